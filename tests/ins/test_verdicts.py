"""Outcomes, reasons and their codes."""

import doctest
from enum import StrEnum

import pytest

from ins import verdicts
from ins.documents import plain
from ins.verdicts import ReasonCode, because, sentence


class Why(StrEnum):
    MOVES = "moves"


def test_examples_of_the_docstrings():
    assert doctest.testmod(verdicts).failed == 0


def test_a_reason_is_its_code_and_values():
    assert plain(because(Why.MOVES, seconds=3)) == {"code": "moves", "values": {"seconds": 3}}


class Said(ReasonCode):
    CRAB = "crab", "crab {value:+.3g} +- {sigma:.2g} mrad, {other:.3g} deg"


@pytest.mark.parametrize(
    ("value", "sigma", "said"),
    [
        (0.000653, 0.23, "crab +0.00 +- 0.23 mrad"),
        (-0.00732, 0.037, "crab -0.007 +- 0.037 mrad"),
        (12.34, 15.0, "crab +12 +- 15 mrad"),
        (1.5, 0.00123, "crab +1.5 +- 0.0012 mrad"),
        (4e-7, 2.5e-6, "crab +4e-07 +- 2.5e-06 mrad"),
    ],
)
def test_a_value_has_no_more_decimals_than_its_sigma(value, sigma, said):
    shown = sentence(because(Said.CRAB, value=value, sigma=sigma, other=0.123))
    assert shown == f"{said}, 0.123 deg"
