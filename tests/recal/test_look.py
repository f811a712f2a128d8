"""`recal look`: any log on one page, with what it can be used for and the commands that do it."""

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import recal
from ins.records import AXES, GnssLog, ImuLog, Survey
from ins.units import DEG_PER_HOUR
from recal.cli.app import app
from recal.service.look.opened import reads_earth_rate
from recal.service.look.records import Fit, Use
from trajectories.runs.directory import write_run
from trajectories.runs.physics_gates import quiet_means

SITE_LATITUDE_DEG = 45.0  # of the packaged scenarios
# of the latitude by gyros: 5 deg/h of bias is 20 deg of it, the simulated unit's 0.01 far less
LATITUDE_TOLERANCE_DEG = 1.0


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """Ten minutes of a parked ring-laser unit, as a run and as a bare table of its rows."""
    folder = tmp_path_factory.mktemp("look")
    scenario = recal.simulate("parked_only", seed=7, rate_hz=10)
    run = scenario.write(folder / "run") and recal.read_run(folder / "run")
    imu = run.imu.between(-np.inf, 600.0)
    names = [f"dtheta_{a}_rad" for a in AXES] + [f"dv_{a}_m_s" for a in AXES]
    rows = np.column_stack([imu.time_s, imu.dtheta_rad, imu.dv_m_s])
    header = ",".join(["time_s", *names])
    np.savetxt(folder / "bare.csv", rows, "%.12g", ",", header=header, comments="")
    moved = rows.copy()
    moved[:, 1:] += np.random.default_rng(1).normal(0.0, 0.05, moved[:, 1:].shape)
    np.savetxt(folder / "shaken.csv", moved, "%.12g", ",", header=header, comments="")
    gap = np.delete(rows, slice(1500, 1600), axis=0)
    np.savetxt(folder / "gap.csv", gap, "%.12g", ",", header=header, comments="")
    return folder


@pytest.fixture(scope="module")
def looked(simulated):
    return recal.look(simulated / "run")


