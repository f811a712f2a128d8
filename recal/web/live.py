"""The page of `recal watch`: the state by server-sent events, on this machine alone, behind the
guards of the review page.
"""

import asyncio
import json
import socket
import threading
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any

import uvicorn
from fastapi import Depends, FastAPI
from fastapi.responses import Response, StreamingResponse

from ins.records import InputError
from recal.service.results.pages import page_environment, update_html
from recal.service.watch.records import GYRO_HEAD, WatchState, gyro_rows, rows
from recal.web import guard
from recal.web.guard import server_config
from recal.web.settings import ServeSettings
from recal.web.site import framed

EVENT_S = 1.0
HOST = "127.0.0.1"
POLICY = (
    "default-src 'none'; style-src 'self'; script-src 'self'; img-src data: blob:;"
    " connect-src 'self'; frame-src 'self'; frame-ancestors 'none'; base-uri 'none';"
    " form-action 'none'"
)


@dataclass(frozen=True)
class _Site:
    """What the guards look for in an application."""

    settings: ServeSettings


class LivePage:
    """Serves the last state in a thread of its own while it is entered.

    Parameters
    ----------
    port : int
        On 127.0.0.1; 0 takes any that is free.

    Raises
    ------
    InputError
        Where the port cannot be had.
    """

    def __init__(self, port: int) -> None:
        try:
            self._listener = socket.create_server((HOST, port), backlog=20)
        except OSError as error:
            raise InputError(
                f"watch: cannot listen on {HOST} port {port} ({error.strerror})"
            ) from None
        self.url = f"http://{HOST}:{self._listener.getsockname()[1]}/"
        self._last: WatchState | None = None
        settings = ServeSettings(store_url="", host=HOST, port=port)
        self.app = self._application(settings)
        self._server = uvicorn.Server(server_config(self.app, settings, log=False))
        self._server.install_signal_handlers = lambda: None  # type: ignore[attr-defined]
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> "LivePage":
        self._thread.start()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._server.should_exit = self._server.force_exit = True
        self._thread.join(timeout=5.0)
        self._listener.close()

    def show(self, state: WatchState) -> None:
        """Take the state that the next event tells of."""
        self._last = state

    def _serve(self) -> None:
        asyncio.run(self._server.serve(sockets=[self._listener]))

    def _application(self, settings: ServeSettings) -> FastAPI:
        app = FastAPI(
            docs_url=None,
            redoc_url=None,
            openapi_url=None,
            dependencies=[Depends(guard.known_host)],
        )
        app.state.site = _Site(settings)
        found = page_environment("recal", "web/templates")
        style = "".join(found.get_template(n).render() for n in ("style.css", "web.css"))
        script = found.get_template("live.js").render()
        page = found.get_template("live.html.j2").render()
        files = {
            "/": (page, "text/html"),
            "/style.css": (style, "text/css"),
            "/live.js": (script, "text/javascript"),
        }

        @app.get("/events")
        async def events() -> StreamingResponse:
            return StreamingResponse(self._events(), media_type="text/event-stream")

        @app.get("/report")
        def report() -> Response:
            return framed(drawn(self._last))

        for path, (text, kind) in files.items():
            app.add_api_route(path, _answer(text, kind), methods=["GET"])
        return app

    async def _events(self) -> AsyncIterator[str]:
        while not self._server.should_exit:
            if self._last is not None:
                yield f"data: {told(self._last)}\n\n"
            await asyncio.sleep(EVENT_S)


def _answer(text: str, kind: str) -> Any:
    headers = {"content-security-policy": POLICY, "x-frame-options": "DENY"}
    return lambda: Response(text, media_type=kind, headers=headers)


def told(state: WatchState) -> str:
    """The state as the page's script writes it, in JSON: texts alone."""
    estimate = state.estimate
    drawable = estimate is not None and estimate.document is not None
    said = {
        "rows": rows(state),
        "head": GYRO_HEAD,
        "gyros": gyro_rows(estimate) if estimate is not None else [],
        "faults": list(state.faults),
        "advice": list(estimate.advice) if estimate is not None else [],
        "report": estimate.until_s if estimate is not None and drawable else None,
    }
    return json.dumps(said)


def drawn(state: WatchState | None) -> str:
    """The report of the last estimate."""
    document = None if state is None or state.estimate is None else state.estimate.document
    return "" if document is None else update_html(document)
