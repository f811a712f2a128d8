"""What the program costs: CPU time, wall time and memory of its commands and of its filters.

A command runs in a process of its own, launched from a small one: its ru_maxrss begins with that of
the process that starts it. `first`: the commands that a newcomer types first, with nothing compiled
on the machine and again. `update`: 83 min at 100 Hz. `aided`: a flight at 200 Hz with GNSS at 1 Hz,
in memory, beside free-inertial navigation of the same log; the last row of sensors eight times and
fixes three times as noisy as declared, so that the noise is searched for. `diagnose`: four runs of
an hour at 10 Hz with one planted effect of 12 sigma. `memory`: what reads a run, on flights of some
hours at 200 Hz.
"""

import compileall
import os
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.gap_size import scaled
from benchmarks.gap_trials.trial import draw_trial
from benchmarks.gap_trials.written import write_trial
from benchmarks.long_flight import make_run
from benchmarks.study import ROOT, Work, table
from infield.aided.flight import navigate_aided
from infield.session.log import find_rest
from ins.records import NavState
from ins.strapdown.mechanization import navigate
from ins.twin_file import default_twin
from tests.infield.aided_cases import FLIGHT, SITE, flown
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Cruise, Park
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.truth import build_truth

PACKAGES = ("ins", "alignment", "trajectories", "infield", "simreal", "recal")
LIMIT_MB = 1000.0
UPDATED_S = 4965.0  # of the log that is updated
HEAD = ("command", "wall s", "CPU s", "peak MB")
Row = tuple[str, ...]
LAUNCH = """
import os, subprocess, sys, time
start = time.perf_counter()
child = subprocess.Popen(sys.argv[1:], stdout=sys.stderr)
_, status, usage = os.wait4(child.pid, 0)
print(time.perf_counter() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0)
sys.exit(os.waitstatus_to_exitcode(status))
"""


class Use(NamedTuple):
    """What a command took."""

    wall_s: float
    cpu_s: float
    peak_mb: float

    def row(self, name: str) -> Row:
        return name, f"{self.wall_s:.1f}", f"{self.cpu_s:.1f}", f"{self.peak_mb:.0f}"


