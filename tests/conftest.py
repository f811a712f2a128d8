"""What every test process shares: one thread of linear algebra, and byte code that is kept.

Two workers with two threads each slow small matrices fortyfold. Without byte code each process
compiles the sources of all libraries again: 30 s of CPU for a collection in place of 10 s, 8 s for
a command of its own in place of 3 s.
"""

import os
import sys
from pathlib import Path

BYTE_CODE = Path(__file__).parent.parent / ".pytest_cache" / "byte_code"

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

if sys.dont_write_bytecode:  # the environment wants none beside the sources
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(BYTE_CODE)
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
