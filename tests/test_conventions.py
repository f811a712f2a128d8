"""One test per sign and frame of CONVENTIONS.md that concerns `ins`, each through a navigated log.

Crab and lever arm belong to the packages that use them.
"""

import numpy as np
import pytest
from scipy.linalg import expm

from ins import attitude, earth
from ins.records import ImuLog, NavState, Site
from ins.strapdown.compensation import compensate
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG, DEG_PER_HOUR, MILLIRADIAN

LAT = 45 * DEG
G = float(earth.gravity_magnitude(LAT, 0.0))
SPIN_N, SPIN_D = earth.EARTH_RATE_RAD_S * np.cos(LAT), -earth.EARTH_RATE_RAD_S * np.sin(LAT)
R_N, R_E = earth.radii_of_curvature(LAT)
HOLD = VerticalChannel(mode="hold")
BIAS = 0.01 * DEG_PER_HOUR


def heading_dcm(heading_rad):
    return attitude.dcm_from_euler(0.0, 0.0, heading_rad)


def parked(duration_s, *, C_nb=None, gyro_bias=(0.0, 0.0, 0.0), dt=0.1):
    """A parked unit whose true attitude is C_nb (default: level, north); gyro errors added."""
    n, C_nb = round(duration_s / dt), np.eye(3) if C_nb is None else C_nb
    gyro, accel = C_nb.T @ [SPIN_N, 0.0, SPIN_D] + gyro_bias, C_nb.T @ [0.0, 0.0, -G]
    return ImuLog(
        time_s=dt * np.arange(1, n + 1),
        dt_s=np.full(n, dt),
        dtheta_rad=np.tile(gyro * dt, (n, 1)),
        dv_m_s=np.tile(accel * dt, (n, 1)),
    )


def state(C_nb=None, v_n_m_s=(0.0, 0.0, 0.0)):
    site = Site(lat_rad=LAT, lon_rad=0.1, height_m=0.0)
    return NavState(
        time_s=0.0, site=site, v_n_m_s=v_n_m_s, C_nb=np.eye(3) if C_nb is None else C_nb
    )


def push(imu, row, dv_b):
    """The log with a velocity increment added to one row."""
    dv = np.array(imu.dv_m_s)
    dv[row] += dv_b
    return ImuLog(time_s=imu.time_s, dt_s=imu.dt_s, dtheta_rad=imu.dtheta_rad, dv_m_s=dv)


@pytest.mark.parametrize(
    ("dv_b", "heading_deg", "v_n"),
    [
        ((1, 0, 0), 0, (1, 0, 0)),
        ((1, 0, 0), 90, (0, 1, 0)),
        ((0, 1, 0), 0, (0, 1, 0)),
        ((0, 1, 0), 90, (-1, 0, 0)),
        ((0, 0, 1), 30, (0, 0, 1)),
    ],
)
def test_body_is_forward_right_down_and_navigation_north_east_down(dv_b, heading_deg, v_n):
    """C_nb takes b into n; heading is clockwise from north; v_eb_n is relative to the Earth."""
    C_nb = heading_dcm(heading_deg * DEG)
    h = navigate(push(parked(2.0, C_nb=C_nb), 4, dv_b), state(C_nb))
    assert h.v_n_m_s[-1] == pytest.approx(v_n, abs=1e-3)
    assert h.displacement_n_m[2] == pytest.approx(v_n, abs=1e-3)
    assert h.displacement_b_m[2] == pytest.approx(dv_b, abs=1e-3)


def test_north_raises_latitude_east_raises_longitude_down_lowers_height():
    h = navigate(parked(1.0), state(v_n_m_s=(10.0, 20.0, 5.0)))
    assert h.lat_rad[-1] - LAT == pytest.approx(10 / R_N, rel=1e-3)
    assert h.lon_rad[-1] - 0.1 == pytest.approx(20 / (R_E * np.cos(LAT)), rel=1e-3)
    assert h.height_m[-1] == pytest.approx(-5.0, rel=1e-3)


def test_earth_rate_is_north_and_up_at_positive_latitude():
    assert earth.omega_ie_n(LAT) == pytest.approx([SPIN_N, 0.0, SPIN_D])
    assert SPIN_N > 0 > SPIN_D


def test_at_rest_and_level_the_accelerometers_read_minus_g_down():
    """A free-falling reading of +g down would double gravity instead."""
    h = navigate(parked(10.0), state())
    assert np.abs(h.v_n_m_s).max() < 1e-6
    assert h.dv_f_n_m_s[-1] == pytest.approx([0, 0, -G], abs=1e-5)


@pytest.mark.parametrize("axis", range(3))
def test_phi_is_computed_minus_true_and_a_gyro_bias_makes_it_grow(axis):
    """C_computed = (I + [phi x]) C_true; phi' = + eps over a minute, eps = C_nb bias, bias =
    measured - true.
    """
    C_nb = heading_dcm(0.5)
    bias = 100 * BIAS * np.eye(3)[axis]
    h = navigate(parked(60.0, C_nb=C_nb, gyro_bias=bias), state(C_nb))
    phi = attitude.rotation_vector_from_dcm(h.C_nb[-1] @ C_nb.T)
    assert phi == pytest.approx(60 * C_nb @ bias, abs=0.01 * 60 * 100 * BIAS)


