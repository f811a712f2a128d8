"""The application: site and routes together; each fault is a page of one line, no trace."""

from typing import Any

from fastapi import Depends, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from starlette.exceptions import HTTPException

from ins.records import InputError
from recal.service.store import StoreBusy, StoreError, StoreRefused, UnknownUnit
from recal.web import actions, guard, pages
from recal.web.settings import ServeSettings
from recal.web.site import ReviewSite, Visit

NO_FAULT = (
    "The program met a case it does not know. Nothing was changed; the server's log says more."
)
# in place of what the library says
OWN_LINES = {
    "Not Found": "There is no page here.",
    "Method Not Allowed": "Only GET and POST are served.",
}

ADDRESS_LETTERS = 40  # letters of what an address holds; chosen: a line of a phone


def build_app(settings: ServeSettings) -> FastAPI:
    """The application as uvicorn takes it. InputError where store or reports cannot be opened."""
    app = FastAPI(
        docs_url=None,
        redoc_url=None,
        openapi_url=None,
        title="recal",
        dependencies=[Depends(guard.known_host)],
        exception_handlers={
            HTTPException: _of_http,
            RequestValidationError: _of_address,
            InputError: _of_service,
            StoreRefused: _of_service,
            Exception: _of_program,
        },
    )
    app.state.site = ReviewSite(settings)
    app.include_router(pages.router)
    app.include_router(actions.router)
    return app


async def _of_http(request: Request, error: HTTPException) -> Response:
    if error.headers and "location" in error.headers:
        return Visit(request).go_to(error.headers["location"])
    answer = Visit(request).fault(error.status_code, OWN_LINES.get(error.detail, error.detail))
    answer.headers.update(error.headers or {})
    return answer


async def _of_address(request: Request, error: RequestValidationError) -> Response:
    """What the address of a page lacks or has wrong, and what it needs."""
    said = "; ".join(_wrong_part(fault) for fault in error.errors())
    return Visit(request).fault(400, f"There is no page at this address: {said}.")


async def _of_service(request: Request, error: Exception) -> Response:
    return Visit(request).fault(_status(error), str(error))


async def _of_program(request: Request, error: Exception) -> Response:
    return Visit(request).fault(500, NO_FAULT)


def _wrong_part(fault: Any) -> str:  # one of pydantic, a mapping
    name = fault["loc"][-1]
    if fault["type"] == "missing":
        return f"{name} is missing"
    needed = fault.get("ctx", {}).get("expected", "a whole number from 1 on")
    return f"{name} is {str(fault['input'])[:ADDRESS_LETTERS]!r}, needed {needed}"


def _status(error: Exception) -> int:
    if isinstance(error, UnknownUnit):
        return 404
    if isinstance(error, StoreError | StoreBusy):
        return 503
    if isinstance(error, InputError):
        return 400
    return 409
