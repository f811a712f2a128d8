"""The error filter: clones and assigned states with covariances worked by hand, static bins, gate,
invariants.
"""

from dataclasses import replace

import numpy as np
import pytest

from ins import earth, kalman
from ins.attitude import dcm_from_euler
from ins.estimation import error_model as em
from ins.estimation import kernel as fk
from ins.estimation import states
from ins.estimation.error_filter import GATE_SIGMA, ErrorFilter
from ins.estimation.tape import INPUTS, Tape
from ins.filters import states as aided
from ins.units import DEG
from tests.ins.filter_steps import advance, dense, driven, measure, only, steps_of

NOISE = em.ProcessNoise(
    arw=6e-7, vrw=1e-4, accel_rrw=3e-7, yaw_creep=1e-7, lateral_rms=0.03, lateral_time_s=2.0
)
DOWN = em.THETA.stop - 1
CLONE_DOWN = em.THETA_CLONE.stop - 1
NOT_STATES = ("CORE", "BASE")
STATE_NAMES = [name for name in vars(states) if name.isupper() and name not in NOT_STATES]
AIDED_NOT_STATES = ("AIDED_MOTION", "AIDED_DRIVING", "AIDED_STATES", "READING_GYRO", "READ_AXIS")
AIDED_NAMES = [name for name in vars(aided) if name.isupper() and name not in AIDED_NOT_STATES]


def new_filter(bins=2, **sigma0):
    sigma = {"W": 0.05, "POS": 10.0, "THETA": 1e-3, "ACCEL": 5e-4, "KAPPA": 0.01, **sigma0}
    P = np.eye(3 * bins) * 1e-15 + np.kron(np.ones((bins, bins)), np.eye(3)) * 2e-15
    return ErrorFilter(sigma0=sigma, noise=NOISE, bias_mean=np.zeros(3 * bins), bias_covariance=P)


def clone(flt):
    tape = only()
    tape.clone(np.array([0]), em.THETA_CLONE)
    flt.run(tape)


def parked_step(dt_s=10.0, heading=0.4, speed=0.0, turn_rate=0.0):
    v_n = speed * np.array([np.cos(heading), np.sin(heading), 0.0])
    spin = earth.omega_ie_n(45 * DEG)
    return em.Step(
        dt_s=dt_s,
        C_nb=dcm_from_euler(0.0, 0.0, heading),
        v_n=v_n,
        omega_ie_n=spin,
        omega_en_n=earth.omega_en_n(45 * DEG, 0.0, v_n),
        gravity=9.806,
        radius_m=6.378e6,
        turn_rad=(spin[2] + turn_rate) * dt_s,
    )


def test_a_clone_is_the_state_itself_at_that_time():
    """Cov(clone, clone) = Cov(clone, theta) = Cov(theta, theta): no variance of the difference."""
    flt = new_filter()
    flt.x[em.THETA] = [1e-4, 2e-4, 3e-4]
    advance(flt, parked_step())
    clone(flt)
    assert np.array_equal(flt.x[em.THETA_CLONE], flt.x[em.THETA])
    theta = flt.P[em.THETA, em.THETA]
    assert flt.P[em.THETA_CLONE, em.THETA_CLONE] == pytest.approx(theta, abs=0)
    assert flt.P[em.THETA_CLONE, em.THETA] == pytest.approx(theta, abs=0)
    assert flt.P[em.THETA_CLONE, em.POS] == pytest.approx(flt.P[em.THETA, em.POS], abs=0)
    # made at the start
    assert not flt.P[em.THETA_START, em.THETA_START] == pytest.approx(theta, abs=1e-20)


def test_a_clone_stands_still_and_learns_from_what_follows():
    flt = new_filter()
    before = flt.P[em.THETA_START, em.THETA_START].copy()
    for _ in range(30):
        advance(flt, parked_step())
    # no noise, no motion
    assert flt.P[em.THETA_START, em.THETA_START] == pytest.approx(before, abs=0)
    measure(flt, "survey", 2e-4, [{DOWN: 1.0}], 1e-12, 300.0)
    start_down = em.THETA_START.stop - 1
    assert flt.x[start_down] == pytest.approx(2e-4, rel=0.05)
    assert flt.P[start_down, start_down] < 0.1 * before[2, 2]


