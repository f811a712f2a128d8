"""Bad runs: one line that names the file, the row or key, what was got and what was needed."""

import re

import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.run_cases import (
    csv_run,
    edit_json,
    lines,
    put_lines,
    scale_columns,
    set_cell,
)
from trajectories.runs.directory import inspect_run, read_run


@pytest.fixture
def path(tmp_path):
    return csv_run(tmp_path / "run")


def rename(path, old, new):
    rows = lines(path)
    rows[0] = [name.replace(old, new) for name in rows[0]]
    put_lines(path, rows)


# stream, row, column, value, what the complaint says after file and row
CELLS = [
    ("imu", 10, "dtheta_z_rad", "nan", "column dtheta_z_rad: got nan"),
    ("imu", 10, "dv_x_m_s", "", "column dv_x_m_s: got nan"),
    ("imu", 10, "dv_x_m_s", "-inf", "column dv_x_m_s: got -inf"),
    ("imu", 10, "dv_x_m_s", "1,5", "8 values, needed 7"),
    ("imu", 10, "dv_x_m_s", "abc", "column dv_x_m_s: got 'abc'"),
    ("imu", 10, "time_s", "0.05", r"column time_s: 0\.05 s goes back from 0\.09 s"),
    ("imu", 10, "time_s", "0.09", r"column time_s: 0\.09 s repeats"),
    ("imu", 10, "time_s", "nan", "column time_s: got nan"),
    ("temperature", 4, "time_s", "1", "column time_s: 1 s goes back from 2 s"),
    ("temperature", 4, "gyro_x_degC", "warm", "column gyro_x_degC: got 'warm'"),
    ("gnss", 4, "lat_deg", "91", "column lat_deg: got 91, needed -90 to 90"),
    ("gnss", 4, "time_s", "2", "column time_s: 2 s repeats"),
    ("gnss", 4, "sigma_velocity_m_s", "-1", "sigma_velocity_m_s: got -1, needed more than 0"),
    ("odometer", 4, "time_s", "0", "column time_s"),
    ("phases", 2, "phase", "flying", "phase 'flying', needed one of alignment"),
    ("phases", 2, "end_s", "20", "phase parked: ends at 20"),
    ("phases", 2, "end_s", "", "got 'parked"),
]


@pytest.mark.parametrize(("stream", "row", "column", "value", "line"), CELLS)
def test_a_wrong_value_is_named(path, stream, row, column, value, line):
    set_cell(path / f"{stream}.csv", row=row, column=column, value=value)
    with pytest.raises(InputError, match=rf"{stream}\.csv: row {row} .*{line}") as caught:
        read_run(path)
    assert "\n" not in str(caught.value)


# stream, column, its new name, the column that is named as needed
COLUMNS = [
    ("imu", "dtheta_x_rad", "dtheta_x_deg", "as in dtheta_x_rad"),
    ("imu", "dtheta_x_rad", "gyro_x_deg_h", "as in gyro_x_rad_s"),
    ("imu", "dtheta_x_rad", "gyro_x_rad_s", "beside dtheta_y_rad"),
    ("imu", "dv_z_m_s", "dv_y_m_s", "appears twice"),
    ("imu", "time_s", "", "is a table index"),
    ("imu", "time_s", "time_us", "as in time_s"),
    ("temperature", "gyro_x_degC", "gyro_x_K", "as in gyro_x_degC"),
    ("temperature", "gradient_x_degC", "ambient_degC", "gradient_y_degC needs all of gradient_x"),
    ("gnss", "lat_deg", "lat_rad", "as in lat_deg"),
    ("odometer", "speed_m_s", "speed_kt", "as in speed_m_s"),
    ("phases", "end_s", "stop", "unknown column stop"),
]


@pytest.mark.parametrize(("stream", "old", "new", "line"), COLUMNS)
def test_a_wrong_column_is_named(path, stream, old, new, line):
    rename(path / f"{stream}.csv", old, new)
    with pytest.raises(InputError, match=rf"{stream}\.csv: .*{line}"):
        read_run(path)


