"""Column maps on every kind of file: the same parked unit written in the ways that people write
logs.
"""

import gzip
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from ins.records import FixType, InputError
from tests.trajectories.readers.known_motion import GIVEN, LAT_DEG, LON_DEG, check_parked, parked
from trajectories.readers.conversion import convert_log

OUT = parked(start_s=5000.0)
N = OUT.rows
DEG_H = 180 / np.pi * 3600
MAP = {
    "time": {"column": "t"},
    "gyro": {"columns": ["wx", "wy", "wz"], "unit": "deg/h"},
    "accel": {"columns": ["fx", "fy", "fz"], "unit": "mg"},
}


def rate_table() -> dict[str, np.ndarray]:
    """Rates in deg/h and milli-g, axes forward, right, down."""
    w, f = OUT.dtheta / 0.01 * DEG_H, OUT.dv / 0.01 / 9.80665e-3
    return {
        "t": OUT.time_s,
        "wx": w[:, 0],
        "wy": w[:, 1],
        "wz": w[:, 2],
        "fx": f[:, 0],
        "fy": f[:, 1],
        "fz": f[:, 2],
    }


def lines(columns: dict, delimiter=",") -> list[str]:
    return [
        delimiter.join(repr(float(v)) if np.isfinite(v) else "" for v in row)
        for row in zip(*columns.values())
    ]


def csv_text(columns: dict, *, head=None, delimiter=",") -> str:
    return "\n".join([head or delimiter.join(columns), *lines(columns, delimiter)]) + "\n"


def convert(path, options=None, **given):
    return convert_log(path, options or MAP, GIVEN | given)


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        (csv_text(rate_table()), {}),
        (csv_text(rate_table(), head="t;wx;wy;wz;fx;fy;fz", delimiter=";"), {"delimiter": ";"}),
        (csv_text(rate_table(), delimiter="\t"), {"delimiter": "\t"}),
        ("logger 7\nunit SN-1\n" + csv_text(rate_table()), {"header_lines": 3}),
        (
            "logger 7\n"
            + csv_text(rate_table(), head="t,wx,wy,wz,fx,fy,fz\ns,deg/h,deg/h,deg/h,mg,mg,mg"),
            {"header_lines": 3, "names_line": 2},
        ),
        (
            "# made by\n\n"
            + csv_text(rate_table()).replace("\n", "\n# a remark, with, commas\n", 40),
            {"comment": "#"},
        ),
        (
            "\r\n".join(["t wx wy wz fx fy fz", *lines(rate_table(), "   ")]) + "\r\n",
            {"format": "text", "header_lines": 1},
        ),
    ],
    ids=[
        "plain",
        "semicolons",
        "tabs",
        "header in line 3",
        "units below names",
        "comments",
        "white space",
    ],
)
@pytest.mark.parametrize("packed", [False, True], ids=["", "gz"])
def test_text(tmp_path, text, keys, packed):
    path = tmp_path / ("log.csv.gz" if packed else "log.csv")
    path.write_bytes(gzip.compress(text.encode()) if packed else text.encode())
    made = convert(path, MAP | keys)
    check_parked(made.run, OUT)
    assert list(made.record.notes) == []


def test_parquet(tmp_path):
    """By its content, not its name; a part of a record by its path."""
    columns = rate_table()
    pq.write_table(pa.table(columns | {"state": ["ok"] * N}), tmp_path / "log.pq")
    check_parked(convert(tmp_path / "log.pq").run, OUT)
    record = pa.StructArray.from_arrays(
        [pa.array(columns[k]) for k in ("wx", "wy", "wz")], ["x", "y", "z"]
    )
    pq.write_table(
        pa.table({k: v for k, v in columns.items() if k[0] != "w"} | {"gyro": record}),
        tmp_path / "log.parquet",
    )
    nested = MAP | {"gyro": {"columns": ["gyro.x", "gyro.y", "gyro.z"], "unit": "deg/h"}}
    made = convert(tmp_path / "log.parquet", nested)
    check_parked(made.run, OUT)
    assert made.record.format == "parquet"


