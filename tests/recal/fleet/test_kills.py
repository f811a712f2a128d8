"""Real processes killed by SIGKILL (parent, own worker, a worker of a Dask cluster): nothing lost,
nothing twice.
"""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

import recal
from ins.records import InputError
from recal.fleet.pools import dask_pool
from tests.recal.fleet.made_fleet import SERIALS, UPDATES, history

ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": str(Path(recal.__file__).parent.parent),
    "OMP_NUM_THREADS": "1",
}
PATIENCE_S = 300.0


def start(*arguments, folder, module="recal"):
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        cwd=folder,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def fleet_update(folder, *more):
    arguments = (
        "fleet",
        "update",
        "runs",
        "--store",
        "sqlite:///recal.db",
        "--commit",
        "-o",
        "out",
        "--pages",
        "none",
        "--json",
    )
    return start(*arguments, *more, folder=folder)


def journal(folder):
    path = folder / "out" / "journal.jsonl"
    whole = (
        [line for line in path.read_bytes().splitlines(keepends=True) if line.endswith(b"\n")]
        if path.exists()
        else []
    )
    return [line["run"] for line in map(json.loads, whole) if line["event"] == "run"]


def wait_for_runs(folder, count, process):
    end = time.monotonic() + PATIENCE_S
    while len(journal(folder)) < count:
        assert process.poll() is None, process.stderr.read().decode()
        assert time.monotonic() < end
        time.sleep(0.02)
    return journal(folder)


def finished(process):
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err.decode()
    return json.loads(out)


def assert_all_merged_once(folder, document):
    assert document["counts"]["committed"] == UPDATES == sum(document["counts"].values())
    for serial in SERIALS:
        kinds = [revision.kind for revision in history(folder, serial)]
        assert kinds == ["factory", "update", "update"]
    assert all((folder / "out" / run["report"]).exists() for run in document["runs"])


@pytest.mark.slow
def test_a_killed_parent_goes_on_where_it_stopped(fleet):
    first = fleet_update(fleet, "--workers", "2")
    before = wait_for_runs(fleet, 2, first)
    first.kill()
    first.communicate()
    document = finished(fleet_update(fleet, "--workers", "2"))
    assert_all_merged_once(fleet, document)
    kept = {run["path"]: run["worker"] for run in before}
    assert {r["path"]: r["worker"] for r in document["runs"] if r["path"] in kept} == kept


@pytest.mark.slow
def test_a_killed_worker_is_replaced(fleet):
    process = fleet_update(fleet, "--workers", "2")
    os.kill(int(wait_for_runs(fleet, 1, process)[0]["worker"].split(":")[1]), signal.SIGKILL)
    assert_all_merged_once(fleet, finished(process))


@contextmanager
def cluster(folder):
    """A scheduler and two worker processes, each started by itself."""
    pytest.importorskip("distributed")
    told = folder / "scheduler.json"
    processes = [
        start(
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--no-dashboard",
            "--scheduler-file",
            str(told),
            folder=folder,
            module="distributed.cli.dask_scheduler",
        )
    ]
    try:
        while not told.exists():
            assert processes[0].poll() is None, processes[0].stderr.read().decode()
            time.sleep(0.05)
        address = json.loads(told.read_text())["address"]
        processes += [
            start(
                address,
                "--nthreads",
                "1",
                "--no-dashboard",
                "--local-directory",
                str(folder),
                folder=folder,
                module="distributed.cli.dask_worker",
            )
            for _ in range(2)
        ]
        yield address
    finally:
        for process in reversed(processes):
            process.terminate()
            process.communicate()


@pytest.mark.slow
def test_a_killed_worker_of_a_cluster_loses_nothing(fleet, tmp_path):
    scratch = tmp_path / "dask"
    scratch.mkdir()
    with cluster(scratch) as address:
        process = fleet_update(fleet, "--cluster", address)
        killed = wait_for_runs(fleet, 1, process)[0]["worker"]
        os.kill(int(killed.split(":")[1]), signal.SIGKILL)
        document = finished(process)
    assert_all_merged_once(fleet, document)
    assert document["timing"]["where"] == address
    assert len({run["worker"] for run in document["runs"]}) >= 2


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"'strapdown-recal\[cluster\]'"):
        dask_pool.DaskPool("tcp://127.0.0.1:1", [], sqlite=True)


def test_a_worker_must_see_the_files_and_may_not_share_sqlite_over_a_network(tmp_path):
    here = dask_pool.probe([str(tmp_path)])
    assert dask_pool._wrong("tcp://w", here, sqlite=True) == ""
    elsewhere = replace(here, host="another-machine")
    assert "PostgreSQL" in dask_pool._wrong("tcp://w", elsewhere, sqlite=True)
    assert dask_pool._wrong("tcp://w", elsewhere, sqlite=False) == ""
    blind = dask_pool.probe([str(tmp_path), "/no/such/runs"])
    assert "does not see /no/such/runs" in dask_pool._wrong("tcp://w", blind, sqlite=True)
    assert "has recal 9.9" in dask_pool._wrong("tcp://w", replace(here, version="9.9"), sqlite=True)
