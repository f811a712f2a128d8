"""Everything that is read: units, one unit, differences, proposals, diagnosis reports."""

import json
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, HTTPException, Query
from fastapi.responses import HTMLResponse, Response

from ins.records import InputError
from recal.service.priors.forecast_page import date_words, trend_strips
from recal.service.results.pages import (
    JsonObject,
    diagnosis_lines,
    script_texts,
    stored_update_html,
)
from recal.service.store import FullProposal, Revision, TableStore, UnitKey
from recal.service.tables import proposed_document
from recal.web import views
from recal.web.drawings import TableLine
from recal.web.reports import DOCUMENT, PAGE
from recal.web.site import SCRIPT_PATH, ReaderVisit, ReviewSite, framed
from recal.web.views import Show, UnitHealth

LINE_WORDS = {
    "factory": "factory table",
    "previous": "previous table, U(k=2) band",
    "active": "active table, U(k=2) band",
}
A_DAY = "private, max-age=86400"  # a script under its hash

Sort = Literal[
    "next", "serial", "technology", "changed", "proposals", "contradictions", "age", "drift"
]
State = Literal[
    "open", "out of date", "approved", "rejected", "all"
]  # of proposals that are listed
Number = Annotated[int, Query(ge=1, le=10**9)]
SORTS: dict[Sort, Callable[[UnitHealth], Any]] = {
    "next": views.urgency,
    "serial": lambda row: row.unit.unit,
    "technology": lambda row: row.unit.unit.gyro_technology,
    "changed": lambda row: row.unit.created_utc,
    "proposals": lambda row: row.unit.undecided,
    "contradictions": lambda row: row.unit.contradictions,
    "age": lambda row: row.age_days,
    "drift": lambda row: row.drift_nm_h,
}
PAGE_ROWS = 200
SHOWS = {
    Show.ALL: "all units",
    Show.NEXT: "those that need something",
    Show.WAITING: "those with a proposed update",
    Show.NO_TWIN: "those without a noise model of their own",
}
MOST_SHOWN = 500  # rows of a history


router = APIRouter()
Reader = Annotated[ReaderVisit, Depends()]


def asked_unit(serial: str, technology: str, mode: str = "") -> UnitKey:
    """The unit that an address names."""
    return UnitKey(imu_serial=serial, gyro_technology=technology, gyro_mode=mode)


Unit = Annotated[UnitKey, Depends(asked_unit)]


