"""The real ArduPilot logs of ../shared/data through `recal convert`, `check` and `align`: their
axes, places and rest.
"""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from alignment import gyrocompass
from ins.earth import gravity_magnitude
from ins.records import InputError
from ins.twin_file import default_twin
from ins.units import DEG, DEG_PER_HOUR
from recal.cli.logs import convert as command
from tests.recal.verbs import align, check
from trajectories.readers.conversion import convert_log
from trajectories.runs.directory import read_run

DATA = Path(__file__).parents[3] / "shared" / "data"
COPTER, PLANE = DATA / "ardupilot_log171.bin", DATA / "apm_fixedwing_TestLog2.mat"
pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="../shared/data is not beside the project"
)

app = typer.Typer()
app.command()(command)


@pytest.fixture(scope="module")
def plane():
    return convert_log(PLANE, {}, {}).run


@pytest.fixture(scope="module")
def copters():
    return {k: convert_log(COPTER, {"imu": k, "to_s": 73.0}, {}) for k in (1, 2, 3)}


def means(run, start_s, end_s):
    """Mean rate [deg/h] and specific force [m/s^2]."""
    part = run.imu.between(start_s, end_s)
    span = part.dt_s.sum()
    return part.dtheta_rad.sum(axis=0) / span / DEG_PER_HOUR, part.dv_m_s.sum(axis=0) / span


def test_gravity_is_down(plane, copters):
    """At rest f_z is -g within what an uncalibrated MEMS triad is off."""
    for run, tolerance in (
        (plane, 0.3),
        (copters[1].run, 0.3),
        (copters[2].run, 0.5),
        (copters[3].run, 0.75),
    ):
        f = means(run, 1.5, 5.0)[1]
        site = run.header.site
        assert f[2] == pytest.approx(
            -float(gravity_magnitude(site.lat_rad, site.height_m)), abs=tolerance
        )
        assert np.hypot(f[0], f[1]) < 1.0


def test_the_planes_axes_agree_with_its_gps(plane):
    """Take-off: forward force with a rise of speed; in flight, right turns have gyro z > 0 and a
    course that grows.
    """
    gnss = plane.gnss
    course = np.unwrap(np.arctan2(gnss.v_n_m_s[:, 1], gnss.v_n_m_s[:, 0]))
    speed = np.hypot(gnss.v_n_m_s[:, 0], gnss.v_n_m_s[:, 1])
    edges = np.arange(300.0, 560.0, 2.0)
    turned = np.interp(edges[1:], gnss.time_s, course) - np.interp(edges[:-1], gnss.time_s, course)
    gyro = np.array([plane.imu.between(a, b).dtheta_rad.sum(axis=0)[2] for a, b in pairwise(edges)])
    flying = np.interp(edges[1:], gnss.time_s, speed) > 8.0
    assert flying.sum() > 80
    assert np.corrcoef(turned[flying], gyro[flying])[0, 1] > 0.8
    down = -np.gradient(gnss.height_m, gnss.time_s)
    rows = (gnss.time_s > 260) & (gnss.time_s < 570)
    assert np.corrcoef(down[rows], gnss.v_n_m_s[rows, 2])[0, 1] > 0.5  # VZ is positive down


def test_place_and_time(plane, copters):
    """Melbourne on 2013-11-29 and Canberra on 2015-11-21, by hand from week and ms."""
    assert plane.header.site.lat_rad / DEG == pytest.approx(-37.9597, abs=1e-3)
    assert plane.header.site.lon_rad / DEG == pytest.approx(144.7648, abs=1e-3)
    # week 1768, 511 216.7 s: day 5, 22:00:16.7, 16 leap s
    assert plane.header.start_utc.startswith("2013-11-29T22:00:0")
    assert copters[3].run.header.site.lat_rad / DEG == pytest.approx(-35.363, abs=1e-2)
    assert copters[3].run.header.start_utc.startswith("2015-11-21T23:4")
    assert copters[3].run.header.imu_serial == "PX4v2-004A002F3334511932383433-imu3"


def test_what_is_wrong_with_the_copters_log_is_named(copters):
    notes = copters[3].record.notes
    with pytest.raises(InputError, match=r"gap of 2\.022 s .* --from-s 74\.628"):
        convert_log(COPTER, {"imu": 3}, {})
    assert any("8898 rows" in n for n in notes)
    assert any("rows 1-161" in n for n in notes)
    later = convert_log(COPTER, {"imu": 3, "from_s": 74.0}, {})
    assert later.run.imu.end_s > 170 and later.run.imu.rows == 8898


def test_parked_gyros_warm_up_as_the_note_beside_the_data_says(plane, copters):
    """README of the data: x 100 to 623 deg/h in 160 s; IMU 3 from 29.3 to 32.2 degC at rest (log
    time 38 to 71 s).
    """
    early, late = means(plane, 0.0, 15.0)[0], means(plane, 150.0, 175.0)[0]
    np.testing.assert_allclose(early, [100, 166, 27], atol=80)
    np.testing.assert_allclose(late, [623, 911, 481], atol=80)
    copter, shift_s = copters[3].run, copters[3].record.time_shift_s
    early, late = (means(copter, a - shift_s, b - shift_s)[0] for a, b in ((38, 45), (64, 71)))
    np.testing.assert_allclose(early, [-279, 330, 83], atol=60)
    np.testing.assert_allclose(late, [-372, 762, -40], atol=60)
    T = copter.temperature
    assert np.interp([38 - shift_s, 71 - shift_s], T.time_s, T.gyro_degC[:, 0]) == pytest.approx(
        [29.3, 32.2], abs=0.3
    )
    assert plane.temperature is None


@pytest.mark.parametrize(
    ("log", "args", "rows"), [(COPTER, ("--imu", "3", "--to-s", "73"), 3018), (PLANE, (), 30650)]
)
def test_from_log_to_check_and_align(tmp_path, log, args, rows):
    """MEMS units: the run is usable, with a warning of its bias; half a minute of rest gives its
    level, heading is refused with the reason.
    """
    said = CliRunner().invoke(app, [str(log), "-o", str(tmp_path / "run"), *args])
    assert said.exit_code == 0, said.stderr
    assert f"{rows} rows, 50 Hz" in said.stdout
    assert check(tmp_path / "run")["verdict"] == "warnings"
    found = read_run(tmp_path / "run").sha256
    assert found == convert_log(log, {"imu": 3, "to_s": 73.0} if args else {}, {}).run.sha256
    document = align(
        tmp_path / "run", store_url=f"sqlite:///{tmp_path}/none.db", output=tmp_path / "align"
    )
    assert document["verdict"] == "level_only"
    assert document["reason_codes"][0] == "no_heading"
    found = json.loads((tmp_path / "align" / "alignment.json").read_text())["schema"]
    assert found == "recal.alignment/1"


def test_level_of_the_parked_plane_is_that_of_its_autopilot(plane):
    """The log's own ATT at log time 173.2 s (run time 160 s): roll 0.71, pitch 4.51 deg."""
    result = gyrocompass.align(plane.imu, plane.header.site, default_twin("mems"))
    assert result.time_s == pytest.approx(160.0, abs=0.1)
    assert result.roll_rad / DEG == pytest.approx(0.71, abs=2 * result.sigma_roll_rad / DEG)
    assert result.pitch_rad / DEG == pytest.approx(4.51, abs=2 * result.sigma_pitch_rad / DEG)
    assert result.sigma_roll_rad < 0.5 * DEG
    assert [p.phase for p in result.phases] == ["alignment"]
