"""The numbers of physics.md section 6, each from the nonlinear navigation; signs as in
CONVENTIONS.md.
"""

from functools import cache

import numpy as np
import pytest

from alignment.tilt_rate import tilt_rates
from ins import earth
from ins.attitude import dcm_from_euler
from ins.estimation import error_model as em
from ins.estimation.tape import GYRO
from ins.records import NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG, DEG_PER_HOUR, MILLIRADIAN
from tests.ins.nonlinear_errors import Errors, error_states, run_errors, straight_roll

LAT, HEIGHT = 45 * DEG, 0.0
G = float(earth.gravity_magnitude(LAT, HEIGHT))
SPIN = earth.EARTH_RATE_RAD_S
BIAS = 0.01 * DEG_PER_HOUR
ONE_MM_S = 1e-3
# stiff: v_D would leak 5e-6 deg/h into u_N
HOLD = VerticalChannel(mode="hold", time_constant_s=10.0)
SPEED = 10.0


def start(heading_rad=0.0, speed_m_s=0.0):
    v_n = speed_m_s * np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0])
    site = Site(lat_rad=LAT, lon_rad=0.1, height_m=HEIGHT)
    return NavState(time_s=0.0, site=site, v_n_m_s=v_n, C_nb=dcm_from_euler(0.0, 0.0, heading_rad))


def east_at(heading_rad, size=BIAS):
    """Body components of a level gyro bias that points east at a heading (physics.md 6.1)."""
    return (size * np.sin(heading_rad), size * np.cos(heading_rad), 0.0)


def gyrocompass_errors(gyro, accel, heading_rad):
    """theta of an alignment that is done: phi_N = -del_E / g, phi_E = del_N / g, psi = -eps_E /
    (Omega cosL) + ...
    """
    C_nb = dcm_from_euler(0.0, 0.0, heading_rad)
    eps, nabla = C_nb @ gyro, C_nb @ accel
    psi = -eps[1] / (SPIN * np.cos(LAT)) + nabla[1] / G * np.tan(LAT)
    return (-nabla[1] / G, nabla[0] / G, psi)


@cache
def parked_errors(gyro, theta=(0.0, 0.0, 0.0), accel=(0.0, 0.0, 0.0), hours=1.0):
    """Velocity error (k, 3) each second of a parked unit facing north, and the history."""
    begin = start()
    imu = straight_roll(begin, duration_s=hours * 3600.0, dt=0.5)
    history = run_errors(
        imu, begin, Errors(gyro=gyro, theta=theta, accel=accel), epoch_s=1.0, vertical=HOLD
    )
    return history.v_n_m_s, history


@pytest.mark.parametrize(
    ("lat_deg", "mrad", "coupling_deg_h"),
    [
        (0, 0.665, 15.04),
        (30, 0.768, 13.03),
        (45, 0.940, 10.64),
        (60, 1.330, 7.52),
        (70, 1.944, 5.14),
    ],
)
def test_table_of_heading_error_against_latitude(lat_deg, mrad, coupling_deg_h):
    coupling = earth.omega_ie_n(lat_deg * DEG)[0]
    assert coupling / DEG_PER_HOUR == pytest.approx(coupling_deg_h, abs=0.006)
    assert BIAS / coupling / MILLIRADIAN == pytest.approx(mrad, abs=6e-4)


def test_an_east_bias_shows_nothing_on_the_alignment_heading_and_a_north_bias_all():
    """6.4: |dv| below 0.2 mm/s after an hour; the north bias gives the full Schuler response, 0.6
    m/s.

    What is left in between, 0.31 mm/s at 42 min, is the Earth rate's psi^2 / 2.
    """
    east = (0.0, BIAS, 0.0)
    v, _ = parked_errors(east, theta=gyrocompass_errors(east, (0, 0, 0), 0.0))
    assert np.abs(v[-1, :2]).max() < 0.2 * ONE_MM_S
    assert np.abs(v[:, :2]).max() < 0.35 * ONE_MM_S
    v, _ = parked_errors((BIAS, 0.0, 0.0))
    assert np.abs(v[:, 1]).max() == pytest.approx(2 * 6.371e6 * BIAS, rel=0.03)


def second_derivative(values, k, h=10):
    """Central, fourth order."""
    return (
        -values[k + 2 * h]
        + 16 * values[k + h]
        - 30 * values[k]
        + 16 * values[k - h]
        - values[k - 2 * h]
    ) / (12.0 * h**2)


def first_derivative(values, k, h=10):
    return (-values[k + 2 * h] + 8 * values[k + h] - 8 * values[k - h] + values[k - 2 * h]) / (
        12.0 * h
    )


