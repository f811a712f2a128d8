"""Put a found effect back into the twin: how much of the gap is gone on data that the effect was
not fitted to (effects.md, section 3.7)::

    S = N / D,  N = 2 d'z - |d|^2,  D = |z|^2 - m

z: whitened held-out rows in the channels the effect touches (slow part), less what the other found
effects make there; d: the effect as fitted elsewhere. S = 1 - |s - d|^2 / |s|^2 for the true effect
s, so never above 1. The interval is Fieller's, from var(N - S D) = 4 |d - S s|^2 + 2 S^2 m, since D
may be near zero.

What repeats is held out run by run; an event, or all there is of one run, by alternate
half-minutes; noise by runs. A free function of one run is held out by halves: between the
half-minutes that it is drawn through, a smooth curve is right whatever made it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from ins.errors.telemetry import Trace
from simreal.declared.generic import OF_ONE_RUN, OF_TELEMETRY
from simreal.evidence.run_view import RunView
from simreal.evidence.whitened import Evidence
from simreal.inference.attribute import Attribution, Slot
from simreal.inference.bank import Bank, Hypothesis
from simreal.inference.noise_hypotheses import NoiseHypothesis, term_of
from simreal.inference.scoring import fit
from simreal.inference.verdict import Judging

LOW_BAND = 32  # transform indices kept of a channel's parked rows; what moves is kept in as many
# share of an effect's energy that makes a channel one of its own; chosen: of 12 sigma, the size
# of the blind trials, 0.02 is 1.7 sigma
TOUCHED = 0.02
ALTERNATE_S = 30.0  # blocks of an event's run that are fitted and judged in turn
# of an effect's energy within the low band; chosen: 0.9 of it makes a shrink at most 0.1 too
# small
MOST_ENERGY = 0.9  # of an effect's energy within the low band; chosen: 0.1 of it may go unjudged
# variance of the predicted effect, of its energy: beyond, nothing is predicted; a sigma of half the
# effect: 0.5^2
LOOSE = 0.25
RIDGE = 1e-3  # of a signature's whole energy
SURE = 1.96  # sigmas: 95 %
FEW_SIGMA = 8.0  # 1e-15 of Gaussian errors lie beyond


@dataclass(frozen=True)
class Gone:
    """Share of a gap that is gone, with its 95 % interval."""

    fraction: float
    interval_95: tuple[float, float]


@dataclass(frozen=True)
class Shrink(Gone):
    """Share of the excess that is gone on held-out data; size: of the held-out gap, in sigmas;
    too_small: to quantify a shrink.
    """

    held_out: bool
    how: Judging
    size: float
    too_small: bool


def shrink_of(attribution: Attribution, number: int, held: "HeldOut | None" = None) -> Shrink:
    """The shrink by one slot, the others in; held: runs kept apart for it, else the runs take
    turns.
    """
    slot = attribution.slots[number]
    if held is not None and slot.extra is None and held.judges(slot):
        return held.shrink(number)
    if slot.extra is not None:
        return _of_noise(attribution, slot)
    evidence, runs = attribution.evidence, len(attribution.evidence.runs)
    repeats = slot.hypothesis.effect.repeats if slot.hypothesis.effect is not None else "R"
    own_run = repeats in ("E", "P") or slot.hypothesis.name in OF_ONE_RUN
    touched = _touched(attribution, slot)
    if runs > 1 and not own_run:
        parts = [
            _fold(attribution, slot, _run_mask(evidence, k), touched, by_run=True)
            for k in range(runs)
        ]
        how = Judging.BY_RUN
    else:
        if slot.hypothesis.run is not None:
            touched = touched & (evidence.rows.run == slot.hypothesis.run)
        halves = slot.hypothesis.name in OF_TELEMETRY
        mask = _half_mask if halves else _block_mask
        parts = [
            _fold(attribution, slot, mask(evidence, odd), touched, by_run=halves)
            for odd in (False, True)
        ]
        how = Judging.HALVES if halves else Judging.HALF_MINUTES
    N, D, dd, dz, m, loose = (float(sum(p[k] for p in parts)) for k in range(6))
    # half the data do not fix it: an event is short
    if how is not Judging.BY_RUN and loose > LOOSE * max(D, dd):
        return _in_sample(attribution, slot, touched)
    return fieller(N, D, dd=dd, dz=dz, m=m, how=how)


def _in_sample(attribution: Attribution, slot: Slot, touched: NDArray) -> Shrink:
    """On the data it was fitted to, less what the fit owes to their noise (Mallows): not held
    out.
    """
    columns, z = attribution.columns, attribution.evidence.z
    A = attribution.bank.matrix(columns)
    beta, _ = fit(attribution.bank, columns)
    mine = np.isin(columns, slot.columns)
    d, rest = (A[:, mine] @ beta[mine])[touched], (z - A[:, ~mine] @ beta[~mine])[touched]
    shapes = len(slot.group.shape) if slot.group is not None else 0
    dd, dz, cost = float(d @ d), float(d @ rest), float(mine.sum() + shapes)
    inside = np.abs(d) > 0.01 * np.abs(d).max()  # where the event is
    D = float(rest[inside] @ rest[inside]) - int(inside.sum())
    return replace(
        fieller(
            2.0 * dz - dd - 2.0 * cost,
            D,
            dd=dd,
            dz=dz,
            m=float(inside.sum()),
            how=Judging.SAME_RUN_LESS_FIT,
        ),
        held_out=False,
    )


class HeldOut:
    """Runs that took no part in the attribution: they only judge what the found effects are
    worth.
    """

    def __init__(
        self,
        attribution: Attribution,
        views: Sequence[RunView],
        first: int,
        known: Sequence[Trace | None] | None = None,
    ) -> None:
        """views: all runs, those held out from number `first` on, under the same noise."""
        found = attribution.evidence
        self._first = first
        evidence = Evidence(views, attribution.plain_evidence.twin, found.extra, known)
        bank = Bank(evidence, (), with_generic=False)

        def entered(slot: Slot) -> Slot:
            h = slot.hypothesis
            if slot.group is None or not isinstance(h, Hypothesis) or not self.judges(slot):
                return replace(slot, group=None)
            if h.effect is not None:
                group = bank.append(h.effect, h.target, [slot.group.shape], h.run)[0]
                return replace(slot, group=group)
            generic = attribution.bank.generic_of(h, slot.group)
            traces = [generic.traces(t) for t in bank.telemetry]
            return replace(slot, group=bank.append_traces(traces, slot.group))

        self._of_all = replace(
            attribution,
            slots=[entered(slot) for slot in attribution.slots],
            tables=[entered(slot) for slot in attribution.tables],
            evidence=evidence,
            bank=bank,
        )

    @staticmethod
    def judges(slot: Slot) -> bool:
        """What belongs to one run alone cannot be judged on another."""
        effect = slot.hypothesis.effect
        return (effect is None or effect.repeats == "R") and slot.hypothesis.name not in OF_ONE_RUN

    def shrink(self, number: int) -> Shrink:
        slot = self._of_all.slots[number]
        rows = self._of_all.evidence.rows
        held = rows.run >= self._first
        N, D, dd, dz, m, _ = _fold(
            self._of_all, slot, held, _touched(self._of_all, slot), by_run=True
        )
        return fieller(N, D, dd=dd, dz=dz, m=m, how=Judging.APART)


def fieller(
    N: float, D: float, *, dd: float, dz: float, m: float, how: Judging = Judging.APART
) -> Shrink:
    """S = N / D with its interval: all S in [-1, 1] that the data do not exclude at 95 %."""
    S = np.linspace(-1.0, 1.0, 2001)
    # the effect is at least what its projection on the fit shows
    s2 = max(D, dz**2 / dd if dd > 0 else 0.0, 0.0)
    variance = 4.0 * np.maximum(dd - 2.0 * S * dz + S**2 * s2, 0.0) + 2.0 * S**2 * m + 1e-12
    ratio = (N - S * D) ** 2 / variance
    inside = ratio <= ratio.min() + SURE**2  # the least is above zero where S = N / D lies beyond 1
    if D < SURE * np.sqrt(2.0 * m):
        inside[:] = True  # no gap to speak of in what was held out: nothing is excluded
    value = float(np.clip(N / D, -1.0, 1.0)) if D > 0 else 0.0
    interval = (float(S[inside].min()), float(S[inside].max())) if inside.any() else (value, value)
    interval = (min(interval[0], value), max(interval[1], value))
    size = float(np.sqrt(max(D, 0.0)))
    return Shrink(value, interval, True, how, size, size < FEW_SIGMA)


def _touched(attribution: Attribution, slot: Slot) -> NDArray:
    """Rows (k,) of the channels that hold the effect's energy."""
    channel = attribution.evidence.rows.channel
    energy = np.zeros(channel.size)
    for column in slot.columns:
        u = attribution.bank.signature(np.array([column]), np.ones(1))
        energy += u**2 / max(float(u @ u), 1e-300)
    total = np.bincount(channel, energy, minlength=10)
    return np.asarray((total / max(total.sum(), 1e-300) > TOUCHED)[channel])


