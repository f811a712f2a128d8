"""How likely the sessions of many units are under given parameters: the model of the table merge,
exact in its Gaussian part.

A unit's table ages between its sessions (`ThermalTable.aged`), session i measures::

    y_i = H_i x(t_i) + t_i + v_i,    t_i: turn-on, flicker, rate random walk;  v_i: measurement

and x, t, v are integrated out by a filter over the sessions of each unit, all units side by side. A
session is an outlier with a small probability: then each gyro is shifted as a whole by a large
random amount. Which sessions are is summed over the histories that are likely; each has a filter of
its own, because an early outlier is often found by later sessions only. Units: deg/h, years.
Source: physics.md 6.8.

Decision: docs/decisions/0067-drawn-posterior.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from infield.learning.parameters import OF_POINTS, OUTLIER_SIZE, PriorName, defaults_of, logs_of
from infield.learning.stored_sessions import StoredSession, StoredUnit, covering, curve_rows
from infield.table.merge import bin_edges
from infield.table.thermal_table import ThermalTable
from ins.errors.table import DEFAULT_SIGMA_deg_h
from ins.noise import flicker_covariance, random_walk_covariance
from ins.records import AXES
from ins.units import HOUR

LOG_2_PI = float(np.log(2.0 * np.pi))
LARGEST_SHARE = 0.5  # of outliers: beyond it they would be the rule
HISTORIES_FOLLOWED = 8  # of a unit: three sessions in doubt have eight
KEPT_PROBABILITY = 0.98  # of those kept together: the log likelihood of a unit falls by 0.02


@dataclass(frozen=True)
class FleetEvidence:
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
    table, and the parts of the covariance: fixed, and of each parameter its `own`; points (u,): how
    many are real.
    """

    years: NDArray
    H: NDArray
    y: NDArray
    fixed: NDArray
    own: dict[PriorName, NDArray]
    points: NDArray

    @property
    def same_axis(self) -> NDArray:
        """1 where two points are of one gyro."""
        return self.own[PriorName.TURN_ON]

    def of(self, unit: NDArray) -> "_Session":
        """Of some units, in this order."""
        return _Session(
            self.years[unit],
            self.H[unit],
            self.y[unit],
            self.fixed[unit],
            {name: part[unit] for name, part in self.own.items()},
            self.points[unit],
        )

    @cached_property
    def H_transposed(self) -> NDArray:
        """Laid down as it is read."""
        return np.ascontiguousarray(self.H.transpose(0, 2, 1))


@dataclass(frozen=True)
class _Level:
    """The k-th sessions under each way in which those up to it may be outliers: of which row of the
    level before it goes on, its unit, 1 for an outlier; the session, laid down for these rows.
    """

    parent: NDArray
    unit: NDArray
    outlier: NDArray
    session: _Session


@dataclass(frozen=True)
class _Histories:
    """Which sessions of a unit are outliers, in several ways: the unit of each history (r,), and 1
    for an outlier (r, s).
    """

    unit: NDArray
    outlier: NDArray

    def levels(self, sessions: Sequence[_Session]) -> list[_Level]:
        """Session by session, what histories have in common once; the last has each history in
        turn.
        """
        every = np.column_stack([self.unit, self.outlier]).astype(int)
        every = np.unique(every, axis=0)
        found = []
        before = np.unique(every[:, :1], axis=0, return_inverse=True)[1].ravel()
        for k, session in enumerate(sessions):
            rows, first, of_history = np.unique(
                every[:, : k + 2], axis=0, return_index=True, return_inverse=True
            )
            unit = rows[:, 0]
            found.append(_Level(before[first], unit, rows[:, -1].astype(float), session.of(unit)))
            before = of_history.ravel()
        return found


@dataclass(frozen=True)
class _State:
    """What the sessions so far say under each history: log likelihood (r,), mean (r, n) and
    covariance (r, n, n) of the nodes' departure.
    """

    log_likelihood: NDArray
    x: NDArray
    P: NDArray

    def of(self, rows: NDArray) -> "_State":
        return _State(self.log_likelihood[rows], self.x[rows], self.P[rows])


