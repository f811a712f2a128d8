"""The update report: one self-contained HTML page drawn from the update document alone; all numbers
come from there.

Written to be read twice: the verdict, its reason and three figures in ten seconds; everything
behind them below, with the items of ISO/IEC 17025:2017, 7.8.2 to 7.8.6 (identification, dates,
conditions, method, results with U(k=2), decision rule and statement of conformity, what is out of
scope).
"""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count, cycle

from infield.reports import update_figures as figures
from infield.reports.documents.session_records import (
    EstimatedDocument,
    SessionDocument,
    TemperatureDocument,
)
from infield.reports.documents.update import TableUncertainty, table_uncertainty
from infield.reports.documents.update_records import (
    ChangeDocument,
    ConsistencyDocument,
    ProposalState,
    UpdateDocument,
    VarianceShares,
)
from infield.reports.drawing import Panel
from infield.reports.page import decimals_for, number, render_page
from infield.session.hysteresis import ThermalTerm
from infield.session.points import AxisObservability
from infield.session.reasons import HeadingSource, VarianceSource
from infield.table.file import export_command, table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.records import AXES, Span, TableDocument
from ins.twin_file import TWIN_SECTIONS
from ins.verdicts import Observability, Outcome

VERDICTS: dict[str, tuple[str, str, str]] = {  # verdict: word, look, symbol
    Outcome.COMMITTED: ("Committed", "good", "\u2714"),
    Outcome.PROPOSED: ("Proposed", "fair", "\u25c6"),
    Outcome.REFUSED: ("Refused", "none", "\u25a0"),
    Outcome.INCONSISTENT: ("Inconsistent", "bad", "\u2716"),
}
PROPOSALS = {  # what became of one: as VERDICTS
    ProposalState.OUT_OF_DATE: ("Out of date", "none", "\u25a0"),
    ProposalState.APPROVED: ("Approved", "good", "\u2714"),
    ProposalState.REJECTED: ("Rejected", "bad", "\u2716"),
}
BADGES: dict[str, tuple[str, str]] = {
    Observability.OBSERVED: ("observed", "good"),
    Observability.WEAK: ("weak", "fair"),
    Observability.NOT_OBSERVABLE: ("not observable", "none"),
}
SOURCES = {
    HeadingSource.TURNS: "turns in the taxi",
    HeadingSource.STOPS: "stops on another heading",
    HeadingSource.GNSS: "the GNSS track",
    HeadingSource.ODOMETER: "the odometer",
    HeadingSource.SURVEY: "a surveyed heading",
    HeadingSource.COMBINED: "several sources together",
}
# of the parts of a bar, by size: Okabe and Ito's colours (colour-blind safe), then their pale ones
SOURCE_COLOURS = (
    "#0072b2",
    "#e69f00",
    "#009e73",
    "#cc79a7",
    "#56b4e9",
    "#d55e00",
    "#999999",
    "#f0e442",
    "#444444",
)
# a source below 0.05 % everywhere would read 0.0 %: it stands in the JSON alone
LEAST_DRAWN_SHARE = 0.0005
OUTCOMES = {
    Outcome.ACCEPTED: ("merged", "good"),
    Outcome.REFUSED: ("left out", "none"),
    Outcome.INCONSISTENT: ("inconsistent", "bad"),
}


@dataclass(frozen=True)
class Statement:
    """Why the verdict is what it is, and what to do with it, a sentence each."""

    why: str
    use: str


@dataclass(frozen=True, kw_only=True)
class AxisView:
    """What the first card says of one gyro."""

    axis: str
    seen: AxisObservability | None
    word: str
    look: str
    help: str
    largest: ChangeDocument | None
    table: TableUncertainty | None


@dataclass(frozen=True, kw_only=True)
class SessionView:
    """One run with its figures; excluded spans go to the first run of an id.

    span_totals: reason, how many spans, seconds; unseen: gyros without residuals.
    """

    run: SessionDocument
    number: int
    spans: Sequence[Span]
    span_totals: Sequence[tuple[str, int, float]]
    timeline: Sequence[Panel]
    residuals: Sequence[Panel]
    unseen: Sequence[str]
    coverage: Panel | None
    chain: Sequence[Panel]


