"""A unit's history in the store: kept with each commit, asked for at the next, and older stores."""

import json
from dataclasses import replace

import pytest

from infield.store.table_store import TableStore
from infield.table.file import table_to_dict
from ins.verdicts import Outcome
from recal.service.inputs import new_units as unit_marks
from recal.service.update import UpdateRequest, update_in_store
from tests.infield.sessions import TWIN, factory, simulated


@pytest.fixture
def store(tmp_path):
    url = f"sqlite:///{tmp_path / 'recal.db'}"
    with TableStore.open(url, create=True) as opened:
        opened.import_table(table_to_dict(factory()), twin=TWIN)
    return url


def updated(store, tmp_path, run, **asked):
    request = UpdateRequest(
        runs=[run], store_url=store, commit=True, output=tmp_path / "out", html=False, **asked
    )
    return update_in_store(request).document


def another(run):
    """The log of a unit whose thermometers have other errors."""
    read = run.temperature.gyro_degC + [1.0, -0.8, 0.0]
    return replace(run, temperature=replace(run.temperature, gyro_degC=read), sha256="b" * 64)


def days(number):
    return simulated(seed=number, start_utc=f"2026-03-0{number}T05:00:00Z").run


def test_the_second_session_is_held_against_the_first_and_another_unit_is_found(store, tmp_path):
    first = updated(store, tmp_path, days(1))
    marks = first["sessions"][0]["unit_marks"]
    assert first["verdict"] == Outcome.COMMITTED and marks["sessions"] == 0
    with TableStore.open(store) as opened:
        (unit,) = opened.units()
        (kept,) = unit_marks.known_marks(opened, unit.unit)
    assert list(kept.names) == marks["names"]
    wrong = updated(store, tmp_path, another(days(2)))
    assert wrong["verdict"] == Outcome.INCONSISTENT
    assert any(code.endswith("unlike_the_unit") for code in wrong["reason_codes"])
    second = updated(store, tmp_path, days(2))
    assert second["verdict"] == Outcome.COMMITTED
    assert second["sessions"][0]["unit_marks"]["sessions"] == 1


def test_reports_without_marks_or_with_broken_ones_say_nothing(store):
    with TableStore.open(store) as opened:
        (unit,) = opened.units()
        (factory_revision,) = opened.reports("SN-0042", "rlg", "")
        assert unit_marks.known_marks(opened, unit.unit) == ()
    told = {"names": ["force_ug"], "value": [1.0], "covariance": [[4.0]], "heat": [0.0]}
    site = {"lat_deg": 45.0, "lon_deg": 7.0}
    sound = {"outcome": "accepted", "site": site, "unit_marks": told}
    for session, count in (
        (sound, 1),
        ({**sound, "outcome": "inconsistent"}, 0),
        ({**sound, "unit_marks": None}, 0),
        ({**sound, "unit_marks": {**told, "covariance": [[-4.0]]}}, 0),
        ({**sound, "unit_marks": {**told, "value": [1.0, 2.0]}}, 0),
        ({"outcome": "accepted"}, 0),
        ("no session", 0),
    ):
        report = json.dumps({"sessions": [session]})
        revision = replace(factory_revision, kind="update", report_json=report)
        assert len(unit_marks._of_report(revision)) == count
    assert unit_marks._of_report(replace(factory_revision, report_json=None)) == []
    assert unit_marks._of_report(replace(factory_revision, report_json="{")) == []
