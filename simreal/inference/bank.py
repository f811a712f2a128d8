"""The bank of hypotheses: whitened signatures of every effect, target and grid point, and of the
free functions.

All that the attribution needs of them is their Gram matrix and their products with the data, so
both the data and the replicates of the noise are judged by the same few numbers.

Decision: docs/decisions/0024-null-replicates.md.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ins.errors.base import ACCELS, GYROS, Effect, ShapeParameter
from ins.errors.table import TABLE_AGED
from ins.errors.telemetry import Telemetry, Trace
from ins.errors.unnamed import OF_RUN
from ins.records import TwinModel
from ins.units import DEG_PER_HOUR, MICRO_G
from simreal.declared.generic import MOTION_SIZE, Generic, generic_functions
from simreal.evidence.whitened import CHANNELS, SENSORS, Evidence

# squared sizes that the prior mixes
SIZES = np.array([9.0, 36.0, 144.0, 576.0, 2304.0, 9216.0, 36864.0, 147456.0])
GENERIC_LOG_PRIOR = -2.0  # of a free function
LOG_PRIOR = {OF_RUN: -3.0, TABLE_AGED: 0.0}
# times the upper end of the usual range, and the prior is thin; chosen: 1e2, a step of e^-3 there
REACH = 100.0
# deg/h and ug of the units the catalogue's usual sizes are for
NAVIGATION_TURN_ON = {"gyro": 0.003, "accel": 30.0}
OUTLIER_OFFSETS_S = (-4.0, -1.0, 2.0)
# turns of a vehicle that are taken out of a run in which it moves
TURNS = frozenset({"platform_settling", "platform_step"})


@dataclass(frozen=True)
class Group:
    """One grid point of a hypothesis: its shape parameters and the bank's columns, one a
    coefficient.

    precision: of the coefficients before any data, which the bank's Gram matrix holds as if they
    had been measured to be 0 once; 0: they are free.
    """

    shape: Mapping[str, float]
    columns: NDArray
    scale: NDArray  # typical coefficients
    log_weight: float = 0.0  # of this grid point among its hypothesis's
    precision: float = 0.0


@dataclass
class Hypothesis:
    """An effect on a target (in one run, for an event), or a free function."""

    name: str
    target: str
    effect: Effect | None
    generic: Generic | None = None
    run: int | None = None
    log_prior: float = 0.0
    groups: list[Group] = field(default_factory=list)
    coarse: int = 1

    def weigh(self) -> None:
        """Equal weights on the grid."""
        self.coarse = len(self.groups)
        self.groups = [replace(g, log_weight=-float(np.log(self.coarse))) for g in self.groups]

    def refine(self, group: Group) -> Group:
        """Enter a point between those of the grid, at half the weight of one of them."""
        entered = replace(group, log_weight=-float(np.log(2.0 * self.coarse)))
        self.groups.append(entered)
        return entered

    @property
    def of_table(self) -> bool:
        """What the table's own covariance leaves open."""
        return self.name == TABLE_AGED

    @property
    def named(self) -> bool:
        return self.effect is not None or self.of_table

    @property
    def key(self) -> tuple[str, str, int | None]:
        return (self.name if self.effect is None else self.effect.id), self.target, self.run


def unit_scale(effect: Effect, target: str, evidence: Evidence) -> float:
    """How much larger the usual sizes are for this unit than for one of navigation grade."""
    twin = evidence.twin
    if target in GYROS:
        return max(1.0, twin.gyro.turn_on_deg_h / NAVIGATION_TURN_ON["gyro"])
    if target in ACCELS:
        return max(1.0, twin.accel.turn_on_ug / NAVIGATION_TURN_ON["accel"])
    return 1.0


def usual_coefficient(target: str, twin: TwinModel) -> float:
    """The usual coefficient of a free function on a target [rad/s, m/s^2, m/s or m].

    On a gyro or an accelerometer it is the twin's turn-on sigma; on odometer, vehicle and GNSS it
    is what would matter there (MOTION_SIZE).
    """
    if target in GYROS:
        return twin.gyro.turn_on_deg_h * DEG_PER_HOUR
    if target in ACCELS:
        return twin.accel.turn_on_ug * MICRO_G
    return MOTION_SIZE[target]


