"""How uvicorn serves the page: its limits, and room for a new connection where others only wait.

uvicorn counts every open connection, and answers 503 beyond its limit, although most of them may
have sent nothing at all: a hundred idle sockets would lock everyone out.

Decision: docs/decisions/0089-guards-of-the-review-page.md.
"""

import asyncio
import copy
from typing import Any, cast

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from recal.web.settings import ServeSettings

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
