"""MATLAB arrays against scipy's reader: every kind that a log has, packed and plain; and lengths
that lie.
"""

import struct
import zlib

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from ins.records import InputError
from trajectories.readers.containers.mat_file import read_variables, variable_names
from trajectories.runs import limits


def variables() -> dict:
    rng = np.random.default_rng(4)
    cells = np.empty((2, 3), dtype=object)
    for k in range(6):
        cells[k % 2, k // 2] = rng.standard_normal((k, 2)) if k % 2 else f"text {k}"
    return {
        "matrix": rng.standard_normal((5, 3)),
        "whole": np.array([[1.0, 2.0, 300.0]]),
        "empty": np.empty((0, 3)),
        "three": rng.standard_normal((2, 3, 4)),
        "single": np.float32([[1.5, 2.5]]),
        "complex": np.array([[1 + 2j, 3 - 4j]]),
        **{
            name: np.array([[1, 2], [3, 100]], dtype=name)
            for name in ("int8", "uint16", "int32", "uint64", "int64")
        },
        "text": "forward, right, down",
        "rows": np.array(["abc", "de "]),
        "nothing": "",
        "cells": cells,
        "flag": np.array([[True]]),
        "imu": {
            "t": np.arange(4.0),
            "wb": rng.standard_normal((4, 3)),
            "ini": {"att": np.array([1.0, 2.0])},
        },
        "several": np.array([(1.0, "a"), (2.0, "b")], dtype=[("x", object), ("name", object)]),
    }


def same(a, b) -> bool:
    """Whether two values of loadmat have the same shape and content; numbers may be of another,
    wider type.
    """
    if a.dtype.names or b.dtype.names:
        return (
            a.shape == b.shape
            and a.dtype.names == b.dtype.names
            and all(same(a[n], b[n]) for n in a.dtype.names)
        )
    if a.dtype == object:
        return a.shape == b.shape and all(
            same(np.asarray(x), np.asarray(y)) for x, y in zip(a.ravel(), b.ravel())
        )
    if a.dtype.kind == "U" and b.dtype.kind == "U":
        return [text.rstrip() for text in a.ravel()] == [text.rstrip() for text in b.ravel()]
    return a.shape == b.shape and np.array_equal(a, b)


@pytest.mark.parametrize("packed", [False, True])
def test_the_same_as_scipy(tmp_path, packed):
    savemat(tmp_path / "a.mat", variables(), do_compression=packed)
    own, notes = read_variables(tmp_path / "a.mat", lambda name: True)
    theirs = {k: v for k, v in loadmat(tmp_path / "a.mat").items() if not k.startswith("__")}
    assert set(own) == set(theirs) == variable_names(tmp_path / "a.mat") and notes == []
    assert [name for name in own if not same(own[name], theirs[name])] == []
    assert own["whole"].dtype == np.float64


def test_the_other_byte_order(tmp_path):
    """A file as a big-endian machine writes it, laid down by hand."""
    body = (
        struct.pack(">IIII", 6, 8, 6, 0)
        + struct.pack(">IIii", 5, 8, 1, 2)
        + struct.pack(">HH4s", 1, 1, b"x\0\0\0")
    )
    body += struct.pack(">II2d", 9, 16, 1.5, -2.5)
    path = tmp_path / "a.mat"
    path.write_bytes(
        b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI" + struct.pack(">II", 14, len(body)) + body
    )
    assert read_variables(path, lambda name: True)[0]["x"].tolist() == [[1.5, -2.5]]


def lying(path, *, dims=(1, 2), kind=9, length=16, packed=False):
    body = (
        struct.pack("<IIII", 6, 8, 6, 0)
        + struct.pack("<IIii", 5, 8, *dims)
        + struct.pack("<HH4s", 1, 1, b"x\0\0\0")
    )
    body += struct.pack("<II2d", kind, length, 1.5, -2.5)
    element = struct.pack("<II", 14, len(body)) + body
    if packed:
        element = zlib.compress(element)
        element = struct.pack("<II", 15, len(element)) + element
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + element)
    return path


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"dims": (2**31 - 1, 2**31 - 1)}, "16 bytes for 4611686014132420609 numbers"),
        ({"dims": (-1, 2)}, "dimensions"),
        ({"dims": (1, 3)}, "16 bytes for 3 numbers"),
        ({"length": 2**32 - 8}, "an element longer than its array"),
        ({"kind": 77}, "16 bytes for 2 numbers"),
    ],
)
def test_lengths_that_lie(tmp_path, changes, told, packed):
    found, notes = read_variables(
        lying(tmp_path / "a.mat", **changes, packed=packed), lambda name: True
    )
    assert found == {} and len(notes) == 1 and told in notes[0]
    assert (
        lying(tmp_path / "a.mat", packed=packed)
        and read_variables(tmp_path / "a.mat", lambda name: True)[0]
    )


def test_a_bomb_is_not_unpacked(tmp_path, monkeypatch):
    """Some kilobytes of one-byte zeros, which would take eight times what they unpack to; a name
    that is not wanted costs its head alone.
    """
    monkeypatch.setattr(limits, "SMALL_BYTES", 1 << 20)
    rows = 1 << 18
    values = np.zeros((rows, 1), dtype=np.int8)
    path = tmp_path / "a.mat"
    savemat(path, {"imu": values, "x": np.array([[1.0]])}, do_compression=True)
    size = path.stat().st_size
    assert size < 1000
    with pytest.raises(InputError, match=f"^a.mat: {size} bytes hold .*, needed at most 1048576"):
        read_variables(path, lambda name: True)
    assert set(read_variables(path, lambda name: name == "x")[0]) == {"x"}
    with limits.unpack_limit(10):
        assert read_variables(path, lambda name: True)[0]["imu"].shape == (rows, 1)
    cells = np.empty((1, 10_000), dtype=object)
    cells[0, :] = [np.empty((0, 0))] * 10_000
    savemat(path, {"cells": cells}, do_compression=True)
    with pytest.raises(InputError, match="needed at most 1048576"):
        read_variables(path, lambda name: True)
    with pytest.raises(InputError, match="needed version 5"):
        path.write_bytes(b"junk")
        read_variables(path, lambda name: True)
