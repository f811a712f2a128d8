"""MATLAB files of version 5 to 7.2: what is found of every kind that a log has, packed and plain;
and lengths that lie.
"""

import re
import struct
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from ins.records import InputError
from trajectories.readers.containers.mat_file import read_arrays, variable_names

pytestmark = pytest.mark.usefixtures("forked")


def variables() -> dict:
    rng = np.random.default_rng(4)
    names = np.empty((2, 1), dtype=object)
    names[:, 0] = ["GyrX", "GyrY"]
    return {
        "matrix": rng.standard_normal((5, 3)),
        "whole": np.array([[1.0, 2.0, 300.0]]),
        "single": np.float32([[1.5, 2.5]]),
        **{
            name: np.array([[1, 2], [3, 100]], dtype=name)
            for name in ("int8", "uint16", "int32", "uint64", "int64")
        },
        "flag": np.array([[True]]),
        "imu": {
            "t": np.arange(4.0),
            "wb": rng.standard_normal((4, 3)),
            "ini": {"att": np.array([1.0, 2.0])},
        },
        "several": np.array([(1.0, "a"), (2.0, "b")], dtype=[("x", object), ("name", object)]),
        "IMU_label": names,
    }


OTHERS = {
    "empty": np.empty((0, 3)),
    "three": np.ones((2, 3, 4)),
    "complex": np.array([[1 + 2j, 3 - 4j]]),
    "text": "forward, right, down",
    "nothing": "",
}


def check(arrays):
    """All of `variables`, and nothing else."""
    given = variables()
    expected = {name: given[name] for name in given if name not in ("imu", "several")}
    expected |= {"imu.t": given["imu"]["t"][None, :], "imu.wb": given["imu"]["wb"]}
    expected["imu.ini.att"] = given["imu"]["ini"]["att"][None, :]
    expected |= {"several(1).x": np.array([[1.0]]), "several(2).x": np.array([[2.0]])}
    expected["IMU_label"] = np.array(["GyrX", "GyrY"])
    assert set(arrays) == set(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(arrays[name], values, err_msg=name)
        assert arrays[name].dtype.kind == ("U" if name == "IMU_label" else "f")


@pytest.mark.parametrize("packed", [False, True])
def test_what_a_file_holds(tmp_path, packed):
    savemat(tmp_path / "a.mat", variables() | OTHERS, do_compression=packed)
    arrays, notes = read_arrays(tmp_path / "a.mat")
    check(arrays)
    assert notes == [] and variable_names(tmp_path / "a.mat") == set(variables() | OTHERS)
    assert set(read_arrays(tmp_path / "a.mat", ["matrix", "x"])[0]) == {"matrix"}


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
def test_a_type_that_ends_scipy_is_one_line(tmp_path, packed):
    """A type of numbers that is none; what scipy finds at its place in a table is by chance."""
    path = lying(tmp_path / "a.mat", kind=77, packed=packed)
    try:
        found, notes = read_arrays(path)
    except InputError as error:
        told = "a.mat: the library that reads it ended by SIG[A-Z]+, needed a sound file"
        assert re.fullmatch(told, str(error))
        return
    assert found == {} and "variable at byte 128 damaged (" in notes[0]
