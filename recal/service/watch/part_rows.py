"""The rows of a part that grows, as the estimate on the way takes them: read once, summed to about
RATE_HZ, and laid off in a file without a name, so that the memory of an estimate is that of a
piece.
"""

import os
import tempfile
import weakref
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ins.columns import INCREMENT_COLUMNS, RATE_COLUMNS
from ins.json_file import Written, read_json_object
from ins.records import InputError, Run
from trajectories.readers.live.text_source import READ_BYTES, Lines, numbers
from trajectories.runs import streams
from trajectories.runs.checks import MIN_RATE_HZ, Findings
from trajectories.runs.directory import run_sha256
from trajectories.runs.imu_stream import Columns, ImuParts, imu_log
from trajectories.runs.physics_gates import CoSensors, check_physics
from trajectories.runs.schema import header_from_json
from trajectories.runs.stream_files import StreamFile

RATE_HZ = MIN_RATE_HZ
COLUMNS = 8  # of a row that is laid off: time_s, dt_s, dtheta_rad, dv_m_s
ROW_BYTES = 8 * COLUMNS
PIECE_ROWS = 1 << 14  # at once: 27 min at 10 Hz, 1 MB


@dataclass(frozen=True, kw_only=True, eq=False)
class LaidOffImu(ImuParts):
    """The first rows of a file of rows (an `ins.records.ImuSource`).

    file: holds them; rate_hz: of the first piece; index_time_s: time of the first row of each
    piece.
    """

    file: IO[bytes]
    rows: int
    start_s: float
    end_s: float
    rate_hz: float
    index_time_s: NDArray
    source: str = "increments"

    def parts(self, start_s: float, end_s: float) -> Iterator[Columns]:
        """A piece of the file each."""
        first = max(int(np.searchsorted(self.index_time_s, start_s, side="right")) - 1, 0)
        for row in range(first * PIECE_ROWS, self.rows, PIECE_ROWS):
            values = rows_at(self.file, row, min(PIECE_ROWS, self.rows - row))
            a, b = np.searchsorted(values[:, 0], [start_s, end_s], side="right")
            if a < b:
                used = values[a:b]
                yield used[:, 0], used[:, 1], used[:, 2:5], used[:, 5:]
            if b < len(values):
                return


def rows_at(file: IO[bytes], row: int, count: int) -> NDArray:
    """Rows (count, COLUMNS) of a file of them."""
    data = os.pread(file.fileno(), count * ROW_BYTES, row * ROW_BYTES)
    return np.frombuffer(data).reshape(-1, COLUMNS)


class PartRows:
    """The rows of a part that grows, read once and summed to about RATE_HZ."""

    def __init__(self, path: Path) -> None:
        self._path, self._lines = path, Lines(path / "imu.csv")
        self._names: list[str] = []
        self._raw = np.zeros((0, 7))
        self._file = tempfile.TemporaryFile()
        weakref.finalize(self, self._file.close)
        self._rows = 0  # in it

    def run(self, findings: Findings) -> Run | None:
        """The run of the rows that were read; what is wrong with it goes to `findings`."""
        if self._rows < 2:
            return None
        imu = self._imu()
        data = read_json_object(self._path / "run.json", number=Written)
        header, errors, _ = header_from_json(data, name="run.json")
        if header is None:
            raise InputError(errors[0])
        names = ("temperature", "gnss", "odometer")
        held = {name: self._stream(name, imu.end_s, findings) for name in names}
        check_physics(
            imu,
            site=header.site,
            technology=header.gyro_technology,
            label="imu",
            findings=findings,
            beside=CoSensors(
                gnss=held["gnss"],
                odometer=held["odometer"],
                accepted_scale=header.accepted_accel_scale,
            ),
        )
        site = data["site"]
        by_digits = isinstance(site, dict) and "sigma_lat_deg" not in site
        if held["gnss"] is not None and by_digits:
            header = streams.with_receiver(header, held["gnss"])
        run = Run(header=header, imu=imu, **held)
        return replace(run, sha256=run_sha256(run))

    def _imu(self) -> LaidOffImu:
        first = rows_at(self._file, 0, min(PIECE_ROWS, self._rows))
        begins = range(0, self._rows, PIECE_ROWS)
        return LaidOffImu(
            file=self._file,
            rows=self._rows,
            start_s=float(first[0, 0]),
            end_s=float(rows_at(self._file, self._rows - 1, 1)[0, 0]),
            rate_hz=float(1.0 / np.median(np.diff(first[:, 0]))),
            index_time_s=np.array([rows_at(self._file, row, 1)[0, 0] for row in begins]),
        )

    def read(self) -> None:
        """Lay off what the recording holds now, where there is one."""
        if not (self._path / "imu.csv").exists():
            return
        size = (self._path / "imu.csv").stat().st_size
        for _ in range(size // READ_BYTES + 1):  # not what comes meanwhile: it may come faster
            lines = self._lines.read()
            if lines:
                self._take(lines)

    def _take(self, lines: list[bytes]) -> None:
        if not self._names:
            self._names = lines.pop(0).decode().strip().split(",")
        values = numbers(lines, len(self._names), Counter(), ",")
        raw = np.concatenate([self._raw, values])
        if len(raw) < 3:
            self._raw = raw
            return
        is_rate = RATE_COLUMNS[0] in self._names
        at = [0, *(self._names.index(n) for n in (RATE_COLUMNS if is_rate else INCREMENT_COLUMNS))]
        ordered = raw[:, at]
        w, f = ordered[:, 1:4].copy(), ordered[:, 4:7].copy()
        log, _ = imu_log(ordered[:, 0].copy(), w, f, source="rates" if is_rate else "increments")
        rows = np.column_stack([log.time_s, log.dt_s, log.dtheta_rad, log.dv_m_s])
        each = max(int(log.rate_hz * (1.0 + 1e-6) // RATE_HZ), 1)
        # the first row was the last of the block before: it is there for the interval after it
        first = 1 if self._rows else 0
        count = (len(rows) - first) // each
        if not count:
            self._raw = raw
            return
        used = rows[first : first + count * each].reshape(count, each, 8)
        summed = used.sum(axis=1)
        summed[:, 0] = used[:, -1, 0]
        self._file.write(np.ascontiguousarray(summed).data)
        self._file.flush()
        self._rows += count
        self._raw = raw[first + count * each - 1 :]

    def _stream(self, name: str, end_s: float, findings: Findings):
        """A stream until the last row of the imu that was read: it may have grown since."""
        path = self._path / f"{name}.csv"
        if not path.exists():
            return None
        try:
            log = streams.LOADERS[name](StreamFile(path), findings)[0]
        except InputError:  # not a row of it yet
            return None
        if log is None or log.time_s[-1] <= end_s:
            return log
        known = log.time_s <= end_s
        columns = {k: v[known] for k, v in vars(log).items() if isinstance(v, np.ndarray)}
        return replace(log, **columns) if known.any() else None
