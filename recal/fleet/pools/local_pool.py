"""Worker processes on this machine, each with a pipe to the parent: one may die without taking the
others along.

A worker that finds its pipe closed ends: a killed parent leaves none behind for longer than the run
it is at.
"""

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from ins.records import InputError
from recal.fleet.pools.journal import Journal
from recal.fleet.records import (
    MERGED,
    FleetOutcome,
    RunOutcome,
    RunTask,
    Task,
    UnitReport,
    UnitTask,
    outcome_of,
)
from recal.service.store import moment

READY = "ready"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
# of a task whose worker died; chosen: one that ends 3 workers is the cause itself
MOST_ATTEMPTS = 3
# tasks after which more than one goes out, whatever they gave; one that goes through compiles the
# kernels for all (11 s, CHANGELOG.md), 3 that fail may not reach them
WARM = 3


@dataclass(frozen=True)
class Done:
    """A task and what came back."""

    task: Task
    result: Any


@dataclass(frozen=True)
class Lost:
    """A task whose worker is gone, and how."""

    task: Task
    why: str


class Pool(Protocol):
    """Where tasks are worked on."""

    @property
    def size(self) -> int:
        """How many tasks are worked on at once."""

    def submit(self, task: Task) -> None: ...

    def wait(self) -> list[Done | Lost]:
        """What ended, at least one; waits for it."""

    def close(self) -> None: ...


@dataclass
class _Worker:
    process: Any
    pipe: Connection
    task: Task | None = None
    ready: bool = False


class LocalPool:
    """`workers` spawned processes, each with one thread of linear algebra; a dead one is
    replaced.
    """

    def __init__(self, workers: int) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._workers = [self._start() for _ in range(workers)]

    @property
    def size(self) -> int:
        return len(self._workers)

    def submit(self, task: Task) -> None:
        idle = next(w for w in self._workers if w.task is None)
        idle.task = task
        try:
            idle.pipe.send(task)
        except OSError:  # it is dead: `wait` finds that out
            pass

    def wait(self) -> list[Done | Lost]:
        ended: list[Done | Lost] = []
        while not ended:
            ready = wait([item for w in self._workers for item in (w.pipe, w.process.sentinel)])
            for k, worker in enumerate(self._workers):
                if worker.pipe in ready or worker.process.sentinel in ready:
                    ended += self._hear(k, worker)
        return ended

    def close(self) -> None:
        for worker in self._workers:
            worker.process.kill()
            worker.process.join()
            worker.pipe.close()

    def _hear(self, k: int, worker: _Worker) -> list[Done | Lost]:
        """What a worker sent before anything else; without a word it is dead and a new one takes
        its place.
        """
        try:
            while worker.pipe.poll():
                message = worker.pipe.recv()
                if message == READY:
                    worker.ready = True
                    continue
                task, worker.task = worker.task, None
                assert task is not None
                return [Done(task, message)]
        except (EOFError, OSError):
            pass
        else:
            if worker.process.exitcode is None:
                return []
        worker.process.join()
        why = _death(worker.process.exitcode)
        if not worker.ready and worker.process.exitcode != -signal.SIGKILL:
            raise InputError(f"a worker process cannot start ({why}); its words are above")
        worker.pipe.close()
        self._workers[k] = self._start()
        return [] if worker.task is None else [Lost(worker.task, why)]

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=serve, args=(theirs,), daemon=True)
        with _one_thread():
            process.start()
        theirs.close()
        return _Worker(process=process, pipe=ours)


def serve(pipe: Connection) -> None:
    """The life of a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    from recal.fleet.pools.work import perform

    try:
        pipe.send(READY)
        while True:
            pipe.send(perform(pipe.recv()))
    except (EOFError, OSError):  # the parent is gone
        return


@contextmanager
def _one_thread() -> Iterator[None]:
    """What a process started in here reads before it loads numpy; two threads for small matrices
    only wait for each other.
    """
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def _death(code: int | None) -> str:
    if code is not None and code < 0:
        try:
            return f"killed by {signal.Signals(-code).name}"
        except ValueError:
            return f"killed by signal {-code}"
    return f"ended with exit code {code}"


class UnitQueue:
    """What is left to do for one unit; done: the outcomes of its runs so far."""

    def __init__(
        self, name: str, tasks: Sequence[RunTask], done: Sequence[RunOutcome], pages: str
    ) -> None:
        self.name, self.outcomes, self.pages = name, list(done), pages
        self.runs = [run for task in tasks for run in task.runs]
        self._tasks = deque(tasks)
        self._summed = False

    def next_task(self) -> Task | None:
        """A run task while there is one, then the summary; None when all is done."""
        if self._tasks:
            merged = tuple((o.sha256, o.path) for o in self.outcomes if o.outcome in MERGED)
            return replace(self._tasks.popleft(), merged=merged)
        if self._summed:
            return None
        self._summed = True
        return self.summary_task()

    def summary_task(self) -> UnitTask:
        ordered = sorted(self.outcomes, key=lambda o: (moment(o.start_utc), o.run_id, o.path))
        unit = ordered[0].unit
        assert unit is not None
        return UnitTask(unit=unit, outcomes=tuple(ordered), pages=self.pages)

    def is_summed(self, summary: UnitReport | None) -> bool:
        """Whether an earlier summary tells of the same outcomes and pages."""
        return summary is not None and summary.of == self.summary_task().identity


def run_all(
    queues: Sequence[UnitQueue], pool: Pool, journal: Journal, told: Callable[[RunOutcome], None]
) -> None:
    """Work through all queues, the longest first; every outcome goes to the journal, then to
    `told`.

    Until a first update has run through, one task goes out at a time: it compiles what the others
    then load.
    """
    waiting = deque(sorted(queues, key=lambda q: -len(q.runs)))
    at_work: dict[Task, UnitQueue] = {}
    again: deque[tuple[Task, UnitQueue]] = deque()
    heard, warm = 0, False
    while True:
        limit = pool.size if warm or heard >= WARM else 1
        while len(at_work) < limit and (again or waiting):
            task, queue = again.popleft() if again else _take(waiting)
            if task is not None:
                at_work[task] = queue
                pool.submit(task)
        if not at_work:
            return
        for event in pool.wait():
            queue = at_work.pop(event.task)
            if isinstance(event, Lost) and event.task.attempt < MOST_ATTEMPTS:
                again.append((replace(event.task, attempt=event.task.attempt + 1), queue))
                continue
            heard, warm = heard + 1, _settle(event, queue, journal, told) or warm
            waiting.appendleft(queue)


def _take(waiting: deque[UnitQueue]) -> tuple[Task | None, UnitQueue]:
    queue = waiting.popleft()
    return queue.next_task(), queue


def _settle(
    event: Done | Lost, queue: UnitQueue, journal: Journal, told: Callable[[RunOutcome], None]
) -> bool:
    """Write down what a task gave; whether one of its runs went through the filter."""
    if isinstance(event.task, UnitTask):
        if isinstance(event, Done):
            journal.add_unit(queue.name, event.result)
        return False
    why = (
        f"worker died {event.task.attempt} times at this run: {event.why}"
        if isinstance(event, Lost)
        else ""
    )
    outcomes = (
        event.result
        if isinstance(event, Done)
        else [
            outcome_of(run, FleetOutcome.CRASHED, why, attempts=event.task.attempt)
            for run in event.task.runs
        ]
    )
    for outcome in outcomes:
        queue.outcomes.append(outcome)
        journal.add_run(outcome)
        told(outcome)
    return any(
        outcome.outcome in MERGED or outcome.outcome == FleetOutcome.INCONSISTENT
        for outcome in outcomes
    )
