"""Worker processes killed for real: the task comes back as lost, a new worker does it, nothing is
merged twice.
"""

import os
import signal
import time
from datetime import UTC, datetime

import pytest

from recal.fleet.plan import listed_runs, plan_fleet
from recal.fleet.pools.local_pool import Done, LocalPool, Lost
from recal.fleet.records import RunTask
from tests.recal.fleet.made_fleet import history


@pytest.fixture
def task(fleet):
    (run, _), *_ = plan_fleet(listed_runs(fleet / "runs"), datetime.now(UTC)).units.values()
    return RunTask(
        runs=(run,),
        folders=(str(fleet / "out"),),
        store_url=f"sqlite:///{fleet}/recal.db",
        commit=True,
        propose=None,
        config=None,
        head=1,
    )


def kill(pool, after_s=0.0):
    (worker,) = pool._workers
    # it has loaded everything and waits for a task
    while not worker.pipe.poll() and not worker.ready:
        time.sleep(0.01)
    time.sleep(after_s)
    os.kill(worker.process.pid, signal.SIGKILL)


@pytest.mark.slow  # a lost worker's run is taken again: test_fleet_update.py, without a process
def test_a_worker_killed_midway_loses_nothing(fleet, task):
    pool = LocalPool(1)
    try:
        pool.submit(task)
        kill(pool, after_s=0.3)
        (lost,) = pool.wait()
        assert lost == Lost(task, "killed by SIGKILL")
        pool.submit(task)
        (done,) = pool.wait()
        assert isinstance(done, Done)
        (outcome,) = done.result
        assert outcome.outcome == "committed" and outcome.worker.split(":")[1] != str(os.getpid())
        assert [r.kind for r in history(fleet, "SN-A")] == ["factory", "update"]
    finally:
        pool.close()


def test_an_idle_worker_that_dies_is_replaced(fleet):
    pool = LocalPool(1)
    try:
        kill(pool)
        pool._workers[0].process.join()
        assert pool._hear(0, pool._workers[0]) == []
        assert pool._workers[0].process.is_alive() and pool.size == 1
    finally:
        pool.close()


def test_workers_end_when_the_parent_is_gone(fleet):
    pool = LocalPool(1)
    (worker,) = pool._workers
    worker.pipe.close()
    worker.process.join(timeout=60)
    assert worker.process.exitcode == 0
