"""No worker of Arrow lives on when a command ends.

A `std::thread` that is destroyed while it can still be joined ends the process with SIGABRT
(apache/arrow, issue 34314). Reading a Parquet column with `use_threads` left such a worker behind
at the exit of `recal check`.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import recal
from tests.trajectories.run_cases import full_run
from trajectories.runs.directory import write_run

TASKS = Path("/proc/self/task")
AT_EXIT = """
import atexit, json, os, sys

def tell():
    tasks = os.listdir("/proc/self/task")
    names = [open(f"/proc/self/task/{task}/comm").read().strip() for task in tasks]
    print("THREADS " + json.dumps(sorted(names)))

atexit.register(tell)
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
"""
IMPORTS = AT_EXIT + "import numpy, pyarrow, pyarrow.parquet\n"
CHECK = AT_EXIT + (
    "sys.argv = ['recal', 'check', '-q', sys.argv[1]]\nfrom recal.__main__ import main\nmain()\n"
)


def threads_at_exit(code: str, *words: str) -> tuple[int, list[str]]:
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(recal.__file__).parent.parent)},
    )
    return done.returncode, json.loads(done.stdout.rpartition("THREADS ")[2])


@pytest.mark.skipif(not TASKS.is_dir(), reason="threads are listed by Linux")
@pytest.mark.parametrize("broken", [False, True])
def test_check_leaves_no_thread_but_those_of_the_imports(tmp_path, broken):
    write_run(tmp_path / "run", full_run())
    if broken:
        (tmp_path / "run" / "imu.parquet").write_bytes(b"no Parquet")
    code, names = threads_at_exit(CHECK, str(tmp_path / "run"))
    assert code == (3 if broken else 0)
    assert names == threads_at_exit(IMPORTS)[1]
