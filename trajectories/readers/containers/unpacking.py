"""A log in memory: whole, where it is not larger than a log can be, or its packed blocks (bz2, lz4,
zstd), never more bytes than the block says and than a limit allows.
"""

import bz2
import importlib
import zlib
from pathlib import Path
from typing import Any

from ins.records import InputError
from ins.user_input import read_bounded

MAX_BLOCK_BYTES = 1 << 28  # 268 MB; recorders write blocks of 0.8 MB, a message at least
MAX_MESSAGE_BYTES = 65_536  # a message of the kinds read here has a kilobyte
SPARE_BYTES = 65_536  # beyond what packed data say of their length: padding has eight
INSTALL = "pip install strapdown-recal[ros]"
# Of a log that is read at once: 4 h of six IMUs at 2 kHz with 24 bytes a row.
MAX_FILE_BYTES = 4_000_000_000


class Damaged(Exception):
    """Bytes that are not what their format says; caught where the next place to go on is known."""


def unpacked(data: memoryview, name: str, size: int | None = None) -> bytes:
    """The `size` bytes of a packed block (None: a message, as long as it is).

    Damaged where they are not there, InputError where a library is missing.
    """
    if size is not None and size > MAX_BLOCK_BYTES:
        raise Damaged(f"{size} bytes unpacked, at most {MAX_BLOCK_BYTES}")
    if name not in UNPACK:
        raise Damaged(f"packed with {name[:20]!r}")
    try:
        found = UNPACK[name](bytes(data), MAX_MESSAGE_BYTES if size is None else size)
    except ImportError:
        raise InputError(f"packed with {name}: needed the libraries of {INSTALL}") from None
    except Exception as error:  # each library has its own errors for damaged bytes
        raise Damaged(
            f"{name}: {' '.join(str(error).split())[:80] or type(error).__name__}"
        ) from None
    if size is not None and len(found) != size:
        raise Damaged(f"{len(found)} bytes unpacked, needed {size}")
    return found


def inflated(data: memoryview, most: int, *, whole: bool = True) -> bytes:
    """What zlib packed, at most so many bytes of it. Damaged where it is garbled; where it should
    be `whole`, also where it is cut off, or SPARE_BYTES longer.
    """
    unpack = zlib.decompressobj()
    try:
        found = unpack.decompress(data, most)
        if whole and not unpack.eof:  # padding, and the checksum behind it
            unpack.decompress(unpack.unconsumed_tail, SPARE_BYTES)
    except zlib.error as error:
        raise Damaged(str(error)) from None
    if whole and not unpack.eof:
        longer = len(found) == most and unpack.unconsumed_tail
        raise Damaged(f"more than {most} bytes unpacked" if longer else "packed data cut off")
    return found


def _bz2(data: bytes, size: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(data, max_length=size)


def _lz4(data: bytes, size: int) -> bytes:
    frame = importlib.import_module("lz4.frame")
    return frame.LZ4FrameDecompressor().decompress(data, max_length=size)


def _zstd(data: bytes, size: int) -> bytes:
    try:  # of the standard library (3.14), or its backport
        zstd: Any = importlib.import_module("compression.zstd")
    except ImportError:
        zstd = importlib.import_module("backports.zstd")
    return zstd.ZstdDecompressor().decompress(data, max_length=size)


def is_own_file(file: Path, folder: Path) -> bool:
    """Whether a file of a folder is one, no pipe or device, and no link leads out of the folder."""
    return file.is_file() and file.resolve().is_relative_to(folder.resolve())


def read_whole(path: Path) -> bytes:
    """The bytes of a file; InputError where it is larger than MAX_FILE_BYTES."""
    try:
        return read_bounded(path, MAX_FILE_BYTES)
    except OSError as error:
        raise InputError(f"{path.name}: cannot be read ({error.strerror or error})") from None


UNPACK = {"bz2": _bz2, "lz4": _lz4, "zstd": _zstd}
