"""Table files: bits kept through export and import, the hash as formats.md writes it, and every
refusal's key.
"""

import copy
import hashlib
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from infield.table.file import (
    canonical_json,
    csv_text,
    json_text,
    read_table_csv,
    read_table_dict,
    table_from_dict,
    table_sha256,
    table_to_dict,
)
from infield.table.thermal_table import EvenNodes, default_table
from ins.records import InputError

UTC = "2026-03-01T05:00:00Z"


def plain(interpolation="linear"):
    """A table dict as written by hand: integers among the numbers, covariance null."""
    axis = {
        "temperature_degC": [-10, 0, 10.5],
        "bias_deg_h": [0.01, 0, -0.02],
        "sigma_deg_h": [0.006, 0.006, 0.007],
    }
    if interpolation == "hermite":
        axis["slope_deg_h_degC"] = [1e-4, 0, 2e-4]
    return {
        "schema": "recal.table/1",
        "imu_serial": "SN-0042",
        "gyro_technology": "rlg",
        "created_utc": UTC,
        "interpolation": interpolation,
        "axes": {a: copy.deepcopy(axis) for a in "xyz"},
        "covariance": None,
        "provenance": {"parent_sha256": None, "runs": []},
    }


@pytest.mark.parametrize("interpolation", ["linear", "hermite"])
def test_null_covariance_is_the_kernel_of_the_contract(interpolation):
    table = table_from_dict(plain(interpolation), name="t.json")
    P = table.covariance
    s, dT = 0.006 * 0.007, 10.5 - 0.0
    assert P[0, 0] == 0.006**2  # exactly: its root is the sigma of the file
    assert P[1, 2] == pytest.approx(s * (0.7 + 0.3 * np.exp(-(dT**2) / (2 * 30.0**2))), rel=1e-14)
    assert np.all(P[0:3, 3:9] == 0.0)  # axes uncorrelated


@given(st.floats(1e-6, 100.0), st.integers(0, 2**32 - 1), st.sampled_from(["linear", "hermite"]))
@settings(max_examples=20, deadline=None)
def test_export_import_export_keeps_every_bit(scale, seed, interpolation):
    rng = np.random.default_rng(seed)
    table = default_table(
        imu_serial="S",
        gyro_technology="fog",
        created_utc=UTC,
        interpolation=interpolation,
        span=EvenNodes(high_degC=0),
        gyro_mode="m",
    )
    root = rng.standard_normal((table.n_parameters, table.n_parameters)) * scale
    table = table.replaced(
        parameters=rng.standard_normal(table.n_parameters) * scale, covariance=root @ root.T
    )
    first = json_text(table_to_dict(table))
    again = table_from_dict(json.loads(first), name="t.json")
    assert json_text(table_to_dict(again)) == first
    assert again.parameters.tobytes() == table.parameters.tobytes()
    assert again.covariance.tobytes() == table.covariance.tobytes()


def test_files_round_trip(tmp_path):
    data = table_to_dict(table_from_dict(plain("hermite"), name="t"))
    path = tmp_path / "t.json"
    path.write_text(json_text(data))
    assert table_sha256(read_table_dict(path)) == table_sha256(data)
    again = table_from_dict(read_table_dict(path), name="table.json")
    assert json_text(table_to_dict(again)) == path.read_text()


@pytest.mark.parametrize("interpolation", ["linear", "hermite"])
def test_csv_round_trip(tmp_path, interpolation):
    path = tmp_path / "t.csv"
    text = csv_text(table_from_dict(plain(interpolation), name="t"))
    path.write_text(text)
    assert text.splitlines()[:2][1].startswith("x,-10.0,0.01,0.006")
    data = read_table_csv(path, imu_serial="SN-0042", gyro_technology="rlg", created_utc=UTC)
    assert canonical_json(data) == canonical_json(plain(interpolation))
    assert csv_text(table_from_dict(data, name="t")) == text


def test_hash_is_the_one_of_the_contract():
    data = plain()
    data["provenance"]["approved"] = True  # a bool stays a bool
    as_float = copy.deepcopy(data)
    for axis in as_float["axes"].values():
        for key in axis:
            axis[key] = [float(v) for v in axis[key]]
    text = json.dumps(as_float, sort_keys=True, separators=(",", ":"))
    assert "true" in text
    assert table_sha256(data) == hashlib.sha256(text.encode()).hexdigest()


