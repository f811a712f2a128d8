"""Trials: same seed same trial, linear in size, what each plan may plant, and their files."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gap_trials import runs
from benchmarks.gap_trials.effects import EFFECTS
from benchmarks.gap_trials.trial import draw_noise_trial, draw_trial
from benchmarks.gap_trials.written import write_trial
from infield.table.file import table_from_dict
from ins.records import InputError
from ins.twin_file import read_twin
from tests.gap_trials.cases import SHORT_S, change, planted
from trajectories.runs.directory import read_run


def test_the_same_seed_makes_the_same_trial():
    first, again, other = (draw_trial(seed, parked_s=SHORT_S) for seed in (3, 3, 4))
    assert [r.sha256 for r in first.runs] == [r.sha256 for r in again.runs]
    assert first.truth == again.truth
    assert {r.sha256 for r in first.runs_without}.isdisjoint(r.sha256 for r in other.runs_without)


def test_noise_does_not_depend_on_the_effect():
    """Runs without are the same whatever is planted."""
    a, b = (
        draw_trial(5, names=[name], parked_s=SHORT_S)
        for name in ("gyro_rate_ramp", "platform_sway")
    )
    assert [r.sha256 for r in a.runs_without] == [r.sha256 for r in b.runs_without]
    assert a.truth[0].effect == "gyro_rate_ramp" and b.truth[0].effect == "platform_sway"


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.linear])
def test_effects_are_linear_in_their_size(short, name):
    effect = EFFECTS[name]
    parameters = effect.draw(np.random.default_rng(2), short.seen)
    number = parameters.get("run", 0)
    one, three = (
        change(short, number, planted(name, effect.targets[0], size, **parameters))
        for size in (1.0, 3.0)
    )
    touched = False
    for a, b in zip(one[:2], three[:2]):
        # atol: the rounding of 9.8 m/s^2 in rows, in micro-g
        np.testing.assert_allclose(b, 3 * a, rtol=1e-6, atol=1e-4)
        touched |= bool(np.abs(a).max() > 0)
    plain = short.runs_without[number]
    speeds = [run.odometer.speed_m_s - plain.odometer.speed_m_s for run in (one[2], three[2])]
    latitudes = [run.header.site.lat_rad - plain.header.site.lat_rad for run in (one[2], three[2])]
    np.testing.assert_allclose(speeds[1], 3 * speeds[0], atol=1e-12)
    assert latitudes[1] == pytest.approx(3 * latitudes[0], abs=1e-12)
    assert touched or np.any(speeds[0]) or latitudes[0]


@pytest.mark.parametrize("name", list(EFFECTS))
def test_size_zero_is_the_run_without(short, name):
    effect = EFFECTS[name]
    parameters = effect.draw(np.random.default_rng(2), short.seen)
    number = parameters.get("run", 0)
    _, _, run = change(short, number, planted(name, effect.targets[0], 0.0, **parameters))
    plain = short.runs_without[number]
    assert np.array_equal(run.imu.dtheta_rad, plain.imu.dtheta_rad)
    np.testing.assert_allclose(run.imu.dv_m_s, plain.imu.dv_m_s, atol=1e-15)
    assert np.array_equal(run.odometer.speed_m_s, plain.odometer.speed_m_s)
    np.testing.assert_allclose(run.gnss.v_n_m_s, plain.gnss.v_n_m_s, atol=1e-12)
    assert np.array_equal(run.temperature.gyro_degC, plain.temperature.gyro_degC)


def test_with_sizes_keeps_noise_and_draws():
    trial = draw_trial(21, names=["gyro_thermal_linear"], parked_s=SHORT_S)
    double = trial.with_sizes([2.0])
    axis = "xyz".index(trial.truth[0].target[-1])
    once, twice = (
        t.runs[0].imu.dtheta_rad - t.runs_without[0].imu.dtheta_rad for t in (trial, double)
    )
    np.testing.assert_allclose(twice, 2 * once, atol=1e-16)
    assert np.abs(once[:, axis]).max() > 0
    assert double.truth[0].parameters == trial.truth[0].parameters
    with pytest.raises(InputError, match="2 sizes, needed 1"):
        trial.with_sizes([1.0, 2.0])


@pytest.mark.parametrize("which_seed", range(3))
def test_noise_that_is_five_percent_off(which_seed):
    trial = draw_noise_trial(which_seed, plan="one_cold", parked_s=SHORT_S)
    truth = trial.truth[0].parameters
    # no sway, no yaw creep there
    key, axis = ("dv_m_s", 2) if truth["which"] == "accel" else ("dtheta_rad", 0)
    spread = [
        np.std(np.diff(getattr(r[0].imu, key)[:2900, axis]))
        for r in (trial.runs, trial.runs_without)
    ]
    assert spread[0] / spread[1] == pytest.approx(truth["factor"], rel=2e-3)
    with pytest.raises(InputError, match="no size"):
        trial.with_sizes([2.0])


def test_two_effects_hit_different_targets():
    for seed in range(4):
        a, b = draw_trial(seed, effects=2, parked_s=SHORT_S).truth
        assert a.target != b.target


def test_plans_plant_only_what_they_can_show():
    rng_names = {
        draw_trial(seed, plan="one_cold", parked_s=60.0).truth[0].effect for seed in range(25)
    }
    assert len(rng_names) > 8
    assert all(not EFFECTS[name].needs & {"taxi", "runs"} for name in rng_names)
    with pytest.raises(InputError, match="no effect left"):
        draw_trial(0, plan="one_cold", names=["lever_arm"], parked_s=60.0)


def test_files_of_a_trial_read_back(tmp_path):
    trial = draw_trial(2, plan="one_cold", names=["gyro_warmup_transient"], parked_s=60.0)
    write_trial(trial, tmp_path / "t")
    run = read_run(tmp_path / "t/blind/run-1")
    assert np.array_equal(run.imu.dtheta_rad, trial.runs[0].imu.dtheta_rad)
    assert np.array_equal(run.temperature.gyro_degC, trial.runs[0].temperature.gyro_degC)
    assert read_twin(tmp_path / "t/blind/twin.json").gyro == trial.twin.gyro
    table_from_dict(json.loads((tmp_path / "t/blind/table.json").read_text()), name="table.json")
    truth = json.loads((tmp_path / "t/truth.json").read_text())
    assert truth["planted"][0]["effect"] == "gyro_warmup_transient"
    blind = "".join(p.read_text() for p in (tmp_path / "t/blind").rglob("*.json"))
    assert "warmup" not in blind


def test_trials_never_import_the_diagnosis():
    for path in Path(runs.__file__).parent.glob("*.py"):
        assert not re.search(r"^\s*(from|import)\s+simreal", path.read_text(), re.MULTILINE), (
            path.name
        )
