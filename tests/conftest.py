"""What every test process shares: one thread of linear algebra, byte code that is kept, kernels
that are compiled once.

Two workers with two threads each slow small matrices fortyfold. Without byte code each process
compiles the sources of all libraries again: 30 s of CPU for a collection in place of 10 s, 8 s for
a command of its own in place of 3 s.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BYTE_CODE = ROOT / ".pytest_cache" / "byte_code"
COMPILING = pytest.StashKey[subprocess.Popen]()

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

if sys.dont_write_bytecode:  # the environment wants none beside the sources
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(BYTE_CODE)
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix


def pytest_configure(config: pytest.Config) -> None:
    """The controller of several processes has the kernels compiled while those collect: each of
    them took 36 s to compile what the other one did too.
    """
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        config.stash[COMPILING] = subprocess.Popen(
            [sys.executable, "-m", "tests.compiled"],
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


def pytest_unconfigure(config: pytest.Config) -> None:
    if (compiling := config.stash.get(COMPILING, None)) is not None:
        compiling.terminate()  # of a few tests, done before it
        compiling.wait()
