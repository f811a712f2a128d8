"""The known log formats, and choosing one: by the map's `format`, else by the content of the
file.

Decision: docs/decisions/0040-known-by-gravity.md.
"""

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from ins.records import GnssLog, ImuLog, InputError, OdometerLog, ReferenceLog, Span, TemperatureLog
from ins.user_input import open_regular
from trajectories.readers.rows.column_map import LogOptions

# Each has READERS; a new format is one more module here. `mapped` stays last: its .mat takes any
# MATLAB file.
MODULES = (
    "ardupilot",
    "px4",
    "ros",
    "navego",
    "psins",
    "kfgins",
    "novatel",
    "exports.xsens",
    "exports.vectornav",
    "datasets.euroc",
    "datasets.kitti",
    "mapped",
)


GZIP = b"\x1f\x8b\x08"
# of R's save(), binary and text, which gzip, bzip2 or xz pack as a rule
R_DATA, R_NAMES = (b"RDX", b"RDA"), (".rda", ".rdata", ".rds")
PACKED = {
    b"PK\x03\x04": "zip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\x00": "xz",
    b"7z\xbc\xaf": "7z",
    b"Rar!": "rar",
    b"\x28\xb5\x2f\xfd": "zstd",
}


@dataclass(frozen=True, kw_only=True)
class ConvertedLog:
    """What a reader found: streams with run time (starting at 0), what it dropped or repaired, and
    what it noticed.

    `time_shift_s` is what was subtracted from the log's own times [s], `wraps_s` the periods by
    which its clock wrapped; `header` holds run.json keys the log knows; `reference` is a solution
    or truth that came with the log, for scoring only; `other_files`: read beside the log.
    """

    imu: ImuLog
    temperature: TemperatureLog | None = None
    gnss: GnssLog | None = None
    odometer: OdometerLog | None = None
    reference: ReferenceLog | None = None
    time_shift_s: float = 0.0
    wraps_s: tuple[float, ...] = ()
    faults: tuple[Span, ...] = ()
    notes: tuple[str, ...] = ()
    other_files: tuple[Path, ...] = ()
    header: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Reader:
    """One format: its name in maps, a line about it, `detect(path)` by content, `read(path,
    options)`.

    folder: whether a log may be a folder; only then do `detect` and `read` see one. gnss_file:
    whether fixes may be in another file (`gnss.file`, --gnss).
    """

    name: str
    about: str
    detect: Callable[[Path], bool]
    read: Callable[[Path, LogOptions], ConvertedLog]
    folder: bool = False
    gnss_file: bool = False


class UnknownLog(InputError):
    """A log that no reader knows by its content."""


def _choices(known: Sequence[Reader]) -> tuple[str, ...]:
    """What somebody with an unknown log can do, and the formats that are known, in short lines."""
    names = [reader.name for reader in known]
    rows = [names[k : k + 6] for k in range(0, len(names), 6)]
    return (
        "  A table (text, Parquet, MATLAB): recal look FILE writes a column map to begin with.",
        "  Raw numbers: a map is written by hand (docs/log_formats.md).",
        "  --format NAME forces one of",
        *(f"    {', '.join(row)}" for row in rows),
    )


def readers() -> tuple[Reader, ...]:
    """All known formats, those that can be recognised first."""
    modules = (importlib.import_module(f"trajectories.readers.formats.{name}") for name in MODULES)
    return tuple(reader for module in modules for reader in module.READERS)


def _refuse_no_log(path: Path) -> None:
    """InputError for what no reader can make anything of, whatever the map says: nothing, an empty
    file, a packed one.
    """
    if not (path.is_file() or path.is_dir()):
        dead = "a link that leads nowhere" if path.is_symlink() else "no such file"
        raise InputError(f"{path}: {'not a file' if path.exists() else dead}")
    if path.is_dir():
        return
    try:
        with open_regular(path) as file:
            head = file.read(8)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    if not head:
        raise InputError(f"{path}: the file is empty (0 bytes)")
    if head.startswith(R_DATA) or path.suffix.lower() in R_NAMES:
        raise InputError(
            f"{path}: R data: write it as a table in R, write.csv(get(load(FILE)), NAME), and give"
            " that with --map"
        )
    for magic, what in PACKED.items():
        if head.startswith(magic):
            raise InputError(f"{path}: a {what} file: unpack it first and give the log in it")
    if (head.startswith(b"\xff\xfe") and head[3::2] == bytes(3)) or (
        head.startswith(b"\xfe\xff") and head[2::2] == bytes(3)
    ):
        raise InputError(
            f"{path}: text in UTF-16, needed UTF-8: save it so (iconv -f UTF-16 -t UTF-8)"
        )
    if head.startswith(GZIP) and path.suffix != ".gz":
        raise InputError(
            f"{path}: a gzip file without .gz in its name: unpack it first, or name it so (text"
            " only)"
        )


def read_log(path: Path, options: LogOptions) -> tuple[str, ConvertedLog]:
    """The name of the format and the log. InputError where the file, its format or an option is
    wrong.
    """
    _refuse_no_log(path)
    known = tuple(reader for reader in readers() if reader.folder or path.is_file())
    name = options.keys.get("format")
    # a column map says itself what it is
    if name is None and path.is_file() and {"gyro", "accel"} & set(options.keys):
        name = importlib.import_module("trajectories.readers.columns.layouts").content_format(path)
    if name is not None:
        chosen = [r for r in known if r.name == name]
        if not chosen and name in (r.name for r in readers()):
            raise InputError(f"{path}: a folder, needed a file: a {name} log is one")
        if not chosen:
            raise InputError(
                f"format: got {str(name)[:40]!r}, needed one of {', '.join(r.name for r in known)}"
            )
    else:
        chosen = list(islice((r for r in known if r.detect(path)), 1))
    if not chosen and path.is_dir():
        raise InputError(
            f"{path}: a folder without a bag (.bag, .db3, .mcap), oxts (KITTI) or mav0 (EuRoC):"
            " needed the file of the log"
        )
    if not chosen:
        raise UnknownLog(f"{path}: format not recognised", _choices(known))
    if "gnss" in options.keys and not chosen[0].gnss_file:
        raise InputError(
            f"{path.name}: [gnss] (--gnss): a {chosen[0].name} log takes no fixes of another file"
        )
    return chosen[0].name, chosen[0].read(path, options)
