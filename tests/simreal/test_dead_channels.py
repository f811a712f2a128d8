"""A sensor that says nothing: the others are diagnosed as before, and its own effects are listed as
not testable.
"""

from dataclasses import replace

import numpy as np
import pytest

from infield.table.file import table_from_dict
from ins.attitude import euler_from_dcm
from ins.errors.catalogue import catalogue
from ins.records import ImuLog, InputError, Run
from ins.units import DEG
from simreal.evidence.dead_channels import dead_columns
from simreal.evidence.run_view import RunView, view_run
from simreal.inference.diagnosis import DiagnosisSettings, diagnose
from tests.simreal import diagnosed
from tests.simreal.runs import simulated, table, twin_of
from trajectories.runs.directory import read_run, write_run

NAMES = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]


def without(run: Run, *names: str, value: float = np.nan) -> Run:
    both = np.hstack([run.imu.whole().dtheta_rad, run.imu.whole().dv_m_s])
    both[:, [NAMES.index(name) for name in names]] = value
    log = run.imu.whole()
    imu = ImuLog(
        time_s=log.time_s,
        dt_s=log.dt_s,
        dtheta_rad=both[:, :3].copy(),
        dv_m_s=both[:, 3:].copy(),
        source=log.source,
    )
    return replace(run, imu=imu)


def viewed(run: Run) -> RunView | str:
    return view_run(run, 0, table(), twin_of())


@pytest.fixture(scope="module")
def parked_run():
    return simulated().run


@pytest.mark.parametrize("value", [np.nan, 0.0])
@pytest.mark.parametrize("name", NAMES)
def test_attitude_comes_from_the_sensors_that_are_left(parked_run, name, value):
    run = without(parked_run, name, value=value)
    assert [n for n, gone in zip(NAMES, dead_columns(run.imu)) if gone] == [name]
    view = viewed(run)
    assert isinstance(view, RunView) and view.history is None
    assert list(view.seconds.dead) == [n == name for n in NAMES]
    assert any(name in note and "left out" in note for note in view.notes)
    roll, pitch, heading = np.array(euler_from_dcm(view.C_nb)) / DEG
    whole = viewed(parked_run)
    seen = np.array(euler_from_dcm(whole.C_nb)) / DEG
    # a dead level gyro cannot tell a heading from its mirror image
    headings = [seen[2], 180.0 - seen[2], -seen[2]]
    assert min(abs((heading - h + 180.0) % 360.0 - 180.0) for h in headings) < 1.0
    assert abs(roll - seen[0]) < (0.02 if name != "accel_y" else 1.0)
    assert abs(pitch - seen[1]) < (0.02 if name != "accel_x" else 1.5)


def test_too_few_sensors_are_told_in_words(parked_run):
    said = viewed(without(parked_run, "accel_x", "accel_y"))
    assert isinstance(said, str) and "accel_x, accel_y" in said and "two accelerometers" in said
    said = viewed(without(parked_run, "gyro_x", "gyro_y"))
    assert isinstance(said, str) and "survey" in said


def test_a_survey_stands_in_for_two_gyros(parked_run):
    survey = replace(parked_run.header.survey, heading_rad=37.0 * DEG, sigma_heading_rad=1e-3)
    run = replace(parked_run, header=replace(parked_run.header, survey=survey))
    view = viewed(without(run, "gyro_x", "gyro_y"))
    assert isinstance(view, RunView)
    assert euler_from_dcm(view.C_nb)[2] / DEG == pytest.approx(37.0, abs=0.2)


def test_the_effect_is_found_without_the_dead_sensor_and_its_own_effects_are_not_testable():
    made = diagnosed.trial("gyro_thermal_rate", 14.0)
    target = made.truth[0].target
    dead = next(n for n in ("gyro_z", "gyro_y", "gyro_x") if n != target)
    effects = tuple(e for e in catalogue() if e.name in diagnosed.NAMES)
    runs = [without(run, dead) for run in made.runs]
    settings = DiagnosisSettings(effects=effects, replicates=100)
    found = diagnose(runs, made.twin, table_from_dict(made.table, name="t"), settings)
    assert found.causes and found.causes[0].target == target
    assert found.causes[0].effect in ("gyro_thermal_rate", "gyro_thermal_lag")
    lost = {(one.effect, one.target) for one in found.not_testable}
    assert ("gyro_thermal_rate", dead) in lost and ("gyro_turn_on_bias", dead) in lost
    assert not any(c.target == dead for c in found.causes)


def test_only_diagnose_reads_a_run_with_a_silent_column(tmp_path, parked_run):
    path = tmp_path / "run"
    write_run(path, without(parked_run, "gyro_y"))
    with pytest.raises(InputError, match="dtheta_y_rad"):
        read_run(path)
    run = read_run(path, dead_columns=True)
    assert np.isnan(run.imu.whole().dtheta_rad[:, 1]).all()
    assert np.isfinite(run.imu.whole().dtheta_rad[:, 0]).all()


def test_a_column_with_holes_is_still_refused(tmp_path, parked_run):
    run = without(parked_run, "gyro_y")
    log = run.imu.whole()
    some = log.dtheta_rad.copy()
    some[5, 1] = 1e-6
    write_run(tmp_path / "run", replace(run, imu=replace(log, dtheta_rad=some)))
    with pytest.raises(InputError, match="dtheta_y_rad"):
        read_run(tmp_path / "run", dead_columns=True)
