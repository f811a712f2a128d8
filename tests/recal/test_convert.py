"""`recal convert`: real and third-party logs to runs, with their axes proven by gravity and Earth
rate.
"""

import json
import struct
import tomllib
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.json_file import read_toml
from ins.records import InputError
from ins.units import DEG, DEG_PER_HOUR
from recal.cli.logs import convert as command
from recal.service.convert import convert
from tests.recal.verbs import check
from tests.trajectories.run_cases import F_B, W_B, csv_run, full_run
from trajectories.readers.conversion import convert_log
from trajectories.readers.registry import UnknownLog
from trajectories.runs.directory import read_run

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
MAPS = ROOT / "examples" / "maps"
needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="../shared/data is not beside the project"
)

app = typer.Typer()
app.command()(command)


def invoke(*args):
    return CliRunner().invoke(app, [str(a) for a in args])


def rest_means(name: str, axes: dict | None = None):
    """Mean f [m/s^2] and w [deg/h] in body axes of a shared log, by its map or other axes."""
    options = read_toml(MAPS / f"{name.split('.')[0]}.toml")
    run = convert_log(DATA / name, options | ({"axes": axes} if axes else {}), {}).run
    span = run.imu.dt_s.sum()
    return (
        run,
        run.imu.dv_m_s.sum(axis=0) / span,
        run.imu.dtheta_rad.sum(axis=0) / span / DEG_PER_HOUR,
    )


def down_and_horizontal(f, w):
    down = -f / np.linalg.norm(f)
    return w @ down, np.linalg.norm(w - (w @ down) * down)


@needs_data
@pytest.mark.parametrize(
    ("name", "rows", "rate_hz", "shift_s", "tolerance_deg_h"),
    # biases of 0.2 to 0.3 deg/h, not known from one position
    [
        ("x_LN100_up.ins", 19217, 64.07, 10769.990, 0.3),
        # declared: 0.1 deg/h an axis, more by Gauss-Markov
        ("calgary_project_data.BIN", 66667, 66.667, -0.015, 0.3),
    ],
)
def test_gyro_logs_show_gravity_down_and_earth_rate(name, rows, rate_hz, shift_s, tolerance_deg_h):
    """f is (0, 0, -g); w is -Omega sinL about down and Omega cosL level. Any wrong sign is off by
    12 deg/h or more.
    """
    run, f, w = rest_means(name)
    assert run.imu.time_s.size == rows
    assert run.imu.rate_hz == pytest.approx(rate_hz, rel=1e-3)
    assert run.imu.time_s[0] == pytest.approx(1 / rate_hz, rel=0.02)
    record = convert_log(DATA / name, read_toml(MAPS / f"{name.split('.')[0]}.toml"), {}).record
    assert record.time_shift_s == pytest.approx(shift_s, abs=1e-3)
    site = run.header.site
    assert f[2] == pytest.approx(-float(gravity_magnitude(site.lat_rad, site.height_m)), abs=0.01)
    assert abs(f[0]) < 0.4 and abs(f[1]) < 0.1  # the second log is 2 deg nose up
    down, level = down_and_horizontal(f, w)
    assert down == pytest.approx(
        -EARTH_RATE_RAD_S * np.sin(site.lat_rad) / DEG_PER_HOUR, abs=tolerance_deg_h
    )
    assert level == pytest.approx(
        EARTH_RATE_RAD_S * np.cos(site.lat_rad) / DEG_PER_HOUR, abs=tolerance_deg_h
    )


@needs_data
def test_ln100_axes_are_those_of_its_note():
    """Body (x, y, z) = (raw z, raw y, -raw x): the means of the raw file as published beside it,
    turned by hand.
    """
    _, f, w = rest_means("x_LN100_up.ins")
    # plain means; the stamps jitter by 1 %
    np.testing.assert_allclose(w, [1.250, 9.187, -11.479], atol=0.02)
    raw = np.fromfile(DATA / "x_LN100_up.ins", dtype="<f8").reshape(-1, 7)
    np.testing.assert_allclose(f, raw[:, [6, 5, 4]].mean(axis=0) * [1, 1, -1], atol=1e-5)


@needs_data
@pytest.mark.parametrize(
    "axes",
    [
        {"x": "x", "y": "y", "z": "z"},
        {"x": "-z", "y": "y", "z": "x"},
        {"x": "x", "y": "-z", "z": "y"},
    ],
    ids=["as logged", "upside down", "on its side"],
)
def test_wrong_ln100_axes_are_refused(axes):
    with pytest.raises(InputError, match="z must point down"):
        rest_means("x_LN100_up.ins", axes)