def test_bracket_form_is_the_tilt_rate_over_an_hour():
    """u from velocity alone, at 0.004 deg/h on both level axes, within 1e-6 deg/h of theta' (6.3).

    First order in the errors: at 0.01 deg/h terms in v^2 / R take 2.7e-6 deg/h.
    """
    eps = 0.4 * np.array([BIAS, -BIAS, 0.0])
    v, history = parked_errors(tuple(eps))
    truth = navigate(
        straight_roll(start(), duration_s=3600.0, dt=0.5), start(), epoch_s=1.0, vertical=HOLD
    )
    coriolis = 2 * SPIN * np.sin(LAT)
    R_N, R_E = earth.radii_of_curvature(LAT)
    for k in (300, 900, 1266, 1800, 2532, 3500):
        theta = error_states(truth, history, k)[em.THETA]
        u = -np.cross(earth.omega_ie_n(LAT), theta) + eps
        (vn, ve), (an, ae) = v[k, :2], (first_derivative(v[:, i], k) for i in (0, 1))
        u_N = (second_derivative(v[:, 1], k) + G / R_E * ve - coriolis * an) / G
        u_E = -(second_derivative(v[:, 0], k) + G / R_N * vn + coriolis * ae) / G
        assert u_N == pytest.approx(u[0], abs=1e-6 * DEG_PER_HOUR)
        assert u_E == pytest.approx(u[1], abs=1e-6 * DEG_PER_HOUR)


def test_tilt_rates_of_claim_1_are_schuler_corrected():
    """Windows of 5 min: within 2 % of theta', where the raw acceleration rate loses its sign."""
    eps = np.array([BIAS, -BIAS, 0.0])
    _, history = parked_errors(tuple(eps))
    truth = navigate(
        straight_roll(start(), duration_s=3600.0, dt=0.5), start(), epoch_s=1.0, vertical=HOLD
    )
    found = tilt_rates(
        history, np.ones(len(history.time_s), bool), arw=0.0, velocity_sigma_m_s=1e-6
    )
    assert len(found) == 12
    for rate in found:
        theta = error_states(truth, history, round(rate.time_s))[em.THETA]
        u = -np.cross(earth.omega_ie_n(LAT), theta) + eps
        assert rate.u_north_rad_s == pytest.approx(u[0], abs=0.02 * BIAS)
        assert rate.u_east_rad_s == pytest.approx(u[1], abs=0.02 * BIAS)


def parked_observability(columns):
    """Stacked H F^k (row norms one) of zero-velocity rows, one heading, over the given states, in
    units of scale.
    """
    step = em.Step(
        dt_s=1.0,
        C_nb=np.eye(3),
        v_n=np.zeros(3),
        omega_ie_n=earth.omega_ie_n(LAT),
        omega_en_n=np.zeros(3),
        gravity=G,
        radius_m=earth.SEMI_MAJOR_AXIS_M,
        turn_rad=0.0,
    )
    F, B = em.system_matrix(step, 2.0)
    down = [em.W_DOWN, em.POS_DOWN]  # the height is given
    F[down], B[down] = 0.0, 0.0
    A = np.block([[F, B[:, GYRO : GYRO + 3]], [np.zeros((3, em.BASE + 3))]])
    H = np.zeros((2, em.BASE + 3))
    H[0, em.W.start] = H[1, em.W.start + 1] = 1.0
    hour = 1000.0  # time unit that keeps F near one
    rows, power = [], np.eye(em.BASE + 3)
    for _ in range(14):
        rows.append(H @ power)
        power = power @ A * hour
    return np.vstack(rows)[:, columns]


def test_one_heading_leaves_exactly_three_directions_unseen():
    """Three zero singular values over w, theta, eps, del (position known at the start), and they
    are n1, n2, n3.
    """
    gyro = np.arange(em.BASE, em.BASE + 3)
    columns = np.r_[em.W, em.THETA, gyro, em.ACCEL]
    rate = 1e-3  # states in units where all are of one size: 1 rad, 1e-3 rad/s, g, R rate
    unit = np.array([6.4e3, 6.4e3, 1, 1, 1, rate, rate, rate, G, G])
    O = parked_observability(columns) * unit
    O /= np.abs(O).max(axis=1, keepdims=True) + 1e-300
    singular = np.linalg.svd(O)[1]
    assert np.count_nonzero(singular > 1e-6 * singular[0]) == 7
    assert singular[7] < 1e-12 * singular[0]
    spin_n, spin_d = SPIN * np.cos(LAT), SPIN * np.sin(LAT)
    n1 = np.array([0, 0, 0, 0, 1.0, 0, -spin_n, 0, 0, 0])
    n2 = np.array([0, 0, 1.0, 0, 0, 0, -spin_d, 0, 0, -G])
    n3 = np.array([0, 0, 0, 1.0, 0, spin_d, 0, spin_n, G, 0])
    for null in (n1, n2, n3):
        assert np.abs(O @ (null / unit)).max() < 1e-12
    for k, wrong in ((6, n1), (9, n2), (5, n3)):  # the same with one sign turned is seen
        turned = wrong.copy()
        turned[k] *= -1
        assert np.abs(O @ (turned / unit)).max() > 1e-3