def test_psi_is_computed_minus_true_heading():
    C_nb = heading_dcm(0.3)
    wrong = heading_dcm(0.3 + MILLIRADIAN)
    assert attitude.rotation_vector_from_dcm(wrong @ C_nb.T) == pytest.approx([0, 0, MILLIRADIAN])
    assert attitude.euler_from_dcm(wrong)[2] == pytest.approx(0.301)


def test_heading_is_between_0_and_360_deg():
    assert attitude.euler_from_dcm(heading_dcm(-0.1))[2] == pytest.approx(2 * np.pi - 0.1)


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 200.0])
def test_gyro_error_at_heading_h(heading_deg):
    """eps_N = b_x cosH - b_y sinH, eps_E = b_x sinH + b_y cosH, eps_D = b_z."""
    H, (bx, by, bz) = heading_deg * DEG, (1.0, 2.0, 3.0)
    expected = [bx * np.cos(H) - by * np.sin(H), bx * np.sin(H) + by * np.cos(H), bz]
    assert heading_dcm(H) @ [bx, by, bz] == pytest.approx(expected)


def test_a_bias_is_subtracted_from_the_gyro_output():
    bias = BIAS * np.array([1.0, -2.0, 3.0])
    corrected = compensate(parked(1.0, gyro_bias=bias), gyro_bias_rad_s=bias)
    assert corrected.dtheta_rad == pytest.approx(parked(1.0).dtheta_rad, abs=1e-18)


def test_east_gyro_error_turns_the_gyrocompass_by_minus_0_94_mrad():
    """With psi = -eps_E / (Omega cosL) the tilt rate vanishes: no velocity after an hour
    (physics.md 6.4: 0.2 mm/s).
    """
    psi = -BIAS / SPIN_N
    assert psi == pytest.approx(-0.940 * MILLIRADIAN, abs=1e-6)
    imu = parked(3600.0, gyro_bias=(0.0, BIAS, 0.0))
    aligned = navigate(imu, state(heading_dcm(psi)), vertical=HOLD)
    assert np.abs(aligned.v_n_m_s[-1]).max() < 2e-4  # what is left is psi^2 / 2 of the Earth rate
    other_sign = navigate(imu, state(heading_dcm(-psi)), vertical=HOLD)
    assert np.abs(other_sign.v_n_m_s).max() > 0.5


def test_theta_is_free_of_schuler_motion():
    """theta = phi less the rotation of the position error obeys theta' = -omega_ie x theta + eps
    (physics.md 6.2).
    """
    eps = BIAS * np.array([1.0, -0.5, 2.0])
    h = navigate(parked(3600.0, gyro_bias=eps), state(), epoch_s=600.0, vertical=HOLD)
    phi = attitude.rotation_vector_from_dcm(h.C_nb)
    north, east = ((h.lat_rad - LAT) * R_N, (h.lon_rad - 0.1) * R_E * np.cos(LAT))
    theta = phi + np.stack([east / R_E, -north / R_N, -east * np.tan(LAT) / R_E], axis=-1)
    A = np.zeros((4, 4))
    A[:3, :3], A[:3, 3] = -attitude.skew([SPIN_N, 0.0, SPIN_D]), eps
    expected = np.array([expm(A * t)[:3, 3] for t in h.time_s])
    assert theta == pytest.approx(expected, abs=0.003 * np.abs(expected).max())
    # phi itself is not free of it
    assert np.abs(phi - expected).max() > 0.1 * np.abs(expected).max()


def test_w_is_the_velocity_error_in_the_computed_frame():
    """Heading error 1 mrad, 10 m/s gained straight ahead: dv_E = +psi V, while w = dv - theta x v
    stays near zero.

    Hence the computed body-lateral velocity does not show the heading error (physics.md 6.5).
    """
    psi, v_true = MILLIRADIAN, np.array([10.0, 0.0, 0.0])
    h = navigate(push(parked(2.0), 9, v_true), state(heading_dcm(psi)))
    dv = h.v_n_m_s[1] - v_true
    assert dv[1] == pytest.approx(psi * 10.0, rel=0.01)
    w = dv - np.cross([0.0, 0.0, psi], v_true)
    assert np.abs(w[:2]).max() < 0.02 * psi * 10.0
    lateral = h.C_nb[1].T @ h.v_n_m_s[1]
    assert abs(lateral[1]) < 0.02 * psi * 10.0


def test_an_imu_row_covers_the_interval_that_ends_at_its_time():
    h = navigate(push(parked(1.0), 4, (1.0, 0.0, 0.0)), state(), epoch_s=None)
    assert h.v_n_m_s[h.time_s < 0.45, 0] == pytest.approx(np.zeros(5), abs=1e-4)
    assert h.v_n_m_s[h.time_s > 0.45, 0] == pytest.approx(np.ones(6), abs=1e-4)
    assert h.displacement_n_m[5, 0] == pytest.approx(0.05, abs=0.01)
