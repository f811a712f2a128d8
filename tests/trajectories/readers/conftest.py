"""A child that is forked, for tests that read hundreds of damaged files: it does all that the
program's own does but start Python and load the library.
"""

import faulthandler
import os
import traceback
import warnings

import pytest

from trajectories.readers import contained


def fork(request, arrays, errors):
    """As `contained._run`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside threads
        child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    code = 1
    faulthandler.disable()
    try:
        os.dup2(arrays.fileno(), 1)
        os.dup2(errors.fileno(), 2)
        contained.answer(request)
        code = 0
    except BaseException:
        os.write(2, traceback.format_exc().encode())
    finally:
        os._exit(code)


@pytest.fixture
def forked(monkeypatch):
    monkeypatch.setattr(contained, "_run", fork)
    import trajectories.readers.containers.mat_hdf5
    import trajectories.readers.containers.mat_level5  # noqa: F401 (loaded once for all)