@dataclass(frozen=True)
class BudgetRow:
    """A term, and for each gyro its sigma [deg/h] with its share of the longest bar [%]."""

    term: str
    cells: Sequence[tuple[float | None, float]]


@dataclass(frozen=True)
class SourceRow:
    """A source of variance: its words, its colour, and for each gyro its share [%]."""

    words: str
    colour: str
    percent: Sequence[float | None]


@dataclass(frozen=True)
class NodeRow:
    """A node of one gyro: temperature, sigma [deg/h], and each shown source's share [%]."""

    temperature_degC: float
    sigma_deg_h: float
    percent: Sequence[float]


@dataclass(frozen=True, kw_only=True)
class VarianceView:
    """The variance of the new table by source.

    rows, sigma_deg_h: of each gyro's mean over the temperatures visited; bars: the rows' shares
    that are drawn, a list a gyro; nodes: by axis.
    """

    rows: Sequence[SourceRow]
    sigma_deg_h: Sequence[float | None]
    bars: Sequence[tuple[str, Sequence[tuple[str, str, float]]]]
    nodes: Mapping[str, Sequence[NodeRow]]


@dataclass(frozen=True, kw_only=True)
class Commands:
    """What a reader may copy."""

    rollback: str
    history: str
    approve: str
    reproduce: str
    export: str
    diagnose: str
    look: str


def update_html(document: UpdateDocument) -> str:
    """The report of an update (`update.json`, formats.md section 5): committed, proposed, refused
    or inconsistent.
    """
    drawn = _panels(document)
    known = table_uncertainty(document) if document.table_before else {}
    sessions = [_session(document, k) for k in range(len(document.sessions))]
    estimated = estimated_of(document)
    return render_page(
        "update.html.j2",
        d=document,
        verdict=_verdict(document),
        statement=_statement(document),
        next=_next_step(document),
        axes=[_axis(document, axis, known) for axis in AXES],
        decimals=_decimals(document),
        revision=(document.decision or document).revision,
        changed=_changed(document),
        bias_panels=drawn["bias"],
        shape_panels=drawn["shape"],
        without_points=[axis for axis in AXES if not figures.seen_points(document, axis)],
        run_key=_run_key(document),
        changes={axis: _changes(document, axis) for axis in AXES},
        agreement=(
            figures.agreement_panel(document) if document.consistency.nis_mean is not None else None
        ),
        kinds=sorted({kind for s in estimated for kind in s.measurements}),
        sessions=sessions,
        budget=_budget(document),
        variance=_variance(document),
        noise=_noise(document),
        commands=_commands(document),
        sources=SOURCES,
        outcomes=OUTCOMES,
        nis_words=_nis_words,
        band=_band,
        temperature_words=_temperature_words,
        hysteresis_words=_hysteresis_words,
    )


def estimated_of(document: UpdateDocument) -> list[EstimatedDocument]:
    """The sessions that were estimated."""
    return [s for s in document.sessions if isinstance(s, EstimatedDocument)]


def _verdict(document: UpdateDocument) -> tuple[str, str, str]:
    """Word, look and symbol: of what became of a proposal, else of the verdict."""
    verdict = VERDICTS.get(document.verdict, (str(document.verdict), "none", "\u25a0"))
    state = document.proposal_state
    return verdict if state is None else PROPOSALS.get(state, verdict)


def _table(data: TableDocument, name: str) -> ThermalTable | None:
    return table_from_dict(data, name=name) if data else None


def _changed(document: UpdateDocument) -> bool:
    """Does the document hold a table that differs from the stored one (also where it was not
    committed)?
    """
    return bool(document.table_after) and document.table_after != document.table_before


def _changes(document: UpdateDocument, axis: str) -> list[ChangeDocument]:
    return [row for row in document.changes if row.axis == axis]


def _decimals(document: UpdateDocument) -> int:
    """Decimals for deg/h that give the smallest uncertainty of the page two digits."""
    sigmas: list[float | None] = [s.sigma_after_deg_h for s in document.observability.values()]
    return decimals_for(sigmas + [row.U_after_k2_deg_h for row in document.changes])


