"""Seeded blind trials of `recal diagnose`: issue 4, "Figures to reach"::

    python -m benchmarks.gap_study --out TRIALS.jsonl [--cells 12 none ...] [--seeds 0:20]
        [--jobs 1] [--until 16:30]
    python -m benchmarks.gap_study --out TRIALS.jsonl --draw docs [--commit HASH ...] [--speed FILE]

appends a record for each trial as it is done: what was interrupted goes on. --draw writes
gap_study.md, .json and .svg; records of other commits than those asked for only enter the table of
earlier ones.
"""

import argparse
import json
import subprocess
import traceback
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks import gap_study_document
from benchmarks.gap_study_summary import by_commit, miss_line, misses, summarise
from benchmarks.gap_study_trial import CELLS, record_of


def main(arguments: Sequence[str] | None = None) -> None:
    options = _options(arguments)
    if options.draw or options.misses:
        records = read(options.out)
        chosen = [r for r in records if not options.commit or r["commit"] in options.commit]
        if options.misses:
            print("\n".join(miss_line(r) for r in chosen if misses(r)))
        if options.draw:
            earlier = by_commit([r for r in records if r not in chosen])
            speed = options.speed.read_text(encoding="utf-8") if options.speed else ""
            gap_study_document.write(
                {**summarise(chosen), "earlier": earlier, "speed": speed}, options.draw
            )
        return
    done = {(r["cell"], r["seed"]) for r in read(options.out)}
    low, high = (int(v) for v in options.seeds.split(":"))
    tasks = [
        (cell, seed)
        for seed in range(low, high)
        for cell in options.cells
        if (cell, seed) not in done
    ]
    work(tasks, options.out, jobs=options.jobs, until=options.until)


def work(tasks: Sequence[tuple[str, int]], out: Path, *, jobs: int, until: str) -> None:
    """Does the tasks, appending to `out`; hands out no more work after `until` (UTC, HH:MM)."""
    commit = _commit()
    out.parent.mkdir(parents=True, exist_ok=True)
    with (
        ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool,
        out.open("a", encoding="utf-8") as file,
    ):
        running = [pool.submit(one, *task, commit, until) for task in tasks]
        for future in as_completed(running):
            record = future.result()
            if record is not None:
                file.write(json.dumps(record) + "\n")
                file.flush()


def one(cell: str, seed: int, commit: str, until: str) -> dict[str, Any] | None:
    """A record; where the program fails, a record of the failure. None when it is too late to
    begin.
    """
    if until and datetime.now(UTC).strftime("%H:%M") >= until:
        return None
    try:
        return record_of(cell, seed, commit=commit)
    except Exception as error:
        where = traceback.format_exc().strip().splitlines()[-4:]
        return {
            "cell": cell,
            "seed": seed,
            "commit": commit,
            "failed": f"{type(error).__name__}: {error}",
            "at": where,
        }


def read(path: Path) -> list[dict[str, Any]]:
    """Records kept so far; a last line that was cut off is left out."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    return [json.loads(line) for line in lines if line.endswith("\n")]


def _commit() -> str:
    root = Path(__file__).parent
    asked = subprocess.run(
        ["git", "-C", str(root), "rev-parse", "--short", "HEAD"], capture_output=True, text=True
    )
    return asked.stdout.strip() or "unknown"


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_study", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="records, one JSON object a line")
    parser.add_argument("--cells", nargs="+", choices=list(CELLS), default=list(CELLS))
    parser.add_argument("--seeds", default="0:20", help="A:B, B not included")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--until", default="", help="UTC, HH:MM: begin no trial later")
    parser.add_argument(
        "--draw",
        type=Path,
        help="write the page of these records into this folder, and do no trial",
    )
    parser.add_argument(
        "--misses",
        action="store_true",
        help="print the trials that are not as they should be, and do none",
    )
    parser.add_argument("--commit", nargs="+", help="the page is of these commits")
    parser.add_argument(
        "--speed", type=Path, help="what benchmarks.gap_speed printed, for the page"
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    main()
