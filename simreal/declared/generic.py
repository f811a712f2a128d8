"""Answers without a name: free functions of temperature, its rate, time or run on one channel, as
competitors; and what a table's own covariance leaves open.

Straight lines between nodes ("hats"), at several resolutions; a smooth effect of the catalogue with
its few parameters beats them where it fits, and loses where nothing named does.

Decision: docs/decisions/0084-table-error-state.md.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import ThermalTable
from ins.errors.base import ACCELS, AXIS, GYROS
from ins.errors.table import TABLE_AGED
from ins.errors.telemetry import Telemetry, Trace, on_axis
from ins.errors.unnamed import (
    OF_RATE,
    OF_RUN,
    OF_TEMPERATURE,
    OF_TIME,
    UNKNOWN_MOTION,
    WHILE_MOVING,
)
from ins.units import DEG_PER_HOUR

# curves over what is logged, which must hold in data that they are not drawn through
OF_TELEMETRY = frozenset({OF_TEMPERATURE, OF_RATE, OF_TIME})
# of the motion: found, but nothing that a simulator can make
OF_UNNAMED_MOTION = frozenset({UNKNOWN_MOTION, WHILE_MOVING})
# of a table's error: temperatures that it is drawn over, and the least variance of a curve in them
# relative to the largest; chosen: 1e-4, a hundredth of its sigma
TABLE_NODES, LEAST_CURVE = 25, 1e-4
# what belongs to one run alone, and cannot be carried to another
OF_ONE_RUN = frozenset({OF_RUN, WHILE_MOVING})
# of a free function of the time in motion; chosen: half the period of the quickest error that moves
# a level by more than its accelerometer's noise over 10 s, and so few columns for a long flight
MOVING_NODE_S, MOST_MOVING_NODES = 20.0, 40
# m/s, m/s, m at 10 m/s: what would matter there
MOTION_SIZE = {"odometer": 0.02, "vehicle": 0.02, "gnss": 0.5}
Hats = Callable[[Telemetry], NDArray]  # (n, p) of a run; columns of zeros leave it alone
Quantity = Callable[[Telemetry, str], NDArray | None]


@dataclass(frozen=True)
class Generic:
    """One free function on one channel: `traces(run)` gives its p columns, `curves` (nodes, p) what
    a unit of each is at the nodes (None: one of each).
    """

    name: str
    target: str
    resolution: int
    hats: Hats
    nodes: tuple[float, ...] = ()
    curves: NDArray | None = None

    @property
    def key(self) -> tuple[str, str, int]:
        return self.name, self.target, self.resolution

    def traces(self, run: Telemetry) -> tuple[Trace, ...]:
        columns = self.hats(run).T
        if self.target == "odometer":
            return tuple(Trace(odometer_m_s=c) for c in columns)
        if self.target == "vehicle":
            return tuple(Trace(lateral_m_s=c) for c in columns)
        if self.target == "gnss":
            return tuple(_fix_error(run, c) for c in (*columns, *(1j * columns)))
        axis = AXIS[self.target]
        gyro = self.target in GYROS
        return tuple(
            Trace(gyro_rad_s=on_axis(c, axis)) if gyro else Trace(accel_m_s2=on_axis(c, axis))
            for c in columns
        )


def generic_functions(runs: Sequence[Telemetry]) -> tuple[Generic, ...]:
    """All free functions that the runs' telemetry allows, for each gyro and accelerometer."""
    out: list[Generic] = []
    for target in (*GYROS, *ACCELS):
        for name, quantity in ((OF_TEMPERATURE, _temperature), (OF_RATE, _rate)):
            values = [quantity(run, target) for run in runs]
            if any(v is None for v in values):
                continue
            for nodes in (4, 8, 16) if name == OF_TEMPERATURE else (4, 8):
                out.append(_hats(name, target, quantity, _nodes(values, nodes)))
        for nodes in (4, 8, 16):
            out.append(
                _hats(OF_TIME, target, _time, _nodes([_time(r, target) for r in runs], nodes))
            )
        if len(runs) > 1:
            out.append(Generic(OF_RUN, target, len(runs), _of_run(len(runs))))
        out += moving_functions(runs, target)
    return (*out, *motion_functions(runs))


def table_errors(table: ThermalTable, runs: Sequence[Telemetry]) -> tuple[Generic, ...]:
    """What a table's covariance leaves open of each gyro's bias, over the temperatures of the runs.

    One drawn error e(T) for all runs, as a body-fixed bias of the gyro. It is principal curves of
    one sigma each, so that coefficients of N(0, 1) draw it::

        cov(e(T), e(T')) = h(T) P h(T')' = sum_k c_k(T) c_k(T')

    h: the rows of the table, P: its covariance, with nodes for temperatures that it does not hold.
    Covariances between the gyros are left out, which makes no gyro's error smaller. Empty for a
    table without any.
    """
    read = [run.temperature_degC for run in runs if run.temperature_degC is not None]
    if not read:
        return ()
    every = np.concatenate(read)
    wide = table.extended_to(float(every.min()), float(every.max()))
    out = []
    for target in GYROS:
        nodes = _nodes([every[:, AXIS[target]]], TABLE_NODES)
        rows = wide.basis(AXIS[target], nodes)
        values, vectors = np.linalg.eigh(rows @ wide.covariance @ rows.T)
        kept = values > LEAST_CURVE * values[-1]
        if kept.any():
            curves = DEG_PER_HOUR * vectors[:, kept] * np.sqrt(values[kept])
            hats, at = _of_curves(target, nodes, curves), tuple(nodes.tolist())
            out.append(Generic(TABLE_AGED, target, int(kept.sum()), hats, at, curves))
    return tuple(out)


