"""What a worker does: take a task, call `recal update` on it, say what became of each run. Nothing
it meets stops the fleet.

The worker commits by itself, in the one transaction of `recal update`: killed before it, nothing
has happened; killed after it, the store holds the run, and whoever takes the task again finds that
out.
"""

import os
import socket
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from ins.records import InputError
from ins.verdicts import Outcome
from recal.fleet.records import (
    MERGED,
    FleetOutcome,
    PlannedRun,
    RunOutcome,
    RunTask,
    Task,
    UnitReport,
    outcome_of,
)
from recal.fleet.unit_summary import summarise_unit
from recal.service.results.files import write_text
from recal.service.results.pages import UpdateDocument
from recal.service.store import (
    WORTH_ANOTHER_TRY,
    StoreConflict,
    StoreError,
    StoreRefused,
    TableStore,
    holds_store,
)
from recal.service.update import UpdateRequest, update_in_store

WORTH_A_TRY = [[str(code)] for code in WORTH_ANOTHER_TRY]  # the only reason of a document
# what becomes of the runs of an update that are merged, by its verdict
REST: dict[str, FleetOutcome] = {
    Outcome.COMMITTED: FleetOutcome.COMMITTED,
    Outcome.PROPOSED: FleetOutcome.PROPOSED,
    Outcome.INCONSISTENT: FleetOutcome.AGAIN,
}
CONFLICT_TRIES = 6  # another writer changed this very unit in between, or kept the store busy
Pair = tuple[PlannedRun, str]  # a run and the folder of its report
# a Dask worker may have several threads; drawing and migrations are one per process
_ONE_AT_A_TIME = threading.Lock()


def perform(task: Task) -> tuple[RunOutcome, ...] | UnitReport:
    """RunTask: the outcomes of its runs, in order. UnitTask: the unit's summary."""
    with _ONE_AT_A_TIME:
        return take_runs(task) if isinstance(task, RunTask) else summarise_unit(task)


def take_runs(task: RunTask) -> tuple[RunOutcome, ...]:
    """One update over the task's runs; with several, those that stand in the way of the others are
    left out of it.
    """
    started, cpu = time.perf_counter(), time.process_time()
    found = dict(_outcomes(task, list(zip(task.runs, task.folders))))
    share = len(task.runs)
    seconds = round((time.perf_counter() - started) / share, 4)
    cpu_s = round((time.process_time() - cpu) / share, 4)
    return tuple(
        replace(
            found[run.path],
            seconds=seconds,
            cpu_s=cpu_s,
            worker=f"{socket.gethostname()}:{os.getpid()}",
            attempts=task.attempt,
        )
        for run in task.runs
    )


def _outcomes(task: RunTask, runs: list[Pair]) -> Iterator[tuple[str, RunOutcome]]:
    """Outcomes by path. A run that cannot be read, or contradicts, is told and the rest taken again
    without it.
    """
    while runs:
        told = [o for o in _one_update(task, runs) if o.outcome != FleetOutcome.AGAIN]
        yield from ((outcome.path, outcome) for outcome in told)
        gone = {outcome.path for outcome in told}
        runs = [pair for pair in runs if pair[0].path not in gone]


def _one_update(task: RunTask, runs: Sequence[Pair]) -> list[RunOutcome]:
    """One call of `recal update`, its document as outcomes; whatever it raises is an outcome too.
    At least one is not AGAIN.
    """
    try:
        document = _update(task, runs)
        return list(_told(task, runs, document))
    except Exception as error:
        if len(runs) == 1:
            return [_failed(runs[0], error)]
    failures = [failure for pair in runs if (failure := _failure_alone(task, pair))]
    if failures:
        bad = {failure.path for failure in failures}
        return failures + [
            outcome_of(run, FleetOutcome.AGAIN) for run, _ in runs if run.path not in bad
        ]
    return [
        outcome_of(
            run, FleetOutcome.CRASHED, "breaks down together with the other runs of this unit"
        )
        for run, _ in runs
    ]


def _failure_alone(task: RunTask, pair: Pair) -> RunOutcome | None:
    """Whether a run, not committed, breaks an update by itself."""
    try:
        _update(replace(task, commit=False, propose=None), [pair])
    except Exception as error:
        return _failed(pair, error)
    return None


def _failed(pair: Pair, error: Exception) -> RunOutcome:
    """The outcome of a run on which an update raised."""
    run, folder = pair
    if not Path(run.path).is_dir():
        return outcome_of(
            run,
            FleetOutcome.BAD_INPUT,
            f"{run.path}: no such run directory on {socket.gethostname()}, where the worker is",
        )
    text = (
        f"{error.filename or run.path}: {error.strerror or error}"
        if isinstance(error, OSError)
        else str(error)
    )
    if isinstance(error, StoreError | StoreRefused):  # not the run's fault, worth another call
        return outcome_of(run, FleetOutcome.CRASHED, text)
    if isinstance(error, InputError | OSError):
        return outcome_of(run, FleetOutcome.BAD_INPUT, text)
    return outcome_of(
        run,
        FleetOutcome.CRASHED,
        _crash_words(error),
        folder=folder,
        notes=(*run.notes, *_keep_trace(folder)),
    )


