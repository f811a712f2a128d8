"""Samples of every reader's format, and ways in which a log gets damaged; a new reader registers
its sample here.
"""

import gzip
import resource
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from tests.trajectories.readers import (
    ardupilot_logs,
    ros_bags,
    test_datasets,
    test_exports,
    test_kfgins,
    test_mat_hdf5,
    test_navego,
    test_novatel,
    test_novatel_binary,
    test_psins,
    test_px4,
)
from tests.trajectories.readers.known_motion import parked
from tests.trajectories.run_cases import F_B, W_B

ROWS = 240
COLUMNS = ["time_s", *(f"gyro_{a}_rad_s" for a in "xyz"), *(f"accel_{a}_m_s2" for a in "xyz")]
NAMED = {
    "time": {"column": "time_s"},
    "gyro": {"columns": COLUMNS[1:4], "unit": "rad/s"},
    "accel": {"columns": COLUMNS[4:], "unit": "m/s2"},
}
PLAUSIBLE_RAD_S, PLAUSIBLE_M_S2 = 100.0, 2000.0
MEMORY_BYTES = 1 << 30  # that a damaged sample of some ten kilobytes may never ask for
HANG_S = 60  # a reader that takes this long for such a sample does not come back


@dataclass(frozen=True)
class Sample:
    """A small whole log: `write(path)` makes it (a file); options for `read_log`."""

    reader: str
    suffix: str
    write: Callable[[Path], Any]
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return f"{self.reader}{self.suffix}"


def table(rows: int = ROWS) -> np.ndarray:
    """A parked unit at 100 Hz, shape (rows, 7), with noise so that no row repeats another."""
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((rows, 6)) * [1e-5] * 3
    return np.column_stack([10 + 0.01 * np.arange(rows), np.tile([*W_B, *F_B], (rows, 1)) + noise])


def _csv(path: Path) -> None:
    text = "".join(",".join(map(repr, row)) + "\n" for row in table().tolist())
    data = (",".join(COLUMNS) + "\n" + text).encode()
    path.write_bytes(gzip.compress(data) if path.name.endswith(".gz") else data)


def _text(path: Path) -> None:
    path.write_text(
        " ".join(COLUMNS)
        + "\n"
        + "".join(" ".join(map(repr, row)) + "\n" for row in table().tolist())
    )


def _parquet(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(dict(zip(COLUMNS, table().T))), path)


def _mat(path: Path) -> None:
    savemat(
        path,
        {"imu": {"t": table()[:, 0], "w": table()[:, 1:4], "f": table()[:, 4:]}},
        do_compression=True,
    )


