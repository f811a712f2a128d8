"""`recal table`: its rule of two people, signed rollbacks, and locked stores."""

import json
import sqlite3
from contextlib import closing

import pytest
from typer.testing import CliRunner

from infield.store import database
from infield.store.table_store import MergedRun, TableStore
from infield.table.file import json_text
from recal.cli.app import app
from tests.infield.stores import table, table_to_dict, updated

URL = "sqlite:///recal.db"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "table.json").write_text(json_text(table_to_dict(table())))
    return tmp_path


def run(*words, code=0):
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == code, (done.output, done.exception)
    return done


def put_forward(by):
    with TableStore.open(URL) as store:
        active = store.active()
        runs = [MergedRun(run_id=by, sha256=by)]
        new = updated(active, 0.001)
        kept = store.propose(active.sha256, new, runs, '{"verdict": "proposed"}', by=by)
    return kept.number


def test_her_own_proposal_is_refused_with_its_code(folder):
    run("table", "import", "table.json")
    put_forward("anna")
    done = run("table", "approve", 1, "--by", " Anna", "--reason", "good", "--json", code=4)
    document = json.loads(done.stdout)
    assert (document["verdict"], document["reason_codes"]) == ("refused", ["same_person"])
    run("table", "approve", 1, "--by", "ben", "--reason", "good")


def test_a_store_of_one_person_says_so(folder):
    run("table", "import", "table.json", "--one-person")
    put_forward("anna")
    run("table", "approve", 1, "--by", "anna", "--reason", "good")
    assert run("table", "list").stdout.startswith("one person may put an update forward")
    assert json.loads(run("table", "list", "--json").stdout)["policy"]["approval"] == "one_person"
    run("table", "policy", "--two-people", "--by", "ben", "--reason", "two now")
    rule = json.loads(run("table", "policy", "--json").stdout)
    assert (rule["approval"], rule["number"], rule["set_by"]) == ("two_people", 2, "ben")
    run("table", "policy", "--two-people", "--one-person", code=2)


@pytest.mark.parametrize("words", [[], ["--by", "B"], ["--reason", "why"]])
def test_a_rollback_is_signed(folder, words):
    run("table", "import", "table.json")
    run("table", "rollback", *words, code=2)


@pytest.mark.parametrize(
    "words",
    [
        ["table", "list"],
        ["table", "import", "table.json", "--note", "again"],
        ["table", "rollback", "--by", "B", "--reason", "why"],
        ["table", "verify"],
    ],
)
@pytest.mark.parametrize("lock", ["BEGIN EXCLUSIVE", "BEGIN IMMEDIATE"])
def test_a_locked_store_is_exit_code_4(folder, monkeypatch, words, lock):
    assert database.LOCK_WAIT_S == 10.0
    monkeypatch.setattr(database, "LOCK_WAIT_S", 0.1)
    run("table", "import", "table.json")
    with closing(sqlite3.connect("recal.db")) as other:
        other.execute(lock)
        reads = lock == "BEGIN IMMEDIATE" and words[1] in ("list", "verify")
        done = run(*words, "--json", code=0 if reads else 4)
    if not reads:
        document = json.loads(done.stdout)
        assert document["verdict"] == "refused" and "busy with other writers" in done.stderr
