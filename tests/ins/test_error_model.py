"""F, B, Phi, Gamma, Q of the error model against the nonlinear navigation, scipy and by hand."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from ins import earth
from ins.attitude import dcm_from_euler, skew
from ins.estimation import error_model as em
from ins.records import NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG, DEG_PER_HOUR
from tests.ins.nonlinear_errors import STATES, Errors, constant_imu, error_states, run_errors

LAT = 50 * DEG
CASES = ("parked", "rolling", "turning", "tilted turn")
# of the perturbations
SIZE = {"w": 0.1, "p": 800.0, "theta": 1e-3, "accel": 1e-2, "gyro": 1e-5, "scale": 1e-3}
ROWS = {"W": slice(0, 3), "POS": slice(3, 6), "THETA": slice(6, 9), "S": slice(9, 11)}
COLUMNS = {
    "W": (0, 1, 2),
    "POS": (3, 4, 5),
    "THETA": (6, 7, 8),
    "ACCEL": (9, 10, 11),
    "SCALE_Z": (12,),
    "BIAS": (13, 14, 15),
}
# one radius for both curvatures: (a - R_meridian) / a at 50 deg, with its height
ROUND_EARTH = 5e-3
# what 1 of each state does to 1 of each row in a second, at most: blocks are compared to 1e-3 of
# it, zero blocks too
INSTANT_S = 0.02
TERM = {"W": 9.8, "POS": 12.0, "THETA": 1.0, "S": 1.0}


def start_of(case):
    speed = 0.0 if case == "parked" else 12.0
    roll, pitch = (0.03, -0.05) if case == "tilted turn" else (0.0, 0.0)
    heading = 0.7
    v_n = speed * np.array([np.cos(heading), np.sin(heading), 0.0])
    site = Site(lat_rad=LAT, lon_rad=0.2, height_m=100.0)
    return NavState(time_s=0.0, site=site, v_n_m_s=v_n, C_nb=dcm_from_euler(roll, pitch, heading))


@cache
def run_of(case, duration_s, dt=0.01):
    """Start, log and solution (the truth here) of a vehicle that turns at 0.2 rad/s."""
    start = start_of(case)
    turn = 0.2 if "turn" in case else 0.0
    g = float(earth.gravity_magnitude(LAT, 100.0))
    along = np.linalg.norm(start.v_n_m_s) * turn * np.array([-np.sin(0.7), np.cos(0.7), 0.0])
    rate_n = earth.omega_ie_n(LAT) + [0.0, 0.0, turn]
    imu = constant_imu(
        start.C_nb.T @ rate_n, start.C_nb.T @ (along - [0.0, 0.0, g]), duration_s=duration_s, dt=dt
    )
    return start, imu, navigate(imu, start, epoch_s=None)


def step_of(history):
    """The step of a whole history, as `alignment.navigation_filter.view_of` builds it."""
    dt = history.time_s[-1] - history.time_s[0]
    lat, height = float(history.lat_rad[-1]), float(history.height_m[-1])
    v_n = history.displacement_n_m.sum(axis=0) / dt
    return em.Step(
        dt_s=float(dt),
        C_nb=history.C_nb_dt.sum(axis=0) / dt,
        v_n=v_n,
        omega_ie_n=earth.omega_ie_n(lat),
        omega_en_n=earth.omega_en_n(lat, height, v_n),
        gravity=float(earth.gravity_magnitude(lat, height)),
        radius_m=earth.SEMI_MAJOR_AXIS_M + height,
        turn_rad=float(history.dtheta_b_rad[:, 2].sum()),
    )


@cache
def nonlinear_transition(case, duration_s, dt=0.01):
    """(11, 16): w, p, theta, S at the end against STATES at the start, by differences."""
    start, imu, truth = run_of(case, duration_s, dt)
    columns = []
    for state in STATES:
        size = SIZE[state.partition("_")[0]]
        ends = []
        for sign in (1.0, -1.0):
            computed = run_errors(imu, start, Errors.of(state, sign * size))
            S = (computed.displacement_b_m - truth.displacement_b_m).sum(axis=0)[:2]
            ends.append(np.concatenate([error_states(truth, computed), S]))
        columns.append((ends[0] - ends[1]) / (2.0 * size))
    return np.stack(columns, axis=1)


def model_matrix(F, B):
    """The same (11, 16) out of the model's F (42, 42) and B (42, 9)."""
    rows = np.arange(em.S.stop)
    columns = np.r_[em.W.start : em.THETA.stop, em.ACCEL, em.ACCEL_Z, em.SCALE_Z]
    return np.hstack([F[np.ix_(rows, columns)], B[rows, :3]])


