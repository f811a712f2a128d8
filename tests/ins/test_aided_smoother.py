"""The smoother of the aided filter: by hand, against the whole log solved at once, over seeds."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from ins.filters.aided_kernel import TAPE, TAPE_H, TAPE_K
from ins.filters.aided_smoother import smoothed
from ins.filters.aided_smoother_kernel import backward

from infield.aided.flight import aided_noise
from ins.earth import SEMI_MAJOR_AXIS_M
from ins.filters.aided_filter import AidedNavigator
from ins.filters.aided_records import AidedOptions, AidedStart
from ins.filters.aided_tape import TAPED_PHI
from ins.filters.states import (
    AIDED_ACCEL,
    AIDED_DEFLECTION,
    AIDED_GYRO,
    AIDED_SLOW_OTHER,
    AIDED_SLOW_POS,
    AIDED_SLOW_VEL,
    AIDED_STATES,
)
from ins.records import InputError
from ins.robust import chi2
from tests.infield.aided_cases import errors, flown, ideal, nees, twin_of
from tests.ins.test_aided_filter import ANTENNA, fixes_from, prior, truth_at

N = AIDED_STATES
QUIET = np.array(
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 200.0, 0.0, 3.0, 0.0, 0.0, 1e7]
)  # slow errors fade over 200 s, 3 s, the deflection of the vertical over 10 000 km
HOLE_S = 300.0, 360.0


def went_back(steps_s, phis, lines, ends, P_rows):
    """Errors (rows, 15) and covariances of a tape that puts out a row at each step."""
    lam, Lam = np.zeros(N), np.zeros((N, N))
    x, P = np.zeros((len(P_rows), 15)), np.zeros((len(P_rows), 15, 15))
    emits = np.ones(len(ends), dtype=bool)
    backward(np.array(steps_s), phis, lines, np.array(ends), emits, P_rows, QUIET, lam, Lam, x, P)
    return x, P


def test_mean_of_two_fixes_worked_by_hand():
    """A place known to 1 m, which stands, and two fixes of 1 m. After the first its variance is
    1/2; the second, 0.9 m off that, has a residual of variance 3/2. Given both, the place at the
    first is off by 1/2 / (3/2) of 0.9 m, 0.3 m, and its variance is 1/3, the mean of three's.
    """
    still = np.zeros((2, *TAPED_PHI))
    still[:, :, :9] = np.eye(9)
    lines, P_rows = np.zeros((2, TAPE)), np.zeros((2, N, N))
    for k, (before, s, y) in enumerate(((1.0, 2.0, 0.4), (0.5, 1.5, 0.9))):
        lines[k, TAPE_H], lines[k, TAPE_K] = 1.0, before
        lines[k, TAPE_K + N :] = s, y
        P_rows[k, 0, 0] = before - before**2 / s
    x, P = went_back([1.0, 1.0], still, lines, [1, 2], P_rows)
    assert x[:, 0] == pytest.approx([0.3, 0.0])
    assert P[:, 0, 0] == pytest.approx([1.0 / 3.0, 1.0 / 3.0])


def test_adjoints_are_the_whole_log_solved_at_once():
    """Eight steps of random dynamics, noise and measurements, and a new beginning amid them:
    errors and covariances at every step are those of one Gaussian of all steps, conditioned on all
    measurements.
    """
    rng, steps, anew = np.random.default_rng(3), 8, 4
    phis = np.zeros((steps, *TAPED_PHI))
    phis[:, :, :9] = np.eye(9)
    phis += 0.2 * rng.standard_normal(phis.shape)
    root = rng.standard_normal((N, N))
    P = root @ root.T / N + np.eye(N)
    fade = np.ones(N)
    fade[AIDED_SLOW_POS] = fade[AIDED_SLOW_OTHER] = np.exp(-1.0 / 200.0)
    fade[AIDED_SLOW_VEL] = np.exp(-1.0 / 3.0)
    transitions, noises, rows, lines, ends, P_rows = [], [], [], [], [], []
    x, P_minus = np.zeros(N), P.copy()
    for k in range(steps):
        # the way of a step turns places by these two over Earth's radius, here by a tenth
        way_m = SEMI_MAJOR_AXIS_M * float(np.hypot(phis[k, 0, 2], phis[k, 1, 2]))
        fade[AIDED_DEFLECTION] = np.exp(-way_m / 1e7)
        F = np.diag(fade)
        F[: TAPED_PHI[0], : TAPED_PHI[1]] = phis[k]
        G = rng.standard_normal((N, 4))
        Q = 0.1 * G @ G.T
        P_minus = F @ P_minus @ F.T + Q
        if k == anew:  # of position, velocity: known to 2 m, 2 m/s and nothing of before
            begun = np.diag(np.concatenate([np.zeros(6), np.ones(N - 6)]))
            lines.append(np.zeros(TAPE))
            P_minus = begun @ P_minus @ begun + 4.0 * (np.eye(N) - begun)
            F, Q = begun @ F, begun @ Q @ begun + 4.0 * (np.eye(N) - begun)
        transitions.append(F)
        noises.append(Q)
        H, r, y = rng.standard_normal(N), 0.5, rng.standard_normal()
        PH = P_minus @ H
        s = float(H @ PH + r)
        lines.append(np.concatenate([H, PH, [s, y]]))
        rows.append((k, H, r, y))
        P_minus = P_minus - np.outer(PH, PH) / s
        ends.append(len(lines))
        P_rows.append(P_minus.copy())
    found, found_P = went_back(np.ones(steps), phis, np.array(lines), ends, np.array(P_rows))

    joint = np.zeros(((steps + 1) * N, (steps + 1) * N))
    joint[:N, :N] = P
    for k in range(steps):
        a, b = slice(k * N, (k + 1) * N), slice((k + 1) * N, (k + 2) * N)
        upto = slice(0, (k + 1) * N)
        joint[b, upto] = transitions[k] @ joint[a, upto]
        joint[upto, b] = joint[b, upto].T
        joint[b, b] = transitions[k] @ joint[a, a] @ transitions[k].T + noises[k]
    seen = np.zeros((steps, joint.shape[0]))
    for k, H, _, _ in rows:
        seen[k, (k + 1) * N : (k + 2) * N] = H
    S = seen @ joint @ seen.T + np.diag([r for _, _, r, _ in rows])
    # the innovations, made white one after the other, are the residuals over their variances
    white = np.linalg.cholesky(S)
    residuals = np.array([line[-1] / np.sqrt(line[-2]) for line in lines if line[-2] > 0])
    measured = white @ residuals
    gain = joint @ seen.T @ np.linalg.inv(S)
    mean, left = gain @ measured, joint - gain @ seen @ joint
    x = np.zeros(N)
    for k in range(steps):  # less what the filter had taken off by then
        x = transitions[k] @ x
        s, y = lines[ends[k] - 1][-2:]
        x = x + lines[ends[k] - 1][TAPE_K : TAPE_K + N] * y / s
        b = slice((k + 1) * N, (k + 1) * N + 15)
        np.testing.assert_allclose(found[k], (mean[b] - x[:15]), rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(found_P[k], left[b, b], rtol=1e-7, atol=1e-9)


def inverse(A):
    """Of a positive definite matrix in long doubles, by Gauss and Jordan."""
    rows = np.hstack([A, np.eye(len(A), dtype=np.longdouble)])
    for k in range(len(A)):
        rows[k] /= rows[k, k]
        others = [j for j in range(len(A)) if j != k]
        rows[others] -= np.outer(rows[others, k], rows[k])
    return rows[:, len(A) :]


def test_an_outage_between_fixes_of_a_centimetre_keeps_its_digits():
    """Place, speed and tilt of one axis, fixes of 5 mm but for 60 s, in which a tilt that walks by
    3 mrad in a second makes the place unknown by 250 m: its variance is 10^9 times that of fixes.
    Against (P^-1 + J)^-1, with J what all later fixes say, in 64 bits of mantissa.
    """
    steps, r, q = 160, np.longdouble(0.005**2), np.longdouble(0.003**2)
    at = (0, 3, 6)
    F = np.array([[1, 1, 5], [0, 1, 10], [0, 0, 1]], dtype=np.longdouble)
    seen = [k for k in range(steps) if not 50 <= k < 110]
    phis = np.zeros((steps, *TAPED_PHI))
    phis[:, :, :9] = np.eye(9)
    phis[np.ix_(range(steps), at, at)] = F
    P = np.diag(np.array([1.0, 1.0, 0.01], dtype=np.longdouble))
    lines, ends, filtered = [], [], []
    for k in range(steps):
        P = F @ P @ F.T + np.diag(np.array([0, 0, q]))
        if k in seen:
            line, gain = np.zeros(TAPE), P[:, 0]
            line[0] = 1.0
            line[[TAPE_K + j for j in at]] = gain
            line[-2] = P[0, 0] + r
            lines.append(line)
            known = np.eye(3, dtype=np.longdouble)
            known[:, 0] -= gain / (P[0, 0] + r)
            P = known @ P @ known.T + r * np.outer(gain, gain) / (P[0, 0] + r) ** 2
        ends.append(len(lines))
        filtered.append(P)
    P_rows = np.zeros((steps, N, N))
    P_rows[np.ix_(range(steps), at, at)] = np.array(filtered)
    _, found = went_back(np.ones(steps), phis, np.array(lines), ends, P_rows)
    J = np.zeros((3, 3), dtype=np.longdouble)
    for k in range(steps - 1, -1, -1):
        wanted = inverse(inverse(filtered[k]) + J)
        assert found[k, 0, 0] == pytest.approx(float(wanted[0, 0]), rel=1e-3), k
        J[0, 0] += 1 / r if k in seen else 0
        J = F.T @ (J - np.outer(J[:, 2], J[2]) * (q / (1 + q * J[2, 2]))) @ F


def flight(technology: str, seed: int, *, taped: bool = True, pieces: int = 1):
    """A simulated flight without fixes in HOLE_S, its filter, where the start is off as it says."""
    twin = twin_of(technology, flicker=False)
    made, sigma = flown(ideal(), twin, seed, technology), prior(twin)
    sigma[8] = 0.01  # of the heading: what the linearisation of one pass is good for
    error = sigma * np.random.default_rng([seed, 9]).standard_normal(15)
    error[AIDED_GYRO] = error[AIDED_ACCEL] = 0.0  # the turn-on of the unit is that error
    start = AidedStart(
        state=truth_at(made, error=error),
        gyro_bias_rad_s=np.zeros(3),
        accel_bias_m_s2=np.zeros(3),
        covariance=np.diag(sigma**2),
    )
    fixes = fixes_from(made, twin)
    hole = (fixes.time_s > HOLE_S[0]) & (fixes.time_s < HOLE_S[1])
    gone = np.where(hole[:, None], np.nan, 0.0)
    fixes = replace(fixes, r_e_m=fixes.r_e_m + gone, v_n_m_s=fixes.v_n_m_s + gone)
    options = AidedOptions(keep_covariance=True, keep_tape=taped)
    navigator = AidedNavigator(
        start, aided_noise(twin, technology), fixes, antenna=ANTENNA, options=options
    )
    edges = np.linspace(0.0, made.run.imu.end_s + 1.0, pieces + 1)
    for a, b in itertools.pairwise(edges):
        navigator.feed(made.run.imu.between(float(a), float(b)))
    return made, navigator


def test_tape_changes_nothing_and_may_be_cut():
    """The filter's rows are the same bits with a tape; a log in three pieces is smoothed alike."""
    _, plain = flight("mems", 1, taped=False)
    _, taped = flight("mems", 1)
    _, cut = flight("mems", 1, pieces=3)
    history = taped.finish()
    assert np.array_equal(plain.finish().C_nb, history.C_nb)
    one, _, _ = smoothed(history, taped.tape)
    three, _, _ = smoothed(cut.finish(), cut.tape)
    np.testing.assert_allclose(three.lat_rad, one.lat_rad, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(three.variance, one.variance, rtol=1e-9)
    with pytest.raises(InputError, match="keep_tape"):
        _ = plain.tape


@pytest.mark.parametrize("technology", ["mems", "rlg"])
@pytest.mark.parametrize("flights", [6, pytest.param(60, marks=pytest.mark.slow)])
def test_smoothed_errors_are_those_of_the_sigmas(technology, flights):
    """NEES of all 15 states at the start, before, within and after a minute without fixes: 99.9 %
    band. No sigma is wider than the filter's, and level errors in that minute are a tenth of the
    filter's at most (MEMS).
    """
    at, found, level = [5, 150, 290, 330, 480], [], []
    for seed in range(flights):
        made, navigator = flight(technology, seed)
        history = navigator.finish()
        best, _, _ = smoothed(history, navigator.tape)
        found.append(nees(made, best)[at])
        assert (best.variance <= history.variance * (1.0 + 1e-6)).all()
        hole = (history.time_s > HOLE_S[0]) & (history.time_s < HOLE_S[1])
        level.append([np.mean(errors(made, h)[hole, :2] ** 2) for h in (history, best)])
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 15 * flights) / (15 * flights)
    assert low < np.mean(found) < high
    was, now = np.sqrt(np.mean(level, axis=0))
    assert now < (0.1 if technology == "mems" else 0.6) * was
