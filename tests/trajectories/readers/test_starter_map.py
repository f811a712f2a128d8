"""A column map to begin with: what foreign tables look like, and that the map reads them right."""

import numpy as np
import pytest

from ins.json_file import read_toml
from ins.records import InputError
from ins.units import DEG, DEG_PER_HOUR, STANDARD_GRAVITY
from recal.service.convert import convert
from recal.service.look.look import write_starter
from trajectories.readers.columns.named_columns import named
from trajectories.readers.columns.starter_map import starter_map
from trajectories.readers.registry import UnknownLog, read_log
from trajectories.readers.rows.column_map import LogOptions

LAT = 45.0
RATE_HZ, ROWS = 50.0, 6000
OMEGA = 15.041 * DEG_PER_HOUR
REST_W = OMEGA * np.array([np.cos(LAT * DEG), 0.0, -np.sin(LAT * DEG)])  # heading north
REST_F = np.array([0.0, 0.0, -9.806])
UNIT = {"imu_serial": "SN-1", "gyro_technology": "fog", "start_utc": "2026-03-01T05:00:00Z"}
UNIT |= {"lat_deg": LAT, "lon_deg": 7.0, "height_m": 0.0}


def at_rest(sigma=1e-7):
    """Time, rates and forces of a unit that stands level, nose north."""
    rng = np.random.default_rng(3)
    time_s = np.arange(1, ROWS + 1) / RATE_HZ
    w = REST_W + rng.normal(0, sigma, (ROWS, 3))
    return time_s, w, REST_F + rng.normal(0, 1e-3, (ROWS, 3))


def rocked():
    """A consumer unit, rocked by hand in the middle: its gyros do not see the Earth turn."""
    time_s, w, _ = at_rest(2e-3)
    w = w + [0.02, -0.01, 0.015]
    moving = (time_s > 40) & (time_s < 80)
    w[moving, 0] += 0.6 * np.sin(2.5 * time_s[moving])
    w[moving, 1] += 0.5 * np.sin(1.9 * time_s[moving])
    f, held = np.empty((ROWS, 3)), REST_F.copy()
    for k in range(ROWS):
        held = held - np.cross((w[k] - [0.02, -0.01, 0.015]) / RATE_HZ, held)
        f[k] = held * np.linalg.norm(REST_F) / np.linalg.norm(held)
    return time_s, w, f


def written(path, columns, *, sign=",", decimal=".", head="", names=True, decimals=10):
    rows = np.stack(list(columns.values()), axis=1)
    lines = [sign.join(f"{v:.{decimals}f}" for v in row) for row in rows]
    text = "\n".join(lines).replace(".", decimal)
    path.write_text(head + (sign.join(columns) + "\n" if names else "") + text + "\n")
    return path


def named_table(time, w, f, names):
    columns = {names[0]: time}
    columns |= {names[1].format(axis): w[:, k] for k, axis in enumerate("xyz")}
    return columns | {names[2].format(axis): f[:, k] for k, axis in enumerate("xyz")}


def read(path, tmp_path):
    """The run by the map that was begun, completed by options."""
    found = starter_map(path)
    file = tmp_path / "map.toml"
    file.write_text(found.text)
    return found, convert(path, map_file=file, header=UNIT).run.imu.whole()


def check_rates(imu, w, f):
    dt_s = imu.dt_s[:, None]
    assert imu.dtheta_rad[1:] / dt_s[1:] == pytest.approx(w[1:], abs=1e-9)
    assert imu.dv_m_s[1:] / dt_s[1:] == pytest.approx(f[1:], abs=1e-6)


