"""What a long command is doing, on a terminal; nothing when piped."""

import sys
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING

from ins.user_input import one_line
from recal.cli.terminal import life

if TYPE_CHECKING:
    from rich.progress import Progress as Bar
    from rich.progress import TaskID

FIRST_RUN = "first run on this machine: compiling, 5 to 20 s"  # benchmarks/speed.py


class Progress:
    """A bar on standard error with what is being done, which step of how many, and since when; call
    it with the words as each step begins.

    steps: how many there are; None where nobody knows, then the bar only moves. compiles: whether
    the work runs kernels, which the first run on a machine compiles.
    """

    def __init__(
        self, title: str, *, quiet: bool, steps: int | None = None, compiles: bool = True
    ) -> None:
        self._compiles = compiles
        self._title, self._steps, self._begun = title, steps, 0
        self._bar: Bar | None = None
        self._task: TaskID | None = None
        self._compiled_s: Callable[[], float] | None = None
        if not quiet and sys.stderr.isatty():
            self._bar = _bar(counted=steps is not None)

    def __enter__(self) -> "Progress":
        life.clear()
        if self._bar is not None:
            self._bar.start()
            self._task = self._bar.add_task(self._title, total=self._steps)
            self._watch_compiling()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is None:
            return
        self._bar.stop()
        compiled_s = 0.0 if self._compiled_s is None else self._compiled_s()
        if compiled_s > 0.0:
            self._say(f"compiled in {compiled_s:.0f} s, kept for the next run")

    def __call__(self, what: str) -> None:
        life.log.info("%s", one_line(what))
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, description=one_line(what), completed=self._begun)
            self._begun += 1

    def _watch_compiling(self) -> None:
        if not self._compiles:
            return
        from recal.service.results.files import watch_compiling

        self._compiled_s = watch_compiling(lambda: self._say(FIRST_RUN))

    def _say(self, words: str) -> None:
        if self._bar is not None:
            self._bar.console.print(one_line(words), highlight=False, markup=False)


def _bar(*, counted: bool) -> "Bar":
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    count = [MofNCompleteColumn(), TextColumn("left"), TimeRemainingColumn()] if counted else []
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        *count,
        TimeElapsedColumn(),
    )
    return Progress(*columns, console=Console(stderr=True), transient=True)
