"""`recal update` and `recal watch`: recalibrate a unit's thermal table from its runs, and from a
session while it runs.
"""

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ins.user_input import one_line
from recal.cli.console import DEFAULT_STORE, Shown, json_line, login_name, say
from recal.cli.logs import LATITUDE
from recal.cli.parameters.shared import PROPOSAL
from recal.cli.parameters.verbs import made_from

if TYPE_CHECKING:
    from recal.service.watch.records import WatchState

# chosen: an interrupt that comes twice within 1 s is one (timeout sends it to the process and to
# its group), and nobody changes their mind so soon
SAME_S = 1.0


@made_from(
    "recal.service.update",
    "UpdateRequest",
    *PROPOSAL,
    asks="new_unit new_store accept_step retry any_clock twin config priors thermal_model",
    retry="[N]",
)
def update(
    shown: Shown, runs, /, store, commit, propose, by, note, *, output, force, **asked
) -> None:
    """Measure the gyro biases in runs of a unit, merge them into its stored table, and report.

    Example: recal update run-1 run-2 --store sqlite:///recal.db --commit

    With --propose the new table waits for a second person, who decides in recal serve or by recal
    table approve.

    Parameters
    ----------
    retry
        With --commit: where another writer was faster, estimate again from the table that is
        active then, at most N times. Default: 0; 3 where N is left out.
    """
    signed = _signed(propose, by, note, commit=commit)
    if asked["retry"] and not commit:
        raise typer.BadParameter("nothing is stored without --commit", param_hint="--retry")
    from recal.service.update import UPDATE_STEPS, UpdateRequest, update_in_store

    folder = shown.folder(output, "recal.update/1", "update.html", force=force)
    with shown.progress("reading", UPDATE_STEPS) as step:
        request = UpdateRequest(
            runs=runs,
            store_url=store,
            store_named=store != DEFAULT_STORE,
            commit=commit,
            propose=signed,
            output=folder,
            keep_earlier=not force,
            told=shown.say,
            step=step,
            **asked,
        )
        result = update_in_store(request)
    shown.end(result, folder / "update.html")


def _signed(propose: bool, by: str | None, note: str, *, commit: bool) -> tuple[str, str] | None:
    """Who proposes and their note; None of what is no proposal."""
    if commit and propose:
        raise typer.BadParameter(
            "--commit stores the table at once, --propose keeps it for review: give one of them"
        )
    return (login_name() if by is None else by, note) if propose else None


@made_from(
    "recal.service.watch.session",
    "WatchRequest",
    LATITUDE,
    *PROPOSAL,
    asks="serial target_deg_h technology lat_deg map_ idle_s new_unit new_store twin config"
    " thermal_model",
    map_="FILE",
    technology="rlg|fog|mems",
    report="FOLDER",
)
def watch(
    shown: Shown,
    source,
    /,
    run: Annotated[
        Path, typer.Option("-o", "--output", metavar="RUN", help="The run directory to record to.")
    ],
    store,
    page: Annotated[
        int | None,
        typer.Option(
            "--page", metavar="PORT", min=0, max=65535, help="Show it on 127.0.0.1 at this port."
        ),
    ] = None,
    commit: bool = False,
    *,
    propose,
    by,
    note,
    report: Path | None = None,
    force,
    **asked,
) -> None:
    """Watch a session while it runs: record it, say what it shows and what more would bring; at
    its end, or on Ctrl-C, update the table as recal update does.

    Example: recal watch udp:127.0.0.1:14550 --serial SN-0042 --lat-deg 45.000 -o run

    Parameters
    ----------
    report
        The folder of the update's report. Default: recal-watch.
    """
    signed = _signed(propose, by, note, commit=commit)
    if _in_lines(shown):
        stamped(f"watching {source}, recording to {run}")  # what is imported next takes seconds
    from recal.service.watch.session import WatchRequest
    from recal.service.watch.session import watch as watched

    folder = shown.folder(
        report, "recal.update/1", "update.html", default="recal-watch", force=force
    )
    with _screen(shown) as screen, _page(page, shown) as page_shown, _until_interrupted() as stop:

        def show(state: "WatchState") -> None:
            screen(state)
            page_shown(state)

        request = WatchRequest(
            source=source,
            run=run,
            store_url=store,
            store_named=store != DEFAULT_STORE,
            commit=commit,
            propose=signed,
            output=folder,
            stopped=stop.is_set,
            shown=show,
            told=shown.say,
            **asked,
        )
        try:
            result = watched(request)
        except KeyboardInterrupt:
            say(f"broken off before the update was through; recal update {run} makes it")
            raise
    if shown.as_json:
        json_line(result.document)
        shown = Shown(as_json=False, quiet=True, verbose=shown.verbose)
    shown.end(result, folder / "update.html")


@contextmanager
def _until_interrupted() -> Iterator[Event]:
    """Set by the first Ctrl-C, or a request to end; one that comes SAME_S later breaks off."""
    stop, asked_s = Event(), 0.0
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def ask(number: int, frame: Any) -> None:
        nonlocal asked_s
        if not stop.is_set():
            asked_s = time.monotonic()
            stop.set()
        elif time.monotonic() - asked_s > SAME_S:
            raise KeyboardInterrupt

    for number in before:
        signal.signal(number, ask)
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _screen(shown: Shown) -> Iterator[Any]:
    """What shows the state: lines of JSON, a screen of a terminal, lines with the time, nothing."""
    if shown.as_json:
        yield json_line
    elif shown.quiet:
        yield lambda state: None
    elif _in_lines(shown):
        from recal.cli.terminal.watch_screen import changed_lines

        lines = changed_lines()

        def print_new(state: "WatchState") -> None:
            for line in lines(state):
                stamped(line)

        yield print_new
    else:
        from recal.cli.terminal.watch_screen import screen

        with screen() as show:
            yield show


def _in_lines(shown: Shown) -> bool:
    """Whether the session is told line by line: somebody reads the output later, or elsewhere."""
    on_terminal = sys.stdout.isatty() and sys.stderr.isatty()
    return not (shown.as_json or shown.quiet or on_terminal)


def stamped(line: str) -> None:
    """A line with the time of day (UTC), at once: on standard output where that is no terminal."""
    out = sys.stderr if sys.stdout.isatty() else sys.stdout
    print(f"{datetime.now(UTC):%H:%M:%SZ} {one_line(line)}", file=out, flush=True)


@contextmanager
def _page(port: int | None, shown: Shown) -> Iterator[Any]:
    """What shows the state on a page, served meanwhile."""
    if port is None:
        yield lambda state: None
        return
    from recal.cli.serve import require_web

    require_web("watch --page")
    from recal.web.live import LivePage

    with LivePage(port) as live:
        shown.say(f"page: {live.url}")
        yield live.show