def _statement(document: UpdateDocument) -> Statement:
    """One sentence of why and one of what to do with it."""
    reasons = document.reasons or ["no reason is on record"]
    match document.verdict:
        case Outcome.COMMITTED | Outcome.PROPOSED:
            return _statement_of_change(document)
        case Outcome.REFUSED:
            several = "Nothing can be merged, for these reasons:"
            return Statement(
                why=reasons[0] if len(reasons) == 1 else several,
                use="Keep using the stored table: nothing was written to it.",
            )
        case Outcome.INCONSISTENT:
            several = "The data contradict the model or the table:"
            return Statement(
                why=reasons[0] if len(reasons) == 1 else several,
                use=(
                    "Do not use: the data contradict the model or the table. Nothing was committed."
                ),
            )
    return Statement(why="; ".join(reasons), use="Unknown verdict: do not use.")


def _next_step(document: UpdateDocument) -> tuple[str, str]:
    """What the reader does now, in words and as a command."""
    commands = _commands(document)
    again = f"{commands.reproduce} --propose --note WHY"
    match document.proposal_state:
        case ProposalState.APPROVED:
            return "Next, write it to a file for the unit:", commands.export
        case ProposalState.REJECTED:
            return "Put it forward again where the reason no longer holds:", again
        case ProposalState.OUT_OF_DATE:
            return "Next, update again from the same runs:", again
    match document.verdict:
        case Outcome.COMMITTED:
            return "Next, write it to a file for the unit:", commands.export
        case Outcome.PROPOSED if document.proposal is not None:
            return "Next, where this page convinces you:", commands.approve
        case Outcome.PROPOSED:
            return "Next, where this page convinces you:", f"{commands.reproduce} --commit"
        case Outcome.INCONSISTENT:
            return "Next, find out what contradicts:", commands.diagnose
    return "Next, see what the run lacks:", commands.look


def _statement_of_change(document: UpdateDocument) -> Statement:
    """Of an update that the rule accepted."""
    sessions = document.sessions
    merged = sum(s.outcome == Outcome.ACCEPTED for s in sessions)
    runs = "The run" if len(sessions) == 1 else f"{merged} of {len(sessions)} runs"
    partly = ", ".join(
        axis
        for axis, seen in document.observability.items()
        if seen.verdict == Observability.NOT_OBSERVABLE
    )
    limits = f" Gyro {partly}: not observable, it rests on its prior." if partly else ""
    passed = f"{runs} passed every gate of the decision rule"
    if document.verdict == Outcome.PROPOSED:
        return Statement(why=f"{passed}.{limits}", use=_use_of_proposal(document))
    revision = f" as revision {document.revision}" if document.revision is not None else ""
    return Statement(
        why=f"{passed} and changed the table.{limits}",
        use=(
            f"The new table is stored{revision}; it counts once the unit has loaded it. The command"
            " that takes it back ends this page."
        ),
    )


def _use_of_proposal(document: UpdateDocument) -> str:
    """What to do with an update that no store holds, or that one keeps for review."""
    if document.proposal is None:
        return (
            "Not in use yet: nothing was stored. Read this page, then run the same command with"
            " --commit."
        )
    kept, decision = f"proposal {document.proposal}", document.decision
    if document.proposal_state is ProposalState.OUT_OF_DATE:
        return f"Not in use: another table is active by now, so {kept} cannot be approved."
    if decision is None:
        return (
            f"Not in use yet: it waits as {kept} to be approved or rejected. Read this page first."
        )
    signed = (
        f"{kept} was {document.proposal_state} by {decision.by} on {decision.decided_utc}"
        f" ({decision.reason})"
    )
    if decision.revision is None:
        return f"Not in use: {signed}. The stored table stayed as it was."
    return (
        f"The new table is stored as revision {decision.revision}: {signed}. It counts once the"
        " unit has loaded it."
    )


def _axis(document: UpdateDocument, axis: str, known: Mapping[str, TableUncertainty]) -> AxisView:
    seen = document.observability.get(axis)
    word, look = "not estimated", "none"
    if seen is not None:
        word, look = BADGES.get(seen.verdict, (str(seen.verdict), "none"))
    return AxisView(
        axis=axis,
        seen=seen,
        word=word,
        look=look,
        help=_help(document, seen),
        largest=max(_changes(document, axis), key=lambda row: abs(row.change_deg_h), default=None),
        table=known.get(axis),
    )


