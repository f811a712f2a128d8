"""Everything that is read: units, one unit, differences, proposals, diagnosis reports."""

import json
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

from fastapi import FastAPI, Query, Request
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
from recal.service.tables import change_between
from recal.web import health, views
from recal.web.drawings import Line
from recal.web.guard import Refused
from recal.web.health import Show, UnitHealth
from recal.web.reports import DOCUMENT, PAGE
from recal.web.site import SCRIPT_PATH, Site

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
HEALTH_SORTS: dict[str, Callable[[UnitHealth], Any]] = {
    "next": health.urgency,
    "age": lambda row: row.age_days,
    "drift": lambda row: row.drift_nm_h,
}
SHOWS = {
    Show.ALL: "all units",
    Show.NEXT: "those that need something",
    Show.WAITING: "those with a proposed update",
    Show.NO_TWIN: "those without a noise model of their own",
}
MOST_SHOWN = 500  # rows of a history


def register(app: FastAPI, site: Site) -> None:
    """All routes that only read."""
    _register_script(app)
    _register_units(app, site)
    _register_forecast(app, site)
    _register_revisions(app, site)
    _register_proposals(app, site)
    _register_proposal_texts(app, site)
    _register_reports(app, site)


def _register_units(app: FastAPI, site: Site) -> None:
    @app.get("/")
    def units(
        request: Request,
        q: str = "",
        show: Show = Show.ALL,
        sort: Sort = "next",
        down: bool = False,
        page: Number = 1,
    ) -> HTMLResponse:
        site.require_reader(request)
        with site.tables() as opened:
            everything = opened.overview()
            forecast = site.forecasts.at_hand(opened)
        by_store = sort if sort in views.SORTS else "serial"
        listed = views.sorted_units(everything, search=q, sort=by_store, descending=down)
        found = health.chosen(health.judged(listed, forecast, datetime.now(UTC)), show)
        if sort in HEALTH_SORTS:
            found.sort(key=HEALTH_SORTS[sort], reverse=down)
        last = max(1, -(-len(found) // views.PAGE_ROWS))
        page = min(page, last)
        shown = found[(page - 1) * views.PAGE_ROWS : page * views.PAGE_ROWS]
        return site.page(
            request,
            "units.html.j2",
            units=shown,
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
            undecided=sum(u.undecided for u in everything),
        )

    @app.get("/unit")
    def unit(
        request: Request, serial: str, technology: str, mode: str = "", done: str = ""
    ) -> HTMLResponse:
        site.require_reader(request)
        key = (serial, technology, mode)
        named = UnitKey(imu_serial=serial, gyro_technology=technology, gyro_mode=mode)
        with site.tables() as opened:
            summary = [u for u in opened.overview() if u.unit == named]
            only_proposed = any(not u.active_number for u in summary)
            history = [] if only_proposed else opened.history(*key)
            proposals = opened.proposals(*key)
            contradictions = opened.contradictions(*key) if history else ()
            forecast = site.forecasts.at_hand(opened)
        context: dict[str, Any] = {"active": None, "drawn": "", "contradictions": [], "rows": None}
        if history:
            lines = _lines(history)
            active = history[-1]
            context = {
                "active": active,
                "drawn": site.drawings.bias_panels(lines, contradictions),
                "rows": views.table_rows(active.table),
                "contradictions": views.contradiction_rows(contradictions, active.table),
            }
        diagnoses = [e for e in site.reports.all() if e.document.get("imu_serial") == serial]
        return site.page(
            request,
            "unit.html.j2",
            unit=(history or proposals)[-1].unit,
            history=history[::-1][:MOST_SHOWN],
            proposals=[views.proposal_facts(p) for p in reversed(proposals)],
            done=done,
            state=health.judged(summary, forecast, datetime.now(UTC))[0].words,
            diagnoses=diagnoses,
            **context,
        )


def _register_script(app: FastAPI) -> None:
    @app.get(SCRIPT_PATH)
    def figures_script() -> Response:
        headers = {"cache-control": A_DAY}
        return Response("\n".join(script_texts()), 200, headers, "text/javascript")


def _register_forecast(app: FastAPI, site: Site) -> None:
    @app.get("/forecast")
    def forecast(request: Request) -> HTMLResponse:
        site.require_reader(request)
        with site.tables() as opened:
            key, document = site.forecasts.of(opened)
        return site.page(
            request,
            "urgent.html.j2",
            f=document,
            shown=len(document.units),
            trends=trend_strips(document),
            date_words=date_words,
            unit_page=views.forecast_address,
            drawn=site.drawings.trend(key, document) if document.units else "",
        )


def _register_revisions(app: FastAPI, site: Site) -> None:
    @app.get("/diff")
    def diff(
        request: Request,
        serial: str,
        technology: str,
        mode: str = "",
        before: Number = 1,
        after: Number = 1,
    ) -> HTMLResponse:
        site.require_reader(request)
        with site.tables() as opened:
            old, new = (opened.revision(k, serial, technology, mode) for k in (before, after))
        lines = [
            Line(name, of.sha256, of.table, f"revision {of.number}, U(k=2) band")
            for name, of in (("before", old), ("after", new))
        ]
        return site.page(
            request,
            "diff.html.j2",
            unit=new.unit,
            before=old,
            after=new,
            change=_change(old, new),
            drawn=site.drawings.bias_panels(lines),
            made_from=views.provenance_change(old, new),
        )

    @app.get("/revision/report")
    def revision_report(
        request: Request, serial: str, technology: str, number: Number, mode: str = ""
    ) -> HTMLResponse:
        site.require_reader(request)
        with site.tables() as opened:
            found = opened.revision(number, serial, technology, mode)
        if found.report_json is None:
            raise Refused(404, f"Revision {number} was made without a report.")
        document = {**json.loads(found.report_json), "revision": number}
        return site.framed(_drawn(site, f"{found.sha256} revision {number}", document))


def _register_proposals(app: FastAPI, site: Site) -> None:
    @app.get("/proposals")
    def proposals(request: Request, state: State = "open") -> HTMLResponse:
        site.require_reader(request)
        with site.tables() as opened:
            everything = opened.proposals()
        counts = {name: sum(p.state == name for p in everything) for name in views.STATE_LOOKS}
        chosen = [p for p in reversed(everything) if state in ("all", p.state)]
        chosen.sort(key=lambda p: p.proposed_utc, reverse=True)
        return site.page(
            request,
            "proposals.html.j2",
            state=state,
            counts=counts,
            proposals=[views.proposal_facts(p) for p in chosen[:MOST_SHOWN]],
        )

    @app.get("/proposal")
    def proposal(
        request: Request, serial: str, technology: str, number: Number, mode: str = ""
    ) -> HTMLResponse:
        site.require_reader(request)
        with site.tables() as opened:
            full = opened.proposal(number, serial, technology, mode)
            base = _base(opened, full)
        change = None if base is None else _change(base, full)
        return site.page(
            request,
            "proposal.html.j2",
            p=full,
            unit=full.unit,
            report=full.report,
            base=base,
            change=change,
            drawn="" if base is None else site.drawings.bias_panels(_proposed(base, full)),
            look=views.STATE_LOOKS[full.state],
        )


def _register_proposal_texts(app: FastAPI, site: Site) -> None:
    @app.get("/proposal/report")
    def proposal_report(
        request: Request, serial: str, technology: str, number: Number, mode: str = ""
    ) -> HTMLResponse:
        site.require_reader(request)
        with site.tables() as opened:
            full = opened.proposal(number, serial, technology, mode)
        return site.framed(_drawn(site, full.record_sha256, {**full.report, "proposal": number}))

    @app.get("/proposal/update.json")
    def proposal_document(
        request: Request, serial: str, technology: str, number: Number, mode: str = ""
    ) -> Response:
        site.require_reader(request)
        with site.tables() as opened:
            full = opened.proposal(number, serial, technology, mode)
        return _download(full.report_json, "update.json")


def _register_reports(app: FastAPI, site: Site) -> None:
    @app.get("/diagnoses")
    def diagnoses(request: Request) -> HTMLResponse:
        site.require_reader(request)
        return site.page(request, "diagnoses.html.j2", entries=site.reports.all())

    @app.get("/diagnosis")
    def diagnosis(request: Request, folder: str) -> HTMLResponse:
        site.require_reader(request)
        entry = site.reports.one(folder)
        if entry is None:
            raise Refused(404, "There is no diagnosis in this folder.")
        return site.page(request, "diagnosis.html.j2", e=entry, summary=_summary(entry.document))

    @app.get("/diagnosis/page")
    def diagnosis_page(request: Request, folder: str) -> HTMLResponse:
        site.require_reader(request)
        text = site.reports.text(folder, PAGE)
        if text is None:
            raise Refused(404, "There is no diagnosis.html in this folder.")
        return site.framed(text)

    @app.get("/diagnosis/document")
    def diagnosis_document(request: Request, folder: str) -> Response:
        site.require_reader(request)
        text = site.reports.text(folder, DOCUMENT)
        if text is None:
            raise Refused(404, "There is no diagnosis.json in this folder.")
        return _download(text, DOCUMENT)


def _lines(history: list[Revision]) -> list[Line]:
    """Factory, previous and active table, each once."""
    factory, active = history[0], history[-1]
    chosen = [("factory", factory)] if factory.sha256 != active.sha256 else []
    if len(history) > 1 and history[-2].sha256 not in (factory.sha256, active.sha256):
        chosen.append(("previous", history[-2]))
    return [
        Line(name, r.sha256, r.table, LINE_WORDS[name]) for name, r in [*chosen, ("active", active)]
    ]


def _proposed(base: Revision, full: FullProposal) -> list[Line]:
    """The table that a proposal was made from, and the proposed one."""
    now = "table now" if full.state == "open" else f"revision {base.number}"
    return [
        Line("before", base.sha256, base.table, f"{now}, U(k=2) band"),
        Line("after", full.sha256, full.table, "proposed table, U(k=2) band"),
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


def _change(before: Revision, after: Revision | FullProposal) -> views.ChangeRows:
    return views.change_rows({axis: change_between(before, after, axis) for axis in "xyz"})


def _drawn(site: Site, key: str, document: JsonObject) -> str:
    """The report of a stored document; a Refused page where this version cannot draw it."""
    try:
        return site.drawings.page(key, lambda: stored_update_html(document))
    except Exception as error:  # whatever an old or damaged document makes of the template
        line = (
            f"This version cannot draw the stored report ({type(error).__name__}); its update.json"
            " is whole."
        )
        raise Refused(409, line) from error


def _summary(document: JsonObject) -> list[str]:
    try:
        return diagnosis_lines(document) if document else []
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        return [f"This version cannot read the document ({type(error).__name__})."]


def _download(text: str, name: str) -> Response:
    disposition = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(text, media_type="application/json", headers=disposition)
