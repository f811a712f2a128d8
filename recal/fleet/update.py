"""The spine of `recal fleet update`: list the runs -> order them by unit -> skip what is done ->
hand out -> sum up.

In a commit each run of a unit is an update of its own, one after the other, as an engineer would: a
run that contradicts is left out and remembered and the next one still counts, each revision can be
rolled back alone, a kill costs one run. A proposal must stand on the active table, so it is one
joint update of all the unit's runs (less those that contradict); so is a commit with `joint`.
"""

import hashlib
import re
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from ins.documents import to_json
from recal.fleet.document import Timing, fleet_document
from recal.fleet.document_records import CallTiming, FleetReport, FleetTiming, UnitReport
from recal.fleet.manifest import listed_runs
from recal.fleet.plan import plan_fleet
from recal.fleet.pools.dispatch import UnitQueue, run_all
from recal.fleet.pools.journal import Journal
from recal.fleet.pools.local_pool import LocalPool, Pool
from recal.fleet.records import (
    CallSettings,
    FleetOutcome,
    FleetRequest,
    PlannedRun,
    RunOutcome,
    RunTask,
    outcome_of,
)
from recal.fleet.report import fleet_html
from recal.service.inputs.listings import read_small_text
from recal.service.inputs.records import twin_fit_command
from recal.service.results.files import output_directory, program_version, write_files
from recal.service.store import (
    TableStore,
    UnitKey,
    UnitRecord,
    absolute_store,
    holds_store,
    moment,
    store_name,
)

HELD = (FleetOutcome.COMMITTED, FleetOutcome.TAKEN_OUT)  # that the store held once
LONGEST = 80  # characters kept of a name


@dataclass(frozen=True)
class Watcher:
    """Who is told of the progress: how many runs there are and are done already, then each
    outcome.
    """

    begins: Callable[[int, int], None] = lambda total, done: None
    told: Callable[[RunOutcome], None] = lambda outcome: None


def update_fleet(request: FleetRequest, watcher: Watcher | None = None) -> FleetReport:
    """Update every unit from its runs; writes fleet.json and fleet.html and returns the document
    (recal.fleet/1).
    """
    watcher, now, started = watcher or Watcher(), datetime.now(UTC), time.perf_counter()
    plan = plan_fleet(listed_runs(request.source), now)
    store_url, store_file = absolute_store(request.store_url)
    request = replace(
        request, store_url=store_url, output=output_directory(request.output, "fleet").absolute()
    )
    known = _known_units(request)
    heads = {str(key): record.active.number for key, record in known.items()}
    journal = Journal(request.output, _settings(request), heads)
    try:
        set_aside = [*plan.set_aside, *_without_table(request, plan.units, known)]
        units = {
            key: runs
            for key, runs in plan.units.items()
            if not request.refuses_new_units or key in known
        }
        units = {key: tuple(_noted(run, known) for run in runs) for key, runs in units.items()}
        _look_again(journal, store_url)
        queues = [
            queue for key, runs in units.items() if (queue := _queue(request, journal, key, runs))
        ]
        done = sum(len(runs) for runs in units.values()) - sum(len(queue.runs) for queue in queues)
        watcher.begins(sum(map(len, units.values())) + len(set_aside), done + len(set_aside))
        timing = Timing()
        if queues:
            _work(request, queues, journal, timing, watcher, store_file)
        journal.end(timing.document(time.perf_counter() - started))
        spent = timing.document(time.perf_counter() - started)
        document = _document(request, journal, units, set_aside, spent)
    finally:
        journal.close()
    pages = {
        request.output / "fleet.json": to_json(document),
        request.output / "fleet.html": fleet_html(document),
    }
    write_files(pages)
    return document


def _work(
    request: FleetRequest,
    queues: Sequence[UnitQueue],
    journal: Journal,
    timing: Timing,
    watcher: Watcher,
    store_file: str | None,
) -> None:
    pool = _pool(request, queues, store_file)
    timing.workers, timing.where = pool.size, request.cluster or "processes on this machine"

    def told(outcome: RunOutcome) -> None:
        timing.tell(outcome)
        watcher.told(outcome)

    try:
        run_all(queues, pool, journal, told)
    finally:
        pool.close()


def _pool(request: FleetRequest, queues: Sequence[UnitQueue], store_file: str | None) -> Pool:
    if not request.cluster:
        return LocalPool(max(1, min(request.workers, len(queues))))
    from recal.fleet.pools.dask_pool import DaskPool, sample_paths

    runs = [run.path for queue in queues for run in queue.runs]
    return DaskPool(
        request.cluster,
        sample_paths(request.output, runs, store_file),
        sqlite=store_file is not None,
    )


def _known_units(request: FleetRequest) -> dict[UnitKey, UnitRecord]:
    """Units with a table; a store that is going to be written is
    migrated here, once, or made where it is asked for.
    """
    if not (request.new_store and request.mode != "dry") and not holds_store(request.store_url):
        return {}
    with TableStore.open(request.store_url, create=request.mode != "dry") as store:
        return {record.unit: record for record in store.units()}


def _settings(request: FleetRequest) -> CallSettings:
    config = None
    if request.config:
        config = hashlib.sha256(read_small_text(request.config).encode()).hexdigest()
    return CallSettings(
        store=store_name(request.store_url),
        mode=request.mode,
        joint=request.jointly,
        config=config,
        version=program_version(),
    )


