"""Closed forms: at rest, Schuler, Foucault, free fall, the vertical channel."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ins import earth
from ins.attitude import dcm_from_euler, rotation_vector_from_dcm
from ins.records import ImuLog, InputError, NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, MICRO_G

SCHULER = tomllib.loads((Path(__file__).parent.parent / "vectors" / "schuler.toml").read_text())
ONE_MM, ONE_MM_S = 1e-3, 1e-3
HOLD = VerticalChannel(mode="hold")
TILTED = dcm_from_euler(0.1, -0.2, 1.0)


ZERO = (0.0, 0.0, 0.0)


PLACE = {"lon_rad": 0.3, "height_m": 100.0}


def at_rest(lat_deg, *, duration_s, dt=0.05, C_nb=None, gyro_bias=ZERO, accel_bias=ZERO, **place):
    """Increments of a body fixed to the Earth, biases added, and its state."""
    lat, n = lat_deg * DEG, round(duration_s / dt)
    C_nb = np.eye(3) if C_nb is None else C_nb
    site = Site(lat_rad=lat, **{**PLACE, **place})
    omega = C_nb.T @ earth.omega_ie_n(lat) + gyro_bias
    force = -C_nb.T @ earth.gravity_n(lat, site.height_m) + accel_bias
    imu = ImuLog(
        time_s=dt * np.arange(1, n + 1),
        dt_s=np.full(n, dt),
        dtheta_rad=np.tile(omega * dt, (n, 1)),
        dv_m_s=np.tile(force * dt, (n, 1)),
    )
    return imu, NavState(time_s=0.0, site=site, v_n_m_s=np.zeros(3), C_nb=C_nb)


def offsets_ned(h):
    """North, east [m] of each row from the first."""
    return earth.displacement_ned(
        h.lat_rad, h.lon_rad, lat0_rad=h.lat_rad[0], lon0_rad=h.lon_rad[0], height0_m=h.height_m[0]
    )


# ------------------------------------------------------------------------------------------------
# at rest


@pytest.mark.parametrize("lat_deg", [-90.0, -45.0, 0.1, 70.0, 89.9, 90.0])
def test_at_rest_it_stays(lat_deg):
    """One hour, ideal sensors: within 1 mm, 1e-3 mm/s and 1e-3 arcsec; ECEF compared, so the pole
    counts as well.
    """
    imu, state = at_rest(lat_deg, duration_s=3600, dt=0.02, C_nb=TILTED)
    h = navigate(imu, state, epoch_s=600.0)
    r_e = earth.ecef_from_geodetic(h.lat_rad, h.lon_rad, h.height_m)
    C_eb = earth.dcm_en(h.lat_rad, h.lon_rad) @ h.C_nb
    phi = rotation_vector_from_dcm(C_eb @ C_eb[0].T)
    assert np.abs(r_e - r_e[0]).max() < ONE_MM
    assert np.abs(h.v_n_m_s).max() < 1e-3 * ONE_MM_S
    assert np.abs(phi).max() < 1e-3 * ARCSEC


def test_at_the_pole_ned_is_that_of_longitude_zero():
    imu, state = at_rest(90.0, duration_s=10, C_nb=TILTED, lon_rad=0.0)
    h = navigate(imu, state)
    assert not h.lon_rad.any()
    assert h.C_nb[-1] == pytest.approx(TILTED, abs=1e-9)


# ------------------------------------------------------------------------------------------------
# Schuler, Foucault


def schuler_run(lat_deg, hours=1.5, **errors):
    imu, state = at_rest(lat_deg, duration_s=3600 * hours, dt=0.1, height_m=0.0, **errors)
    return navigate(imu, state, epoch_s=6.0, vertical=HOLD)


def test_raw_jerk_passes_zero_at_a_quarter_period():
    u = SCHULER["gyro_bias_deg_h"] * DEG_PER_HOUR
    h = schuler_run(0.0, hours=0.6, gyro_bias=(u, 0, 0))
    t, jerk = h.time_s[1:-1] / 60, np.diff(h.v_n_m_s[:, 1], 2) / 6.0**2
    factor = jerk / earth.GRAVITY_EQUATOR_M_S2 / u
    for minute, expected in SCHULER["jerk_factor"].items():
        assert np.interp(float(minute), t, factor) == pytest.approx(expected, abs=0.002)
    assert t[np.argmax(factor < 0)] == pytest.approx(SCHULER["jerk_zero_min"], abs=0.2)


@pytest.mark.parametrize("channel", range(5))
@pytest.mark.parametrize("lat_deg", [-45.0, 45.0, 70.0])
def test_response_to_each_sensor_error_is_that_of_the_error_equations(lat_deg, channel):
    """physics.md 6.2, solved by matrix exponential, one gyro or level accelerometer at a time:
    signs and couplings.
    """
    eps, nabla = np.zeros(3), np.zeros(3)
    (eps if channel < 3 else nabla)[channel % 3] = (
        0.01 * DEG_PER_HOUR if channel < 3 else 20 * MICRO_G
    )
    h = schuler_run(lat_deg, hours=1.0, gyro_bias=eps, accel_bias=nabla)
    L, (meridian, transverse) = lat_deg * DEG, earth.radii_of_curvature(lat_deg * DEG)
    g, W = float(earth.gravity_magnitude(L, 0.0)), earth.EARTH_RATE_RAD_S
    s, c = W * np.sin(L), W * np.cos(L)
    F = np.zeros((7, 7))  # phi_N, phi_E, phi_D, dv_N, dv_E, dL, 1
    F[0, [1, 5, 4, 6]] = -s, s, -1 / transverse, eps[0]
    F[1, [0, 2, 3, 6]] = s, c, 1 / meridian, eps[1]
    F[2, [1, 5, 4, 6]] = -c, c, np.tan(L) / transverse, eps[2]
    F[3, [1, 4, 6]] = -g, -2 * s, nabla[0]
    F[4, [0, 3, 6]] = g, 2 * s, nabla[1]
    F[5, 3] = 1 / meridian
    x = expm(F * h.time_s[-1])[:, 6]
    phi = rotation_vector_from_dcm(h.C_nb[-1])  # C_computed = (I + [phi x]) C_true, C_true = I
    scale_v = max(np.abs(x[3:5]).max(), 1e-3)
    assert h.v_n_m_s[-1, :2] == pytest.approx(x[3:5], abs=0.01 * scale_v)
    assert phi == pytest.approx(x[:3], abs=0.01 * np.abs(x[:3]).max() + 1e-9)


def test_foucault_turns_the_schuler_plane():
    """A Schuler period after a push north the velocity points Omega sinL T to the east of north."""
    imu, state = at_rest(45.0, duration_s=5070, dt=0.1, height_m=0.0)
    pushed = NavState(time_s=0.0, site=state.site, v_n_m_s=[0.1, 0.0, 0.0], C_nb=state.C_nb)
    h = navigate(imu, pushed, epoch_s=1.0, vertical=HOLD)
    period = (
        2
        * np.pi
        * np.sqrt(earth.radii_of_curvature(45 * DEG)[0] / earth.gravity_magnitude(45 * DEG, 0.0))
    )
    v = np.array([np.interp(period, h.time_s, h.v_n_m_s[:, i]) for i in range(2)])
    assert np.linalg.norm(v) == pytest.approx(0.1, rel=0.01)
    assert np.arctan2(v[1], v[0]) == pytest.approx(
        earth.EARTH_RATE_RAD_S * np.sin(45 * DEG) * period, rel=0.02
    )


# ------------------------------------------------------------------------------------------------
# falling


def test_free_fall_matches_newton_in_the_inertial_frame():
    """40 s of fall from 12 km; east by about Omega g t^3 cosL / 3."""
    lat, n, dt = 40 * DEG, 400, 0.1
    imu = ImuLog(
        time_s=dt * np.arange(1, n + 1),
        dt_s=np.full(n, dt),
        dtheta_rad=np.zeros((n, 3)),
        dv_m_s=np.zeros((n, 3)),
    )
    site = Site(lat_rad=lat, lon_rad=0.0, height_m=12e3)
    h = navigate(
        imu, NavState(time_s=0.0, site=site, v_n_m_s=np.zeros(3), C_nb=np.eye(3)), epoch_s=None
    )
    spin, axis = earth.EARTH_RATE_RAD_S, np.array([0.0, 0.0, earth.EARTH_RATE_RAD_S])

    def fixed_from_inertial(t):
        c, s = np.cos(spin * t), np.sin(spin * t)
        return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])

    def motion(t, y):
        C_ei = fixed_from_inertial(t)
        phi, lon, height = (float(a) for a in earth.geodetic_from_ecef(C_ei @ y[:3]))
        plumb = earth.dcm_en(phi, lon) @ earth.gravity_n(phi, height)
        return np.concatenate([y[3:], C_ei.T @ plumb + np.cross(axis, np.cross(axis, y[:3]))])

    r0 = earth.ecef_from_geodetic(lat, 0.0, 12e3)
    end = solve_ivp(
        motion, (0, 40), np.concatenate([r0, np.cross(axis, r0)]), rtol=1e-12, atol=1e-8
    ).y[:, -1]
    r_e = earth.ecef_from_geodetic(h.lat_rad[-1], h.lon_rad[-1], h.height_m[-1])
    assert r_e == pytest.approx(fixed_from_inertial(40.0) @ end[:3], abs=2 * ONE_MM)
    assert offsets_ned(h)[-1, 1] == pytest.approx(spin * 9.77 * 40**3 * np.cos(lat) / 3, rel=0.01)
    assert h.height_m[-1] < 4300
    turned = fixed_from_inertial(40.0) @ earth.dcm_en(lat, 0.0)
    C_eb = earth.dcm_en(h.lat_rad[-1], h.lon_rad[-1]) @ h.C_nb[-1]
    assert C_eb == pytest.approx(turned, abs=1e-12)


# ------------------------------------------------------------------------------------------------
# vertical channel


def test_free_height_error_grows_as_cosh():
    imu, state = at_rest(45.0, duration_s=1200, height_m=0.0)
    site = Site(lat_rad=state.site.lat_rad, lon_rad=0.3, height_m=1.0)
    h = navigate(imu, NavState(time_s=0.0, site=site, v_n_m_s=np.zeros(3), C_nb=np.eye(3)))
    growth = np.sqrt(2 * earth.gravity_magnitude(45 * DEG, 0.0) / earth.SEMI_MAJOR_AXIS_M)
    assert 1 / growth == pytest.approx(570, abs=1)
    assert h.height_m == pytest.approx(np.cosh(growth * h.time_s), rel=0.01)


@pytest.mark.parametrize("tau", [20.0, 100.0])
def test_damped_height_answers_an_accelerometer_error_as_designed(tau):
    """B t^2/2 exp(-t/tau) for a step B up; zero in the end because of the integral path."""
    B = 100 * MICRO_G
    imu, state = at_rest(30.0, duration_s=20 * tau, accel_bias=(0, 0, -B))
    h = navigate(imu, state, vertical=VerticalChannel(mode="hold", time_constant_s=tau))
    expected = B * h.time_s**2 / 2 * np.exp(-h.time_s / tau)
    assert h.height_m - 100.0 == pytest.approx(expected, abs=0.01 * expected.max())
    v_down = -np.gradient(expected, h.time_s) - 3 / tau * expected
    assert h.v_n_m_s[1:-1, 2] == pytest.approx(v_down[1:-1], abs=0.01 * B * tau)


def test_hold_at_another_height_and_aided_by_a_series_go_there():
    imu, state = at_rest(30.0, duration_s=1500)
    hold = navigate(imu, state, vertical=VerticalChannel(mode="hold", height_m=110.0))
    aided = navigate(
        imu,
        state,
        vertical=VerticalChannel(mode="aided", time_s=[0.0, 9e9], height_m=[110.0, 110.0]),
    )
    assert hold.height_m[-1] == pytest.approx(110.0, abs=0.01)
    assert np.array_equal(hold.height_m, aided.height_m)


def test_aided_follows_a_ramp_that_the_sensors_do_not_see():
    imu, state = at_rest(30.0, duration_s=3000)
    series = VerticalChannel(
        mode="aided", time_s=[0.0, 1000.0, 1600.0], height_m=[100.0, 100.0, 106.0]
    )
    h = navigate(imu, state, vertical=series)
    at = dict(zip(h.time_s, h.height_m))
    assert at[1000.0] == pytest.approx(100.0, abs=0.01)
    assert at[3000.0] == pytest.approx(106.0, abs=0.01)
    assert h.height_m.max() < 109 and h.height_m.min() > 99


def test_vertical_loop_leaves_the_horizontal_channels_alone():
    """An accelerometer error down: 50 m of height apart after 4 min, level together but for
    Coriolis of that v_D.
    """
    imu, state = at_rest(
        45.0, duration_s=240, accel_bias=(30 * MICRO_G, 0, -200 * MICRO_G), C_nb=np.eye(3)
    )
    free, held = (navigate(imu, state, vertical=v) for v in (None, HOLD))
    assert free.height_m[-1] - held.height_m[-1] > 40
    climb_m = -np.cumsum(free.v_n_m_s[:, 2] - held.v_n_m_s[:, 2])
    coriolis_m = -2 * earth.EARTH_RATE_RAD_S * np.cos(45 * DEG) * np.sum(climb_m)
    difference = offsets_ned(free)[-1] - offsets_ned(held)[-1]
    assert difference[1] == pytest.approx(coriolis_m, rel=0.03)
    assert difference[0] == pytest.approx(0.0, abs=2 * ONE_MM)
    same = navigate(
        *at_rest(45.0, duration_s=240), vertical=VerticalChannel(mode="hold", height_m=100.0)
    )
    assert np.abs(offsets_ned(same)).max() < 0.1 * ONE_MM


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        (dict(mode="baro"), "mode"),
        (dict(mode="aided"), "needs time_s"),
        (dict(time_constant_s=0.0), "above 0"),
        (dict(mode="aided", time_s=[0, 1], height_m=[1.0]), "shape"),
        (dict(mode="hold", height_m=[1.0, 2.0]), "aided"),
        (dict(mode="aided", time_s=[0, 0], height_m=[1.0, 1.0]), "increasing"),
        (dict(mode="hold", height_m=np.nan), "finite"),
        (dict(mode="aided", time_s=[0, 1], height_m=[1.0, np.nan]), "finite"),
    ],
)
def test_vertical_channel_refuses(fields, word):
    with pytest.raises(InputError, match=word):
        VerticalChannel(**fields)
