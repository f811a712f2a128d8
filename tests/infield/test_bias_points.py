"""Points of a session: its own information, free of the stored table, and the verdict on each
gyro.
"""

from dataclasses import replace

import numpy as np
import pytest

from infield.session.bins import make_bins
from infield.session.points import (
    mean_rows,
    measurement_information,
    observability,
    session_evidence,
    session_points,
)
from infield.thermometer.gyro_temperature import gyro_temperature
from tests.infield.sessions import (
    PARKED,
    SETTINGS,
    TWIN,
    estimate,
    estimate_of,
    factory,
    shifted,
    simulated,
    true_bias,
)
from tests.scenarios.study import prior_table


def test_information_by_hand():
    """One bin, prior 1, posterior 1/5 with mean 0.8: information 4, vector 4 (a reading of 1 with
    variance 1/4).
    """
    e = estimate(1)
    bins = replace(e.bins, prior=np.eye(3))
    one = replace(
        e, bins=bins, covariance=np.diag([0.2, 1.0, 1.0]), mean_deg_h=np.array([0.8, 0.0, 0.0])
    )
    information, vector = measurement_information(bins, one)
    assert information == pytest.approx(np.diag([4.0, 0.0, 0.0]), abs=1e-9)
    assert vector == pytest.approx([4.0, 0.0, 0.0], abs=1e-9)


def test_prior_and_points_together_are_the_posterior():
    e = estimate(1)
    p = session_points(simulated(1).run, e)
    joint = np.linalg.inv(np.linalg.inv(e.bins.prior) + np.linalg.inv(p.covariance))
    # vague to 1e-4
    assert np.sqrt(np.diag(joint)) == pytest.approx(np.sqrt(np.diag(e.covariance)), rel=0.01)
    mean = joint @ np.linalg.solve(p.covariance, p.bias_deg_h - e.bins.table_deg_h)
    assert mean == pytest.approx(e.mean_deg_h, abs=0.02 * np.sqrt(np.diag(e.covariance)).max())


@pytest.mark.parametrize("shift", [(0.02, 0.02, 0.02), (-0.02, 0.02, 0.0)])
def test_points_do_not_depend_on_the_stored_table(shift):
    """The table moved by 0.02 deg/h, two of its sigmas and more: points stay within a tenth of
    their sigma.
    """
    run = simulated(1).run
    a = session_points(run, estimate(1))
    b = session_points(run, estimate_of(run, shifted(factory(), shift)))
    moved = np.abs(b.bias_deg_h - a.bias_deg_h) / a.sigma_deg_h
    assert moved.max() < 0.1
    assert b.sigma_deg_h == pytest.approx(a.sigma_deg_h, rel=0.05)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_points_agree_with_truth(seed):
    e = estimate(seed)
    p = session_points(simulated(seed).run, e)
    error = p.bias_deg_h - true_bias(simulated(seed), e.bins.edges_s)
    m = len(error)
    assert error @ np.linalg.solve(p.covariance, error) < m + 4.5 * np.sqrt(2 * m)


def test_a_point_that_says_nothing_says_so():
    """Parked on north: each y point carries about 100 prior sigmas, each x point its own ARW."""
    p = session_points(simulated(1, PARKED).run, estimate(1, PARKED))
    prior = np.sqrt(np.diag(estimate(1, PARKED).bins.prior))
    y, x = p.axis_index == 1, p.axis_index == 0
    assert (p.sigma_deg_h[y] > 30 * prior[y]).all()
    assert (p.sigma_deg_h[x] < 2 * prior[x]).all()
    # nor do all of them together: what they lack is common to them
    A = mean_rows(estimate(1, PARKED))
    together = np.sqrt((A @ p.covariance @ A.T)[1, 1])
    assert together > 60 * np.sqrt((A @ estimate(1, PARKED).bins.prior @ A.T)[1, 1])


