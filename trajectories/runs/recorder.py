"""A run that is being recorded: streams of text that grow, readable to the last second whatever
ends the recording.

Rows are written whole and put on the disk once a second. What a kill or a full disk leaves of a
last row is cut off, at once or when the recording goes on.
"""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ins.columns import FIX_SIGMA_COLUMNS, GYRO_DEGC, POSITION, RATE_COLUMNS, VELOCITY
from ins.json_file import read_json_object
from ins.records import InputError, RunHeader
from trajectories.runs.schema import ConversionRecord, header_to_json

COLUMNS: Mapping[str, Sequence[str]] = {
    "imu": ("time_s", *RATE_COLUMNS),
    "temperature": ("time_s", *GYRO_DEGC),
    "gnss": ("time_s", *POSITION, *VELOCITY, *FIX_SIGMA_COLUMNS),
}
TAIL_BYTES = 1 << 16  # of a file, in which its last row is looked for: a row has some 200


LIVE = "live"  # `conversion.format` of a run that was recorded so


def run_text(header: RunHeader, source: str, shift_s: float) -> str:
    """run.json of a run that is recorded from a source, whose times are shifted by so much."""
    made = ConversionRecord(source=source, source_sha256="", format=LIVE, time_shift_s=shift_s)
    said = header_to_json(header, conversion=made)
    return json.dumps(said, indent=1, allow_nan=False) + "\n"


class Recorder:
    """Appends rows to the streams of a run directory; goes on with one that it began.

    Parameters
    ----------
    path : Path
        The run directory, made where it is not there.
    text : str
        Its run.json, of a new run; an older one keeps its own, so that the same rows make the same
        run.

    Attributes
    ----------
    shift_s : float
        What is taken off the times of the source, as run.json says.
    last_s : dict
        Time of the last row of each stream that was there before.

    Raises
    ------
    InputError
        Where the folder holds something else, or cannot be written.
    """

    def __init__(self, path: Path, text: str) -> None:
        self.path, self.shift_s = path, 0.0
        self.last_s: dict[str, float] = {}
        self._files: dict[str, int] = {}
        self._sizes: dict[str, int] = {}
        with _written(path):
            path.mkdir(parents=True, exist_ok=True)
            self._begin(text)

    def _begin(self, text: str) -> None:
        run_json = self.path / "run.json"
        if not run_json.exists():
            if any(file.name != ".run.json" for file in self.path.iterdir()):
                raise InputError(f"{self.path}: exists and is not a run, not written to")
            new = self.path / ".run.json"
            new.write_text(text, encoding="utf-8")
            new.rename(run_json)
            _synced(self.path)
        kept, mine = read_json_object(run_json), json.loads(text)
        made = kept.get("conversion")
        is_own = isinstance(made, dict) and made.get("format") == LIVE
        if not (is_own or run_json.read_text("utf-8") == text):
            raise InputError(f"{self.path}: a run that no watch began, not written to")
        if kept["imu_serial"] != mine["imu_serial"]:
            raise InputError(
                f"{self.path}: a run of unit {kept['imu_serial']}, not of {mine['imu_serial']}"
            )
        if isinstance(made, dict) and is_own:
            self.shift_s = float(str(made["time_shift_s"]))
        for file in self.path.glob("*.csv"):
            self._go_on(file)

    def _go_on(self, file: Path) -> None:
        """Cut a last row that is not whole, and find the time of the last one."""
        size = file.stat().st_size
        with file.open("r+b") as text:
            text.seek(max(size - TAIL_BYTES, 0))
            tail = text.read()
            whole = tail.rfind(b"\n") + 1
            text.truncate(size - len(tail) + whole)
        lines = tail[:whole].splitlines()
        header_only = size <= TAIL_BYTES and len(lines) < 2
        if not lines:
            file.unlink()
        elif not header_only:
            self.last_s[file.stem] = float(lines[-1].split(b",")[0])

    def append(self, stream: str, rows: Iterable[str], columns: Sequence[str] = ()) -> None:
        """Add rows of numbers between commas to a stream; columns: its names, where they are not
        COLUMNS. InputError where they cannot be written; the stream then ends with a whole row.
        """
        with _written(self.path):
            if stream not in self._files:
                self._open(stream, columns or COLUMNS[stream])
            data = "".join(f"{row}\n" for row in rows).encode()
            self._write(stream, data)

    def sync(self) -> None:
        """Put on the disk what was written."""
        with _written(self.path):
            for file in self._files.values():
                os.fsync(file)

    def close(self) -> None:
        """Put all on the disk and close the files."""
        self.sync()
        for file in self._files.values():
            os.close(file)
        self._files.clear()

    def _open(self, stream: str, columns: Sequence[str]) -> None:
        file = self.path / f"{stream}.csv"
        self._files[stream] = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        self._sizes[stream] = file.stat().st_size
        if not self._sizes[stream]:
            self._write(stream, f"{','.join(columns)}\n".encode())
            _synced(self.path)

    def _write(self, stream: str, data: bytes) -> None:
        file, size = self._files[stream], self._sizes[stream]
        try:
            left = memoryview(data)
            while left:
                left = left[os.write(file, left) :]
        except OSError:
            os.ftruncate(file, size)
            raise
        self._sizes[stream] = size + len(data)


class _written:
    """What the operating system refuses is an InputError that names the run."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, OSError):
            raise InputError(
                f"{self._path}: cannot be written ({error.strerror or error}); what was recorded"
                " stays, the same command goes on"
            ) from None


def _synced(folder: Path) -> None:
    """Put the names in a folder on the disk."""
    handle = os.open(folder, os.O_RDONLY)
    os.fsync(handle)
    os.close(handle)
