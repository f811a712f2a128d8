"""CPU time (user and system, children included) of the commands that a newcomer types first: with
nothing compiled on the machine (an empty NUMBA_CACHE_DIR), and again.

    python benchmarks/first_run.py [COMMAND ...]

COMMAND: demo, update, replay, aided (a replay of a flight with satellite fixes), plan, list; all
of them where none is given. Python's own byte code is made first, as pip makes it on installing.
"""

import compileall
import os
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("ins", "alignment", "trajectories", "infield", "simreal", "recal")


def recal(*arguments: str, folder: Path, cache: Path) -> float:
    """CPU seconds of one command."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
    child = subprocess.Popen(
        [sys.executable, "-m", "recal", *arguments],
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(child.pid, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(f"recal {' '.join(arguments)} failed")
    return usage.ru_utime + usage.ru_stime


def commands(folder: Path, warm: Path) -> dict[str, tuple[str, ...]]:
    """The commands, and what they need laid out in a folder."""
    recal("demo", "-q", folder=folder, cache=warm)
    run, url = "recal-demo/run-1-cold_parked_taxi", "sqlite:///recal-demo/recal.db"
    table = ("table", "export", "--revision", "1", "--store", url, "-o", "t.json")
    recal(*table, folder=folder, cache=warm)
    recal("table", "import", "t.json", folder=folder, cache=warm)
    recal("simulate", "flight", "-o", "flight", "-q", folder=folder, cache=warm)
    return {
        "demo": ("demo", "-q", "--force"),
        "update": ("update", run, "-q", "--force"),
        "replay": ("replay", run, "-q", "--force"),
        "aided": (
            "replay",
            "flight",
            "--store",
            "sqlite:///none.db",
            "-o",
            "aided",
            "-q",
            "--force",
        ),
        "plan": ("plan", "-q", "--force"),
        "list": ("table", "list"),
    }


def main(chosen: list[str]) -> None:
    for place in (*(ROOT / name for name in PACKAGES), Path(sysconfig.get_path("purelib"))):
        compileall.compile_dir(place, quiet=2)
    print(
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; CPU s, nothing compiled and again"
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = commands(folder, folder / "warm")
        for command in chosen or list(made):
            cache = folder / f"cold-{command}"
            cold = recal(*made[command], folder=folder, cache=cache)
            again = min(recal(*made[command], folder=folder, cache=cache) for _ in range(2))
            print(f"{command:8s}{cold:6.1f}{again:6.1f}")


if __name__ == "__main__":
    main(sys.argv[1:])
