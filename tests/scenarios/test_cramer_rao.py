"""The Cramer-Rao bound: hand-worked cases, the covariance table of physics.md 6.7, and the filter
against it.
"""

import subprocess
import sys
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.linalg import block_diag

from benchmarks.cramer_rao import Epoch, Sights, Spread, bias_bound, posterior_covariance
from benchmarks.navigation_response import NavigationResponse, navigation_response
from infield.session.settings import SessionSettings
from ins.earth import EARTH_RATE_RAD_S
from ins.records import TwinModel
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, HOUR, MICRO_G
from tests.scenarios.study import REFERENCE_TWIN, estimated, ideal, session, simulated_session
from trajectories.simulator.motions import Park, Stop, Straight, Turn, lay
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth

ONE_PERCENT, TEN_PERCENT = 0.01, 0.10
ARW = REFERENCE_TWIN.gyro.arw_deg_sqrt_h  # deg/sqrt(h)
PRIOR = 0.01  # deg/h
CONSTANT = Spread(common_deg_h=PRIOR, shape_deg_h=0.0)
REFERENCE = Spread(common_deg_h=PRIOR * np.sqrt(0.7), shape_deg_h=PRIOR * np.sqrt(0.3))
QUIET = replace(
    REFERENCE_TWIN, vehicle=replace(REFERENCE_TWIN.vehicle, sway_m_s=0.0, lateral_noise_m_s=0.0)
)
BLIND = Sights(hold_heading=False)
# physics.md 6.7: ZUPT 5 mm/s, lateral 30 mm/s
AS_6_7 = Sights(hold_heading=False, velocity_noise_m_s=(0.005, 0.03))


@lru_cache(maxsize=16)
def response(name: str, lat_deg: float = 45.0):
    """Made once for each reference motion; 27 navigations."""
    return navigation_response(ideal(name, lat_deg))


def bound(name: str, twin: TwinModel, spread: Spread, sights: Sights, *, lat_deg: float = 45.0):
    return bound_of(ideal(name, lat_deg), response(name, lat_deg), twin, spread, sights)


def bound_of(
    base: IdealSensors, answer: NavigationResponse, twin: TwinModel, spread: Spread, sights: Sights
):
    middle_s = answer.nominal.time_s[1:] - 0.5
    return bias_bound(
        base, answer, thermal_history("ambient").at(middle_s).gyro_degC, twin, spread, sights
    )


def parallel(*sigmas: float) -> float:
    """Sigma of independent sights of one quantity together."""
    return float(np.sum(np.array(sigmas) ** -2.0) ** -0.5)


def test_the_bound_knows_nothing_of_the_filter():
    """Neither the bound nor what it imports loads a module of the estimator."""
    code = "import sys, benchmarks.cramer_rao; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    shared = {"ins.estimation", "ins.kalman", "alignment", "infield"}
    assert "benchmarks.navigation_response" in loaded
    assert not shared & set(loaded)


def test_recursion_is_the_batch_least_squares_covariance():
    """(H' R^-1 H + P0^-1)^-1 of start and all noise inputs at once, taken to the last state."""
    rng = np.random.default_rng(5)
    n, count = 4, 9
    epochs = [
        Epoch(
            np.eye(n) + 0.3 * rng.standard_normal((n, n)),
            np.diag(rng.uniform(0.1, 1.0, n)),
            rng.standard_normal((k % 3, n)),
            rng.uniform(0.1, 1.0, k % 3),
        )
        for k in range(count)
    ]
    P0 = np.diag(rng.uniform(1.0, 9.0, n))
    to_state, rows, noise = np.eye(n, n * (count + 1)), [], []
    for k, epoch in enumerate(epochs):
        to_state = epoch.F @ to_state
        to_state[:, n * (k + 1) : n * (k + 2)] += np.eye(n)
        rows.append(epoch.H @ to_state)
        noise.append(epoch.R)
    H, R = np.concatenate(rows), np.concatenate(noise)
    prior = block_diag(P0, *(epoch.Q for epoch in epochs))
    batch = to_state @ np.linalg.inv(H.T @ (H / R[:, None]) + np.linalg.inv(prior)) @ to_state.T
    np.testing.assert_allclose(posterior_covariance(P0, epochs), batch, rtol=1e-9, atol=1e-12)