def _update(task: RunTask, runs: Sequence[Pair]) -> UpdateDocument:
    """The update document; tried again where another writer was faster on this unit."""
    first = runs[0][0]
    for attempt in range(CONFLICT_TRIES):
        request = UpdateRequest(
            runs=[Path(run.path) for run, _ in runs],
            store_url=task.store_url,
            commit=task.commit,
            propose=task.propose,
            new_unit=True,  # units that are not asked for get no task
            html=False,
            twin=None if first.twin is None else Path(first.twin),
            config=None if task.config is None else Path(task.config),
            output=Path(runs[0][1]),
        )
        document = update_in_store(request).record
        refused = document.verdict == Outcome.REFUSED
        if not (refused and list(document.reason_codes) in WORTH_A_TRY):
            return document
        time.sleep((1.0 + os.getpid() % 8 / 8.0) * 0.1 * 2**attempt)  # not in step with the others
    raise StoreConflict(document.reasons[0])


def _told(task: RunTask, runs: Sequence[Pair], document: UpdateDocument) -> Iterator[RunOutcome]:
    """The document's sessions as outcomes, one a run; AGAIN for those that only stand beside one
    that contradicts.
    """
    merged = dict(task.merged)
    rest = REST.get(document.verdict, FleetOutcome.REFUSED)
    remembered = document.remembered
    for (run, _), session in zip(runs, document.sessions, strict=True):
        outcome = _outcome(session.outcome, rest)
        contradicts = outcome is FleetOutcome.INCONSISTENT
        notes = (*run.notes, remembered) if contradicts and remembered else run.notes
        refused = outcome is FleetOutcome.REFUSED
        told = outcome_of(
            run,
            outcome,
            *(session.reasons or (document.reasons if refused else ())),
            notes=notes,
            sha256=session.sha256,
            folder=runs[0][1],
            revision=document.revision if outcome is FleetOutcome.COMMITTED else None,
            proposal=document.proposal if outcome is FleetOutcome.PROPOSED else None,
        )
        told = _if_held(task, told, merged.get(told.sha256)) if refused else told
        if told.outcome in MERGED:
            merged[told.sha256] = told.path
        yield told


def _outcome(of_session: str, rest: FleetOutcome) -> FleetOutcome:
    """The outcome of one run, where those that are merged come to `rest`."""
    if of_session == Outcome.INCONSISTENT:
        return FleetOutcome.INCONSISTENT
    if of_session == Outcome.ACCEPTED or rest is FleetOutcome.AGAIN:
        return rest
    return FleetOutcome(of_session)


def _if_held(task: RunTask, outcome: RunOutcome, original: str | None) -> RunOutcome:
    """A refused run that the table holds is no refusal: merged under another path, before, or by a
    worker that was killed.
    """
    if original is not None:
        return replace(
            outcome, outcome=FleetOutcome.ALREADY, reasons=(f"the same recording as {original}",)
        )
    key = task.unit
    if not holds_store(task.store_url):
        return outcome
    with TableStore.open(task.store_url) as store:
        if not store.has_run(outcome.sha256, key.imu_serial):
            return outcome
        history = store.history(*key.key)
    by = next(
        (r for r in reversed(history) if any(run.sha256 == outcome.sha256 for run in r.runs)), None
    )
    if by is None:
        return replace(outcome, outcome=FleetOutcome.ALREADY, reasons=("came with the table",))
    if by.number <= task.head or not by.report_json:
        words = f"merged as revision {by.number} on {by.created_utc[:10]}"
        return replace(outcome, outcome=FleetOutcome.ALREADY, reasons=(words,), revision=by.number)
    write_text(Path(outcome.folder) / "update.json", by.report_json)
    note = "committed before its worker or the call was stopped; found in the store"
    return replace(
        outcome,
        outcome=FleetOutcome.COMMITTED,
        reasons=(),
        revision=by.number,
        notes=(*outcome.notes, note),
    )


def _crash_words(error: Exception) -> str:
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return (
        f"{type(error).__name__}: {str(error)[:300]} ({Path(frame.filename).name}, line"
        f" {frame.lineno})"
    )


def _keep_trace(folder: str) -> tuple[str, ...]:
    """The traceback beside where the report would be."""
    path = Path(folder) / "crash.txt"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, traceback.format_exc())
    except (OSError, InputError):
        return ()
    return (f"traceback in {path.name} of its report folder",)