@pytest.mark.parametrize(
    "names, units, layout",
    [
        (("t_ms", "gyro_{}_deg_s", "acc_{}_g"), (1e3, 1 / DEG, 1 / STANDARD_GRAVITY), {}),
        (
            ("Zeit [s]", "Drehrate_{} [Grad/s]", "Beschleunigung_{} [m/s\u00b2]"),
            (1.0, 1 / DEG, 1.0),
            {"sign": ";", "decimal": ","},
        ),
        (("TimeUS", "Gyr{}", "Acc{}"), (1e6, 1.0, 1.0), {"sign": "\t"}),
        (("a", "b{}", "c{}"), (1.0, 1 / DEG_PER_HOUR, 1e3 / STANDARD_GRAVITY), {"names": False}),
        (("t", "w{}", "a{}"), (1.0, 1.0, 1.0), {"sign": " ", "head": "# a logger\n# of ours\n"}),
        (("t", "dtheta_{}", "dv_{}"), (1.0, 1 / RATE_HZ, 1 / RATE_HZ), {}),
    ],
)
def test_units_are_found_by_gravity_and_the_earths_rate(tmp_path, names, units, layout):
    time_s, w, f = at_rest()
    columns = named_table(time_s * units[0], w * units[1], f * units[2], names)
    found, imu = read(written(tmp_path / "log.txt", columns, decimals=12, **layout), tmp_path)
    check_rates(imu, w, f)
    assert set(found.missing) == {
        "run.imu_serial",
        "run.gyro_technology",
        "run.start_utc",
        "run.site.lat_deg",
    }


def test_a_wrong_unit_in_the_name_gives_way_to_gravity(tmp_path):
    time_s, w, f = at_rest()
    names = ("time_s", "gyro_{}_deg_s", "accel_{}_g")
    found, imu = read(
        written(tmp_path / "log.csv", named_table(time_s, w, f, names), decimals=12), tmp_path
    )
    check_rates(imu, w, f)
    assert sum("although" in why for _, why in found.guesses) == 2


def test_axes_that_point_up_are_turned(tmp_path):
    time_s, w, f = at_rest()
    up = np.array([1.0, -1.0, -1.0])
    path = written(
        tmp_path / "l.csv", named_table(time_s, w * up, f * up, ("t", "w{}", "a{}")), decimals=12
    )
    _, imu = read(path, tmp_path)
    check_rates(imu, w, f)


@pytest.mark.parametrize("factor, unit", [(1.0, "rad/s"), (1 / DEG, "deg/s")])
def test_gyros_without_the_earths_rate_are_told_by_the_turns_of_gravity(tmp_path, factor, unit):
    time_s, w, f = rocked()
    path = written(tmp_path / "l.csv", named_table(time_s, w * factor, f, ("t", "g{}", "a{}")))
    assert f'unit = "{unit}"' in starter_map(path).text


def test_what_nothing_shows_is_left_open_and_refused(tmp_path):
    time_s, w, f = at_rest(2e-3)
    w = w + [0.02, -0.01, 0.015]
    path = written(tmp_path / "l.csv", named_table(time_s, w, f * 0.5, ("t", "g{}", "a{}")))
    found = starter_map(path)
    assert {"gyro.unit", "accel.unit"} <= set(found.missing)
    (tmp_path / "map.toml").write_text(found.text)
    with pytest.raises(InputError, match=r"map: gyro\.unit, accel\.unit: still"):
        convert(path, map_file=tmp_path / "map.toml", header=UNIT)


def test_fixes_and_temperatures_come_with_their_units(tmp_path):
    time_s, w, f = at_rest()
    columns = named_table(time_s, w, f, ("t", "w{}", "a{}"))
    columns |= {"Temp": 300.0 + time_s / 60, "lat": 45.1 + 0 * time_s, "lon": 7.2 + 0 * time_s}
    columns |= {"alt": 250.0 + 0 * time_s, "ve": 0 * time_s, "vn": 0 * time_s, "vu": 0 * time_s}
    keys = read_toml_of(starter_map(written(tmp_path / "l.csv", columns, decimals=12)), tmp_path)
    assert keys["temperature"] == {"columns": ["Temp"], "unit": "K"}
    assert keys["gnss"]["velocity"]["frame"] == "enu"
    assert keys["gnss"]["position"]["unit"] == "deg" and "site" not in keys["run"]


def test_a_steady_turn_is_no_rest_and_a_slow_column_perhaps_a_temperature(tmp_path):
    """Turned on a table for a fifth of the log: no force shows it. The column has a name that says
    nothing, so its unit is left open; a counter and noise are no temperatures.
    """
    time, w, f = at_rest()
    w[(time > 60) & (time < 84), 2] += 0.05
    columns = named_table(time, w / DEG, f, ("stamp", "g{}", "a{}"))
    columns["count"] = np.arange(ROWS) % 1000 * 1.0
    columns["spare"] = np.random.default_rng(1).normal(0.0, 1.0, ROWS)
    columns["board"] = 20.0 + 10.0 * (1.0 - np.exp(-time / 60.0))
    text = starter_map(written(tmp_path / "log.csv", columns)).text
    assert 'columns = ["gx", "gy", "gz"]\nunit = "deg/s"' in text
    assert '[temperature]\ncolumn = "board"\nunit = "?"' in text


