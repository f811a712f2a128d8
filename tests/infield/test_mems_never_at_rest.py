"""Units without a heading whose log begins in motion and never stands: one way, taken with its
sigmas or refused.
"""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from infield.reports.documents import parked as parked_document
from infield.session.reasons import FlightReason, ParkedReason
from ins.verdicts import Outcome
from tests.cut import cut_run
from tests.infield import mems_away
from tests.infield.mems_away import SETTINGS, bin_errors, simulated
from tests.infield.test_flown_mems import led_astray

# 15 s after it begins to roll, to the end: no second of it stands
ROLLS_S = mems_away.PARKED_S + 15.0
CHANCE = 5e-4  # two-sided: 1 in 1000 of right sigmas


def rolling(run):
    """A run that begins in motion."""
    return cut_run(run, ROLLS_S, run.imu.end_s)


@lru_cache(maxsize=2)
def taken(seed):
    return mems_away.taken(rolling(simulated(seed).run))


def mean_of(seed):
    """Error of the means over a session, gyros x, y, z, and their covariance [deg/h]."""
    estimate = taken(seed).estimate
    rows = np.kron(estimate.bins.duration_s / estimate.bins.duration_s.sum(), np.eye(3))
    error = bin_errors(simulated(seed), estimate).ravel()
    return rows @ error, rows @ estimate.covariance @ rows.T


def test_a_log_that_never_stands_is_taken_with_right_sigmas():
    error, P = mean_of(0)
    low, high = chi2.ppf([CHANCE, 1.0 - CHANCE], error.size)
    assert low < error @ np.linalg.solve(P, error) < high
    # the blank table's 30 deg/h and a turn-on of as much
    assert np.sqrt(np.diag(P)).max() < 0.2 * 42.0


def test_what_gyros_may_read_under_way_alone_stays_in_the_sigmas():
    """Nothing stood: the session cannot tell it from the table's own error."""
    shift = SETTINGS.flight.shift_deg_h["mems"]
    assert np.sqrt(np.diag(mean_of(0)[1])).min() > shift
    assert not taken(0).flight.notes
    terms = parked_document.budget_terms(taken(0), SimpleNamespace(twin=mems_away.TWIN))
    told = [of_axis["what a gyro reads under way against at rest"] for of_axis in terms]
    assert np.array(told) == pytest.approx(shift, rel=1e-3)


@pytest.mark.slow
def test_a_receiver_led_astray_leaves_nothing():
    made = simulated(0)
    result = mems_away.taken(rolling(replace(made.run, gnss=led_astray(made.run.gnss))))
    assert result.verdict.outcome is Outcome.REFUSED and result.flight.joined is None
    codes = [reason.code for reason in result.verdict.reasons]
    assert codes[0] is ParkedReason.NO_REST
    assert any(isinstance(code, FlightReason) for code in codes[1:])
