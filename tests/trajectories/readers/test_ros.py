"""ROS bags of every form (ros_bags.py, by rosbags' writers): axes, units, time, topics, and bags
that are damaged.
"""

import re
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from ins.attitude import dcm_from_euler
from ins.records import FixType, InputError
from ins.units import DEG
from trajectories.readers.containers import unpacking
from trajectories.readers.conversion import convert_log
from trajectories.readers.formats import ros
from trajectories.readers.registry import read_log
from trajectories.readers.rows.column_map import LogOptions

pytest.importorskip("rosbags", reason="rosbags (extra `ros`) writes the bags")
from tests.trajectories.readers import ros_bags as bags

GIVEN = {"imu_serial": "SN-1", "gyro_technology": "mems"}
DT_S = 1 / bags.RATE_HZ


def convert(path: Path, options=None, given=GIVEN):
    return convert_log(path, options or {}, given)


def check_motion(run, *, rows=bags.ROWS, first=1):
    """Forward, right, down: what the levels of the messages mean, and the turn to the right."""
    assert run.imu.rows == rows
    rates = run.imu.dtheta_rad / run.imu.dt_s[:, None]
    forces = run.imu.dv_m_s / run.imu.dt_s[:, None]
    fx, fy, fz = forces[first]
    assert np.arcsin(fx / bags.G) == pytest.approx(bags.PITCH, abs=1e-9)
    assert np.arctan2(-fy, -fz) == pytest.approx(bags.ROLL, abs=1e-9)
    turning = run.imu.time_s - run.imu.time_s[0] >= bags.PARKED_S - DT_S / 2
    np.testing.assert_allclose(
        rates[turning], np.tile([0, 0, bags.TURN], (turning.sum(), 1)), atol=1e-12
    )
    np.testing.assert_allclose(rates[~turning], 0.0, atol=1e-15)


@pytest.mark.parametrize("form", bags.FORMS)
def test_axes_units_and_time(tmp_path, form):
    """UTC by hand: 1 700 000 000 s since 1970; the first row ends the first interval of 10 ms."""
    made = convert(bags.write(tmp_path / f"walk.{form}.bag", form))
    run = made.run
    check_motion(run)
    assert made.record.format == "ros" and run.header.run_id == "walk"
    assert run.header.start_utc == "2023-11-14T22:13:19.990Z"
    assert made.record.time_shift_s == pytest.approx(1_700_000_000 - DT_S, abs=1e-6)
    # of the stamps: receiving jitters by 0.6 ms
    np.testing.assert_allclose(np.diff(run.imu.time_s), DT_S, atol=1e-8)
    assert run.header.site.lat_rad == pytest.approx(30 * DEG) and run.header.site.height_m == 250.0
    np.testing.assert_allclose(
        run.gnss.v_n_m_s, np.tile([bags.NORTH, bags.EAST, -bags.UP], (40, 1))
    )
    np.testing.assert_allclose(run.gnss.sigma_horizontal_m, np.sqrt(2.0))
    np.testing.assert_allclose(run.gnss.sigma_vertical_m, 3.0)
    np.testing.assert_array_equal(run.gnss.fix_type, FixType.SINGLE)
    np.testing.assert_allclose(run.gnss.sigma_velocity_m_s, np.sqrt(0.14 / 3))
    assert run.gnss.time_s[0] == pytest.approx(6 * DT_S, abs=1e-7)
    np.testing.assert_allclose(
        run.temperature.gyro_degC[:, 2], 30 + (run.temperature.time_s - DT_S) / 10, atol=1e-6
    )
    assert any("frame_id 'imu_link': axes taken as REP-103" in n for n in made.record.notes)


def test_level_of_the_parked_vehicle(tmp_path):
    """The project's own attitude: roll right side down, pitch nose up, through a bag."""
    run = convert(bags.write(tmp_path / "b", "mcap")).run
    f_b = dcm_from_euler(bags.ROLL, bags.PITCH, 1.0).T @ [0.0, 0.0, -bags.G]
    np.testing.assert_allclose(
        run.imu.dv_m_s[1:] / run.imu.dt_s[1:, None], np.tile(f_b, (bags.ROWS - 1, 1)), atol=1e-9
    )