@needs_data
def test_mems_log_shows_gravity():
    """Gyro biases of up to 2.6 deg/s; gravity is down, within 60 mg, level to 3 deg."""
    run, f, _ = rest_means("x_adi_up.txt")
    assert run.imu.time_s.size == 3579 and run.imu.rate_hz == pytest.approx(100, rel=1e-6)
    assert run.header.gyro_technology == "mems"
    assert -f[2] == pytest.approx(9.81, abs=0.6)
    assert np.degrees(np.hypot(f[0], f[1]) / -f[2]) < 3.0


@needs_data
def test_from_log_to_checked_run(tmp_path):
    said = invoke(
        DATA / "x_LN100_up.ins",
        "-o",
        tmp_path / "run",
        "--map",
        MAPS / "x_LN100_up.toml",
        "--tail",
        "T1",
    )
    assert said.exit_code == 0, said.stderr
    assert "19217 rows, 64.07 Hz" in said.stdout and said.stderr == ""
    assert check(tmp_path / "run")["verdict"] == "ok"
    assert read_run(tmp_path / "run").header.tail == "T1"
    record = json.loads((tmp_path / "run" / "run.json").read_text())["conversion"]
    assert record["source"] == "x_LN100_up.ins"
    assert record["time_shift_s"] == pytest.approx(10769.990, abs=1e-3)


MAP = """
columns = ["t", "wx", "wy", "wz", "fx", "fy", "fz"]
{format}
[time]
column = "t"
[gyro]
columns = ["wx", "wy", "wz"]
unit = "rad/s"
[accel]
columns = ["fx", "fy", "fz"]
unit = "m/s2"
"""
GIVEN = {
    "imu_serial": "S",
    "gyro_technology": "rlg",
    "start_utc": "2026-03-01T05:00:00Z",
    "lat_deg": 30,
    "lon_deg": 7,
    "height_m": 250,
}
ROWS = np.array([[0.02 * k, *W_B, *F_B] for k in range(500)])


def options(format_lines: str) -> dict:
    return tomllib.loads(MAP.format(format=format_lines))


@pytest.mark.parametrize(("dtype", "pack"), [("<f8", "<7d"), (">f8", ">7d")])
def test_binary_rows_with_a_header_and_a_cut_off_end(tmp_path, dtype, pack):
    log = tmp_path / "log.dat"
    log.write_bytes(b"HEADER!" + b"".join(struct.pack(pack, *row) for row in ROWS) + b"\x01" * 30)
    made = convert_log(
        log, options(f'format = "binary"\ndtype = "{dtype}"\nheader_bytes = 7'), GIVEN
    )
    np.testing.assert_allclose(
        made.run.imu.dv_m_s, np.tile(F_B * 0.02, (500, 1)), rtol=1e-9, atol=1e-18
    )
    (note,) = made.record.notes
    assert "30 of 56 bytes" in note


def test_a_csv_with_the_names_of_a_run_needs_no_map(tmp_path):
    source = csv_run(tmp_path / "source") / "imu.csv"
    said = invoke(
        source,
        "-o",
        tmp_path / "run",
        "--serial",
        "SN-0042",
        "--technology",
        "rlg",
        "--lat-deg",
        30,
        "--lon-deg",
        7,
        "--height-m",
        250,
        "--start-utc",
        "2026-03-01T05:00:00Z",
        "--run-id",
        "again",
        "--json",
    )
    assert said.exit_code == 0, said.stderr
    result = json.loads(said.stdout)
    assert result["schema"] == "recal.convert/1"
    assert result["format"] == "csv"
    assert result["run_id"] == "again"
    run = read_run(tmp_path / "run")
    assert result["sha256"] == run.sha256
    np.testing.assert_allclose(run.imu.dtheta_rad, full_run().imu.dtheta_rad, rtol=1e-12)


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"imu_serial": None}, r"imu_serial \(--serial\)"),
        ({"lat_deg": None, "lon_deg": None}, r"lat_deg \(--lat-deg\), lon_deg \(--lon-deg\)"),
        ({"lat_deg": 91}, r"site\.lat_deg: got 91, needed at most 90"),
        ({"gyro_technology": "laser"}, 'gyro_technology: got "laser"'),
        ({"start_utc": "today"}, 'start_utc: got "today"'),
    ],
)
def test_missing_or_wrong_header_values_are_named(tmp_path, given, line):
    source = csv_run(tmp_path / "source") / "imu.csv"
    with pytest.raises(InputError, match=line):
        convert_log(source, {}, GIVEN | given)


