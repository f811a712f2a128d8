"""The application: settings, door, drawings and reports together, each fault a page of one line, no
trace, no password.
"""

import base64
import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any
from urllib.parse import quote

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from jinja2 import ChoiceLoader, Environment, PackageLoader
from markupsafe import Markup
from starlette.exceptions import HTTPException

from infield.reports import page as report_page
from infield.store.errors import StoreError, StoreRefused, UnknownUnit
from infield.store.table_store import TableStore
from ins.records import InputError
from recal.web import views
from recal.web.door import Door, Session, TooManyGuesses
from recal.web.drawings import Drawings
from recal.web.guard import Guard, Refused
from recal.web.reports import Reports
from recal.web.settings import ServeSettings

TITLES = {
    400: "This cannot be done",
    403: "Not allowed",
    404: "Not found",
    405: "Not served",
    408: "Too slow",
    409: "Refused",
    413: "Too large",
    415: "Not a form",
    421: "Unknown address",
    429: "Too many wrong tokens",
    500: "A fault of the program",
    503: "The store cannot be read",
}
FRAMED_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self';"
    " base-uri 'none'; form-action 'none'"
)
NO_FAULT = (
    "The program met a case it does not know. Nothing was changed; the server's log says more."
)


class SignInFirst(Exception):
    """Whoever asks is not signed in; `path`: where to go afterwards."""

    def __init__(self, path: str = "/") -> None:
        super().__init__(path)
        self.path = path


class Site:
    """What the routes share."""

    def __init__(self, settings: ServeSettings) -> None:
        self.settings = settings
        self.door, self.drawings, self.reports = (
            Door(settings.tokens),
            Drawings(),
            Reports(settings.reports),
        )
        prefix = "__Host-" if settings.https else ""
        self.session_cookie, self.form_cookie = f"{prefix}recal_session", f"{prefix}recal_form"
        with self.tables() as opened:
            self.store_name = opened.name

    @contextmanager
    def tables(self) -> Iterator[TableStore]:
        """The store, opened for one request: a server that went away, or a file put in its place,
        is met at the next.
        """
        with TableStore.open(self.settings.store_url) as opened:
            yield opened

    def session(self, request: Request) -> Session | None:
        return self.door.session(request.cookies.get(self.session_cookie, ""))

    def require_reader(self, request: Request) -> Session | None:
        """The session, None on this machine; SignInFirst where reading needs one."""
        session = self.session(request)
        if session is None and self.settings.reading_needs_token:
            query = f"?{request.url.query}" if request.url.query else ""
            raise SignInFirst(quote(request.url.path) + query)
        return session

    def page(
        self, request: Request | None, template: str, status: int = 200, **context: Any
    ) -> HTMLResponse:
        """A page under the strict policy: no script, no style but its own, nothing from
        elsewhere.
        """
        session = None if request is None else self.session(request)
        text = (
            _environment()
            .get_template(template)
            .render(
                style=_style(),
                session=session,
                locked=self.door.locked,
                has_reports=self.reports.given,
                address=views.address,
                **context,
            )
        )
        return HTMLResponse(text, status, headers={"content-security-policy": _policy()})

    def fault(self, status: int, line: str, request: Request | None = None) -> HTMLResponse:
        """A page that says what is wrong; the store's address is not in it."""
        line = line.replace(f"store {self.store_name}", "the store").replace(
            self.store_name, "the store"
        )
        return self.page(
            request, "fault.html.j2", status, title=TITLES.get(status, f"Error {status}"), line=line
        )

    def framed(self, text: str) -> HTMLResponse:
        """A report that was drawn elsewhere: alone in a sandbox, without scripts, forms or an
        origin.
        """
        return HTMLResponse(
            text,
            headers={"content-security-policy": FRAMED_POLICY, "x-frame-options": "SAMEORIGIN"},
        )


def build_app(settings: ServeSettings) -> Guard:
    """The application as uvicorn takes it. InputError where store or reports cannot be opened."""
    from recal.web import actions, pages

    site = Site(settings)
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, title="recal")
    pages.register(app, site)
    actions.register(app, site)
    _register_faults(app, site)

    def refused(status: int, line: str) -> tuple[int, list[tuple[bytes, bytes]], bytes]:
        answer = site.fault(status, line)
        return answer.status_code, answer.raw_headers, bytes(answer.body)

    return Guard(app, settings, refused)


def _register_faults(app: FastAPI, site: Site) -> None:
    """Each kind of fault and its page."""

    def known(request: Request, error: Exception) -> Response:
        return site.fault(_status(error), str(error), request)

    def of_http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        line = "There is no page here." if error.status_code == 404 else str(error.detail)
        return site.fault(error.status_code, line, request)

    def of_query(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        said = "; ".join(f"{fault['loc'][-1]}: {fault['msg']}" for fault in error.errors())
        return site.fault(400, said, request)

    def too_many(request: Request, error: Exception) -> Response:
        assert isinstance(error, TooManyGuesses)
        answer = site.fault(429, str(error), request)
        answer.headers["retry-after"] = str(error.seconds)
        return answer

    def sign_in(request: Request, error: Exception) -> Response:
        assert isinstance(error, SignInFirst)
        return RedirectResponse(views.address("/signin", next=error.path), 303)

    def unknown(request: Request, error: Exception) -> Response:
        return site.fault(500, NO_FAULT, request)

    for kind in (InputError, StoreRefused, Refused):
        app.add_exception_handler(kind, known)
    app.add_exception_handler(HTTPException, of_http)
    app.add_exception_handler(RequestValidationError, of_query)
    app.add_exception_handler(TooManyGuesses, too_many)
    app.add_exception_handler(SignInFirst, sign_in)
    app.add_exception_handler(Exception, unknown)


def _status(error: Exception) -> int:
    if isinstance(error, Refused):
        return error.status
    if isinstance(error, UnknownUnit):
        return 404
    if isinstance(error, StoreError):
        return 503
    if isinstance(error, InputError):
        return 400
    return 409


@lru_cache(maxsize=1)
def _environment() -> Environment:
    shared = report_page._environment()
    assert shared.loader is not None
    return shared.overlay(
        loader=ChoiceLoader([PackageLoader("recal", "web/templates"), shared.loader])
    )


@lru_cache(maxsize=1)
def _style() -> Markup:
    """The style sheet of the reports with what the page adds."""
    found = _environment()
    return Markup(found.get_template("style.css").render() + found.get_template("web.css").render())


@lru_cache(maxsize=1)
def _policy() -> str:
    digest = base64.b64encode(hashlib.sha256(_style().encode()).digest()).decode()
    return (
        f"default-src 'none'; style-src 'sha256-{digest}'; img-src data:; form-action 'self';"
        " frame-src 'self'; frame-ancestors 'none'; base-uri 'none'"
    )