def call(*words):
    done = CliRunner().invoke(app, ["look", *map(str, words)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done


def fits(document):
    return {use["use"]: use["fit"] for use in document["uses"]}


def test_a_parked_run_is_fit_for_all_but_aided_replay(looked):
    assert looked.verdict == "usable"
    assert fits(looked.to_dict()) == {
        "alignment": "yes",
        "noise": "yes",
        "table": "yes",
        "replay": "partly",
        "diagnosis": "yes",
    }
    assert {use.use for use in looked.uses} == set(Use)
    assert all(use.command for use in looked.uses if use.fit is not Fit.NO)


def test_a_rest_too_short_for_an_update_is_fit_for_no_table(simulated):
    """Two minutes were called fit, and `recal update` refused them: it needs 300 s."""
    run = recal.read_run(simulated / "run")
    for seconds, fit in ((120.0, "no"), (420.0, "yes")):
        short = replace(run, imu=run.imu.between(-np.inf, seconds), phases=())
        write_run(simulated / f"short-{seconds:.0f}", short)
        looked = recal.look(simulated / f"short-{seconds:.0f}")
        table = next(use for use in looked.uses if use.use is Use.TABLE)
        assert table.fit == fit, table.why
        assert ("from 5 min or more" in table.why) == (fit == "no")


def test_the_noise_is_the_simulated_one(looked):
    told = {one["name"]: one for one in looked.to_dict()["noise"]}
    found = told["gyro.arw_deg_sqrt_h"]
    assert abs(found["value"] - 0.002) < 5.0 * found["sigma"]
    assert found["unit"] == "deg/sqrt(h)"


def test_what_a_bare_log_does_not_say_is_taken_and_named(simulated, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = call(simulated / "bare.csv", "--json")
    document = json.loads(done.stdout)
    assert done.exit_code == 0
    taken = {one["key"]: one["value"] for one in document["assumed"]}
    assert taken["gyro_technology"] == "fog"  # the gyros show the Earth's rate
    assert abs(taken["lat_deg"] - SITE_LATITUDE_DEG) < LATITUDE_TOLERANCE_DEG
    assert set(taken) == {
        "imu_serial",
        "gyro_technology",
        "start_utc",
        "lat_deg",
        "lon_deg",
        "height_m",
    }
    assert document["start_utc"] is None
    assert fits(document)["table"] == "no"  # no temperatures


def test_the_commands_do_what_they_say(simulated, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    document = json.loads(call(simulated / "bare.csv", "--json").stdout)
    words = shlex.split(document["convert"])
    assert words[0] == "recal"
    # nobody gave the latitude: the command asks for it, and takes no guess for it
    asked = CliRunner().invoke(app, words[1:])
    assert asked.exit_code == 2 and "LATITUDE" in asked.stderr
    words[words.index("LATITUDE")] = f"{SITE_LATITUDE_DEG}"
    assert CliRunner().invoke(app, words[1:]).exit_code == 0
    align = next(use["command"] for use in document["uses"] if use["use"] == "alignment")
    done = CliRunner().invoke(app, shlex.split(align)[1:])
    assert done.exit_code == 0 and "aligned" in done.stdout


def test_of_a_log_with_gaps_the_longest_stretch_is_looked_at(simulated, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = call(simulated / "gap.csv", "--json")
    document = json.loads(done.stdout)
    assert done.exit_code == 0
    assert "longest of 2 stretches" in document["notes"][0]
    assert document["holds"]["imu"]["duration_s"] == pytest.approx(440.0, abs=1.0)
    words = document["convert"].replace("LATITUDE", f"{SITE_LATITUDE_DEG}")
    made = CliRunner().invoke(app, shlex.split(words)[1:])
    assert made.exit_code == 0


def test_what_is_no_log_is_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "poem.txt").write_text("no numbers here\n" * 100)
    done = CliRunner().invoke(app, ["look", "poem.txt"])
    assert "format not recognised" in str(done.exception)
    assert not (tmp_path / "recal-look" / "look.html").exists()


def test_dither_does_not_hide_the_earths_rate():
    """A ring laser whose rows scatter by 200 deg/h in counts of angle, half a minute long: its
    seconds show the Earth; a MEMS unit's, with a bias of 100 deg/h, do not.
    """
    rng = np.random.default_rng(4)
    rows, dt = 64 * 30, 1.0 / 64.0
    angle = 200.0 * DEG_PER_HOUR * dt * rng.standard_normal((rows + 1, 3))
    f = np.tile([0.0, 0.0, -9.8], (rows, 1))
    for bias_deg_h, finds in ((0.0, True), (100.0, False)):
        rate = np.array([7.0, 0.0, -13.0]) * DEG_PER_HOUR + bias_deg_h * DEG_PER_HOUR
        imu = ImuLog(
            time_s=dt * np.arange(1, rows + 1),
            dt_s=np.full(rows, dt),
            dtheta_rad=rate * dt + np.diff(angle, axis=0),
            dv_m_s=f * dt,
        )
        assert reads_earth_rate(imu, quiet_means(imu)) is finds


@pytest.mark.parametrize("speed_m_s, fit", [(0.3, Fit.NO), (3.0, Fit.YES)])
def test_fixes_that_never_move_start_no_replay(simulated, tmp_path, speed_m_s, fit):
    """A MEMS unit on a table: `look` said yes, `replay` refused."""
    run = recal.read_run(simulated / "run")
    rng = np.random.default_rng(3)
    imu = run.imu.between(-np.inf, 100.0)
    turned = imu.dtheta_rad + 0.01 * imu.dt_s[:, None]
    time_s = np.arange(1.0, 99.0)
    v = 0.02 * rng.standard_normal((time_s.size, 3))
    v[:, 0] += speed_m_s * np.sin(0.3 * time_s)
    site = run.header.site
    still = np.ones(time_s.size)
    gnss = GnssLog(
        time_s=time_s,
        lat_rad=site.lat_rad * still,
        lon_rad=site.lon_rad * still,
        height_m=site.height_m * still,
        v_n_m_s=v,
        sigma_velocity_m_s=0.02 * still,
    )
    header = replace(run.header, gyro_technology="mems", survey=Survey())
    made = replace(
        run, header=header, imu=replace(imu, dtheta_rad=turned), gnss=gnss, temperature=None
    )
    write_run(tmp_path / "run", replace(made, odometer=None))
    uses = {use.use: use.fit for use in recal.look(tmp_path / "run").uses}
    assert uses[Use.REPLAY] is fit


def test_a_log_that_is_fit_for_nothing_is_refused(simulated, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = call(simulated / "shaken.csv")
    assert done.exit_code == 4
    assert done.stdout.startswith("shaken: refused\n")
    assert (tmp_path / "recal-look" / "look.html").exists()
