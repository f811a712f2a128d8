"""What all studies share: work that is kept and gone on with, in as many processes as wanted;
Markdown tables; intervals of shares.

A study is a module with one function::

    def run(work: Work, *, units: int = 40, cases: tuple[str, ...] = tuple(CASES)) -> str:
        records = work.each(one_unit, [(case, seed) for case in cases for seed in range(units)])
        return table(HEAD, rows(records))

`work.each` calls `one_unit(case, seed)` for each task. The function stands at the top of its
module, its arguments are plain values, and what it gives back can be written as JSON. The text is
what the page of the study shows. The options of `python -m benchmarks run` are `run`'s own.
"""

import json
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import beta

ROOT = Path(__file__).parents[1]
Record = dict[str, Any]
Task = tuple[Any, ...]


@dataclass
class Work:
    """How the tasks of a study are done.

    kept : JSON lines, one a task that is done; what stands there is not done again. jobs :
    processes. until : UTC, HH:MM, after which nothing is begun. failed : one line a task that
    raised, which the file does not hold, so that the next call tries it again.
    """

    kept: Path | None = None
    jobs: int = 1
    until: str = ""
    records: list[Record] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    def each(self, function: Callable[..., Any], tasks: Iterable[Task]) -> list[Any]:
        """What the function gives of each task that is done, in the order of the tasks."""
        keys = {_key(function, task): task for task in tasks}
        done = {key: value for key, value in self._read() if key in keys}
        left = {key: task for key, task in keys.items() if key not in done}
        for key, value in self._worked(function, left):
            done[key] = value
            self._keep(key, value)
        found = [done[key] for key in keys if key in done]
        self.records += found
        return found

    def _worked(
        self, function: Callable[..., Any], left: dict[str, Task]
    ) -> Iterator[tuple[str, Any]]:
        if self.jobs == 1:
            for key, task in left.items():
                yield from self._told(key, one(function, task, self.until))
            return
        with ProcessPoolExecutor(self.jobs, mp_context=get_context("spawn")) as pool:
            running = {
                pool.submit(one, function, task, self.until): key for key, task in left.items()
            }
            for future in as_completed(running):
                yield from self._told(running[future], future.result())

    def _told(self, key: str, outcome: tuple[str, Any]) -> Iterator[tuple[str, Any]]:
        what, value = outcome
        if what == "done":
            yield key, value
        if what == "failed":
            self.failed.append(f"{key}: {value}")
            print(self.failed[-1], file=sys.stderr, flush=True)

    def _read(self) -> Iterator[tuple[str, Any]]:
        """Lines kept so far; one that was cut off in the writing is dropped."""
        if self.kept is None or not self.kept.exists():
            return
        whole = self.kept.read_bytes()
        whole = whole[: whole.rfind(b"\n") + 1]
        self.kept.write_bytes(whole)
        for line in whole.splitlines():
            kept = json.loads(line)
            yield kept["task"], kept["record"]

    def _keep(self, key: str, value: Any) -> None:
        if self.kept is None:
            return
        line = json.dumps({"task": key, "commit": commit(), "record": value})
        with self.kept.open("a", encoding="utf-8") as file:
            file.write(line + "\n")


def one(function: Callable[..., Any], task: Task, until: str) -> tuple[str, Any]:
    """ "done" and what came of a task, "failed" and why, or "late"."""
    if until and datetime.now(UTC).strftime("%H:%M") >= until:
        return "late", None
    try:
        return "done", json.loads(json.dumps(function(*task)))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return "failed", f"{type(error).__name__}: {error} ({where.filename}:{where.lineno})"


def _key(function: Callable[..., Any], task: Task) -> str:
    return f"{function.__name__}{json.dumps(task)}"


def commit() -> str:
    """The commit this runs from, with a mark where files differ from it."""
    command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty"]
    asked = subprocess.run(command, capture_output=True, text=True)
    return asked.stdout.strip() or "unknown"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(str(cell) for cell in line) + " |\n" for line in lines)


def interval_95(hits: int, total: int) -> tuple[float, float]:
    """Clopper-Pearson (1934): exact two-sided 95 % interval of a share."""
    low = float(beta.ppf(0.025, hits, total - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.975, hits + 1, total - hits)) if hits < total else 1.0
    return low, high


def share(hits: int, total: int) -> str:
    """The count of a share, and its interval."""
    low, high = interval_95(hits, total)
    return f"{hits} of {total} ({100 * low:.1f} to {100 * high:.1f} %)"


def rms(values: ArrayLike) -> float:
    """Root mean square; NaN of none."""
    squares = np.square(np.asarray(values, dtype=float))
    return float(np.sqrt(np.mean(squares))) if squares.size else float("nan")
