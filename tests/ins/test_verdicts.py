"""Records as JSON holds them."""

import doctest
import json
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ins import verdicts
from ins.verdicts import Outcome, because, plain


class Why(StrEnum):
    MOVES = "moves"


@dataclass(frozen=True)
class Inner:
    sigma_deg_h: np.ndarray
    outcome: Outcome


@dataclass(frozen=True)
class Outer:
    inner: tuple[Inner, ...]
    by_axis: dict[str, float]


def test_examples_of_the_docstrings():
    assert doctest.testmod(verdicts).failed == 0


def test_nested_records_become_json():
    record = Outer((Inner(np.array([1.0, 2.0]), Outcome.REFUSED),), {"x": np.float64(0.5)})
    text = json.dumps(plain(record))
    assert json.loads(text) == {
        "inner": [{"sigma_deg_h": [1.0, 2.0], "outcome": "refused"}],
        "by_axis": {"x": 0.5},
    }


def test_a_reason_is_its_code_and_values():
    assert plain(because(Why.MOVES, seconds=3)) == {"code": "moves", "values": {"seconds": 3}}