def test_assign_by_hand():
    """x_k = a x_i + b x_j + noise: variance a^2 P_ii + 2 a b P_ij + b^2 P_jj + sigma^2."""
    flt = new_filter()
    rng = np.random.default_rng(3)
    A = rng.standard_normal((flt.x.size, flt.x.size))
    flt.P, flt.x = A @ A.T, rng.standard_normal(flt.x.size)
    P, x, i, j = flt.P.copy(), flt.x.copy(), DOWN, em.POS.start + 1
    tape = only()
    tape.assign(np.array([0]), em.YAW, {i: -2.0, j: 0.5}, 0.3**2)
    flt.run(tape)
    assert flt.x[em.YAW] == pytest.approx(-2.0 * x[i] + 0.5 * x[j])
    assert flt.P[em.YAW, em.YAW] == pytest.approx(4 * P[i, i] - 2 * P[i, j] + 0.25 * P[j, j] + 0.09)
    assert flt.P[em.YAW, em.KAPPA] == pytest.approx(-2.0 * P[i, em.KAPPA] + 0.5 * P[j, em.KAPPA])
    others = np.delete(np.arange(flt.x.size), em.YAW)
    rounding = 1e-12 * np.abs(P).max()  # of elements that happen to be near zero
    kept = pytest.approx(P[np.ix_(others, others)], rel=1e-9, abs=rounding)
    assert flt.P[np.ix_(others, others)] == kept


def test_a_fresh_prior_is_independent():
    flt = new_filter()
    for _ in range(3):
        advance(flt, parked_step())
    flt.widen_prior(DOWN, 0.05)
    assert flt.P[DOWN, DOWN] == pytest.approx(0.05**2)
    assert np.count_nonzero(flt.P[DOWN]) == 1
    assert flt.x[DOWN] == 0.0


def test_bins_are_static_and_only_their_own_drives_the_step():
    flt = new_filter(bins=3)
    bias = em.BASE + np.arange(9)
    prior = flt.P[np.ix_(bias, bias)].copy()
    flt.x[em.BASE + 3 : em.BASE + 6] = [1e-7, 0.0, 0.0]  # bin 1, x
    advance(flt, parked_step())
    assert np.abs(flt.x[em.THETA]).max() == 0.0
    advance(flt, parked_step(), 1)
    assert flt.x[em.THETA][:2] == pytest.approx(
        1e-6 * np.array([np.cos(0.4), np.sin(0.4)]), rel=1e-3
    )
    assert flt.P[np.ix_(bias, bias)] == pytest.approx(prior, abs=0)  # exactly


def test_a_bin_learns_through_its_correlation():
    """Bin 0 measured exactly: bin 1, sharing 2/3 of the variance, keeps 1 - (2/3)^2 of it."""
    flt = new_filter(bins=2)
    measure(flt, "bias", 1e-8, [{em.BASE: 1.0}], 1e-24)
    assert flt.x[em.BASE + 3] == pytest.approx(2 / 3 * 1e-8, rel=1e-6)
    assert flt.P[em.BASE + 3, em.BASE + 3] == pytest.approx((1 - 4 / 9) * 3e-15, rel=1e-6)


@pytest.mark.parametrize(
    ("sigmas", "used"), [(GATE_SIGMA - 0.01, True), (GATE_SIGMA + 0.01, False)]
)
def test_gate_at_six_sigmas_of_the_innovation(sigmas, used):
    flt = new_filter()
    x = flt.x.copy()
    z = sigmas * np.hypot(0.01, 0.01)
    assert measure(flt, "lateral", z, [{em.KAPPA: 1.0}], 0.01**2, 12.0, gate=GATE_SIGMA) is used
    assert flt.tally.rejected == ([] if used else [(12.0, "lateral")])
    assert np.array_equal(flt.x, x) is not used
    assert bool(flt.P[em.KAPPA, em.KAPPA] < 0.9e-4) is used
    assert flt.tally.dof == ({"lateral": 1} if used else {})
    assert measure(flt, "lateral", z, [{em.KAPPA: 1.0}], 0.01**2, 13.0)


def test_one_row_beyond_the_gate_leaves_the_whole_measurement_out():
    flt = new_filter()
    rows = [{em.W.start: 1.0}, {em.W.start + 1: 1.0}]
    assert not measure(flt, "gnss", [0.0, 1.0], rows, [1e-4, 1e-4], gate=GATE_SIGMA)
    assert flt.P[em.W.start, em.W.start] == pytest.approx(0.05**2)


def test_tally_by_kind():
    flt = new_filter()
    for value in (0.03, -0.02):
        measure(
            flt,
            "still",
            [value, 0.0],
            [{em.W.start: 1.0}, {em.W.start + 1: 1.0}],
            [1e-4, 1e-4],
            1.0,
        )
    assert flt.tally.dof["still"] == 4
    assert len(flt.tally.normalised["still"]) == 2
    assert flt.tally.nis["still"] == pytest.approx(
        sum(float(v @ v) for v in flt.tally.normalised["still"])
    )


