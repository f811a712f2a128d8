"""`recal table verify` as a user runs it: a line for each unit, exit code 3 and what is broken,
nothing written.
"""

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from recal.cli.app import app
from tests.infield.stores import commit, factory

URL = "sqlite:///recal.db"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A store of two units in the working folder."""
    monkeypatch.chdir(tmp_path)
    with TableStore.open(URL, create=True) as store:
        commit(store, factory(store))
        factory(store, "SN-2")
    return tmp_path


def verify(*arguments):
    return CliRunner().invoke(app, ["table", "verify", "--store", URL, *arguments])


def test_an_intact_store_is_one_line_a_unit_and_stays_as_it_is(folder):
    before = Path("recal.db").read_bytes()
    said = verify()
    assert said.exit_code == 0 and said.stderr == ""
    one, two = said.stdout.splitlines()
    assert one.startswith("SN-1 (rlg): 2 revisions, intact, head ")
    assert two.startswith("SN-2 (rlg): 1 revision, intact, head ")
    assert verify("--head", one.split()[-1]).exit_code == 0
    assert verify("-q").output == ""
    assert Path("recal.db").read_bytes() == before
    assert [p.name for p in folder.iterdir()] == ["recal.db"]


def test_a_broken_unit_is_named_and_the_others_are_not(folder):
    with closing(sqlite3.connect("recal.db")) as raw, raw:
        raw.execute("DELETE FROM recal_revision WHERE number = 2")
    raw.close()
    for arguments in ([], ["-q"]):
        said = verify(*arguments)
        assert said.exit_code == 3 and isinstance(said.exception, SystemExit)
        assert "revision 2" in said.output
    result = json.loads(verify("--json").stdout)
    assert (result["schema"], result["verdict"]) == ("recal.verify/1", "broken")
    assert [len(u["faults"]) > 0 for u in result["units"]] == [True, False]
    assert result["reasons"][0].startswith("SN-1 (rlg): revision 2 is missing")


def test_head_and_report_kept_elsewhere(folder):
    said = verify("--head", "0" * 16)
    assert said.exit_code == 3 and "head 0000000000000000" in said.stdout
    assert "hexadecimal" in str(verify("--head", "yesterday").exception)
    kept = {"verdict": "committed", "imu_serial": "SN-1", "gyro_technology": "rlg", "revision": 7}
    Path("update.json").write_text(json.dumps(kept))
    said = verify("--report", "update.json", "--json")
    assert said.exit_code == 3
    assert json.loads(said.stdout)["reasons"] == [
        "update.json: SN-1 revision 7 is not in the store"
    ]
