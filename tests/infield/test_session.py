"""One session: bins and their joint prior, and the estimate against truth."""

from dataclasses import replace

import numpy as np
import pytest

from infield.session.bins import make_bins
from infield.session.log import compensated_imu, session_end
from infield.session.settings import SessionSettings
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import Phase, TemperatureLog
from ins.units import DEG_PER_HOUR
from tests.infield.sessions import (
    PARKED,
    SETTINGS,
    TWIN,
    estimate,
    estimate_of,
    factory,
    own_information_floor_deg_h,
    shifted,
    simulated,
    true_bias,
)


def bins_of(temperature=None, settings=SETTINGS, start_s=0.0, end_s=1800.0):
    temperature = temperature or gyro_temperature(simulated().run.temperature)
    return make_bins(factory(), temperature, TWIN, settings, start_s=start_s, end_s=end_s)


def test_bins_share_the_time_evenly():
    bins = bins_of(end_s=1700.0)
    assert bins.duration_s == pytest.approx(np.full(6, 1700.0 / 6))
    assert bins.centre_s[0] == pytest.approx(850.0 / 6)
    assert len(bins_of(settings=SessionSettings(bin_s=60.0)).centre_s) == 30
    assert len(bins_of(end_s=40.0).centre_s) == 1


def test_rows_average_the_table_over_the_bin():
    """H beta is the table's mean along the bin, not the table at the mean temperature."""
    temperature, table, bins = gyro_temperature(simulated().run.temperature), factory(), bins_of()
    inside = (
        np.linspace(bins.edges_s[0], bins.edges_s[1], 6001)[:-1] + 0.5 * bins.duration_s[0] / 6000
    )
    for axis in range(3):
        along = table.bias_deg_h(axis, temperature.at(inside)[:, axis]).mean()
        assert bins.table_deg_h[axis] == pytest.approx(along, abs=1e-8)
        assert bins.H[axis].sum() == pytest.approx(1.0)
        others = np.delete(np.arange(table.n_parameters), np.r_[table.values_of(axis)])
        assert not bins.H[axis, others].any()


def test_prior_is_the_table_and_what_a_session_adds():
    bins, table = bins_of(), factory()
    assert bins.prior == pytest.approx(bins.H @ table.covariance @ bins.H.T + bins.own, abs=1e-18)
    assert np.linalg.eigvalsh(bins.prior)[0] > 0
    gyro = TWIN.gyro
    assert bins.own[0, 3] > gyro.turn_on_deg_h**2  # turn-on is common to the session
    assert bins.own[0, 1] == 0.0  # of one axis
    # and so is the table's common shift
    assert bins.prior[0, 3] > 0.7 * table.sigma_deg_h(0, 20.0)[0] ** 2


def test_an_unknown_stuck_axis_teaches_the_table_nothing():
    T = simulated().run.temperature
    gyro = T.gyro_degC.copy()
    gyro[:, 1] = 25.0
    bins = bins_of(gyro_temperature(TemperatureLog(time_s=T.time_s, gyro_degC=gyro)))
    y = np.arange(1, len(bins.prior), 3)
    gain = factory().covariance @ bins.H[y].T @ np.linalg.inv(bins.prior[np.ix_(y, y)])
    assert np.abs(gain).max() < 1e-3
    x = np.arange(0, len(bins.prior), 3)
    assert (
        np.abs(factory().covariance @ bins.H[x].T @ np.linalg.inv(bins.prior[np.ix_(x, x)])).max()
        > 0.1
    )


def test_compensated_imu_takes_off_the_table_at_the_logged_temperature():
    run = simulated().run
    imu = compensated_imu(run, factory(), gyro_temperature(run.temperature), TWIN)
    row = 9000
    T = gyro_temperature(run.temperature).at(run.imu.time_s[[row]])[0]
    expected = [factory().bias_deg_h(k, T[k])[0] for k in range(3)]
    taken = (run.imu.dtheta_rad - imu.dtheta_rad)[row] / run.imu.dt_s[row] / DEG_PER_HOUR
    assert taken == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_estimate_agrees_with_truth(seed):
    """Chi-square of all bins jointly below its 99.9 % bound, mean biases within 4 sigmas."""
    e = estimate(seed)
    error = e.bins.table_deg_h + e.mean_deg_h - true_bias(simulated(seed), e.bins.edges_s)
    m = len(error)
    assert error @ np.linalg.solve(e.covariance, error) < m + 4.5 * np.sqrt(2 * m)
    reference = simulated(seed).reference
    k = int(np.argmin(np.abs(reference.time_s - e.alignment.time_s)))
    true_error = e.alignment.heading_rad - reference.heading_rad[k]
    true_error = np.angle(np.exp(1j * true_error))
    assert abs(e.heading_error_rad - true_error) < 4 * e.sigma_heading_rad
    assert e.sigma_heading_rad < 0.7 * e.sigma_heading_before_rad
    assert 0.8 < e.nis_mean < 1.2


def test_posterior_never_exceeds_the_prior_and_stays_positive():
    e = estimate(1)
    assert np.linalg.eigvalsh(e.bins.prior - e.covariance)[0] > -1e-12
    assert np.linalg.eigvalsh(e.covariance)[0] > 0


def test_no_session_beats_its_angle_random_walk():
    """R11: sigma of the mean bias, without prior, is not below ARW / sqrt(t)."""
    e = estimate(1)
    seconds = e.bins.edges_s[-1] - e.bins.edges_s[0]
    weights = np.zeros((3, len(e.mean_deg_h)))
    for axis in range(3):
        weights[axis, axis::3] = 1.0 / len(e.bins.centre_s)
    before, after = (np.diag(weights @ P @ weights.T) for P in (e.bins.prior, e.covariance))
    own = 1.0 / np.sqrt(1.0 / after - 1.0 / before)
    assert (own > 0.95 * own_information_floor_deg_h(TWIN, seconds)).all()
    assert own_information_floor_deg_h(TWIN, 3600.0) == pytest.approx(0.002)


def test_a_wrong_table_gives_the_same_total_bias():
    """0.02 deg/h on every axis with its sigma: the solution is linearised about its own result."""
    table = shifted(factory(), (0.005, -0.005, 0.005))
    a, b = estimate(1), estimate_of(simulated(1).run, table)
    north = 0  # heading 0 at rest: x is north and seen, so prior and table hardly matter
    total_a, total_b = (e.bins.table_deg_h + e.mean_deg_h for e in (a, b))
    sigma = np.sqrt(np.diag(a.covariance))
    assert total_b[north::3] == pytest.approx(total_a[north::3], abs=0.6 * sigma[north])


def test_session_ends_at_take_off():
    run = simulated(1, PARKED).run
    assert session_end(run) == pytest.approx(1800.0)
    flying = replace(
        run, phases=(*run.phases, Phase(phase="takeoff", start_s=1000.0, end_s=1030.0))
    )
    assert session_end(flying) == 1000.0
