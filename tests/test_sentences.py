"""Every reason is declared once: whoever gives a code gives what its template names, and no code
is without a giver.
"""

import ast
from functools import cache
from importlib import import_module
from pathlib import Path
from string import Formatter

import pytest

from alignment.reasons import AlignmentReason
from infield.aided.reasons import AidedReason
from infield.replay.reasons import ReplayReason
from ins.verdicts import Reason, ReasonCode, because, codes, plain_number, sentence, sentences

ROOT = Path(__file__).parents[1]
PACKAGES = ("ins", "alignment", "infield", "simreal", "recal")
# codes among the values of a reason: their templates are filled by the same values
INNER = {"PriorsReason.NO_SESSIONS": "NothingKept", "SessionReason.LIKE_A_WRONG_FACT": "WrongFact"}


@cache
def trees():
    return {
        str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8"))
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
    }


@cache
def enums():
    """Every enum of reasons of the product, by its name."""
    found = {}
    for path, tree in trees().items():
        for node in tree.body:
            bases = getattr(node, "bases", [])
            if isinstance(node, ast.ClassDef) and any(map(is_reason_code, bases)):
                module = import_module(path.removesuffix(".py").replace("/", "."))
                assert node.name not in found, f"{node.name}: two enums of one name"
                found[node.name] = getattr(module, node.name)
    return found


def is_reason_code(base):
    return isinstance(base, ast.Name) and base.id == "ReasonCode"


def members():
    return [member for enum in enums().values() for member in enum]


def name_of(member):
    return f"{type(member).__name__}.{member.name}"


def fields_of(text):
    """The values that a template names, those of its inner fields with them."""
    found = set()
    for _, field, form, _ in Formatter().parse(text):
        if field is not None:
            found |= {field.partition("[")[0].partition(".")[0]} | fields_of(form)
    return found


def needed_by(member):
    needed = fields_of(member.whole)
    inner = INNER.get(name_of(member))
    if inner is None:
        return needed
    return needed.union(*(fields_of(code.whole) for code in enums()[inner]))


@cache
def calls():
    """Module, code, keywords of every `because(...)`; a keyword None stands for `**values`."""
    found = []
    for path, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "because":
                code = ast.unparse(node.args[0])
                found.append((path, code, {k.arg for k in node.keywords}))
    return found


def test_there_are_reasons():
    assert len(enums()) > 25 and len(members()) > 200 and len(calls()) > 120


def test_a_member_carries_its_code_and_a_template():
    for member in members():
        assert member == member.value and "{" not in member.value, member
        assert member.template and member.template != member.value, member


def test_whoever_gives_a_code_gives_what_its_template_names():
    by_name = {name_of(member): member for member in members()}
    checked = 0
    for path, code, given in calls():
        if code not in by_name:
            continue
        needed = needed_by(by_name[code])
        if None in given:
            assert given - {None} < needed, f"{path}: {code}"
        else:
            assert given == needed, f"{path}: {code}"
            checked += 1
    assert checked > 100


def test_no_member_is_without_a_giver():
    used, whole = set(), set()
    for tree in trees().values():
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                used.add(f"{node.value.id}.{node.attr}")
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                whole.add(node.func.id)  # looked up by its value
            if isinstance(node, ast.comprehension) and isinstance(node.iter, ast.Name):
                whole.add(node.iter.id)
    unused = [
        name_of(member)
        for member in members()
        if name_of(member) not in used and type(member).__name__ not in whole
    ]
    assert unused == []


def test_a_reason_among_the_values_is_said_and_coded():
    inner = because(AidedReason.FEW_FIXES, count=5, needed=10)
    reason = because(ReplayReason.BY_AIDED, reason=inner)
    told = "aided by GNSS: 5 satellite fixes within the imu log, needed 10"
    assert sentences([reason, "as it is"]) == [told, "as it is"]
    assert codes([reason, "as it is"]) == ["aided_by_gnss.few_fixes", None]


@pytest.mark.parametrize(
    ("value", "spec", "words"),
    [
        (9372.0, ".3g", "9370"),
        (-68213.0, "+.3g", "-68200"),
        (9996.0, "+.3g", "+10000"),
        (4.2e7, ".3g", "4.2e+07"),
        (0.0123, ".2g", "0.012"),
        (12, "d", "12"),
    ],
)
def test_numbers_that_people_read_have_no_exponent(value, spec, words):
    assert plain_number(value, spec) == words


def test_a_sentence_has_plain_numbers():
    values = {"sigma_deg_h": 9372.0, "level_deg_h": 9.45}
    said = sentence(Reason(AlignmentReason.NO_HEADING, values))
    assert said.startswith("gyro uncertainty 9370 deg/h against 9.45 deg/h")


class Said(ReasonCode):
    PART = "part", "{what} {lag_s:ms .0f}"
    ASKS = "asks", "was {it} so?", "then {do}"
    LISTS = "lists", "{parts:, |}{more: ({size:.1f})|}"


def test_what_to_do_follows_its_template():
    assert sentence(because(Said.ASKS, it="it", do="do")) == "was it so? then do"
    assert sentence(because(Said.LISTS, parts=(), more=False, size=1.0)) == ""


def test_parts_are_joined_and_inner_fields_filled():
    parts = tuple(because(Said.PART, what=what, lag_s=0.12) for what in "ab")
    told = sentence(because(Said.LISTS, parts=parts, more=True, size=2.0))
    assert told == "a 120, b 120 (2.0)"
