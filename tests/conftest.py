"""One thread of linear algebra for each test process: two workers with two threads each slow small
matrices fortyfold.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
