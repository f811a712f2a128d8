"""The merge: both forms agree, nothing unobserved moves, variance never grows, order does not
matter, outliers wait.
"""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from infield.table.merge import AXIS_Z_LIMIT, SessionPoints, merge_posterior, session_covariance
from infield.table.thermal_table import EvenNodes, default_table, prior_covariance
from ins.noise import flicker_covariance, random_walk_covariance
from ins.records import GyroNoise, InputError
from tests.infield.common_part import common_shift
from tests.infield.point_merge import merge_points

UTC = "2026-03-01T05:00:00Z"
ARW_deg_sqrt_h, BIN_S = 0.002, 300.0
SIGMA_POINT_deg_h = ARW_deg_sqrt_h / np.sqrt(BIN_S / 3600.0)


def table_with(sigma=0.0072, interpolation="linear", **prior):
    table = default_table(
        imu_serial="S",
        gyro_technology="rlg",
        created_utc=UTC,
        span=EvenNodes(low_degC=-20, high_degC=50),
        interpolation=interpolation,
    )
    nodes, sigmas = table.temperature_degC, (np.full(8, sigma),) * 3
    return table.replaced(
        covariance=prior_covariance(nodes, sigmas, hermite=interpolation == "hermite", **prior)
    )


def session(
    table,
    *,
    low=0.0,
    high=25.0,
    bins=6,
    shift=(0.0, 0.0, 0.0),
    rng=None,
    sigma=SIGMA_POINT_deg_h,
    **noise,
):
    """Points of a warming session on all axes; the truth is the table plus `shift` and noise."""
    axis = np.repeat([0, 1, 2], bins)
    T = np.tile(np.linspace(low, high, bins), 3)
    time = np.tile(BIN_S * (np.arange(bins) + 0.5), 3)
    H = np.vstack([table.basis(int(a), t) for a, t in zip(axis, T)])
    R = sigma**2 * np.eye(3 * bins)
    own = session_covariance(
        axis_index=axis,
        time_s=time,
        duration_s=np.full(3 * bins, BIN_S),
        gyro=GyroNoise(**noise),
        run_length_s=BIN_S * bins,
    )
    y = H @ table.parameters + np.asarray(shift)[axis]
    if rng is not None:
        y = y + rng.multivariate_normal(np.zeros(y.size), own + R)
    points = SessionPoints(
        axis_index=axis,
        time_s=time,
        duration_s=np.full(y.size, BIN_S),
        temperature_degC=T,
        temperature_rate_degC_min=np.ones(y.size),
        bias_deg_h=y,
        covariance=R,
        H=H,
        run_id="r",
        run_sha256="h",
    )
    return points, own


def filtered(table, points, own, M=None, y=None, R=None):
    """Prior and posterior of the session biases, from measurements M b + v."""
    C, m0 = points.H @ table.covariance @ points.H.T + own, points.H @ table.parameters
    M = np.eye(m0.size) if M is None else M
    R, y = points.covariance if R is None else R, points.bias_deg_h if y is None else y
    gain = C @ M.T @ np.linalg.inv(M @ C @ M.T + R)
    left = np.eye(m0.size) - gain @ M
    return m0, C, m0 + gain @ (y - M @ m0), left @ C @ left.T + gain @ R @ gain.T


def test_one_point_is_inverse_variance_weighting():
    table = default_table(
        imu_serial="S",
        gyro_technology="rlg",
        created_utc=UTC,
        span=EvenNodes(low_degC=0, high_degC=10),
    )
    table = table.replaced(covariance=np.diag(np.full(6, 0.01**2)))
    points = SessionPoints(
        axis_index=[0],
        time_s=[0],
        duration_s=[300],
        temperature_degC=[0],
        temperature_rate_degC_min=[0],
        bias_deg_h=[0.008],
        covariance=[[0.004**2]],
        H=table.basis("x", 0.0),
    )
    merged = merge_points(table, points, [[0.003**2]]).table
    w_table, w_point = 1 / 0.01**2, 1 / (0.004**2 + 0.003**2)
    assert merged.parameters[0] == pytest.approx(0.008 * w_point / (w_table + w_point))
    assert merged.sigma_deg_h("x", 0.0) == pytest.approx(1 / np.sqrt(w_table + w_point))
    assert not merged.parameters[1:].any()


