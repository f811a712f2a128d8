"""A whole log in memory, where it is not larger than a log can be."""

from pathlib import Path

from ins.records import InputError

# Of a log that is read at once: 4 h of six IMUs at 2 kHz with 24 bytes a row.
MAX_FILE_BYTES = 4_000_000_000


def is_own_file(file: Path, folder: Path) -> bool:
    """Whether a file of a folder is one, no pipe or device, and no link leads out of the folder."""
    return file.is_file() and file.resolve().is_relative_to(folder.resolve())


def read_whole(path: Path) -> bytes:
    """The bytes of a file; InputError where it is larger than MAX_FILE_BYTES."""
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise InputError(f"{path.name}: {size} bytes, needed at most {MAX_FILE_BYTES}")
    return path.read_bytes()