def _run_mask(evidence: Evidence, run: int) -> NDArray:
    return evidence.rows.run == run


def _block_mask(evidence: Evidence, odd: bool) -> NDArray:
    return np.asarray((np.floor(evidence.rows.time_s / ALTERNATE_S).astype(int) % 2 == 1) == odd)


def _half_mask(evidence: Evidence, second: bool) -> NDArray:
    """Rows of one half of the only run, by the times of its rows."""
    time_s = evidence.rows.time_s
    return np.asarray((time_s > 0.5 * (time_s.min() + time_s.max())) == second)


def _fold(
    attribution: Attribution, slot: Slot, held: NDArray, touched: NDArray, *, by_run: bool
) -> tuple[float, float, float, float, float, float]:
    """N, D, |d|^2, d'z, m and the variance of d of one fold: fitted on the rows not held, judged on
    those held.
    """
    bank, evidence = attribution.bank, attribution.evidence
    columns = attribution.columns
    A = bank.matrix(columns)
    train = ~held
    gram = A[train].T @ A[train]
    # rows without the effect leave its coefficient at zero
    whole = np.maximum(np.sum(A**2, axis=0), 1e-300)
    scale = 1.0 / np.sqrt(whole)
    ridge = np.diag(RIDGE + attribution.precision * scale**2)
    beta = scale * np.linalg.solve(
        gram * np.outer(scale, scale) + ridge, scale * (A[train].T @ evidence.z[train])
    )
    mine = np.isin(columns, slot.columns)
    others = evidence.z - A[:, ~mine] @ beta[~mine]
    d, z = A[:, mine] @ beta[mine], others
    where = held & touched
    B = _low_band(evidence, where)
    if by_run or energetic(B(d)) > MOST_ENERGY * energetic(
        d[where]
    ):  # an event may be as short as a row
        d, z, m = B(d), B(z), B(z).size
    else:
        d, z, m = d[where], z[where], int(where.sum())
    dd, dz = float(d @ d), float(d @ z)
    own = np.flatnonzero(mine)
    C = np.linalg.inv(gram * np.outer(scale, scale) + ridge)[np.ix_(own, own)] * np.outer(
        scale[own], scale[own]
    )
    loose = float(np.sum((A[where][:, mine] @ C) * A[where][:, mine]))
    return 2.0 * dz - dd, float(z @ z) - m, dd, dz, float(m), loose