@pytest.mark.parametrize("interpolation", ["linear", "hermite"])
def test_both_forms_are_the_same_update(interpolation):
    table = table_with(interpolation=interpolation)
    points, own = session(table, rng=np.random.default_rng(1))
    direct = merge_points(table, points, own)
    through_filter = merge_posterior(table, points.H, *filtered(table, points, own))
    assert through_filter.table.parameters == pytest.approx(direct.table.parameters, abs=1e-13)
    assert through_filter.table.covariance == pytest.approx(direct.table.covariance, abs=1e-15)
    assert through_filter.nis == pytest.approx(direct.nis, rel=1e-9)
    assert through_filter.dof == direct.dof == 18
    assert through_filter.axis_z == pytest.approx(direct.axis_z, rel=1e-6)


@pytest.mark.parametrize("spurious_deg_h", [0.0, 0.01, 100.0])
def test_an_unobserved_direction_moves_nothing(spurious_deg_h):
    """The east gyro on one heading: its level is unseen, its change over the session is seen."""
    table = table_with()
    points, own = session(table, bins=6)
    M = np.zeros((11, 18))  # x whole, y only as differences, z not at all
    M[:6, :6] = np.eye(6)
    M[6:, 6:12] = np.diff(np.eye(6), axis=0)
    R = M @ points.covariance @ M.T
    m0, C, m1, P1 = filtered(table, points, own, M=M, R=R, y=M @ points.bias_deg_h + 0.01)
    level = np.zeros(18)
    # said of directions that it never saw
    level[6:12], level[12:] = spurious_deg_h, -spurious_deg_h
    result = merge_posterior(table, points.H, m0, C, m1 + level, P1)
    assert result.dof == 11
    for axis in "yz":
        assert abs(common_shift(table, axis, result.candidate)) < 1e-6
    z = table.values_of("z")
    assert np.max(np.abs(result.candidate.parameters[z])) < 1e-9
    assert result.candidate.covariance[z, z] == pytest.approx(table.covariance[z, z], rel=1e-12)
    assert abs(common_shift(table, "x", result.candidate)) > 1e-3


@pytest.mark.parametrize("axes", ["y", "xz"])
def test_a_held_axis_keeps_its_common_part_and_how_sure_that_is(axes):
    """A consider update of whatever was measured: its shape may be learnt, its level is as before,
    and nothing is surer than by the whole update.
    """
    table = table_with()
    points, own = session(table, shift=(0.01, -0.02, 0.01))
    priors = filtered(table, points, own)
    free, held = (merge_posterior(table, points.H, *priors, held_axes=of) for of in ("", axes))
    for axis in axes:
        weights = table.common_weights(axis)
        before, after = (weights @ t.covariance @ weights for t in (table, held.candidate))
        assert after == pytest.approx(before, rel=1e-9)
        assert weights @ free.candidate.covariance @ weights < 0.5 * before
        assert abs(common_shift(table, axis, held.candidate)) < 1e-12
    less = held.candidate.covariance - free.candidate.covariance
    assert np.linalg.eigvalsh(less).min() > -1e-12


@pytest.mark.parametrize("interpolation", ["linear", "hermite"])
@pytest.mark.parametrize(("low", "high"), [(-8.0, 2.0), (18.0, 24.0), (30.0, 50.0)])
def test_no_node_of_a_held_axis_becomes_less_sure(interpolation, low, high):
    """A session at a few temperatures moves near nodes more than far ones."""
    table = table_with(interpolation=interpolation)
    points, own = session(table, shift=(0.01, -0.02, 0.01), low=low, high=high)
    held = merge_posterior(table, points.H, *filtered(table, points, own), held_axes="yz")
    before, after = table.covariance, held.candidate.covariance
    assert np.all(np.diag(after) <= np.diag(before) * (1 + 1e-9))
    for axis in "yz":
        own_block = np.ix_(table.block(axis), table.block(axis))
        assert np.linalg.eigvalsh(before[own_block] - after[own_block])[0] > -1e-12


def test_unobserved_directions_do_not_add_up_over_many_points():
    table = table_with()
    points, own = session(table, bins=100)
    M = np.kron(np.eye(3), np.diff(np.eye(100), axis=0))  # no level on any axis
    rng = np.random.default_rng(2)
    R = SIGMA_POINT_deg_h**2 * M @ M.T
    y = M @ (points.bias_deg_h + rng.multivariate_normal(np.zeros(300), own + points.covariance))
    result = merge_posterior(table, points.H, *filtered(table, points, own, M=M, R=R, y=y))
    assert np.max(np.abs(result.candidate.parameters)) > 1e-4  # the shape is seen
    assert all(abs(common_shift(table, axis, result.candidate)) < 1e-6 for axis in "xyz")


