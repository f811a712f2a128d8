"""The example of a user's own effect: it follows the protocol, is found by entry point, and a bank
takes it.
"""

import ast
import importlib.util
from pathlib import Path

import pytest

from ins.errors import catalogue as module
from ins.errors.base import Effect
from ins.records import InputError
from simreal.effects import own
from simreal.inference.bank import Bank
from tests.simreal.test_evidence import null_evidence

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_effect.py"


@pytest.fixture
def example():
    spec = importlib.util.spec_from_file_location("own_effect", EXAMPLE)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


class Point:
    def __init__(self, value, name="fan"):
        self.value, self.name = value, name

    def load(self):
        return self.value


def listed(monkeypatch, value):
    monkeypatch.setattr(
        module, "entry_points", lambda group: [Point(value)] if group == module.GROUP else []
    )
    return module.catalogue.__wrapped__()


def test_the_example_gives_its_trace(example):
    assert example.trace_at(8.0) == pytest.approx(8.0)


def test_it_is_found_by_its_entry_point(example, monkeypatch):
    assert isinstance(example.FAN, Effect)
    assert example.FAN in listed(monkeypatch, example.FAN)


def test_what_is_no_effect_or_takes_an_id_in_use_is_refused(example, monkeypatch):
    with pytest.raises(InputError, match="does not follow"):
        listed(monkeypatch, object())
    with pytest.raises(InputError, match="in use"):
        listed(monkeypatch, (example.FAN, example.FAN))


def test_all_that_it_is_written_with_comes_from_one_place():
    """The example takes nothing of `simreal` but names of `simreal.effects.own`."""
    tree = ast.parse(EXAMPLE.read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    (of_effects,) = [node for node in imports if node.module.startswith("simreal")]
    assert of_effects.module == own.__name__
    assert {alias.name for alias in of_effects.names} <= set(own.__all__)


def test_a_bank_takes_it_where_the_runs_taxi(example):
    bank = Bank(null_evidence("trajectories"), (example.FAN,), with_generic=False)
    assert {h.target for h in bank.hypotheses} == set(example.FAN.targets)
    assert (bank.gram.diagonal() > 0).all()
