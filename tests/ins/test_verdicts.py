"""Outcomes, reasons and their codes."""

import doctest
from enum import StrEnum

from ins import verdicts
from ins.documents import plain
from ins.verdicts import because


class Why(StrEnum):
    MOVES = "moves"


def test_examples_of_the_docstrings():
    assert doctest.testmod(verdicts).failed == 0


def test_a_reason_is_its_code_and_values():
    assert plain(because(Why.MOVES, seconds=3)) == {"code": "moves", "values": {"seconds": 3}}
