"""Which effects explain the gap: forward selection of single effects, refined, swept, and reported
as credible sets.

Each slot holds one effect; its posterior runs over all hypotheses given the other slots (SuSiE, see
`scoring`; effects.md, section 3.4). The threshold comes from replicates of the twin's own noise on
the very same runs.

What the twin's table leaves open by its own covariance is a state of every unit, as its turn-on is:
it has slots of its own from the start, so that every effect is judged against a table that may be
off. It is called a cause where the runs show it.

Decision: docs/decisions/0024-null-replicates.md.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ins.errors.base import SLOW_NAME, Effect
from ins.errors.table import TABLE_AGED
from ins.errors.telemetry import Trace
from ins.records import TwinModel
from simreal.declared.generic import Generic
from simreal.evidence.run_view import RunView
from simreal.evidence.whitened import CHANNELS, SENSORS, Evidence, ExtraNoise
from simreal.inference.bank import Bank, Group, Hypothesis, limits
from simreal.inference.noise_hypotheses import (
    NoiseHypothesis,
    Squares,
    log_bf,
    noise_hypotheses,
    observed,
)
from simreal.inference.phases import phases_contradict
from simreal.inference.scoring import Scorer, fit
from simreal.inference.tails import tail_quantile

MOST_EFFECTS = 6  # chosen: the blind trials (docs/gap.md) plant up to 2
# chosen: a unit of another grade than its twin's needs a white and a slow noise on each of 6
# sensors (the Calgary log needs 9)
MOST_NOISES = 12
REPLICATES = 300
SWEEPS = 3
REFINEMENTS = 3
REFINED_POINTS = 9  # points of one refinement
PAIR_CANDIDATES = 40
# of a large effect's amplitude, what its form may be off by: a companion within that is not told
# from it; chosen: 1/20, as usual sizes are given to one digit; what that does to a swaying vehicle
# is in
# tests/simreal/test_phases.py
OFF_IN_FORM = 0.05
TOUCHED = (
    0.02  # of a slot's energy, for a channel to be one of its own; chosen: 1/50, as in addback
)
MOST_MISSING = 0.99  # of a declared noise
ONSET_OFFSETS_S = (-12.0, -8.0, -4.0, 0.0, 4.0, 8.0, 12.0)
NO_COLUMNS = np.zeros(0, dtype=int)

AnyHypothesis = Hypothesis | NoiseHypothesis


@dataclass
class Slot:
    """One found effect: the chosen hypothesis with its group (refined) or its noise, its log
    posterior odds, and

    `posterior`: probability of every hypothesis of the scan, in the order of
    `Attribution.hypotheses`.
    """

    hypothesis: AnyHypothesis
    group: Group | None = None
    extra: ExtraNoise | None = None
    log_odds: float = 0.0
    posterior: NDArray = field(default_factory=lambda: np.zeros(0))

    @property
    def columns(self) -> NDArray:
        return NO_COLUMNS if self.group is None else self.group.columns

    @property
    def of_table(self) -> bool:
        """What the twin's table leaves open on a gyro, whether the runs show it or not."""
        return self.hypothesis.name == TABLE_AGED


def columns_of(slots: Iterable[Slot]) -> NDArray:
    """The bank's columns of slots, in their order."""
    return np.concatenate([NO_COLUMNS, *(s.columns for s in slots)])


@dataclass
class Attribution:
    """The slots, the state they were judged in, and the null threshold.

    tables: what the table leaves open of the gyros on which these runs show no error of it.
    """

    slots: list[Slot]
    tables: list[Slot]
    evidence: Evidence
    bank: Bank
    squares: Squares
    hypotheses: list[AnyHypothesis]
    threshold: float
    log_odds_before: NDArray
    replicate_max: NDArray
    plain_evidence: Evidence
    plain_squares: Squares
    plain_residual: NDArray
    replicate_z: NDArray
    replicate_ratio: NDArray
    not_testable: list[tuple[str, str, str]]

    @property
    def every(self) -> list[Slot]:
        """All that is fitted."""
        return [*self.slots, *self.tables]

    @property
    def columns(self) -> NDArray:
        return columns_of(self.every)

    @property
    def precision(self) -> NDArray:
        """Of the coefficients of `columns` before any data (k,)."""
        groups = (s.group for s in self.every if s.group is not None)
        of_each = [np.full(g.columns.size, g.precision) for g in groups]
        return np.concatenate([np.zeros(0), *of_each])

    def others(self, slot: Slot) -> NDArray:
        """The columns of all slots but one."""
        return columns_of(s for s in self.every if s is not slot)

    def residual(self) -> NDArray:
        """Whitened rows less what the slots explain."""
        columns = self.columns
        if not columns.size:
            return self.evidence.z
        coefficients, _ = fit(self.bank, columns)
        return self.evidence.z - self.bank.signature(columns, coefficients)