def table(path, names, rows, before=""):
    """A log in the form of a public one: its head as it stands, then the rows."""
    text = [before + names, *(",".join(f"{v:.9g}" for v in row) for row in rows)]
    path.write_text("\n".join(text) + "\n")
    return path


def test_forces_of_an_odd_name_are_found_beside_a_quaternion_and_a_magnetometer(tmp_path):
    """`tx ty tz wx wy wz mx my mz qx qy qz qw`, as a public MEMS log has it: its magnetometer was
    taken for the accelerometers and its quaternion for the gyros.
    """
    time_s, w, f = rocked()
    turned = np.full((len(w), 4), 0.5) + 0.1 * w[:, [0, 1, 2, 0]]
    rows = np.column_stack([time_s, f, w, 0.03 * f, turned])
    names = "time,tx,ty,tz,wx,wy,wz,mx,my,mz,qx,qy,qz,qw"
    keys = read_toml_of(starter_map(table(tmp_path / "l.csv", names, rows)), tmp_path)
    assert keys["accel"] == {"columns": ["tx", "ty", "tz"], "unit": "m/s2"}
    assert keys["gyro"] == {"columns": ["wx", "wy", "wz"], "unit": "rad/s"}
    assert "temperature" not in keys


def test_names_of_two_lines_are_those_of_the_group_and_its_part(tmp_path):
    """As RepoIMU has it: empty orientations were taken for the gyros, the time among them."""
    time_s, w, f = rocked()
    rows = np.column_stack([time_s, np.zeros((len(w), 4)), f, w])
    names = (
        "Time (s),Vicon Orientation,,,,IMU Acceleration,,,IMU Gyroscope,,,\n,W,X,Y,Z,X,Y,Z,X,Y,Z,"
    )
    keys = read_toml_of(starter_map(table(tmp_path / "l.csv", names, rows)), tmp_path)
    assert keys["accel"]["columns"] == [f"IMU Acceleration {axis}" for axis in "XYZ"]
    assert keys["gyro"] == {"columns": [f"IMU Gyroscope {axis}" for axis in "XYZ"], "unit": "rad/s"}
    assert keys["time"]["column"] == "Time (s)"


def test_rows_that_end_with_empty_columns_keep_their_names(tmp_path):
    """As MicroStrain writes it: fields that are never filled, and one sign more than names."""
    time_s, w, f = rocked()
    rows = ["GPS TOW,X Accel [x8004],Y Accel,Z Accel,X Gyro,Y Gyro,Z Gyro,Lat,Long,Height,A,B,C,D"]
    for row in np.column_stack([time_s, f / STANDARD_GRAVITY, w]):
        rows.append(",".join(f"{v:.9g}" for v in row) + "," * 8)
    path = tmp_path / "l.csv"
    path.write_text("FILE_INFO\nModelName,3DM\n\nDATA_START\n" + "\n".join(rows) + "\n")
    keys = read_toml_of(starter_map(path), tmp_path)
    assert keys["accel"] == {"columns": ["X Accel [x8004]", "Y Accel", "Z Accel"], "unit": "g"}
    assert "gnss" not in keys


@pytest.mark.parametrize("off", [1.08, 0.6])
def test_a_mean_near_the_earths_rate_in_some_unit_is_chance_where_no_name_says_it(tmp_path, off):
    """Biases of MEMS of 0.0045 rad/s are 16 deg/h if they were deg/s; with the noise of a log of
    a minute any size near it is.
    """
    time_s, w, f = at_rest(2e-5)
    w = (w - REST_W + np.array([0.0, 0.0, OMEGA * off])) / DEG
    path = written(tmp_path / "l.csv", named_table(time_s, w, f, ("t", "g{}", "a{}")), decimals=9)
    assert "gyro.unit" in starter_map(path).missing


