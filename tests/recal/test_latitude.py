"""A latitude that was typed, guessed or measured: what the gyros' sigmas make of it.

The recordings are written here from the equations of a unit at rest on the turning Earth, in numpy,
without the simulator.
"""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

import recal
from infield.session.parked.zero_rate import first_zero_rate
from infield.session.settings import SessionSettings
from ins.twin_file import default_twin
from ins.units import DEG
from recal.cli.app import app

EARTH_DEG_H = 15.041067
TRUE_LAT_DEG = 48.0
BIAS_DEG_H = np.array([-0.0120, 0.0180, 0.0065])  # at 20 degC
SLOPE_DEG_H_DEGC = np.array([4e-4, -3e-4, 5e-4])
RATE_HZ, MINUTES = 10, 40
WARMED_DEGC = 8.0
SIGMAS = 3.0


def parked_rows(rng, *, heading_deg=40.0, lat_deg=TRUE_LAT_DEG, lean_deg=(0.4, -0.7)):
    """Time (n,), rates [rad/s], specific force (n, 3) and temperature (n,) of a ring-laser unit
    that stands for 40 min while it warms up.
    """
    n = RATE_HZ * 60 * MINUTES
    time_s = np.arange(1, n + 1) / RATE_HZ
    T = 20.0 + WARMED_DEGC * (1.0 - np.exp(-time_s / 1200.0))
    heading, lat = np.radians(heading_deg), np.radians(lat_deg)
    roll, pitch = np.radians(lean_deg)
    about_z = np.array(
        [
            [np.cos(heading), np.sin(heading), 0.0],
            [-np.sin(heading), np.cos(heading), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    about_y = np.array(
        [[np.cos(pitch), 0.0, -np.sin(pitch)], [0.0, 1.0, 0.0], [np.sin(pitch), 0.0, np.cos(pitch)]]
    )
    about_x = np.array(
        [[1.0, 0.0, 0.0], [0.0, np.cos(roll), np.sin(roll)], [0.0, -np.sin(roll), np.cos(roll)]]
    )
    body_of_ned = about_x @ about_y @ about_z
    earth = body_of_ned @ (EARTH_DEG_H * np.array([np.cos(lat), 0.0, -np.sin(lat)]))
    bias = BIAS_DEG_H + SLOPE_DEG_H_DEGC * (T - 20.0)[:, None]
    white = 0.002 * np.sqrt(3600.0 * RATE_HZ) * rng.standard_normal((n, 3))  # 0.002 deg/sqrt(h)
    rates = np.radians(earth + bias + white) / 3600.0
    # Somigliana to 1e-5, 200 m up
    gravity = 9.780327 * (1.0 + 0.0053024 * np.sin(lat) ** 2) - 3.086e-6 * 200.0
    force = body_of_ned @ [0.0, 0.0, -gravity] + 2e-4 * rng.standard_normal((n, 3))
    return time_s, rates, force, T


def write_csv(path, columns):
    names, values = list(columns), np.column_stack(list(columns.values()))
    np.savetxt(path, values, "%.12g", ",", header=",".join(names), comments="")


def write_parquet(path, columns):
    pq.write_table(pa.table(columns), path)


def write_run(folder, site, rng, *, lon_deg=11.5, **how):
    """A run directory whose run.json has this site, as text."""
    folder.mkdir(parents=True)
    time_s, rates, force, T = parked_rows(rng, **how)
    of_axes = {f"gyro_{a}_rad_s": rates[:, k] for k, a in enumerate("xyz")}
    of_axes |= {f"accel_{a}_m_s2": force[:, k] for k, a in enumerate("xyz")}
    write_parquet(folder / "imu.parquet", {"time_s": time_s, **of_axes})
    every = slice(None, None, RATE_HZ)
    of_gyros = {f"gyro_{a}_degC": T[every] for a in "xyz"}
    write_parquet(folder / "temperature.parquet", {"time_s": time_s[every], **of_gyros})
    keys = {
        "schema": "recal.run/1",
        "run_id": folder.name,
        "tail": "",
        "imu_serial": "SN-48",
        "gyro_technology": "rlg",
        "start_utc": "2026-05-01T08:00:00Z",
        "lever_arms_m": {},
        "applied_table_sha256": None,
    }
    text = (
        json.dumps(keys)[:-1] + f', "site": {{{site}, "lon_deg": {lon_deg}, "height_m": 200.0}}}}'
    )
    (folder / "run.json").write_text(text)
    return folder


@pytest.fixture(scope="module")
def look_at(tmp_path_factory):
    """What `recal look` makes of the rows alone, and its table of text."""
    log = tmp_path_factory.mktemp("bare") / "unit.csv"
    time_s, rates, force, _ = parked_rows(np.random.default_rng(5))
    of_axes = {f"dtheta_{a}_rad": rates[:, k] / RATE_HZ for k, a in enumerate("xyz")}
    of_axes |= {f"dv_{a}_m_s": force[:, k] / RATE_HZ for k, a in enumerate("xyz")}
    write_csv(log, {"time_s": time_s, **of_axes})
    return log, recal.look(log)


def table_file(path, sigma_deg_h=0.01):
    nodes = np.array([10.0, 40.0])
    axes = {
        a: {
            "temperature_degC": nodes.tolist(),
            "bias_deg_h": (BIAS_DEG_H[k] + SLOPE_DEG_H_DEGC[k] * (nodes - 20.0)).tolist(),
            "sigma_deg_h": [sigma_deg_h, sigma_deg_h],
        }
        for k, a in enumerate("xyz")
    }
    unit = {"imu_serial": "SN-48", "gyro_technology": "rlg", "created_utc": "2026-04-01T00:00:00Z"}
    table = {"schema": "recal.table/1", **unit, "interpolation": "linear", "axes": axes}
    path.write_text(json.dumps(table))
    return path


def off_and_sigma(result, T=24.0):
    """Error of the table and its sigma (3,) [deg/h] at a temperature."""
    true = BIAS_DEG_H + SLOPE_DEG_H_DEGC * (T - 20.0)
    bias = [result.table.bias_deg_h(axis, T)[0] for axis in range(3)]
    sigma = [result.table.sigma_deg_h(axis, T)[0] for axis in range(3)]
    return np.array(bias) - true, np.array(sigma)


def site_of(sigma_deg):
    return f'"lat_deg": {TRUE_LAT_DEG}, "sigma_lat_deg": {sigma_deg}'


def vertical_deg_h(sigma_lat_deg):
    """What the sigma of the latitude is on the vertical gyro."""
    return EARTH_DEG_H * np.cos(np.radians(TRUE_LAT_DEG)) * np.radians(sigma_lat_deg)


@pytest.mark.parametrize(
    ("typed", "true_deg"), [("48", 47.6), ("47.50", 47.504), ("-33.9", -33.87)]
)
def test_a_new_unit_is_as_sure_of_its_gyros_as_the_digits_of_its_latitude(
    tmp_path, typed, true_deg
):
    run = write_run(
        tmp_path / "run", f'"lat_deg": {typed}', np.random.default_rng(5), lat_deg=true_deg
    )
    result = recal.update(run)
    off, sigma = off_and_sigma(result)
    assert result.verdict == "proposed"
    assert np.all(np.abs(off) < SIGMAS * sigma)


def test_a_guess_has_its_own_sigma_and_is_no_argument(look_at, tmp_path):
    """The guess, pasted, made a table 8 sigma wrong: -0.0288 +- 0.0047 deg/h, true 0.0080."""
    _, looked = look_at
    guess = next(one for one in looked.record.assumed if one.key == "lat_deg")
    assert "LATITUDE" in looked.record.convert and f"{guess.value}" not in looked.record.convert
    assert abs(guess.value - TRUE_LAT_DEG) < SIGMAS * guess.sigma
    site = f'"lat_deg": {guess.value}, "sigma_lat_deg": {guess.sigma}, "lat_source": "guess"'
    result = recal.update(write_run(tmp_path / "run", site, np.random.default_rng(5)))
    off, sigma = off_and_sigma(result)
    assert np.all(np.abs(off) < SIGMAS * sigma)
    assert sigma[2] > 0.05  # the guess tells next to nothing of the vertical gyro


def test_what_a_session_knows_is_less_by_what_the_latitude_is(tmp_path):
    """With a measured variance R, R + (Omega cosL sigma)^2; an exact one changes nothing."""

    def after(sigma_deg, table):
        folder = tmp_path / f"run-{sigma_deg}-{table is None}"
        run = write_run(folder, site_of(sigma_deg), np.random.default_rng(5))
        return recal.update(run, table).axes["z"].sigma_after_deg_h

    table = table_file(tmp_path / "table.json")
    assert after(0.001, table) == pytest.approx(after(1e-6, table), rel=0.02)
    # with a table of 0.1 deg/h the level gyros tell nothing of the latitude
    expected = np.hypot(after(1e-6, None), vertical_deg_h(0.05))
    assert after(0.05, None) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("turned_deg", [0.0, 90.0])
def test_sessions_at_one_place_share_its_error(tmp_path, turned_deg):
    """On one heading, four sessions know the vertical gyro no better than their one latitude; on
    four, the level gyros find the latitude's error, and with it the vertical gyro.
    """
    entered = f'"lat_deg": {TRUE_LAT_DEG + 0.25}, "sigma_lat_deg": 0.2'
    runs = []
    for number in range(4):
        rng = np.random.default_rng(number)
        heading_deg = 40.0 + number * turned_deg
        run = write_run(tmp_path / f"run-{number}", entered, rng, heading_deg=heading_deg)
        text = (run / "run.json").read_text().replace("05-01", f"05-0{number + 1}")
        (run / "run.json").write_text(text)
        runs.append(run)
    off, sigma = off_and_sigma(recal.update(runs))
    before = 0.1  # raw bias of the technology
    # the north gyro, known to that, shows Omega sinL times the latitude's error
    shown_deg = np.degrees(before / (EARTH_DEG_H * np.sin(np.radians(TRUE_LAT_DEG))))
    sigma_lat_deg = 1.0 / np.hypot(1.0 / 0.2, 1.0 / shown_deg)
    one = 1.0 / np.hypot(1.0 / before, 1.0 / vertical_deg_h(sigma_lat_deg))
    assert np.all(np.abs(off) < SIGMAS * sigma)
    if turned_deg:
        assert sigma[2] < 0.2 * one
    else:
        assert 0.98 * one < sigma[2] < 1.1 * one


def test_the_digits_of_run_json_are_read_as_they_are_written(tmp_path):
    cases = {"48": 0.5, "48.0": 0.05, "47.50": 0.005, "47.500000": 0.001, "4.75e1": 0.05}
    for number, (text, sigma_deg) in enumerate(cases.items()):
        folder = tmp_path / f"{number}"
        run = recal.read_run(write_run(folder, f'"lat_deg": {text}', np.random.default_rng(1)))
        assert run.header.site.sigma_lat_rad / DEG == pytest.approx(sigma_deg)


def test_a_receiver_knows_its_latitude(tmp_path):
    run = write_run(tmp_path / "run", '"lat_deg": 48.0', np.random.default_rng(1))
    fix = {"time_s": [1.0, 2.0], "lat_deg": [48.00002] * 2, "lon_deg": [11.5] * 2}
    at_rest = {f"v{axis}_m_s": [0.0, 0.0] for axis in "ned"}
    of_fix = {"height_m": [200.0] * 2, **at_rest, "sigma_horizontal_m": [2.0] * 2}
    write_csv(run / "gnss.csv", {**fix, **of_fix})
    site = recal.read_run(run).header.site
    assert site.lat_source == "receiver"
    assert site.sigma_lat_rad / DEG == pytest.approx(np.hypot(2.0 / 111_320.0, 2e-5), rel=0.01)


@pytest.mark.parametrize(
    ("options", "sigma_deg"),
    [
        (["--lat-deg", "47.5"], 0.05),
        (["--lat-deg", "47.500"], 0.001),
        (["--lat-deg", "47.5", "--sigma-lat-deg", "0.3"], 0.3),
    ],
)
def test_a_converted_log_keeps_the_digits_that_were_typed(
    look_at, tmp_path, monkeypatch, options, sigma_deg
):
    log, _ = look_at
    monkeypatch.chdir(tmp_path)
    unit = ["--serial", "SN-48", "--technology", "rlg", "--start-utc", "2026-05-01T08:00:00Z"]
    place = [*options, "--lon-deg", "11.5", "--height-m", "200"]
    done = CliRunner().invoke(app, ["convert", str(log), "-o", "run", *unit, *place])
    assert done.exit_code == 0, done.output
    site = json.loads((tmp_path / "run" / "run.json").read_text())["site"]
    assert site["sigma_lat_deg"] == pytest.approx(sigma_deg)
    assert site["lat_source"] == "given"


def test_a_unit_that_finds_no_north_carries_it_too(tmp_path):
    """Of Earth rate by latitude (-sinL, 0, -cosL) only the vertical part has a known direction."""
    run = recal.read_run(
        write_run(tmp_path / "run", site_of(1e-6), np.random.default_rng(1), lean_deg=(0.0, 0.0))
    )
    site = replace(run.header.site, sigma_lat_rad=2.0 * DEG)
    wide = replace(run, header=replace(run.header, site=site))
    twin, settings = default_twin("rlg"), SessionSettings()
    found = [first_zero_rate(r, twin, settings)[1].covariance for r in (run, wide)]
    more = np.diag([0.0, 0.0, vertical_deg_h(2.0) ** 2])
    assert found[1] - found[0] == pytest.approx(more, abs=1e-3 * more[2, 2])


@pytest.mark.parametrize(
    ("entered", "lon_deg", "code", "with_table"),
    [
        ("0.8378", 11.5, "latitude_in_radians", True),
        ("11.5", 48.0, "latitude_is_longitude", False),
        ("30.0", 11.5, "wrong_latitude", False),
        pytest.param("30.0", 11.5, "wrong_latitude", True, marks=pytest.mark.slow),
    ],
)
def test_what_was_entered_for_the_latitude_is_named(tmp_path, entered, lon_deg, code, with_table):
    """It was "14 measurements leave the heading at 6.8 deg", or "it moves"."""
    rng = np.random.default_rng(5)
    run = write_run(tmp_path / "run", f'"lat_deg": {entered}', rng, lon_deg=lon_deg)
    table = table_file(tmp_path / "table.json") if with_table else None
    for result in (recal.align(run, table), recal.update(run, table)):
        assert result.verdict in ("refused", "inconsistent")
        assert result.record.reason_codes[0].removeprefix("of_run.") == code


def test_an_update_without_a_table_begins_from_nothing_and_says_so(tmp_path):
    run = write_run(tmp_path / "run", site_of(0.01), np.random.default_rng(5))
    first = repr(recal.update(run)).splitlines()
    assert "from nothing" in first[0] and "0.1 deg/h" in first[0]
    assert f"{vertical_deg_h(0.01):.4f} deg/h" in first[1]
    known = recal.update(run, table_file(tmp_path / "table.json"))
    assert known.record.new_unit is None and "from nothing" not in repr(known)
