"""How likely the sessions of many units are under given parameters: the model of the table merge,
exact in its Gaussian part.

A unit's table ages between its sessions (`ThermalTable.aged`), session i measures

    y_i = H_i x(t_i) + t_i + v_i,    t_i: turn-on, flicker, rate random walk;  v_i: measurement

and x, t, v are integrated out by a filter over the sessions of each unit, all units side by side. A
session is an outlier with a small probability: then each gyro is shifted as a whole by a large
random amount. Its state after such a session is the mixture of both cases, taken as one Gaussian
with the mixture's mean and covariance. Units: deg/h, years. Source: physics.md 6.8.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.learning.kept import KeptUnit, covering
from infield.learning.parameters import OF_POINTS, OUTLIER_SIZE, PriorName
from infield.table.merge import bin_edges
from infield.table.thermal_table import DEFAULT_SIGMA_deg_h, ThermalTable
from ins.noise import flicker_covariance, random_walk_covariance
from ins.records import AXES
from ins.units import HOUR

LOG_2_PI = float(np.log(2.0 * np.pi))
LARGEST_SHARE = 0.5  # of outliers: beyond it they would be the rule


@dataclass(frozen=True)
class Evidence:
    """log_likelihood (u,): of each unit's sessions. nis, dof (u, s): squared normalised innovation
    of each session before it was merged, outliers not allowed for, and its degrees of freedom (0:
    no session there); outlier (u, s): probability that it is one. mean (u, n), covariance (u, n,
    n): of the departure of the nodes from the first table, after the last session.
    """

    log_likelihood: NDArray
    nis: NDArray
    dof: NDArray
    outlier: NDArray
    mean: NDArray
    covariance: NDArray


@dataclass(frozen=True)
class _Nodes:
    """Of all units: prior covariance, same-axis mask of values (common ageing), squared distances
    over temperature and same-axis mask (shape ageing).
    """

    prior: NDArray
    common: NDArray
    squared_degC2: NDArray
    same_axis: NDArray


@dataclass(frozen=True)
class _Session:
    """The k-th sessions of all units, padded: years since the one before, H, y less the first
    table, and the parts of the covariance; points (u,): how many are real.
    """

    years: NDArray
    H: NDArray
    y: NDArray
    fixed: NDArray
    creep: NDArray
    same_axis: NDArray
    flicker: NDArray
    walk: NDArray
    axes: NDArray
    points: NDArray


class FleetLikelihood:
    """The sessions of units of one technology, laid down once, asked for many parameters.

    Units must have tables of node values (`linear`); of `hermite` ones the values alone age here.
    """

    def __init__(self, units: Sequence[KeptUnit]) -> None:
        self.units = tuple(units)
        self.tables = tuple(covering(unit) for unit in units)
        sizes = [_values(table).size for table in self.tables]
        n = max(sizes)
        self._nodes = _laid_nodes(self.tables, n)
        self._sessions = _laid_sessions(self.units, self.tables, n)
        self._shift = (OUTLIER_SIZE * DEFAULT_SIGMA_deg_h[units[0].gyro_technology]) ** 2

    def log_likelihood(self, theta: NDArray) -> NDArray:
        """Of each unit's sessions, (u,); minus infinity where the parameters are so far off that
        the covariances lose their digits.
        """
        try:
            return self(theta).log_likelihood
        except np.linalg.LinAlgError:
            return np.full(len(self.units), -np.inf)

    def __call__(self, theta: NDArray) -> Evidence:
        """The evidence at logarithms of the parameters, (p,) for all units or (u, p)."""
        value: dict[PriorName, NDArray] = {
            name: np.exp(part)[..., None, None]
            for name, part in zip(OF_POINTS, np.transpose(theta))
        }
        share = np.minimum(value[PriorName.OUTLIER_SHARE], LARGEST_SHARE)[..., 0, 0]
        P, x = self._nodes.prior.copy(), np.zeros(self._nodes.prior.shape[:2])
        growth = _growth(self._nodes, value)
        total = np.zeros(len(self.units))
        nis, dof, outlier = [], [], []
        for session in self._sessions:
            P = P + session.years[:, None, None] * growth
            S = session.H @ P @ session.H.transpose(0, 2, 1) + _own(session, value)
            step = _Step(session, S, x, self._shift, share)
            total += np.where(session.points > 0, step.log_likelihood, 0.0)
            x, P = step.merged(x, P)
            nis.append(step.nis)
            dof.append(session.points)
            outlier.append(step.outlier)
        return Evidence(total, self._by_unit(nis), self._by_unit(dof), self._by_unit(outlier), x, P)

    def _by_unit(self, rows: list[NDArray]) -> NDArray:
        """Values of each session in turn as (u, s)."""
        return np.array(rows).reshape(len(rows), len(self.units)).T


class _Step:
    """One session of every unit against what was known of it."""

    def __init__(
        self, session: _Session, S: NDArray, x: NDArray, shift: float, share: NDArray
    ) -> None:
        self._session = session
        r = session.y - np.einsum("umn,un->um", session.H, x)
        L = np.linalg.cholesky(S)
        W = np.linalg.inv(L)
        z = np.einsum("umk,uk->um", W, r)
        self.nis = np.sum(z**2, axis=1)
        self.S_inv = W.transpose(0, 2, 1) @ W
        self._r = r
        half_log_det = np.sum(np.log(np.diagonal(L, axis1=1, axis2=2)), axis=1)
        plain = -0.5 * self.nis - half_log_det - 0.5 * session.points * LOG_2_PI
        # an outlier adds `shift` to each gyro's common part: a change of rank 3 (Woodbury)
        self._SE = self.S_inv @ session.axes
        core = np.eye(len(AXES)) / shift + session.axes.transpose(0, 2, 1) @ self._SE
        self._core_inv = np.linalg.inv(core)
        along = np.einsum("umk,um->uk", self._SE, r)
        gain = np.einsum("uk,ukl,ul->u", along, self._core_inv, along)
        log_det = np.linalg.slogdet(core)[1] + len(AXES) * np.log(shift)
        shifted = plain + 0.5 * gain - 0.5 * log_det
        weighed = np.log1p(-share) + plain, np.log(share) + shifted
        self.log_likelihood = np.logaddexp(*weighed)
        self.outlier = np.exp(weighed[1] - self.log_likelihood)
        self._along = along

    def merged(self, x: NDArray, P: NDArray) -> tuple[NDArray, NDArray]:
        """Mean and covariance of the mixture after the session."""
        w = self.outlier[:, None, None]
        removed = self._SE @ self._core_inv @ self._SE.transpose(0, 2, 1)
        PH = P @ self._session.H.transpose(0, 2, 1)
        kept = self.S_inv - w * removed
        weight = np.einsum("umk,uk->um", kept, self._r)
        apart = np.einsum("umk,uk->um", removed, self._r)
        d = np.einsum("unm,um->un", PH, apart)
        spread = w * (1.0 - w) * d[:, :, None] * d[:, None, :]
        after = P - PH @ kept @ PH.transpose(0, 2, 1) + spread
        return x + np.einsum("unm,um->un", PH, weight), 0.5 * (after + after.transpose(0, 2, 1))


def _growth(nodes: _Nodes, value: dict[PriorName, NDArray]) -> NDArray:
    """Covariance that a year of ageing adds, (u, n, n): physics.md 6.8."""
    smooth = np.exp(-nodes.squared_degC2 / (2.0 * value[PriorName.LENGTH] ** 2)) * nodes.same_axis
    return np.asarray(
        value[PriorName.AGEING_COMMON] ** 2 * nodes.common
        + value[PriorName.AGEING_SHAPE] ** 2 * smooth
    )


def _own(session: _Session, value: dict[PriorName, NDArray]) -> NDArray:
    """Covariance of what is the session's own: measurement, creep, turn-on, flicker, walk."""
    creep = value[PriorName.YAW_CREEP] ** 2 * session.creep
    return np.asarray(
        session.fixed
        + creep
        + value[PriorName.TURN_ON] ** 2 * session.same_axis
        + value[PriorName.FLICKER] ** 2 * session.flicker
        + value[PriorName.RANDOM_WALK] ** 2 * session.walk
    )


