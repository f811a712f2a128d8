"""What the routes share: settings, door, drawings and reports together, and how a page is made."""

import base64
import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any
from urllib.parse import quote

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import ChoiceLoader, Environment, PackageLoader
from markupsafe import Markup

from recal.service.results.pages import page_environment, script_texts
from recal.service.store import TableStore
from recal.web import views
from recal.web.door import Door, Session
from recal.web.drawings import Drawings
from recal.web.forecasts import Forecasts
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
NEXT = {
    503: Markup(
        "On the machine that holds the store, <code>recal table verify --store STORE</code> says"
        " what is wrong with it."
    )
}
SCRIPT_PATH = "/figures.js"


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
            Door(settings.tokens, ticket=settings.ticket),
            Drawings(),
            Reports(settings.reports),
        )
        self.forecasts = Forecasts()
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
        """A page under the strict policy: no script but that of its figures, no style but its
        own, nothing from elsewhere.
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
                figures_script=_script_address(),
                **context,
            )
        )
        policy = _policy(drawn="<script src=" in text)
        return HTMLResponse(text, status, headers={"content-security-policy": policy})

    def fault(self, status: int, line: str, request: Request | None = None) -> HTMLResponse:
        """A page that says what is wrong; the store's address is not in it."""
        for text, shown in (
            (f"no store at {self.store_name}", "the store is not where it was"),
            (f"store {self.store_name}", "the store"),
            (self.store_name, "the store"),
        ):
            line = line.replace(text, shown)
        return self.page(
            request,
            "fault.html.j2",
            status,
            title=TITLES.get(status, f"Error {status}"),
            line=line,
            next=NEXT.get(status, ""),
            sign_in=status == 403,
        )

    def framed(self, text: str) -> HTMLResponse:
        """A report that was drawn elsewhere: alone in a sandbox, without forms or an origin; of
        scripts only those of this version's figures run.
        """
        return HTMLResponse(
            text,
            headers={"content-security-policy": _framed_policy(), "x-frame-options": "SAMEORIGIN"},
        )


@lru_cache(maxsize=1)
def _environment() -> Environment:
    shared = page_environment()
    assert shared.loader is not None
    return shared.overlay(
        loader=ChoiceLoader([PackageLoader("recal", "web/templates"), shared.loader])
    )


@lru_cache(maxsize=1)
def _style() -> Markup:
    """The style sheet of the reports with what the page adds."""
    found = _environment()
    return Markup(found.get_template("style.css").render() + found.get_template("web.css").render())


@lru_cache(maxsize=2)
def _policy(*, drawn: bool) -> str:
    """Of a page; `drawn`: with figures, so with the script that draws them and saves pictures."""
    style = _source(hashlib.sha256(_style().encode()).digest())
    more = "img-src data: blob:; script-src 'self'" if drawn else "img-src data:"
    return (
        f"default-src 'none'; style-src {style}; {more}; form-action 'self';"
        " frame-src 'self'; frame-ancestors 'none'; base-uri 'none'"
    )


@lru_cache(maxsize=1)
def _framed_policy() -> str:
    scripts = " ".join(map(_source, _digests()))
    return (
        f"sandbox allow-scripts allow-downloads; default-src 'none'; script-src {scripts};"
        " style-src 'unsafe-inline'; img-src data: blob:; frame-ancestors 'self';"
        " base-uri 'none'; form-action 'none'"
    )


@lru_cache(maxsize=1)
def _digests() -> tuple[bytes, ...]:
    """SHA-256 of each script that shows figures."""
    return tuple(hashlib.sha256(text.encode()).digest() for text in script_texts())


def _script_address() -> str:
    """Where a page finds the scripts: another place for each version of them."""
    return f"{SCRIPT_PATH}?{'-'.join(digest[:4].hex() for digest in _digests())}"


def _source(digest: bytes) -> str:
    """As a policy names what it allows."""
    return f"'sha256-{base64.b64encode(digest).decode()}'"
