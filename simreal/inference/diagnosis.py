"""diagnose(runs, twin): where simulator and logs disagree, which effect causes it, how far the gap
shrinks with it::

    runs -> views -> whitened evidence -> cells -> attribution -> what is left
        -> shrink on held-out data -> twin with effects
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import timedelta

import numpy as np

from infield.learning.parameters import ageing_of, defaults_of
from infield.session.disagreement import utc
from infield.table.thermal_table import AgeingModel, ThermalTable
from ins.documents import OMIT_NONE
from ins.errors.base import Effect
from ins.errors.catalogue import catalogue
from ins.errors.telemetry import Trace
from ins.records import InputError, Run, Site, TwinModel
from simreal.declared.generic import Generic, table_errors
from simreal.declared.twin_effects import TwinEffect, parse_effects, twin_extra_noise, twin_traces
from simreal.evidence.run_view import RunView, view_run
from simreal.evidence.whitened import ExtraNoise, RunEvidence
from simreal.inference.addback import Gone, HeldOut, shrink_of
from simreal.inference.attribute import REPLICATES, Attribution, Attributor, Listed
from simreal.inference.bank import silent
from simreal.inference.causes import Cause, cause_of, shares_of
from simreal.inference.excess import FLOOR, Excess, excesses
from simreal.inference.locate import (
    CellTable,
    GapCell,
    Leftover,
    cells_of,
    gap_cells,
    locate,
    measure_cells,
)
from simreal.inference.moved_vehicles import NAMED_FIRST, rocking, tilting
from simreal.inference.places import Place, places
from simreal.inference.tails import tail_probability
from simreal.inference.verdict import GapVerdict, Looks
from simreal.inference.wrong_site import entered_wrong_rad, with_entered, with_latitude_less

DEFAULT_ALPHA = 0.01


@dataclass(frozen=True, kw_only=True)
class GapSize:
    """Mean squared whitened residual over all rows, the twin's own, the p-value that there is no
    gap, and the distance from the twin's own in sigmas of the null.
    """

    score: float | None = None
    floor: float | None = None
    p_value: float | None = None
    excess_sigma: float | None = None


@dataclass(frozen=True, kw_only=True)
class GapSizeAfter:
    """The same with what was found."""

    score: float | None = None
    p_value: float | None = None
    excess_sigma: float | None = None


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """What is left; share of the excess, and the test that sees it."""

    present: bool | None = None
    p_value: float | None = None
    share: float | None = None
    looks_like: Looks = Looks.NOTHING


@dataclass(frozen=True)
class NotTestable:
    """An effect that these runs cannot show; target where only that one lacks something."""

    effect: str
    needs: str
    target: str | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True)
class NotLookedAt:
    """A run that could not be looked at, or not be predicted, and why."""

    run_id: str
    why: str


@dataclass(frozen=True)
class Diagnosis:
    """Everything that the document and the report say, in the document's own records.

    order: the attribution's slot behind each cause.
    """

    verdict: GapVerdict
    gap: GapSize
    gap_after: GapSizeAfter
    shrink: Gone
    channels: tuple[Excess, ...]
    where: tuple[Place, ...]
    causes: tuple[Cause, ...]
    order: tuple[int, ...]
    unexplained: Unexplained
    not_testable: tuple[NotTestable, ...]
    cells: tuple[GapCell, ...]
    views: tuple[RunView, ...]
    not_looked_at: tuple[NotLookedAt, ...]
    twin: TwinModel
    alpha: float
    threshold: float
    replicates: int
    attribution: Attribution
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True, kw_only=True)
class DiagnosisSettings:
    """How a diagnosis is made.

    alpha : false alarms per diagnosis, half for a wrongly named cause, half for "something is
    left". seed : of the replicates. effects : to choose from, None: the catalogue. hold_out : run
    ids that only judge the shrink. replicates : of the twin's noise, which set the threshold.
    ageing : of the table since it was made; None: that of the technology. told : told what is being
    done, in DIAGNOSIS_STEPS (more for a latitude far off).
    """

    alpha: float = DEFAULT_ALPHA
    seed: int = 0
    effects: Sequence[Effect] | None = None
    hold_out: Sequence[str] = ()
    replicates: int = REPLICATES
    ageing: AgeingModel | None = None
    told: Callable[[str], None] = lambda words: None


DIAGNOSIS_STEPS = 4  # that a diagnosis tells of


def diagnose(
    runs: Sequence[Run],
    twin: TwinModel,
    table: ThermalTable | None,
    settings: DiagnosisSettings | None = None,
    *,
    table_sha256: str = "",
) -> Diagnosis:
    """The sim-to-real gap of runs of one unit.

    Parameters
    ----------
    runs : power-on sessions of the twin's unit.
    twin : what the simulator believes about it.
    table : the twin's, as uncertain as its covariance and its ageing say; None: it has none.
    settings : level, seed, effects, runs held out.
    table_sha256 : of that table: a log from which it was subtracted already gets it back.

    Raises
    ------
    InputError
        Where a run is of another unit, no run can be looked at, or a run to hold out is not among
        them.
    """
    how = settings or DiagnosisSettings()
    look = _Look(runs, twin, table, table_sha256, how)
    seen = look.at(0.0)
    attribution = look.attributed(seen, enough=look.needs_another)
    wrong_rad = entered_wrong_rad(attribution)
    if wrong_rad:  # it hides the rest, a mount that bends among it
        seen = look.at(wrong_rad, seen.moved)
        attribution = look.attributed(seen, enough=look.tilts)
    if moved := tilting(attribution, look.turned_back):
        seen = look.at(wrong_rad, seen.moved | moved)
        attribution = look.attributed(seen)
    every = [*seen.views, *seen.held]
    apart = HeldOut(attribution, every, len(seen.views), seen.known) if seen.held else None
    return _diagnosed(attribution, every, seen.unused, how, apart)


@dataclass(frozen=True)
class _Seen:
    """Runs to attribute on, runs held out, what the twin makes of both in their order, the runs
    that cannot be looked at, and the names of those whose parked vehicles move.
    """

    views: list[RunView]
    held: list[RunView]
    known: list[Trace | None]
    unused: list[NotLookedAt]
    moved: frozenset[str]


@dataclass(frozen=True)
class _Look:
    """What is diagnosed, and how."""

    runs: Sequence[Run]
    twin: TwinModel
    table: ThermalTable | None
    table_sha256: str
    how: DiagnosisSettings
    _turned: dict[tuple[str, Site], RunEvidence] = field(default_factory=dict)

    def at(self, wrong_rad: float, moved: frozenset[str] | None = None) -> _Seen:
        """The runs from a latitude this much less than the entered one. moved: those whose parked
        vehicles move, None: those that rock.
        """
        self.how.told("cutting the runs at their phases")
        runs = with_latitude_less(self.runs, wrong_rad) if wrong_rad else self.runs
        found, unused = self._views(runs, moved or frozenset())
        if moved is None:
            moved = rocking([RunEvidence(replace(v, history=None), self.twin) for v in found])
            found, unused = self._views(runs, moved) if moved else (found, unused)
        views, held = _split(found, self.how.hold_out)
        listed = parse_effects(self.twin)
        known = [
            with_entered(twin_traces(listed, v.telemetry, v.name) if listed else None, v, wrong_rad)
            for v in [*views, *held]
        ]
        return _Seen(views, held, known, unused, moved)

    def turned_back(self, run: RunEvidence) -> RunEvidence:
        """The parked stretch of a run as that of a vehicle that moves."""
        site = run.view.run.header.site
        if (run.view.name, site) not in self._turned:
            view = self._view(run.view.run, run.view.telemetry.run_index, moved=True)
            assert isinstance(view, RunView)
            made = RunEvidence(replace(view, history=None), self.twin)
            self._turned[run.view.name, site] = made
        return self._turned[run.view.name, site]

    def needs_another(self, found: Attributor) -> bool:
        """Whether what is left needs other views: from another latitude, or of a vehicle that
        moves.
        """
        return entered_wrong_rad(found) != 0.0 or self.tilts(found)

    def tilts(self, found: Attributor) -> bool:
        """Whether a vehicle moves beyond the first effects named."""
        named = sum(not s.of_table for s in found.slots)
        return named >= NAMED_FIRST and bool(tilting(found, self.turned_back))

    def _view(self, run: Run, index: int, *, moved: bool) -> RunView | str:
        sha256 = self.table_sha256
        return view_run(run, index, self.table, self.twin, table_sha256=sha256, moved=moved)

    def _views(
        self, runs: Sequence[Run], moved: frozenset[str]
    ) -> tuple[list[RunView], list[NotLookedAt]]:
        """Views of the runs that can be looked at, and the others."""
        views: list[RunView] = []
        unused: list[NotLookedAt] = []
        for run in runs:
            header = run.header
            for key in ("imu_serial", "gyro_technology"):
                own, of_twin = getattr(header, key), getattr(self.twin, key)
                if of_twin and own != of_twin:
                    raise InputError(f"run {header.run_id}: {key} {own}, the twin is of {of_twin}")
            view = self._view(run, len(views), moved=header.run_id in moved)
            if isinstance(view, str):
                unused.append(NotLookedAt(header.run_id, view))
            else:
                views.append(view)
        if not views:
            raise InputError("; ".join(f"run {one.run_id}: {one.why}" for one in unused))
        return views, unused

    def attributed(
        self, seen: _Seen, enough: Callable[[Attributor], bool] = lambda _: False
    ) -> Attribution:
        """Which effects explain these runs."""
        how, listed = self.how, parse_effects(self.twin)
        how.told("comparing with the twin")
        extra = [e for k, v in enumerate(seen.views) for e in _listed_noise(listed, v.name, k)]
        attributor = Attributor(
            seen.views,
            self.twin,
            catalogue() if how.effects is None else tuple(how.effects),
            alpha=how.alpha,
            rng=np.random.default_rng(how.seed),
            replicates=how.replicates,
            listed=Listed(tuple(extra), seen.known[: len(seen.views)], self._table_errors(seen)),
        )
        attributor.enough = enough
        how.told("looking for effects")
        return attributor.explain()

    def _table_errors(self, seen: _Seen) -> tuple[Generic, ...]:
        """What the table leaves open when the last of the runs was recorded."""
        if self.table is None:
            return ()
        last = max(utc(run.header.start_utc) for run in self.runs)
        days = (last - utc(self.table.created_utc)) / timedelta(days=1)
        ageing = self.how.ageing or ageing_of(defaults_of(self.table.gyro_technology))
        aged = self.table.aged(days, ageing)
        return table_errors(aged, [v.telemetry for v in [*seen.views, *seen.held]])


def _listed_noise(listed: Sequence[TwinEffect], run_id: str, number: int) -> list[ExtraNoise]:
    """Noise that the twin lists: what is in every run once, with the first; events with their
    own.
    """
    always = twin_extra_noise([item for item in listed if not item.run_id]) if number == 0 else []
    events = twin_extra_noise([item for item in listed if item.run_id == run_id])
    return [*always, *(replace(e, run=number) for e in events)]


def _split(
    views: Sequence[RunView], hold_out: Sequence[str]
) -> tuple[list[RunView], list[RunView]]:
    """Runs to attribute on, numbered anew, and those held out."""
    if strangers := [name for name in hold_out if name not in {v.name for v in views}]:
        raise InputError(
            f"hold out {strangers[0]!r}: not among the runs ({', '.join(v.name for v in views)})"
        )
    kept = [v for v in views if v.name not in hold_out]
    if not kept:
        raise InputError("hold out: no run is left to diagnose")
    ordered = [*kept, *(v for v in views if v.name in hold_out)]
    numbered = [
        replace(v, telemetry=replace(v.telemetry, run_index=k)) for k, v in enumerate(ordered)
    ]
    return numbered[: len(kept)], numbered[len(kept) :]


def _diagnosed(
    attribution: Attribution,
    views: Sequence[RunView],
    unused: Sequence[NotLookedAt],
    how: DiagnosisSettings,
    apart: HeldOut | None = None,
) -> Diagnosis:
    """The diagnosis of an attribution: cells, what is left, shrink, places, words."""
    how.told("judging what was found")
    evidence, squares = attribution.plain_evidence, attribution.plain_squares
    cells = cells_of(evidence, squares)
    _, _, null = measure_cells(cells, squares.dof, attribution.replicate_ratio)
    threshold = float(np.quantile(null.max(axis=0), 1.0 - 0.5 * how.alpha))
    ratio = squares.ratio(evidence.z[:, None])[:, 0]
    before = locate(cells, squares, ratio, threshold)
    leftover = Leftover(evidence, cells, squares)
    statistics = leftover.statistics(attribution.replicate_z, attribution.replicate_ratio)
    p_before, _ = leftover.judge(evidence.z, ratio, statistics)
    residual = attribution.residual()  # under the noise that was found
    after_squares = attribution.squares
    ratio_after = after_squares.ratio(residual[:, None])[:, 0]
    after = locate(cells, after_squares, ratio_after, threshold)
    p_after, looks_like = leftover.judge(residual, ratio_after, statistics)
    shares = [shares_of(attribution, slot) for slot in attribution.slots]
    causes = tuple(
        cause_of(attribution, k, of_slot, shrink_of(attribution, k, apart))
        for k, of_slot in enumerate(shares)
    )
    p_max = tail_probability(attribution.replicate_max, float(attribution.log_odds_before.max()))
    present = p_after < 0.5 * how.alpha
    where = places(attribution, before, after)
    verdict = _verdict(causes, present)
    own = [of.get((c.effect, c.target), 0.0) for of, c in zip(shares, causes)]
    order = tuple(int(k) for k in np.argsort([-p for p in own], kind="stable"))
    whole, *channels = excesses(evidence, residual, attribution.columns.size)
    return Diagnosis(
        verdict=verdict,
        gap=GapSize(
            score=whole.score,
            floor=FLOOR,
            p_value=min(2.0 * min(p_max, p_before), 1.0),
            excess_sigma=whole.excess_sigma,
        ),
        gap_after=GapSizeAfter(
            score=whole.score_after, p_value=p_after, excess_sigma=whole.excess_sigma_after
        ),
        shrink=whole.shrink,
        channels=tuple(channels),
        where=where,
        causes=tuple(causes[k] for k in order),
        order=order,
        unexplained=Unexplained(
            present=bool(present),
            p_value=p_after,
            share=_left_share(before, after),
            looks_like=looks_like if present else Looks.NOTHING,
        ),
        not_testable=_not_testable(attribution),
        cells=gap_cells(before, after),
        views=tuple(views),
        not_looked_at=tuple(unused),
        twin=evidence.twin,
        alpha=how.alpha,
        threshold=attribution.threshold,
        replicates=how.replicates,
        attribution=attribution,
        notes=tuple(f"{v.name}: {n}" for v in views for n in v.notes),
    )


def _left_share(before: CellTable, after: CellTable) -> float:
    """Excess information left, of what there was."""
    total = float(np.maximum(before.nats, 0.0).sum())
    return float(np.clip(np.maximum(after.nats, 0.0).sum() / total, 0.0, 1.0)) if total > 0 else 0.0


def _verdict(causes: Sequence[Cause], present: bool) -> GapVerdict:
    named = [c for c in causes if c.named]
    if not causes:
        return GapVerdict.UNEXPLAINED if present else GapVerdict.NO_GAP
    if not named:
        return GapVerdict.UNEXPLAINED
    if present or len(named) < len(causes):
        return GapVerdict.PARTLY_EXPLAINED
    return GapVerdict.EXPLAINED


def _not_testable(attribution: Attribution) -> tuple[NotTestable, ...]:
    """Effects that no target of these runs can show, with what they need, each once; those that
    only a silent sensor cannot show come with it as the target.
    """
    tested = {h.name for h in attribution.hypotheses}
    out: dict[tuple[str, str], str] = {}
    for name, target, needs in attribution.not_testable:
        if name not in tested:
            out.setdefault((name, ""), needs)
        elif needs == silent(target):
            out[name, target] = needs
    return tuple(
        NotTestable(name, needs, target or None) for (name, target), needs in sorted(out.items())
    )
