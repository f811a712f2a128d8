"""What the routes share: settings, door, drawings and reports together, and how a page is made."""

import base64
import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any
from urllib.parse import quote

from fastapi import HTTPException, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from markupsafe import Markup

from ins.records import InputError
from recal.service.results.pages import page_environment, script_texts
from recal.service.store import StoreRefused, TableStore
from recal.web import views
from recal.web.door import SESSION_S, Door
from recal.web.drawings import Drawings, Forecasts
from recal.web.guard import has_known_host
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
CLOSED = {  # what is no page: nothing may be loaded from it, and nothing may frame it
    "x-frame-options": "DENY",
    "content-security-policy": "default-src 'none'; frame-ancestors 'none'",
}
SCRIPT_PATH = "/figures.js"


class ReviewSite:
    """What the routes share. InputError where store or reports cannot be opened."""

    def __init__(self, settings: ServeSettings) -> None:
        self.settings = settings
        self.door = Door(settings.tokens, ticket=settings.ticket)
        self.drawings = Drawings()
        self.reports = Reports(settings.reports)
        self.forecasts = Forecasts()
        self.cookie = "__Host-recal_session" if settings.https else "recal_session"
        with self.tables() as opened:
            self.store_name = opened.name

    @contextmanager
    def tables(self) -> Iterator[TableStore]:
        """The store, opened for one request: a server that went away, or a file put in its place,
        is met at the next.
        """
        with TableStore.open(self.settings.store_url) as opened:
            yield opened


class Visit:
    """A request, the session that its cookie opens, and the answers that can be given to it."""

    def __init__(self, request: Request) -> None:
        self.site: ReviewSite = request.app.state.site
        self.request = request
        # a page without a route is drawn for any Host, but as for a stranger
        cookie = request.cookies.get(self.site.cookie, "")
        self.cookie = cookie if has_known_host(request) else ""
        self.session = self.site.door.session(self.cookie)

    def page(self, template: str, status: int = 200, **context: Any) -> HTMLResponse:
        """A page under the strict policy: no script but that of its figures, no style but its
        own, nothing from elsewhere.
        """
        shared = {
            "style": _style(),
            "session": self.session,
            "locked": self.site.door.locked,
            "waiting": self._waiting(),
            "has_reports": self.site.reports.given,
            "address": views.address,
            "looks": views.STATE_LOOKS,
            "figures_script": _script_address(),
        }
        page = page_environment("recal", "web/templates").get_template(template)
        text = page.render(**shared, **context)
        policy = _policy(drawn="<script src=" in text)
        headers = {"x-frame-options": "DENY", "content-security-policy": policy}
        return HTMLResponse(text, status, headers=headers)

    def _waiting(self) -> int:
        """How many proposals wait for a decision; 0 for who may not read, or without a store."""
        if self.session is None and self.site.settings.reading_needs_token:
            return 0
        try:
            with self.site.tables() as opened:
                return opened.undecided()
        except (InputError, StoreRefused):
            return 0

    def fault(self, status: int, line: str) -> HTMLResponse:
        """A page that says what is wrong; the store's address is not in it."""
        name = self.site.store_name
        line = line.replace(f"no store at {name}", "the store is not where it was")
        line = line.replace(f"store {name}", "the store").replace(name, "the store")
        return self.page(
            "fault.html.j2",
            status,
            title=TITLES.get(status, f"Error {status}"),
            line=line,
            next=NEXT.get(status, ""),
            sign_in=status == 403,
        )

    def download(self, text: str, name: str) -> Response:
        """A document as a file."""
        said = {"content-disposition": f'attachment; filename="{name}"'}
        return Response(text, media_type="application/json", headers=CLOSED | said)

    def go_to(self, path: str) -> RedirectResponse:
        """Another page of this site."""
        return RedirectResponse(path, 303, headers=CLOSED)

    def set_cookie(self, answer: Response, value: str) -> None:
        """Give the browser its cookie; an empty one takes it back."""
        answer.set_cookie(
            self.site.cookie,
            value,
            max_age=round(SESSION_S) if value else 0,
            httponly=True,
            samesite="strict",
            secure=self.site.settings.https,
        )


class ReaderVisit(Visit):
    """A visit of who may read: anybody on this machine, elsewhere who is signed in."""

    def __init__(self, request: Request) -> None:
        super().__init__(request)
        if self.site.settings.reading_needs_token:
            self.need_session()

    def need_session(self) -> None:
        """Sends who is not signed in to do so, and back here."""
        if self.session is None:
            query = f"?{self.request.url.query}" if self.request.url.query else ""
            path = views.address("/signin", next=quote(self.request.url.path) + query)
            raise HTTPException(303, headers={"location": path})


@lru_cache(maxsize=1)
def _style() -> Markup:
    """The style sheet of the reports with what the page adds."""
    found = page_environment("recal", "web/templates")
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


def framed(text: str) -> HTMLResponse:
    """A report that was drawn elsewhere: alone in a sandbox, without forms or an origin; of scripts
    only those of this version's figures run.
    """
    headers = {"x-frame-options": "SAMEORIGIN", "content-security-policy": _framed_policy()}
    return HTMLResponse(text, headers=headers)


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
