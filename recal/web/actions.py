"""Everything that is written: sign in and out, approve or reject a proposal, roll a table back.
Every form is checked.
"""

import secrets
from urllib.parse import parse_qs, urlsplit

from fastapi import FastAPI, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from ins.records import InputError
from recal.service.tables import change_between
from recal.web import views
from recal.web.door import SESSION_S, Session, same
from recal.web.guard import BODY, Refused
from recal.web.pages import Number
from recal.web.site import SignInFirst, Site

MAX_FIELDS = 12
OTHER_PAGE = (
    "The form is not the one that this page gave you, or it is older than your session. Open the"
    " page again."
)
USED_LINK = (
    "This link was used already, or is older than 10 minutes. Sign in with the token that recal"
    " serve printed, or start it again."
)
VERDICTS = ("approved", "rejected")


def register(app: FastAPI, site: Site) -> None:
    """All routes that write, and the pages with their forms."""
    _register_door(app, site)
    _register_decisions(app, site)


def _register_door(app: FastAPI, site: Site) -> None:
    @app.get("/signin")
    def sign_in_page(request: Request, next: str = "/") -> HTMLResponse:
        return _sign_in_page(site, request, next)

    @app.post("/signin")
    def sign_in(request: Request) -> Response:
        form = form_of(request)
        cookie = request.cookies.get(site.form_cookie, "")
        if not cookie or not same(site.door.form_token(cookie), form.get("form_token", "")):
            raise Refused(403, OTHER_PAGE + " Cookies must be allowed.")
        peer = request.client.host if request.client else ""
        session_id = site.door.sign_in(form.get("token", ""), peer)
        if session_id is None:
            return _sign_in_page(site, request, form.get("next", "/"), wrong=True)
        answer = RedirectResponse(local_path(form.get("next", "/")), 303)
        _set_cookie(site, answer, site.session_cookie, session_id, round(SESSION_S))
        answer.delete_cookie(
            site.form_cookie, path="/", secure=site.settings.https, httponly=True, samesite="strict"
        )
        return answer

    @app.get("/login")
    def sign_in_once(request: Request, ticket: str = "") -> Response:
        session_id = site.door.sign_in_once(ticket)
        if session_id is None and site.session(request) is not None:
            return RedirectResponse("/", 303)  # clicked again by a browser that is signed in
        if session_id is None:
            raise Refused(403, USED_LINK)
        answer = RedirectResponse("/", 303)
        _set_cookie(site, answer, site.session_cookie, session_id, round(SESSION_S))
        return answer

    @app.post("/signout")
    def sign_out(request: Request) -> Response:
        _require_form(site, request)
        site.door.sign_out(request.cookies.get(site.session_cookie, ""))
        answer = RedirectResponse("/", 303)
        answer.delete_cookie(
            site.session_cookie,
            path="/",
            secure=site.settings.https,
            httponly=True,
            samesite="strict",
        )
        return answer


def _register_decisions(app: FastAPI, site: Site) -> None:
    @app.post("/decide")
    def decide(request: Request) -> Response:
        session, form = _require_form(site, request)
        verdict, key = form.get("verdict", ""), _unit(form)
        if verdict not in VERDICTS:
            raise Refused(400, "verdict: needed approved or rejected")
        with site.tables() as opened:
            done = opened.decide(
                _number(form, "number"),
                verdict,
                *key,
                by=session.name or form.get("by", ""),
                reason=form.get("reason", ""),
            )
        return RedirectResponse(views.address("/unit", done.unit, done=verdict), 303)

    @app.get("/rollback")
    def confirm_rollback(
        request: Request, serial: str, technology: str, to: Number, mode: str = ""
    ) -> HTMLResponse:
        if site.require_reader(request) is None:
            raise SignInFirst(
                views.address("/rollback", serial=serial, technology=technology, to=to, mode=mode)
            )
        with site.tables() as opened:
            active = opened.active(serial, technology, mode)
            target = opened.revision(to, serial, technology, mode)
        change = views.change_rows({axis: change_between(active, target, axis) for axis in "xyz"})
        return site.page(
            request,
            "rollback.html.j2",
            unit=active.unit,
            active=active,
            target=target,
            change=change,
            made_from=views.provenance_change(active, target),
        )

    @app.post("/rollback")
    def rollback(request: Request) -> Response:
        session, form = _require_form(site, request)
        serial, technology, mode = _unit(form)
        with site.tables() as opened:
            done = opened.rollback(
                serial,
                _number(form, "to"),
                technology,
                mode,
                by=session.name or form.get("by", ""),
                reason=form.get("reason", ""),
                active_number=_number(form, "active"),
            )
        return RedirectResponse(views.address("/unit", done.unit, done="rolled back"), 303)


def form_of(request: Request) -> dict[str, str]:
    """The fields of the form that the guard has read; Refused where they are no form."""
    try:
        fields = parse_qs(
            request.scope[BODY].decode("ascii"),
            keep_blank_values=True,
            errors="strict",
            max_num_fields=MAX_FIELDS,
        )
    except ValueError:
        raise Refused(400, "The form cannot be read.") from None
    if any(len(values) > 1 for values in fields.values()):
        raise Refused(400, "The form holds a field twice.")
    return {name: values[0] for name, values in fields.items()}


def local_path(path: str) -> str:
    """A path on this site to go on to, "/" where it would lead elsewhere."""
    parts = urlsplit(path)
    wrong = (
        parts.scheme
        or parts.netloc
        or not path.startswith("/")
        or path.startswith("//")
        or "\\" in path
    )
    return "/" if wrong or not path.isascii() or not path.isprintable() else path


def _require_form(site: Site, request: Request) -> tuple[Session, dict[str, str]]:
    """The session and its form; Refused where one of them is not right."""
    if site.door.locked:
        raise Refused(403, "The server was started without a token: nothing can be written here.")
    session, form = site.session(request), form_of(request)
    if session is None:
        raise Refused(
            403, "You are not signed in, or your session is over. Sign in and send the form again."
        )
    if not same(session.form_token, form.get("form_token", "")):
        raise Refused(403, OTHER_PAGE)
    return session, form


def _sign_in_page(site: Site, request: Request, path: str, *, wrong: bool = False) -> HTMLResponse:
    cookie = request.cookies.get(site.form_cookie, "") or secrets.token_urlsafe(32)
    answer = site.page(
        request,
        "signin.html.j2",
        403 if wrong else 200,
        next=local_path(path),
        wrong=wrong,
        form_token=site.door.form_token(cookie),
    )
    _set_cookie(site, answer, site.form_cookie, cookie, 3600)
    return answer


def _set_cookie(site: Site, answer: Response, name: str, value: str, seconds: int) -> None:
    answer.set_cookie(
        name,
        value,
        max_age=seconds,
        path="/",
        httponly=True,
        samesite="strict",
        secure=site.settings.https,
    )


def _unit(form: dict[str, str]) -> tuple[str, str, str]:
    if not form.get("serial") or not form.get("technology"):
        raise InputError("serial and technology: needed, to name the unit")
    return form["serial"], form["technology"], form.get("mode", "")


def _number(form: dict[str, str], name: str) -> int:
    text = form.get(name, "")
    if not (text.isascii() and text.isdecimal() and len(text) < 10):
        raise InputError(f"{name}: got {text[:20]!r}, needed a whole number")
    return int(text)
