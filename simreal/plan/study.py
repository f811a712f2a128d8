"""Which recordings separate rival effects: judged with the very operator that whitens a diagnosis.

Method: effects.md, section 3.9.

Candidate recordings are simulated with the twin, viewed and whitened as real ones are
(`plan_recordings`, `plan_gram`); a greedy search takes the recording that separates most, then the
next given the first, and so on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import ThermalTable
from ins.records import Site, TwinModel
from simreal.evidence.run_view import RunView
from simreal.evidence.whitened import Evidence
from simreal.inference.bank import Bank, Group
from simreal.inference.scoring import Scorer
from simreal.plan.gram import Contender, RunGrams
from simreal.plan.pairs import Pair, PairAssessment, assess, special_case
from simreal.plan.recordings import Recording, RecordingMaker, candidates

# log odds that a null stays below at alpha 1 %: 5.2 on one cold hour, 4.8 on four
# (simreal.inference.attribute)
NULL_NATS = 5.0
DELTAS = np.linspace(1.0, 20.0, 191)  # sizes tried for the smallest that is seen
# of the score, and for each pair: a recording that separates no more must gain this
LEAST_GAIN, LEAST_EACH = 0.1, 0.01
# of the best gain: within it, the cheaper recording is taken; chosen: 3 % of a gain are not worth
# an hour
EQUAL_GAIN = 0.03
COMPARED: dict[str, tuple[Recording, ...]] = {
    "1 cold": (Recording(),),
    "1 cooling": (Recording(start="cooling"),),
    "3 cold": (Recording(), Recording(variant=1), Recording(variant=2)),
    "cold + ambient + cooling": (
        Recording(),
        Recording(start="ambient"),
        Recording(start="cooling"),
    ),
    "with a hot restart": (
        Recording(),
        Recording(start="ambient"),
        Recording(start="cooling"),
        Recording(start="hot_restart"),
    ),
    "the same on four headings": (
        Recording(),
        Recording(start="ambient", heading_deg=90.0),
        Recording(start="cooling", heading_deg=180.0),
        Recording(start="hot_restart", heading_deg=270.0),
    ),
}


@dataclass(frozen=True)
class Plan:
    """A set of recordings, and every pair in it."""

    name: str
    recordings: tuple[Recording, ...]
    judged: tuple[PairAssessment, ...]

    @property
    def score(self) -> float:
        return sum(j.score for j in self.judged)

    @property
    def separated(self) -> int:
        """Pairs that are separated, at least where the effect is large."""
        return sum(j.margin_high >= 1.0 for j in self.judged)

    @property
    def hours(self) -> float:
        return sum(r.hours for r in self.recordings)


@dataclass(frozen=True)
class Study:
    """The answer. given: what the runs at hand do (None: there are none); next_best: single
    recordings, best first;

    chosen: the smallest set found (beside the given runs); compared: usual plans; reach: all
    candidates together. seen: smallest size Delta that the diagnosis calls found; usual: geometric
    mean of the usual sizes of each coefficient for this unit; both by contender.
    """

    pairs: tuple[Pair, ...]
    twin: TwinModel
    given: Plan | None
    next_best: tuple[Plan, ...]
    chosen: Plan
    steps: tuple[Plan, ...]
    compared: tuple[Plan, ...]
    reach: Plan
    seen: dict[tuple[str, str], float]
    usual: dict[tuple[str, str], NDArray]
    run_ids: tuple[str, ...] = ()


class Planner:
    """Judges sets of recordings beside given runs; every recording is simulated and whitened
    once.
    """

    def __init__(
        self, pairs: Sequence[Pair], maker: RecordingMaker, given: Sequence[RunView] = ()
    ) -> None:
        self.pairs, self.maker = tuple(pairs), maker
        self.contenders = list({e.key: e for pair in pairs for e in (pair.a, pair.b)}.values())
        self.given = [RunGrams(view, maker.twin, self.contenders) for view in given]
        self._grams: dict[Recording, RunGrams] = {}
        self.special: dict[str, str] = {}

    @property
    def least_gain(self) -> float:
        return LEAST_GAIN + LEAST_EACH * len(self.pairs)

    def gram(self, recording: Recording) -> RunGrams:
        if recording not in self._grams:
            self._grams[recording] = RunGrams(
                self.maker.view(recording), self.maker.twin, self.contenders
            )
        return self._grams[recording]

    def grams(self, recordings: Sequence[Recording]) -> list[RunGrams]:
        return [*self.given, *(self.gram(r) for r in recordings)]

    def learn_special_cases(self, rich: Sequence[Recording]) -> None:
        """Finds the pairs of which one is a special case of the other, from a rich set of
        recordings.
        """
        runs = [self.gram(r) for r in rich]
        self.special = {pair.label: special_case(runs, pair) for pair in self.pairs}

    def plan(self, recordings: Sequence[Recording], name: str = "") -> Plan:
        """The given runs with these recordings."""
        runs = self.grams(recordings)
        title = name or " + ".join(r.name for r in recordings)
        return Plan(
            title,
            tuple(recordings),
            tuple(assess(runs, p, self.special.get(p.label, "")) for p in self.pairs),
        )

    def best_next(self, before: Plan, among: Sequence[Recording]) -> list[Plan]:
        """The plan with one more recording, best first; among near equals the cheaper."""
        tried = [
            self.plan((*before.recordings, r), r.name) for r in among if r not in before.recordings
        ]
        top = max((p.score - before.score for p in tried), default=0.0)
        near = [p for p in tried if p.score - before.score >= (1.0 - EQUAL_GAIN) * top]
        near.sort(key=lambda p: (p.recordings[-1].cost_hours, -p.score))
        rest = sorted((p for p in tried if p not in near), key=lambda p: -p.score)
        return [*near, *rest]

    def choose(self, among: Sequence[Recording], most: int) -> tuple[list[Plan], list[Plan]]:
        """Greedy: the plan after each step, and all first choices in order."""
        steps: list[Plan] = []
        first: list[Plan] = []
        now = self.plan((), "given")
        while len(steps) < most and any(j.score < 1.0 for j in now.judged):
            ranked = self.best_next(now, among)
            first = first or ranked
            if not ranked or not (
                ranked[0].separated > now.separated
                or ranked[0].score - now.score >= self.least_gain
            ):
                break
            now = ranked[0]
            steps.append(now)
        return steps, first or self.best_next(now, among)

    def thinned(self, plan: Plan) -> Plan:
        """Without recordings that a later choice has made needless."""
        for recording in plan.recordings[:-1]:
            less = self.plan(tuple(r for r in plan.recordings if r != recording))
            if less.separated >= plan.separated and less.score > plan.score - 0.2 * self.least_gain:
                plan = less
        return plan


@dataclass(frozen=True, kw_only=True)
class PlanSettings:
    """seed: of the simulated recordings. without: what cannot be had (`recordings.candidates`).
    most: at most so many new recordings.
    """

    seed: int = 0
    without: tuple[str, ...] = ()
    most: int = 6


def study(
    pairs: Sequence[Pair],
    twin: TwinModel,
    table: ThermalTable | None,
    site: Site,
    settings: PlanSettings,
    *,
    given: Sequence[RunView] = (),
    told: Callable[[str], None] = lambda words: None,
) -> Study:
    """Everything a plan says. given: views of runs at hand; told: what is being done."""
    maker = RecordingMaker(twin, table, site, settings.seed, settings.without)
    planner = Planner(pairs, maker, given)
    among = candidates(settings.without)
    for number, recording in enumerate(among, start=1):
        told(f"recording {number} of {len(among)}")
        planner.gram(recording)
    told("choosing")
    planner.learn_special_cases(among)
    steps, first = planner.choose(among, settings.most)
    chosen = planner.thinned(steps[-1]) if steps else planner.plan((), "no recording")
    told("comparing")
    compared = (
        ()
        if given
        else tuple(planner.plan(recordings, name) for name, recordings in COMPARED.items())
    )
    views = [g.view for g in planner.grams(chosen.recordings) or planner.grams(among[:1])]
    return Study(
        pairs=tuple(pairs),
        twin=twin,
        given=planner.plan((), "the given runs") if given else None,
        next_best=tuple(first[:5]),
        chosen=chosen,
        steps=tuple(steps),
        compared=compared,
        reach=planner.plan(among, "all of the recordings together"),
        seen=seen_sizes(views, twin, planner.contenders),
        usual={k: v for r in among for k, v in planner.gram(r).usual.items()},
        run_ids=tuple(v.name for v in given),
    )


def seen_sizes(
    views: Sequence[RunView], twin: TwinModel, contenders: Sequence[Contender]
) -> dict[tuple[str, str], float]:
    """Smallest size Delta whose mean log odds reach NULL_NATS in these runs, by contender; inf
    where it leaves no trace.

    The odds are those of the attribution, its search over shapes and runs included.
    """
    evidence = Evidence(views, twin)
    out = {}
    for contender in contenders:
        bank = Bank(evidence, (contender.effect,), with_generic=False)
        mine = [h for h in bank.hypotheses if h.target == contender.target]
        out[contender.key] = (
            _seen(bank, mine[0].groups[len(mine[0].groups) // 2], Scorer(bank, mine))
            if mine
            else np.inf
        )
    return out


def _seen(bank: Bank, group: Group, scorer: Scorer) -> float:
    norm2 = group.scale @ bank.gram[np.ix_(group.columns, group.columns)] @ group.scale
    if not norm2 > 1e-12:
        return float("inf")
    unit = group.scale / np.sqrt(norm2)
    score = (bank.gram[:, group.columns] @ unit)[:, None] * DELTAS
    odds, _ = scorer.log_posterior(np.zeros(0, dtype=int), score)
    reached = np.flatnonzero(odds[0] >= NULL_NATS)
    return float(DELTAS[reached[0]]) if reached.size else float("inf")
