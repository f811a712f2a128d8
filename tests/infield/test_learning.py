"""Learning from kept sessions: the likelihood against one dense normal distribution, the tree
against its own, values against the truth of a fleet that another generator made.
"""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.stats import multivariate_normal

from benchmarks.fleet_made import made_fleet
from infield.learning.draws import draw
from infield.learning.learn import Information, learn, solve
from infield.learning.likelihood import FleetLikelihood
from infield.learning.parameters import OF_POINTS, PriorName, logs_of
from infield.learning.stored_sessions import StoredUnit, covering
from infield.table.merge import session_covariance
from infield.table.thermal_table import AgeingModel
from ins.records import GyroNoise


@pytest.fixture(scope="module")
def fleet():
    return made_fleet(7, units=8, sessions=4)


def dense_log_likelihood(unit, value):
    """All sessions of a unit at once: nodes at every session's date, jointly normal."""
    table = covering(unit)
    ageing = AgeingModel(
        common_deg_h_sqrt_year=value[PriorName.AGEING_COMMON],
        shape_deg_h_sqrt_year=value[PriorName.AGEING_SHAPE],
        length_degC=value[PriorName.LENGTH],
    )
    gyro = GyroNoise(
        bias_instability_deg_h=value[PriorName.FLICKER],
        rate_random_walk_deg_h_sqrt_h=value[PriorName.RANDOM_WALK],
        turn_on_deg_h=value[PriorName.TURN_ON],
    )
    H, y, R, P = [], [], [], []
    for s in unit.sessions:
        rows = np.zeros((s.axis_index.size, table.n_parameters))
        for axis in range(3):
            chosen = s.axis_index == axis
            values, nodes = table.values_of(axis), table.temperature_degC[axis]
            spline = CubicSpline(nodes, np.eye(nodes.size), bc_type="not-a-knot")
            rows[chosen, values] = spline(s.temperature_degC[chosen])
        creep = np.diag(s.creep_variance) * value[PriorName.YAW_CREEP] ** 2
        own = session_covariance(
            axis_index=s.axis_index,
            time_s=s.time_s,
            duration_s=s.duration_s,
            gyro=gyro,
            run_length_s=s.run_length_s,
        )
        H.append(rows)
        y.append(s.bias_deg_h - rows @ table.parameters)
        R.append(s.covariance_without_creep + creep + own)
        P.append(table.aged(365.25 * (s.year - unit.year), ageing).covariance)
    S = np.block([[H[i] @ P[min(i, j)] @ H[j].T for j in range(len(H))] for i in range(len(H))])
    at = 0
    for part in R:
        S[at : at + len(part), at : at + len(part)] += part
        at += len(part)
    return multivariate_normal(cov=S).logpdf(np.concatenate(y))


def test_the_filter_gives_the_likelihood_of_all_sessions_at_once(fleet):
    """With next to no outliers, 72 points of a unit: agreement to rounding."""
    made, value = fleet
    value = {**value, PriorName.OUTLIER_SHARE: 1e-12}
    units = [m.kept for m in made[:3]]
    got = FleetLikelihood(units)(logs_of(value)).log_likelihood
    want = [dense_log_likelihood(unit, value) for unit in units]
    assert got == pytest.approx(want, abs=1e-5)


def test_an_outlier_is_found_and_moves_nothing(fleet):
    made, value = fleet
    sound = next(m.kept for m in made if not any(m.outliers))
    theta = logs_of({**value, PriorName.OUTLIER_SHARE: 0.02})
    bad = sound.sessions[-1]
    shifted = type(bad)(**{**vars(bad), "bias_deg_h": bad.bias_deg_h + 0.1})
    before, after = (
        FleetLikelihood([StoredUnit(**{**vars(sound), "sessions": sessions})])(theta)
        for sessions in (sound.sessions[:-1], (*sound.sessions[:-1], shifted))
    )
    assert after.outlier[0, -1] > 0.99
    sigma = float(np.sqrt(np.diag(after.covariance[0])).mean())
    levels = (after.mean - before.mean)[0].reshape(3, -1).mean(axis=1)
    assert np.abs(levels).max() < sigma