def test_parquet_time_stamps_give_the_date(tmp_path):
    """2026-03-01T05:00:00Z is 1 772 341 200 s since 1970 (by `date -d`); run time 0 is one interval
    before the first row.
    """
    columns = rate_table()
    stamps = pa.array(
        np.round((1_772_341_200 + 0.01 * np.arange(N)) * 1e9).astype(np.int64),
        type=pa.timestamp("ns"),
    )
    pq.write_table(pa.table({**columns, "t": stamps}), tmp_path / "log.parquet")
    made = convert(
        tmp_path / "log.parquet", MAP | {"time": {"column": "t", "epoch": "unix"}}, start_utc=None
    )
    assert made.run.header.start_utc == "2026-03-01T04:59:59.990Z"
    np.testing.assert_allclose(made.run.imu.dtheta_rad, OUT.dtheta, rtol=1e-4)


MAT_MAPS = {
    "vectors": {"t": "t", "w": ["wx", "wy", "wz"], "f": ["fx", "fy", "fz"]},
    "matrix": {
        "t": "data[0]",
        "w": ["data[1]", "data[2]", "data[3]"],
        "f": ["data[4]", "data[5]", "data[6]"],
    },
    "matlab": {
        "t": "log.t",
        "w": [f"log.wb(:,{k})" for k in (1, 2, 3)],
        "f": [f"log.fb(:, {k})" for k in (1, 2, 3)],
    },
    "elements": {
        "t": "unit(2).t",
        "w": [f"unit(2).wb[{k}]" for k in range(3)],
        "f": [f"unit(2).fb[{k}]" for k in range(3)],
    },
}


@pytest.mark.parametrize("style", MAT_MAPS)
@pytest.mark.parametrize("compressed", [False, True], ids=["", "compressed"])
def test_matlab(tmp_path, style, compressed):
    """As vectors, columns of a matrix, fields of a struct, an element of a struct array."""
    columns = rate_table()
    w, f = (np.column_stack([columns[k + a] for a in "xyz"]) for k in "wf")
    unit = {"t": OUT.time_s[:, None], "wb": w, "fb": f}
    other = {**unit, "wb": -w}
    savemat(
        tmp_path / "log.mat",
        do_compression=compressed,
        mdict=(
            {
                **columns,
                "data": np.column_stack(list(columns.values())),
                "log": unit,
                "unit": np.array([other, unit], dtype=object),
                "comment": "text",
                "nothing": np.empty((0, 0)),
            }
            if style != "elements"
            else {"unit": struct_array(other, unit)}
        ),
    )
    names = MAT_MAPS[style]
    keys = {
        "time": {"column": names["t"]},
        "gyro": {"columns": names["w"], "unit": "deg/h"},
        "accel": {"columns": names["f"], "unit": "mg"},
    }
    made = convert(tmp_path / "log.mat", keys)
    check_parked(made.run, OUT)
    assert made.record.format == "mat"


def struct_array(*elements: dict) -> np.ndarray:
    out = np.zeros(len(elements), dtype=[(k, object) for k in elements[0]])
    for k, element in enumerate(elements):
        for name, value in element.items():
            out[name][k] = value
    return out


FIXES = {
    "lat": LAT_DEG + 1e-6 * np.arange(60),
    "lon": LON_DEG + 0.0 * np.arange(60),
    "h": 380.0 + 0.1 * np.arange(60),
    "v1": np.full(60, 2.0),
    "v2": np.full(60, 3.0),
    "v3": np.full(60, 0.5),
    "s": np.full(60, 0.4),
    "sv": np.full(60, 0.9),
    "sw": np.full(60, 0.36),
}
GNSS = {
    "position": {"columns": ["lat", "lon", "h"], "sigma": ["s", "s", "sv"]},
    "velocity": {
        "columns": ["v1", "v2", "v3"],
        "frame": "enu",
        "unit": "km/h",
        "sigma": ["sw", "sw", "sw"],
    },
}


def test_fixes_and_temperatures_among_the_rows(tmp_path):
    """1 Hz fixes beside every hundredth row (then again in every row), deg F at 0.5 Hz, a wheel in
    km/h; empty elsewhere.
    """
    columns = rate_table()
    for name, values in FIXES.items():
        columns[name] = np.full(N, np.nan)
        columns[name][::100] = values
    columns["T"], columns["speed"] = np.full(N, np.nan), np.full(N, np.nan)
    columns["T"][::200], columns["speed"][::10] = 68.0, 36.0
    (tmp_path / "log.csv").write_text(csv_text(columns))
    keys = MAP | {
        "gnss": GNSS,
        "temperature": {"columns": ["T"], "unit": "degF"},
        "odometer": {"column": "speed", "unit": "km/h"},
    }
    run = convert(tmp_path / "log.csv", keys).run
    check_parked(run, OUT)
    check_fixes(run.gnss, np.arange(60) * 1.0 + 0.01)
    np.testing.assert_allclose(run.temperature.gyro_degC, 20.0, atol=1e-12)
    assert run.temperature.time_s.size == 30
    np.testing.assert_allclose(run.odometer.speed_m_s, 10.0)
    assert run.odometer.time_s.size == 600
    assert run.gnss.fix_type is None
    for name, values in FIXES.items():
        columns[name] = np.repeat(values, 100)
    (tmp_path / "held.csv").write_text(csv_text(columns))
    check_fixes(
        convert(tmp_path / "held.csv", MAP | {"gnss": GNSS}).run.gnss, np.arange(60) * 1.0 + 0.01
    )


