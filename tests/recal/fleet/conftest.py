"""The fleet is simulated and written once for all tests of this folder."""

import hashlib

import pytest

from infield.session import pipeline
from infield.table.file import canonical_json, table_to_dict
from recal.fleet import update as spine
from tests.recal.fleet.made_fleet import InlinePool, copy_fleet, write_fleet


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    return write_fleet(tmp_path_factory.mktemp("fleet"))


@pytest.fixture
def fleet(made, tmp_path, monkeypatch):
    """A copy to work on, and to work in."""
    folder = copy_fleet(made, tmp_path / "fleet")
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture(scope="session")
def known_sessions():
    return {}


@pytest.fixture
def inline(monkeypatch, known_sessions):
    """Tasks in this process; the pools that were made. The same run against the same table is
    estimated once a test session.
    """
    pools, real = [], pipeline.take_run

    def remembered(run, table, twin, settings, repeated, on_record):
        held = [(m.names, m.value.tolist()) for m in on_record.marks]
        text = (
            f"{run.sha256} {run.header} {canonical_json(table_to_dict(table))} {twin} {settings}"
            f" {repeated} {held}"
        )
        key = hashlib.sha256(text.encode()).hexdigest()
        if key not in known_sessions:
            known_sessions[key] = real(run, table, twin, settings, repeated, on_record)
        return known_sessions[key]

    monkeypatch.setattr(pipeline, "take_run", remembered)
    monkeypatch.setattr(spine, "fleet_html", lambda document: "")  # test_report draws

    def pool(workers):
        pools.append(InlinePool())
        return pools[-1]

    monkeypatch.setattr(spine, "LocalPool", pool)
    return pools
