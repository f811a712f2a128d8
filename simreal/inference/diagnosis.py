"""diagnose(runs, twin): where simulator and logs disagree, which effect causes it, how far the gap
shrinks with it.

runs -> views -> whitened evidence -> cells -> attribution -> what is left -> shrink on held-out
data -> twin with effects
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import ThermalTable
from ins.records import InputError, Run, TwinModel
from simreal.declared.twin_effects import TwinEffect, parse_effects, twin_extra_noise, twin_traces
from simreal.effects.base import SLOW_NAME, Effect
from simreal.effects.catalogue import catalogue
from simreal.effects.telemetry import AIRBORNE, PARKED, ROLLING
from simreal.evidence.run_view import RunView, view_run
from simreal.evidence.whitened import CHANNELS, Evidence, ExtraNoise
from simreal.inference.addback import HeldOut, shrink_of
from simreal.inference.attribute import (
    REPLICATES,
    Attribution,
    Attributor,
    Listed,
    Slot,
    tail_probability,
)
from simreal.inference.bank import silent
from simreal.inference.causes import Cause, cause_of, posterior_bars
from simreal.inference.excess import Excess, excesses
from simreal.inference.locate import Cell, CellTable, Leftover, cells_of, locate, measure_cells
from simreal.inference.noise_hypotheses import NoiseHypothesis, term_of
from simreal.inference.scoring import fit
from simreal.inference.verdict import GapVerdict, Looks

DEFAULT_ALPHA = 0.01
MOST_PLACES = 8
SPAN = (0.05, 0.95)  # of the energy, for the stretch of time and temperature that a place names
LEAST_SHARE = 0.02  # of the gap, for a channel to be named; chosen: as TOUCHED of addback, 1/50
PHASE_OF_MOTION = {PARKED: "extended_alignment", ROLLING: "taxi", AIRBORNE: "flight"}


@dataclass(frozen=True)
class Place:
    """Where a part of the gap lies; share of the total excess. temperature: None where there is
    none.
    """

    channel: str
    phase: str
    temperature_degC: tuple[float, float] | None
    frequency_hz: tuple[float, float]
    time_s: tuple[float, float]
    share: float


@dataclass(frozen=True)
class Diagnosis:
    """Everything that the document and the report say; they compute nothing.

    excesses: the gap over all rows, then channel by channel. bars: the most probable answers of
    each cause. cells: before; cells_after. unused: runs that could not be looked at.
    """

    verdict: GapVerdict
    sentence: str
    excesses: tuple[Excess, ...]
    p_value: float
    p_value_after: float
    where: tuple[Place, ...]
    causes: tuple[Cause, ...]
    bars: tuple[tuple[tuple[str, str, float], ...], ...]
    left_present: bool
    left_share: float
    looks_like: Looks
    not_testable: tuple[tuple[str, str, str], ...]
    cells: CellTable
    cells_after: CellTable
    views: tuple[RunView, ...]
    unused: tuple[tuple[str, str], ...]
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
    """

    alpha: float = DEFAULT_ALPHA
    seed: int = 0
    effects: Sequence[Effect] | None = None
    hold_out: Sequence[str] = ()
    replicates: int = REPLICATES


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
    table : the twin's, taken as exact; None: it has none.
    settings : level, seed, effects, runs held out.
    table_sha256 : of that table: a log from which it was subtracted already gets it back.

    Raises
    ------
    InputError
        Where a run is of another unit, no run can be looked at, or a run to hold out is not among
        them.
    """
    how = settings or DiagnosisSettings()
    views, unused = _views(runs, twin, table, table_sha256)
    chosen = catalogue() if how.effects is None else tuple(how.effects)
    views, held = _split(views, how.hold_out)
    listed = parse_effects(twin)
    known = [twin_traces(listed, v.telemetry, v.name) if listed else None for v in [*views, *held]]
    extra = [e for k, v in enumerate(views) for e in _listed_noise(listed, v.name, k)]
    attribution = Attributor(
        views,
        twin,
        chosen,
        alpha=how.alpha,
        rng=np.random.default_rng(how.seed),
        replicates=how.replicates,
        listed=Listed(tuple(extra), known[: len(views)]),
    ).explain()
    apart = HeldOut(attribution, [*views, *held], len(views), known) if held else None
    return _diagnosed(attribution, [*views, *held], unused, how, apart)


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


def _views(
    runs: Sequence[Run], twin: TwinModel, table: ThermalTable | None, table_sha256: str
) -> tuple[list[RunView], list[tuple[str, str]]]:
    views: list[RunView] = []
    unused: list[tuple[str, str]] = []
    for run in runs:
        header = run.header
        if twin.imu_serial and header.imu_serial != twin.imu_serial:
            raise InputError(
                f"run {header.run_id}: imu_serial {header.imu_serial}, the twin is of"
                f" {twin.imu_serial}"
            )
        if header.gyro_technology != twin.gyro_technology:
            raise InputError(
                f"run {header.run_id}: gyro_technology {header.gyro_technology}, the twin is"
                f" {twin.gyro_technology}"
            )
        view = view_run(run, len(views), table, twin, table_sha256=table_sha256)
        if isinstance(view, str):
            unused.append((header.run_id, view))
        else:
            views.append(view)
    if not views:
        raise InputError("; ".join(f"run {name}: {why}" for name, why in unused))
    return views, unused


def _diagnosed(
    attribution: Attribution,
    views: Sequence[RunView],
    unused: Sequence[tuple[str, str]],
    how: DiagnosisSettings,
    apart: HeldOut | None = None,
) -> Diagnosis:
    """The diagnosis of an attribution: cells, what is left, shrink, places, words."""
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
    causes = tuple(
        cause_of(attribution, k, shrink_of(attribution, k, apart))
        for k in range(len(attribution.slots))
    )
    bars = tuple(tuple(posterior_bars(attribution, slot)) for slot in attribution.slots)
    p_max = tail_probability(attribution.replicate_max, float(attribution.log_odds_before.max()))
    present = p_after < 0.5 * how.alpha
    where = _places(attribution, before, after)
    verdict = _verdict(causes, present)
    order = np.argsort([-c.probability for c in causes], kind="stable")
    return Diagnosis(
        verdict=verdict,
        sentence=_sentence(verdict, causes, where, looks_like if present else Looks.NOTHING),
        excesses=excesses(evidence, residual, attribution.columns.size),
        p_value=min(2.0 * min(p_max, p_before), 1.0),
        p_value_after=p_after,
        where=where,
        causes=tuple(causes[k] for k in order),
        bars=tuple(bars[k] for k in order),
        left_present=bool(present),
        left_share=_left_share(before, after),
        looks_like=looks_like if present else Looks.NOTHING,
        not_testable=_not_testable(attribution),
        cells=before,
        cells_after=after,
        views=tuple(views),
        unused=tuple(unused),
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


HEADS = {
    GapVerdict.EXPLAINED: "Explained by",
    GapVerdict.PARTLY_EXPLAINED: "Partly explained by",
    GapVerdict.UNEXPLAINED: "Not explained by a named effect:",
}
MOST_RIVALS_SAID = 4  # in a sentence; the document lists all


def _sentence(
    verdict: GapVerdict, causes: Sequence[Cause], where: Sequence[Place], looks_like: Looks
) -> str:
    """The verdict in one sentence (words of effects.md section 3.6)."""
    if verdict is GapVerdict.NO_GAP:
        return "No gap beyond the noise floor."
    if not causes:
        at = f", mostly in {where[0].channel}" if where else ""
        return f"A gap that no known effect explains{at}: it shows in {looks_like}."
    said = " and ".join(_said(cause) for cause in causes)
    something_left = verdict is GapVerdict.PARTLY_EXPLAINED and looks_like is not Looks.NOTHING
    tail = "; something is left" if something_left else ""
    return f"{HEADS[verdict]} {said}{tail}."


def _said(cause: Cause) -> str:
    """A cause, with what it cannot be told from."""
    what = _called(cause)
    if cause.resolved or not cause.rivals:
        return what
    others = {
        r.effect if r.target == cause.target else f"{r.effect} on {r.target}" for r in cause.rivals
    }
    return f"{what} (not unique: or {', '.join(sorted(others)[:MOST_RIVALS_SAID])})"


def _called(cause: Cause) -> str:
    if cause.effect == SLOW_NAME:
        return f"a slow variation on {cause.target}, not tied to any logged quantity"
    if not cause.named:
        return f"an {cause.effect.replace('_', ' ')} on {cause.target}"
    return f"{cause.effect} on {cause.target}"


def _places(attribution: Attribution, cells: CellTable, after: CellTable) -> tuple[Place, ...]:
    """Channels by their share of the gap, with band, time and temperature.

    A found effect counts where it enters: on its target if that is a channel (a gyro's drift also
    shows in GNSS), else on the channels that hold its energy. What is left counts in the cells that
    still stand out.
    """
    evidence, squares = attribution.plain_evidence, attribution.plain_squares
    channels = np.array([CHANNELS.index(c.channel) for c in cells.cells])
    by_cell, by_channel = np.zeros(len(cells.cells)), np.zeros(len(CHANNELS))
    explained = np.zeros(evidence.size)
    for slot in attribution.slots:
        if slot.extra is not None:
            energy = 2.0 * max(slot.log_odds, 0.0) * _noise_cells(attribution, slot, cells)
        else:
            signature = _signature(attribution, slot)
            explained += signature
            ratio = squares.ratio(signature[:, None])[:, 0]
            for quick in squares.quick.values():
                ratio[quick] = 0.0
            energy = np.array(
                [float((squares.dof[c.index] * ratio[c.index]).sum()) for c in cells.cells]
            )
        target = slot.hypothesis.target
        # as a target it is the vehicle, as a channel its side slip
        if target in CHANNELS and target != "vehicle":
            own = energy * (channels == CHANNELS.index(target))
            energy = own * (energy.sum() / own.sum()) if own.sum() > 0 else energy
        by_cell += energy
    by_cell += np.where(after.located, 2.0 * np.maximum(after.nats, 0.0), 0.0)
    if not attribution.slots:
        by_cell = np.where(cells.located, 2.0 * np.maximum(cells.nats, 0.0), 0.0)
    np.add.at(by_channel, channels, by_cell)
    total = float(by_channel.sum())
    places = []
    for number in np.flatnonzero(by_channel > LEAST_SHARE * max(total, 1e-300)):
        mine = channels == number
        largest = float(by_cell[mine].max())
        own = [cells.cells[k] for k in np.flatnonzero(mine & (by_cell > 0.1 * largest))]
        places.append(
            _place(evidence, CHANNELS[number], own, explained, float(by_channel[number] / total))
        )
    places.sort(key=lambda p: -p.share)
    return tuple(places[:MOST_PLACES])


def _signature(attribution: Attribution, slot: Slot) -> NDArray:
    """Whitened rows of one found effect as fitted with the others."""
    columns = attribution.columns
    beta, _ = fit(attribution.bank, columns)
    return attribution.bank.signature(slot.columns, beta[np.isin(columns, slot.columns)])


def _noise_cells(attribution: Attribution, slot: Slot, cells: CellTable) -> NDArray:
    """Shares of the cells (k,) in what a found noise changes."""
    factor = np.zeros(attribution.plain_squares.dof.size)
    h = slot.hypothesis
    assert isinstance(h, NoiseHypothesis) and slot.extra is not None
    term = term_of(
        attribution.plain_evidence,
        attribution.plain_squares,
        h.effect,
        h.target,
        dict(slot.extra.shape),
        h.run,
    )
    factor[term.index] = np.abs(slot.extra.square) * term.factor
    dof = attribution.plain_squares.dof
    change = np.array([float((dof[c.index] * factor[c.index] ** 2).sum()) for c in cells.cells])
    return np.asarray(change / max(change.sum(), 1e-300))


def _place(
    evidence: Evidence, channel: str, cells: Sequence[Cell], explained: NDArray, share: float
) -> Place:
    rows = evidence.rows
    at = np.flatnonzero(rows.channel == CHANNELS.index(channel))
    e = (
        explained[at] ** 2
        if np.any(explained[at])
        else (evidence.z[at] ** 2 if at.size else np.zeros(0))
    )
    if not at.size:
        span, kind, warm = (evidence.views[0].start_s, evidence.views[0].end_s), PARKED, None
    else:
        kind = int(np.bincount(rows.kind[at], weights=e, minlength=3).argmax())
        inside = rows.kind[at] == kind
        span = _span(rows.time_s[at][inside], e[inside]) or (0.0, 0.0)
        T = rows.temperature_degC[at][inside]
        warm = _span(T[np.isfinite(T)], e[inside][np.isfinite(T)])
    low = min(c.frequency_hz[0] for c in cells)
    high = max(min(c.frequency_hz[1], 1e3) for c in cells)
    return Place(
        channel, _phase_name(evidence, kind, span), warm, (float(low), float(high)), span, share
    )


def _span(values: NDArray, weights: NDArray) -> tuple[float, float] | None:
    if not values.size or not weights.sum() > 0:
        return None
    order = np.argsort(values)
    total = np.cumsum(weights[order]) / weights.sum()
    a, b = np.searchsorted(total, SPAN)
    return float(values[order][min(a, values.size - 1)]), float(
        values[order][min(b, values.size - 1)]
    )


def _phase_name(evidence: Evidence, kind: int, span: tuple[float, float]) -> str:
    """The logged phase that holds the middle of the span, else the kind of motion in words of
    formats.md.
    """
    middle = 0.5 * (span[0] + span[1])
    for view in evidence.views:
        for phase in view.run.phases:
            if phase.start_s <= middle <= phase.end_s:
                return str(phase.phase)
    if kind == PARKED and not any(v.run.phases for v in evidence.views):
        return "parked"
    return PHASE_OF_MOTION[kind]


def _not_testable(attribution: Attribution) -> tuple[tuple[str, str, str], ...]:
    """Effects that no target of these runs can show, with what they need, each once; those that
    only a silent sensor

    cannot show come with it as the target (else "").
    """
    tested = {h.name for h in attribution.hypotheses}
    out: dict[tuple[str, str], str] = {}
    for name, target, needs in attribution.not_testable:
        if name not in tested:
            out.setdefault((name, ""), needs)
        elif needs == silent(target):
            out[name, target] = needs
    return tuple((name, needs, target) for (name, target), needs in sorted(out.items()))
