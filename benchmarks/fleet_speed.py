"""Time of `recal fleet update --commit` with one worker, with two, and with two workers of a Dask
scheduler over TCP.

    python benchmarks/fleet_speed.py FLEET [--runs 24]

FLEET comes from benchmarks/fleet_runs.py. Each way gets a fresh copy of the store and draws no
pages; load averages are printed beside the times, since the machine may be shared. CPU time is that
of the runs themselves.
"""

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": str(Path(__file__).parent.parent),
    "OMP_NUM_THREADS": "1",
}


@contextmanager
def cluster(folder: Path) -> Iterator[str]:
    """The address of a scheduler with two workers, all processes of their own on the loopback
    interface.
    """
    told = folder / "scheduler.json"
    processes = [
        dask(
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--scheduler-file",
            str(told),
            folder=folder,
        )
    ]
    try:
        while not told.exists():
            time.sleep(0.05)
        address = json.loads(told.read_text())["address"]
        processes += [
            dask(
                "worker",
                address,
                "--nthreads",
                "1",
                "--local-directory",
                str(folder),
                folder=folder,
            )
            for _ in range(2)
        ]
        yield address
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def dask(what: str, *arguments: str, folder: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *arguments]
    return subprocess.Popen(command, cwd=folder, env=ENVIRONMENT, stderr=subprocess.DEVNULL)


def timed(fleet: Path, manifest: Path, *options: str) -> str:
    """One fleet update on a copy of the store: wall time of the whole command, then what it says of
    itself.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copy(fleet / "recal.db", folder / "recal.db")
        command = [
            sys.executable,
            "-m",
            "recal",
            "fleet",
            "update",
            str(manifest),
            "--store",
            f"sqlite:///{folder}/recal.db",
            "--commit",
            "--pages",
            "none",
            "-o",
            str(folder / "out"),
            "-q",
            *options,
        ]
        start = time.perf_counter()
        subprocess.run(command, cwd=folder, env=ENVIRONMENT, check=True)
        wall = time.perf_counter() - start
        document = json.loads((folder / "out" / "fleet.json").read_text())
    t, merged = document["timing"], document["counts"]["committed"]
    return (
        f"{wall:6.1f} s wall, {t['runs']} runs ({merged} committed), {t['cpu_s']:.1f} s CPU in the"
        f" runs, median {t['run_cpu_s']['median']:.2f} s CPU a run, load {os.getloadavg()[0]:.1f}"
    )


def main(fleet: Path, count: int) -> None:
    fleet = fleet.resolve()
    runs = sorted(path.parent for path in (fleet / "runs").glob("*/*/run.json"))[:count]
    with tempfile.TemporaryDirectory() as name:
        manifest = Path(name) / "runs.csv"
        with manifest.open("w", newline="") as stream:
            csv.writer(stream).writerows([["path"], *([str(path)] for path in runs)])
        print("1 worker:            ", timed(fleet, manifest, "--workers", "1"), flush=True)
        print("2 workers:           ", timed(fleet, manifest, "--workers", "2"), flush=True)
        with cluster(Path(name)) as address:
            time.sleep(5.0)  # workers join
            print("2 workers over TCP:  ", timed(fleet, manifest, "--cluster", address), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("fleet", type=Path)
    parser.add_argument("--runs", type=int, default=24)
    given = parser.parse_args()
    main(given.fleet, given.runs)
