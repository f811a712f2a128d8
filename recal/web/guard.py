"""What a request must pass, as FastAPI dependencies: its Host, and of a form its origin, its kind
and its size.

Host against DNS rebinding; Origin and Sec-Fetch-Site against forms of other sites. And how uvicorn
serves the page: its limits, and room for a new connection where others only wait. uvicorn counts
every open connection, and answers 503 beyond its limit, although most of them may have sent nothing
at all: a hundred idle sockets would lock everyone out.

Decision: docs/decisions/0089-guards-of-the-review-page.md.
"""

import asyncio
import copy
import ipaddress
import re
from typing import Any, cast
from urllib.parse import parse_qsl

import uvicorn
from fastapi import HTTPException, Request
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol

from recal.web.settings import LOOPBACK_NAMES, ServeSettings, is_loopback

# bytes of a form (docs/serve.md): a reason of 4,000 letters of two bytes has 24,000 when
# percent-encoded
MAX_BODY = 32_768
MAX_FIELDS = 12
BODY_WAIT_S = 10.0
FORM = "application/x-www-form-urlencoded"
# A Host, whole: a name or an address, IPv6 in brackets, and perhaps a port (RFC 9110, 7.2).
HOST = re.compile(r"(?P<name>[0-9a-z._-]+|\[[0-9a-f:.]+\])(?::(?P<port>[0-9]{1,5}))?", re.I)
MAX_PORT = 65_535  # 2^16 - 1
# Of connections that are open at once: a browser opens six, so ten reviewers fit.
MAX_CONNECTIONS = 64
# Of requests at work, each in a thread or a task of its own; beyond it uvicorn answers 503.
MAX_REQUESTS = 100
KEEP_ALIVE_S = 5  # after an answer: a reader who clicks on is back by then
SHUTDOWN_S = 5
MAX_HEAD_BYTES = 32_768  # of a request: a cookie and a Host are a kilobyte
HEADERS = {  # of every answer; what a page may load is its own header (site.py)
    "x-content-type-options": "nosniff",
    # with no-referrer, browsers would send forms with `Origin: null`
    "referrer-policy": "same-origin",
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
}
HTTPS_HEADERS = {"strict-transport-security": "max-age=31536000"}


async def known_host(request: Request) -> None:
    """Refused where the browser asks under a name that is not this server's."""
    if not has_known_host(request):
        raise HTTPException(
            421, "This address is not served here. The operator may allow a name with --allow-host."
        )


def has_known_host(request: Request) -> bool:
    """Whether the one Host of the request is allowed."""
    given = request.headers.getlist("host")
    return len(given) == 1 and allowed_host(given[0], request.app.state.site.settings)


def allowed_host(host: str, settings: ServeSettings) -> bool:
    """May a browser ask under this Host? An IP address cannot be rebound; names must be known. The
    port does not count.
    """
    found = HOST.fullmatch(host)
    if found is None or int(found["port"] or 0) > MAX_PORT:
        return False
    name = found["name"].lower()
    try:
        address = ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return name in (*LOOPBACK_NAMES, *settings.hosts, settings.host.lower())
    if (address.version == 6) != name.startswith("["):
        return False
    named = name.strip("[]") in settings.hosts
    return named or address.is_loopback or not is_loopback(settings.host)


async def form_of(request: Request) -> dict[str, str]:
    """The fields of a form that a page of this very site has sent, each once."""
    _check_origin(request.headers)
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != FORM:
        raise HTTPException(415, f"Needed a form ({FORM}).")
    try:
        async with asyncio.timeout(BODY_WAIT_S):
            body = await _body(request)
        fields = parse_qsl(
            body.decode("ascii"), keep_blank_values=True, errors="strict", max_num_fields=MAX_FIELDS
        )
    except TimeoutError:
        raise HTTPException(408, "The form did not arrive in time.") from None
    except ClientDisconnect:
        raise HTTPException(400, "The form was cut off.") from None
    except ValueError:
        raise HTTPException(400, "The form cannot be read.") from None
    if len(dict(fields)) < len(fields):
        raise HTTPException(400, "The form holds a field twice.")
    return dict(fields)


def _check_origin(headers: Headers) -> None:
    """Refused unless a browser says that the form came from this very site."""
    site = headers.getlist("sec-fetch-site")
    origin = [text.lower() for text in headers.getlist("origin")]
    host = headers["host"].lower()
    same_site = site in ([], ["same-origin"])
    same_origin = origin in ([], [f"http://{host}"], [f"https://{host}"])
    if not (same_site and same_origin and (site or origin)):
        raise HTTPException(
            403,
            "The form did not come from this page. Open the page again and send the form from"
            " there.",
        )


async def _body(request: Request) -> bytes:
    """The whole body, as long as it is small. (starlette's own limit answers without a page.)"""
    too_large = HTTPException(413, f"The form is larger than {MAX_BODY} bytes.")
    if int(request.headers.get("content-length", 0)) > MAX_BODY:
        raise too_large
    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > MAX_BODY:
            raise too_large
    return body


class Connection(H11Protocol):
    """uvicorn's own, for which the longest waiting ones of MAX_CONNECTIONS make room."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the connection up; one at work on a whole request is never dropped for it."""
        waiting = [held for held in self.connections if isinstance(held, Connection) and held.waits]
        waiting.sort(key=lambda held: held.opened_s)
        for held in waiting[: max(len(self.connections) + 1 - MAX_CONNECTIONS, 0)]:
            held.transport.abort()
            self.connections.discard(held)
        self.opened_s = self.loop.time()
        super().connection_made(cast(asyncio.Transport, transport))

    @property
    def waits(self) -> bool:
        """Whether the next step is the client's: it has sent no whole request, or has not read the
        answer.
        """
        cycle = self.cycle
        if cycle is None or cycle.response_complete or cycle.more_body:
            return True
        return bool(self.flow.write_paused)


def server_config(app: Any, settings: ServeSettings, *, log: bool) -> uvicorn.Config:
    """How the page is served; requests are logged on standard error where that is asked for."""
    logging = copy.deepcopy(uvicorn.config.LOGGING_CONFIG)
    logging["handlers"]["access"]["stream"] = "ext://sys.stderr"
    headers = HEADERS | (HTTPS_HEADERS if settings.https else {})
    return uvicorn.Config(
        app,
        http=Connection,
        headers=list(headers.items()),
        log_config=logging,
        log_level="info" if log else "warning",
        access_log=log,
        server_header=False,
        proxy_headers=False,
        ws="none",
        lifespan="off",
        timeout_keep_alive=KEEP_ALIVE_S,
        limit_concurrency=MAX_REQUESTS,
        timeout_graceful_shutdown=SHUTDOWN_S,
        h11_max_incomplete_event_size=MAX_HEAD_BYTES,
    )
