"""A store edited by hand: every reader and writer of what was changed refuses in one line, `verify`
names all of it.
"""

from contextlib import contextmanager

import pytest
from sqlalchemy import text

from infield.store.table_store import MergedRun
from infield.table.file import table_to_dict
from ins.records import InputError
from tests.infield.stores import SIGNED, commit, factory, rows, table, tamper, updated


@pytest.fixture
def five(store):
    """SN-1 with five revisions, SN-2 with one."""
    last = factory(store)
    for k in range(4):
        last = commit(store, last, run=f"run-{k}")
    factory(store, "SN-2")
    return store


def faults(store):
    return {u.unit.imu_serial: u.faults for u in store.verify().units if u.faults}


def test_no_reader_or_writer_uses_an_active_tag_that_was_moved(five, url):
    last, other = five.active("SN-1"), table_to_dict(table(high=30.0))
    tamper(url, "UPDATE recal_tag SET number = 3 WHERE name = 'active' AND number = 5")
    third = five.revision(3, "SN-1")
    for use in (
        lambda: five.active("SN-1"),
        lambda: five.previous("SN-1"),
        lambda: five.history("SN-1"),
        five.units,
        lambda: five.import_table(other),
        lambda: five.import_table(last.table_dict),
        lambda: five.rollback("SN-1", **SIGNED),
        lambda: commit(five, third, run="new"),
        lambda: commit(five, last, run="new"),
        lambda: five.propose(
            third.sha256, updated(third), [MergedRun(run_id="new", sha256="new")], "{}", by="A"
        ),
    ):
        with pytest.raises(InputError) as raised:
            use()
        said = str(raised.value)
        assert "revision 3" in said and "recal table verify" in said
        assert "SN-1 (rlg): " in said and "\n" not in said
    assert five.active("SN-2").number == 1
    assert any("revision 3" in said for said in faults(five)["SN-1"]) and "SN-2" not in faults(five)


def only_sqlite(url):
    if url.startswith("postgresql"):
        pytest.skip("a text column of PostgreSQL takes no bytes")


@contextmanager
def bytes_in(url, table_name, column, value, where="1 = 1"):
    """The column holds bytes for a while."""
    ((before,),) = rows(url, f"SELECT {column} FROM {table_name} WHERE {where}")
    tamper(url, f"UPDATE {table_name} SET {column} = {value} WHERE {where}")
    yield
    where = where.replace(f"{column} = {before}", f"{column} = {value}")
    tamper(url, (f"UPDATE {table_name} SET {column} = :before WHERE {where}", {"before": before}))


@pytest.mark.parametrize("value", ["x'00ff'", "x'7b7d'", "CAST(x'00ff' AS TEXT)"])
def test_bytes_in_a_revision_are_a_changed_row(five, url, value):
    only_sqlite(url)
    uses = (
        five.units,
        lambda: five.active("SN-1"),
        lambda: five.import_table(table_to_dict(table(high=30.0))),
    )
    for column in (
        "table_json",
        "report_json",
        "note",
        "created_utc",
        "runs_json",
        "record_sha256",
        "number",
    ):
        with bytes_in(url, "recal_revision", column, value, "number = 5"):
            assert list(faults(five)) == ["SN-1"] and len(five.verify().units) == 2, column
            for use in uses:
                with pytest.raises(InputError) as raised:
                    use()
                assert "\n" not in str(raised.value)
    assert faults(five) == {}


def test_rows_that_contradict_each_other_are_not_a_busy_store(five):
    """A reference to a revision that is not there: no number of tries mends it."""
    with pytest.raises(InputError, match="rows contradict each other"):
        five._database.write(
            lambda c: c.execute(
                text("INSERT INTO recal_tag (unit_id, name, number) VALUES (1, 'x', 99)")
            )
        )
