"""The screen of `recal watch` on a terminal, and its lines where there is none."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ins.user_input import visible
from recal.service.watch.records import GYRO_HEAD, WatchState, gyro_rows, rows

BEAT_S, EARLY_BEAT_S = 60.0, 10.0  # chosen: a line a minute is read; before it one sees it lives


@contextmanager
def screen() -> Iterator[Callable[[WatchState], None]]:
    """A part of the terminal that is written over with each state."""
    from rich.console import Console
    from rich.live import Live

    with Live(console=Console(stderr=True), auto_refresh=False) as live:
        yield lambda state: live.update(drawn(state), refresh=True)


def drawn(state: WatchState) -> Any:
    """The state as rich draws it."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    head = Table.grid(padding=(0, 2))
    for name, value in rows(state):
        head.add_row(Text(name, style="bold"), Text(visible(value)))
    parts: list[Any] = [head]
    if state.estimate is not None and state.estimate.gyros:
        table = Table(*GYRO_HEAD, title="deg/h, 1 sigma", title_justify="left")
        for row in gyro_rows(state.estimate):
            table.add_row(*row)
        parts.append(table)
    for fault in state.faults:
        parts.append(Text(f"! {visible(fault)}", style="bold red"))
    for line in _advice(state):
        parts.append(Text(f"> {line}", style="bold"))
    if state.ending is None:
        parts.append(Text("Ctrl-C ends the session and updates the table", style="dim"))
    return Group(*parts)


def changed_lines() -> Callable[[WatchState], list[str]]:
    """Gives the lines that were not said before, and every BEAT_S, before the first estimate
    EARLY_BEAT_S, where the session is: of a pipe or a log file.
    """
    said: set[str] = set()
    until_s, beat_s, known = -1.0, -np.inf, False

    def lines(state: WatchState) -> list[str]:
        nonlocal until_s, beat_s, known
        found = [f"phase: {state.phase}", *(f"! {fault}" for fault in state.faults)]
        if state.ending is not None:
            found.append(f"session ended: {state.ending}")
        fresh = [line for line in found if line not in said]
        said.difference_update([one for one in said if one.startswith("phase")])
        said.update(found)
        estimate, now_s = state.estimate, time.monotonic()
        is_new = estimate is not None and estimate.until_s != until_s
        every_s = BEAT_S if known else EARLY_BEAT_S
        if is_new or (state.ending is None and now_s - beat_s >= every_s):
            beat_s = now_s
            fresh += [f"{name}: {value}" for name, value in rows(state)[1:]]
        if estimate is not None and is_new:
            until_s, known = estimate.until_s, True
            for row in gyro_rows(estimate):
                cells = (f"{head} {cell}" for head, cell in zip(GYRO_HEAD, row))
                fresh.append(", ".join(cells))
            fresh += [f"> {line}" for line in _advice(state)]
        return fresh

    return lines


def _advice(state: WatchState) -> tuple[str, ...]:
    return tuple(state.estimate.advice) if state.estimate is not None else ()