def test_the_tree_is_solved_as_one_normal_distribution():
    """Technology, two types, three units: against the dense information matrix of all of them."""
    rng = np.random.default_rng(3)
    p, spreads = 2, (0.3, 0.25)
    units = []
    for _ in range(3):
        A = rng.standard_normal((p, p))
        units.append(Information(A @ A.T, rng.standard_normal(p)))
    prior = Information(np.eye(p), np.zeros(p))
    about, types = np.array([1.0, -2.0]), ["a", "a", "b"]
    tree = solve(prior, units, types, type_spread=spreads[0], unit_spread=spreads[1], about=about)
    parents = [None, 0, 0, 1, 1, 2]  # technology, a, b, then the units
    J, h = np.zeros((6 * p, 6 * p)), np.zeros(6 * p)
    J[:p, :p] += prior.information
    for node, parent in enumerate(parents):
        if parent is None:
            continue
        own, above = slice(p * node, p * node + p), slice(p * parent, p * parent + p)
        weight = np.eye(p) / spreads[0 if parent == 0 else 1] ** 2
        J[own, own] += weight
        J[above, above] += weight
        J[own, above] -= weight
        J[above, own] -= weight
    for k, said in enumerate(units):
        own = slice(p * (3 + k), p * (4 + k))
        J[own, own] += said.information
        h[own] += said.vector
    covariance = np.linalg.inv(J)
    mean = covariance @ h
    found = [tree.technology, tree.types["a"], tree.types["b"], *tree.units]
    for node, normal in enumerate(found):
        own = slice(p * node, p * node + p)
        assert normal.mean == pytest.approx(about + mean[own])
        assert normal.covariance == pytest.approx(covariance[own, own])


def test_draws_hold_what_a_fine_grid_holds():
    """Two variances that are told by their sum alone, below one that bounds both: a bent ridge with
    a tail to where the prior ends it. Curvature at the top misses its lower ends by a factor.
    """
    sigma = np.array([1.1, 1.1])

    def log_density(theta):
        total = np.sum(np.exp(2.0 * theta), axis=1)
        return -0.5 * (np.log(total) / 0.2) ** 2 - 0.5 * np.sum((theta / sigma) ** 2, axis=1)

    axis = np.linspace(-6.0, 2.0, 801)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    weight = np.exp(log_density(grid)).reshape(801, 801).sum(axis=1)
    want = np.interp((0.025, 0.5, 0.975), np.cumsum(weight) / weight.sum(), axis)

    def drawn(density):
        rng = np.random.default_rng(5)
        return draw(density, np.full(2, -0.5 * np.log(2.0)), np.diag([0.3, 0.3]) ** 2, sigma, rng)

    found = drawn(log_density)
    assert found.effective > 100.0
    for k in range(2):
        got = found.quantiles(k, (0.025, 0.5, 0.975))
        assert got == pytest.approx(want, abs=0.35)  # three sigmas of a quantile of 160 draws
    # another machine, or more threads: the same draws
    again = drawn(lambda theta: log_density(theta) + 1e-9 * np.cos(1e6 * theta[:, 0]))
    np.testing.assert_array_equal(again.theta, found.theta)


@pytest.mark.slow
def test_a_fleet_teaches_what_its_sessions_show(fleet):
    """Within four sigmas each; the squared innovation comes to what is expected."""
    made, value = fleet
    found = learn([m.kept for m in made])
    assert found.settled
    for name in OF_POINTS:
        learnt = found.parameters[name]
        assert abs(np.log(learnt.value / value[name])) < 4.0 * learnt.sigma_log, name
        assert learnt.interval_95[0] < learnt.value < learnt.interval_95[1]
    sound = ~np.array([m.outliers for m in made])
    nis = found.evidence.nis[sound].sum() / found.evidence.dof[sound].sum()
    assert nis == pytest.approx(1.0, abs=0.2)
    assert len(found.of_units) == 8 and set(found.types) == {"rlg"}
