"""The error filter: clones and assigned states with covariances worked by hand, static bins, gate, invariants."""

import numpy as np
import pytest

from ins import earth
from ins import error_model as em
from ins.attitude import dcm_from_euler
from ins.error_filter import GATE_SIGMA, ErrorFilter
from ins.units import DEG

NOISE = em.ProcessNoise(arw=6e-7, vrw=1e-4, accel_rrw=3e-7, yaw_creep=1e-7, lateral_rms=0.03, lateral_time_s=2.0)
DOWN = em.THETA.stop - 1
CLONE_DOWN = em.THETA_CLONE.stop - 1


def new_filter(bins=2, **sigma0):
    sigma = {"W": 0.05, "POS": 10.0, "THETA": 1e-3, "ACCEL": 5e-4, "KAPPA": 0.01, **sigma0}
    P = np.eye(3 * bins) * 1e-15 + np.kron(np.ones((bins, bins)), np.eye(3)) * 2e-15
    return ErrorFilter(sigma0=sigma, noise=NOISE, bias_mean=np.zeros(3 * bins), bias_covariance=P)


def parked_step(dt_s=10.0, heading=0.4, speed=0.0, turn_rate=0.0):
    v_n = speed * np.array([np.cos(heading), np.sin(heading), 0.0])
    spin = earth.omega_ie_n(45 * DEG)
    return em.Step(
        dt_s=dt_s, C_nb=dcm_from_euler(0.0, 0.0, heading), v_n=v_n, omega_ie_n=spin,
        omega_en_n=earth.omega_en_n(45 * DEG, 0.0, v_n), gravity=9.806, radius_m=6.378e6,
        turn_rad=(spin[2] + turn_rate) * dt_s,
    )  # fmt: skip


def test_a_clone_is_the_state_itself_at_that_time():
    """Cov(clone, clone) = Cov(clone, theta) = Cov(theta, theta): their difference has no variance."""
    flt = new_filter()
    flt.x[em.THETA] = [1e-4, 2e-4, 3e-4]
    flt.advance(parked_step(), 0, rolling=False)
    flt.clone(em.THETA_CLONE)
    assert np.array_equal(flt.x[em.THETA_CLONE], flt.x[em.THETA])
    theta = flt.P[em.THETA, em.THETA]
    assert flt.P[em.THETA_CLONE, em.THETA_CLONE] == pytest.approx(theta, abs=0)
    assert flt.P[em.THETA_CLONE, em.THETA] == pytest.approx(theta, abs=0)
    assert flt.P[em.THETA_CLONE, em.POS] == pytest.approx(flt.P[em.THETA, em.POS], abs=0)
    assert not flt.P[em.THETA_START, em.THETA_START] == pytest.approx(theta, abs=1e-20)  # made at the start


def test_a_clone_stands_still_and_learns_from_what_follows():
    flt = new_filter()
    before = flt.P[em.THETA_START, em.THETA_START].copy()
    for _ in range(30):
        flt.advance(parked_step(), 0, rolling=False)
    assert flt.P[em.THETA_START, em.THETA_START] == pytest.approx(before, abs=0)  # no noise, no motion
    z, H = np.array([2e-4]), flt.row({DOWN: 1.0})[None]
    flt.measure("survey", z, H, np.array([[1e-12]]), 300.0)
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
    flt.assign(em.YAW, flt.row({i: -2.0, j: 0.5}), 0.3)
    assert flt.x[em.YAW] == pytest.approx(-2.0 * x[i] + 0.5 * x[j])
    assert flt.P[em.YAW, em.YAW] == pytest.approx(4 * P[i, i] - 2 * P[i, j] + 0.25 * P[j, j] + 0.09)
    assert flt.P[em.YAW, em.KAPPA] == pytest.approx(-2.0 * P[i, em.KAPPA] + 0.5 * P[j, em.KAPPA])
    others = np.delete(np.arange(flt.x.size), em.YAW)
    assert np.array_equal(flt.P[np.ix_(others, others)], P[np.ix_(others, others)])


def test_assign_with_a_zero_row_is_a_fresh_prior():
    flt = new_filter()
    for _ in range(3):
        flt.advance(parked_step(), 0, rolling=False)
    flt.assign(DOWN, np.zeros(flt.x.size), 0.05)
    assert flt.P[DOWN, DOWN] == pytest.approx(0.05**2)
    assert np.count_nonzero(flt.P[DOWN]) == 1
    assert flt.x[DOWN] == 0.0


def test_bins_are_static_and_only_their_own_drives_the_step():
    flt = new_filter(bins=3)
    bias = em.BASE + np.arange(9)
    prior = flt.P[np.ix_(bias, bias)].copy()
    flt.x[em.BASE + 3 : em.BASE + 6] = [1e-7, 0.0, 0.0]  # bin 1, x
    flt.advance(parked_step(), 0, rolling=False)
    assert np.abs(flt.x[em.THETA]).max() == 0.0
    flt.advance(parked_step(), 1, rolling=False)
    assert flt.x[em.THETA][:2] == pytest.approx(1e-6 * np.array([np.cos(0.4), np.sin(0.4)]), rel=1e-3)
    assert flt.P[np.ix_(bias, bias)] == pytest.approx(prior, abs=0)  # exactly


def test_a_bin_learns_through_its_correlation():
    """Bin 0 measured as good as exactly: bin 1, sharing 2/3 of the variance, keeps 1 - (2/3)^2 of it."""
    flt = new_filter(bins=2)
    row = flt.row({em.BASE: 1.0})[None]
    flt.measure("bias", np.array([1e-8]), row, np.array([[1e-24]]), 0.0)
    assert flt.x[em.BASE + 3] == pytest.approx(2 / 3 * 1e-8, rel=1e-6)
    assert flt.P[em.BASE + 3, em.BASE + 3] == pytest.approx((1 - 4 / 9) * 3e-15, rel=1e-6)


