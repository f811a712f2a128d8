"""The lists in docs/reference agree with the code: columns, keys, defaults, commands, exit codes,
schemas, effects and requirements.
"""

import importlib
import json
import re
import sys
from dataclasses import fields
from pathlib import Path

import pytest

import trajectories.runs.schema as run_schema
from ins import twin_file
from ins.errors.catalogue import OWN
from ins.errors.reference import renewed
from ins.estimation import states
from ins.filters import states as aided
from recal.cli import console

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "docs/reference"
FORMATS = (REFERENCE / "formats.md").read_text("utf-8")
EFFECTS = (REFERENCE / "effects.md").read_text("utf-8")
REQUIREMENTS = (REFERENCE / "requirements.md").read_text("utf-8")
CONVENTIONS = (ROOT / "CONVENTIONS.md").read_text("utf-8")
STATE_COUNTS = {"CORE", "BASE", "AIDED_MOTION"}
PACKAGES = ("ins", "trajectories", "alignment", "infield", "simreal", "recal")
SCHEMA = re.compile(r'"(recal\.[a-z_]+/\d)"')


def row(text, name):
    """The table row that begins with a name."""
    return next(line for line in text.splitlines() if line.startswith(f"| {name} |"))


def section(text, number):
    return re.search(rf"^## {number}\. .*?(?=^## |\Z)", text, re.M | re.S)[0]


def backquoted(text):
    return set(re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.S)))


@pytest.mark.parametrize("stream", run_schema.STREAMS)
def test_columns_of_a_stream(stream):
    if stream == "imu":
        needed = {"time_s", *run_schema.INCREMENT_COLUMNS, *run_schema.RATE_COLUMNS}
    else:
        needed = {*run_schema.REQUIRED[stream], *run_schema.OPTIONAL.get(stream, ())}
    named = backquoted(row(section(FORMATS, 1), stream))
    assert needed <= named
    if stream != "phases":  # whose row names the phases too
        assert named == needed


def test_keys_of_run_json():
    known = set(run_schema._RunKeys.model_fields)
    block = json.loads(re.search(r"```json\n(.*?)```", section(FORMATS, 1), re.S)[1])
    assert set(block) - {"schema"} <= known
    assert known <= set(block) | backquoted(section(FORMATS, 1))


def test_twin_with_the_defaults_of_a_ring_laser():
    block = json.loads(re.search(r"```json\n(.*?)```", section(FORMATS, 3), re.S)[1])
    default = twin_file.default_twin("rlg")
    for name in twin_file.TWIN_SECTIONS:
        record = getattr(default, name)
        values = {f.name: getattr(record, f.name) for f in fields(record)}
        stated = {k: tuple(v) if isinstance(v, list) else v for k, v in block[name].items()}
        assert stated == values, name


def test_commands():
    sys.path.insert(0, str(ROOT / "docs/_ext"))
    try:
        from command_pages import command_tree
    finally:
        sys.path.remove(str(ROOT / "docs/_ext"))
    rows = [line for line in section(FORMATS, 4).splitlines() if line.startswith("| `recal ")]
    first = [line.split("|")[1] for line in rows]
    groups = {"table": next(cell for cell in first if "table list" in cell)}
    for name in command_tree():
        word, _, verb = name.partition(" ")
        if word in groups:
            assert re.search(rf"`(?:recal table )?{verb}`", groups[word]), name
        else:
            assert any(re.search(rf"`recal {name}[` ]", cell) for cell in first), name


def test_exit_codes():
    stated = set(re.findall(r"^\| (\d) \|", section(FORMATS, 4), re.M))
    assert stated == {str(code) for code in {*console.EXIT_CODES.values(), console.USAGE_EXIT}}


def test_schemas():
    """Each schema that the code writes is named; what is named and not written is marked."""
    written = set()
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            written |= set(SCHEMA.findall(path.read_text("utf-8")))
    named = set(re.findall(r"recal\.[a-z_]+/\d", FORMATS))
    assert written - named == set()
    later = set(re.findall(r"recal\.[a-z_]+/\d", section(FORMATS, 6)))
    assert named - written <= later


def test_catalogue():
    """The tables are as the list has them: a row each, of a slow variation under its process."""
    assert renewed(EFFECTS) == EFFECTS, "python -m ins.errors.reference --write"
    errors = EFFECTS.split("<!-- priors")[0]
    rows = dict(re.findall(r"^\| ([GAPOFDT]\d\d) \| `(\w+)` \|", errors, re.M))
    assert rows.keys() == {e.number for e in OWN} and len(rows) == 87
    named = {e.name for e in OWN} - {"slow_variation"}
    assert named <= {*rows.values()} <= named | {e.id for e in OWN}


def test_requirements_have_a_place_where_they_are_measured():
    rows = re.findall(r"^\| \*\*(R\d+)\*\* \| .+ \| (.+) \|$", REQUIREMENTS, re.M)
    assert [name for name, _ in rows] == [f"R{k}" for k in range(1, 30)]
    for name, where in rows:
        files = re.findall(r"`(tests/[\w/]+\.py)`", where)
        assert files, name
        assert all((ROOT / file).exists() for file in files), name


def test_every_number_of_every_result_has_a_unit():
    """The generated page of results names the unit of each key, or what the key holds."""
    sys.path.insert(0, str(ROOT / "docs/_ext"))
    try:
        file_pages = importlib.import_module("file_pages")
        result_keys = importlib.import_module("result_keys")
    finally:
        sys.path.pop(0)
    sources = [file_pages._sources(package).items() for package in file_pages.PACKAGES]
    found = result_keys.documents(dict(pair for of_one in sources for pair in of_one))
    typed = {document.schema: document.tree.splitlines() for document in found if document.typed}
    assert len(typed) >= 24 and "recal.update/1" in typed
    lacking = {
        schema: [line.strip() for line in lines if line.endswith(f"[{result_keys.UNKNOWN}]")]
        for schema, lines in typed.items()
    }
    assert not any(lacking.values()), lacking
    of_update = [line.strip() for line in typed["recal.update/1"]]
    assert "sigma_own_deg_h  [deg/h]" in of_update and "shares  [1]" in of_update
    assert "temperature_degC  [degC]" in of_update and "time_s  [s]" in of_update


def test_state_vectors_of_the_conventions():
    rows = re.findall(r"^\| (\d+)(?:-(\d+))? \| `(\w+)` \|", CONVENTIONS, re.M)
    listed = {name: range(int(first), int(last or first) + 1) for first, last, name in rows}
    declared = {
        name: range(at.start, at.stop) if isinstance(at, slice) else range(at, at + 1)
        for name, at in {**vars(states), **vars(aided)}.items()
        if isinstance(at, slice | int) and name not in STATE_COUNTS
    }
    assert listed == declared
