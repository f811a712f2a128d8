"""The smoothed aided solution: over seeds, with a minute without fixes."""

from dataclasses import replace

import numpy as np
import pytest

from infield.aided.flight import aided_noise
from ins.filters.aided_filter import first_about, solved
from ins.filters.aided_records import AidedOptions, AidedStart
from ins.filters.aided_tape import Task
from ins.filters.states import AIDED_ACCEL, AIDED_GYRO
from ins.robust import chi2
from tests.infield.aided_cases import errors, flown, ideal, nees, twin_of
from tests.ins.test_aided_filter import ANTENNA, fixes_from, prior, truth_at

HOLE_S = 300.0, 360.0


def flight(technology: str, seed: int):
    """A simulated flight without fixes in HOLE_S, filtered and smoothed, where the start is off as
    it says.
    """
    twin = twin_of(technology, flicker=False)
    made, sigma = flown(ideal(), twin, seed, technology), prior(twin)
    error = sigma * np.random.default_rng([seed, 9]).standard_normal(15)
    error[AIDED_GYRO] = error[AIDED_ACCEL] = 0.0  # the turn-on of the unit is that error
    start = AidedStart(
        state=truth_at(made, error=error),
        gyro_bias_rad_s=np.zeros(3),
        accel_bias_m_s2=np.zeros(3),
        covariance=np.diag(sigma**2),
    )
    fixes = fixes_from(made, twin)
    hole = (fixes.time_s > HOLE_S[0]) & (fixes.time_s < HOLE_S[1])
    gone = np.where(hole[:, None], np.nan, 0.0)
    task = Task(
        start=start,
        noise=aided_noise(twin, technology),
        fixes=replace(fixes, r_e_m=fixes.r_e_m + gone, v_n_m_s=fixes.v_n_m_s + gone),
        antenna=ANTENNA,
        options=AidedOptions(),
    )
    about = first_about(made.run.imu, task)
    return made, solved(about, task), solved(about, task, smooth=True)


@pytest.mark.parametrize("technology", ["mems", "rlg"])
@pytest.mark.parametrize("flights", [6, pytest.param(60, marks=pytest.mark.slow)])
def test_smoothed_errors_are_those_of_the_sigmas(technology, flights):
    """NEES of all 15 states at the start, before, within and after a minute without fixes: 99.9 %
    band. No sigma is wider than the filter's, and level errors in that minute are a tenth of the
    filter's at most (MEMS).
    """
    at, found, level = [5, 150, 290, 330, 480], [], []
    for seed in range(flights):
        made, history, best = flight(technology, seed)
        found.append(nees(made, best)[at])
        assert (best.variance <= history.variance * (1.0 + 1e-6)).all()
        hole = (history.time_s > HOLE_S[0]) & (history.time_s < HOLE_S[1])
        level.append([np.mean(errors(made, h)[hole, :2] ** 2) for h in (history, best)])
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 15 * flights) / (15 * flights)
    assert low < np.mean(found) < high
    was, now = np.sqrt(np.mean(level, axis=0))
    assert now < (0.1 if technology == "mems" else 0.6) * was
