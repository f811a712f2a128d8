"""MATLAB files of version 7.3: laid down as MATLAB does (columns first, cells in #refs#), and files
that are made to harm.
"""

import h5py
import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.readers.known_motion import GIVEN, check_parked, parked
from tests.trajectories.readers.test_mat_level5 import check, variables
from trajectories.readers.containers.mat_file import read_arrays, variable_names
from trajectories.readers.conversion import convert_log

pytestmark = pytest.mark.usefixtures("forked")
CLASSES = {"f8": "double", "f4": "single", "b1": "logical", "u2": "uint16", "u8": "uint64"}
CLASSES |= {"i1": "int8", "i4": "int32", "i8": "int64"}
SHORT = parked(seconds=5.0)


class Writer:
    """An HDF5 file behind MATLAB's head of 512 bytes."""

    def __init__(self, path, *, packed=True):
        self.path, self.packed, self.count = path, packed, 0

    def __enter__(self):
        self.file = h5py.File(self.path, "w", userblock_size=512)
        return self

    def __exit__(self, *error):
        self.file.close()
        head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124)
        with self.path.open("r+b") as file:
            file.write(head + b"\x00\x02IM")

    def put(self, name, value, group=None):
        group = self.file if group is None else group
        if isinstance(value, dict):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, part in value.items():
                self.put(key, part, inner)
            return
        value = np.array([list(map(ord, value))]) if isinstance(value, str) else np.asarray(value)
        if value.dtype.names:
            self.structs(name, value, group)
        elif value.dtype == object:
            self.references(name, value, group).attrs["MATLAB_class"] = np.bytes_("cell")
        else:
            self.numbers(name, value, group)

    def numbers(self, name, value, group):
        is_text = value.dtype.kind == "U"
        if is_text:
            value = np.array([list(map(ord, row)) for row in value])
        value = np.atleast_2d(value) if value.ndim != 1 else value[None, :]
        kind = "char" if is_text else CLASSES[value.dtype.str[1:]]
        value = value.astype("u1") if kind == "logical" else value
        if value.size == 0:
            data = group.create_dataset(name, data=np.uint64(value.shape))
            data.attrs["MATLAB_empty"] = 1
        elif self.packed:
            chunks = tuple(max(n - 1, 1) for n in value.T.shape)
            settings = {"chunks": chunks, "compression": "gzip", "shuffle": value.size > 10}
            data = group.create_dataset(name, data=value.T, **settings)
        else:
            data = group.create_dataset(name, data=value.T)
        data.attrs["MATLAB_class"] = np.bytes_(kind)

    def references(self, name, values, group):
        inner = self.file.require_group("#refs#")
        found = np.empty(values.T.shape, dtype=h5py.ref_dtype)
        for place, value in np.ndenumerate(values.T):
            self.count += 1
            self.put(f"r{self.count}", value, inner)
            found[place] = inner[f"r{self.count}"].ref
        return group.create_dataset(name, data=found, dtype=h5py.ref_dtype)

    def structs(self, name, value, group):
        inner = group.create_group(name)
        inner.attrs["MATLAB_class"] = np.bytes_("struct")
        for field in value.dtype.names:
            self.references(field, np.atleast_2d(value[field]).T, inner)


def text(value):
    """A text as MATLAB's char: 16 bits a sign."""
    return np.array([value])


def log(path, output=SHORT):
    """A parked log as a struct, its name as a text."""
    with Writer(path) as file:
        rates = {"t": output.time_s[:, None], "w": output.dtheta / 0.01, "f": output.dv / 0.01}
        file.put("imu", rates)
        file.put("name", text("parked"))
    return path


def small_log(path):
    """240 rows."""
    return log(path, parked(seconds=2.4, start_s=20.0))


MAP = {
    "time": {"column": "imu.t"},
    "gyro": {"columns": [f"imu.w[{k}]" for k in range(3)], "unit": "rad/s"},
    "accel": {"columns": [f"imu.f(:,{k})" for k in (1, 2, 3)], "unit": "m/s2"},
}


@pytest.mark.parametrize("packed", [False, True])
def test_the_same_values_as_of_older_versions(tmp_path, packed):
    given = variables()
    names = given["IMU_label"]
    for place, name in np.ndenumerate(names):
        names[place] = text(name)
    given["several"]["name"] = [text("a"), text("b")]
    with Writer(tmp_path / "a.mat", packed=packed) as file:
        for name, value in given.items():
            file.put(name, value)
        file.put("text", text("forward, right, down"))
        file.put("nothing", np.empty((0, 3)))
        file.put("three", np.ones((2, 3, 4)))
    arrays, notes = read_arrays(tmp_path / "a.mat")
    check(arrays)
    assert notes == [] and variable_names(tmp_path / "a.mat") == set(given)


def test_a_parked_log(tmp_path):
    check_parked(convert_log(log(tmp_path / "log.mat"), MAP, GIVEN).run, SHORT)


def with_item(path, add):
    """A sound file and one thing that `add` puts into it."""
    log(path)
    with h5py.File(path, "r+") as file:
        add(file)
    return path


def values_beside(path):
    def add(file):
        settings = {"shape": (6,), "dtype": "u1", "external": [(str(path), 0, 6)]}
        file.create_dataset("bad", **settings)

    return add


def bomb(file):
    """A chunk of 8 kB that says so, and unpacks to 80 MB."""
    import zlib

    data = file.create_dataset("bad", shape=(1024,), chunks=(1024,), compression="gzip", dtype="f8")
    data.id.write_direct_chunk((0,), zlib.compress(bytes(80_000_000)))


def mislabelled(file):
    """A packed chunk of which one bit says that it is not: the library takes its bytes, and what
    its memory held before, for numbers.
    """
    import zlib

    data = file.create_dataset("bad", shape=(1024,), chunks=(1024,), compression="gzip", dtype="f8")
    data.id.write_direct_chunk((0,), zlib.compress(bytes(8192)), filter_mask=1)


LOG = {"imu.t", "imu.w", "imu.f"}


@pytest.mark.parametrize(
    ("add", "told"),
    [
        (bomb, "bytes unpacked"),
        (mislabelled, "bytes in a chunk, needed 8192"),
        (
            lambda f: f.create_dataset("bad", (9,), chunks=(9,), compression="lzf", dtype="f8"),
            "needed gzip",
        ),
    ],
)
def test_what_would_harm_costs_its_variable_alone(tmp_path, add, told):
    found, notes = read_arrays(with_item(tmp_path / "a.mat", add))
    assert set(found) == LOG and told in notes[0]


def test_nothing_is_read_from_other_files(tmp_path):
    secret = tmp_path / "secret"
    secret.write_bytes(b"secret")
    path = with_item(tmp_path / "a.mat", values_beside(secret))
    found, notes = read_arrays(path)
    assert "bad" not in found and "in another file" in notes[0]
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = [1.0]
    path = with_item(
        tmp_path / "b.mat",
        lambda f: f.__setitem__("bad", h5py.ExternalLink(str(tmp_path / "other.h5"), "/x")),
    )
    assert set(read_arrays(path)[0]) == LOG


def test_more_than_may_be_unpacked(tmp_path):
    """A shape of 80 GB whose chunks were never written."""
    shape = {"shape": (10**10,), "chunks": (10**6,), "dtype": "f8"}
    path = with_item(tmp_path / "a.mat", lambda f: f.create_dataset("bad", **shape))
    with pytest.raises(InputError, match=r"a\.mat: \d+ bytes hold \d+ or more bytes unpacked"):
        read_arrays(path)