def _help(document: UpdateDocument, seen: AxisObservability | None) -> str:
    """What would make this gyro better known."""
    if document.verdict == Outcome.INCONSISTENT:
        return "explain the contradiction first"
    if seen is None:
        return "see the reason above"
    return seen.advice or "nothing more needed"


def _panels(document: UpdateDocument) -> dict[str, list[Panel]]:
    """Bias against temperature, a panel a gyro; of sessions without a heading also the shapes
    alone, which the levels of their power-ons would hide.
    """
    before = _table(document.table_before, "table_before")
    new = _table(document.table_after, "table_after") if _changed(document) else None
    if before is None:
        return {"bias": [], "shape": []}
    shapes: list[Panel | None] = []
    if any(s.zero_rate is not None for s in estimated_of(document)):
        shapes = [figures.shape_panel(document, axis, before, new) for axis in AXES]
    return {
        "bias": [figures.bias_panel(document, axis, before, new) for axis in AXES],
        "shape": [panel for panel in shapes if panel],
    }


def _run_key(document: UpdateDocument) -> list[tuple[int, str, str]]:
    """Number, id and colour of each run with points; empty where there is one run."""
    run_ids = document.run_ids
    drawn: set[str | None] = set()
    for axis in AXES:
        drawn |= {p.run_id for p in figures.seen_points(document, axis)}
    key = zip(count(1), run_ids, cycle(figures.SESSION_COLOURS))
    return [row for row in key if row[1] in drawn] if len(run_ids) > 1 else []


def _session(document: UpdateDocument, k: int) -> SessionView:
    session = document.sessions[k]
    spans = _spans(document, k)
    reasons: dict[str, list[float]] = {}
    for span in spans:
        reasons.setdefault(str(span.reason), []).append(span.end_s - span.start_s)
    chain = [figures.chain_panel(session, way) for way in ("north", "east")]
    residuals = {axis: figures.residual_panel(session, axis) for axis in AXES}
    return SessionView(
        run=session,
        number=k + 1,
        spans=spans,
        span_totals=[(reason, len(lengths), sum(lengths)) for reason, lengths in reasons.items()],
        timeline=figures.timeline_panels(session, spans),
        residuals=[panel for panel in residuals.values() if panel],
        unseen=[axis for axis, panel in residuals.items() if panel is None],
        coverage=figures.coverage_panel(session),
        chain=[panel for panel in chain if panel],
    )


def _spans(document: UpdateDocument, k: int) -> list[Span]:
    """What was excluded of the run, told at the first run of its id."""
    run_id = document.sessions[k].run_id
    if any(s.run_id == run_id for s in document.sessions[:k]):
        return []
    return [s for s in document.excluded if s.run_id in (None, run_id)]


def _budget(document: UpdateDocument) -> list[BudgetRow]:
    """Terms in rows, gyros in columns, each with its share of the longest bar."""
    entries = document.uncertainty_budget
    longest = max((e.sigma_deg_h for e in entries), default=1.0) or 1.0
    rows = []
    for term in dict.fromkeys(e.term for e in entries):
        found = {e.axis: e.sigma_deg_h for e in entries if e.term == term}
        cells = [(found.get(axis), 100.0 * found.get(axis, 0.0) / longest) for axis in AXES]
        rows.append(BudgetRow(term, cells))
    return rows


def _variance(document: UpdateDocument) -> VarianceView | None:
    """The shares that the document lists, the largest sources first."""
    if not document.variance_shares:
        return None
    of_mean = {v.axis: v for v in document.variance_shares if v.temperature_degC is None}
    sources = _shown_sources(document.variance_shares)
    known = {source.value: source.template for source in VarianceSource}
    rows = []
    for source, colour in zip(sources, cycle(SOURCE_COLOURS)):
        words = known.get(source, source.replace("_", " "))
        percent = [
            100.0 * of_mean[a].shares.get(source, 0.0) if a in of_mean else None for a in AXES
        ]
        rows.append(SourceRow(words, colour, percent))
    return VarianceView(
        rows=rows,
        sigma_deg_h=[of_mean[a].sigma_deg_h if a in of_mean else None for a in AXES],
        bars=[(axis, _bar(rows, k)) for k, axis in enumerate(AXES) if axis in of_mean],
        nodes={axis: _nodes(document, axis, sources) for axis in AXES},
    )