def at(*keys):
    """A change of one value in a table dict, its place given as keys."""

    def change(data, value):
        for key in keys[:-1]:
            data = data[key]
        data[keys[-1]] = value

    return change


T3 = np.eye(9) * 0.006**2
T3[[2, 5, 8], [2, 5, 8]] = 0.007**2


def bad_covariance(i, j, value):
    P = T3.copy()
    P[i, j] = value
    return P.tolist()


REFUSALS = [
    (at("schema"), "recal.table/2", "schema"),
    (at("colour"), "red", "unknown key colour"),
    (at("created_utc"), "yesterday", "created_utc"),
    (at("created_utc"), "2026-03-01T05:00:00+02:00", "created_utc"),
    (at("gyro_technology"), "hrg", "gyro_technology"),
    (at("interpolation"), "spline", "interpolation"),
    (at("interpolation"), "hermite", "slope_deg_h_degC"),
    (at("axes", "y", "temperature_degC"), [0, -10, 20], "axes.y.temperature_degC[1]"),
    (at("axes", "y", "temperature_degC"), [0, 10, 10], "axes.y.temperature_degC[2]"),
    (at("axes", "y", "temperature_degC"), [263, 273, 283], "wrong unit"),
    (at("axes", "z", "bias_deg_h"), [0.1, 0.2], "axes.z.bias_deg_h"),
    (at("axes", "z", "bias_deg_h", 1), float("nan"), "axes.z.bias_deg_h[1]"),
    (at("axes", "z", "bias_deg_h", 1), "0.1", "axes.z.bias_deg_h[1]"),
    (at("axes", "z", "sigma_deg_h", 1), -0.1, "axes.z.sigma_deg_h"),
    (
        at("axes", "x", "temperature"),
        [0, 1, 2],
        "unknown key axes.x.temperature (did you mean temperature_degC?)",
    ),
    (at("covariance"), T3[:8].tolist(), "covariance"),
    (at("covariance"), bad_covariance(0, 1, 1e-6), "not symmetric"),
    (at("covariance"), bad_covariance(4, 4, 0.02**2), "covariance[4][4]"),
]


@pytest.mark.parametrize("change, value, key", REFUSALS)
def test_refusals_name_file_and_key(change, value, key):
    data = plain()
    change(data, value)
    with pytest.raises(InputError) as error:
        table_from_dict(data, name="table.json")
    assert str(error.value).startswith("table.json: ") and key in str(error.value)
    assert "\n" not in str(error.value)


def test_covariance_not_positive_is_refused():
    P = T3.copy()
    P[0, 1] = P[1, 0] = 1.01 * 0.006**2  # correlation above one
    with pytest.raises(InputError, match="positive semidefinite"):
        table_from_dict({**plain(), "covariance": P.tolist()}, name="t")


@pytest.mark.parametrize("key", ["y", "schema", "imu_serial", "axes"])
def test_missing_key_is_named(key):
    data = plain()
    (data["axes"] if key == "y" else data).pop(key)
    with pytest.raises(InputError, match=key):
        table_from_dict(data, name="t")


@pytest.mark.parametrize(
    "text, clue",
    [
        ("", "line 1"),
        ("axis,temperature,bias_deg_h,sigma_deg_h\n", "line 1"),
        ("axis,temperature_degC,bias_deg_h,sigma_deg_h\nw,0,0,1\n", "line 2"),
        ("axis,temperature_degC,bias_deg_h,sigma_deg_h\nx,0,nan,1\n", "line 2: bias_deg_h"),
        ("axis,temperature_degC,bias_deg_h,sigma_deg_h\nx,0,0,1\nx,0,1\n", "line 3"),
        ("axis,temperature_degC,bias_deg_h,sigma_deg_h\nx,0,0,1\nx,5,0,1\n", "axes.y"),
    ],
)
def test_csv_refusals_name_the_line(tmp_path, text, clue):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"t\.csv: ") as error:
        read_table_csv(path, imu_serial="S", gyro_technology="rlg", created_utc=UTC)
    assert clue in str(error.value)


def test_nan_in_json_text_is_refused(tmp_path):
    path = tmp_path / "t.json"
    path.write_text(json.dumps({**plain(), "x": float("nan")}))
    with pytest.raises(InputError, match="NaN"):
        read_table_dict(path)