def _of_curves(target: str, nodes: NDArray, curves: NDArray) -> Hats:
    """Curves (nodes, p) of a gyro's temperature; a run without one has no table to be off."""

    def hats(run: Telemetry) -> NDArray:
        T = _temperature(run, target)
        if T is None:
            return np.zeros((run.n, curves.shape[1]))
        return np.stack([np.interp(T, nodes, curve) for curve in curves.T], axis=1)

    return hats


def moving_functions(runs: Sequence[Telemetry], target: str) -> list[Generic]:
    """Free functions of a sensor's error in motion alone: of the motion, and of the time in motion.

    The second has nodes of its own in each run. Nothing of either reaches a parked second.
    """
    nodes = [_moving_nodes(run) for run in runs]
    count = sum(n.size for n in nodes)
    if not count:
        return []
    functions = {_MOTION_COLUMNS: _of_moving, count: _over_moving(nodes)}
    return [Generic(WHILE_MOVING, target, k, hats) for k, hats in sorted(functions.items())]


_MOTION_COLUMNS = 5  # of `_of_moving`


def _moving_nodes(run: Telemetry) -> NDArray:
    """Nodes over the time from the first to the last second in motion [s]."""
    moving = run.time_s[~run.parked]
    if not moving.size:
        return np.zeros(0)
    span = float(moving[-1] - moving[0])
    count = int(np.clip(np.ceil(span / MOVING_NODE_S), 1, MOST_MOVING_NODES)) + 1
    return np.linspace(moving[0], moving[0] + max(span, 1.0), count)


def _over_moving(nodes: Sequence[NDArray]) -> Hats:
    first = np.concatenate([[0], np.cumsum([n.size for n in nodes])])

    def hats(run: Telemetry) -> NDArray:
        own = nodes[run.run_index]
        out = np.zeros((run.n, int(first[-1])))
        for k, row in enumerate(np.eye(own.size)):
            out[:, first[run.run_index] + k] = np.interp(run.time_s, own, row)
        return out * ~run.parked[:, None]

    return hats


def motion_functions(runs: Sequence[Telemetry]) -> tuple[Generic, ...]:
    """Free functions of the motion on odometer, side slip and GNSS: of speed, its square,
    acceleration and turn rate.
    """
    out = []
    if any(run.rolling.any() for run in runs):
        out.append(Generic(UNKNOWN_MOTION, "vehicle", 4, _of_motion))
        if any(run.has_odometer for run in runs):
            out.append(Generic(UNKNOWN_MOTION, "odometer", 4, _of_motion))
    if any(run.has_gnss for run in runs):
        out.append(Generic(UNKNOWN_MOTION, "gnss", 5, _of_fixes))
    return tuple(out)


def _of_motion(run: Telemetry) -> NDArray:
    v, a, turn = run.speed_m_s, run.acceleration_m_s2, run.turn_rad_s
    columns = np.stack([v / 10.0, (v / 10.0) ** 2, a, v * turn], axis=1)
    return np.asarray(columns * (run.rolling | (np.abs(v) > 0.5))[:, None])


def _of_moving(run: Telemetry) -> NDArray:
    """A constant and the motion, while the vehicle moves."""
    return _of_fixes(run) * ~run.parked[:, None]


def _of_fixes(run: Telemetry) -> NDArray:
    return np.column_stack([np.ones(run.n), _of_motion(run)])


def _fix_error(run: Telemetry, column: NDArray) -> Trace:
    """A position error along (real) or across (imaginary) the heading, with the velocity error that
    goes with it not read.
    """
    heading = run.heading_rad
    along = np.stack([np.cos(heading), np.sin(heading), np.zeros(run.n)], axis=1)
    across = np.stack([-np.sin(heading), np.cos(heading), np.zeros(run.n)], axis=1)
    return Trace(
        gnss_position_m=np.real(column)[:, None] * along + np.imag(column)[:, None] * across
    )


def _hats(name: str, target: str, quantity: Quantity, nodes: NDArray) -> Generic:
    return Generic(
        name, target, nodes.size, _over(quantity, target, nodes), tuple(float(n) for n in nodes)
    )


def _temperature(run: Telemetry, target: str) -> NDArray | None:
    T = run.temperature_degC if target in GYROS else run.accel_degC
    return None if T is None else T[:, AXIS[target]]


def _rate(run: Telemetry, target: str) -> NDArray | None:
    rate = run.temperature_rate_degC_min
    return None if rate is None else rate[:, AXIS[target]]


def _time(run: Telemetry, target: str) -> NDArray:
    return run.time_s


def _nodes(values: Sequence[NDArray | None], count: int) -> NDArray:
    low = min(float(np.min(v)) for v in values if v is not None)
    high = max(float(np.max(v)) for v in values if v is not None)
    return np.linspace(low, max(high, low + 1e-6), count)


def _over(quantity: Quantity, target: str, nodes: NDArray) -> Hats:
    def hats(run: Telemetry) -> NDArray:
        values = quantity(run, target)
        assert values is not None
        return np.stack([np.interp(values, nodes, row) for row in np.eye(nodes.size)], axis=1)

    return hats


def _of_run(count: int) -> Hats:
    def hats(run: Telemetry) -> NDArray:
        out = np.zeros((run.n, count))
        out[:, run.run_index] = 1.0
        return out

    return hats