KEYS = [
    (lambda d: d["site"].update(lat_deg=91), r"site\.lat_deg: got 91, needed at most 90"),
    (lambda d: d["site"].update(lat_deg="45"), r'site\.lat_deg: got "45", needed a number'),
    (lambda d: d["site"].update(height_m=float("nan")), "NaN"),
    (lambda d: d["site"].pop("lon_deg"), r"site\.lon_deg is missing"),
    (lambda d: d.pop("imu_serial"), "imu_serial is missing"),
    (lambda d: d.update(imu_serial=""), "imu_serial"),
    (lambda d: d.update(imu_serial="a\nb"), "imu_serial"),
    (lambda d: d.update(gyro_technology="laser"), 'gyro_technology: got "laser"'),
    (lambda d: d.update(schema="recal.run/2"), 'schema: got "recal.run/2"'),
    (lambda d: d.update(start_utc="2026-03-01T05:00:00"), "start_utc: .* needed a UTC time"),
    (lambda d: d.update(applied_table_sha256="abc"), 'applied_table_sha256: got "abc"'),
    (lambda d: d["lever_arms_m"].update(gnss=[1, 2]), r"lever_arms_m\.gnss: got \[1, 2\]"),
    (lambda d: d["survey"].update(sigma_heading_deg=None), "needed sigma_heading_deg"),
]


@pytest.mark.parametrize(("change", "line"), KEYS)
def test_a_wrong_key_is_named(path, change, line):
    edit_json(path, change)
    with pytest.raises(InputError, match=rf"run\.json: .*{line}"):
        read_run(path)


def test_files_are_named_when_missing_doubled_or_damaged(path, tmp_path):
    with pytest.raises(InputError, match="no such run directory"):
        read_run(tmp_path / "nowhere")
    (path / "imu.parquet").write_bytes(b"PAR1 this is not")
    with pytest.raises(InputError, match=r"imu\.parquet.*imu\.csv"):
        read_run(path)
    (path / "imu.csv").unlink()
    with pytest.raises(InputError, match=r"imu\.parquet"):
        read_run(path)
    (path / "imu.parquet").unlink()
    with pytest.raises(InputError, match=r"imu\.parquet"):
        read_run(path)
    (path / "run.json").unlink()
    assert len(inspect_run(path).errors) == 2


def test_links_out_of_the_run_are_refused(path, tmp_path):
    (path / "gnss.csv").rename(tmp_path / "elsewhere.csv")
    (path / "gnss.csv").symlink_to(tmp_path / "elsewhere.csv")
    with pytest.raises(InputError, match=r"gnss\.csv"):
        read_run(path)


def test_a_gap_is_named_with_its_length(path):
    rows = lines(path / "imu.csv")
    put_lines(path / "imu.csv", rows[:1001] + rows[1151:])
    with pytest.raises(InputError, match=r"imu\.csv.*row 1001.*line 1002.*1\.510 s"):
        read_run(path)


@pytest.mark.parametrize(
    ("part", "line"),
    [
        (lambda rows: rows[:2001] + rows[2001::2], "row 2001 .*: rate changes"),
        (lambda rows: [rows[0], *rows[1::12]], r"rate 8\.333 Hz, needed 10 to 2000 Hz"),
        (
            lambda rows: [rows[0], *([repr(float(r[0]) / 30), *r[1:]] for r in rows[1:])],
            r"rate 3000 Hz, needed",
        ),
        (lambda rows: rows[:2], r"1 rows, needed at least 2"),
        (lambda rows: rows[:1], r"imu\.csv: no rows"),
    ],
)
def test_a_wrong_rate_is_named(path, part, line):
    put_lines(path / "imu.csv", part(lines(path / "imu.csv")))
    with pytest.raises(InputError, match=line):
        read_run(path)


def test_a_second_of_double_rate_is_not_a_rate_change(path):
    rows = lines(path / "imu.csv")
    put_lines(path / "imu.csv", rows[:1001] + rows[1001:1101:2] + rows[1101:])
    assert len(read_run(path).faults) == 1


# which increments are multiplied by what, and the unit or sign that is named
GATES = [
    ("dv_", 1 / 9.80665, r"0\.9\d+ m/s2, needed 9\.8: g\? multiply by 9\.80665"),
    ("dv_", 1000.0, r"mm/s2\? divide by 1000"),
    ("dv_", 100.0, r"accel_x_m_s2 .*cm/s2\? divide by 100"),
    ("dv_", 0.9, r"needed 9\.8 within 2 %"),
    ("dv_", 0.0, "gravity removed"),
    ("dv_", -1.0, r"\+9\.79\d m/s2 on z, .*accelerometer sign"),
    ("dtheta_", 57.29578, r"8\d\d\.\d deg/h, .* deg/s\? multiply by pi/180"),
    ("dtheta_", 206264.8, r"deg/h\? multiply by 4\.848"),
    ("dtheta_", 1000.0, r"mrad/s\? divide by 1000"),
    ("dtheta_", 100.0, "name them gyro_x_rad_s"),
]


