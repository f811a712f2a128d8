"""Estimator sigma, actual RMS error and Cramer-Rao bound of each gyro, for all rows of physics.md
6.7 and the realistic taxi.

    python -m benchmarks.accuracy_study [--runs 50] [--rows NAME ...] [--latitudes 0 45 ...]
        [--jobs 2] [-o docs]

writes accuracy.md, .json and .svg. Scores are kept in RUNS.jsonl (--keep) as they come, a few seeds
of every cell at a time: what was interrupted goes on, more --runs add to it, and --draw draws what
stands. All seeded.
"""

import argparse
import json
import os
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from datetime import UTC, datetime
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks import accuracy_cell, accuracy_document, accuracy_summary

CHUNK = 5  # seeds of a cell worked at once


def main(arguments: Sequence[str] | None = None) -> None:
    options = _options(arguments)
    kept = read(options.keep)
    if not options.draw:
        work(options.keep, kept, options)
        kept = read(options.keep)
    study = accuracy_summary.summarise(kept, list(accuracy_cell.ROWS))
    options.output.mkdir(parents=True, exist_ok=True)
    accuracy_document.write(study, options.output)


def work(path: Path, kept: list[dict[str, Any]], options: argparse.Namespace) -> None:
    """Does what is not kept yet, appending to `path`; stops handing out work at --until."""
    if path.exists():
        whole = path.read_bytes()
        # a line that was cut off would spoil the next
        path.write_bytes(whole[: whole.rfind(b"\n") + 1])
    tasks, running = iter(_tasks(kept, options)), set[Future]()
    with (
        ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool,
        path.open("a") as out,
    ):
        while True:
            late = options.until and datetime.now(UTC).strftime("%H:%M") >= options.until
            running |= {
                pool.submit(_one, *task)
                for task in islice(tasks, 0 if late else options.jobs + 1 - len(running))
            }
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for one in done:
                out.writelines(json.dumps(line) + "\n" for line in one.result())
            out.flush()


def read(path: Path) -> list[dict[str, Any]]:
    """Lines kept so far; a last one that was cut off is left out."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    return [json.loads(line) for line in lines if line.endswith("\n")]


Task = tuple[str, str, float, int, int]  # what, row, latitude, seeds from, to


def _tasks(kept: list[dict[str, Any]], options: argparse.Namespace) -> list[Task]:
    """What is not kept yet: bounds first, then a few seeds of every cell, then a few more."""
    done = {(line["row"], line["lat_deg"], line.get("seed", -1)) for line in kept}
    cells = [
        (name, lat)
        for lat in options.latitudes
        for name in options.rows
        if accuracy_cell.ways(accuracy_cell.ROWS[name], lat)
    ]
    tasks: list[Task] = [("bounds", *cell, -1, 0) for cell in cells]
    for first in range(0, options.runs, CHUNK):
        tasks += [("sessions", *cell, first, min(first + CHUNK, options.runs)) for cell in cells]
    missing = [
        [seed for seed in range(t[3], t[4]) if (t[1], t[2], seed) not in done] for t in tasks
    ]
    return [(*t[:3], seeds[0], t[4]) for t, seeds in zip(tasks, missing) if seeds]


def _one(what: str, name: str, lat_deg: float, first: int, stop: int) -> list[dict[str, Any]]:
    if what == "bounds":
        return accuracy_cell.bounds(name, lat_deg)
    return accuracy_cell.sessions(name, lat_deg, range(first, stop))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=50, help="seeds of each cell")
    parser.add_argument(
        "--rows",
        nargs="+",
        default=list(accuracy_cell.ROWS),
        choices=list(accuracy_cell.ROWS),
        metavar="NAME",
    )
    parser.add_argument(
        "--latitudes",
        nargs="+",
        type=float,
        default=list(accuracy_cell.LATITUDES_DEG),
        metavar="DEG",
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--until", default="", metavar="HH:MM", help="hand out no more work after this time, UTC"
    )
    parser.add_argument(
        "--keep", type=Path, default=Path("accuracy_runs.jsonl"), metavar="RUNS.jsonl"
    )
    parser.add_argument("--draw", action="store_true", help="only draw what is kept")
    parser.add_argument("-o", "--output", type=Path, default=Path("docs"))
    return parser.parse_args(arguments)


if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # of the workers, which start afresh
    main()
