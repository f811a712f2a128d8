"""Hands tasks to a pool: runs of a unit one after the other, units side by side, what a dead worker
left once more.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from recal.fleet.document_records import UnitReport
from recal.fleet.pools.journal import Journal
from recal.fleet.pools.local_pool import Done, Lost, Pool
from recal.fleet.records import (
    MERGED,
    FleetOutcome,
    RunOutcome,
    RunTask,
    Task,
    UnitTask,
    outcome_of,
)
from recal.service.store import moment

# of a task whose worker died; chosen: one that ends 3 workers is the cause itself
MOST_ATTEMPTS = 3
# tasks after which more than one goes out, whatever they gave; one that goes through compiles the
# kernels for all (11 s, CHANGELOG.md), 3 that fail may not reach them
WARM = 3


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