def nonlinear_rates(case):
    """F by Richardson from the transitions over h and h/2: (4 Phi(h/2) - Phi(h) - 3 I) / h, error
    h^2 F^3 / 12.
    """
    start = np.eye(11, 16)
    start[9:] = 0.0
    whole = nonlinear_transition(case, INSTANT_S, 1e-3)
    half = nonlinear_transition(case, INSTANT_S / 2, 1e-3)
    return (4.0 * half - whole - 3.0 * start) / INSTANT_S


@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize("row", ROWS)
@pytest.mark.parametrize("case", CASES)
def test_block_of_F_is_the_derivative_of_the_nonlinear_navigation(case, row, column):
    start, _, truth = run_of(case, INSTANT_S, 1e-3)
    step = step_of(truth)
    instant = replace(  # F at the start, not the mean over the step
        step,
        C_nb=start.C_nb,
        v_n=start.v_n_m_s,
        omega_en_n=earth.omega_en_n(LAT, 100.0, start.v_n_m_s),
    )
    model = model_matrix(*em.system_matrix(instant, 2.0))[ROWS[row], COLUMNS[column]]
    measured = nonlinear_rates(case)[ROWS[row], COLUMNS[column]]
    # g/R is 1e-6 of the velocity rows' other terms: held to its own size
    if (row, column) == ("W", "POS"):
        assert measured == pytest.approx(
            model, abs=2.0 * ROUND_EARTH * step.gravity / step.radius_m
        )
        return
    allowed = 1e-3 * TERM[row] if column not in ("POS", "W") else 1e-5
    if (row, column) == ("W", "THETA") and case == "tilted turn":
        allowed += 12.0 * 0.2 * 0.06  # v_D' of a tilted turn
    assert measured == pytest.approx(model, abs=allowed)


@pytest.mark.parametrize(
    ("case", "dt_s"), [("parked", 1.0), ("parked", 10.0), ("rolling", 1.0), ("turning", 1.0)]
)
def test_discretized_step_is_the_nonlinear_step(case, dt_s):
    """Phi and Gamma with the step's means: seconds while rolling, up to 10 s parked."""
    _, _, truth = run_of(case, dt_s)
    noise = em.ProcessNoise(
        arw=0.0, vrw=0.0, accel_rrw=0.0, yaw_creep=0.0, lateral_rms=0.02, lateral_time_s=2.0
    )
    Phi, Gamma, _ = em.discretize(step_of(truth), noise, rolling=True, level=False)
    sizes = np.array([SIZE[state.partition("_")[0]] for state in STATES])
    model, measured = model_matrix(Phi, Gamma) * sizes, nonlinear_transition(case, dt_s) * sizes
    # the step's mean attitude: half its turn, 0.1 rad, on dt^2 terms
    part = 0.1 if case == "turning" else ROUND_EARTH
    for row, i in ROWS.items():
        whole = np.abs(measured[i]).max()
        for column, j in COLUMNS.items():
            block = np.abs(measured[i, j]).max()
            assert measured[i, j] == pytest.approx(model[i, j], abs=part * block + 1e-6 * whole), (
                row,
                column,
            )


def test_w_is_free_of_heading_and_of_the_specific_force():
    """The column of theta_D in w' is v x (omega_ie x theta): 5e-4 m/s^2 per rad at 10 m/s, no g, no
    acceleration.
    """
    for case in CASES:
        _, _, truth = run_of(case, 0.2)
        F, _ = em.system_matrix(step_of(truth), 2.0)
        assert np.abs(F[em.W, em.THETA.stop - 1]).max() < 12.5 * earth.EARTH_RATE_RAD_S