def test_response_at_rest_is_that_of_physics_6_2():
    """One second at 45 deg: tilt into velocity, Earth rate into tilt, gyro into attitude; and a
    gyro's hour in flight.
    """
    answer = response("parked_only")
    g, rate = 9.806, EARTH_RATE_RAD_S * np.cos(45 * DEG)
    Phi, Gamma = answer.Phi[1000], answer.Gamma[1000]
    assert Phi[3, 4] == pytest.approx(g, rel=1e-3) and Phi[2, 5] == pytest.approx(-g, rel=1e-3)
    assert Phi[5, 6] == pytest.approx(rate, rel=1e-3)
    assert Phi[4, 5] == pytest.approx(-rate, rel=1e-3)
    assert Phi[6, 5] == pytest.approx(-rate, rel=1e-3)
    np.testing.assert_allclose(Gamma[4:, :3], np.eye(3), atol=1e-3)  # heading 0
    np.testing.assert_allclose(Gamma[2:4, 3:5], np.eye(2), atol=1e-3)
    np.testing.assert_allclose(answer.shown_Phi[1000, :2, 2:4], np.eye(2), atol=1e-3)


def test_a_parked_hour_shows_the_north_gyro_to_arw_over_root_t():
    """physics.md 6.4 at the equator (no accelerometer term): sigma_N = ARW / sqrt(t) beside its
    prior; east: the prior.
    """
    found = bound("parked_only", QUIET, CONSTANT, BLIND, lat_deg=0.0).sigma_deg_h
    assert found[0] == pytest.approx(parallel(PRIOR, ARW / np.sqrt(4200 / HOUR)), rel=ONE_PERCENT)
    assert found[1] == pytest.approx(PRIOR, rel=1e-3)


def test_accelerometers_tilt_the_north_gyro():
    """physics.md 6.4: u_N = eps_N - Omega sinL theta_E: 50 ug leave Omega sinL x 50e-6."""
    found = bound("parked_only", QUIET, CONSTANT, BLIND).sigma_deg_h[0]
    seen = np.hypot(
        ARW / np.sqrt(4200 / HOUR),
        EARTH_RATE_RAD_S * np.sin(45 * DEG) * 50 * MICRO_G / 9.806 / DEG_PER_HOUR,
    )
    assert found == pytest.approx(parallel(PRIOR, seen), rel=ONE_PERCENT)


@pytest.mark.parametrize("creep_arcsec", [0.0, 5.0, 20.0])
def test_the_parked_heading_shows_the_vertical_gyro(creep_arcsec):
    """sigma_z^2 = ARW^2 / t + (creep / t)^2 + (Omega cosL sigma_tilt)^2, physics.md,
    parked-attitude constraint.
    """
    hours = 4200 / HOUR
    vehicle = replace(QUIET.vehicle, yaw_creep_arcsec_sqrt_h=creep_arcsec / np.sqrt(hours))
    found = bound("parked_only", replace(QUIET, vehicle=vehicle), CONSTANT, Sights()).sigma_deg_h[2]
    tilt = EARTH_RATE_RAD_S * np.cos(45 * DEG) * 50 * MICRO_G / 9.806 / DEG_PER_HOUR
    seen = np.sqrt(ARW**2 / hours + (creep_arcsec * ARCSEC / DEG / hours) ** 2 + tilt**2)
    assert found == pytest.approx(parallel(PRIOR, seen), rel=ONE_PERCENT)


def test_a_turn_of_90_deg_and_a_stop_show_the_east_gyro():
    """physics.md 6.4 at the equator, t1 = 70 min on heading 0, t2 = 20 min on 90 deg, the heading
    drift of t2 left out:

    u_N2 = -eps_E + n2;  u_E2 - u_E1 = (eps_N - eps_E) + n3, noise ARW / sqrt(t); eps_N known from
    the first rest.
    """
    found = bound("turn_90_park_20min", QUIET, CONSTANT, BLIND, lat_deg=0.0).sigma_deg_h[1]
    n1, n2 = ARW / np.sqrt(4200 / HOUR), ARW / np.sqrt(1200 / HOUR)
    direct = n2
    against_the_alignment = np.sqrt(n2**2 + n1**2 + parallel(PRIOR, n1) ** 2)
    assert found == pytest.approx(parallel(PRIOR, direct, against_the_alignment), rel=0.05)


def one_stop() -> IdealSensors:
    """Legs 90/180/90 of physics.md 6.7 with one stop, at the end."""
    leg = Straight(duration_s=200.0, speed_m_s=10.0, acceleration_m_s2=1.0)
    turns = [
        Turn(angle_deg=90.0),
        leg,
        Turn(angle_deg=90.0),
        leg,
        Turn(angle_deg=-90.0),
        leg,
        Stop(duration_s=60.0),
    ]
    site = ideal("parked_only").truth.site
    return ideal_sensors(
        build_truth(lay([Park(duration_s=4200.0), *turns]), site, heading_rad=0.0), 10.0
    )