def energetic(values: NDArray) -> float:
    return float(values @ values)


def _low_band(evidence: Evidence, where: NDArray) -> Callable[[NDArray], NDArray]:
    """The fixed subspace: the first transform indices of each channel's rows in time order, run by
    run.
    """
    rows = evidence.rows
    groups = []
    for run in np.unique(rows.run[where]):
        for channel in np.unique(rows.channel[where & (rows.run == run)]):
            at = np.flatnonzero(where & (rows.run == run) & (rows.channel == channel))
            groups.append(at)

    def project(values: NDArray) -> NDArray:
        return np.concatenate([dct(values[at], norm="ortho")[:LOW_BAND] for at in groups])

    return project


def _of_noise(attribution: Attribution, slot: Slot) -> Shrink:
    """Excess of the squares that is gone when each run is judged with the coefficient found in the
    others.
    """
    hypothesis, evidence, squares = (
        slot.hypothesis,
        attribution.plain_evidence,
        attribution.plain_squares,
    )
    assert isinstance(hypothesis, NoiseHypothesis) and slot.extra is not None
    ratio = squares.ratio(attribution.plain_residual[:, None])[:, 0]
    runs = range(len(evidence.runs)) if hypothesis.run is None else (hypothesis.run,)
    shape = dict(slot.extra.shape)
    terms = [
        term_of(evidence, squares, hypothesis.effect, hypothesis.target, shape, k) for k in runs
    ]
    excess = np.array(
        [float(np.sum(squares.dof[t.index] * t.factor * (ratio[t.index] - 1.0))) for t in terms]
    )
    unit = np.array([float(np.sum(squares.dof[t.index] * t.factor**2)) for t in terms])
    q = slot.extra.square
    spread = np.array(
        [
            float(
                np.sqrt(
                    np.sum(2.0 * squares.dof[t.index] * t.factor**2 * (1.0 + q * t.factor) ** 2)
                )
            )
            for t in terms
        ]
    )
    total, seen = float(unit.sum()), float(excess.sum())
    found = seen / max(total, 1e-300)  # the coefficient squared, all runs together
    sigma = float(np.sqrt(np.sum(spread**2))) / max(total, 1e-300)
    held = len(terms) > 1
    without = (seen - excess) / np.maximum(total - unit, 1e-300) if held else np.array([found])
    rng = np.random.default_rng(0)
    truths = found + sigma * np.concatenate([[0.0], rng.standard_normal(4000)])
    left = np.abs(truths[:, None] - without) @ unit / np.maximum(np.abs(truths) * total, 1e-300)
    fractions = np.clip(1.0 - left, -1.0, 1.0)
    low, high = np.quantile(fractions, [0.025, 0.975])
    how = Judging.BY_RUN if held else Judging.SAME_RUN
    interval = float(min(low, fractions[0])), float(max(high, fractions[0]))
    size = abs(found) / max(sigma, 1e-300)
    return Shrink(float(fractions[0]), interval, held, how, size, size < FEW_SIGMA)
