"""How much a file may unpack to: what a small file asks for is bounded before it is made.

Counted are the bytes that come out, and of numbers the eight bytes each that they take in memory.
A file may grow to SMALL_BYTES in any case, and MAX_GROWTH times its own size where that is more;
the numbers of it that are held in memory at once to HELD_BYTES;
`recal --max-unpacked-mb MB COMMAND`, which sets the variable RECAL_MAX_UNPACKED_MB of the
environment (so that worker processes have it too), gives another limit for all files.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from ins.records import InputError

SMALL_BYTES = 1 << 28  # 268 MB: an hour at 1 kHz of seven numbers is 202 MB
# Rows of an IMU at rest grow 4- to 20-fold from gzip; zeros grow a thousandfold.
MAX_GROWTH = 50
NUMBER_BYTES = 8  # of a float64
# Of the numbers that one file puts into memory: seven columns of an hour at 1 kHz are 202 MB. What
# is made of them takes up to four times as much, 1 GB with the program.
HELD_BYTES = 220_000_000
GROWTH_BYTES = 1 << 30  # 1 GB, chosen, of a child that reads a file: 4 times HELD_BYTES
# chosen: 1 each for the file's bytes, the library's array and the numbers, 1 to spare
GROWTH_SHARE = 4
VARIABLE = "RECAL_MAX_UNPACKED_MB"
OPTION = "recal --max-unpacked-mb"
MEGABYTE = 1_000_000
MAX_MEGABYTES = 1_000_000  # of the option: 1 TB, beyond any machine


def most_unpacked(packed_bytes: int) -> int:
    """The bytes that so many packed ones may become."""
    return _asked_for() or max(SMALL_BYTES, MAX_GROWTH * packed_bytes)


def most_growth() -> int:
    """The bytes that a child which reads a file may grow by."""
    return max(GROWTH_BYTES, GROWTH_SHARE * (_asked_for() or 0))


def _asked_for() -> int | None:
    """The limit of the option or the environment [bytes]; None where neither is given."""
    text = os.environ.get(VARIABLE, "")
    if not text:
        return None
    if not (text.isascii() and text.isdecimal() and 0 < int(text[:9]) <= MAX_MEGABYTES):
        raise InputError(f"{VARIABLE}: got {text[:40]!r}, needed 1 to {MAX_MEGABYTES}")
    return int(text) * MEGABYTE


def refuse_unpacked(unpacked: int, packed_bytes: int, label: str, what: str = "bytes") -> None:
    """InputError where `unpacked` bytes, declared or counted so far, are more than may be."""
    most = most_unpacked(packed_bytes)
    if unpacked > most:
        raise InputError(
            f"{label}: {packed_bytes} bytes hold {unpacked} or more {what} unpacked, needed at most"
            f" {most} ({OPTION} raises it)"
        )


def refuse_held(rows: int, columns: int, label: str) -> None:
    """InputError where so many rows of numbers take more memory than one file may."""
    most = _asked_for() or HELD_BYTES
    if rows * columns * NUMBER_BYTES > most:
        raise InputError(
            f"{label}: {rows} or more rows of {columns} numbers, needed at most"
            f" {most // (columns * NUMBER_BYTES)} to stay within {most // MEGABYTE} MB"
            f" ({OPTION} raises it)"
        )


class Room:
    """What is left of the bytes that one file may unpack to, over all its parts."""

    def __init__(self, packed_bytes: int, label: str) -> None:
        self._packed, self._label, self._taken = packed_bytes, label, 0

    def check(self, count: int) -> None:
        """InputError where there is no room for so many bytes."""
        refuse_unpacked(self._taken + count, self._packed, self._label)

    def take(self, count: int) -> None:
        """Room for so many bytes; InputError where there is not as much."""
        self._taken += count
        refuse_unpacked(self._taken, self._packed, self._label)


@contextmanager
def unpack_limit(megabytes: int | None) -> Iterator[None]:
    """Another limit [MB] for what is read within; None leaves it as it is."""
    before = os.environ.get(VARIABLE)
    if megabytes is not None:
        os.environ[VARIABLE] = str(megabytes)
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(VARIABLE, None)
        else:
            os.environ[VARIABLE] = before
