"""SIGKILL at any moment of `recal update --commit` and `recal table rollback`: no corrupt store, no
lost commit, no half.

A lost commit is one that the command said was done and that is not there. The slow tests kill 1,000
times on SQLite and 200 times on PostgreSQL, the normal ones 12 times on each.
"""

import json
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import create_engine, make_url, text
from sqlalchemy.pool import NullPool

from infield.store.table_store import TableStore
from tests.forks import ForkServer
from tests.infield.sessions import PARKED, factory_dict, simulated
from tests.infield.stores import database_url
from trajectories.runs.directory import write_run

QUICKEST_S, LATEST_S = 0.0003, 0.04  # of computing after the write began


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    write_run(folder / "run", simulated(1, PARKED).run)
    return str(folder / "run")


@pytest.fixture(scope="module")
def forks(run, tmp_path_factory):
    """A server of processes in which one update was done, so that all is loaded."""
    with ForkServer(tmp_path_factory.mktemp("warm")) as server:
        server.here("tests.forks:recal_plain", ["update", run, "-o", "out", "-q"])
        yield server


def settled(url):
    """Waits until a server has done with what a killed client had sent it."""
    name = make_url(url).query.get("application_name")
    if name is None:
        return
    engine = create_engine(
        make_url(url).difference_update_query(["application_name"]), poolclass=NullPool
    )
    with engine.connect() as c:
        for _ in range(1000):
            if (
                c.execute(
                    text("SELECT count(*) FROM pg_stat_activity WHERE application_name = :n"),
                    {"n": name},
                ).scalar()
                == 0
            ):
                return
            c.rollback()
            time.sleep(0.01)
    raise AssertionError("the server still works for a client that is gone")


def writer(url, run, out, held):
    """An update where the table does not hold the run, else the way back."""
    if held:
        signed = ("--by", "B", "--reason", "why")
        return ["table", "rollback", "--store", url, "--to", "factory", *signed, "--json"]
    return ["update", run, "--store", url, "-o", str(out), "--commit", "--json"]


def kill_writers(forks, url, run, out, *, kills, rng, function="tests.forks:recal_plain"):
    """Start a command, kill it, look at the store; again and again. How often each end was seen."""
    seen = Counter()
    with TableStore.open(url, create=True) as store:
        store.import_table(factory_dict())
    for _ in range(kills):
        with TableStore.open(url) as store:
            before, held = store.active(), store.active().kind == "update"
        words = writer(url, run, out, held)
        if rng.random() < 0.8:
            # the first of an update looks whether the schema is up to date
            writes = 1 if held else 2
            moment = {
                "since": writes,
                "after_s": float(np.exp(rng.uniform(np.log(QUICKEST_S), np.log(LATEST_S)))),
            }
        else:
            moment = {"since": 0, "after_s": float(rng.uniform(0.0, 0.1 if held else 0.6))}
        outcome = forks.run_and_kill(function, words, **moment)
        assert outcome.code in (0, -9), (words, outcome)
        settled(url)
        seen[(words[0], outcome.code, look(url, before, outcome, out))] += 1
    return seen


def look(url, before, outcome, out):
    """How many revisions came; all is intact, what was told is there, and the report is true."""
    report = out / "update.json"
    kept = json.loads(report.read_text()) if report.exists() else None
    with TableStore.open(url) as store:
        found = store.verify(reports={"update.json": kept} if kept else {})
        active = store.active()
    assert found.intact, found
    assert active.number in (before.number, before.number + 1)
    if active.number == before.number:
        assert active == before and outcome.code != 0
    if outcome.code == 0:
        told = json.loads(outcome.out)
        assert told["revision"] == active.number == before.number + 1
        assert told.get("table_after_sha256", told.get("sha256")) == active.sha256
    for left in out.glob(".update.*") if out.exists() else ():
        left.unlink()  # SIGKILL leaves the staged report behind, under its own name
    return active.number - before.number


@pytest.fixture
def kill_url(request, tmp_path):
    with database_url(request.param, tmp_path) as url:
        yield (
            url
            if url.startswith("sqlite")
            else make_url(url)
            .update_query_dict({"application_name": tmp_path.name})
            .render_as_string(hide_password=False)
        )


@pytest.mark.parametrize("kill_url", ["sqlite", "postgresql"], indirect=True)
def test_killed_commands_lose_and_break_nothing(forks, kill_url, run, tmp_path):
    seen = kill_writers(
        forks, kill_url, run, tmp_path / "out", kills=6, rng=np.random.default_rng(5)
    )
    killed = sum(n for (_, code, _), n in seen.items() if code == -9)
    assert sum(seen.values()) == 6 and killed >= 2, seen


BATCHES = [("sqlite", k) for k in range(20)] + [("postgresql", 100 + k) for k in range(4)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "kill_url, batch", BATCHES, indirect=["kill_url"], ids=[f"{kind}-{k}" for kind, k in BATCHES]
)
def test_many_killed_commands_lose_and_break_nothing(forks, kill_url, run, tmp_path, batch):
    # some with the real page
    function = "tests.forks:recal" if batch % 10 == 0 else "tests.forks:recal_plain"
    seen = kill_writers(
        forks,
        kill_url,
        run,
        Path(tmp_path / "out"),
        kills=50,
        rng=np.random.default_rng(1000 + batch),
        function=function,
    )
    print(
        "ends:",
        kill_url[:6],
        batch,
        {" ".join(map(str, end)): n for end, n in sorted(seen.items())},
    )
    assert sum(seen.values()) == 50