def _values(table: ThermalTable) -> NDArray:
    """Where the node values of x, y, z stand among the parameters."""
    return np.concatenate([np.r_[table.values_of(axis)] for axis in AXES])


def _laid_nodes(tables: Sequence[ThermalTable], n: int) -> _Nodes:
    """Every unit's nodes, padded with nodes that nothing is known of and nobody asks for."""
    shape = (len(tables), n, n)
    prior = np.tile(np.eye(n) * 1e-12, (len(tables), 1, 1))
    same_axis, squared = np.zeros(shape), np.zeros(shape)
    for u, table in enumerate(tables):
        rows = _values(table)
        T = np.concatenate(table.temperature_degC)
        axis = np.repeat(np.arange(3), [t.size for t in table.temperature_degC])
        m = rows.size
        prior[u, :m, :m] = table.covariance[np.ix_(rows, rows)]
        same_axis[u, :m, :m] = axis[:, None] == axis[None, :]
        squared[u, :m, :m] = (T[:, None] - T[None, :]) ** 2
    return _Nodes(prior, same_axis, squared, same_axis)


def _laid_sessions(
    units: Sequence[KeptUnit], tables: Sequence[ThermalTable], n: int
) -> list[_Session]:
    most = max((len(unit.sessions) for unit in units), default=0)
    return [_laid_session(units, tables, k, n) for k in range(most)]