def _without_table(
    request: FleetRequest, units: dict[UnitKey, tuple[PlannedRun, ...]], known: Collection[UnitKey]
) -> list[RunOutcome]:
    """Runs of units that the store does not hold, where those are refused."""
    if not request.refuses_new_units:
        return []
    words = "the store holds no table of this unit: recal table import TABLE, or --new-unit"
    if request.known_only:
        words = "the store holds no table of this unit, and --known-only was given"
    elif not request.new_store and not holds_store(request.store_url):
        words = (
            f"no store at {store_name(request.store_url)}: recal table import TABLE makes one, or"
            " --new-store with --new-unit"
        )
    return [
        outcome_of(run, FleetOutcome.REFUSED, words)
        for key, runs in units.items()
        if key not in known
        for run in runs
    ]


def _noted(run: PlannedRun, known: Mapping[UnitKey, UnitRecord]) -> PlannedRun:
    """The run with what its update rests on beside the log itself."""
    record, notes = known.get(run.unit), list(run.notes)
    if record is None:
        notes.append(
            "unit without a table in the store: it begins with the default of its technology"
        )
    if run.twin is None and (record is None or not record.has_twin):
        notes.append(
            "unit without a noise model: sigma rests on the defaults of"
            f" {run.unit.gyro_technology}; {twin_fit_command(())} measures it, then recal table"
            " import TABLE --twin twin.json"
        )
    return replace(run, notes=tuple(notes))


def _look_again(journal: Journal, store_url: str) -> None:
    """Runs that an earlier call committed and the store does not hold any more: a rollback is
    somebody's decision.
    """
    committed = [o for o in journal.runs.values() if o.outcome in HELD]
    if not committed or not holds_store(store_url):
        return
    words = "rolled back since, or the store was replaced; with another -o the run is taken anew"
    with TableStore.open(store_url) as store:
        for o in committed:
            held = store.has_run(o.sha256, o.imu_serial)
            if held != (o.outcome == FleetOutcome.COMMITTED):
                journal.add_run(
                    replace(
                        o,
                        outcome=FleetOutcome.COMMITTED if held else FleetOutcome.TAKEN_OUT,
                        reasons=() if held else (words,),
                    )
                )


def _queue(
    request: FleetRequest, journal: Journal, key: UnitKey, runs: Sequence[PlannedRun]
) -> UnitQueue | None:
    """What is left to do for a unit; None where its runs and its summary are done."""
    name = unit_folder(key)
    done = {
        run.path: o for run in runs if (o := journal.runs.get(run.path)) and _still_holds(o, run)
    }
    left = [run for run in runs if run.path not in done]
    if left and request.jointly:
        left, done = list(runs), {}
    folders = [str(request.output / "units" / name / run_folder(run)) for run in left]
    everything = RunTask(
        runs=tuple(left),
        folders=tuple(folders),
        store_url=request.store_url,
        commit=request.mode == "commit",
        head=journal.heads.get(str(key), 0),
        propose=(request.by, request.note) if request.mode == "propose" else None,
        config=str(request.config.absolute()) if request.config else None,
    )
    if request.jointly:
        joint = str(request.output / "units" / name / "joint")
        tasks = [replace(everything, folders=(joint,) * len(left))] if left else []
    else:
        tasks = [
            replace(everything, runs=(run,), folders=(folder,))
            for run, folder in zip(left, folders)
        ]
    queue = UnitQueue(name, tasks, list(done.values()), request.pages)
    return None if not tasks and queue.is_summed(journal.units.get(name)) else queue


def _still_holds(outcome: RunOutcome, run: PlannedRun) -> bool:
    return (
        outcome.signature == run.signature
        and outcome.outcome != FleetOutcome.CRASHED
        and outcome.unit == run.unit
    )


def _document(
    request: FleetRequest,
    journal: Journal,
    units: dict[UnitKey, tuple[PlannedRun, ...]],
    set_aside: Sequence[RunOutcome],
    timing: CallTiming,
) -> FleetReport:
    outcomes = [*(journal.runs[run.path] for runs in units.values() for run in runs), *set_aside]
    summaries = {key: journal.units.get(unit_folder(key), UnitReport()) for key in units}
    return fleet_document(
        request, outcomes, summaries, FleetTiming(**vars(timing), earlier_calls=journal.calls)
    )


def unit_folder(key: UnitKey) -> str:
    """A folder name for a unit."""
    return _safe("-".join(filter(None, (key.imu_serial, key.gyro_technology, key.gyro_mode))))


def run_folder(run: PlannedRun) -> str:
    """A folder name for a run's report, in time order among those of its unit."""
    stamp = moment(run.start_utc).astimezone(UTC).strftime("%Y%m%dT%H%M%SZ")
    return f"{stamp}-{_safe(run.run_id)}-{hashlib.sha256(run.path.encode()).hexdigest()[:6]}"


def _safe(text: str) -> str:
    """The text where it is a plain name, else what is left of it with digits of its hash, so that
    no two are the same.
    """
    safe = re.sub(r"[^A-Za-z0-9._-]", "_", text)[:LONGEST]
    return (
        safe
        if safe == text and not text.startswith(".")
        else f"_{safe}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    )
