"""Ideal sensors against closed forms, against the navigation-frame equations (not used in making
them), and back.
"""

from itertools import pairwise

import numpy as np
import pytest

from ins.attitude import dcm_from_euler, rotation_vector_from_dcm
from ins.earth import (
    EARTH_RATE_RAD_S,
    SEMI_MAJOR_AXIS_M,
    gravity_n,
    omega_en_n,
    omega_ie_n,
    radii_of_curvature,
)
from ins.records import ImuLog, InputError, NavState, Site
from ins.strapdown.mechanization import navigate
from ins.units import ARCSEC, DEG, DEG_PER_HOUR
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Descend,
    Landing,
    Park,
    Stop,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)
from trajectories.simulator.sensors import _body_rate, ideal_sensors
from trajectories.simulator.truth import build_truth, rate_from_euler

NANO_G = 1e-8  # m/s^2
FLIGHT = [
    Park(duration_s=20.0),
    Turn(angle_deg=-70.0),
    TakeOff(),
    Climb(height_m=1500.0),
    TurnFlight(angle_deg=200.0),
    Cruise(duration_s=120.0, speed_m_s=180.0),
    Descend(height_m=300.0),
    Landing(),
    Stop(duration_s=5.0),
]


def truth_at(segments, *, lat_deg=45.0, lon_deg=7.0, **attitude):
    site = Site(lat_rad=lat_deg * DEG, lon_rad=lon_deg * DEG, height_m=250.0)
    return build_truth(lay(segments), site, **attitude)


@pytest.mark.parametrize("lat_deg", [-89.0, -45.0, 0.0, 0.1, 45.0, 70.0, 90.0])
def test_at_rest_they_read_gravity_and_earth_rate(lat_deg):
    euler = np.array([2.0, -3.0, 200.0]) * DEG
    roll, pitch, heading = euler
    truth = truth_at(
        [Park(duration_s=5.0)], lat_deg=lat_deg, heading_rad=heading, roll_rad=roll, pitch_rad=pitch
    )
    ideal = ideal_sensors(truth, 100.0)
    C_bn = dcm_from_euler(*euler).T
    f_b = -C_bn @ gravity_n(lat_deg * DEG, 250.0)
    np.testing.assert_allclose(ideal.dv_m_s / ideal.dt_s, np.tile(f_b, (500, 1)), atol=0.1 * NANO_G)
    rate = C_bn @ omega_ie_n(lat_deg * DEG)
    np.testing.assert_allclose(
        ideal.dtheta_rad / ideal.dt_s, np.tile(rate, (500, 1)), atol=1e-7 * DEG_PER_HOUR
    )
    assert ideal.at_rest.all()


def test_east_along_the_equator():
    """Constant speed v on the equator: f_up = g - 2 Omega v - v^2/(a + h), pitch rate -(Omega +
    v/(a + h)).
    """
    leg = Straight(duration_s=80.0, speed_m_s=30.0, acceleration_m_s2=2.0)
    truth = truth_at([leg], lat_deg=0.0, heading_rad=90 * DEG)
    ideal = ideal_sensors(truth, 20.0)
    cruise = slice(1000, 1500)
    radius = SEMI_MAJOR_AXIS_M + 250.0
    up = gravity_n(0.0, 250.0)[2] - 2 * EARTH_RATE_RAD_S * 30.0 - 30.0**2 / radius
    np.testing.assert_allclose(
        ideal.dv_m_s[cruise] / ideal.dt_s, np.tile([0.0, 0.0, -up], (500, 1)), atol=1e-6
    )
    pitch_rate = -(EARTH_RATE_RAD_S + 30.0 / radius)
    expected = np.tile([0.0, pitch_rate, 0.0], (500, 1))
    np.testing.assert_allclose(ideal.dtheta_rad[cruise] / ideal.dt_s, expected, atol=1e-11)


def test_circle_at_constant_speed():
    """A turn at rate r: f_y = V (r + Coriolis), body yaw rate r less Earth rate's down part."""
    truth = truth_at([Turn(angle_deg=3600.0, radius_m=40.0, speed_m_s=8.0)])
    ideal = ideal_sensors(truth, 50.0)
    steady = slice(2500, 5000)
    rate, earth = 8.0 / 40.0, EARTH_RATE_RAD_S * np.sin(45 * DEG)
    yaw = ideal.dtheta_rad[steady, 2] / ideal.dt_s
    np.testing.assert_allclose(yaw, rate - earth, atol=2e-6)  # transport: V/R tanL = 1.3e-6
    side = ideal.dv_m_s[steady, 1] / ideal.dt_s
    # transport again, times V
    np.testing.assert_allclose(side, 8.0 * (rate - 2 * earth), atol=2e-5)


