"""MATLAB files (version 5 to 7.2), a variable at a time, so that a damaged or cut-off one costs no other.

A file is a head of 128 bytes and elements: type and length (4 bytes each), then that many bytes.
"""

import io
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ins.records import InputError

HEAD_BYTES = 128
ARRAY, COMPRESSED = 14, 15  # types of an element that holds a variable
MAX_FILE_BYTES = 4_000_000_000
HDF5 = b"\x89HDF"


def is_mat(path: Path) -> bool:
    """Whether a file is of version 5 to 7.2, which can be read."""
    with path.open("rb") as file:
        return file.read(HEAD_BYTES).startswith(b"MATLAB 5.0 MAT-file")


def is_matlab(path: Path) -> bool:
    """Whether a file is of version 5 or later; 7.3 is HDF5 behind a head of its own, and refused when read."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    return head.startswith((b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file", HDF5))


def variable_names(path: Path) -> set[str]:
    """Names of the variables that can be read."""
    return set(_named(path, [], _whosmat))


def read_variables(path: Path, wanted: Callable[[str], bool]) -> tuple[dict[str, Any], list[str]]:
    """Variables by name as `scipy.io.loadmat` gives them, and notes on damaged ones. InputError for another format."""
    if not is_mat(path):
        what = "a MATLAB file of version 7.3 (HDF5)" if is_matlab(path) else "no MATLAB file"
        raise InputError(f"{path.name}: {what}, needed version 5 to 7.2: in MATLAB save with -v7")
    notes: list[str] = []

    def load(element: bytes) -> dict[str, Any]:
        names = [name for name in _whosmat(element) if wanted(name)]
        return {k: v for k, v in _loadmat(element, names).items() if isinstance(v, np.ndarray)} if names else {}

    return _named(path, notes, load), notes


def _named(path: Path, notes: list[str], load: Callable[[bytes], dict[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for at, element in _elements(path, notes):
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                found |= load(element)
        except Exception as error:  # scipy meets damaged bytes with errors of every kind
            what = f"{type(error).__name__}: {str(error)[:80]}" if str(error) else type(error).__name__
            notes.append(f"{path.name}: variable at byte {at} damaged ({what}), not read")
    return found


def _elements(path: Path, notes: list[str]) -> Iterator[tuple[int, bytes]]:
    """Place and content of each variable, with the file's head before it so that it is a file of its own."""
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise InputError(f"{path.name}: {size} bytes, needed at most {MAX_FILE_BYTES}")
    data = path.read_bytes()
    order = "big" if data[126:128] == b"MI" else "little"
    at = HEAD_BYTES
    while at < size:
        kind, length = (int.from_bytes(data[at + k : at + k + 4], order) for k in (0, 4))  # type: ignore[arg-type]
        after = at + 8 + length
        if after > size or kind not in (ARRAY, COMPRESSED):
            what = "cut off" if kind in (ARRAY, COMPRESSED) else "damaged"
            notes.append(f"{path.name}: {what} at byte {at}: the last {size - at} bytes dropped")
            return
        yield at, data[:HEAD_BYTES] + data[at:after]
        at = after


def _whosmat(element: bytes) -> dict[str, Any]:
    from scipy.io import whosmat

    return {name: shape for name, shape, _ in whosmat(io.BytesIO(element))}


def _loadmat(element: bytes, names: list[str]) -> dict[str, Any]:
    from scipy.io import loadmat

    return loadmat(io.BytesIO(element), variable_names=names)