@dataclass(frozen=True)
class Listed:
    """What the twin lists already: its noise, its traces run by run (None: it lists none), and
    what its table leaves open.
    """

    noise: tuple[ExtraNoise, ...] = ()
    traces: Sequence[Trace | None] | None = None
    tables: tuple[Generic, ...] = ()


class Attributor:
    """The search over one set of runs under one twin."""

    def __init__(
        self,
        views: Sequence[RunView],
        twin: TwinModel,
        effects: Sequence[Effect],
        *,
        alpha: float,
        rng: np.random.Generator,
        replicates: int = REPLICATES,
        listed: Listed | None = None,
    ) -> None:
        self.views, self.twin, self.effects = views, twin, effects
        # whether what was found is all that is asked for, after each effect found
        self.enough: Callable[[Attributor], bool] = lambda _: False
        self._listed = listed or Listed()
        self._parked_only = False  # what follows the parked stretches explains nothing
        self._set(self._under(()))
        self.plain, self.plain_squares = self.evidence, self.squares
        self.not_testable = list(self.bank.not_testable)
        self._replicates(rng, replicates)
        self.threshold = tail_quantile(self.replicate_max, 0.5 * alpha)
        self.slots = self._tables()

    def _set(self, evidence: Evidence) -> None:
        """A new noise model: everything is whitened again, found columns included."""
        self.evidence = evidence
        self.bank = Bank(evidence, self.effects, tables=self._listed.tables)
        self.scorer, self.squares = Scorer(self.bank), Squares(evidence)
        self.noises = noise_hypotheses(evidence, self.squares, self.effects)
        self.hypotheses: list[AnyHypothesis] = [*self.bank.hypotheses, *self.noises]

    def _under(self, noise: Sequence[ExtraNoise]) -> Evidence:
        """The evidence under the twin with more noise."""
        listed = self._listed
        return Evidence(
            self.views,
            self.twin,
            (*listed.noise, *noise),
            listed.traces,
            parked_only=self._parked_only,
        )

    def _tables(self) -> list[Slot]:
        """Slots of what the table leaves open, in every comparison from the start."""
        return [Slot(h, h.groups[0]) for h in self.bank.hypotheses if h.of_table]

    def _replicates(self, rng: np.random.Generator, count: int) -> None:
        """The twin's noise: its table is judged with the table exact, its effects with tables drawn
        from the covariance.
        """
        self.replicate_z = rng.standard_normal((self.evidence.size, count))
        self.replicate_ratio = self.squares.ratio(self.replicate_z, rng)
        noise = [self._noise_odds(h, self.replicate_ratio, self.replicate_z) for h in self.noises]
        columns, score = columns_of(self._tables()), self.bank.replicate_scores(self.replicate_z)
        tables = self._table_odds(score)
        drawn = rng.standard_normal((columns.size, count))
        score = score + self.bank.gram[:, columns] @ drawn
        score[columns] -= drawn  # their precision is no product of columns
        lp, _ = self.scorer.log_posterior(columns, score)
        lp[self._of_table] = -np.inf
        self.replicate_max = np.max(np.vstack([lp, *tables, *noise]), axis=0)

    @property
    def _of_table(self) -> NDArray:
        """Which of the bank's hypotheses are a table's."""
        return np.array([h.of_table for h in self.bank.hypotheses], dtype=bool)

    def _table_odds(self, score: NDArray) -> list[NDArray]:
        """Log Bayes factor (reps,) of each gyro's table being off against its being exact, the
        others' off as they may be.
        """
        slots = self._tables()
        out = []
        for slot in slots:
            others = columns_of(s for s in slots if s is not slot)
            own = Scorer(self.bank, [h for h in self.bank.hypotheses if h is slot.hypothesis])
            out.append(own.groups_log_bf(others, score)[0])
        return out

    def _noise_odds(self, hypothesis: NoiseHypothesis, ratio: NDArray, z: NDArray) -> NDArray:
        scores, _ = log_bf(hypothesis, self.squares, ratio, z)
        return np.asarray(logsumexp(scores, axis=0) - np.log(len(scores)) + hypothesis.log_prior)

    def explain(self) -> Attribution:
        """Forward selection, sweeps, pruning."""
        tables = self._table_odds(self.bank.score[:, None])
        first = np.concatenate([self._odds(self.slots)[0], *tables])
        self._search()
        if self._effects and phases_contradict(self.bank, self.evidence, self.columns):
            self._parked_only = True
            self._begin_anew()
            self._search()
        return Attribution(
            [s for s in self.slots if self._is_found(s)],
            [s for s in self.slots if not self._is_found(s)],
            self.evidence,
            self.bank,
            self.squares,
            self.hypotheses,
            self.threshold,
            first,
            self.replicate_max,
            self.plain,
            self.plain_squares,
            self._plain_residual(),
            self.replicate_z,
            self.replicate_ratio,
            self.not_testable,
        )

    def _begin_anew(self) -> None:
        """Under the twin's own noise, nothing found."""
        self._set(self._under(()))
        self.slots = self._tables()

    def _is_found(self, slot: Slot) -> bool:
        """A table's error that these runs do not show is no cause."""
        return not slot.of_table or slot.log_odds >= self.threshold

    @property
    def columns(self) -> NDArray:
        """The bank's columns of all slots."""
        return columns_of(self.slots)

    @property
    def _effects(self) -> list[Slot]:
        """The slots of effects, without the table's."""
        return [s for s in self.slots if not s.of_table]

    def _search(self) -> None:
        self._forward()
        self._noise_instead()
        self._finish()

    def _forward(self, *, pairs: bool = True) -> float:
        """Add effects until none reaches the threshold; the evidence gained, less what each slot
        costs.
        """
        total = 0.0
        while any(self._room()):
            found = self._best(self.slots, pairs=pairs)
            if found is None:
                break
            total += found.log_odds - self.threshold
            self._enter(len(self.slots), found)
            if self.enough(self):
                break
            for _ in range(SWEEPS):
                if not self._sweep():
                    break
        self.gained = total
        return total

    def _room(self) -> tuple[bool, bool]:
        """Whether there are places left for effects that are no noise, and for noise."""
        noise = sum(s.extra is not None for s in self.slots)
        others = sum(s.extra is None and not s.of_table for s in self.slots)
        return others < MOST_EFFECTS, noise < MOST_NOISES

    def _noise_instead(self) -> None:
        """A slow noise beside named effects on one channel: would the noise alone have done?

        A drifting path can be drawn by two smooth named effects; the noise found after them is then
        too small to tell.
        """
        slow = [s for s in self.slots if s.hypothesis.name == SLOW_NAME]
        channels = {s.hypothesis.target for s in slow}
        if not any(s.extra is None and s.hypothesis.target in channels for s in self._effects):
            return
        kept, gained = list(self.slots), self.gained
        self._begin_anew()
        odds, _ = self._odds(self.slots)
        noise = [
            k for k, h in enumerate(self.noises) if h.name == SLOW_NAME and h.target in channels
        ]
        first = len(self.bank.hypotheses)
        best = max(noise, key=lambda k: odds[first + k])
        slot = self._noise_slot(self.noises[best], float(odds[first + best]))
        slot.posterior = np.exp(odds - logsumexp(odds))
        self._enter(len(self.slots), slot)
        total = slot.log_odds - self.threshold + self._forward(pairs=False)
        if total >= gained:
            return
        self.slots = []
        self._set(self._under([s.extra for s in kept if s.extra is not None]))
        for s in kept:
            if s.group is not None:
                self._restore(s)
        self.slots = kept

    def _plain_residual(self) -> NDArray:
        """Rows under the twin's own noise less the named effects, for judging noise."""
        out, columns = self.plain.z.copy(), self.columns
        if not columns.size:
            return out
        beta, _ = fit(self.bank, columns)
        for r, run in enumerate(self.plain.runs):
            traces = [self.bank.traces_of(int(c), r) for c in columns]
            here = np.array([t is not None for t in traces])
            out[self.plain.rows_of(r)] -= (
                run.whiten([t for t in traces if t is not None]) @ beta[here]
            )
        return out

    def _odds(self, others: Sequence[Slot]) -> tuple[NDArray, NDArray]:
        """Log posterior odds (h,) of all hypotheses given other slots, and the log Bayes factors of
        all groups.
        """
        columns = columns_of(others)
        lp, groups = self.scorer.log_posterior(columns, self.bank.score[:, None])
        z = self.evidence.z
        if columns.size:
            z = z - self.bank.signature(columns, fit(self.bank, columns)[0])
        ratio = self.squares.ratio(z[:, None])
        noise = [float(self._noise_odds(h, ratio, z[:, None])[0]) for h in self.noises]
        odds = np.concatenate([lp[:, 0], noise])
        taken = {s.hypothesis.key for s in others if s.extra is not None or s.of_table}
        odds[[h.key in taken for h in self.hypotheses]] = -np.inf
        self._ratio, self._z = ratio, z[:, None]
        return odds, groups[:, 0]

    def _odds_with_room(self, others: Sequence[Slot]) -> tuple[NDArray, NDArray]:
        """`_odds`, without those of a kind that has no place left."""
        odds, groups = self._odds(others)
        known = len(self.bank.hypotheses)
        for kind, room in zip((slice(known), slice(known, None)), self._room()):
            odds[kind] = odds[kind] if room else -np.inf
        return odds, groups

    def _best(self, others: Sequence[Slot], *, pairs: bool = True) -> Slot | None:
        """The best new effect given others, refined; None where nothing reaches the threshold."""
        odds, groups = self._odds_with_room(others)
        best = int(np.argmax(odds))
        if odds[best] < self.threshold:
            return None
        known = len(self.bank.hypotheses)
        events = np.array([h.run is not None for h in self.bank.hypotheses])
        event = int(np.argmax(np.where(events, odds[:known], -np.inf)))
        if best >= known and events[event] and odds[event] > self.threshold:
            # a sharp event off its grid looks like noise: refine it first
            self._slot(event, odds, groups, others)
            odds, groups = self._odds_with_room(others)
            best = int(np.argmax(odds))
        slot = self._slot(best, odds, groups, others)
        hypothesis = slot.hypothesis
        generic = not hypothesis.named or hypothesis.name == SLOW_NAME
        if pairs and generic and len(self._effects) + 2 <= MOST_EFFECTS:
            pair = self._pair(slot, others)
            if pair is not None:
                return pair
        return slot

    def _slot(self, number: int, odds: NDArray, groups: NDArray, others: Sequence[Slot]) -> Slot:
        if number >= len(self.bank.hypotheses):
            slot = self._noise_slot(
                self.noises[number - len(self.bank.hypotheses)], float(odds[number])
            )
            slot.posterior = np.exp(odds - logsumexp(odds))  # as it is before its own noise is in
            return slot
        hypothesis = self.bank.hypotheses[number]
        mine = self.scorer.groups_of(number)
        group = hypothesis.groups[int(np.argmax(groups[mine]))]
        slot = Slot(hypothesis, self._refined(hypothesis, group, others), None, float(odds[number]))
        return self._at_onset(slot, others)

    def _at_onset(self, slot: Slot, others: Sequence[Slot]) -> Slot:
        """The other events of this run at the onset found: a scan in steps of minutes misses what
        lasts seconds.
        """
        assert slot.group is not None
        onset = slot.group.shape.get("onset_s")
        if onset is None:
            return slot
        best, numbers = slot, []
        for number, h in enumerate(self.bank.hypotheses):
            if h.effect is None or h.run != slot.hypothesis.run or h is slot.hypothesis:
                continue
            if any(p.name == "onset_s" for p in h.effect.shape):
                near = min(h.groups, key=lambda g: abs(g.shape["onset_s"] - onset))
                shapes = [{**near.shape, "onset_s": onset + d} for d in ONSET_OFFSETS_S]
                columns = columns_of(others)
                groups = self.bank.append(h.effect, h.target, shapes, h.run)
                fits = Scorer(self.bank, [replace(h, groups=groups)]).groups_log_bf(
                    columns, self.bank.score[:, None]
                )[:, 0]
                h.refine(groups[int(np.argmax(fits))])
                numbers.append(number)
        if not numbers:
            return slot
        self.scorer = Scorer(self.bank)
        odds, groups_bf = self._odds(others)
        number = max(numbers, key=lambda k: odds[k])
        own = next(k for k, h in enumerate(self.bank.hypotheses) if h is slot.hypothesis)
        if odds[number] > odds[own]:
            h = self.bank.hypotheses[number]
            group = h.groups[int(np.argmax(groups_bf[self.scorer.groups_of(number)]))]
            best = Slot(h, self._refined(h, group, others), None, float(odds[number]))
        return best

    def _noise_slot(self, hypothesis: NoiseHypothesis, odds: float) -> Slot:
        scores, best = log_bf(hypothesis, self.squares, self._ratio, self._z)
        at = int(np.argmax(scores[:, 0]))
        square = _refined_level(
            float(best[at, 0]), *observed(hypothesis.terms[at], self.squares, self._ratio, self._z)
        )
        square = min(square, hypothesis.most)
        if square < 0:
            square = max(square, -MOST_MISSING * hypothesis.declared)
        extra = ExtraNoise(
            hypothesis.effect, hypothesis.target, hypothesis.shapes[at], square, hypothesis.run
        )
        return Slot(hypothesis, None, extra, odds)

    def _refined(self, hypothesis: Hypothesis, group: Group, others: Sequence[Slot]) -> Group:
        """Continuous shape parameters: finer and finer grids about the best, one parameter at a
        time.
        """
        effect = hypothesis.effect
        if effect is None or not effect.shape:
            return group
        run = None if hypothesis.run is None else self.bank.telemetry[hypothesis.run]
        columns = columns_of(others)
        shape, best = dict(group.shape), group
        for parameter in effect.shape:
            low, high = limits(parameter, run)
            if parameter.steps < 2 or high <= low:
                continue
            log = parameter.spread == "log"
            width = (np.log(high / low) if log else high - low) / (parameter.steps - 1)
            for _ in range(REFINEMENTS):
                offsets = width * np.linspace(-1.0, 1.0, REFINED_POINTS)
                centre = shape[parameter.name]
                tried = centre * np.exp(offsets) if log else centre + offsets
                tried = np.unique(np.clip(tried, low, high))
                shapes = [{**shape, parameter.name: float(v)} for v in tried]
                groups = self.bank.append(effect, hypothesis.target, shapes, hypothesis.run)
                scorer = Scorer(self.bank, [replace(hypothesis, groups=groups)])
                fits = scorer.groups_log_bf(columns, self.bank.score[:, None])[:, 0]
                best = groups[int(np.argmax(fits))]
                shape, width = dict(best.shape), width / 4.0
        entered = hypothesis.refine(best)
        self.scorer = Scorer(self.bank)
        return entered

    def _pair(self, single: Slot, others: Sequence[Slot]) -> Slot | None:
        """Two named effects on the channel of a generic answer, where together they explain it
        better.

        The better of them is returned; the other is found in the next round.
        """
        target = single.hypothesis.target
        on_channel = [
            k
            for k, h in enumerate(self.bank.hypotheses)
            if h.effect is not None and h.target == target
        ]
        if not on_channel:
            return None
        base = columns_of(others)
        mine = Scorer(self.bank, [self.bank.hypotheses[k] for k in on_channel])
        _, groups = mine.log_posterior(base, self.bank.score[:, None])
        order = np.argsort(-groups[:, 0])[:PAIR_CANDIDATES]
        best, chosen = single.log_odds + self.threshold, None  # two slots cost more than one
        for k in order:
            group = mine.groups[k]
            hypothesis = mine.hypotheses[mine.owner[k]]
            rest, _ = mine.log_posterior(
                np.concatenate([base, group.columns]), self.bank.score[:, None]
            )
            rest[mine.owner[k]] = -np.inf
            total = groups[k, 0] + group.log_weight + hypothesis.log_prior + float(rest[:, 0].max())
            if float(rest[:, 0].max()) > self.threshold and total > best:
                best, chosen = total, (hypothesis, group)
        if chosen is None:
            return None
        return Slot(chosen[0], self._refined(*chosen, others), None, single.log_odds)

    def _enter(self, place: int, slot: Slot) -> None:
        """Put a slot in its place; noise changes the whitening, and all columns are made anew."""
        before = [s.extra for s in self.slots if s.extra is not None]
        if place < len(self.slots):
            self.slots[place] = slot
        else:
            self.slots.append(slot)
        after = [s.extra for s in self.slots if s.extra is not None]
        if [id(e) for e in before] != [id(e) for e in after]:
            self._set(self._under(after))
            for s in self.slots:
                if s.group is not None:
                    self._restore(s)

    def _restore(self, slot: Slot) -> None:
        """The slot's hypothesis and columns in a new bank."""
        old = slot.hypothesis
        found = next(h for h in self.bank.hypotheses if h.key == old.key)
        slot.hypothesis = found
        assert slot.group is not None
        if found.effect is not None:
            slot.group = found.refine(
                self.bank.append(found.effect, found.target, [slot.group.shape], found.run)[0]
            )
            self.scorer = Scorer(self.bank)
        else:
            slot.group = next(g for g in found.groups if g.shape == slot.group.shape)

    def _sweep(self) -> bool:
        """Judge each slot again given the others; True where one changed."""
        changed = False
        for place in range(len(self.slots)):
            slot = self.slots[place]
            if slot.extra is not None or slot.of_table or len(self._effects) < 2:
                continue
            others = [s for k, s in enumerate(self.slots) if k != place]
            odds, groups = self._odds(others)
            best = int(np.argmax(odds[: len(self.bank.hypotheses)]))
            if self._noise_far_likelier(odds, best):
                self._enter(place, self._slot(int(np.argmax(odds)), odds, groups, others))
                return True
            hypothesis = self.bank.hypotheses[best]
            if hypothesis.key == slot.hypothesis.key:
                slot.group = self._refined(hypothesis, self._start(best, groups), others)
                continue
            self.slots[place] = self._slot(best, odds, groups, others)
            changed = True
        return changed

    def _noise_far_likelier(self, odds: NDArray, best: int) -> bool:
        """Whether a noise says what a slot says, and by a threshold better than the best effect
        that is none.
        """
        _, room = self._room()
        return room and float(odds[len(self.bank.hypotheses) :].max()) > odds[best] + self.threshold

    def _start(self, number: int, groups: NDArray) -> Group:
        mine = self.scorer.groups_of(number)
        return self.bank.hypotheses[number].groups[int(np.argmax(groups[mine]))]

    def _finish(self) -> None:
        """Judge every slot given all others, noise as well; the weakest that no longer earns its
        place goes, until all do.
        """
        while True:
            self._judge_named()
            self._judge_noise()
            weak = [s for s in self._effects if s.log_odds < self.threshold]
            weak = weak or [s for s in self._effects if self._in_shadow(s)]
            if not weak:
                return
            self._drop(min(weak, key=lambda s: s.log_odds))

    def _judge_named(self) -> None:
        """Name, odds and posterior of each slot that is no noise, given the others."""
        for place, slot in enumerate(self.slots):
            if slot.extra is not None:
                continue
            others = [s for k, s in enumerate(self.slots) if k != place]
            odds, groups = self._odds(others)
            if slot.of_table:
                self._judge_table(slot, odds)
                continue
            likelier = self._likelier_name(slot, odds)
            if likelier is not None:
                slot = self.slots[place] = self._slot(likelier, odds, groups, others)
                odds, _ = self._odds(others)
            own = next(
                k for k, h in enumerate(self.bank.hypotheses) if h.key == slot.hypothesis.key
            )
            named = odds[: len(self.bank.hypotheses)]
            slot.log_odds = float(max(odds[own], named.max()))
            slot.posterior = np.exp(odds - logsumexp(odds))

    def _judge_table(self, slot: Slot, odds: NDArray) -> None:
        """What the runs show of a table's error, and its posterior. Every unit has such an error,
        and one of the catalogue's effects is rare: it counts as all their names together.
        """
        own = [h is slot.hypothesis for h in self.bank.hypotheses]
        names = {h.name for h in self.hypotheses}
        prior = np.zeros(odds.size)
        prior[: len(own)][own] = np.log(len(names))
        slot.log_odds = float(odds[: len(own)][own][0])
        slot.posterior = np.exp(odds + prior - logsumexp(odds + prior))

    def _judge_noise(self) -> None:
        """What each found noise is still worth, with the others in."""
        noisy = [s for s in self.slots if s.extra is not None]
        if len(self._effects) < 2 or not noisy:
            return
        z = self.evidence.z
        columns = self.columns
        if columns.size:
            z = z - self.bank.signature(columns, fit(self.bank, columns)[0])
        ratio = self.squares.ratio(z[:, None])
        for slot in noisy:
            h = next(n for n in self.noises if n.key == slot.hypothesis.key)
            assert slot.extra is not None
            term = h.terms[h.shapes.index(dict(slot.extra.shape))]
            n, y, a = observed(term, self.squares, ratio, z[:, None])
            gained = _gained_by(slot.extra.square, n, y[:, 0], a)
            cost = float(np.log(len(h.tried()[0]))) - h.log_prior
            slot.log_odds = min(slot.log_odds, gained - cost)

    def _in_shadow(self, slot: Slot) -> bool:
        """Whether a slot may be no more than what a much larger one is off by in form, on the
        channels that it touches itself.
        """
        own, worth = self._energy(slot), 2.0 * max(slot.log_odds, 0.0)
        touched = own > TOUCHED * own.sum()
        return any(
            worth < OFF_IN_FORM**2 * float(self._energy(other)[touched].sum())
            for other in self.slots
            if other is not slot
        )

    def _energy(self, slot: Slot) -> NDArray:
        """Squared size of a slot on each channel of the parked stretch, then of what follows."""
        count = len(CHANNELS)
        if slot.group is not None:
            columns = self.columns
            beta, _ = fit(self.bank, columns)
            signature = self.bank.signature(slot.columns, beta[np.isin(columns, slot.columns)])
            key = self.evidence.rows.channel + count * self.evidence.followed
            return np.bincount(key, signature**2, minlength=2 * count)
        h = next(n for n in self.noises if n.key == slot.hypothesis.key)
        assert slot.extra is not None
        term = h.terms[h.shapes.index(dict(slot.extra.shape))]
        change = self.squares.dof[term.index] * (slot.extra.square * term.factor) ** 2
        channel = self.squares.channel[term.index]
        share = np.bincount(channel + count * (channel > SENSORS), change, minlength=2 * count)
        return 2.0 * max(slot.log_odds, 0.0) * share / max(float(share.sum()), 1e-300)

    def _drop(self, slot: Slot) -> None:
        """Take a slot out; without its noise everything is whitened again."""
        self.slots = [s for s in self.slots if s is not slot]
        if slot.extra is not None:
            self._set(self._under([s.extra for s in self.slots if s.extra is not None]))
            for s in self.slots:
                if s.group is not None:
                    self._restore(s)

    def _likelier_name(self, slot: Slot, odds: NDArray) -> int | None:
        """The best hypothesis of the name whose parts are together likelier than the slot's own
        name; None: it is that.
        """
        names: dict[tuple[str, str], list[int]] = {}
        for number, h in enumerate(self.bank.hypotheses):
            names.setdefault((h.name, h.target), []).append(number)
        together = {key: float(logsumexp(odds[numbers])) for key, numbers in names.items()}
        best = max(together, key=lambda key: together[key])
        if together[best] <= together[slot.hypothesis.name, slot.hypothesis.target]:
            return None
        return max(names[best], key=lambda number: odds[number])


def _gained_by(square: float, n: NDArray, ratio: NDArray, a: NDArray) -> float:
    """Log likelihood that squares lose where a noise that is in the whitening is taken out of it.

    ratio: over their expectation with the noise; without it they were 1 - square a of that.
    """
    s = np.maximum(1.0 - square * a, 1e-3)
    return float(np.sum(0.5 * n * (ratio / s - ratio + np.log(s))))


def _refined_level(square: float, n: NDArray, ratio: NDArray, a: NDArray) -> float:
    """The coefficient squared of most likelihood, between its neighbours of the scan."""
    from scipy.optimize import minimize_scalar

    y = ratio[:, 0]

    def loss(factor: float) -> float:
        s = np.maximum(1.0 + factor * square * a, 1e-3)
        return -float(np.sum(0.5 * n * (y * (1.0 - 1.0 / s) - np.log(s))))

    high = 4.0 if square > 0 else min(4.0, 0.99 / (-square * float(a.max())))
    found = minimize_scalar(loss, bounds=(0.25, high), method="bounded", options={"xatol": 1e-3})
    return float(found.x) * square