def recal(*arguments: str, folder: Path, cache: Path | None = None) -> Use:
    """Run one command; SystemExit unless it ends well. cache: of what is compiled."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    environment |= {"NUMBA_CACHE_DIR": str(cache)} if cache else {}
    command = [sys.executable, "-c", LAUNCH, sys.executable, "-m", "recal", *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"recal {' '.join(arguments)} failed:\n{done.stderr}")
    return Use(*map(float, done.stdout.split()))


def median(uses: list[Use]) -> Use:
    return Use(*(statistics.median(column) for column in zip(*uses)))


def newcomer(folder: Path, warm: Path) -> Mapping[str, tuple[str, ...]]:
    """The first commands, and what they need laid out in a folder."""
    recal("demo", "-q", folder=folder, cache=warm)
    run, url = "recal-demo/run-1-cold_parked_taxi", "sqlite:///recal-demo/recal.db"
    export = ("table", "export", "--revision", "1", "--store", url, "-o", "t.json")
    recal(*export, folder=folder, cache=warm)
    recal("table", "import", "t.json", folder=folder, cache=warm)
    recal("simulate", "flight", "-o", "flight", "-q", folder=folder, cache=warm)
    aided = ("replay", "flight", "--store", "sqlite:///none.db", "-o", "aided")
    return {
        "demo": ("demo", "-q", "--force"),
        "update": ("update", run, "-q", "--force"),
        "replay": ("replay", run, "-q", "--force"),
        "replay of a flight with fixes": (*aided, "-q", "--force"),
        "plan": ("plan", "-q", "--force"),
        "table list": ("table", "list"),
    }


def first(folder: Path, repeats: int, minutes: float, hours: tuple[float, ...]) -> Iterator[Row]:
    for place in (*(ROOT / name for name in PACKAGES), Path(sysconfig.get_path("purelib"))):
        compileall.compile_dir(place, quiet=2)
    for number, (name, words) in enumerate(newcomer(folder, folder / "warm").items()):
        cache = folder / f"cold-{number}"
        yield recal(*words, folder=folder, cache=cache).row(f"{name}, nothing compiled")
        uses = [recal(*words, folder=folder, cache=cache) for _ in range(repeats)]
        yield min(uses, key=lambda use: use.cpu_s).row(f"{name}, again")


def update(folder: Path, repeats: int, minutes: float, hours: tuple[float, ...]) -> Iterator[Row]:
    made = ("simulate", "cold_parked_taxi", "-o", "run", "--table-out", "table.json", "-q")
    for words in (made, ("table", "import", "table.json"), ("update", "run", "-q")):
        recal(*words, folder=folder)
    use = median([recal("update", "run", "-q", folder=folder) for _ in range(repeats)])
    check = median([recal("check", "run", folder=folder) for _ in range(repeats)])
    yield use.row(f"update, 83 min at 100 Hz: {UPDATED_S / use.wall_s:.0f} times real time")
    yield check.row("check of the same log")


def diagnose(folder: Path, repeats: int, minutes: float, hours: tuple[float, ...]) -> Iterator[Row]:
    write_trial(scaled(draw_trial(0), 12.0)[0], folder)
    runs = [str(path) for path in sorted((folder / "blind").glob("run-*"))]
    words = ("--twin", str(folder / "blind" / "twin.json"), "-o", "out", "--force", "-q")
    uses = [recal("diagnose", *runs, *words, folder=folder) for _ in range(repeats)]
    yield median(uses).row("diagnose, four hours at 10 Hz")


def memory(folder: Path, repeats: int, minutes: float, hours: tuple[float, ...]) -> Iterator[Row]:
    for each in hours:
        place = folder / f"{each:g}"
        place.mkdir()
        make_run(place, each)
        for command, use in measure(place).items():
            yield use.row(f"{command}, {each:g} h at 200 Hz")


def measure(folder: Path) -> dict[str, Use]:
    """Check, align, replay and update of `folder`/run against the table beside it."""
    recal("table", "import", "table.json", folder=folder)
    commands = ("check", "align", "replay", "update")
    return {command: recal(command, "run", folder=folder) for command in commands}


def aided(folder: Path, repeats: int, minutes: float, hours: tuple[float, ...]) -> Iterator[Row]:
    cruise = Cruise(duration_s=max(60.0 * minutes - 730.0, 10.0))
    truth = build_truth(lay([Park(duration_s=300.0), *FLIGHT, cruise]), SITE, heading_rad=2.0)
    base, twin = ideal_sensors(truth, 200.0), default_twin("rlg")
    run = flown(base, twin, 1).run
    start = NavState(time_s=0.0, site=SITE, v_n_m_s=np.zeros(3), C_nb=base.C_nb[0])
    gyro = replace(twin.gyro, arw_deg_sqrt_h=8.0 * twin.gyro.arw_deg_sqrt_h)
    gnss = replace(twin.gnss, sigma_horizontal_m=3.0 * twin.gnss.sigma_horizontal_m)
    loud = flown(base, replace(twin, gyro=gyro, gnss=gnss), 1).run
    loud = replace(loud, gnss=replace(loud.gnss, sigma_horizontal_m=None))

    def fly(log):
        return navigate_aided(log, log.imu, twin, rest=find_rest(log), gyro_sigma_deg_h=None)

    works: dict[str, Callable[[], object]] = {
        "free-inertial navigation": lambda: navigate(run.imu.pieces(), start),
        "aided: stands, start, filter, verdict": lambda: fly(run),
        "smoothing it": fly(run).with_smoothed,
        "aided, the noise searched for": lambda: fly(loud),
    }
    for name, work in works.items():
        work()
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        work()
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        times = f"{minutes:.0f} min at 200 Hz, {run.imu.end_s / cpu_s:.0f} times real time"
        yield f"{name}, {times}", f"{wall_s:.2f}", f"{cpu_s:.2f}", ""


PARTS = {"first": first, "update": update, "aided": aided, "diagnose": diagnose, "memory": memory}


def part(name: str, repeats: int, minutes: float, hours: list[float]) -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        return list(PARTS[name](Path(folder), repeats, minutes, tuple(hours)))


def run(
    work: Work,
    *,
    parts: tuple[str, ...] = tuple(PARTS),
    repeats: int = 3,
    minutes: float = 60.0,
    hours: tuple[float, ...] = (1.0, 10.0),
) -> str:
    """minutes: of the aided flight; hours: of the flights whose memory is measured."""
    machine = f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, medians of {repeats}."
    found = work.each(part, [(name, repeats, minutes, list(hours)) for name in parts])
    return f"{machine}\n\n" + table(HEAD, [row for rows in found for row in rows])