def test_heading_gain_is_booked_to_the_kind_that_gave_it():
    """ln of the variance ratio of the cloned heading: kinds add up, none before the clone
    exists.
    """
    flt = new_filter()
    measure(flt, "survey", 0.0, [{DOWN: 1.0}], 1e-6)
    assert flt.tally.heading_gain == {}
    clone(flt)
    before = flt.P[CLONE_DOWN, CLONE_DOWN]
    measure(flt, "gnss", 0.0, [{DOWN: 1.0}], before, 1.0)  # halves the variance
    measure(flt, "lateral", 0.0, [{em.KAPPA: 1.0}], 1e-6, 2.0)
    assert flt.tally.heading_gain["gnss"] == pytest.approx(np.log(2.0))
    assert flt.tally.heading_gain["lateral"] == pytest.approx(0.0, abs=1e-12)


def test_lost_digits_are_an_error_not_a_result():
    flt = new_filter()
    flt.P[em.KAPPA, em.KAPPA] = -1e-3
    with pytest.raises(ArithmeticError, match=r"7\.0 s"):
        measure(flt, "lateral", 0.0, [{em.KAPPA: 1.0}], 1e-6, 7.0)


def test_a_value_that_is_not_finite_is_an_error_with_its_time():
    with pytest.raises(ValueError, match=r"gnss at 7\.0 s: .* not finite"):
        measure(new_filter(), "gnss", np.nan, [{em.KAPPA: 1.0}], 1e-6, 7.0)
    with pytest.raises(ValueError, match=r"bin 2.*2"):
        advance(new_filter(bins=2), parked_step(), 2)


ONE, ROW = np.array([0]), {em.KAPPA: 1.0}


@pytest.mark.parametrize(
    "lay_down",
    [
        lambda tape: tape.measure("two", ONE, [0.0, 0.0], [ROW], [1.0, 1.0]),
        lambda tape: tape.measure("two", ONE, [0.0, 0.0], [ROW, ROW], [1.0]),
        lambda tape: tape.measure("before", -1 - ONE, [0.0], [ROW], [1.0]),
        lambda tape: tape.measure("none", ONE, [0.0], [{-1: 1.0}], [1.0]),
        lambda tape: tape.drive(em.BASE, INPUTS, 1.0),
        lambda tape: tape.drive(em.BASE, -1, 1.0),
        lambda tape: tape.compiled().under(np.ones(7), {}),
    ],
)
def test_what_the_kernel_would_read_beyond_its_arrays_is_refused(lay_down):
    with pytest.raises(ValueError):
        lay_down(only())


def test_a_step_a_shift_or_a_bin_that_is_none_is_refused():
    flt, steps = new_filter(), steps_of(parked_step(), 3)
    beyond = Tape(steps)
    beyond.measure("beyond", np.array([3]), [0.0], [ROW], [1.0])
    with pytest.raises(IndexError):
        flt.run(beyond)
    with pytest.raises(ValueError):
        flt.run(Tape(replace(steps, shift=np.zeros((2, 9)))))
    with pytest.raises(ValueError):
        flt.run(Tape(replace(steps, bin_index=np.array([0, 0, -1]))))


def test_parked_lateral_velocity_is_a_fresh_draw_at_every_step():
    flt = new_filter()
    advance(flt, parked_step())
    assert flt.P[em.LATERAL, em.LATERAL] == pytest.approx(NOISE.lateral_rms**2)
    assert np.count_nonzero(flt.P[em.LATERAL]) == 1


def test_a_jolt_widens_the_parked_heading_only():
    quiet, bumped = new_filter(), new_filter()
    advance(quiet, parked_step())
    advance(bumped, parked_step(), extra_yaw_rad=2e-5)
    difference = bumped.P - quiet.P
    assert difference[em.YAW, em.YAW] == pytest.approx(4e-10)
    assert np.count_nonzero(difference) == 1


def test_displacement_is_kept_only_where_asked():
    """Velocity sigma 0.05 m/s alone: way over 20 s against way over 10 s, 1 and 0.5 m."""
    kept, fresh = (new_filter(POS=0.0, THETA=0.0, ACCEL=0.0) for _ in range(2))
    for flt, keep in ((kept, True), (fresh, False)):
        advance(flt, parked_step())
        advance(flt, parked_step(), keep=keep)
    assert np.sqrt(kept.P[em.S.start, em.S.start]) == pytest.approx(1.0, rel=1e-3)
    assert np.sqrt(fresh.P[em.S.start, em.S.start]) == pytest.approx(0.5, rel=1e-3)


