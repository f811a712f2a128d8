"""Wall time, CPU time and memory of `recal update` on a 70 min parked and 13 min taxi log at 100
Hz, once compiled.

    python benchmarks/update_speed.py [REPEATS]

Ratios, within one run of this script: to the length of the log, and to the time that reading the
log alone takes.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def recal(*arguments: str, folder: Path) -> tuple[float, float, float]:
    """Run one command; wall and CPU seconds and the largest resident memory in MB."""
    start = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, "-m", "recal", *arguments], cwd=folder, stderr=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(child.pid, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(f"recal {' '.join(arguments)} failed")
    return time.perf_counter() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0


def main(repeats: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recal(
            "simulate",
            "cold_parked_taxi",
            "-o",
            "run",
            "--table-out",
            "table.json",
            "-q",
            folder=folder,
        )
        recal("table", "import", "table.json", folder=folder)
        recal("update", "run", "-q", folder=folder)  # compiles
        updates = [recal("update", "run", "-q", folder=folder) for _ in range(repeats)]
        reads = [recal("check", "run", folder=folder)[0] for _ in range(repeats)]
    wall, cpu, memory = (statistics.median(column) for column in zip(*updates))
    length = 4965.0
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {repeats} repeats, medians")
    print(f"recal update, 83 min at 100 Hz: {wall:.2f} s wall, {cpu:.2f} s CPU, {memory:.0f} MB")
    print(
        f"{length / wall:.0f} times real time; {wall / statistics.median(reads):.1f} times `recal"
        " check` of the same log"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
