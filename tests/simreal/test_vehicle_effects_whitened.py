"""Effects through the diagnosis' own operator: what is wrong in a run, fitted with its signature,
comes back in its unit.

The errors are made in the log or its header, by the simulator's boarding, or by other numbers in
the twin's unit, never with the effect's own formula.
"""

from dataclasses import replace

import numpy as np
import pytest

from ins.errors.catalogue import catalogue
from ins.twin_file import default_twin
from ins.units import ARCSEC, PPM
from simreal.evidence.run_view import view_run
from simreal.evidence.whitened import Evidence
from tests.simreal import runs
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.vehicle import Boarding

BY_ID = {effect.id: effect for effect in catalogue()}
TWIN = default_twin("rlg")
ROLLED_m = 0.05  # roll 10 mrad, pitch -20 mrad of a wheel 2 m below the unit: left out by the aids


@pytest.fixture(scope="module")
def clean():
    return runs.simulated(seed=5, aids=True).run


def fitted(run, key, target="", **shape):
    """Coefficients of one effect by least squares on the whitened rows, and their sigmas."""
    view = view_run(run, 0, runs.table(), TWIN)
    evidence = Evidence([view], TWIN)
    effect = BY_ID[key]
    A = evidence.whiten([effect.traces(view.telemetry, target or effect.targets[0], shape)])
    P = np.linalg.inv(A.T @ A)
    return P @ A.T @ evidence.z, np.sqrt(np.diag(P))


def with_header(run, **changes):
    return replace(run, header=replace(run.header, **changes))


def late(log):
    return replace(log, time_s=log.time_s + 0.1)


def in_body(point, x, y):
    """What is logged where the truth is ahead by x and to the right by y."""
    return (point[0] - x, point[1] - y, point[2])


CASES = {
    "lever_arm": (
        lambda r: with_header(r, wheel_reference_m=in_body(r.header.wheel_reference_m, -1.0, 0.5)),
        [-1.0, 0.5],
        ROLLED_m,
    ),
    "gnss_lever_arm_or_latency": (
        lambda r: replace(
            with_header(r, gnss_lever_arm_m=in_body(r.header.gnss_lever_arm_m, 1.0, 0.7)),
            gnss=late(r.gnss),
        ),
        [1.0, 0.7, 100.0],
        0.0,
    ),
    "odometer_scale": (
        lambda r: replace(r, odometer=replace(r.odometer, speed_m_s=1.005 * r.odometer.speed_m_s)),
        [5000.0],
        200.0,
    ),  # cos of the pitch: 200 ppm
    "odometer_time_offset": (lambda r: replace(r, odometer=late(r.odometer)), [100.0], 0.0),
    "site_latitude_error": (
        lambda r: with_header(
            r, site=replace(r.header.site, lat_rad=r.header.site.lat_rad + 60 * ARCSEC)
        ),
        [1.0],
        0.0,
    ),
}


@pytest.mark.parametrize("key", CASES)
def test_an_error_of_the_log_comes_back_in_size_and_sign(clean, key):
    spoil, true, left_out = CASES[key]
    found, sigma = fitted(spoil(clean), key)
    np.testing.assert_array_less(np.abs(found - true), 4.0 * sigma + left_out)
    assert np.all(np.abs(found) > 8.0 * sigma), "the error is well seen, so its sign is"


def test_a_boarding_comes_back_as_a_platform_step():
    """Well inside ten seconds, so that how it rings does not matter."""
    event = Boarding(
        time_s=704.0, roll_arcsec=40.0, pitch_arcsec=-60.0, heading_arcsec=80.0, settle_s=1.0
    )
    run = simulate_run(
        runs._ideal(runs.PARKED, 37.0),
        thermal_history("ambient"),
        runs.unit(),
        TWIN,
        rng=np.random.default_rng(3),
        plan=SessionPlan(events=(event,)),
    ).run
    found, sigma = fitted(run, "platform_step", onset_s=704.5)
    np.testing.assert_array_less(np.abs(found - [40.0, -60.0, 80.0]), 4.0 * sigma + 1.0)


def test_the_twins_own_crab_comes_back_as_a_boresight(clean):
    """A vehicle that crabs by 5 mrad rolls to the left of its nose: -5 mrad."""
    crabbing = replace(TWIN, vehicle=replace(TWIN.vehicle, crab_mrad=5.0))
    run = simulate_run(
        runs._ideal(runs.TAXI, 37.0),
        thermal_history("ambient"),
        runs.unit(),
        crabbing,
        rng=np.random.default_rng(4),
        plan=SessionPlan(with_gnss=True, with_odometer=True, gnss_lever_arm_m=runs.ANTENNA),
    ).run
    found, sigma = fitted(run, "odometer_boresight")
    assert abs(found[0] + 5.0) < 4.0 * sigma[0] and sigma[0] < 0.6


def test_an_accelerometer_that_drifts_by_its_temperature_comes_back_in_ug_per_degC(clean):
    """Increments of the log changed by hand: 30 ug/degC on z."""
    view = view_run(clean, 0, runs.table(), TWIN)
    T = np.interp(clean.imu.time_s, view.telemetry.time_s, view.telemetry.accel_degC[:, 2])
    dv = clean.imu.dv_m_s + np.stack(
        [0 * T, 0 * T, 30 * 9.80665 * PPM * (T - 25.0) * clean.imu.dt_s], axis=1
    )
    (linear, _), (sigma, _) = fitted(
        replace(clean, imu=replace(clean.imu, dv_m_s=dv)), "accel_thermal", "accel_z"
    )
    assert abs(linear - 30.0) < 4.0 * sigma and sigma < 6.0
