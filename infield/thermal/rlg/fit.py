"""One gyro of the ring-laser gradient fit: normal equations by run, the choice of terms on held-out
blocks, the coefficients.

Blocks of one gyro over several runs, each run's turn-on, flicker and random walk marginalised
(`thermal.blocks.axis_blocks`): runs are independent of each other, so their normal equations add,
and leaving one out is a subtraction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from infield.table.least_squares import NormalEquations, condition_number
from infield.table.merge import session_covariance
from infield.thermal.coefficient_curves import Reduced
from infield.thermal.gradient_runs import GradientRun
from infield.thermal.ramp_runs import RAMP_BLOCK_S
from infield.thermal.rlg.lag import Lag, LaggedNormal, corrected_columns, derivatives, find_lag
from infield.thermal.rlg.parameter_covariance import Open, covariance_of
from infield.thermal.rlg.terms import (
    COLLINEAR,
    LINE_TERMS,
    REST_OF_TURN_ON,
    TERMS,
    Collinear,
    columns,
    hold_apart,
    rest_nodes,
    solve_terms,
    term_sets,
)
from infield.thermal.study import INFLATE_ABOVE, AxisBlocks, axis_blocks
from ins.records import AXES, TwinModel

# of a run: every fifth stretch is held out in turn; four bins of `recal update` (5 min) each, a
# fifth of the data at a time
STRETCH_MIN, STRETCHES = 20, 5
# residuals are quoted for means over this, as long as the bins of `recal update`
RESIDUAL_S = 300.0
TEMPERATURE_ONLY = ("K1", "K2", "K3")
# chi2 of all held-out blocks that a term must take off to be kept; with less, terms that are none
# come in often
CHANCE = 4.0
LEAST_REST_deg_h = 1e-3
KNOWN_LEVEL_deg_h = 0.01  # sigma of what Earth rate may have left in K1, below which K1 is a bias


@dataclass(frozen=True)
class Residual:
    """RMS [deg/h] of held-out means over RESIDUAL_S, each run less its own mean.

    before: no model; temperature_only: K1..K3 and the rest; terms: K1..K6 without the rest; model:
    K1..K6 and the rest; noise: what white noise and the twin's drift alone would leave. over_...:
    the model's over these.
    """

    before_deg_h: float
    temperature_only_deg_h: float
    terms_deg_h: float
    model_deg_h: float
    noise_deg_h: float
    over_temperature_only: float
    over_noise: float


class Part(NamedTuple):
    """Rows of a run that are held out together with those of the same fold."""

    run: int
    rows: NDArray
    fold: int


@dataclass(frozen=True)
class TermChoice:
    """Terms and size of the rest that foretell held-out folds best: their chi2 a row."""

    terms: tuple[str, ...]
    rest_deg_h: float
    held_out_chi2: float

    @property
    def mask(self) -> NDArray:
        return np.array([name in self.terms for name in TERMS])


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Condition numbers: of the terms used, of all before any was dropped, of those with
    temperatures counted from 0 degC; and where a dependency is strong.
    """

    used: float
    all: float
    all_uncentred: float
    limit: float = COLLINEAR


@dataclass(frozen=True)
class AxisModel:
    """One gyro: coefficients theta (8 + m,), those of TERMS (0 where not used) and of the rest's
    nodes; covariance of all.

    The covariance is that of all terms that may be there and of all lags of the thermometers
    (`thermal.rlg.parameter_covariance`): it covers what leaving some out does to the others. lag:
    taken out of the columns where it was believed. orders: the best choice of each number of terms;
    temperature_only (8 + m,): the best fit without rates and lines.
    held_out: stretches; by_run: whole runs, None where there is one. scatter: as in
    `thermal.study`. level_known: K1 is a bias, not a share of Earth rate.
    """

    axis: str
    theta: NDArray
    covariance: NDArray
    nodes_degC: NDArray
    range_degC: tuple[float, float]
    choice: TermChoice
    orders: tuple[TermChoice, ...]
    collinear: tuple[Collinear, ...]
    not_better: tuple[str, ...]
    temperature_only: NDArray
    condition: Condition
    held_out: Residual
    by_run: Residual | None
    scatter: float
    level_known: bool
    rows: int
    lag: Lag = field(default_factory=Lag)

    @property
    def used(self) -> tuple[str, ...]:
        return self.choice.terms

    @property
    def sigma(self) -> NDArray:
        return np.sqrt(np.diag(self.covariance))