@pytest.mark.parametrize("turn_deg", [0.0, 45.0, 90.0, 180.0, -90.0])
def test_two_heading_table(turn_deg):
    """u_N(H2) = eps_N cosD - eps_E sinD, u_E(H2) = eps_N sinD + eps_E (cosD - 1), psi unchanged
    (6.4).

    Aligned on north with both biases, turned by D, tilt rate from the nonlinear solution over 10
    min.
    """
    eps_N, eps_E, turn = 0.7 * BIAS, BIAS, turn_deg * DEG
    theta = gyrocompass_errors((eps_N, eps_E, 0.0), (0, 0, 0), 0.0)
    begin = start(turn)
    imu = straight_roll(begin, duration_s=60.0, dt=0.5)
    history = run_errors(
        imu, begin, Errors(gyro=(eps_N, eps_E, 0.0), theta=theta), epoch_s=1.0, vertical=HOLD
    )
    truth = navigate(imu, begin, epoch_s=1.0, vertical=HOLD)
    u = (error_states(truth, history)[em.THETA] - theta) / 60.0
    assert u[0] == pytest.approx(eps_N * np.cos(turn) - eps_E * np.sin(turn), abs=0.01 * BIAS)
    assert u[1] == pytest.approx(
        eps_N * np.sin(turn) + eps_E * (np.cos(turn) - 1.0), abs=0.01 * BIAS
    )


def rolled(aligned_deg, heading_deg, duration_s=190.0):
    """Aligned on a heading with an east bias there, then straight at 10 m/s on another: computed
    minus true.

    Returns cross-track z and along-track velocity errors in body axes, and the cross-track error in
    NED.
    """
    H1, H = aligned_deg * DEG, heading_deg * DEG
    gyro = east_at(H1)
    begin = start(H, SPEED)
    imu = straight_roll(begin, duration_s=duration_s)
    errors = Errors(gyro=gyro, theta=gyrocompass_errors(gyro, (0, 0, 0), H1))
    computed = run_errors(imu, begin, errors, epoch_s=1.0, vertical=HOLD)
    truth = navigate(imu, begin, epoch_s=1.0, vertical=HOLD)
    # the log is a straight taxi
    assert np.abs(truth.v_n_m_s[:, :2] - begin.v_n_m_s[:2]).max() < 0.02 * ONE_MM_S
    body = computed.C_nb[-1].T @ computed.v_n_m_s[-1] - truth.C_nb[-1].T @ truth.v_n_m_s[-1]
    cross_n = [-np.sin(H), np.cos(H)] @ (computed.v_n_m_s[-1] - truth.v_n_m_s[-1])[:2]
    return body[1], body[0], cross_n


def test_straight_taxi_does_not_show_the_heading_error_in_body_axes():
    """psi = -0.94 mrad, 10 m/s, 180 s: NED cross-track error -9.40 mm/s = psi V, body-lateral below
    0.1 mm/s (6.5).
    """
    z, _, cross_n = rolled(0.0, 0.0, 180.0)
    assert cross_n == pytest.approx(-9.40 * ONE_MM_S, abs=0.1 * ONE_MM_S)
    assert abs(z) < 0.1 * ONE_MM_S


@pytest.mark.parametrize(
    ("aligned_deg", "heading_deg", "z_mm_s"),
    [(0, 90, -8.58), (-90, 90, -17.2), (0, 45, -6.07), (0, 180, 0.0), (30, 150, 0.0)],
)
def test_cross_track_velocity_after_a_turn(aligned_deg, heading_deg, z_mm_s):
    """z = -g eps (sinH - sinH1) t^2 / 2, along track +g eps (cosH - cosH1) t^2 / 2 (6.5)."""
    z, along, _ = rolled(aligned_deg, heading_deg)
    sines = np.sin(heading_deg * DEG) - np.sin(aligned_deg * DEG)
    cosines = np.cos(heading_deg * DEG) - np.cos(aligned_deg * DEG)
    assert z / ONE_MM_S == pytest.approx(z_mm_s, abs=0.25)
    assert z == pytest.approx(-0.5 * G * BIAS * sines * 190.0**2, abs=0.25 * ONE_MM_S)
    assert along == pytest.approx(0.5 * G * BIAS * cosines * 190.0**2, abs=0.35 * ONE_MM_S)