def shapes_of(
    effect: Effect, run: Telemetry | None, bounds: Mapping[str, tuple[float, float]] | None = None
) -> list[dict[str, float]]:
    """The grid of an effect's shape parameters; an onset is scanned over the run."""
    grids = []
    for parameter in effect.shape:
        low, high = (bounds or {}).get(parameter.name, limits(parameter, run))
        grids.append(parameter.grid(low, high))
    names = [p.name for p in effect.shape]
    return [dict(zip(names, map(float, values))) for values in product(*grids)]


def limits(parameter: ShapeParameter, run: Telemetry | None) -> tuple[float, float]:
    """Bounds of a shape parameter; those of time are cut to the run, half a grid step inside."""
    if not parameter.of_time or run is None:
        return parameter.low, parameter.high
    margin = 0.5 * (run.time_s[-1] - run.time_s[0]) / parameter.steps
    return float(run.time_s[0] + margin), float(run.time_s[-1] - margin)


def silent(target: str) -> str:
    """What an effect lacks whose sensor says nothing."""
    return f"values of {target}"


class Bank:
    """Columns of all hypotheses over an evidence; `gram` (m, m), `score` (m,) = columns' products
    with the data.

    tables : what the twin's table leaves open (`table_errors`).
    """

    def __init__(
        self,
        evidence: Evidence,
        effects: Sequence[Effect],
        *,
        with_generic: bool = True,
        tables: Sequence[Generic] = (),
    ) -> None:
        self.evidence = evidence
        self.telemetry = [view.telemetry for view in evidence.views]
        self.hypotheses: list[Hypothesis] = []
        self.not_testable: list[tuple[str, str, str]] = []
        self._specs: list[list[Trace | None]] = []
        for effect in effects:
            for target in effect.targets:
                self._add_effect(effect, target)
        free = generic_functions(self.telemetry) if with_generic else ()
        self.generics = (*free, *tables)
        for generic in self.generics:
            self._add_generic(generic)
        for hypothesis in self.hypotheses:
            hypothesis.weigh()
        self._grid = len(self._specs)
        self._fill()

    def anew(self) -> "Bank":
        """The grid as it was before anything was refined."""
        out = copy(self)
        out.hypotheses = [replace(h, groups=h.groups[: h.coarse]) for h in self.hypotheses]
        return out

    def under(self, evidence: Evidence) -> "Bank":
        """The grid on the same runs under another noise: columns are whitened, not made again."""
        out = self.anew()
        out.evidence, out._specs = evidence, self._specs[: self._grid]
        out._fill()
        return out

    def _add_effect(self, effect: Effect, target: str) -> None:
        if lacks := effect.needs(self.telemetry, target) or self._silent(target):
            self.not_testable.append((effect.name, target, lacks))
            return
        if not effect.coefficients or not effect.traces(
            self.telemetry[0], target, shapes_of(effect, self.telemetry[0])[0]
        ):
            return
        for run in self._runs_of(effect):
            prior = getattr(effect, "log_prior", 0.0) - (
                np.log(len(self.telemetry)) if run is not None else 0.0
            )
            hypothesis = Hypothesis(effect.name, target, effect, run=run, log_prior=float(prior))
            whole = next(
                (
                    h
                    for h in self.hypotheses
                    if h.key == (getattr(effect, "whole", None), target, run)
                ),
                None,
            )
            if whole is not None:  # a part of an effect whose columns are there already
                kept = list(getattr(effect, "kept", ()))
                hypothesis.groups = [
                    Group(g.shape, g.columns[kept], g.scale[kept]) for g in whole.groups
                ]
                hypothesis.weigh()
                self.hypotheses.append(hypothesis)
                continue
            shapes = shapes_of(effect, None if run is None else self.telemetry[run])
            for shape in [*shapes, *(self._at_outliers(shapes[0], run) if run is not None else ())]:
                hypothesis.groups.append(self.new_group(effect, target, shape, run))
            hypothesis.weigh()
            self.hypotheses.append(hypothesis)

    def _runs_of(self, effect: Effect) -> Sequence[int | None]:
        """The runs that an event may be in; None: all together."""
        if effect.repeats != "E":
            return (None,)
        views = self.evidence.views
        return [k for k, v in enumerate(views) if v.motion is None or effect.name not in TURNS]

    def _silent(self, target: str) -> str:
        """What is missing where a sensor has no values in any run."""
        if target not in CHANNELS[:SENSORS] or any(
            run.parked.live[CHANNELS.index(target)] for run in self.evidence.runs
        ):
            return ""
        return silent(target)

    def _at_outliers(self, shape: Mapping[str, float], run: int) -> list[dict[str, float]]:
        """Onsets at a run's outliers: what lasts seconds falls between the points of a scan in
        minutes.
        """
        if "onset_s" not in shape:
            return []
        return [
            {**shape, "onset_s": t + d}
            for t in self.evidence.runs[run].outlier_times()
            for d in OUTLIER_OFFSETS_S
        ]

    def new_group(
        self, effect: Effect, target: str, shape: Mapping[str, float], run: int | None
    ) -> Group:
        """Columns of an effect at a grid point, entered in the bank's list; they are whitened by
        `_fill`.
        """
        first = len(self._specs)
        scale = unit_scale(effect, target, self.evidence)
        typical = [scale * np.sqrt(c.low * c.high) for c in effect.coefficients]
        own: list[tuple[Trace, ...] | None] = [
            effect.traces(t, target, shape) if run in (None, k) else None
            for k, t in enumerate(self.telemetry)
        ]
        if effect.repeats == "P":  # a coefficient of its own in each run
            for k in range(len(self.telemetry)):
                traces = own[k]
                assert traces is not None
                self._specs.append(
                    [traces[0] if j == k else None for j in range(len(self.telemetry))]
                )
            typical = typical * len(self.telemetry)
        else:
            for c in range(len(effect.coefficients)):
                self._specs.append([None if traces is None else traces[c] for traces in own])
        return Group(shape, np.arange(first, len(self._specs)), np.array(typical))

    def _add_generic(self, generic: Generic) -> None:
        same = next(
            (h for h in self.hypotheses if (h.name, h.target) == (generic.name, generic.target)),
            None,
        )
        if same is None:
            prior = LOG_PRIOR.get(generic.name, GENERIC_LOG_PRIOR)
            same = Hypothesis(generic.name, generic.target, None, generic, log_prior=prior)
            self.hypotheses.append(same)
        first = len(self._specs)
        per_run = [generic.traces(t) for t in self.telemetry]
        for c in range(len(per_run[0])):
            self._specs.append([traces[c] if _any(traces[c]) else None for traces in per_run])
        count = len(self._specs) - first
        # those of a table are in sigmas already
        declared = same.of_table
        typical = 1.0 if declared else usual_coefficient(generic.target, self.evidence.twin)
        same.groups.append(
            Group(
                {"nodes": float(generic.resolution)},
                np.arange(first, first + count),
                np.full(count, typical),
                precision=float(declared),
            )
        )

    def _fill(self) -> None:
        """Whiten what has been entered since the last call."""
        runs, m = self.evidence.runs, len(self._specs)
        # of each run, in pieces as they were entered: numbers of the columns, whitened (rows, k)
        self.blocks: list[list[tuple[NDArray, NDArray]]] = []
        self._room = np.zeros((2 * m, 2 * m))  # of the Gram matrix, for what is appended
        self.gram, self.score = self._room[:m, :m], np.zeros(m)
        for k, run in enumerate(runs):
            present, A = self._whitened(k, 0)
            self.gram[np.ix_(present, present)] += _gram(A, run.blocks)
            self.score[present] += A.T @ self.evidence.z[self.evidence.rows_of(k)]
            self.blocks.append([(present, A)])
        for hypothesis in self.hypotheses:
            for group in hypothesis.groups:
                self.gram[group.columns, group.columns] += group.precision

    def append(
        self, effect: Effect, target: str, shapes: Sequence[Mapping[str, float]], run: int | None
    ) -> list[Group]:
        """New grid points of an effect, whitened and entered beside the others."""
        before = len(self._specs)
        groups = [self.new_group(effect, target, shape, run) for shape in shapes]
        self._whiten_from(before)
        return groups

    def append_traces(self, traces: Sequence[Sequence[Trace]], like: Group) -> Group:
        """Columns given by their traces (runs, columns), as a group with the scale of another."""
        before = len(self._specs)
        for c in range(len(traces[0])):
            self._specs.append([own[c] for own in traces])
        self._whiten_from(before)
        columns = np.arange(before, len(self._specs))
        self.gram[columns, columns] += like.precision
        return replace(like, columns=columns)

    def _whitened(self, run: int, before: int) -> tuple[NDArray, NDArray]:
        """Numbers from `before` on of the columns that show in a run (k,), and their rows there
        (rows, k).
        """
        present, traces = [], []
        for column, of_runs in enumerate(self._specs[before:], before):
            trace = of_runs[run]
            if trace is not None:
                present.append(column)
                traces.append(trace)
        rows = self.evidence.runs[run].whiten(traces)
        return np.array(present, dtype=int), rows.astype(np.float32)

    def _whiten_from(self, before: int) -> None:
        """Whiten and enter the columns from number `before` on."""
        m = len(self._specs)
        if m > len(self._room):
            room = np.zeros((2 * m, 2 * m))
            room[:before, :before] = self.gram
            self._room = room
        self.gram = self._room[:m, :m]
        self.score = np.concatenate([self.score, np.zeros(m - before)])
        for k, pieces in enumerate(self.blocks):
            if all(of[k] is None for of in self._specs[before:]):
                continue
            fresh, new = self._whitened(k, before)
            self.gram[np.ix_(fresh, fresh)] += new.T @ new
            for present, A in pieces:
                cross = A.T @ new
                self.gram[np.ix_(present, fresh)] += cross
                self.gram[np.ix_(fresh, present)] += cross.T
            self.score[fresh] += new.T @ self.evidence.z[self.evidence.rows_of(k)]
            pieces.append((fresh, new))

    def matrix(self, columns: NDArray) -> NDArray:
        """Whitened rows of columns (rows, k)."""
        out = np.zeros((self.evidence.size, len(columns)))
        for k, pieces in enumerate(self.blocks):
            for present, A in pieces:
                there = np.flatnonzero(np.isin(columns, present))
                here = np.searchsorted(present, columns[there])
                out[self.evidence.rows_of(k), there] = A[:, here]
        return out

    def signature(self, columns: NDArray, coefficients: NDArray) -> NDArray:
        """Whitened rows of a combination of columns."""
        return np.asarray(self.matrix(columns) @ coefficients)

    def replicate_scores(self, z: NDArray) -> NDArray:
        """Products (m, reps) of the columns with replicates of the rows (rows, reps)."""
        out = np.zeros((len(self._specs), z.shape[1]))
        for k, pieces in enumerate(self.blocks):
            # as coarse as the columns themselves: numpy would widen those to 64 bits first
            coarse = z[self.evidence.rows_of(k)].astype(np.float32)
            for present, A in pieces:
                out[present] += A.T @ coarse
        return out

    def generic_of(self, hypothesis: Hypothesis, group: Group) -> Generic:
        """The free function that a group of a nameless hypothesis holds, at its resolution."""
        key = hypothesis.name, hypothesis.target, int(group.shape["nodes"])
        return next(g for g in self.generics if g.key == key)

    def traces_of(self, column: int, run: int) -> Trace | None:
        """A column before whitening."""
        return self._specs[column][run]


