"""A tiny fleet on disk: three units with two parked runs each, simulated once, and a pool that
works in this process.
"""

import shutil
from dataclasses import replace
from pathlib import Path

from infield.store.table_store import TableStore
from recal.fleet.pools.local_pool import Done, Lost
from recal.fleet.pools.work import perform
from recal.fleet.records import Task
from tests.infield.sessions import PARKED, factory_dict, simulated
from trajectories.runs.directory import write_run

SERIALS = ("SN-A", "SN-B", "SN-C")
STARTS = (("ambient", "2026-03-01T05:00:00Z"), ("cold", "2026-04-01T05:00:00Z"))
UPDATES = len(SERIALS) * len(STARTS)


def run_of(serial: str, k: int, **header):
    """The k-th run of a unit; units differ in nothing but their serial."""
    start, start_utc = STARTS[k]
    run = simulated(31 + k, PARKED, start, start_utc).run
    return replace(
        run, header=replace(run.header, imu_serial=serial, run_id=f"{serial}-{k}", **header)
    )


def write_fleet(folder: Path) -> Path:
    """folder/runs with the fleet, folder/recal.db with its factory tables."""
    for serial in SERIALS:
        for k in range(len(STARTS)):
            write_run(folder / "runs" / serial / f"flight-{k}", run_of(serial, k))
    with TableStore.open(f"sqlite:///{folder}/recal.db", create=True) as store:
        for serial in SERIALS:
            store.import_table({**factory_dict(), "imu_serial": serial})
    return folder


def copy_fleet(made: Path, folder: Path) -> Path:
    """A fleet of one's own; times of files kept, as a backup would."""
    return Path(shutil.copytree(made, folder, copy_function=shutil.copy2))


class InlinePool:
    """Works in this process; `spoil(task)` may say how its worker dies, or raise."""

    def __init__(self, workers: int = 1, spoil=lambda task: None) -> None:
        self.spoil, self.size, self.seen = spoil, 1, []
        self._ended: list[Done | Lost] = []

    def submit(self, task: Task) -> None:
        self.seen.append(task)
        why = self.spoil(task)
        self._ended.append(Lost(task, why) if why else Done(task, perform(task)))

    def wait(self) -> list[Done | Lost]:
        ended, self._ended = self._ended, []
        return ended

    def close(self) -> None:
        return None


def history(folder: Path, serial: str):
    with TableStore.open(f"sqlite:///{folder}/recal.db") as store:
        return store.history(serial)