def test_points_have_the_errors_of_their_temperatures_and_means_those_of_the_session():
    run, e = simulated(1).run, estimate(1)
    p, A = session_points(run, e), mean_rows(e)
    more = np.diag(np.linspace(1e-6, 2e-6, len(p.time_s)))
    thermometer = replace(e, bins=replace(e.bins, thermometer=e.bins.thermometer + more))
    assert session_points(run, thermometer).covariance - p.covariance == pytest.approx(
        more, abs=1e-12
    )
    turned_on = replace(e, bins=replace(e.bins, own=e.bins.own + more))
    found, other = (session_evidence(run, factory(), of, p) for of in (e, turned_on))
    assert other.covariance - found.covariance == pytest.approx(A @ more @ A.T, abs=1e-15)
    assert found.bias_deg_h == pytest.approx(A @ p.bias_deg_h)
    # the table of the session's mean temperature is its mean but for the kinks at nodes
    level = A @ e.bins.table_deg_h
    assert np.abs(found.bend_deg_h).max() < 0.1 * np.abs(level).max()
    shift = replace(e.bins, table_deg_h=e.bins.table_deg_h + 0.02)
    moved = session_evidence(run, factory(), replace(e, bins=shift), p)
    assert moved.bend_deg_h - found.bend_deg_h == pytest.approx(0.02, abs=1e-12)


def test_points_carry_what_the_contract_asks():
    run = simulated(1).run
    p = session_points(run, estimate(1))
    assert p.run_id == "run-1"
    assert p.run_sha256 == run.sha256
    assert p.applied_table_sha256 is None
    assert p.time_s == pytest.approx(np.repeat(estimate(1).bins.centre_s, 3))
    assert list(p.axis_index[:3]) == [0, 1, 2]
    assert (p.temperature_rate_degC_min[:3] > 0.1).all()  # warming up


def test_errors_of_temperature_matter_by_what_the_slope_of_the_table_may_be():
    """A table of zeros: between two nodes its slope has the variance of their difference."""
    table, run = prior_table(), simulated(1).run
    spans = dict(start_s=run.imu.start_s, end_s=run.imu.end_s)
    bins = make_bins(table, gyro_temperature(run.temperature), TWIN, SETTINGS, **spans)
    P, nodes = table.covariance[table.values_of(0)][:, table.values_of(0)], np.arange(-20, 61, 10)
    T = bins.temperature_degC[:, 0]
    inside = np.flatnonzero(np.floor((T - 0.5) / 10) == np.floor((T + 0.5) / 10))
    assert inside.size > 3
    for k in inside:
        i = np.searchsorted(nodes, T[k]) - 1
        of_slope = (P[i, i] + P[i + 1, i + 1] - 2 * P[i, i + 1]) / 10.0**2
        expected = bins.sigma_temperature_degC[k, 0] ** 2 * of_slope
        assert bins.thermometer[3 * k, 3 * k] == pytest.approx(expected, rel=1e-6) and expected > 0


def test_bins_without_a_temperature_may_have_any_bias_of_the_table_mostly_the_same():
    """Table of zeros, 0.01 deg/h: the gyro's bins share 70 % of that variance, and no row of H."""
    run, spans = simulated(1).run, dict(start_s=0.0, end_s=1800.0)
    seen = gyro_temperature(run.temperature)
    tied, untied = (
        make_bins(prior_table(), temperature, TWIN, SETTINGS, **spans)
        for temperature in (seen, replace(seen, unusable=("y",)))
    )
    y = np.arange(1, len(tied.own), 3)
    more = (untied.own - untied.thermometer - tied.own + tied.thermometer)[np.ix_(y, y)]
    assert more == pytest.approx(0.01**2 * (0.7 + 0.3 * np.eye(y.size)), rel=1e-9)
    assert not untied.H[y].any() and not untied.thermometer[y].any() and tied.H[y].any()


def test_verdicts_follow_from_the_ratio():
    e = estimate(1, PARKED)
    seen = observability(e, hold_heading=True)
    rows = mean_rows(e)
    assert rows.sum(axis=1) == pytest.approx(np.ones(3))
    for axis, found in enumerate(seen):
        before, after = (np.sqrt(rows[axis] @ P @ rows[axis]) for P in (e.bins.prior, e.covariance))
        assert (found.sigma_before_deg_h, found.sigma_after_deg_h) == pytest.approx((before, after))
    assert [a.verdict for a in seen] == ["observed", "not_observable", "observed"]
    assert "turn by 90" in seen[1].advice
    assert seen[0].advice == ""


@pytest.mark.parametrize(
    ("ratio", "verdict"),
    [(0.49, "observed"), (0.51, "weak"), (0.89, "weak"), (0.91, "not_observable")],
)
def test_thresholds_of_the_contract(ratio, verdict):
    e = estimate(1, PARKED)
    scaled = replace(e, covariance=ratio**2 * e.bins.prior)
    seen = observability(scaled, hold_heading=True)
    assert {a.verdict for a in seen} == {verdict}
    assert all(bool(a.advice) == (verdict != "observed") for a in seen)