@pytest.mark.parametrize(
    ("scale", "numbers"),
    [("autopilot", [3, 4, 5, 6]), ("rtklib", [5, 4, 2, 1]), ("nmea", [1, 2, 5, 4])],
)
def test_numbers_of_quality_are_types_of_fixes(tmp_path, scale, numbers):
    """A number that the scale does not have tells no type, and the fix stays."""
    columns = rate_table()
    for name, values in (FIXES | {"q": np.resize([*numbers, 9], 60)}).items():
        columns[name] = np.repeat(values, 100)
    (tmp_path / "log.csv").write_text(csv_text(columns))
    fix = {"column": "q", "at_least": 1, "scale": scale}
    found = convert(tmp_path / "log.csv", MAP | {"gnss": GNSS | {"fix": fix}}).run.gnss
    types = [FixType.SINGLE, FixType.DIFFERENTIAL, FixType.FLOAT, FixType.FIXED, np.nan]
    np.testing.assert_array_equal(found.fix_type, np.resize(types, 60))


def check_fixes(gnss, time_s):
    """East 2, north 3, up 0.5 km/h, to 0.36 km/h; one sigma a level axis."""
    np.testing.assert_allclose(gnss.time_s, time_s, atol=1e-6)
    np.testing.assert_allclose(np.degrees(gnss.lat_rad), FIXES["lat"], atol=1e-9)
    np.testing.assert_allclose(gnss.v_n_m_s, np.tile([3 / 3.6, 2 / 3.6, -0.5 / 3.6], (60, 1)))
    np.testing.assert_allclose(gnss.sigma_horizontal_m, 0.4)
    np.testing.assert_allclose(gnss.sigma_vertical_m, 0.9)
    np.testing.assert_allclose(gnss.sigma_velocity_m_s, 0.1)


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat"])
def test_streams_in_files_of_their_own(tmp_path, kind):
    columns = {
        "stamp": (5000.01 + np.arange(60)) * 1e3,
        **FIXES,
        "fix": np.where(np.arange(60) < 5, 2.0, 3.0),
    }
    files = {}
    for name, data in (
        ("gps", columns),
        ("oven", {"stamp": 5000.0 + np.arange(0.0, 60.0, 2.0), "T": np.full(30, 303.15)}),
    ):
        files[name] = f"{name}.{kind}"
        if kind == "csv":
            (tmp_path / files[name]).write_text(csv_text(data))
        elif kind == "parquet":
            pq.write_table(pa.table(data), tmp_path / files[name])
        else:
            savemat(tmp_path / files[name], data)
    (tmp_path / "log.csv").write_text(csv_text(rate_table()))
    gnss = {
        **GNSS,
        "file": files["gps"],
        "time": {"column": "stamp", "unit": "ms"},
        "fix": {"column": "fix"},
    }
    oven = {"file": files["oven"], "time": {"column": "stamp"}, "columns": ["T"], "unit": "K"}
    made = convert(tmp_path / "log.csv", MAP | {"gnss": gnss, "temperature": oven})
    assert made.run.gnss.time_s.size == 55
    assert any("GPS rows 1-5 left out: no 3D fix" in note for note in made.record.notes)
    np.testing.assert_allclose(made.run.temperature.gyro_degC, 30.0)
    assert [s.source for s in made.record.other_sources] == [files["oven"], files["gps"]]
    assert json.dumps(made.record.to_json())