def test_nuisance_states_do_not_drive_the_navigation_errors():
    _, _, truth = run_of("turning", 0.2)
    F, B = em.system_matrix(step_of(truth), 2.0)
    for state in (
        em.KAPPA,
        em.LEVER_X,
        em.YAW,
        em.ODOMETER,
        em.CENTRE_LINE,
        em.THETA_START,
        em.THETA_CLONE,
        em.WIND,
        em.CRAB_TURN,
        em.CRAB_GUST,
        em.SLIP,
        em.WHEEL_Y,
        em.ODOMETER_DELAY,
        em.GNSS_ARM,
        em.GNSS_DELAY,
        em.GNSS_VELOCITY_DELAY,
        em.GNSS_SLOW_POS,
        em.GNSS_SLOW_VEL,
    ):
        assert not F[:, state].any()
        assert not F[state].any()
        assert not B[state].any()
    assert F[em.LATERAL, em.LATERAL] == -0.5
    assert F[em.S.stop - 1, em.LATERAL] == 1.0
    assert np.count_nonzero(F[:, em.LATERAL]) == 2


@pytest.mark.parametrize("case", CASES)
def test_a_given_height_leaves_no_error_down(case):
    """Level, the errors down stand still, and nothing of them reaches the others."""
    Phi, Gamma, Q = em.discretize(step_of(run_of(case, 1.0)[2]), NOISE, rolling=True)
    for state in (em.W_DOWN, em.POS_DOWN):
        others = np.arange(em.BASE) != state
        assert Phi[state, state] == 1.0
        assert not Phi[state, others].any()
        assert not Phi[others, state].any()
        assert not Gamma[state].any()
        assert not Q[state].any()


NOISE = em.ProcessNoise(
    arw=6e-7, vrw=1e-4, accel_rrw=3e-7, yaw_creep=1e-7, lateral_rms=0.03, lateral_time_s=2.0
)


@pytest.mark.parametrize(("case", "dt_s"), [("parked", 10.0), ("turning", 1.0)])
def test_phi_and_gamma_are_the_matrix_exponential(case, dt_s):
    """Third order in dt. Largest remainder: theta into p, (omega_s dt)^2 / 12 of g dt^2 / 2 =
    1.3e-5 at 10 s.

    Bias into S starts at dt^3: 1e-3 is left of it.
    A second of Gauss-Markov with 2 s leaves 0.5^3 / 24 = 0.5 %; a turn of 0.2 rad 0.2^3 / 24 of
    what it couples.
    """
    step = step_of(run_of(case, dt_s)[2])
    F, B = em.system_matrix(step, NOISE.lateral_time_s)
    Phi, Gamma, _ = em.discretize(step, NOISE, rolling=case != "parked", level=False)
    exact = expm(np.block([[F, B], [np.zeros((9, em.BASE + 9))]]) * dt_s)
    columns = np.setdiff1d(np.arange(em.BASE), [em.S.start, em.S.stop - 1, em.LATERAL])
    for row in ROWS:
        i = getattr(em, row)
        assert Phi[i, columns] == pytest.approx(
            exact[i, columns], abs=1e-4 * np.abs(exact[i, columns]).max()
        )
        for inputs in (slice(0, 3), slice(3, 6), slice(6, 9)):
            column = exact[i, em.BASE :][:, inputs]
            # of the exponential's rounding, where nothing drives
            allowed = 1e-3 * np.abs(column).max() + 1e-14
            assert Gamma[i, inputs] == pytest.approx(column, abs=allowed)
    if case != "parked":
        lateral = [em.LATERAL, em.S.stop - 1]
        assert Phi[lateral, em.LATERAL] == pytest.approx(exact[lateral, em.LATERAL], abs=6e-3)


def test_displacement_of_a_step_starts_at_zero():
    Phi, _, _ = em.discretize(step_of(run_of("turning", 1.0)[2]), NOISE, rolling=True)
    assert not Phi[:, em.S].any()