def test_covariance_stays_symmetric_and_positive_over_an_hour_and_a_taxi():
    """An hour of 10 s steps parked, a turn, 200 s of rolling by the second, all kinds of rows."""
    flt = new_filter(bins=3)
    rng = np.random.default_rng(5)
    lowest = []
    for k in range(560):
        rolling = k >= 360
        step = parked_step(1.0, 0.4 + 0.01 * (k - 360), 10.0, 0.01) if rolling else parked_step()
        advance(flt, step, k // 200, rolling=rolling, keep=not rolling and k % 3 > 0)
        entries = {em.S.start + 1: 1.0, em.KAPPA: 10.0} if rolling else {em.S.start: 1.0}
        z = 1e-3 * rng.standard_normal(1)
        measure(flt, "row", z, [entries], 1e-6, 10.0 * k)
        assert np.array_equal(flt.P, flt.P.T)
        sigma = np.sqrt(np.maximum(np.diag(flt.P), 1e-40))
        lowest.append(np.linalg.eigvalsh(flt.P / np.outer(sigma, sigma))[0])
    assert min(lowest) > -1e-9


def test_layouts_leave_no_gap_and_share_no_state():
    of_errors = [value for name, value in vars(states).items() if name in STATE_NAMES]
    of_aided = [value for name, value in vars(aided).items() if name in AIDED_NAMES]
    for parts, count in ((of_errors, states.BASE), (of_aided, aided.AIDED_MOTION)):
        taken = [np.atleast_1d(np.arange(count)[part]) for part in parts]
        assert sorted(np.concatenate(taken)) == list(range(count))


def test_the_core_order_of_the_kernel_is_that_of_the_layout():
    level = [em.W, em.POS, em.THETA, em.S]
    core = [k for part in level for k in range(part.start, part.stop)]
    assert sorted([*core, em.W_DOWN, em.POS_DOWN, em.LATERAL]) == list(range(fk.CORE))
    assert (fk.W, fk.POS, fk.THETA, fk.S) == (em.W.start, em.POS.start, em.THETA.start, em.S.start)
    assert em.moving(level=True).tolist() == sorted([*core, em.LATERAL])
    assert em.moving(level=False).tolist() == list(range(fk.CORE))


def beside_a_taxi(size):
    """All states but what a taxi may have beyond what is declared."""
    return np.setdiff1d(np.arange(size), np.arange(em.WIND.start, em.BASE))


def with_random_errors(flt, rng):
    states = beside_a_taxi(flt.x.size)
    flt.x[states] = np.sqrt(np.diag(flt.P)[states]) * rng.standard_normal(states.size)
    return flt


def random_program(rng, count=40, bins=3):
    """Parked and rolling steps on all headings with random sparse measurements, and the same as
    dense matrices. What a taxi may have beyond what is declared rests as crab and arms do; its
    sigmas of meters and hundredths would only decide the rounding.
    """
    known = [em.W_DOWN, em.POS_DOWN, em.ACCEL_Z]  # to be zero: a level filter has no errors there
    dense_steps, measured = [], np.setdiff1d(beside_a_taxi(em.BASE + 3 * bins), known)
    for _ in range(count):
        rolling = bool(rng.random() < 0.5)
        keep = bool(not rolling and rng.random() < 0.5)
        step = parked_step(
            rng.uniform(0.5, 10.0),
            rng.uniform(0, 6),
            rng.uniform(0, 12) * rolling,
            rng.uniform(-0.1, 0.1),
        )
        rows = []
        for _ in range(rng.integers(0, 3)):
            states = rng.choice(measured, size=4, replace=False)
            rows.append(
                (
                    dict(zip(states.tolist(), rng.standard_normal(4))),
                    rng.standard_normal() * 1e-3,
                    1e-6,
                )
            )
        dense_steps.append((step, int(rng.integers(0, bins)), rolling, keep, rows))
    return dense_steps


def by_filterpy(flt, dense_steps):
    """The same steps through ins.kalman, that is filterpy."""
    x, P = flt.x.copy(), flt.P.copy()
    n, nis = x.size, []
    for step, bin_index, rolling, keep, rows in dense_steps:
        Phi, Gamma, Q = em.discretize(step, NOISE, rolling=rolling, keep_displacement=keep)
        F, Q_full, column = np.eye(n), np.zeros((n, n)), em.BASE + 3 * bin_index
        F[: em.BASE, : em.BASE], F[: em.BASE, column : column + 3] = Phi, Gamma[:, :3]
        Q_full[: em.BASE, : em.BASE] = Q
        x, P = kalman.predict(x, P, F, Q_full)
        for row, z, variance in rows:
            x, P, seen = kalman.update(
                x, P, np.array([z]), dense(row, n)[None], np.array([[variance]])
            )
            nis.append(seen.nis)
    return x, P, nis


@pytest.mark.parametrize("seed", range(5))
def test_the_compiled_loop_is_filterpy_on_the_same_steps(seed):
    """State in sigmas, covariance as correlations, NIS: to 1e-12 of their size (1e-9 for what 40
    updates amplify).
    """
    rng = np.random.default_rng(seed)
    flt, dense_steps = new_filter(bins=3), random_program(rng)
    with_random_errors(flt, rng)
    x, P, nis = by_filterpy(flt, dense_steps)
    for k, (step, bin_index, rolling, keep, rows) in enumerate(dense_steps):
        tape = driven(
            steps_of(step, bin_index=bin_index, rolling=rolling, keep=keep, end_s=float(k))
        )
        for row, z, variance in rows:
            tape.measure("row", np.array([0]), [z], [row], [variance])
        flt.run(tape)
    sigma = np.sqrt(np.maximum(np.diag(P), 1e-40))
    assert np.abs((flt.P - P) / np.outer(sigma, sigma)).max() < 1e-9
    assert np.abs((flt.x - x) / sigma).max() < 1e-9
    assert flt.tally.nis["row"] == pytest.approx(sum(nis), rel=1e-9)


def test_a_whole_program_is_its_steps_one_by_one():
    """In the order of the steps, and within a step in the order they were written."""
    whole, single = new_filter(), new_filter()
    step, z = parked_step(speed=3.0), np.array([1e-3, -2e-3, 3e-3])
    tape = driven(steps_of(step, 3, rolling=True, moving=True))
    tape.measure(
        "lateral",
        np.arange(3),
        [z],
        [{em.S.start + 1: 1.0, em.KAPPA: np.array([1.0, 2.0, 3.0])}],
        [1e-6],
    )
    tape.measure("odometer", np.array([1]), [5e-3], [{em.S.start: 1.0}], [1e-4])
    whole.run(tape)
    for k in range(3):
        one = driven(steps_of(step, rolling=True, moving=True))
        one.measure(
            "lateral", np.array([0]), [z[k]], [{em.S.start + 1: 1.0, em.KAPPA: k + 1.0}], [1e-6]
        )
        if k == 1:
            one.measure("odometer", np.array([0]), [5e-3], [{em.S.start: 1.0}], [1e-4])
        single.run(one)
    assert np.array_equal(whole.P, single.P)
    assert np.array_equal(whole.x, single.x)
    assert whole.tally.nis == pytest.approx(single.tally.nis)


def test_a_jump_widens_velocity_or_attitude():
    quiet, jumped = new_filter(), new_filter()
    advance(quiet, parked_step())
    advance(jumped, parked_step(), jump_w=0.25, jump_theta=1e-6)
    added = np.diag(jumped.P - quiet.P)
    assert added[em.W] == pytest.approx(0.25)
    assert added[em.THETA] == pytest.approx(1e-6)
    assert np.count_nonzero(np.abs(added) > 1e-12) == 5


def test_moving_steps_take_the_velocity_error_off():
    """5 m/s east computed of which 2 m/s are error: the position rows see theta x (3 m/s)."""
    flt, exact = new_filter(), new_filter()
    for f in (flt, exact):
        f.x[em.W.start + 1], f.x[DOWN] = 2.0, 1e-3
    step = parked_step(1.0, heading=np.pi / 2, speed=5.0)
    advance(flt, step, rolling=True, moving=True)
    advance(exact, parked_step(1.0, heading=np.pi / 2, speed=3.0), rolling=True)
    assert flt.x[em.POS] == pytest.approx(exact.x[em.POS], rel=1e-9)
    assert flt.x[em.POS.start] == pytest.approx(-3e-3, rel=0.05)


def test_filtered_bins_are_those_at_the_end_of_their_time():
    flt = new_filter(bins=2)
    advance(flt, parked_step(), 0)
    measure(flt, "bias", 1e-8, [{em.BASE: 1.0}], 1e-16)
    at_end = flt.P[em.BASE, em.BASE]
    advance(flt, parked_step(), 1)
    tape = driven(steps_of(parked_step(), bin_index=1))
    tape.measure("bias", np.array([0]), [1e-8], [{em.BASE + 3: 1.0}], [1e-16])
    flt.run(tape)
    assert flt.P[em.BASE, em.BASE] < at_end
    assert flt.filtered[0, 1, 0] == pytest.approx(at_end)
    assert flt.filtered[1, 1, 0] == flt.P[em.BASE + 3, em.BASE + 3]
