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
    name, value = "fan", "fans:FAN"

    def __init__(self, group, loaded):
        self.group, self.loaded = group, loaded

    def load(self):
        if isinstance(self.loaded, Exception):
            raise self.loaded
        return self.loaded


def listed(monkeypatch, value, groups=module.GROUPS[:1]):
    """The catalogue with an entry point in some groups."""
    monkeypatch.setattr(
        module, "entry_points", lambda group: [Point(group, value)] if group in groups else []
    )
    return module.catalogue.__wrapped__()


def test_the_example_gives_its_trace(example):
    assert example.trace_at(8.0) == pytest.approx(8.0)


@pytest.mark.parametrize("groups", [("recal.errors",), ("recal.effects",), module.GROUPS])
def test_it_is_found_once_by_its_entry_point(example, monkeypatch, groups):
    """Either group, or both for an older recal as well."""
    assert isinstance(example.FAN, Effect)
    assert listed(monkeypatch, example.FAN, groups).count(example.FAN) == 1


def test_a_package_that_cannot_be_imported_is_named(monkeypatch):
    with pytest.raises(InputError, match=r"point fan of recal\.errors: fans:FAN cannot be loaded"):
        listed(monkeypatch, ImportError("no module named fans"))


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
