"""Wall time, CPU time and memory of one diagnosis: four runs of an hour at 10 Hz, each with a taxi.

    python -m benchmarks.gap_speed [REPEATS] [--seed 0] [--sigma 12] [--effect NAME] [--command]

Each repeat is a process of its own that reads the runs from files and calls `diagnose`; BLAS may
use all cores. --command: the command `recal diagnose` instead, with its imports, advice and pages.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.gap_size import scaled
from benchmarks.gap_trials.trial import draw_trial
from benchmarks.gap_trials.written import write_trial
from infield.table.file import read_table
from ins.twin_file import read_twin
from simreal.inference.diagnosis import diagnose
from trajectories.runs.directory import read_run


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_speed", description=__doc__)
    parser.add_argument("repeats", type=int, nargs="?", default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--sigma", type=float, default=12.0, help="size of the one effect that is planted"
    )
    parser.add_argument("--effect", help="to be planted; else one is drawn")
    parser.add_argument("--command", action="store_true", help="measure the whole command")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        _one(options.one)
        return
    with tempfile.TemporaryDirectory() as name:
        names = [options.effect] if options.effect else None
        trial = draw_trial(options.seed, names=names)
        write_trial(scaled(trial, options.sigma)[0], Path(name))
        if options.command:
            spent = [_whole(Path(name) / "blind") for _ in range(options.repeats)]
            wall, cpu, memory = (statistics.median(column) for column in zip(*spent))
            print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
            print(f"recal diagnose {wall:.1f} s wall, {cpu:.1f} s CPU, {memory:.0f} MB at most")
            return
        results = [_measured(Path(name) / "blind") for _ in range(options.repeats)]
    reading, wall, cpu, memory = (statistics.median(column) for column in zip(*results))
    print(
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {options.repeats} repeats, medians"
    )
    print(
        f"reading four runs {reading:.1f} s, diagnosis {wall:.1f} s wall, {cpu:.1f} s CPU,"
        f" {memory:.0f} MB at most"
    )


def _measured(folder: Path) -> tuple[float, float, float, float]:
    """Seconds to read, of the diagnosis (wall, CPU), and the largest resident memory in MB."""
    command = [sys.executable, "-m", "benchmarks.gap_speed", "--one", str(folder)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    said = child.stdout.read()
    _, status, usage = os.wait4(child.pid, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit("the diagnosis failed")
    reading, wall, cpu = (float(v) for v in said.split())
    return reading, wall, cpu, usage.ru_maxrss / 1024.0


def _whole(folder: Path) -> tuple[float, float, float]:
    """Seconds of the command (wall, CPU), and the largest resident memory in MB."""
    runs = [str(path) for path in sorted(folder.glob("run-*"))]
    told = ["--twin", str(folder / "twin.json"), "-o", str(folder / "out"), "--force", "-q"]
    start = time.perf_counter()
    child = subprocess.Popen([sys.executable, "-m", "recal", "diagnose", *runs, *told])
    _, status, usage = os.wait4(child.pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 1):
        raise SystemExit("the command failed")
    cpu = usage.ru_utime + usage.ru_stime
    return time.perf_counter() - start, cpu, usage.ru_maxrss / 1024.0


def _one(folder: Path) -> None:
    start = time.perf_counter()
    runs = [read_run(path) for path in sorted(folder.glob("run-*"))]
    twin, table = read_twin(folder / "twin.json"), read_table(folder / "table.json")
    read, used = time.perf_counter(), time.process_time()
    diagnose(runs, twin, table)
    print(read - start, time.perf_counter() - read, time.process_time() - used)


if __name__ == "__main__":
    main()
