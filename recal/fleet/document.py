"""fleet.json (recal.fleet/1): what became of every run, which units drift, which tables are stale,
what was refused and why.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recal.fleet.records import (
    MERGED,
    OUTCOMES,
    CallTiming,
    Criteria,
    Example,
    FleetBand,
    FleetOutcome,
    FleetReport,
    FleetRequest,
    FleetTiming,
    FleetVerdict,
    LeftOutGroup,
    NoteGroup,
    RunOutcome,
    RunRow,
    Spread,
    StaleRow,
    StepDrift,
    TableFacts,
    UnitReport,
    UnitRow,
)
from recal.fleet.unit_summary import LEVEL
from recal.service.priors.forecast import most_urgent
from recal.service.priors.records import ForecastReport
from recal.service.results.files import program_version
from recal.service.results.pages import NM_H_PER_DEG_H, BiasStep, MethodDocument
from recal.service.store import (
    DEFAULT_SIGMA_deg_h,
    TableStore,
    UnitKey,
    UnitRecord,
    holds_store,
    moment,
    store_name,
)

MAX_POINTS = 2000
WORST = {  # the verdict where nothing was merged: of the first of these that there is
    FleetOutcome.INCONSISTENT: FleetVerdict.INCONSISTENT,
    FleetOutcome.REFUSED: FleetVerdict.REFUSED,
    FleetOutcome.BAD_INPUT: FleetVerdict.BAD_INPUT,
    FleetOutcome.CRASHED: FleetVerdict.FAILED,
}
LONGEST_REASON = 220
METHOD = (
    (
        "each run of a unit an update of its own, in the order of the starts, committed before the"
        " next is tried"
    ),
    "all runs of a unit in one joint update, without those that contradict the model or the table",
)
STALE_DAYS = 365.0  # chosen: 1 year
STALE_SHARE = 0.5  # of the sigma that tables of the technology come with
CRITERIA = Criteria(
    stale_after_days=STALE_DAYS,
    stale_sigma_deg_h={name: STALE_SHARE * sigma for name, sigma in DEFAULT_SIGMA_deg_h.items()},
    stale_contradictions=1,
    surprise_sigmas=3.0,
)


class Timing:
    """When each run of this call was through, and what it cost."""

    def __init__(self) -> None:
        self.workers, self.where = 0, ""
        self._began = datetime.now(UTC)
        self._ends_s: list[float] = []
        self._spent: list[tuple[float, float]] = []

    def tell(self, outcome: RunOutcome) -> None:
        self._ends_s.append((datetime.now(UTC) - self._began).total_seconds())
        self._spent.append((outcome.seconds, outcome.cpu_s))

    def document(self, seconds: float) -> CallTiming:
        n = len(self._ends_s)
        rows = (
            np.unique(np.linspace(0, n - 1, min(n, MAX_POINTS)).round().astype(int))
            if n
            else np.arange(0)
        )
        wall, cpu = np.array(self._spent).reshape(-1, 2).T
        return CallTiming(
            began_utc=self._began.strftime("%Y-%m-%dT%H:%M:%SZ"),
            seconds=round(seconds, 2),
            runs=n,
            workers=self.workers,
            where=self.where,
            runs_per_hour=3600.0 * n / seconds if n else None,
            run_s=_spread(wall),
            run_cpu_s=_spread(cpu),
            cpu_s=round(float(cpu.sum()), 1),
            curve=[(round(self._ends_s[k], 2), int(k) + 1) for k in rows],
        )


def _spread(values: NDArray) -> Spread | None:
    if not len(values):
        return None
    median, late, most = np.quantile(values, [0.5, 0.95, 1.0])
    return Spread(median=float(median), p95=float(late), max=float(most))


def fleet_document(
    request: FleetRequest,
    outcomes: Sequence[RunOutcome],
    summaries: Mapping[UnitKey, UnitReport],
    timing: FleetTiming,
) -> FleetReport:
    """outcomes: of all runs; summaries: of the units that have some; both of this call and those
    that it goes on from.
    """
    now = datetime.now(UTC)
    counts = Counter(o.outcome for o in outcomes)
    tables = _tables(request.store_url, now)
    units = [
        _unit(key, summary, outcomes, tables.get(key), request.output)
        for key, summary in summaries.items()
    ]
    ranks = count(1)
    units.sort(key=lambda u: -u.ranked_nm_h)
    return FleetReport(
        verdict=fleet_verdict(counts),
        reasons=[
            f"{counts[name]} {name}: {meaning}"
            for name, meaning in OUTCOMES.items()
            if counts[name]
        ],
        store=store_name(request.store_url),
        mode=request.mode,
        issued_utc=now.strftime("%Y-%m-%dT%H:%M:%SZ"),
        method=MethodDocument(
            name=METHOD[request.jointly], program="recal", version=program_version()
        ),
        counts={name: counts[name] for name in OUTCOMES},
        units=[replace(u, rank=next(ranks)) if u.drift else u for u in units],
        stale=_stale(tables, summaries),
        left_out=_groups(outcomes),
        noted=_notes(outcomes),
        coverage=_coverage(summaries),
        criteria=CRITERIA,
        timing=timing,
        runs=[_run(o, request.output) for o in outcomes],
        forecast=_forecast(request.store_url),
    )


def fleet_verdict(counts: Counter[FleetOutcome]) -> FleetVerdict:
    """One verdict: what was done if anything was; else nothing new; else the worst reason why
    not.
    """
    if any(counts[name] for name in MERGED):
        committed = counts[FleetOutcome.COMMITTED]
        return FleetVerdict.COMMITTED if committed else FleetVerdict.PROPOSED
    found = next((verdict for name, verdict in WORST.items() if counts[name]), None)
    if found is None and counts[FleetOutcome.ALREADY]:
        return FleetVerdict.UP_TO_DATE
    return found or FleetVerdict.REFUSED


def _tables(store_url: str, now: datetime) -> dict[UnitKey, TableFacts]:
    """Facts of every table in the store."""
    if not holds_store(store_url):
        return {}
    with TableStore.open(store_url) as store:
        return {record.unit: table_facts(store, record, now) for record in store.units()}


def _forecast(store_url: str) -> ForecastReport | None:
    """When the units of the store, as this call left it, need their next session."""
    if not holds_store(store_url):
        return None
    with TableStore.open(store_url) as store:
        return most_urgent(store)


def _unit(
    key: UnitKey,
    summary: UnitReport,
    outcomes: Sequence[RunOutcome],
    table: TableFacts | None,
    output: Path,
) -> UnitRow:
    """A row of the fleet."""
    mine = [o for o in outcomes if o.unit == key]
    pages = [str(Path(page).relative_to(output)) for page in summary.pages]
    best = [o.folder for o in mine if o.outcome in MERGED] + [o.folder for o in mine]
    shown = [page for folder in reversed(best) for page in pages if str(output / page) == folder]
    step = _step_drift(summary.steps)
    sizes = [found.nm_h for found in (summary.drift, step) if found is not None]
    return UnitRow(
        **vars(key),
        runs=dict(Counter(o.outcome for o in mine)),
        drift=summary.drift,
        step_drift=step,
        ranked_nm_h=max(sizes, default=-1.0),
        coverage=summary.coverage,
        steps=summary.steps,
        step_words=summary.step_words,
        table=table,
        page=f"{shown[0]}/update.html" if shown else None,
        pages=[f"{page}/update.html" for page in pages],
        proposal=next((o.proposal for o in mine if o.proposal is not None), None),
    )


def _step_drift(steps: Sequence[BiasStep]) -> StepDrift | None:
    """What a step of the level gyros that the table does not follow makes of a solution; None
    without one.
    """
    level = [(s.shift_deg_h, s.sigma_deg_h) for s in steps if s.axis in LEVEL]
    if not level:
        return None
    shift, sigma = np.array(level).T
    size = float(np.linalg.norm(shift))
    return StepDrift(
        nm_h=NM_H_PER_DEG_H * size,
        sigma_nm_h=NM_H_PER_DEG_H * float(np.linalg.norm(shift / size * sigma)),
    )


def _stale(tables: Mapping[UnitKey, TableFacts], visited: Collection[UnitKey]) -> list[StaleRow]:
    """Tables that need somebody's attention, the contradicted first, then the oldest; those without
    a run among them.
    """
    rows = [
        StaleRow(
            **vars(key),
            reasons=table.stale,
            contradictions=table.contradictions,
            age_days=table.age_days,
            in_this_update=key in visited,
        )
        for key, table in tables.items()
        if table.stale
    ]
    return sorted(rows, key=lambda row: (-row.contradictions, -row.age_days))


def _groups(outcomes: Sequence[RunOutcome]) -> list[LeftOutGroup]:
    """Runs left out, by outcome and reason; a reason with its numbers and names taken out."""
    groups: dict[tuple[FleetOutcome, str], list[RunOutcome]] = defaultdict(list)
    for o in outcomes:
        if o.outcome not in MERGED and o.outcome != FleetOutcome.ALREADY:
            groups[o.outcome, plain_reason(o)].append(o)
    rows = [
        LeftOutGroup(
            outcome=outcome,
            reason=reason,
            count=len(runs),
            units=len({o.unit for o in runs if o.unit}),
            example=Example(runs[0].path, (runs[0].reasons or ("",))[0]),
        )
        for (outcome, reason), runs in groups.items()
    ]
    order = list(OUTCOMES)
    return sorted(rows, key=lambda row: (order.index(row.outcome), -row.count))


def plain_reason(outcome: RunOutcome) -> str:
    """The first reason without what is the run's own: path, names and numbers."""
    text = (outcome.reasons or ("no reason is on record",))[0]
    for own, word in ((outcome.path, "RUN"), (outcome.run_id, "RUN"), (outcome.imu_serial, "UNIT")):
        text = text.replace(own, word) if own else text
    return re.sub(r"(?<![\w#])[-+]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?", "#", text)[:LONGEST_REASON]