@given(
    seed=st.integers(0, 2**32 - 1),
    interpolation=st.sampled_from(["linear", "hermite"]),
    known=st.booleans(),
)
@settings(max_examples=25, deadline=None)
def test_merging_never_adds_variance_and_stays_a_covariance(seed, interpolation, known):
    rng = np.random.default_rng(seed)
    table = table_with(sigma=10.0 ** rng.uniform(-4, 0), interpolation=interpolation)
    noise = (
        {"turn_on_deg_h": 0.0, "bias_instability_deg_h": 0.0, "rate_random_walk_deg_h_sqrt_h": 0.0}
        if known
        else {}
    )
    points, own = session(
        table, rng=rng, low=rng.uniform(-60, 20), sigma=10.0 ** rng.uniform(-6, 0), **noise
    )
    M = rng.standard_normal((7, 18))
    y = M @ points.bias_deg_h
    for result in (
        merge_points(table, points, own),
        merge_posterior(table, points.H, *filtered(table, points, own)),
        merge_posterior(
            table, points.H, *filtered(table, points, own, M=M, R=1e-5 * np.eye(7), y=y)
        ),
    ):
        before, after = table.covariance, result.candidate.covariance
        scale = np.max(np.abs(before))
        assert np.array_equal(after, after.T)
        assert np.all(np.diag(after) <= np.diag(before) * (1 + 1e-9))
        assert np.linalg.eigvalsh(after)[0] > -1e-12 * scale
        assert np.linalg.eigvalsh(before - after)[0] > -1e-9 * scale
        assert np.all(np.isfinite(result.candidate.parameters))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_order_of_sessions_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    table = table_with()
    sessions = [session(table, low=rng.uniform(-20, 20), rng=rng) for _ in range(3)]
    ends = []
    for order in itertools.permutations(sessions):
        merged = table
        for points, own in order:
            merged = merge_points(merged, points, own).candidate
        ends.append(merged)
    for other in ends[1:]:
        assert other.parameters == pytest.approx(ends[0].parameters, abs=1e-12)
        assert other.covariance == pytest.approx(ends[0].covariance, abs=1e-14)


def test_turn_on_stays_common_to_all_points_of_a_session():
    """A hundred points of one session cannot beat the turn-on bias they share."""
    table = table_with(sigma=0.01)
    silent = {"bias_instability_deg_h": 0.0, "rate_random_walk_deg_h_sqrt_h": 0.0}
    points, own = session(table, bins=100, sigma=1e-5, turn_on_deg_h=0.003, **silent)
    merged = merge_points(table, points, own).table
    floor = 0.003 * 0.01 / np.hypot(0.003, 0.01)
    assert merged.sigma_deg_h("x", [0.0, 12.0, 25.0]) == pytest.approx(floor, rel=0.04)
    independent = merge_points(table, points, np.diag(np.diag(own))).table
    assert np.all(independent.sigma_deg_h("x", [0.0, 12.0, 25.0]) < 0.5 * floor)


def test_zero_common_shift_and_short_length_leave_unvisited_nodes_bit_identical():
    table = table_with(common_fraction=0.0, length_degC=0.2)
    table = table.replaced(parameters=np.linspace(-0.03, 0.05, table.n_parameters))
    points, own = session(table, low=0.0, high=20.0, shift=(0.01, 0.01, 0.01))
    for result in (
        merge_points(table, points, own),
        merge_posterior(table, points.H, *filtered(table, points, own)),
    ):
        for axis in range(3):
            values = table.values_of(axis)
            unvisited = values.start + np.flatnonzero(
                (table.temperature_degC[axis] < 0) | (table.temperature_degC[axis] > 20)
            )
            visited = np.setdiff1d(np.r_[values], unvisited)
            assert np.array_equal(
                result.candidate.parameters[unvisited], table.parameters[unvisited]
            )
            assert np.array_equal(
                result.candidate.covariance[unvisited, unvisited],
                table.covariance[unvisited, unvisited],
            )
            assert np.all(result.candidate.parameters[visited] != table.parameters[visited])


