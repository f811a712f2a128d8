"""The parts of an updated table's variance: they add up to it, and each is of its own source."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from infield.session.budget import variance_budget
from infield.session.navigated import noise_shares
from infield.session.pipeline import update_calibration
from infield.session.points import measurement_information
from infield.session.reasons import VarianceSource
from ins.units import DEG
from ins.verdicts import Outcome
from tests.infield import mems_sessions
from tests.infield.sessions import TWIN, factory, simulated

ROUNDING = 1e-9  # of a variance, of sums of some ten matrix products
# of a part: two-sided differences of step 0.1 are off by its square over 6
DIFFERENCES = 5e-3


@lru_cache(maxsize=1)
def two_runs():
    """Two runs a month apart, one after the other, on a table that ages between them."""
    runs = [simulated(1).run, simulated(2, start_utc="2026-04-01T05:00:00Z").run]
    return update_calibration(runs, factory(), TWIN)


def added_up(budget):
    return np.asarray(sum(budget.parts.values()))


def test_the_parts_of_two_sessions_add_up_to_the_merged_covariance():
    result = two_runs()
    assert len(result.merged_runs) == 2
    budget = variance_budget(result)
    P = result.after.covariance
    assert np.abs(added_up(budget) - P).max() < ROUNDING * np.diag(P).max()


def test_every_part_is_a_covariance():
    """No part takes away: its smallest eigenvalue is not below what the differences cost."""
    budget = variance_budget(two_runs())
    whole = np.diag(budget.table.covariance).max()
    for source, part in budget.parts.items():
        assert np.linalg.eigvalsh(part)[0] > -DIFFERENCES * whole, source


def test_shares_of_every_node_add_up_to_one():
    budget = variance_budget(two_runs())
    for k in range(budget.table.n_parameters):
        shares = budget.shares(np.eye(budget.table.n_parameters)[k])
        assert sum(shares.values()) == pytest.approx(1.0, abs=ROUNDING)


@pytest.mark.parametrize("sigma_lat_deg", [0.001, 0.05])
def test_named_noise_makes_up_what_a_session_measures(sigma_lat_deg):
    """The parts by derivative against the information itself: nothing much is left without a name,
    and nothing is counted twice.
    """
    header = two_runs().sessions[0].run.header
    site = replace(header.site, sigma_lat_rad=sigma_lat_deg * DEG)
    run = replace(two_runs().sessions[0].run, header=replace(header, site=site))
    estimate = update_calibration([run], factory(), TWIN).sessions[0].estimate
    information, _ = measurement_information(estimate.bins, estimate)
    mean = np.zeros(len(information))
    mean[0::3] = 3.0 / len(mean)
    P1 = estimate.covariance
    named, whole = (mean @ P1 @ N @ P1 @ mean for N in (sum(estimate.shares.values()), information))
    assert set(estimate.shares) == {*noise_shares.SCALED, VarianceSource.LATITUDE}
    assert 0.9 < named / whole < 1.0 + DIFFERENCES


def test_a_unit_without_a_heading_owes_its_level_to_turn_on_and_earth_rate():
    run = mems_sessions.session(1).run
    result = update_calibration([run], mems_sessions.blank(), mems_sessions.TWIN)
    budget = variance_budget(result)
    P = result.after.covariance
    assert np.abs(added_up(budget) - P).max() < ROUNDING * np.diag(P).max()
    assert budget.parts[VarianceSource.EARTH_RATE].max() > 0.0


def test_a_refused_update_has_no_budget():
    assert variance_budget(replace(two_runs(), outcome=Outcome.REFUSED)) is None