def _shown_sources(entries: Sequence[VarianceShares]) -> list[str]:
    """Sources with a share worth a line anywhere, the largest first."""
    largest: dict[str, float] = {}
    for entry in entries:
        for source, share in entry.shares.items():
            largest[source] = max(largest.get(source, 0.0), abs(share))
    shown = [source for source, share in largest.items() if share >= LEAST_DRAWN_SHARE]
    return sorted(shown, key=lambda source: -largest[source])


def _bar(rows: Sequence[SourceRow], k: int) -> list[tuple[str, str, float]]:
    """Words, colour and width [%] of the parts of gyro k's bar."""
    return [(row.words, row.colour, max(row.percent[k] or 0.0, 0.0)) for row in rows]


def _nodes(document: UpdateDocument, axis: str, sources: Sequence[str]) -> list[NodeRow]:
    found = []
    for entry in document.variance_shares:
        if entry.axis == axis and entry.temperature_degC is not None:
            percent = [100.0 * entry.shares.get(source, 0.0) for source in sources]
            found.append(NodeRow(entry.temperature_degC, entry.sigma_deg_h, percent))
    return found


def _noise(document: UpdateDocument) -> list[tuple[str, str, str]]:
    """The noise model as rows: group, key with its unit, value; how it was fitted is left out."""
    rows = []
    for group, values in (document.noise_model or {}).items():
        if group not in TWIN_SECTIONS or not isinstance(values, Mapping):
            continue
        for key, value in values.items():
            if isinstance(value, list | tuple):
                text = ", ".join(f"{v:g}" for v in value)
            else:
                text = f"{value:g}"
            rows.append((group, key, text))
    return rows


def _commands(document: UpdateDocument) -> Commands:
    """Commands that a reader may copy; texts from files are quoted for the shell."""
    store = f" --store {shlex.quote(document.store)}" if document.store else ""
    serial = f" --serial {shlex.quote(document.imu_serial)}"
    commit = " --commit" if document.verdict == Outcome.COMMITTED else ""
    used = document.thermal_model
    model = f" --thermal-model {shlex.quote(used.file)}" if used else ""
    runs = "RUN ..." if len(document.runs) > 1 else "RUN"
    return Commands(
        rollback=(
            document.rollback_command
            or f"recal table rollback{store}{serial} --to previous --by NAME --reason WHY"
        ),
        history=f"recal table list{store}{serial}",
        approve=f"recal table approve {document.proposal}{store}{serial} --reason WHY",
        reproduce=f"recal update {runs}{store}{model}{commit}",
        export=export_command(document.store, document.imu_serial),
        diagnose=f"recal diagnose {runs} --twin twin.json",
        look="recal look RUN",
    )


def _band(band: Sequence[float] | None, decimals: int) -> str:
    return f"{number(band[0], decimals)} to {number(band[1], decimals)}" if band else ""


def _nis_words(consistency: ConsistencyDocument) -> str:
    """Where the mean NIS lies, in words."""
    nis, band_95, band_999 = consistency.nis_mean, consistency.band_95, consistency.band_999
    if nis is None:
        return ""
    if band_95 and band_95[0] <= nis <= band_95[1]:
        return f"Inside its 95 % band ({_band(band_95, 2)}): the noise model describes the data."
    if band_999 and band_999[0] <= nis <= band_999[1]:
        return f"Outside its 95 % band, inside its 99.9 % band ({_band(band_999, 2)})."
    if band_999 and nis > band_999[1]:
        return (
            f"Above its 99.9 % band ({_band(band_999, 2)}): the data hold more than the noise"
            " model."
        )
    return f"Below its bands (95 %: {_band(band_95, 2)}): quieter than the noise model says."


def _temperature_words(temperature: TemperatureDocument) -> str:
    """Range per gyro, and what is wrong with the thermometers."""
    ranges = zip(temperature.min_degC, temperature.max_degC)
    faults = "; ".join(temperature.faults)
    return (
        "; ".join(f"{number(low, 1)} to {number(high, 1)}" for low, high in ranges)
        + " \u00b0C"
        + (f"; {faults}" if faults else "")
    )


def _hysteresis_words(terms: Sequence[ThermalTerm]) -> str:
    """Was a difference between heating and cooling looked for, and what was done about it?"""
    return (
        "; ".join(term.text for term in terms) + "." if terms else "not tested: no run was merged."
    )