def test_flicker_covariance_is_the_integral_of_its_spectrum():
    """Against the defining integral, two-sided PSD 1 / (2 pi f) seen through bin means."""
    start, lowest = np.array([0.0, 600.0]), 1 / (4 * 4200.0)
    f = np.geomspace(lowest, 1.0, 400_001)  # above 1 Hz a 300 s mean passes < 1e-7

    def integral(lag):
        seen = np.sinc(f * BIN_S) ** 2 * np.cos(2 * np.pi * f * lag) / (2 * np.pi * f)
        return 2 * np.trapezoid(seen, f)

    expected = [[integral(0.0), integral(600.0)], [integral(600.0), integral(0.0)]]
    assert flicker_covariance(start, start + BIN_S, lowest_hz=lowest) == pytest.approx(
        np.array(expected), rel=1e-6
    )


def test_random_walk_covariance_by_hand():
    """Unit random walk, bins 0..300 and 600..900 s: T/3, the first bin's mean time, 600 + T/3."""
    start = np.array([0.0, 600.0])
    assert random_walk_covariance(start, start + 300.0) == pytest.approx(
        np.array([[100.0, 150.0], [150.0, 700.0]])
    )


def test_session_covariance_terms_and_units():
    silent = {
        "turn_on_deg_h": 0.0,
        "bias_instability_deg_h": 0.0,
        "rate_random_walk_deg_h_sqrt_h": 0.0,
    }
    same = {
        "axis_index": [0, 0, 1],
        "time_s": [1800, 3600, 1800],
        "duration_s": [1.0] * 3,
        "run_length_s": 4200.0,
    }

    def T(misalignment_mrad=0.0, **noise):
        return session_covariance(
            **same, gyro=GyroNoise(**{**silent, **noise}), sigma_misalignment_mrad=misalignment_mrad
        )

    block = np.array([[1.0, 1, 0], [1, 1, 0], [0, 0, 1]])
    assert T(turn_on_deg_h=0.003) == pytest.approx(0.003**2 * block)
    # physics.md section 4
    assert np.sqrt(T(misalignment_mrad=0.1)) == pytest.approx(0.0015 * block, rel=0.01)
    walk = T(rate_random_walk_deg_h_sqrt_h=0.002)  # K^2 t: 0.5 h and 1 h after power-on
    assert walk == pytest.approx(
        0.002**2 * np.array([[0.5, 0.5, 0], [0.5, 1.0, 0], [0, 0, 0.5]]), rel=1e-3, abs=1e-15
    )
    assert np.all(T(bias_instability_deg_h=0.002)[2, :2] == 0.0)


def settled_table(rng):
    """A table after four sessions: sigma 0.0025 deg/h or so where it was visited."""
    table = table_with()
    for low in (-5.0, 0.0, 5.0, 0.0):
        points, own = session(table, low=low)
        table = merge_points(table, points, own).candidate
    shift = np.linalg.cholesky(
        table.covariance + 1e-15 * np.eye(table.n_parameters)
    ) @ rng.standard_normal(24)
    return table, shift


@pytest.mark.parametrize("wrong_deg_h", [0.03, 0.05])
def test_a_wrong_session_is_flagged_and_not_merged(wrong_deg_h):
    """R16: over 40 units, one axis wrong by 0.03  never moves a node by more than half a sigma."""
    rng = np.random.default_rng(16)
    for k in range(40):
        table, error = settled_table(rng)
        shift = np.zeros(3)
        shift[k % 3] = wrong_deg_h
        points, own = session(table.replaced(parameters=error), shift=shift, rng=rng)
        result = merge_points(table.replaced(parameters=np.zeros(24)), points, own)
        sigma = np.sqrt(np.diag(table.covariance))
        assert np.all(np.abs(result.table.parameters) <= 0.5 * sigma)
        assert not result.consistent and abs(result.axis_z[k % 3]) > AXIS_Z_LIMIT
        # merged, it would have moved the table
        assert np.max(np.abs(result.candidate.parameters) / sigma) > 0.5


def test_shapes_that_do_not_fit_are_refused():
    table = table_with()
    points, _ = session(table)
    with pytest.raises(InputError, match="posterior"):
        merge_posterior(table, points.H, np.zeros(18), np.eye(18), np.zeros(18), np.eye(17))
    with pytest.raises(InputError, match="axis_index"):
        SessionPoints(**{**vars(points), "axis_index": np.full(18, 3)})
