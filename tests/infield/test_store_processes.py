"""Several real processes on one store, SQLite and PostgreSQL: no update is lost, the loser is
told.
"""

import pytest

from infield.store.table_store import TableStore
from tests.forks import ForkServer
from tests.infield.store_writer import STEP_DEG_H
from tests.infield.stores import factory


@pytest.fixture(scope="module")
def forks():
    with ForkServer() as server:
        yield server


@pytest.mark.parametrize("writers, updates", [(2, 6), (8, 3)])
def test_no_update_is_lost_between_processes(forks, store, url, writers, updates):
    factory(store)
    jobs = [
        forks.start("tests.infield.store_writer:work", url, f"w{k}", updates)
        for k in range(writers)
    ]
    outcomes = [forks.wait(job) for job in jobs]
    assert [o.code for o in outcomes] == [0] * writers, outcomes
    history = store.history()
    assert len(history) == 1 + writers * updates
    assert history[-1].table.parameters[0] == pytest.approx(
        writers * updates * STEP_DEG_H, rel=1e-9
    )
    assert {run.sha256 for r in history for run in r.runs} == {
        f"w{k}-{n}" for k in range(writers) for n in range(updates)
    }
    assert all(o.out.strip().isdecimal() for o in outcomes)


def test_eight_processes_may_create_the_store_at_once(forks, url):
    jobs = [forks.start("tests.infield.store_writer:create", url, f"SN-{k}") for k in range(8)]
    outcomes = [forks.wait(job) for job in jobs]
    assert [o.code for o in outcomes] == [0] * 8, outcomes
    with TableStore.open(url) as store:
        assert [u.unit.imu_serial for u in store.units()] == [f"SN-{k}" for k in range(8)]


def test_what_rivals_with_one_table_said_is_kept(forks, url):
    """Eight imports of one table, eight proposals of one update: each exit 0 has its note."""
    jobs = [forks.start("tests.infield.store_writer:put", url, f"w{k}") for k in range(8)]
    outcomes = [forks.wait(job) for job in jobs]
    assert [o.code for o in outcomes] == [0] * 8, outcomes
    with TableStore.open(url) as store:
        history, proposals = store.history(), store.proposals()
        assert store.verify().intact
    assert {r.note for r in history} == {f"import w{k}" for k in range(8)}
    assert {p.note for p in proposals} == {f"update w{k}" for k in range(8)}
    assert sorted(p.number for p in proposals) == list(range(1, 9)) and len(history) == 8