@router.get("/")
def units(
    reader: Reader,
    q: str = "",
    show: Show = Show.ALL,
    sort: Sort = "next",
    down: bool = False,
    page: Number = 1,
) -> HTMLResponse:
    with reader.site.tables() as opened:
        everything = opened.overview()
        forecast = reader.site.forecasts.at_hand(opened)
    wanted = q.casefold().strip()
    listed = [u for u in everything if wanted in f"{u.unit} {u.sha256}".casefold()]
    found = views.chosen(views.unit_health(listed, forecast, datetime.now(UTC)), show)
    found.sort(key=SORTS["serial"])
    found.sort(key=SORTS[sort], reverse=down)
    last = max(1, -(-len(found) // PAGE_ROWS))
    page = min(page, last)
    return reader.page(
        "units.html.j2",
        units=found[(page - 1) * PAGE_ROWS : page * PAGE_ROWS],
        found=len(found),
        of=len(everything),
        q=q,
        show=show,
        shows=SHOWS,
        sort=sort,
        down=down,
        page=page,
        last=last,
        limit_nm_h=None if forecast is None else forecast.limit_nm_h,
    )


@router.get("/unit")
def unit(reader: Reader, asked: Unit, done: str = "") -> HTMLResponse:
    with reader.site.tables() as opened:
        summary = [u for u in opened.overview() if u.unit == asked]
        only_proposed = any(not u.active_number for u in summary)
        history = [] if only_proposed else opened.history(*asked.key)
        proposals = opened.proposals(*asked.key)
        contradictions = opened.contradictions(*asked.key) if history else ()
        forecast = reader.site.forecasts.at_hand(opened)
    active = history[-1] if history else None
    lines = _lines(history)
    return reader.page(
        "unit.html.j2",
        unit=(history or proposals)[-1].unit,
        active=active,
        drawn=reader.site.drawings.bias_panels(lines, contradictions) if lines else "",
        rows=views.table_rows(active.table) if active else None,
        contradictions=views.contradiction_rows(contradictions, active.table) if active else [],
        history=history[::-1][:MOST_SHOWN],
        proposals=proposals[::-1],
        done=done,
        state=views.unit_health(summary, forecast, datetime.now(UTC))[0].words,
        diagnoses=[
            e for e in reader.site.reports.all() if e.document.get("imu_serial") == asked.imu_serial
        ],
    )


@router.get(SCRIPT_PATH)
def figures_script() -> Response:
    headers = {"cache-control": A_DAY}
    return Response("\n".join(script_texts()), 200, headers, "text/javascript")


@router.get("/forecast")
def forecast(reader: Reader) -> HTMLResponse:
    site = reader.site
    with site.tables() as opened:
        key, document = site.forecasts.of(opened)
    return reader.page(
        "urgent.html.j2",
        f=document,
        shown=len(document.units),
        trends=trend_strips(document),
        date_words=date_words,
        unit_page=partial(views.address, "/unit"),
        drawn=site.drawings.trend(key, document) if document.units else "",
    )


@router.get("/diff")
def diff(reader: Reader, asked: Unit, before: Number = 1, after: Number = 1) -> HTMLResponse:
    with reader.site.tables() as opened:
        old = opened.revision(before, *asked.key)
        new = opened.revision(after, *asked.key)
    lines = [
        TableLine(name, of.sha256, of.table, f"revision {of.number}, U(k=2) band")
        for name, of in (("before", old), ("after", new))
    ]
    return reader.page(
        "diff.html.j2",
        unit=new.unit,
        before=old,
        after=new,
        change=views.change_rows(old, new),
        drawn=reader.site.drawings.bias_panels(lines),
        made_from=views.provenance_change(old, new),
    )


@router.get("/revision/report")
def revision_report(reader: Reader, asked: Unit, number: Number) -> HTMLResponse:
    with reader.site.tables() as opened:
        found = opened.revision(number, *asked.key)
    if found.report_json is None:
        raise HTTPException(404, f"Revision {number} was made without a report.")
    document = {**json.loads(found.report_json), "revision": number}
    return framed(_drawn(reader.site, f"{found.sha256} revision {number}", document))


@router.get("/proposals")
def proposals(reader: Reader, state: State = "open") -> HTMLResponse:
    with reader.site.tables() as opened:
        everything = opened.proposals()
    chosen = [p for p in reversed(everything) if state in ("all", p.state)]
    chosen.sort(key=lambda p: p.proposed_utc, reverse=True)
    return reader.page(
        "proposals.html.j2",
        state=state,
        counts={name: sum(p.state == name for p in everything) for name in views.STATE_LOOKS},
        proposals=chosen[:MOST_SHOWN],
    )


@router.get("/proposal")
def proposal(reader: Reader, asked: Unit, number: Number) -> HTMLResponse:
    with reader.site.tables() as opened:
        full = opened.proposal(number, *asked.key)
        base = _base(opened, full)
    return reader.page(
        "proposal.html.j2",
        p=full,
        unit=full.unit,
        report=full.report,
        base=base,
        change=views.change_rows(base, full) if base else None,
        drawn=reader.site.drawings.bias_panels(_proposed(base, full)) if base else "",
    )


@router.get("/proposal/report")
def proposal_report(reader: Reader, asked: Unit, number: Number) -> HTMLResponse:
    with reader.site.tables() as opened:
        full = opened.proposal(number, *asked.key)
    key = f"{full.record_sha256} {full.state}"
    return framed(_drawn(reader.site, key, proposed_document(full)))


@router.get("/proposal/update.json")
def proposal_document(reader: Reader, asked: Unit, number: Number) -> Response:
    with reader.site.tables() as opened:
        full = opened.proposal(number, *asked.key)
    return reader.download(full.report_json, "update.json")


@router.get("/diagnoses")
def diagnoses(reader: Reader) -> HTMLResponse:
    return reader.page("diagnoses.html.j2", entries=reader.site.reports.all())


@router.get("/diagnosis")
def diagnosis(reader: Reader, folder: str) -> HTMLResponse:
    entry = reader.site.reports.one(folder)
    if entry is None:
        raise HTTPException(404, "There is no diagnosis in this folder.")
    return reader.page("diagnosis.html.j2", e=entry, summary=_summary(entry.document))


@router.get("/diagnosis/page")
def diagnosis_page(reader: Reader, folder: str) -> HTMLResponse:
    return framed(_report(reader.site, folder, PAGE))


@router.get("/diagnosis/document")
def diagnosis_document(reader: Reader, folder: str) -> Response:
    return reader.download(_report(reader.site, folder, DOCUMENT), DOCUMENT)


def _report(site: ReviewSite, folder: str, name: str) -> str:
    """The text of a file of a diagnosis."""
    text = site.reports.text(folder, name)
    if text is None:
        raise HTTPException(404, f"There is no {name} in this folder.")
    return text


def _lines(history: list[Revision]) -> list[TableLine]:
    """Factory, previous and active table, each once."""
    if not history:
        return []
    factory, active = history[0], history[-1]
    chosen = [("factory", factory)] if factory.sha256 != active.sha256 else []
    if len(history) > 1 and history[-2].sha256 not in (factory.sha256, active.sha256):
        chosen.append(("previous", history[-2]))
    return [
        TableLine(name, r.sha256, r.table, LINE_WORDS[name])
        for name, r in [*chosen, ("active", active)]
    ]


def _proposed(base: Revision, full: FullProposal) -> list[TableLine]:
    """The table that a proposal was made from, and the proposed one."""
    now = "table now" if full.state == "open" else f"revision {base.number}"
    return [
        TableLine("before", base.sha256, base.table, f"{now}, U(k=2) band"),
        TableLine("after", full.sha256, full.table, "proposed table, U(k=2) band"),
    ]


def _base(opened: TableStore, full: FullProposal) -> Revision | None:
    """The table that a proposal was made from, None where it is its technology's default and not
    stored yet.
    """
    try:
        return opened.by_sha256(full.parent_sha256)
    except InputError:
        if full.first_table_json is None:
            raise
        return None


def _drawn(site: ReviewSite, key: str, document: JsonObject) -> str:
    """The report of a stored document; a Refused page where this version cannot draw it."""
    try:
        return site.drawings.page(key, lambda: stored_update_html(document))
    except Exception as error:  # whatever an old or damaged document makes of the template
        line = (
            f"This version cannot draw the stored report ({type(error).__name__}); its update.json"
            " is whole."
        )
        raise HTTPException(409, line) from error


def _summary(document: JsonObject) -> list[str]:
    try:
        return diagnosis_lines(document) if document else []
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        return [f"This version cannot read the document ({type(error).__name__})."]