def van_loan(F, q, dt):
    """Exact Q of Van Loan (1978), IEEE Trans. Automatic Control 23(3), by scipy's matrix
    exponential.
    """
    n = len(F)
    M = expm(np.block([[-F, q], [np.zeros((n, n)), F.T]]) * dt)
    return M[n:, n:].T @ M[:n, n:]


def density(step, rolling):
    """Spectral density (42, 42) from what each noise is: gyro noise turns theta and, times v, w."""
    G = np.zeros((em.BASE, 3))
    G[em.THETA], G[: em.POS.start] = step.C_nb, skew(step.v_n) @ step.C_nb
    q = NOISE.arw**2 * (G @ G.T)
    for index, value in [
        (slice(em.W.start, em.W_DOWN + 1), NOISE.vrw),
        (em.ACCEL, NOISE.accel_rrw),
        (slice(em.YAW, em.YAW + 1), NOISE.yaw_creep),
    ]:
        q[index, index] += value**2 * np.eye(index.stop - index.start)
    if rolling:
        q[em.LATERAL, em.LATERAL] = 2.0 * NOISE.lateral_rms**2 / NOISE.lateral_time_s
    return q


@pytest.mark.parametrize(("case", "dt_s"), [("parked", 10.0), ("parked", 1.0), ("turning", 1.0)])
def test_process_noise_is_van_loans(case, dt_s):
    """Simpson's rule: exact to dt^3 terms. In units of each state's sigma: 1e-3, but S of angle
    noise (dt^7): 2 %.
    """
    step = step_of(run_of(case, dt_s)[2])
    F, _ = em.system_matrix(step, NOISE.lateral_time_s)
    rolling = case != "parked"
    if not rolling:
        F[:, em.LATERAL] = 0.0  # its Q stands for a fresh draw, tested below
    _, _, Q = em.discretize(step, NOISE, rolling=rolling, level=False)
    exact = van_loan(F, density(step, rolling), dt_s)
    Q[em.LATERAL, em.LATERAL] *= rolling
    sigma = np.sqrt(np.diag(exact))
    driven = sigma > 0
    scale = np.outer(sigma[driven], sigma[driven])
    error = np.abs(Q - exact)[np.ix_(driven, driven)] / scale
    assert np.array_equal(Q, Q.T) or np.abs(Q - Q.T).max() < 1e-18
    assert not Q[~driven].any()
    assert error.max() < 0.02


def test_parked_lateral_velocity_takes_no_part():
    _, _, Q = em.discretize(step_of(run_of("parked", 10.0)[2]), NOISE, rolling=False)
    Phi, _, _ = em.discretize(step_of(run_of("parked", 10.0)[2]), NOISE, rolling=False)
    assert not Phi[:, em.LATERAL].any()
    assert Q[em.LATERAL, em.LATERAL] == NOISE.lateral_rms**2
    assert not Q[em.LATERAL, : em.LATERAL].any()


def test_an_hour_of_steps_follows_the_nonlinear_solution():
    """0.01 deg/h on all three axes, parked: w of the linear steps within 0.5 % of 0.6 m/s."""
    bias = 0.01 * DEG_PER_HOUR * np.array([1.0, -0.7, 2.0])
    start, imu, _ = run_of("parked", 3600.0, 1.0)
    hold = VerticalChannel(mode="hold")
    truth = navigate(imu, start, epoch_s=10.0, vertical=hold)
    computed = run_errors(imu, start, Errors(gyro=tuple(bias)), epoch_s=10.0, vertical=hold)
    Phi, Gamma, _ = em.discretize(step_of(run_of("parked", 10.0)[2]), NOISE, rolling=False)
    x, worst = np.zeros(em.BASE), 0.0
    for row in range(1, 361):
        x = Phi @ x + Gamma[:, :3] @ bias
        errors = x[: em.THETA.stop] - error_states(truth, computed, row)
        worst = max(worst, np.abs(errors)[em.W].max())
    assert np.abs(computed.v_n_m_s[-1]).max() > 0.2
    assert worst < 0.005 * 0.6