def _notes(outcomes: Sequence[RunOutcome]) -> list[NoteGroup]:
    """What was noted of runs, whatever became of them."""
    found: dict[str, list[str]] = defaultdict(list)
    for o in outcomes:
        for note in o.notes:
            found[note].append(o.path)
    return [NoteGroup(note, len(paths), paths[0]) for note, paths in sorted(found.items())]


def _coverage(summaries: Mapping[UnitKey, UnitReport]) -> list[FleetBand]:
    """In each 5 degC band: how many units were seen there, and for how long."""
    bands: dict[float, list[float]] = defaultdict(list)
    for summary in summaries.values():
        for band in summary.coverage:
            bands[band.low_degC].append(band.seconds)
    return [
        FleetBand(
            low_degC=low,
            high_degC=low + 5.0,
            units=len(bands[low]),
            seconds=round(sum(bands[low]), 1),
        )
        for low in sorted(bands)
    ]


def _run(o: RunOutcome, output: Path) -> RunRow:
    """A run's line; `report` is relative to the output folder."""
    inside = bool(o.folder) and Path(o.folder).is_relative_to(output)
    report = f"{Path(o.folder).relative_to(output)}/update.json" if inside else None
    return RunRow(**vars(o), report=report)


def table_facts(store: TableStore, record: UnitRecord, now: datetime) -> TableFacts:
    """Age since the newest data in it, sigma (RMS over the nodes of the level gyros), sessions that
    contradict it.
    """
    unit, revision = record.unit, record.active
    table = revision.table
    sigma = np.concatenate([table.sigma_deg_h(k, table.temperature_degC[k]) for k in (0, 1)])
    against = store.contradictions(*unit.key)
    facts = TableFacts(
        revision=revision.number,
        kind=revision.kind,
        sha256=revision.sha256,
        created_utc=table.created_utc,
        stored_utc=revision.created_utc,
        age_days=round((now - moment(table.created_utc)).total_seconds() / 86400.0, 1),
        sigma_deg_h=float(np.sqrt(np.mean(sigma**2))),
        contradictions=len(against),
        contradicted_by=[evidence.run_id for evidence in against[-5:]],
        stale=(),
    )
    return replace(facts, stale=_why_stale(facts, unit.gyro_technology))


def _why_stale(facts: TableFacts, technology: str) -> list[str]:
    """Why the table needs attention; empty where it does not."""
    most = STALE_SHARE * DEFAULT_SIGMA_deg_h[technology]
    reasons = []
    if facts.contradictions:
        several = facts.contradictions > 1
        words = "sessions contradict it" if several else "session contradicts it"
        reasons.append(f"{facts.contradictions} {words}")
    if facts.age_days > STALE_DAYS:
        reasons.append(f"its newest data are {facts.age_days:.0f} days old")
    if facts.sigma_deg_h > most:
        reasons.append(f"sigma {facts.sigma_deg_h:.4f} deg/h over its nodes, above {most:g}")
    return reasons
