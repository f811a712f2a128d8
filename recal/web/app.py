"""The application: site and routes together; each fault is a page of one line, no trace."""

from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import RedirectResponse, Response
from starlette.exceptions import HTTPException

from ins.records import InputError
from recal.service.store import StoreBusy, StoreError, StoreRefused, UnknownUnit
from recal.web import actions, pages, views
from recal.web.door import TooManyGuesses
from recal.web.guard import Guard, Refused
from recal.web.settings import ServeSettings
from recal.web.site import SignInFirst, Site

NO_FAULT = (
    "The program met a case it does not know. Nothing was changed; the server's log says more."
)

ADDRESS_LETTERS = 40  # letters of what an address holds; chosen: a line of a phone


def build_app(settings: ServeSettings) -> Guard:
    """The application as uvicorn takes it. InputError where store or reports cannot be opened."""
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
        return site.fault(400, _wrong_address(error), request)

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


def _wrong_address(error: RequestValidationError) -> str:
    """What the address of a page lacks or has wrong, and what it needs."""
    said = [_wrong_part(fault) for fault in error.errors()]
    return f"There is no page at this address: {'; '.join(said)}."


def _wrong_part(fault: Any) -> str:  # one of pydantic, a mapping
    name = fault["loc"][-1]
    if fault["type"] == "missing":
        return f"{name} is missing"
    needed = fault.get("ctx", {}).get("expected", "a whole number from 1 on")
    return f"{name} is {str(fault['input'])[:ADDRESS_LETTERS]!r}, needed {needed}"


def _status(error: Exception) -> int:
    if isinstance(error, Refused):
        return error.status
    if isinstance(error, UnknownUnit):
        return 404
    if isinstance(error, StoreError | StoreBusy):
        return 503
    if isinstance(error, InputError):
        return 400
    return 409