class FleetLikelihood:
    """The sessions of units of one technology, laid down once, asked for many parameters.

    Units must have tables of node values (`linear`); of `hermite` ones the values alone age here.
    """

    def __init__(self, units: Sequence[StoredUnit]) -> None:
        self.units = tuple(units)
        self.tables = tuple(covering(unit) for unit in units)
        technology = units[0].gyro_technology
        n = max(_values(table).size for table in self.tables)
        self._nodes = _laid_nodes(self.tables, n)
        self._sessions = _laid_sessions(self.units, self.tables, n)
        self._shift = (OUTLIER_SIZE * DEFAULT_SIGMA_deg_h[technology]) ** 2
        self.look_again(logs_of(defaults_of(technology)))

    def look_again(self, theta: NDArray) -> None:
        """Sum over the histories that are likely at theta from now on."""
        self._levels = self._likely(theta).levels(self._sessions)

    def log_likelihood(self, theta: NDArray) -> NDArray:
        """Of each unit's sessions, (u,); minus infinity where the parameters are so far off that
        the covariances lose their digits.
        """
        model = _Model(self._nodes, theta, self._shift)
        state = model.start()
        try:
            for level in self._levels:
                state = model.after(state, level)
        except np.linalg.LinAlgError:
            return np.full(len(self.units), -np.inf)
        return self._summed(state.log_likelihood, self._levels[-1].unit)

    def __call__(self, theta: NDArray) -> FleetEvidence:
        """The evidence at logarithms of the parameters, (p,) for all units or (u, p)."""
        levels = self._likely(theta).levels(self._sessions)
        model = _Model(self._nodes, theta, self._shift)
        state, unit = model.start(), np.arange(len(self.units))
        outlier = np.zeros((unit.size, 0))
        nis = []
        for level in levels:
            share = self._shares(state.log_likelihood, unit)[level.parent]
            same = np.bincount(level.parent)[level.parent]  # rows that go on from one
            squared = model.nis(state, level)
            nis.append(self._weighed(share / same, squared[:, None], level.unit)[:, 0])
            state, unit = model.after(state, level), level.unit
            outlier = np.column_stack([outlier[level.parent], level.outlier])
        w = self._shares(state.log_likelihood, unit)
        mean = self._weighed(w, state.x, unit)
        apart = state.x - mean[unit]
        spread = state.P + apart[:, :, None] * apart[:, None, :]
        flat = self._weighed(w, spread.reshape(unit.size, -1), unit)
        sessions = (len(self._sessions), len(self.units))
        return FleetEvidence(
            self._summed(state.log_likelihood, unit),
            np.array(nis).reshape(sessions).T,
            np.array([s.points for s in self._sessions]).reshape(sessions).T,
            self._weighed(w, outlier, unit),
            mean,
            flat.reshape(-1, *state.P.shape[1:]),
        )

    def _likely(self, theta: NDArray) -> _Histories:
        """The histories of each unit that are likely at theta."""
        model = _Model(self._nodes, theta, self._shift)
        unit = np.arange(len(self.units))
        outlier = np.zeros((unit.size, 0))
        state = model.start()
        for session in self._sessions:
            both = np.concatenate([np.arange(unit.size), np.flatnonzero(session.points[unit] > 0)])
            flag = (np.arange(both.size) >= unit.size).astype(float)
            unit, outlier = unit[both], np.column_stack([outlier[both], flag])
            state = model.after(state, _Level(both, unit, flag, session.of(unit)))
            kept = _best(state.log_likelihood, unit, HISTORIES_FOLLOWED)
            unit, outlier, state = unit[kept], outlier[kept], state.of(kept)
        share = self._shares(state.log_likelihood, unit)  # the likeliest of a unit first
        likelier = np.cumsum(share) - share - unit
        return _Histories(unit[likelier < KEPT_PROBABILITY], outlier[likelier < KEPT_PROBABILITY])

    def _summed(self, log_likelihood: NDArray, unit: NDArray) -> NDArray:
        """Over the histories of each unit."""
        total = np.full(len(self.units), -np.inf)
        np.logaddexp.at(total, unit, log_likelihood)
        return total

    def _shares(self, log_likelihood: NDArray, unit: NDArray) -> NDArray:
        """Probability of each history of its unit."""
        return np.exp(log_likelihood - self._summed(log_likelihood, unit)[unit])

    def _weighed(self, share: NDArray, values: NDArray, unit: NDArray) -> NDArray:
        """Mean over the histories of each unit, (u, m)."""
        found = np.zeros((len(self.units), values.shape[1]))
        np.add.at(found, unit, share[:, None] * values)
        return found


