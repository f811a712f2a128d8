"""`recal serve`: the review page of a store, in a browser."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.cli.console import Shown, say
from recal.cli.parameters.verbs import made_from

if TYPE_CHECKING:
    import socket

    from recal.web.settings import ServeSettings

NEEDS_EXTRA = "{} needs FastAPI and uvicorn: pip install strapdown-recal[web]"


@made_from(reports="FOLDER", token_file="FILE")
def serve(
    shown: Shown,
    /,
    store,
    *,
    host: str = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes any that is free.")
    ] = 8000,
    reports: Path | None = None,
    token_file: Path | None = None,
    allow_host: Sequence[str] = (),
    https: bool = False,
) -> None:
    """Review a store in a browser: see tables, proposed updates and reports; approve, reject or
    roll back.

    Example: recal serve --store sqlite:///recal.db --reports diagnoses

    Parameters
    ----------
    host
        Address to listen on. Any but this machine's own needs a token.
    reports
        Also show the diagnosis reports below this folder.
    token_file
        File with a line for each reviewer: TOKEN, or NAME TOKEN. Default: RECAL_SERVE_TOKEN.
    allow_host
        A further host name that browsers may use, as behind a proxy. May be repeated.
    https
        A proxy adds TLS, so cookies are for https only.
    """
    require_web("serve")
    from recal.web.app import build_app

    settings, made, ticket = _settings(store, host, port, reports, token_file, allow_host, https)
    app = build_app(settings)
    listener = _listen(settings)
    url = _url(settings, listener)
    started = {
        "schema": "recal.serve/1",
        "verdict": "ok",
        "url": url,
        "read_only": not settings.tokens,
    }
    replace(shown, verbose=False).answer(started, [f"serving on {url} (Ctrl-C ends it)"])
    sys.stdout.flush()
    _greet(settings, made, f"{url}login?ticket={ticket}", quiet=shown.quiet)
    _run(app, settings, listener, log=shown.verbose)


def require_web(what: str) -> None:
    """InputError where the libraries of a page are not installed."""
    if not all(map(find_spec, ("fastapi", "uvicorn"))):
        from ins.records import InputError

        raise InputError(NEEDS_EXTRA.format(what))


def _settings(
    store: str,
    host: str,
    port: int,
    reports: Path | None,
    token_file: Path | None,
    names: Sequence[str],
    https: bool,
) -> tuple[ServeSettings, str, str]:
    """What to serve, and the token and the ticket of a login link if they were made for this start:
    only on this machine, only shown on a terminal.
    """
    import secrets

    from recal.web.settings import ServeSettings, is_loopback, read_tokens, token_of, too_open

    tokens, made, ticket = read_tokens(token_file), "", ""
    if token_file is not None and too_open(token_file):
        say(f"recal: warning: {token_file} can be read by every user of this machine (chmod 600)")
    if not tokens and is_loopback(host) and not (names or https) and sys.stderr.isatty():
        made, ticket = secrets.token_urlsafe(24), secrets.token_urlsafe(24)
        tokens = (token_of(made, source="serve"),)
    hosts = tuple(name.lower() for name in names)
    return (
        ServeSettings(
            store_url=store,
            host=host,
            port=port,
            reports=reports,
            tokens=tokens,
            ticket=token_of(ticket, source="serve") if ticket else None,
            hosts=hosts,
            https=https,
        ),
        made,
        ticket,
    )


def _listen(settings: ServeSettings) -> socket.socket:
    """A socket that listens; InputError where the address cannot be had."""
    import socket

    from ins.records import InputError

    try:
        family = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((settings.host, settings.port), family=family, backlog=100)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(
            f"serve: cannot listen on {settings.host} port {settings.port} ({why})"
        ) from None


def _url(settings: ServeSettings, listener: socket.socket) -> str:
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    return f"http://{host}:{listener.getsockname()[1]}/"


def _greet(settings: ServeSettings, made: str, link: str, *, quiet: bool) -> None:
    """How to sign in, and what a reader on the network can see."""
    from recal.web.settings import is_loopback

    if made:
        say(f"sign in with one click, once, within 10 min: {link}")
        say(f"token of this start, to sign in with: {made}")
    elif not is_loopback(settings.host) and not settings.https:
        say(
            "recal: warning: no TLS: whoever can listen on this network reads the token and the"
            " pages (see docs/serve.md)"
        )
    elif not settings.tokens:
        say("read only: no token was given (--token-file or RECAL_SERVE_TOKEN)", quiet=quiet)


def _run(app: Any, settings: ServeSettings, listener: socket.socket, *, log: bool) -> None:
    """Serve until interrupted; requests are logged on standard error with -v."""
    import uvicorn

    from recal.web.guard import server_config

    uvicorn.Server(server_config(app, settings, log=log)).run(sockets=[listener])