class AxisFit:
    """One gyro over all runs: rows by run or stretch, their normal equations, the choice of terms,
    the fit.
    """

    def __init__(
        self,
        k: int,
        runs: Sequence[GradientRun],
        twin: TwinModel,
        reference: float,
        lines: tuple[str, ...],
        free: bool,
    ) -> None:
        self.k, self.runs, self.twin, self.reference, self.free = k, runs, twin, reference, free
        self.allowed = [name for name in TERMS if name not in LINE_TERMS or name[-1] in lines]
        self.extra = np.zeros(len(runs))  # white variance that errors of the readings add
        self.all = [(j, np.flatnonzero(run.usable)) for j, run in enumerate(runs)]
        T = np.concatenate([run.blocks.temperature_degC[run.usable, k] for run in runs])
        self.range = float(T.min()), float(T.max())
        self.nodes = rest_nodes(*self.range)
        self.lag = Lag()

    def model(self) -> AxisModel:
        rests = [k * max(self.twin.gyro.turn_on_deg_h, LEAST_REST_deg_h) for k in REST_OF_TURN_ON]
        self.lag = self._find_lag(rests[len(rests) // 2])
        whole = self._sum(self.all)
        kept, dropped = hold_apart(whole.A, self._noise(), self.allowed, f"K6{AXES[self.k]}")
        stretches = [part for j, run in enumerate(self.runs) for part in self._stretches(j, run)]
        folds = self._folds(stretches)
        orders = _choose(folds, kept, rests)
        best = _shortest(orders, sum(gram.rows for gram in folds))
        plain = min(
            _choose(folds, [n for n in kept if n in TEMPERATURE_ONLY], rests),
            key=lambda c: c.held_out_chi2,
        )
        bare = replace(best, rest_deg_h=0.0)
        self.extra = self._reading_errors(solve_terms(whole, best.mask, best.rest_deg_h)[0])
        whole = self._sum(self.all)
        theta, _ = solve_terms(whole, best.mask, best.rest_deg_h)
        scatter = whole.misfit(theta) / max(whole.rows - len(best.terms), 1)
        taken = Open(
            allowed=np.array([name in self.allowed for name in TERMS]),
            own=f"K6{AXES[self.k]}",
            rest_deg_h=best.rest_deg_h,
            scatter=max(scatter, INFLATE_ABOVE),
        )
        P, lag = covariance_of(self._beside(), theta, self.lag, taken)
        level = float(max(run.blocks.level_sigma_deg_h[self.k] for run in self.runs))
        P[0, 0] += 0.0 if self.free else level**2
        allowed, used = (
            np.array([name in self.allowed for name in TERMS]),
            np.flatnonzero(best.mask),
        )
        return AxisModel(
            axis=AXES[self.k],
            theta=theta,
            covariance=P,
            nodes_degC=self.nodes,
            range_degC=self.range,
            choice=best,
            orders=orders,
            collinear=tuple(dropped),
            not_better=tuple(name for name in kept if name not in best.terms),
            temperature_only=solve_terms(whole, plain.mask, plain.rest_deg_h)[0],
            condition=Condition(
                used=condition_number(whole.A[np.ix_(used, used)]),
                all=self._condition(whole, allowed),
                all_uncentred=self._condition(self._sum(self.all, 0.0), allowed),
            ),
            held_out=self._held_out(stretches, (plain, bare, best)),
            by_run=self._by_run((plain, bare, best)),
            scatter=float(scatter),
            level_known=all(run.blocks.heading_known for run in self.runs)
            or level < KNOWN_LEVEL_deg_h,
            rows=whole.rows,
            lag=lag,
        )

    def _find_lag(self, rest_deg_h: float) -> Lag:
        """The lags under which the terms that the data hold apart explain the runs best."""
        beside = self._beside()
        kept, _ = hold_apart(beside.at(Lag()).A, self._noise(), self.allowed, f"K6{AXES[self.k]}")
        terms = np.array([name in kept for name in TERMS])
        nodes = np.ones(self.nodes.size, dtype=bool)
        at = np.flatnonzero(np.r_[terms, nodes])
        precision = np.diag(np.where(at < len(TERMS), 0.0, rest_deg_h**-2.0))
        return find_lag(beside, at, precision)

    def _beside(self) -> LaggedNormal:
        """Normal equations of the columns as read and of their derivatives, all runs."""
        grams = []
        for j, rows in self.all:
            X = self._read_columns(j, self.reference)
            both = np.column_stack([X, derivatives(X, self.runs[j].blocks.time_s)])
            grams.append(Reduced(self._blocks(j, rows)).normal(both[rows]))
        return LaggedNormal(sum(grams[1:], grams[0]))

    @staticmethod
    def _condition(gram: NormalEquations, allowed: NDArray) -> float:
        at = np.flatnonzero(allowed)
        return condition_number(gram.A[np.ix_(at, at)])

    def _stretches(self, j: int, run: GradientRun) -> list[Part]:
        """A run cut into stretches of STRETCH_MIN, every fifth of one fold."""
        rows = np.flatnonzero(run.usable)
        stretch = np.floor(
            (run.blocks.time_s[rows] - run.blocks.time_s[rows[0]]) / (60.0 * STRETCH_MIN)
        ).astype(int)
        found = [(s, rows[stretch == s]) for s in np.unique(stretch)]
        return [
            Part(j, at, int((s + j) % STRETCHES)) for s, at in found if at.size >= STRETCH_MIN // 2
        ]

    def _by_run(self, choices: Sequence[TermChoice]) -> Residual | None:
        """Each run with the coefficients of the others, None where there is one run."""
        parts = [Part(j, rows, j) for j, rows in self.all]
        return self._held_out(parts, choices) if len(parts) > 1 else None

    def _folds(self, parts: list[Part]) -> list[NormalEquations]:
        """Normal equations of each fold."""
        grams = [self._gram(part.run, part.rows, self.reference) for part in parts]
        names = sorted({part.fold for part in parts})
        found = [[gram for gram, part in zip(grams, parts) if part.fold == name] for name in names]
        return [sum(fold[1:], fold[0]) for fold in found]

    def _blocks(self, j: int, rows: NDArray) -> AxisBlocks:
        blocks = axis_blocks([self.runs[j].blocks], self.k, self.twin, free=self.free, rows=[rows])
        return replace(blocks, sigma_deg_h=np.sqrt(blocks.sigma_deg_h**2 + self.extra[j]))

    def _read_columns(self, j: int, reference: float) -> NDArray:
        """Of a whole run, as its thermometers read."""
        b, k = self.runs[j].blocks, self.k
        T, rate = b.temperature_degC[:, k], b.rate_degC_min[:, k]
        return columns(T, rate, self.runs[j].gradient_degC, reference, self.nodes)

    def _columns(self, j: int, rows: NDArray, reference: float) -> NDArray:
        X = self._read_columns(j, reference)
        return corrected_columns(X, self.runs[j].blocks.time_s, self.lag)[rows]

    def _gram(self, j: int, rows: NDArray, reference: float) -> NormalEquations:
        return Reduced(self._blocks(j, rows)).normal(self._columns(j, rows, reference))

    def _sum(
        self, parts: list[tuple[int, NDArray]], reference: float | None = None
    ) -> NormalEquations:
        grams = [
            self._gram(j, rows, self.reference if reference is None else reference)
            for j, rows in parts
        ]
        return sum(grams[1:], grams[0])

    def _noise(self) -> NDArray:
        """What errors of the readings alone make of the diagonal of the normal matrix (p,)."""
        out = np.zeros(len(TERMS))
        for run in self.runs:
            T = run.blocks.temperature_degC[run.usable, self.k] - self.reference
            rate2, weight = (
                run.sigma_rate_degC_min[self.k] ** 2,
                run.blocks.sigma_deg_h[self.k] ** -2.0,
            )
            out += (
                weight
                * np.r_[
                    0,
                    0,
                    0,
                    T.size * rate2,
                    np.sum(T**2) * rate2,
                    T.size * run.sigma_gradient_degC**2,
                ]
            )
        return out

    def _reading_errors(self, theta: NDArray) -> NDArray:
        """Variance that errors of rate and lines add to a block of each run."""
        return np.array(
            [
                (theta[3] * run.sigma_rate_degC_min[self.k]) ** 2
                + np.sum((theta[5:8] * run.sigma_gradient_degC) ** 2)
                for run in self.runs
            ]
        )

    def _held_out(self, parts: list[Part], choices: Sequence[TermChoice]) -> Residual:
        """Each part with the coefficients of the other folds."""
        folds, names = self._folds(parts), sorted({part.fold for part in parts})
        left: list[list[NDArray]] = [[] for _ in self.runs]
        for part in parts:
            others = [gram for name, gram in zip(names, folds) if name != part.fold]
            train, X = (
                sum(others[1:], others[0]),
                self._columns(part.run, part.rows, self.reference),
            )
            y = self.runs[part.run].blocks.bias_deg_h[part.rows, self.k]
            foretold = [
                X @ solve_terms(train, choice.mask, choice.rest_deg_h)[0] for choice in choices
            ]
            left[part.run].append(np.stack([y, *(y - value for value in foretold)], axis=1))
        squares, floor, count = np.zeros(len(choices) + 1), 0.0, 0
        for j, run in enumerate(self.runs):
            rows = np.concatenate([part.rows for part in parts if part.run == j])
            means, time_s, minutes = five_minute_means(
                run.blocks.time_s[rows], np.concatenate(left[j])
            )
            squares += np.sum((means - means.mean(axis=0)) ** 2, axis=0)
            floor += noise_of_means(self.twin, run, self.k, time_s, minutes)
            count += len(means)
        rms = np.sqrt(np.r_[squares, floor] / max(count, 1))
        before, plain, terms, model, noise = (float(value) for value in rms)
        return Residual(before, plain, terms, model, noise, model / plain, model / noise)


def five_minute_means(time_s: NDArray, values: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Means (m, c) of block values (n, c) over RESIDUAL_S, their centres and how many blocks each
    has.
    """
    group = np.unique(np.floor((time_s - time_s[0]) / RESIDUAL_S).astype(int), return_inverse=True)[
        1
    ]
    count = np.bincount(group)
    means = np.stack([np.bincount(group, column) / count for column in values.T], axis=1)
    return means, np.bincount(group, time_s) / count, count


def noise_of_means(
    twin: TwinModel, run: GradientRun, k: int, time_s: NDArray, blocks: NDArray
) -> float:
    """Expected sum of squares about their mean of such means of one gyro that hold noise alone
    [(deg/h)^2].
    """
    drift = session_covariance(
        axis_index=np.zeros(time_s.size),
        time_s=time_s,
        duration_s=blocks * RAMP_BLOCK_S,
        gyro=twin.gyro,
        run_length_s=float(run.blocks.time_s[-1]),
    )
    P = drift + np.diag(run.blocks.sigma_deg_h[k] ** 2 / blocks)
    return float(np.trace(P) - P.mean() * len(P))


def _shortest(orders: Sequence[TermChoice], rows: int) -> TermChoice:
    """The fewest terms that foretell held-out blocks as well as any choice, chance apart."""
    least = min(choice.held_out_chi2 for choice in orders)
    return next(choice for choice in orders if (choice.held_out_chi2 - least) * rows <= CHANCE)


def _choose(
    folds: list[NormalEquations], kept: Sequence[str], rests: Sequence[float]
) -> tuple[TermChoice, ...]:
    """Of each number of terms the choice that foretells held-out folds best, fewest first."""
    rows = sum(gram.rows for gram in folds)
    others = [[gram for g, gram in enumerate(folds) if g != f] for f in range(len(folds))]
    train = [sum(grams[1:], grams[0]) for grams in others]
    best: dict[int, TermChoice] = {}
    for use in term_sets(kept):
        names = tuple(name for name, yes in zip(TERMS, use) if yes)
        for rest in rests:
            chi2 = (
                sum(
                    held.misfit(solve_terms(gram, use, rest)[0]) for held, gram in zip(folds, train)
                )
                / rows
            )
            if len(names) not in best or chi2 < best[len(names)].held_out_chi2:
                best[len(names)] = TermChoice(names, rest, chi2)
    return tuple(best[size] for size in sorted(best))
