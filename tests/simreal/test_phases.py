"""The parked stretch and what follows it are asked apart, and what was found is judged again.

The errors laid over the runs are of other forms than the catalogue's: a square wave while the
vehicle rolls, gusts of three modes, a latitude half a degree off.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest

from benchmarks.gap_trials.seen import run_of, streams_of
from benchmarks.gap_trials.trial import Trial, draw_trial
from infield.table.file import table_from_dict
from ins.errors.catalogue import catalogue
from ins.errors.unnamed import WHILE_MOVING
from ins.units import DEG, DEG_PER_HOUR
from simreal.declared.generic import generic_functions
from simreal.evidence.run_view import RunView, view_run
from simreal.inference.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from simreal.inference.phases import phases_contradict
from tests.simreal.diagnosed import NAMES

ROLLS_M_S, PERIOD_S = 3.0, 107.0
RIVALS = (*NAMES, "gyro_magnetic_sensitivity", "axis_or_unit_error", "odometer_quantization")


@lru_cache(maxsize=4)
def clean(seed: int, with_gnss: bool = False) -> Trial:
    return draw_trial(seed, effects=0, plan="four", parked_s=600.0, with_gnss=with_gnss)


def diagnosed(trial: Trial, runs, effects=RIVALS) -> Diagnosis:
    chosen = tuple(e for e in catalogue() if e.name in effects)
    table = table_from_dict(trial.table, name="trial")
    settings = DiagnosisSettings(effects=chosen, replicates=80)
    return diagnose(runs, trial.twin, table, settings)


def on_the_move(trial: Trial, axis: int, rate_deg_h: float):
    """The runs with a square wave on a gyro while they roll."""
    runs = []
    for run, seen in zip(trial.runs_without, trial.seen):
        high = seen.time_s % PERIOD_S < 0.5 * PERIOD_S
        wave = np.where(high, 1.0, -1.0) * (seen.speed_m_s > ROLLS_M_S)
        streams = streams_of(run)
        dtheta = streams.dtheta_rad.copy()
        dtheta[:, axis] += rate_deg_h * DEG_PER_HOUR * wave * seen.dt_s
        runs.append(run_of(run, replace(streams, dtheta_rad=dtheta)))
    return runs


@lru_cache(maxsize=1)
def rolling() -> Diagnosis:
    trial = clean(501)
    return diagnosed(trial, on_the_move(trial, 0, 3.0))


def test_an_error_of_the_drive_is_named_as_one_and_nothing_else():
    found = rolling()
    assert [(c.effect, c.target, c.named) for c in found.causes] == [
        (WHILE_MOVING, "gyro_x", False)
    ]
    assert found.causes[0].probability > 0.9


def test_a_parked_phase_that_is_clean_is_no_place_of_the_gap():
    found = rolling()
    assert found.where
    assert {p.phase for p in found.where} == {"taxi"}
    assert found.where[0].channel == "gyro_x"


def test_free_functions_of_the_drive_add_nothing_while_parked():
    trial = clean(501)
    view = view_run(trial.runs[0], 0, table_from_dict(trial.table, name="trial"), trial.twin)
    assert isinstance(view, RunView)
    run = view.telemetry
    functions = [g for g in generic_functions([run]) if g.name == WHILE_MOVING]
    assert {g.target for g in functions} >= {"gyro_x", "accel_z"}
    for function in functions:
        columns = function.hats(run)
        assert np.any(columns[~run.parked])
        assert not np.any(columns[run.parked])


@dataclass
class Columns:
    """What `phases_contradict` asks of a bank and of an evidence."""

    A: np.ndarray
    z: np.ndarray
    followed: np.ndarray

    @property
    def gram(self):
        return self.A.T @ self.A

    @property
    def score(self):
        return self.A.T @ self.z

    def signature(self, columns, coefficients):
        return self.A[:, columns] @ coefficients


@pytest.mark.parametrize("factor,contradict", [(1.0, False), (1.05, False), (-1.0, True)])
def test_phases_contradict_where_they_want_other_coefficients(factor, contradict):
    rng = np.random.default_rng(0)
    A = rng.standard_normal((400, 2))
    followed = np.arange(400) >= 200
    truth = np.where(followed, factor, 1.0)
    z = 3.0 * A[:, 0] * truth + rng.standard_normal(400)
    seen = Columns(A, z, followed)
    assert phases_contradict(seen, seen, np.arange(2)) is contradict
    assert not phases_contradict(seen, seen, np.zeros(0, int))


@pytest.mark.slow
def test_a_latitude_half_a_degree_off_leaves_nothing_for_others():
    trial = clean(511, with_gnss=True)
    runs = [
        replace(r, header=replace(r.header, site=replace(r.header.site, lat_rad=45.5 * DEG)))
        for r in trial.runs_without
    ]
    found = diagnosed(trial, runs, (*RIVALS, "site_latitude_error", "odometer_scale"))
    assert [c.effect for c in found.causes] == ["site_latitude_error"]
    assert found.causes[0].parameters["coefficient"].value == pytest.approx(30.0, abs=0.01)
    assert not found.unexplained.present


def gusty(trial: Trial, rms_m_s: float):
    """The runs with gusts that shake three modes of the vehicle, parked and on the move."""
    runs, rng = [], np.random.default_rng(77)
    for run, seen in zip(trial.runs_without, trial.seen):
        f = np.fft.rfftfreq(seen.rows, seen.dt_s)
        modes = ((0.28, 0.03, 1.0), (0.55, 0.06, 0.5), (1.1, 0.15, 0.3))
        spectrum = sum(a * np.exp(-0.5 * ((f - f0) / w) ** 2) for f0, w, a in modes)
        v = np.zeros((seen.rows, 3))
        for k in range(2):
            z = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
            raw = np.fft.irfft(z * np.sqrt(spectrum), seen.rows)
            v[:, k] = raw * rms_m_s / np.sqrt(2.0) / raw.std()
        dv = np.einsum("nij,ni->nj", seen.C_nb, np.diff(v, axis=0, prepend=v[:1]))
        streams = streams_of(run)
        runs.append(run_of(run, replace(streams, dv_m_s=streams.dv_m_s + dv)))
    return runs


@pytest.mark.slow
def test_a_swaying_vehicle_has_no_companions():
    trial = clean(510, with_gnss=True)
    others = ("platform_sway", "platform_step", "engine_start", "accel_noise")
    found = diagnosed(trial, gusty(trial, 0.03), (*RIVALS, *others))
    named = {c.effect for c in found.causes if c.named}
    assert "platform_sway" in named
    assert named <= {"platform_sway", "accel_noise"}