def _bag(form: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        made = ros_bags.write(
            path.with_name(f"bag-{path.name}"), form, ros_bags.messages(rows=ROWS)
        )
        stored = made if made.is_file() else next(p for p in made.iterdir() if p.suffix != ".yaml")
        path.write_bytes(stored.read_bytes())
        shutil.rmtree(made) if made.is_dir() else made.unlink()

    return write


def _euroc(path: Path) -> None:
    folder = path.with_name(f"folder-{path.name}")
    path.write_bytes(test_datasets.euroc(folder, SHORT, yaml="").read_bytes())
    shutil.rmtree(folder)


def _novatel_frames(path: Path) -> None:
    frames = [test_novatel_binary.config(26, (0.0, 0.0, 0.0))]
    frames += test_novatel_binary.raw_frames(SHORT)
    for k in (1, 2):
        t = test_novatel_binary.SECONDS + k
        frames += [test_novatel_binary.position(t, k), test_novatel_binary.velocity(t, 2.0)]
        frames += [test_novatel_binary.solution(t, 3)]
    path.write_bytes(b"".join(frames))


SHORT = parked(seconds=ROWS / 100, start_s=20.0)
MAT = {
    "time": {"column": "imu.t"},
    "gyro": {"columns": [f"imu.w[{k}]" for k in range(3)], "unit": "rad/s"},
    "accel": {"columns": [f"imu.f[{k}]" for k in range(3)], "unit": "m/s2"},
}
SAMPLES = [
    Sample("csv", ".csv", _csv),
    Sample("csv", ".csv.gz", _csv),
    Sample("text", ".txt", _text, {**NAMED, "header_lines": 1}),
    Sample("binary", ".bin", lambda path: table().tofile(path), {**NAMED, "columns": COLUMNS}),
    Sample("parquet", ".parquet", _parquet),
    Sample("mat", ".mat", _mat, MAT),
    Sample(
        "dataflash",
        ".bin",
        lambda path: ardupilot_logs.write(path, ardupilot_logs.old_messages(rows=ROWS)),
    ),
    Sample(
        "dataflash",
        "-new.bin",
        lambda path: ardupilot_logs.write(path, ardupilot_logs.new_messages(rows=ROWS)),
        {"imu": 2},
    ),
    Sample("dataflash_text", ".log", lambda path: ardupilot_logs.write_text(path, rows=ROWS)),
    Sample(
        "ardupilot_mat",
        ".mat",
        lambda path: savemat(path, ardupilot_logs.mat_variables(rows=ROWS), do_compression=True),
    ),
    Sample(
        "ardupilot_mat",
        "-plain.mat",
        lambda path: savemat(path, ardupilot_logs.mat_variables(rows=ROWS)),
    ),
    Sample("ulog", ".ulg", lambda path: test_px4.write(path, test_px4.ulog(rows=ROWS))),
    Sample("psins", ".imu", lambda path: test_psins.simu_file(path, SHORT)),
    Sample("psins", ".txt", lambda path: test_psins.text_file(path, SHORT)),
    Sample(
        "psins",
        ".mat",
        lambda path: savemat(
            path,
            {"imu": test_psins.imu_rows(SHORT), "gps": test_psins.gps_rows(3)},
            do_compression=True,
        ),
    ),
    Sample("kfgins", ".txt", lambda path: test_kfgins.write_imu(path, SHORT)),
    Sample(
        "kfgins",
        ".bin",
        lambda path: np.column_stack([SHORT.time_s, SHORT.dtheta, SHORT.dv]).tofile(path),
    ),
    Sample(
        "navego",
        ".mat",
        lambda path: test_navego.write(path, imu1=test_navego.imu(SHORT), gnss1=test_navego.gnss()),
    ),
    Sample("novatel", ".gps", _novatel_frames),
    Sample("xsens", ".txt", lambda path: test_exports.xsens(path, SHORT)),
    Sample("vectornav", ".csv", lambda path: test_exports.vectornav(path, SHORT)),
    Sample("euroc", ".csv", _euroc),
    Sample("kitti", ".txt", lambda path: test_datasets.tracking(path)),
    Sample("mat", "-7.3.mat", test_mat_hdf5.small_log, test_mat_hdf5.MAP),
    Sample("novatel", ".asc", lambda path: test_novatel.write(path, test_novatel.raw_lines(SHORT))),
    *(
        Sample("ros", f"-{form}.{end}", _bag(form))
        for form, end in (
            ("ros1", "bag"),
            ("ros1-bz2", "bag"),
            ("sqlite3", "db3"),
            ("mcap", "mcap"),
            ("mcap-storage", "mcap"),
        )
    ),
]


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """One or more of: cut off, bits flipped, blocks zeroed, lost, doubled, swapped, foreign bytes,
    wild lengths.
    """
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        data = WAYS[rng.integers(len(WAYS))](bytearray(data), rng) if data else data
    return data


def _place(data: bytearray, rng: np.random.Generator) -> int:
    """Anywhere; half of the time within the first kilobyte, where formats say what they hold."""
    return int(rng.integers(min(len(data), 1000) if rng.random() < 0.5 else len(data)))


def _cut(data: bytearray, rng: np.random.Generator) -> bytes:
    return bytes(data[: _place(data, rng)])


def _flip(data: bytearray, rng: np.random.Generator) -> bytes:
    for _ in range(int(rng.integers(1, 20))):
        data[_place(data, rng)] ^= 1 << int(rng.integers(8))
    return bytes(data)


def _zero(data: bytearray, rng: np.random.Generator) -> bytes:
    at, size = _place(data, rng), int(rng.integers(1, 600))
    data[at : at + size] = bytes(len(data[at : at + size]))
    return bytes(data)


def _lose(data: bytearray, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return bytes(data[:at] + data[at + int(rng.integers(1, 2000)) :])


def _double(data: bytearray, rng: np.random.Generator) -> bytes:
    at, size = _place(data, rng), int(rng.integers(1, 2000))
    return bytes(data[: at + size] + data[at:])


def _foreign(data: bytearray, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return bytes(data[:at]) + rng.bytes(int(rng.integers(1, 300))) + bytes(data[at:])


def _wild(data: bytearray, rng: np.random.Generator) -> bytes:
    """A length, count or number of four or eight bytes: huge, nought or negative."""
    at, size = _place(data, rng), int(rng.choice([2, 4, 8]))
    word = (
        b"\xff" * size,
        b"\xff" * (size - 1) + b"\x7f",
        bytes(size),
        b"\0" * (size - 1) + b"\x80",
        b"\xff\xff\xff\xe7",
    )
    new = word[int(rng.integers(len(word)))]
    data[at : at + len(new)] = new
    return bytes(data)


WAYS = (_cut, _flip, _flip, _zero, _lose, _double, _foreign, _wild, _wild)


class Hung(Exception):
    """The reader did not come back."""


@contextmanager
def bounded() -> Iterator[None]:
    """No more memory than MEMORY_BYTES beyond what is in use, and no more time than HANG_S."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)

    def hung(number: int, frame: Any) -> None:
        raise Hung(f"no end after {HANG_S} s")

    before = signal.signal(signal.SIGALRM, hung)
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, hard))
    signal.alarm(HANG_S)
    try:
        yield
    finally:
        signal.alarm(0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGALRM, before)
