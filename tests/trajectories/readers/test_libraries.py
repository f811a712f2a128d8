"""Why ULog and bags have own parsers: on damaged logs they find more right numbers than the
libraries. Where this fails, a library has become as good, and the own parser may go
(docs/decisions/0087-libraries-in-a-child.md).
"""

import contextlib
import io
from collections import defaultdict

import numpy as np
import pytest

from tests.trajectories.readers import damage
from trajectories.readers.containers.ros_messages import IMU
from trajectories.readers.containers.ulog_file import read_ulog
from trajectories.readers.formats.px4 import WANTED_TOPICS
from trajectories.readers.formats.ros import read_bag

LOGS = 100


def ulog_by_us(path):
    topics = read_ulog(path, WANTED_TOPICS).topics
    return {(*key, name): v for key, topic in topics.items() for name, v in topic.items()}


def ulog_by_pyulog(path):
    from pyulog import ULog

    topics = ULog(str(path), WANTED_TOPICS).data_list
    return {
        (t.name, t.multi_id, name): v.astype(float) for t in topics for name, v in t.data.items()
    }


def bag_by_us(path):
    topics = read_bag(path).of_kind(IMU)
    return {topic.name: topic.values[:, [0, 1, 2, 4, 5, 6]] for topic in topics}


def bag_by_rosbags(path):
    from rosbags.highlevel import AnyReader

    rows = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if connection.msgtype.endswith("/Imu"):
                w, f = message.angular_velocity, message.linear_acceleration
                rows[connection.topic].append((w.x, w.y, w.z, f.x, f.y, f.z))
    return {name: np.array(values) for name, values in rows.items()}


def right_and_wrong(read, path, whole):
    """Numbers that the whole log has in the same column, and others; none where it is not read."""
    found = {}
    with contextlib.suppress(Exception, damage.Hung), contextlib.redirect_stdout(io.StringIO()):
        with damage.bounded():
            found = read(path)
    right = sum(int(np.isin(v, whole.get(k, ())).sum()) for k, v in found.items())
    return np.array([right, sum(v.size for v in found.values()) - right])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the libraries: open files, garbled floats
@pytest.mark.parametrize(
    ("name", "ours", "theirs"),
    [
        ("ulog.ulg", ulog_by_us, ulog_by_pyulog),
        ("ros-ros1.bag", bag_by_us, bag_by_rosbags),
        ("ros-sqlite3.db3", bag_by_us, bag_by_rosbags),
        ("ros-mcap.mcap", bag_by_us, bag_by_rosbags),
    ],
)
def test_own_parsers_find_more_in_damaged_logs(tmp_path, monkeypatch, name, ours, theirs):
    monkeypatch.setattr(damage, "HANG_S", 10)
    sample = next(s for s in damage.SAMPLES if s.name == name)
    path = tmp_path / f"log{sample.suffix}"
    sample.write(path)
    data, whole = path.read_bytes(), ours(path)
    own, library = np.zeros(2), np.zeros(2)
    for k in range(LOGS):
        path.write_bytes(damage.damaged(data, np.random.default_rng([11, k])))
        own += right_and_wrong(ours, path, whole)
        library += right_and_wrong(theirs, path, whole)
    print(f"{name}: right and wrong, own {own}, library {library}")
    assert own[0] > 1.1 * library[0]
    # pyulog takes what it meets for messages; of bags the library reads too few to err
    assert name != "ulog.ulg" or 2 * own[1] < library[1]
