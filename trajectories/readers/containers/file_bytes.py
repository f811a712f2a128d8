"""A whole log in memory, where it is not larger than a log can be."""

from pathlib import Path

from ins.records import InputError
from ins.user_input import read_bounded

# Of a log that is read at once: 4 h of six IMUs at 2 kHz with 24 bytes a row.
MAX_FILE_BYTES = 4_000_000_000


def is_own_file(file: Path, folder: Path) -> bool:
    """Whether a file of a folder is one, no pipe or device, and no link leads out of the folder."""
    return file.is_file() and file.resolve().is_relative_to(folder.resolve())


def read_whole(path: Path) -> bytes:
    """The bytes of a file; InputError where it is larger than MAX_FILE_BYTES."""
    try:
        return read_bounded(path, MAX_FILE_BYTES)
    except OSError as error:
        raise InputError(f"{path.name}: cannot be read ({error.strerror or error})") from None
