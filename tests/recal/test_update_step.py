"""A unit that stepped away from its table, its runs given one at a time: remembered, named,
followed only on request.
"""

import json
import sqlite3
from contextlib import closing

import pytest
import typer
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from infield.table.file import table_from_dict, table_sha256, table_to_dict
from recal.cli.update import command
from tests.infield.sessions import TWIN, factory_dict, shifted, simulated, unit
from trajectories.runs.directory import write_run

app = typer.Typer()
app.command()(command)
STEP_DEG_H = 0.05
STARTS = ("ambient", "cold", "hot")


@pytest.fixture
def stepped(tmp_path):
    """Three runs of a unit whose table is 0.05 deg/h off on x, and the store with that table."""
    url = f"sqlite:///{tmp_path}/recal.db"
    table = table_to_dict(
        shifted(table_from_dict(factory_dict(), name="factory"), (-STEP_DEG_H, 0.0, 0.0))
    )
    with TableStore.open(url, create=True) as store:
        store.import_table(table, twin=TWIN)
    runs = []
    for k, start in enumerate(STARTS):
        run = simulated(21 + k, start=start, start_utc=f"2026-04-0{k + 1}T05:00:00Z").run
        write_run(tmp_path / f"run-{k}", run)
        runs.append(tmp_path / f"run-{k}")
    return url, runs, table


def update(url, tmp_path, *arguments):
    said = CliRunner().invoke(
        app, [*map(str, arguments), "--store", url, "-o", str(tmp_path / "out"), "--json"]
    )
    return said.exit_code, json.loads(said.stdout)


def rows(tmp_path):
    with closing(sqlite3.connect(tmp_path / "recal.db")) as db, db:
        return db.execute("SELECT count(*) FROM recal_contradiction").fetchone()[0]


def active(url):
    with TableStore.open(url) as store:
        return store.active()


def test_one_run_at_a_time_then_accepted(stepped, tmp_path):
    url, runs, table = stepped
    code, first = update(url, tmp_path, runs[0])
    assert code == 5 and rows(tmp_path) == 0  # a proposal stores nothing
    assert "table_disagrees" not in first["reason_codes"]
    for k, run in enumerate(runs):
        code, document = update(url, tmp_path, run, "--commit")
        assert code == 5 and rows(tmp_path) == k + 1
        assert active(url).sha256 == table_sha256(table)
    assert any("2026-04-01" in r for r in document["reasons"])
    assert "remembered; the table is as it was" in document["remembered"]
    (step,) = document["disagreement"]["steps"]
    assert abs(step["shift_deg_h"] - STEP_DEG_H) < 0.015 and len(step["run_ids"]) == 3
    code, _ = update(url, tmp_path, runs[2], "--commit")
    assert code == 5 and rows(tmp_path) == 3  # the same session twice is one

    code, document = update(url, tmp_path, *runs, "--accept-step", "--commit")
    assert code == 0 and document["verdict"] == "committed", document["reasons"]
    now = active(url)
    (said,) = now.table_dict["provenance"]["accepted_steps"]
    assert said["axis"] == "x" and len(said["sessions"]) == 3
    error = now.table.bias_deg_h("x", [25.0, 35.0]) - unit().bias_deg_h("x", [25.0, 35.0])
    assert abs(error).max() < 0.01
    with TableStore.open(url) as store:
        # what is merged contradicts no more
        assert store.contradictions("SN-0042", "rlg", "") == ()
        store.rollback(by="B", reason="wrong run")
        assert len(store.contradictions("SN-0042", "rlg", "")) == 3


def test_runs_given_together_agree_without_a_store(stepped, tmp_path):
    url, runs, _ = stepped
    code, document = update(url, tmp_path, *runs)
    assert code == 5 and rows(tmp_path) == 0
    assert "table_disagrees" in document["reason_codes"]


def test_a_store_that_cannot_be_written_still_answers(stepped, tmp_path, monkeypatch):
    monkeypatch.setattr("infield.store.database.LOCK_WAIT_S", 0.2)
    url, runs, _ = stepped
    (tmp_path / "recal.db").chmod(0o444)
    # root writes what it likes: lock the file instead
    with closing(sqlite3.connect(tmp_path / "recal.db")) as db, db:
        db.execute("BEGIN IMMEDIATE")
        code, document = update(url, tmp_path, runs[0], "--commit")
    assert code == 5 and "not remembered" in document["remembered"]


def test_no_step_to_accept_is_said(stepped, tmp_path):
    url, runs, _ = stepped
    code, document = update(url, tmp_path, runs[0], "--accept-step", "--commit")
    assert code == 5
    assert "no_step" in document["reason_codes"]