class _Model:
    """The filter at logarithms of the parameters, (p,) or one for each unit."""

    def __init__(self, nodes: _Nodes, theta: NDArray, shift: float) -> None:
        self._value: dict[PriorName, NDArray] = {
            name: np.exp(part)[..., None, None] for name, part in zip(OF_POINTS, theta.T)
        }
        self._prior, self._growth = nodes.prior, _growth(nodes, self._value)
        self._shift = shift

    def start(self) -> _State:
        """Before any session, a row a unit."""
        units, n = self._prior.shape[:2]
        return _State(np.zeros(units), np.zeros((units, n)), self._prior)

    def after(self, before: _State, level: _Level) -> _State:
        """One session later."""
        state, session = before.of(level.parent), level.session
        P, PH, S = self._predicted(state, level)
        S = S + (self._shift * level.outlier)[:, None, None] * session.same_axis
        r = session.y - _times(session.H, state.x)
        half_log_det = np.sum(np.log(np.diagonal(np.linalg.cholesky(S), axis1=1, axis2=2)), axis=1)
        S_inv = np.linalg.inv(S)
        gain = PH @ S_inv
        squared = np.sum(r * _times(S_inv, r), axis=1)
        share = np.minimum(self._of(PriorName.OUTLIER_SHARE, level.unit), LARGEST_SHARE)
        odds = np.where(level.outlier[:, None, None] > 0.0, np.log(share), np.log1p(-share))
        found = odds[:, 0, 0] - 0.5 * squared - half_log_det - 0.5 * session.points * LOG_2_PI
        after = P - gain @ PH.transpose(0, 2, 1)
        return _State(
            state.log_likelihood + np.where(session.points > 0, found, 0.0),
            state.x + _times(gain, r),
            0.5 * (after + after.transpose(0, 2, 1)),
        )

    def nis(self, before: _State, level: _Level) -> NDArray:
        """Squared normalised innovation of a session taken for no outlier, (r,)."""
        state, session = before.of(level.parent), level.session
        S = self._predicted(state, level)[2]
        r = session.y - _times(session.H, state.x)
        return np.asarray(np.sum(r * _times(np.linalg.inv(S), r), axis=1))

    def _predicted(self, state: _State, level: _Level) -> tuple[NDArray, NDArray, NDArray]:
        """Covariances at the session's date: of the nodes, of nodes and points, of points."""
        session = level.session
        P = state.P + session.years[:, None, None] * self._growth[level.unit]
        PH = P @ session.H_transposed
        S = session.H @ PH + session.fixed
        for name, part in session.own.items():
            S += self._of(name, level.unit) ** 2 * part
        return P, PH, S

    def _of(self, name: PriorName, unit: NDArray) -> NDArray:
        """A parameter of each row."""
        value = self._value[name]
        return value[unit] if value.ndim > 2 else value


def _best(log_likelihood: NDArray, unit: NDArray, most: int) -> NDArray:
    """The likeliest rows of each unit, at most so many."""
    order = np.lexsort((-log_likelihood, unit))
    first = np.searchsorted(unit[order], unit[order])
    return order[np.arange(order.size) - first < most]


def _times(A: NDArray, v: NDArray) -> NDArray:
    """A matrix times a vector, unit by unit."""
    return np.asarray((A @ v[:, :, None])[:, :, 0])


def _growth(nodes: _Nodes, value: dict[PriorName, NDArray]) -> NDArray:
    """Covariance that a year of ageing adds, (u, n, n): physics.md 6.8."""
    smooth = np.exp(-nodes.squared_degC2 / (2.0 * value[PriorName.LENGTH] ** 2)) * nodes.same_axis
    return np.asarray(
        value[PriorName.AGEING_COMMON] ** 2 * nodes.common
        + value[PriorName.AGEING_SHAPE] ** 2 * smooth
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
    units: Sequence[StoredUnit], tables: Sequence[ThermalTable], n: int
) -> list[_Session]:
    most = max((len(unit.sessions) for unit in units), default=0)
    return [_laid_session(units, tables, k, n) for k in range(most)]


def _against(session: StoredSession, table: ThermalTable, n: int) -> tuple[NDArray, NDArray]:
    """What a session measured of the departure from the first table."""
    rows, apart, first = np.zeros((session.axis_index.size, n)), session.bias_deg_h.copy(), 0
    for j, nodes in enumerate(table.temperature_degC):
        of_axis = session.axis_index == j
        T = session.temperature_degC[of_axis]
        rows[of_axis, first : first + nodes.size] = curve_rows(table, j, T)
        apart[of_axis] -= table.bias_deg_h(j, T)
        first += nodes.size
    return rows, apart


def _laid_session(
    units: Sequence[StoredUnit], tables: Sequence[ThermalTable], k: int, n: int
) -> _Session:
    """The k-th session of every unit; a unit that has none gets points that say nothing."""
    count = len(units)
    m = max(len(unit.sessions[k].axis_index) for unit in units if len(unit.sessions) > k)
    H, y, years = np.zeros((count, m, n)), np.zeros((count, m)), np.zeros(count)
    fixed = np.tile(np.eye(m), (count, 1, 1))
    creep, same, flicker, walk = (np.zeros((count, m, m)) for _ in range(4))
    points = np.zeros(count)
    for u, unit in enumerate(units):
        if len(unit.sessions) <= k:
            continue
        session, table = unit.sessions[k], tables[u]
        before = unit.sessions[k - 1].year if k else unit.year
        years[u] = max(session.year - before, 0.0)
        p = session.axis_index.size
        H[u, :p], y[u, :p] = _against(session, table, n)
        mask = (session.axis_index[:, None] == session.axis_index[None, :]).astype(float)
        start, end = bin_edges(session.time_s, session.duration_s)
        fixed[u, :p, :p] = session.covariance_without_creep
        creep[u, :p, :p] = np.diag(session.creep_variance)
        same[u, :p, :p] = mask
        flicker[u, :p, :p] = mask * flicker_covariance(
            start, end, lowest_hz=0.25 / session.run_length_s
        )
        walk[u, :p, :p] = mask * random_walk_covariance(start, end) / HOUR
        points[u] = p
    own = {
        PriorName.YAW_CREEP: creep,
        PriorName.TURN_ON: same,
        PriorName.FLICKER: flicker,
        PriorName.RANDOM_WALK: walk,
    }
    return _Session(years, H, y, fixed, own, points)