ROWS = {  # physics.md 6.7: sigma along north and east of the first heading [deg/h]
    "straight_taxi": (0.0019, 0.0100),
    "taxi_0_90": (0.0019, 0.0080),
    "taxi_m90_p90_300": (0.0018, 0.0055),
    "taxi_m90_p90_600": (0.0018, 0.0032),
    "taxi_m90_p90_300_stop_120": (0.0018, 0.0034),
    "turn_90_park_20min": (0.0017, 0.0027),
    "turn_180_park_20min": (0.0016, 0.0021),
    "turn_180_park_60min": (0.0014, 0.0016),
}


# the others are navigated by `pytest -m slow`: a row is 27 navigations
QUICK_ROWS = ("straight_taxi", "taxi_m90_p90_300")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in QUICK_ROWS else pytest.mark.slow) for n in ROWS]
)
def test_rows_of_physics_6_7(name):
    """With the table's own measurement set, within a tenth: two derivations."""
    found = bound(
        name, QUIET, replace(CONSTANT, crab_rad=0.001, lever_arm_m=0.01), AS_6_7
    ).sigma_deg_h
    north, east = (found[1], found[0]) if "m90" in name else (found[0], found[1])
    assert (north, east) == pytest.approx(ROWS[name], rel=TEN_PERCENT)


@pytest.mark.slow
def test_legs_of_physics_6_7():
    """A single stop ends the legs in the table; the reference motion of that name stops three times
    and shows more.
    """
    spread = replace(CONSTANT, crab_rad=0.001, lever_arm_m=0.01)
    motion = one_stop()
    once = bound_of(motion, navigation_response(motion), QUIET, spread, AS_6_7).sigma_deg_h[1]
    assert once == pytest.approx(0.0034, rel=TEN_PERCENT)
    assert bound("legs_90_180_90", QUIET, spread, AS_6_7).sigma_deg_h[1] < 0.9 * once


@pytest.mark.parametrize(
    ("sigma_mrad", "east_deg_h"), [(1.0, 0.0074), (0.3, 0.0036), (0.1, 0.0024)]
)
def test_external_track_of_physics_6_7(sigma_mrad, east_deg_h):
    sights = replace(AS_6_7, surveyed_sigma_rad=sigma_mrad * 1e-3)
    assert bound("parked_only", QUIET, CONSTANT, sights).sigma_deg_h[1] == pytest.approx(
        east_deg_h, rel=0.05
    )


CELLS = [
    ("realistic_taxi", False, True),
    ("taxi_m90_p90_300", False, True),
    ("straight_taxi", True, False),
]


@pytest.mark.parametrize(
    ("name", "gnss", "hold", "lat_deg"),
    [*((*c, 45.0) for c in CELLS), ("parked_only", True, True, 75.0)],
)
def test_the_filter_claims_what_the_bound_allows_and_nearly_all_of_it(name, gnss, hold, lat_deg):
    """Parked with satellites at 75 deg: its drift shows no heading."""
    base = ideal(name, lat_deg)
    least = bound(
        name, REFERENCE_TWIN, REFERENCE, Sights(gnss=gnss, hold_heading=hold), lat_deg=lat_deg
    )
    made = simulated_session(base, 0, twin=REFERENCE_TWIN, with_gnss=gnss)
    settings = SessionSettings(hold_heading=hold)
    found = estimated(made, made.run, REFERENCE_TWIN, settings=settings)
    assert np.all(least.sigma_deg_h < 1.02 * found.sigma_deg_h)
    assert np.all(found.sigma_deg_h < 1.15 * least.sigma_deg_h)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "gnss", "hold"), CELLS)
def test_errors_reach_the_bound(name, gnss, hold):
    """RMS of 200 runs within 1.15 of the bound on the axes that are seen (chance: 5 %)."""
    least = bound(name, REFERENCE_TWIN, REFERENCE, Sights(gnss=gnss, hold_heading=hold))
    settings = SessionSettings(hold_heading=hold)
    errors = np.stack(
        [session(name, k, with_gnss=gnss, settings=settings).error_deg_h for k in range(200)]
    )
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / least.sigma_deg_h
    assert np.all(ratio[least.sigma_deg_h < 0.9 * least.sigma_prior_deg_h] < 1.15)
