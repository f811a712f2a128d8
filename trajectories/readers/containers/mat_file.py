"""MATLAB files: which they are, and what is in them, read by libraries in a child.

Version 5 to 7.2 are MATLAB's own layout (`mat_elements`, `mat_level5`), version 7.3 is HDF5
(`mat_hdf5`).
"""

from collections.abc import Collection
from pathlib import Path

from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.readers.contained import Contents, read_contained
from trajectories.readers.containers.mat_elements import MAT_HEAD_BYTES, variables

VERSION_5, VERSION_7_3 = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
HDF5 = b"\x89HDF"

_sought: dict[tuple[str, int, int], Contents | InputError] = {}
"""The contents of the last file whose format was sought, until its reader takes them."""


def is_matlab(path: Path) -> bool:
    """Whether a file is MATLAB's, of version 5 or later, or HDF5 of another program."""
    return _head(path).startswith(VERSION_5) or _is_hdf5(path)


def _is_hdf5(path: Path) -> bool:
    """Version 7.3 has a head of its own before that of HDF5."""
    return _head(path).startswith((VERSION_7_3, HDF5))


def _head(path: Path) -> bytes:
    with open_regular(path) as file:
        return file.read(MAT_HEAD_BYTES)


def variable_names(path: Path) -> set[str]:
    """Names of the variables that can be read."""
    if _is_hdf5(path):
        return {name.split(".")[0].split("(")[0] for name in arrays_at_once(path)}
    return {variable.name for variable in variables(path, [])}


def read_arrays(path: Path, wanted: Collection[str] | None = None) -> Contents:
    """Arrays by full name, and notes on damaged variables, as `mat_level5.contents` gives them.

    Parameters
    ----------
    path : Path
        The file.
    wanted : collection of str, optional
        Names of variables; None is all. More may be given.

    Raises
    ------
    InputError
        For another format, or where they unpack to more than they may.
    """
    kept = _sought.pop(_identity(path), None)
    if isinstance(kept, InputError) and wanted is None:
        raise kept
    if kept is not None and not isinstance(kept, InputError):
        return kept
    return _read(path, wanted)


def arrays_at_once(path: Path) -> dict[str, NDArray]:
    """All arrays of a file whose format is sought; none where it cannot be read."""
    identity = _identity(path)
    kept = _sought.get(identity)
    if kept is None:
        try:
            kept = _read(path, None)
        except InputError as error:
            kept = error
        _sought.clear()
        _sought[identity] = kept
    return {} if isinstance(kept, InputError) else kept[0]


def _read(path: Path, wanted: Collection[str] | None) -> Contents:
    if not is_matlab(path):
        raise InputError(f"{path.name}: no MATLAB file, needed version 5 or later")
    name = "mat_hdf5" if _is_hdf5(path) else "mat_level5"
    return read_contained(f"{__package__}.{name}", path, wanted)


def _identity(path: Path) -> tuple[str, int, int]:
    stat = path.stat()
    return str(path.resolve()), stat.st_size, stat.st_mtime_ns
