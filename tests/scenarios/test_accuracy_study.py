"""The accuracy study: a real cell."""

import pytest

from benchmarks import accuracy
from benchmarks.study import Work

CELL = "10 min alignment"


@pytest.mark.slow
def test_a_cell_runs():
    text = accuracy.run(Work(), runs=2, rows=(CELL,), latitudes=(45.0,))
    assert f"| {CELL} |  | yes | 2 |" in text