@pytest.mark.parametrize("lever", [(0.0, 0.0, 0.0), (5.0, 1.0, -2.0)])
def test_rates_are_those_of_the_navigation_frame_equations(lever):
    """Midpoint of omega_nb + omega_en + omega_ie and of v' + (2 omega_ie + omega_en) x v - g, at
    100 Hz in flight.
    """
    truth = truth_at(FLIGHT, wheel_reference_m=lever, heading_rad=1.0)
    ideal = ideal_sensors(truth, 100.0)
    h = 1e-3
    rows = np.arange(200, ideal.time_s.size, 97)
    middle = ideal.time_s[rows] - 0.5 * ideal.dt_s
    now, ahead, behind = (navigation_state(truth, middle + s) for s in (0.0, h, -h))
    C_bn = np.swapaxes(dcm_from_euler(*now["euler"].T), 1, 2)
    transport, spin = omega_en_n(now["lat"], now["height"], now["v_n"]), omega_ie_n(now["lat"])
    omega_b = rate_from_euler(now["euler"], now["euler_rate"]) + np.einsum(
        "nij,nj->ni", C_bn, transport + spin
    )
    v_dot = (ahead["v_n"] - behind["v_n"]) / (2 * h)
    f_n = v_dot + np.cross(2 * spin + transport, now["v_n"]) - gravity_n(now["lat"], now["height"])
    # midpoint rule, dt^2/24 w''
    np.testing.assert_allclose(ideal.dtheta_rad[rows] / ideal.dt_s, omega_b, atol=3e-6)
    f_b = np.einsum("nij,nj->ni", C_bn, f_n)
    np.testing.assert_allclose(ideal.dv_m_s[rows] / ideal.dt_s, f_b, atol=3e-5)


def navigation_state(truth, t):
    from ins.earth import dcm_en, geodetic_from_ecef

    k = truth.kinematics(t)
    lat, lon, height = geodetic_from_ecef(k.r_e)
    v_n = np.einsum("nji,nj->ni", dcm_en(lat, lon), k.v_e)
    return {
        "lat": lat,
        "height": height,
        "v_n": v_n,
        "euler": k.euler_rad,
        "euler_rate": k.euler_rate_rad_s,
    }


def test_ten_samples_at_100_hz_make_one_at_10_hz():
    truth = truth_at(FLIGHT[:5] + [Cruise(duration_s=5.0)])
    fast, slow = ideal_sensors(truth, 100.0), ideal_sensors(truth, 10.0)
    n = slow.time_s.size
    for name in ("dtheta_rad", "dv_m_s"):
        summed = getattr(fast, name)[: 10 * n].reshape(n, 10, 3).sum(axis=1)
        np.testing.assert_allclose(summed, getattr(slow, name), atol=2e-9)


def test_body_rate_of_a_cone_is_exact_to_the_order_of_the_collocation():
    """Coning at 2 Hz, 0.05 rad: halving the sample divides the error by at least 2^5."""
    from ins.attitude import dcm_from_rotation_vector
    from trajectories.simulator.sensors import NODES, WEIGHTS

    def attitude(t):
        w = 2 * np.pi * 2.0
        return dcm_from_rotation_vector(0.05 * np.array([np.cos(w * t), np.sin(w * t), 0.0]))

    def error(dt):
        turned = [
            rotation_vector_from_dcm(attitude(0.1).T @ attitude(0.1 + dt * tau))
            for tau in (*NODES, 1.0)
        ]
        made = WEIGHTS @ _body_rate(np.array([turned]))[0]
        fine = np.linspace(0.1, 0.1 + dt, 4001)
        parts = [rotation_vector_from_dcm(attitude(a).T @ attitude(b)) for a, b in pairwise(fine)]
        return np.linalg.norm(made - np.sum(parts, axis=0))

    coarse, finer = error(0.1), error(0.05)
    assert coarse < 2e-4 and finer < coarse / 2**5


@pytest.mark.parametrize("lat_deg", [-45.0, 70.0])
def test_a_flight_navigates_back_to_itself(lat_deg):
    """Through ins.strapdown.mechanization, which shares only Earth and rotations with the
    simulator: 1 cm, 0.01 arcsec.
    """
    truth = truth_at(
        FLIGHT, lat_deg=lat_deg, lon_deg=179.9, heading_rad=1.0, wheel_reference_m=(5.0, 0.5, -1.0)
    )
    ideal = ideal_sensors(truth, 50.0)
    imu = ImuLog(
        time_s=ideal.time_s,
        dt_s=np.full(ideal.time_s.size, ideal.dt_s),
        dtheta_rad=ideal.dtheta_rad,
        dv_m_s=ideal.dv_m_s,
    )
    start = NavState(
        time_s=0.0, site=truth.site, v_n_m_s=np.zeros(3), C_nb=dcm_from_euler(0.0, 0.0, 1.0)
    )
    history = navigate(imu, start, epoch_s=None)
    meridian, transverse = radii_of_curvature(ideal.lat_rad)
    north = (history.lat_rad[1:] - ideal.lat_rad) * meridian
    dlon = np.angle(np.exp(1j * (history.lon_rad[1:] - ideal.lon_rad)))
    east = dlon * transverse * np.cos(ideal.lat_rad)
    assert np.max(np.abs(north)) < 0.01 and np.max(np.abs(east)) < 0.01
    assert np.max(np.abs(history.height_m[1:] - ideal.height_m)) < 0.01
    phi = rotation_vector_from_dcm(history.C_nb[1:] @ np.swapaxes(ideal.C_nb, 1, 2))
    assert np.max(np.abs(phi)) < 0.01 * ARCSEC


def test_rate_and_length_are_checked():
    truth = truth_at([Park(duration_s=0.05)])
    with pytest.raises(InputError, match="10 Hz to 2 kHz"):
        ideal_sensors(truth, 5.0)
    with pytest.raises(InputError, match="two samples"):
        ideal_sensors(truth, 10.0)