@pytest.mark.parametrize(("sigmas", "used"), [(GATE_SIGMA - 0.01, True), (GATE_SIGMA + 0.01, False)])
def test_gate_at_six_sigmas_of_the_innovation(sigmas, used):
    flt = new_filter()
    x, P = flt.x.copy(), flt.P.copy()
    H, R = flt.row({em.KAPPA: 1.0})[None], np.array([[0.01**2]])
    z = np.array([sigmas * np.hypot(0.01, 0.01)])
    assert flt.measure("lateral", z, H, R, 12.0) is used
    assert flt.tally.rejected == ([] if used else [(12.0, "lateral")])
    assert np.array_equal(flt.x, x) is not used
    assert np.array_equal(flt.P, P) is not used
    assert flt.tally.dof == ({"lateral": 1} if used else {})
    assert flt.measure("lateral", z, H, R, 13.0, gate=False)


def test_tally_by_kind():
    flt = new_filter()
    H, R = np.stack([flt.row({em.W.start: 1.0}), flt.row({em.W.start + 1: 1.0})]), np.eye(2) * 1e-4
    for value in (0.03, -0.02):
        flt.measure("still", np.array([value, 0.0]), H, R, 1.0)
    assert flt.tally.dof["still"] == 4
    assert len(flt.tally.normalised["still"]) == 2
    assert flt.tally.nis["still"] == pytest.approx(sum(float(v @ v) for v in flt.tally.normalised["still"]))


def test_heading_gain_is_booked_to_the_kind_that_gave_it():
    """ln of the variance ratio of the cloned heading: kinds add up, none before the clone exists."""
    flt = new_filter()
    H = flt.row({DOWN: 1.0})[None]
    flt.measure("survey", np.zeros(1), H, np.array([[1e-6]]), 0.0)
    assert flt.tally.heading_gain == {}
    flt.clone(em.THETA_CLONE)
    before = flt.P[CLONE_DOWN, CLONE_DOWN]
    flt.measure("gnss", np.zeros(1), H, np.array([[before]]), 1.0)  # halves the variance
    flt.measure("lateral", np.zeros(1), flt.row({em.KAPPA: 1.0})[None], np.array([[1e-6]]), 2.0)
    assert flt.tally.heading_gain["gnss"] == pytest.approx(np.log(2.0))
    assert flt.tally.heading_gain["lateral"] == pytest.approx(0.0, abs=1e-12)


def test_lost_digits_are_an_error_not_a_result():
    flt = new_filter()
    flt.P[em.KAPPA, em.KAPPA] = -1e-3
    with pytest.raises(ArithmeticError, match="lost its digits"):
        flt.measure("lateral", np.zeros(1), flt.row({em.KAPPA: 1.0})[None], np.array([[1e-6]]), 0.0)


def test_parked_lateral_velocity_is_a_fresh_draw_at_every_step():
    flt = new_filter()
    flt.advance(parked_step(), 0, rolling=False)
    assert flt.P[em.LATERAL, em.LATERAL] == pytest.approx(NOISE.lateral_rms**2)
    assert np.count_nonzero(flt.P[em.LATERAL]) == 1


def test_a_jolt_widens_the_parked_heading_only():
    quiet, bumped = new_filter(), new_filter()
    quiet.advance(parked_step(), 0, rolling=False)
    bumped.advance(parked_step(), 0, rolling=False, extra_yaw_rad=2e-5)
    difference = bumped.P - quiet.P
    assert difference[em.YAW, em.YAW] == pytest.approx(4e-10)
    assert np.count_nonzero(difference) == 1


def test_displacement_is_kept_only_where_asked():
    """Velocity sigma 0.05 m/s alone: way over 20 s against way over 10 s, 1 and 0.5 m."""
    kept, fresh = (new_filter(POS=0.0, THETA=0.0, ACCEL=0.0) for _ in range(2))
    for flt, keep in ((kept, True), (fresh, False)):
        flt.advance(parked_step(), 0, rolling=False)
        flt.advance(parked_step(), 0, rolling=False, keep_displacement=keep)
    assert np.sqrt(kept.P[em.S.start, em.S.start]) == pytest.approx(1.0, rel=1e-3)
    assert np.sqrt(fresh.P[em.S.start, em.S.start]) == pytest.approx(0.5, rel=1e-3)


def test_covariance_stays_symmetric_and_positive_over_an_hour_and_a_taxi():
    """An hour of 10 s steps parked, a turn and 200 s of rolling by the second, all kinds of rows."""
    flt = new_filter(bins=3)
    rng = np.random.default_rng(5)
    lowest = []
    for k in range(560):
        rolling = k >= 360
        step = parked_step(1.0, 0.4 + 0.01 * (k - 360), 10.0, 0.01) if rolling else parked_step()
        flt.advance(step, k // 200, rolling=rolling, keep_displacement=not rolling and k % 3 > 0)
        entries = {em.S.start + 1: 1.0, em.KAPPA: 10.0} if rolling else {em.S.start: 1.0}
        z = 1e-3 * rng.standard_normal(1)
        flt.measure("row", z, flt.row(entries)[None], np.array([[1e-6]]), 10.0 * k, gate=False)
        assert np.array_equal(flt.P, flt.P.T)
        sigma = np.sqrt(np.maximum(np.diag(flt.P), 1e-40))
        lowest.append(np.linalg.eigvalsh(flt.P / np.outer(sigma, sigma))[0])
    assert min(lowest) > -1e-9
