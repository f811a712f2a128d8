"""Every code has a sentence, and whoever gives a code gives what its sentence names."""

import ast
import inspect
from enum import StrEnum
from functools import cache
from importlib import import_module
from pathlib import Path
from string import Formatter

import pytest

from alignment.reasons import AlignmentReason
from infield.reports.words import sentences
from ins.verdicts import Reason

ROOT = Path(__file__).parents[1]
PACKAGES = ("alignment", "infield", "recal", "simreal")
# codes that are chosen by a function, with the values that it is called with
CHOSEN = {
    "OF_ANOTHER": {"column", "fault"},
    "COARSE": {"column", "fault"},
    "CONSTANT": {"column", "fault"},
    "HOLE": {"column", "fault"},
    "AXIS_LEFT_OUT": {"column", "fault"},
    "READINGS_LEFT_OUT": {"column", "fault"},
    "ALL_STUCK": set(),
    "NONE_USABLE": set(),
    "NAMED_TOO_SHORT": {"named_s", "needed_s"},
    "NAMED_NOT_AT_REST": {"named_s", "needed_s"},
    "TABLE_DISAGREES": {"axis", "shift_deg_h", "sigma_deg_h", "since_utc", "run_ids"},
    "TURN_AND_STOP": set(),
    "FLY_TURNS": set(),
    "PARK_LONGER": set(),
    "HOLD_HEADING": set(),
    "PARK_FROM_COLD": set(),
    "FOUND": set(),
    "NO_TAXI": set(),
    "BLIND": set(),
}
ROOMS_CHECKED = ("alignment", "session", "thermometer")


def codes_of(room):
    return list(import_module(f"infield.reports.words.{room}").SENTENCES)


@pytest.mark.parametrize("room", sentences.ROOMS)
def test_a_room_words_whole_enums(room):
    """No member of an enum is left without a sentence."""
    codes = codes_of(room)
    assert codes and all(isinstance(code, StrEnum) for code in codes)
    for enum in {type(code) for code in codes}:
        assert [member for member in enum if member not in codes] == []


@cache
def calls():
    """(enum, member) of each `because(Enum.MEMBER, ...)` in the product, with its keywords."""
    found = []
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if not isinstance(node, ast.Call) or getattr(node.func, "id", "") != "because":
                    continue
                code = node.args[0]
                if isinstance(code, ast.Attribute) and isinstance(code.value, ast.Name):
                    given = {k.arg for k in node.keywords}
                    found.append((code.value.id, code.attr, given))
    return found


def needed_by(template):
    if callable(template):
        parameters = inspect.signature(template).parameters.values()
        return {p.name for p in parameters if p.kind is not p.VAR_KEYWORD}
    return {name for _, name, _, _ in Formatter().parse(template) if name is not None}


def test_each_giver_of_a_code_gives_what_its_sentence_names():
    by_name = {(enum.__name__, name): text for (enum, name), text in sentences.templates().items()}
    checked = 0
    for enum, member, given in calls():
        if (enum, member) in by_name and None not in given:
            assert given == needed_by(by_name[enum, member]), f"{enum}.{member}"
            checked += 1
    assert checked > 30


@pytest.mark.parametrize("room", ROOMS_CHECKED)
def test_each_code_is_given_somewhere(room):
    given = {(enum, member) for enum, member, _ in calls()}
    for code in codes_of(room):
        if (type(code).__name__, code.name) in given:
            continue
        template = sentences.templates()[type(code), code.name]
        assert needed_by(template) == CHOSEN[code.name], code


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
    assert sentences.plain(value, spec) == words


def test_a_sentence_has_plain_numbers():
    values = {"sigma_deg_h": 9372.0, "level_deg_h": 9.45}
    said = sentences.sentence(Reason(AlignmentReason.NO_HEADING, values))
    assert said.startswith("gyro uncertainty 9370 deg/h against 9.45 deg/h")
