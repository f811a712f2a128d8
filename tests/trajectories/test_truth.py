"""Truth: position, velocity and acceleration are derivatives of one another; P does not slip; rest
is rest.
"""

import numpy as np
import pytest

from ins.attitude import dcm_from_euler
from ins.earth import dcm_en, displacement_ned, geodetic_from_ecef
from ins.records import Site
from ins.units import DEG
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Park,
    Pivot,
    Stop,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)
from trajectories.simulator.truth import build_truth, rate_from_euler

SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
TAXI = [
    Park(duration_s=20.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=60.0),
    Turn(angle_deg=-60.0),
    Stop(duration_s=15.0),
]
STEP_S = 1e-2


def central_difference(values):
    """Fourth order, at all but two points at each end."""
    return (values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / (12 * STEP_S)


@pytest.mark.parametrize("lever", [(0.0, 0.0, 0.0), (6.0, -1.0, 2.0)])
def test_velocity_and_acceleration_are_the_derivatives(lever):
    truth = build_truth(lay(TAXI), SITE, heading_rad=0.3, wheel_reference_m=lever)
    k = truth.kinematics(np.arange(15.0, 110.0, STEP_S))
    inner = slice(2, -2)
    # position carries 1e-9 m of rounding: 1e-9 / (12 STEP_S) x 10 terms
    np.testing.assert_allclose(central_difference(k.r_e), k.v_e[inner], atol=1e-6)
    np.testing.assert_allclose(central_difference(k.v_e), k.a_e[inner], atol=1e-6)
    np.testing.assert_allclose(
        central_difference(k.euler_rad), k.euler_rate_rad_s[inner], atol=1e-6
    )


def test_rest_is_constant_to_the_bit_and_joins_the_motion():
    truth = build_truth(lay(TAXI), SITE)
    still = truth.kinematics(np.linspace(0.0, 20.0, 50))
    assert np.ptp(still.r_e, axis=0).max() == 0 and not still.v_e.any() and not still.a_e.any()
    for t in truth.breaks_s[1:-1]:
        before, after = truth.kinematics(np.array([t - 1e-9, t])).r_e
        np.testing.assert_allclose(before, after, atol=1e-8)
    joined = truth.kinematics(truth.breaks_s[1:-1] + 1e-6)
    assert np.max(np.abs(joined.a_e)) < 1e-6


def test_straight_leg_ends_where_speed_times_time_says():
    motion = lay(
        [Straight(duration_s=300.0, speed_m_s=10.0, acceleration_m_s2=1.0), Stop(duration_s=1.0)]
    )
    truth = build_truth(motion, SITE, heading_rad=30 * DEG)
    lat, lon, _ = geodetic_from_ecef(truth.kinematics(np.array([motion.end_s])).r_e)
    ramp_s = 1.875 * 10.0 / 1.0  # half of the start ramp is lost; the stop adds half of its own
    length = 10.0 * (300.0 - ramp_s / 2) + 10.0 * 0.5 * 1.875 * 10.0 / 0.6
    moved = displacement_ned(
        lat, lon, lat0_rad=SITE.lat_rad, lon0_rad=SITE.lon_rad, height0_m=SITE.height_m
    )[0]
    np.testing.assert_allclose(
        moved, [length * np.cos(30 * DEG), length * np.sin(30 * DEG)], atol=0.5
    )


def test_wheel_reference_point_stands_while_the_vehicle_pivots():
    """P lies 6 m ahead of the IMU: turning right, the IMU swings to the left, v_y = -6 m x rate."""
    lever = np.array([6.0, 1.0, 2.0])
    motion = lay(
        [Park(duration_s=5.0), Pivot(angle_deg=90.0, duration_s=40.0), Park(duration_s=5.0)]
    )
    truth = build_truth(motion, SITE, wheel_reference_m=tuple(lever))
    k = truth.kinematics(np.linspace(0.0, motion.end_s, 501))
    lat, lon, _ = geodetic_from_ecef(k.r_e)
    C_eb = dcm_en(lat, lon) @ dcm_from_euler(*k.euler_rad.T)
    point = k.r_e + C_eb @ lever
    np.testing.assert_allclose(point - point[0], 0.0, atol=1e-4)
    middle = truth.kinematics(np.array([25.0]))
    v_b = C_eb[250].T @ middle.v_e[0]
    rate = float(motion.course_rate_rad_s(25.0))
    np.testing.assert_allclose(v_b, [rate * 1.0, -rate * 6.0, 0.0], atol=1e-4)


def test_a_turn_in_flight_is_coordinated():
    """No side force in body axes but Coriolis (2 Omega V = 0.02 m/s^2 at 150 m/s)."""
    from trajectories.simulator.sensors import ideal_sensors

    turn = TurnFlight(angle_deg=180.0, bank_deg=25.0)
    motion = lay([TakeOff(), Climb(height_m=500.0), turn, Cruise(duration_s=20.0)])
    ideal = ideal_sensors(build_truth(motion, SITE), 10.0)
    turning = ideal.euler_rad[:, 0] > 20 * DEG
    side = ideal.dv_m_s[turning, 1] / ideal.dt_s
    assert turning.sum() > 100 and np.max(np.abs(side)) < 0.04
    assert ideal.euler_rad[:, 0].max() == pytest.approx(25 * DEG, abs=0.1 * DEG)


def test_euler_rates_match_the_derivative_of_the_matrix():
    euler, rate = np.array([[0.2, -0.3, 1.0]]), np.array([[0.05, 0.02, -0.1]])
    h = 1e-6
    C = [dcm_from_euler(*(euler + s * h * rate)[0]) for s in (-1, 0, 1)]
    W = C[1].T @ (C[2] - C[0]) / (2 * h)
    np.testing.assert_allclose(
        rate_from_euler(euler, rate)[0], [W[2, 1], W[0, 2], W[1, 0]], atol=1e-9
    )
