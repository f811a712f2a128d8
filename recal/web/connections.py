"""Connections to the server: one that waits for its client makes room for a new one.

uvicorn counts every open connection, and answers 503 beyond its limit, although most of them may
have sent nothing at all: a hundred idle sockets would lock everyone out.
"""

import asyncio
import copy
from collections.abc import Callable
from typing import Any, cast

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

# Of connections that are open at once: a browser opens six, so ten reviewers fit.
MAX_CONNECTIONS = 64
# Of requests at work, each in a thread or a task of its own; beyond it uvicorn answers 503.
MAX_REQUESTS = 100
KEEP_ALIVE_S = 5  # after an answer: a reader who clicks on is back by then
SHUTDOWN_S = 5
MAX_HEAD_BYTES = 32_768  # of a request: a cookie and a Host are a kilobyte


class Connection(H11Protocol):
    """A connection that drops the longest waiting ones where MAX_CONNECTIONS are open."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the connection up, and make room for it."""
        for other in waiting_longest(self.connections, len(self.connections) + 1):
            other.transport.abort()
            self.connections.discard(other)
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


def waiting_longest(connections: set[Any], wanted: int) -> list[Any]:
    """The connections to drop, so that `wanted` of them become MAX_CONNECTIONS; the oldest first.

    One at work on a whole request is never among them.
    """
    waiting = [held for held in connections if isinstance(held, Connection) and held.waits]
    waiting.sort(key=lambda held: held.opened_s)
    return waiting[: max(wanted - MAX_CONNECTIONS, 0)]


def server_config(app: Callable, *, log: bool) -> uvicorn.Config:
    """How the page is served; requests are logged on standard error where that is asked for."""
    logging = copy.deepcopy(uvicorn.config.LOGGING_CONFIG)
    logging["handlers"]["access"]["stream"] = "ext://sys.stderr"
    return uvicorn.Config(
        app,
        http=Connection,
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