def test_positions_alone_become_velocities_with_a_sigma(tmp_path):
    """North at 0.1 m/s up to 30 s, then at rest. Two fixes of 5 mm, 2 s apart: 3.5 mm/s; more where
    the speed changes.
    """
    time_s = np.arange(60.0)
    north = np.minimum(time_s, 30.0) * 0.1
    lat_deg = LAT_DEG + north / 110_922.0  # metres a degree on this parallel
    fixes = {
        "stamp": 5000.01 + time_s,
        "lat": lat_deg,
        "lon": np.full(60, LON_DEG),
        "h": 380 - 0.2 * time_s,
        "s": np.full(60, 0.005),
        "sv": np.full(60, 0.01),
    }
    (tmp_path / "gps.csv").write_text(csv_text(fixes))
    (tmp_path / "log.csv").write_text(csv_text(rate_table()))
    gnss = {"file": "gps.csv", "time": {"column": "stamp"}, "position": GNSS["position"]}
    made = convert(tmp_path / "log.csv", MAP | {"gnss": gnss})
    v, sigma = made.run.gnss.v_n_m_s, made.run.gnss.sigma_velocity_m_s
    np.testing.assert_allclose(v[5:29], np.tile([0.1, 0.0, 0.2], (24, 1)), atol=2e-4)
    np.testing.assert_allclose(v[32:, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(sigma[[10, 50]], 0.005 * np.sqrt(2) / 2, rtol=1e-3)
    assert sigma[30] == pytest.approx(0.025, rel=0.05)
    assert "sigma 0.00354 m/s (median)" in str(made.record.notes)
    without = {**gnss, "position": {"columns": ["lat", "lon", "h"]}}
    made = convert(tmp_path / "log.csv", MAP | {"gnss": without})
    assert made.run.gnss is None
    assert "no sigma to give" in str(made.record.notes)


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"gnss": {**GNSS, "file": "no.csv", "time": {"column": "t"}}}, r"no\.csv: no such file"),
        ({"gnss": {**GNSS, "file": "no.csv"}}, r"gnss\.time: needed"),
        ({"gnss": {"position": {"columns": ["a", "b"]}}}, r"map: gnss\.position\.columns"),
        ({"gnss": {**GNSS, "frame": "ned"}}, r"map: unknown key gnss\.frame"),
        ({"gnss": GNSS}, r"log\.csv: no column lat, has t wx"),
        ({"odometer": {"column": "fx", "unit": "mph"}}, r"odometer\.unit: got \"mph\""),
        ({"header_lines": 1, "names_line": 3}, "names_line 3, needed at most"),
        ({"temperature": {"columns": ["fx"], "unit": "F"}}, r"map: temperature\.unit: got \"F\""),
    ],
)
def test_wrong_keys_are_named(tmp_path, keys, line):
    (tmp_path / "log.csv").write_text(csv_text(rate_table()))
    with pytest.raises(InputError, match=line):
        convert(tmp_path / "log.csv", MAP | keys)


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"accel": {**MAP["accel"], "unit": "g"}}, "6000 of 6000 rows"),
        ({"gyro": {**MAP["gyro"], "unit": "deg/s"}}, r"rows are damaged|mean \|w\| at rest"),
        ({"axes": {"x": "y", "y": "x", "z": "-z"}}, "z points up"),
        ({"axes": {"x": "z", "y": "y", "z": "-x"}}, r"on x, needed about -9\.8 on z"),
    ],
)
def test_wrong_units_and_axes_are_refused(tmp_path, keys, line):
    (tmp_path / "log.csv").write_text(csv_text(rate_table()))
    with pytest.raises(InputError, match=line):
        convert(tmp_path / "log.csv", MAP | keys)


def test_another_clock_is_said(tmp_path):
    (tmp_path / "gps.csv").write_text(csv_text({"stamp": np.arange(60.0), **FIXES}))
    (tmp_path / "log.csv").write_text(csv_text(rate_table()))
    keys = MAP | {"gnss": {**GNSS, "file": "gps.csv", "time": {"column": "stamp"}}}
    made = convert(tmp_path / "log.csv", keys)
    assert made.run.gnss is None
    assert "no gnss stream" in str(made.record.notes)
    for name, part in (("temperature", {"columns": ["s"]}), ("odometer", {"column": "s"})):
        with pytest.raises(InputError, match="another clock"):
            convert(
                tmp_path / "log.csv",
                MAP | {name: {**part, "file": "gps.csv", "time": {"column": "stamp"}}},
            )


def test_raw_numbers_are_not_taken_for_text(tmp_path):
    np.column_stack(list(rate_table().values())).tofile(tmp_path / "log.dat")
    with pytest.raises(InputError, match="binary, with columns and dtype"):
        convert(tmp_path / "log.dat")