def _laid_session(
    units: Sequence[KeptUnit], tables: Sequence[ThermalTable], k: int, n: int
) -> _Session:
    """The k-th session of every unit; a unit that has none gets points that say nothing."""
    count = len(units)
    m = max(len(unit.sessions[k].axis_index) for unit in units if len(unit.sessions) > k)
    H, y, years = np.zeros((count, m, n)), np.zeros((count, m)), np.zeros(count)
    fixed = np.tile(np.eye(m), (count, 1, 1))
    creep, same, flicker, walk = (np.zeros((count, m, m)) for _ in range(4))
    axes, points = np.zeros((count, m, len(AXES))), np.zeros(count)
    for u, unit in enumerate(units):
        if len(unit.sessions) <= k:
            continue
        session, table = unit.sessions[k], tables[u]
        before = unit.sessions[k - 1].year if k else unit.year
        years[u] = max(session.year - before, 0.0)
        p = session.axis_index.size
        rows = np.zeros((p, table.n_parameters))
        for j in range(len(AXES)):
            of_axis = session.axis_index == j
            rows[of_axis] = table.basis(j, session.temperature_degC[of_axis])
        values = _values(table)
        H[u, :p, : values.size] = rows[:, values]
        y[u, :p] = session.bias_deg_h - rows @ table.parameters
        mask = (session.axis_index[:, None] == session.axis_index[None, :]).astype(float)
        start, end = bin_edges(session.time_s, session.duration_s)
        fixed[u, :p, :p] = session.covariance_without_creep
        creep[u, :p, :p] = np.diag(session.creep_variance)
        same[u, :p, :p] = mask
        flicker[u, :p, :p] = mask * flicker_covariance(
            start, end, lowest_hz=0.25 / session.run_length_s
        )
        walk[u, :p, :p] = mask * random_walk_covariance(start, end) / HOUR
        axes[u, np.arange(p), session.axis_index] = 1.0
        points[u] = p
    return _Session(years, H, y, fixed, creep, same, flicker, walk, axes, points)
