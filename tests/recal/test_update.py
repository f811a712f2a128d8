"""`recal update --commit`: report and table together, and the report kept where the store cannot be
written.
"""

import json
import shlex

import pytest
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from ins.records import InputError
from recal.cli.app import app
from tests.infield.sessions import factory_dict, simulated
from tests.recal import verbs
from trajectories.runs.directory import write_run

URL = "sqlite:///recal.db"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "run", simulated().run)
    with TableStore.open(URL, create=True) as store:
        store.import_table(factory_dict())
    return tmp_path


def update(*more):
    return CliRunner().invoke(
        app, ["update", "run", "--store", URL, "-o", "out", "--commit", "--json", *more]
    )


def report(folder):
    return json.loads((folder / "out/update.json").read_text())


def test_the_report_names_the_revision_and_its_command_takes_it_back(folder):
    done = update()
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document == report(folder)
    assert document["verdict"] == "committed"
    assert document["revision"] == 2
    assert "as revision 2" in (folder / "out/update.html").read_text()
    with TableStore.open(URL) as store:
        active = store.active()
        assert (active.number, active.sha256) == (2, document["table_after_sha256"])
        assert json.loads(active.report_json)["points"] == document["points"]
    words = shlex.split(document["rollback_command"])[1:]
    assert words[words.index("--technology") + 1] == "rlg"
    assert words[words.index("--mode") + 1] == ""
    assert CliRunner().invoke(app, words).exit_code == 0
    with TableStore.open(URL) as store:
        assert store.active().sha256 == document["table_before_sha256"]
    again = json.loads(update().stdout)  # the same bits are active, but two revisions on
    assert again["revision"] == 4 and again == report(folder)


def test_where_the_store_cannot_be_written_the_report_stays_as_a_proposal(folder, monkeypatch):
    def full(*arguments, **options):
        raise InputError("store sqlite:///recal.db: not written: database or disk is full")

    monkeypatch.setattr(TableStore, "commit_update", full)
    done = update()
    assert isinstance(done.exception, InputError)
    answer, document = json.loads(done.stdout), report(folder)
    assert answer["schema"] == "recal.error/1" and "disk is full" in answer["reasons"][0]
    assert document["verdict"] == "proposed"
    assert document["reasons"] == [f"not committed: {answer['reasons'][0]}"]
    assert document["revision"] is None
    assert (folder / "out/update.html").stat().st_size > 10_000


def test_where_the_report_cannot_be_written_nothing_is_committed(folder):
    (folder / "out/update.html").mkdir(parents=True)
    done = update("--force")
    assert isinstance(done.exception, InputError) and "update.html" in str(done.exception)
    assert [p.name for p in (folder / "out").iterdir()] == ["update.html"]
    with TableStore.open(URL) as store:
        assert store.active().number == 1


def test_without_html_the_document_alone_is_written(folder):
    document = verbs.update(
        [folder / "run"], store_url=URL, commit=True, output=folder / "out", html=False
    )
    assert document == report(folder)
    assert [p.name for p in (folder / "out").iterdir()] == ["update.json"]


def test_each_step_of_an_update_is_told(folder):
    """The progress bar counts them: as many as UPDATE_STEPS says, in their order."""
    from recal.service.update import UPDATE_STEPS, UpdateRequest, update_in_store

    said = []
    update_in_store(
        UpdateRequest(
            runs=[folder / "run"], store_url="sqlite:///none.db", html=False, step=said.append
        )
    )
    assert said == ["reading 1 run", "estimating from 1 run", "drawing the report"]
    assert len(said) == UPDATE_STEPS
