"""What found effects cost a session: against two navigations of the logged run, with and without
them, and against draws of coefficients, headings and sessions.
"""

from dataclasses import replace

import numpy as np
import pytest

from alignment import coarse
from ins.records import NavState
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import KNOT
from simreal.predict.sessions import ALIGN_S, _expected, _Session, sessions_of
from simreal.predict.traces import fitted_trace
from tests.simreal.diagnosed import diagnosed

# of a drift [NM/h]: a heading error of 20 mrad turns what the noise makes, 1.4 km in 20 min
TURNED_NM_H = 0.05
DRAWN = 0.03  # of an RMS over 4000 draws: 1/sqrt(2 x 4000) is 0.011


@pytest.fixture(scope="module")
def found():
    return diagnosed()


def end_of(view, trace):
    """Level position (2,) [m] of the log less a trace, aligned and navigated unaided."""
    imu, start = view.run.imu.whole(), view.start_s + ALIGN_S
    middle = imu.time_s - 0.5 * imu.dt_s
    rates = [np.interp(middle, view.telemetry.time_s, column) for column in trace.gyro_rad_s.T]
    less = replace(imu, dtheta_rad=imu.dtheta_rad - np.stack(rates, axis=1) * imu.dt_s[:, None])
    site = view.run.header.site
    rest = less.between(view.start_s, start)
    f, omega = (np.sum(v, axis=0) / rest.dt_s.sum() for v in (rest.dv_m_s, rest.dtheta_rad))
    means = coarse.rest_means(rest)  # medians: an effect that settles has another mean
    C_nb = coarse.gyrocompass_dcm(replace(means, f_ib_b=f, omega_ib_b=omega))
    initial = NavState(time_s=start, site=site, v_n_m_s=np.zeros(3), C_nb=C_nb)
    end = view.end_s
    history = navigate(
        less.between(start, end), initial, epoch_s=1.0, vertical=VerticalChannel(mode="hold")
    )
    radius = 6.37e6
    north = (history.lat_rad[-1] - site.lat_rad) * radius
    east = (history.lon_rad[-1] - site.lon_rad) * radius * np.cos(site.lat_rad)
    return np.array([north, east])


def test_a_run_costs_what_two_navigations_of_it_differ_by(found):
    _, levels = sessions_of(found)
    for k, (view, level) in enumerate(zip(found.views, levels, strict=True)):
        trace = fitted_trace(found, k)
        moved = end_of(view, trace.scaled(0.0)) - end_of(view, trace)
        linear = np.sqrt(level.as_it_is.rate_nm_h**2 - level.without.rate_nm_h**2)
        exact = np.linalg.norm(moved) / (level.navigated_s * KNOT)
        assert linear == pytest.approx(exact, abs=TURNED_NM_H), view.name


def test_a_session_is_never_expected_to_drift_less_with_the_effects(found):
    drift, levels = sessions_of(found)
    assert drift.sessions == len(levels) == len(found.views)
    assert drift.noise_nm_h < drift.without.rms_nm_h < drift.as_it_is.rms_nm_h
    assert drift.as_it_is.interval_95[0] < drift.as_it_is.rms_nm_h < drift.as_it_is.interval_95[1]
    assert drift.by_cause_nm_h[0] > 0.0


def made_session(found, rate, noise):
    """One whose drift is `rate` [NM/h] on one heading and none on the others."""
    view = found.views[0]
    per_hour = 3600.0 * KNOT
    position = np.zeros((4, 2, 1))
    position[0, 0, 0] = rate * per_hour
    return _Session(view, 3600.0, position, position[0], np.zeros(1), noise * per_hour, 0.0)


def test_the_expectation_is_that_of_draws(found):
    """Two sessions, four headings, one coefficient of 1 +- 0.5."""
    sessions = [made_session(found, 2.0, 0.3), made_session(found, 1.0, 0.3)]
    drift = _expected(sessions, np.ones(1), np.array([[0.25]]), [np.ones(1, bool)])
    rng = np.random.default_rng(1)
    n = 40000
    truth = rng.normal(1.0, 0.5, n)
    rate = np.where(rng.random(n) < 0.5, 2.0, 1.0) * (rng.random(n) < 0.25)
    noise = rng.normal(0.0, 0.3 / np.sqrt(2.0), (n, 2))
    for left, said in ((truth, drift.as_it_is), (truth - 1.0, drift.without)):
        rms = np.sqrt(np.mean((rate * left + noise[:, 0]) ** 2 + noise[:, 1] ** 2))
        assert said.rms_nm_h == pytest.approx(rms, rel=DRAWN)


def test_nothing_found_costs_nothing(found):
    bare = replace(found.attribution, slots=[], tables=[])
    assert sessions_of(replace(found, attribution=bare, causes=(), order=())) == (None, ())