def test_the_same_messages_as_rosbags(tmp_path):
    """Stamps and values of every message bit for bit as by the library, ROS 1 and ROS 2."""
    from rosbags.highlevel import AnyReader

    for form in ("ros1-lz4", "sqlite3", "mcap-storage"):
        path = bags.write(tmp_path / (f"{form}.bag" if form.startswith("ros1") else form), form)
        own = ros.read_bag(path)
        with AnyReader([path]) as reader:
            theirs = [
                (c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()
            ]
        for topic in own.topics.values():
            same = [(t, m) for name, t, m in theirs if name == topic.name]
            assert list(topic.receive_ns) == [t for t, _ in same]
            assert list(topic.stamp_ns) == [
                m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in same
            ]
        w = [m.angular_velocity for name, _, m in theirs if name == "/imu/data"]
        np.testing.assert_array_equal(
            own.topics["/imu/data"].values[:, :3], [(v.x, v.y, v.z) for v in w]
        )


def test_files_by_themselves_and_in_parts(tmp_path):
    """A storage file without its folder; a folder of parts, whose tenth comes after its second."""
    whole = bags.messages()
    check_motion(convert(next(bags.write(tmp_path / "a", "mcap").glob("*.mcap"))).run)
    check_motion(convert(next(bags.write(tmp_path / "b", "sqlite3").glob("*.db3"))).run)
    (tmp_path / "walk").mkdir()
    edges = np.linspace(0, len(whole), 12).astype(int)
    for k in range(11):
        part = bags.write(tmp_path / f"part{k}", "mcap", whole[edges[k] : edges[k + 1]])
        shutil.copy(next(part.glob("*.mcap")), tmp_path / "walk" / f"walk_{k}.mcap")
    check_motion(convert(tmp_path / "walk").run)


def test_another_mounting(tmp_path):
    """The same unit in axes forward, right, down already; REP-103 is then wrong, and the reader
    says what it sees.
    """
    w, f = np.array([1.0, -1.0, -1.0]), bags.f_flu() * [1.0, -1.0, -1.0]
    made = [
        m if "Imu" not in m[1] else (*m[:3], (m[3][0], "base_frd", w * m[3][2], f))
        for m in bags.messages()
    ]
    path = bags.write(tmp_path / "b", "mcap", made)
    check_motion(convert(path, {"axes": {"x": "x", "y": "y", "z": "z"}}).run)
    with pytest.raises(InputError, match="frame_id 'base_frd'"):
        convert(path)


# Topics


TWO = ("/imu/data", "/imu/data_raw")


def test_several_imus(tmp_path):
    path = bags.write(tmp_path / "b", "mcap", bags.messages(imu_topics=TWO))
    with pytest.raises(InputError, match="1 /imu/data, 2 /imu/data_raw"):
        convert(path)
    check_motion(convert(path, {"imu": 1}).run)
    for options in ({"imu": 2}, {"imu_topic": "/imu/data_raw"}):
        rates = convert(path, options).run.imu.dtheta_rad[-1] / DT_S
        np.testing.assert_allclose(rates, [0, 0, 2 * bags.TURN], atol=1e-7)
    with pytest.raises(InputError, match=r"b: no /imu, has 1 /imu/data, 2 /imu/data_raw"):
        convert(path, {"imu_topic": "/imu"})


def test_three_thermometers(tmp_path):
    names = ["/t/a", "/t/b", "/t/c"]
    path = bags.write(tmp_path / "b", "sqlite3", bags.messages(temperature_topics=names))
    made = convert(path)
    assert made.run.temperature is None
    assert any("/t/a, /t/b, /t/c" in n for n in made.record.notes)
    T = convert(path, {"temperature_topics": names}).run.temperature
    np.testing.assert_allclose(T.gyro_degC[0] - T.gyro_degC[0, 0], [0, 10, 20], atol=1e-9)
    T = read_log(
        path, LogOptions({"temperature_topics": names, "axes": {"x": "y", "y": "z", "z": "x"}})
    )[1].temperature
    # a thermometer follows its gyro
    np.testing.assert_allclose(T.gyro_degC[0] - T.gyro_degC[0, 2], [10, 20, 0], atol=1e-9)
    with pytest.raises(InputError, match="temperature_topics"):
        convert(path, {"temperature_topics": ["/t/a", "/x"]})


def test_a_velocity_of_another_frame_is_not_taken(tmp_path):
    """A commanded velocity is a TwistStamped as well."""
    path = bags.write(
        tmp_path / "b", "mcap", bags.messages(velocity_frame="base_link", twist="TwistStamped")
    )
    made = convert(path)
    notes = " ".join(made.record.notes)
    assert "/vel has frame_id 'base_link'" in notes
    assert "fixes have no velocity: differences of their positions" in notes
    np.testing.assert_allclose(made.run.gnss.v_n_m_s, 0.0, atol=1e-9)
    assert np.all(made.run.gnss.sigma_velocity_m_s > 3)  # 1.4 m on either side of 0.4 s
    gnss = convert(path, {"velocity_topic": "/vel"}).run.gnss
    np.testing.assert_allclose(gnss.v_n_m_s[0], [bags.NORTH, bags.EAST, -bags.UP])
    assert gnss.sigma_velocity_m_s is None and gnss.sigma_vertical_m[0] == pytest.approx(3.0)


def test_fixes_with_neither_velocity_nor_covariance_give_the_site(tmp_path):
    made = [m for m in bags.messages(unknown_covariance=True) if m[0] != "/vel"]
    made = convert(bags.write(tmp_path / "b", "sqlite3", made))
    assert made.run.gnss is None and made.run.header.site.lat_rad == pytest.approx(30 * DEG)
    assert any("the fixes give the site only" in n for n in made.record.notes)


def test_a_bag_without_fixes_or_dates_needs_them(tmp_path):
    """A simulated clock from 0 is no UTC."""
    path = bags.write(tmp_path / "b", "mcap", bags.messages(with_fix=False, start_ns=10**9))
    with pytest.raises(InputError, match=r"start_utc .*lat_deg"):
        convert(path)
    site = {"lat_deg": 30.0, "lon_deg": 7.0, "height_m": 250.0, "start_utc": "2026-01-01T00:00:00Z"}
    check_motion(convert(path, given={**GIVEN, **site}).run)


def test_no_imu(tmp_path):
    made = [m for m in bags.messages() if "Imu" not in m[1]]
    with pytest.raises(InputError, match=r"b: no topic of sensor_msgs/Imu, has none"):
        convert(bags.write(tmp_path / "b", "mcap", made))
    without = [(*m[:3], (*m[3][:3], None)) if "Imu" in m[1] else m for m in bags.messages()]
    with pytest.raises(InputError, match="no linear acceleration"):
        convert(bags.write(tmp_path / "c", "mcap", without))


# Stamps


def test_stamps_that_go_back_repeat_or_jump_are_listed(tmp_path):
    stamps = bags.START_NS + np.arange(bags.ROWS) * 10**7
    stamps[100] = stamps[90]
    stamps[[300, 301]] = stamps[[301, 300]]
    stamps[500] += 3600 * 10**9
    made = convert(bags.write(tmp_path / "b", "sqlite3", bags.messages(stamps=stamps)))
    check_motion(made.run, rows=bags.ROWS - 2)
    notes = " ".join(made.record.notes)
    assert "row 501 dropped" in notes
    assert "row 101 dropped" in notes and "row 302 written late, put back" in notes
    assert [s.reason for s in made.run.faults] == ["dropout: 1 imu rows lost"] * 2


# Damage


@pytest.mark.parametrize("form", ["ros1", "ros1-bz2", "mcap", "mcap-storage"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_cut_off(tmp_path, form, share):
    """Messages of whole chunks before the cut, and of the cut one if it is not packed, are read."""
    path = bags.write(tmp_path / "whole.bag", form)
    path = next(path.glob("*.mcap")) if path.is_dir() else path
    data = path.read_bytes()
    (tmp_path / "cut").write_bytes(data[: int(share * len(data))])
    try:
        made = convert(tmp_path / "cut")
    except InputError as error:
        # one packed chunk
        assert form == "mcap-storage" and "no topic of sensor_msgs/Imu, has none" in str(error)
        assert re.search(r"chunk at byte \d+ damaged", str(error))
        return
    assert made.run.imu.rows > (0.9 * share - 0.15) * bags.ROWS
    notes = " ".join(made.record.notes)
    # index lost
    assert (
        "read up to there" in notes
        or "recording not finished" in notes
        or made.run.imu.rows == bags.ROWS
    )
    np.testing.assert_allclose(made.run.imu.dv_m_s[:, 2] / DT_S, -bags.f_flu()[2], rtol=1e-5)


def test_a_bag_whose_libraries_are_missing_says_what_to_install(tmp_path, monkeypatch):
    path = bags.write(tmp_path / "b", "mcap-storage")

    def absent(data, size):
        raise ImportError("backports.zstd")

    monkeypatch.setitem(unpacking.UNPACK, "zstd", absent)
    with pytest.raises(InputError, match=r"strapdown-recal\[ros\]"):
        convert(path)


def test_hostile_databases(tmp_path):
    """A view in place of a table, a text in place of bytes, a value of another table's size."""
    path = tmp_path / "a.db3"
    base = sqlite3.connect(path)
    base.execute("CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT)")
    base.execute("INSERT INTO topics VALUES (1, '/imu', 'sensor_msgs/msg/Imu', 'cdr')")
    base.execute(
        "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) "
        "SELECT id, 1 AS topic_id, id AS timestamp, zeroblob(100) AS data FROM n"
    )
    base.commit()
    with pytest.raises(InputError, match="not a ROS 2 bag"):
        convert(path)
    base.execute("DROP VIEW messages")
    base.execute(
        "CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB)"
    )
    base.executemany(
        "INSERT INTO messages VALUES (?, 1, ?, ?)",
        [(k, k, "text" if k % 2 else bytes(400)) for k in range(50)],
    )
    base.commit()
    base.close()
    with pytest.raises(InputError, match="no topic of sensor_msgs/Imu"):
        convert(path)