def test_accelerometers_a_sixth_off_gravity_are_named_so(tmp_path):
    time_s, w, f = rocked()
    rows = np.column_stack([time_s, 0.85 * f / STANDARD_GRAVITY, w])
    path = table(tmp_path / "l.csv", "t,Ax,Ay,Az,Gx,Gy,Gz", rows)
    found = starter_map(path)
    assert "accel.unit" not in found.missing and "15 %" in dict(found.guesses)["accel"]


@pytest.mark.parametrize(
    "names, gravity",
    [("\nTime,z-accel,stage,drag,x-accel,y-accel,k", 1.0), ("a,b,c,d,e,f,g", 0.03)],
)
def test_a_table_without_gyros_or_without_gravity_says_so(tmp_path, names, gravity):
    time_s, w, f = rocked()
    rows = np.column_stack([time_s, gravity * f, w])
    with pytest.raises(InputError, match="a table of 7 columns"):
        starter_map(table(tmp_path / "l.csv", names, rows))


def test_matrices_of_a_matlab_file_are_named_by_column(tmp_path):
    from scipy.io import savemat

    _, w, f = rocked()
    path = tmp_path / "l.mat"
    savemat(path, {"imu_gyr": w, "imu_acc": f, "opt_pos": np.cumsum(f, axis=0) * 1e-3})
    keys = read_toml_of(starter_map(path), tmp_path)
    assert keys["gyro"]["columns"] == ["imu_gyr[0]", "imu_gyr[1]", "imu_gyr[2]"]
    assert keys["accel"] == {"columns": ["imu_acc[0]", "imu_acc[1]", "imu_acc[2]"], "unit": "m/s2"}
    savemat(path, {"vals": w.T, "ts": f[:, 0]})
    assert starter_map(path) is None


def read_toml_of(found, tmp_path):
    (tmp_path / "map.toml").write_text(found.text)
    return read_toml(tmp_path / "map.toml")


@pytest.mark.parametrize("content", [b"Dear Sir,\nno table.\n" * 50, bytes(range(256)) * 20])
def test_what_is_no_table_gets_no_map_and_ten_lines(tmp_path, content):
    path = tmp_path / "letter.txt"
    path.write_bytes(content)
    assert starter_map(path) is None
    with pytest.raises(UnknownLog) as unknown:
        read_log(path, LogOptions())
    assert len(unknown.value.more) <= 9 and all(len(line) < 100 for line in unknown.value.more)


def test_a_completed_map_is_never_written_over(tmp_path):
    time_s, w, f = at_rest()
    path = written(tmp_path / "l.csv", named_table(time_s, w, f, ("t", "w{}", "a{}")), decimals=12)
    kept = tmp_path / "l.toml"
    with pytest.raises(InputError, match="is a column map"):
        write_starter(path, kept, UnknownLog("l.csv: not known"))
    kept.write_text("mine")
    with pytest.raises(InputError, match="--force"):
        write_starter(path, kept, UnknownLog("l.csv: not known"))
    assert kept.read_text() == "mine"


@pytest.mark.parametrize(
    "name, quantity, axis, unit",
    [
        ("wx(rad/s)", "gyro", "x", "rad/s"),
        ("GyrX [\u00b0/s]", "gyro", "x", "deg/s"),
        ("q", "gyro", "y", ""),
        ("specific_force_z_m_s2", "accel", "z", "m/s2"),
        ("accel X (g)", "accel", "x", "g"),
        ("imu1_acc_y_mg", "accel", "y", "mg"),
        ("timestamp (ms)", "time", "", "ms"),
        ("gyro_x_degC", "temperature", "x", "degC"),
        ("T_gyro", "temperature", "", ""),
        ("Vel_E [m/s]", "velocity", "e", "m/s"),
        ("mag_x", "", "", ""),
        ("q0", "", "", ""),
        ("sigma_horizontal_m", "", "", ""),
        ("raw_angular_rate_x_deg_per_s", "gyro", "x", "deg/s"),
        ("raw_acceleration_y_gs", "accel", "y", "g"),
        ("est_acceleration_z", "", "", ""),
    ],
)
def test_names_say_quantity_axis_and_unit(name, quantity, axis, unit):
    found = named(name)
    assert (found.quantity, found.axis, found.unit) == (quantity, axis, unit)