def _any(trace: Trace) -> bool:
    """Whether a trace adds anything at all."""
    return any(np.any(v) for v in vars(trace).values() if v is not None)


def _gram(A: NDArray, blocks: Sequence[slice]) -> NDArray:
    """A' A, block of rows by block: most effects leave most channels alone."""
    out = np.zeros((A.shape[1], A.shape[1]))
    for rows in blocks:
        part = A[rows]
        used = np.flatnonzero(part.any(axis=0))
        if used.size:
            B = np.ascontiguousarray(part[:, used])
            out[np.ix_(used, used)] += B.T @ B
    return out


def size_weights(
    group_norm: float | NDArray, low: float | NDArray, high: float | NDArray
) -> NDArray:
    """Log weights of SIZES for a signature of this norm per unit: flat over the usual range,
    falling as its inverse root beyond it, thin beyond REACH times its end; at most 1 together.

    Where the data cannot choose, the more usual of two sizes leads and the other stays in the set.
    """
    coefficient = np.sqrt(SIZES) / np.maximum(group_norm, 1e-300)
    beyond = np.maximum(coefficient / high, 1.0)
    weight = -0.5 * np.log(beyond) - 3.0 * (beyond > REACH)
    weight = weight - 1.0 * (coefficient < low / 30.0)
    return np.asarray(weight - np.log(SIZES.size))
