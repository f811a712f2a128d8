"""`recal update --commit` against other writers: the loser is told; with --retry it merges on top
of the new table.
"""

import json

import pytest
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from recal.cli.app import app
from tests.forks import ForkServer, plain_page
from tests.infield.sessions import factory_dict, simulated
from tests.infield.stores import commit, database_url
from trajectories.runs.directory import write_run

SEEDS = (1, 2)


@pytest.fixture(autouse=True)
def without_figures(monkeypatch):
    monkeypatch.setattr("infield.reports.update_page.update_html", plain_page)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs of one unit."""
    folder = tmp_path_factory.mktemp("runs")
    for k in SEEDS:
        write_run(folder / f"run-{k}", simulated(k, start_utc=f"2026-03-0{k}T05:00:00Z").run)
    return [str(folder / f"run-{k}") for k in SEEDS]


@pytest.fixture
def filled(url):
    """A store with the unit's factory table."""
    with TableStore.open(url, create=True) as store:
        store.import_table(factory_dict())
    return url


def update(run, url, out, *more):
    return CliRunner().invoke(
        app, ["update", run, "--store", url, "-o", str(out), "--commit", "--json", *more]
    )


def beaten_by(monkeypatch, *others):
    """Each first try of a commit comes just after another writer's."""
    waiting, real = list(others), TableStore.commit_update

    def commit_update(self, *arguments, **options):
        if waiting:
            waiting.pop(0)()
        return real(self, *arguments, **options)

    monkeypatch.setattr(TableStore, "commit_update", commit_update)


def table_after(url, folder, runs):
    """What one update after the other gives."""
    with TableStore.open(url, create=True) as store:
        store.import_table(factory_dict())
    for run in runs:
        assert update(run, url, folder / "one").exit_code == 0
    with TableStore.open(url) as store:
        return store.active().table_json


def test_a_retry_gives_the_bits_of_one_update_after_the_other(runs, filled, tmp_path, monkeypatch):
    expected = table_after(f"sqlite:///{tmp_path}/in_turn.db", tmp_path, runs)
    beaten_by(monkeypatch, lambda: update(runs[0], filled, tmp_path / "winner"))
    done = update(runs[1], filled, tmp_path / "loser", "--retry")
    document = json.loads(done.stdout)
    assert (
        done.exit_code == 0 and document["verdict"] == "committed" and document["revision"] == 3
    ), done.output
    assert len(document["conflicts"]) == 1
    with TableStore.open(filled) as store:
        assert store.active().table_json == expected
        assert [len(r.runs) for r in store.history()] == [0, 1, 1] and store.verify().intact
        assert json.loads(store.active().report_json)["conflicts"] == document["conflicts"]


def test_without_a_retry_the_loser_is_told_and_nothing_is_overwritten(
    runs, filled, tmp_path, monkeypatch
):
    beaten_by(monkeypatch, lambda: update(runs[0], filled, tmp_path / "winner"))
    done = update(runs[1], filled, tmp_path / "loser")
    document = json.loads(done.stdout)
    assert done.exit_code == 4 and document["verdict"] == "refused"
    assert document["reason_codes"] == ["table_moved"]
    with TableStore.open(filled) as store:
        assert store.active().number == 2
        assert (
            store.active().sha256
            == json.loads((tmp_path / "winner/update.json").read_text())["table_after_sha256"]
        )


def test_tries_end(runs, filled, tmp_path, monkeypatch):
    def other():
        with TableStore.open(filled) as store:
            commit(store, store.active(), run=f"other-{store.active().number}", shift_deg_h=1e-7)

    beaten_by(monkeypatch, *([other, lambda: None] * 3))
    done = update(runs[0], filled, tmp_path / "out", "--retry", "1")
    document = json.loads(done.stdout)
    assert done.exit_code == 4
    assert len(document["conflicts"]) == 1
    assert document["verdict"] == "refused"


def test_the_same_run_committed_meanwhile_is_refused_not_merged_twice(
    runs, filled, tmp_path, monkeypatch
):
    beaten_by(monkeypatch, lambda: update(runs[0], filled, tmp_path / "winner"))
    done = update(runs[0], filled, tmp_path / "loser", "--retry")
    assert done.exit_code == 4
    assert json.loads(done.stdout)["reason_codes"] == ["of_run.already_merged"]
    with TableStore.open(filled) as store:
        assert store.active().number == 2


@pytest.fixture(scope="module")
def forks(runs, tmp_path_factory):
    """A server of processes in which one update was done, so that all is loaded."""
    folder = tmp_path_factory.mktemp("warm")
    with TableStore.open(f"sqlite:///{folder}/recal.db", create=True) as store:
        store.import_table(factory_dict())
    with ForkServer(folder) as server:
        server.here("tests.forks:recal_plain", ["update", runs[0], "-o", "out", "-q"])
        yield server


def race(forks, url, runs, folder, retry):
    """One process a run, all at once; their outcomes."""
    arguments = [
        [
            "update",
            run,
            "--store",
            url,
            "-o",
            str(folder / f"out-{k}"),
            "--commit",
            "--retry",
            str(retry),
            "--json",
        ]
        for k, run in enumerate(runs)
    ]
    jobs = [forks.start("tests.forks:recal_plain", words) for words in arguments]
    return [forks.wait(job) for job in jobs]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_eight_processes_at_once_lose_no_update(forks, tmp_path, kind):
    runs = []
    for k in range(1, 9):
        write_run(tmp_path / f"run-{k}", simulated(k, start_utc=f"2026-03-0{k}T05:00:00Z").run)
        runs.append(str(tmp_path / f"run-{k}"))
    with database_url(kind, tmp_path) as url:
        with TableStore.open(url, create=True) as store:
            store.import_table(factory_dict())
        outcomes = race(forks, url, runs, tmp_path, 10)
        with TableStore.open(url) as store:
            history = store.history()
            assert store.verify().intact
    assert [o.code for o in outcomes] == [0] * 8, outcomes
    assert sorted(run.run_id for r in history for run in r.runs) == [
        f"run-{k}" for k in range(1, 9)
    ]
    conflicts = sum(len(json.loads(o.out).get("conflicts", ())) for o in outcomes)
    assert conflicts >= 7  # they began together: all but the first were beaten
