"""What a user brings in: files, of which regular ones alone are opened, and text, which is shown
with its control characters as escapes.

A pipe would keep its reader waiting and a device never ends; a line end in a serial would write a
line of its own. Loads nothing but the standard library: every command reads the user's settings
before its options.
"""

import errno
import os
import stat
from io import BufferedReader
from pathlib import Path

LONGEST_PRINTED = 1000  # characters of one printed line; chosen: 12 lines of a terminal


def open_regular(path: Path) -> BufferedReader:
    """A file that a user named, open for reading.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    stream : BufferedReader
        At its beginning; the caller closes it.

    Raises
    ------
    OSError
        Where it cannot be opened, or is a directory, pipe, device or socket.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe is opened without its writer
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(errno.EINVAL, "a pipe or device, needed a regular file", str(path))


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """The bytes of a file that a user named.

    Parameters
    ----------
    path : Path
        The file.
    most_bytes : int
        More are not read.

    Returns
    -------
    data : bytes

    Raises
    ------
    OSError
        As `open_regular`, and where the file is larger.
    """
    with open_regular(path) as stream:
        # the size is asked first: read() makes room for all that it may read
        size = os.fstat(stream.fileno()).st_size
        data = stream.read(min(size, most_bytes) + 1)
    if len(data) > most_bytes:
        told = f"more than {most_bytes} bytes, needed at most that"
        raise OSError(errno.EFBIG, told, str(path))
    return data


def visible(text: str) -> str:
    """A text with nothing in it that a terminal or a page would obey.

    Parameters
    ----------
    text : str
        From a file or an option.

    Returns
    -------
    text : str
        Control characters, line ends, marks of direction and halves of characters as escapes.

    Examples
    --------
    >>> visible("SN-1\\n9 revisions, intact")
    'SN-1\\\\n9 revisions, intact'
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def one_line(text: str) -> str:
    """A text as one line of a terminal.

    Parameters
    ----------
    text : str
        From a file or an option, of any length.

    Returns
    -------
    line : str
        `visible`, of at most LONGEST_PRINTED characters and what was left out.
    """
    line = visible(text[:LONGEST_PRINTED])
    left_out = len(text) - LONGEST_PRINTED
    return line if left_out <= 0 else f"{line}... ({left_out} characters more)"
