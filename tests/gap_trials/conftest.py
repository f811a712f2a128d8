import pytest

from benchmarks.gap_trials.trial import draw_trial
from tests.gap_trials.cases import SHORT_S, SOURCES


@pytest.fixture(scope="module", params=SOURCES)
def short(request):
    """Four short runs with a taxi and no effect."""
    return draw_trial(7, effects=0, source=request.param, parked_s=SHORT_S)


@pytest.fixture(scope="module", params=SOURCES)
def parked(request):
    return draw_trial(11, plan="four_parked", effects=0, source=request.param)