def test_a_wrong_header_value_names_the_map_s_file_where_there_is_one(tmp_path):
    source, walk = csv_run(tmp_path / "source") / "imu.csv", tmp_path / "walk.toml"
    # a site's keys may stand in [run] itself
    walk.write_text('format = "csv"\n[run]\nlat_deg = 91\nlon_deg = 7\n')
    given = {key: GIVEN[key] for key in ("imu_serial", "gyro_technology", "start_utc")}
    with pytest.raises(InputError, match=r"^walk.toml: .*site\.lat_deg: got 91"):
        convert(source, map_file=walk, header=given)
    with pytest.raises(InputError, match=r"^options: site\.lat_deg: got 91"):
        convert(source, header={**GIVEN, "lat_deg": 91})
    site = convert(
        source, map_file=walk, header={**given, "lat_deg": 30}
    ).conversion.run.header.site
    assert (site.lat_rad, site.lon_rad) == pytest.approx((30 * DEG, 7 * DEG))


def test_unknown_keys_formats_and_files_are_refused(tmp_path):
    source = csv_run(tmp_path / "source") / "imu.csv"
    with pytest.raises(InputError, match=r"unknown key serial"):
        convert_log(source, {"run": {"serial": "S"}}, GIVEN)
    with pytest.raises(InputError, match=r"map: unknown key colums"):
        convert_log(source, options('format = "csv"\ncolums = 1'), GIVEN)
    (tmp_path / "walk.toml").write_text('format = "csv"\ncolums = 1')
    with pytest.raises(InputError, match=r"^walk.toml: map: unknown key colums"):
        convert(source, map_file=tmp_path / "walk.toml", header=GIVEN)
    with pytest.raises(InputError, match=r"got 'ulg', needed one of .*csv"):
        convert_log(source, {"format": "ulg"}, GIVEN)
    (tmp_path / "log").write_bytes(bytes(range(256)))
    with pytest.raises(UnknownLog, match="not recognised"):
        convert_log(tmp_path / "log", {}, GIVEN)
    with pytest.raises(InputError, match="no such file"):
        convert_log(tmp_path / "nothing", {}, GIVEN)
    (tmp_path / "map.toml").write_text("axes = {")
    with pytest.raises(InputError, match="not valid TOML"):
        read_toml(tmp_path / "map.toml")
    with pytest.raises(InputError, match="cannot be read"):
        read_toml(tmp_path / "no.toml")


def test_fixes_are_refused_where_a_log_has_its_own(tmp_path):
    (tmp_path / "log.bin").write_bytes(b"\xa3\x95\x80" + bytes(200))
    with pytest.raises(InputError, match=r"log\.bin.*--gnss"):
        convert_log(tmp_path / "log.bin", {"format": "dataflash", "gnss": {"file": "x"}}, GIVEN)


def test_what_is_accepted_by_name_is_said_and_kept(tmp_path):
    """Accelerometers that read 8 m/s^2 and thermometers that never change: refused, and warned of;
    accepted by their options, kept in run.json, said by `recal check`.
    """
    t = np.arange(0.0, 700.0, 0.1)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((t.size, 6))
    still = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -8.0])
    rows = np.column_stack([t, noise + still, np.full(t.size, 25.0)])
    names = "t,gx,gy,gz,ax,ay,az,T"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=names, comments="", fmt="%.6f")
    (tmp_path / "map.toml").write_text(
        '[time]\ncolumn = "t"\n[gyro]\ncolumns = ["gx", "gy", "gz"]\nunit = "rad/s"\n'
        '[accel]\ncolumns = ["ax", "ay", "az"]\nunit = "m/s2"\n[temperature]\n'
        'columns = ["T"]\n[run]\n'
        'imu_serial = "A"\nstart_utc = "2026-03-01T05:00:00Z"\ngyro_technology = "mems"\n'
        "site = {lat_deg = 45, lon_deg = 7, height_m = 0}\n"
    )
    asked = [tmp_path / "log.csv", "--map", tmp_path / "map.toml", "-o", tmp_path / "run"]
    said = invoke(*asked)
    assert said.exit_code != 0 and "accepted_accelerometer_scale 0.19" in str(said.exception)
    scale = ["--accepted-accelerometer-scale", "0.2"]
    assert invoke(*asked, *scale).exit_code == 0
    assert "accepted_constant_temperature" in str(check(tmp_path / "run")["problems"])
    assert invoke(*asked, *scale, "--accepted-constant-temperature", "--force").exit_code == 0
    lines = str(check(tmp_path / "run")["problems"])
    assert "25 degC" in lines
    assert "accepted_accelerometer_scale" in lines
    run = read_run(tmp_path / "run")
    assert run.header.accepted_accel_scale == 0.2 and run.temperature.constant
    given = {"gyro_technology": "rlg", "accepted_accelerometer_scale": 0.2}
    with pytest.raises(InputError, match="of mems units only"):
        convert_log(asked[0], read_toml(asked[2]), given)