@pytest.mark.parametrize(("prefix", "factor", "line"), GATES)
def test_units_and_signs_are_found_at_rest(path, prefix, factor, line):
    scale_columns(path / "imu.csv", prefix, factor)
    with pytest.raises(InputError, match=line):
        read_run(path)


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_axis_map_named_for_a_wrong_installation_puts_it_right(path, axis, sign):
    """Turn the unit so that another axis points down or up; the map in the message turns it back,
    right-handed.
    """
    k = "xy".index(axis)
    turn = [2, 1, 0] if axis == "x" else [0, 2, 1]
    rows = lines(path / "imu.csv")
    raw = np.array(rows[1:], dtype=float)
    for at in (1, 4):
        body = raw[:, at : at + 3].copy()
        raw[:, at : at + 3] = body[:, turn] * np.where(np.arange(3) == k, -sign, 1)
    put_lines(path / "imu.csv", [rows[0], *([repr(v) for v in row] for row in raw.tolist())])
    with pytest.raises(
        InputError, match=rf"{'[+]' if sign > 0 else '-'}9\.79\d m/s2 on {axis}"
    ) as e:
        read_run(path)
    text = str(e.value)
    told = dict(
        part.split(" = ")
        for part in text[text.index("axes ") + 5 : text.index(" would")].split(", ")
    )
    M = np.zeros((3, 3))
    for i, name in enumerate("xyz"):
        raw_axis = told[name].strip('"')
        M[i, "xyz".index(raw_axis[-1])] = -1 if raw_axis.startswith("-") else 1
    assert np.linalg.det(M) == pytest.approx(1)
    assert (M @ raw[0, 4:7])[2] == pytest.approx(-9.8 / 100, rel=0.01)


def test_a_wrong_gyro_sign_fails_the_check_but_can_be_read(path):
    scale_columns(path / "imu.csv", "dtheta_", -1.0)
    seen = inspect_run(path)
    assert seen.run is not None
    assert [f.level for f in seen.findings] == ["suspect"]
    assert "sign of the gyros or of the latitude" in seen.findings[0].text


def test_tilted_and_biased_units_pass(path):
    """20 deg of pitch, a 1 deg/h bias: neither is a unit or an axis fault."""
    rows = lines(path / "imu.csv")
    raw = np.array(rows[1:], dtype=float)
    c, s = np.cos(np.radians(20)), np.sin(np.radians(20))
    tilt = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    raw[:, 1:4], raw[:, 4:7] = (
        raw[:, 1:4] @ tilt.T + np.radians(1 / 3600) / 100,
        raw[:, 4:7] @ tilt.T,
    )
    put_lines(path / "imu.csv", [rows[0], *([repr(v) for v in row] for row in raw.tolist())])
    assert inspect_run(path).findings == ()


@pytest.mark.parametrize(
    ("technology", "bias_deg_h", "tolerance"),
    [("rlg", 3.0, 2), ("fog", 6.0, 5), ("mems", 9472.0, 150)],
)
def test_a_rate_at_rest_that_hides_the_earth_is_a_warning_with_the_number(
    path, technology, bias_deg_h, tolerance
):
    edit_json(path, lambda d: d.update(gyro_technology=technology))
    rows = lines(path / "imu.csv")
    raw = np.array(rows[1:], dtype=float)
    size = np.linalg.norm(raw[:, 1:4].mean(axis=0))
    # along Earth rate: |w| grows by the whole bias
    raw[:, 1:4] *= 1 + np.radians(bias_deg_h / 3600) / 100 / size
    put_lines(path / "imu.csv", [rows[0], *([repr(v) for v in row] for row in raw.tolist())])
    (found,) = inspect_run(path).findings
    assert found.level == "warning"
    seen = re.search(
        rf"mean \|w\| at rest is ([\d.]+) deg/h.* needed within {tolerance} of it \({technology}\)",
        found.text,
    )
    assert float(seen[1]) == pytest.approx(15.04 + bias_deg_h, rel=0.02)
