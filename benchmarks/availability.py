"""Does a parked hour end in a table? Hours in every environment, and what became of them.

    python -m benchmarks.availability --count 270 --seed 1 -o availability.jsonl [--workers 1]
    python -m benchmarks.availability -o availability.jsonl [--before FILE] --page docs

appends one record (JSON) for each session that the file does not hold yet, so that it may be
stopped and started again; `--page` writes availability_study.md and its figure. Environments,
technologies, strengths and stations are drawn from the seed and the session's number alone.
"""

import argparse
import json
import subprocess
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.availability_document import Study, write_page
from benchmarks.availability_session import STATIONS, Draw, draw, study_session, yardstick
from ins.records import GYRO_TECHNOLOGIES

ROOT = Path(__file__).parents[1]


def read_records(path: Path | None) -> list[dict[str, Any]]:
    """The records of a study so far; a line that a stopped process left unfinished is left out."""
    if path is None or not path.exists():
        return []
    lines = path.read_text("utf-8").splitlines()
    return [json.loads(line) for line in lines if line.endswith("}")]


def wanted(count: int, seed: int) -> Iterator[Draw]:
    """The yardsticks, then the sessions."""
    for technology in GYRO_TECHNOLOGIES:
        for station in range(STATIONS):
            yield yardstick(technology, station, seed)
    for index in range(count):
        yield draw(index, seed)


def missing(draws: Iterable[Draw], records: Iterable[dict[str, Any]]) -> list[Draw]:
    """Those that have no record."""
    known = {(r["index"], r["seed"], r["technology"]) for r in records}
    return [d for d in draws if (d.index, d.seed, d.technology) not in known]


def run(draws: list[Draw], path: Path, *, workers: int) -> None:
    """Runs the sessions and appends each record when it is there."""
    revision = _revision()
    with path.open("a", encoding="utf-8") as file, ProcessPoolExecutor(workers) as pool:
        for record in pool.map(study_session, draws):
            file.write(json.dumps({**record, "revision": revision}) + "\n")
            file.flush()


def _revision() -> str:
    """The commit this runs from."""
    command = ["git", "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=Path("availability.jsonl"))
    parser.add_argument("--before", type=Path, help="records of an older revision, for the page")
    parser.add_argument("--page", type=Path, help="folder for availability_study.md and .svg")
    options = parser.parse_args()
    if options.count:
        records = read_records(options.output)
        run(
            missing(wanted(options.count, options.seed), records),
            options.output,
            workers=options.workers,
        )
    if options.page:
        study = Study(records=read_records(options.output), before=read_records(options.before))
        write_page(study, options.page)


if __name__ == "__main__":
    main()
