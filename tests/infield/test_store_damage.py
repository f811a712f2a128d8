"""Damage of every column of every table, and of bytes of the file: where `verify` finds the store
broken, nothing is written to it.
"""

import random
import shutil
import sqlite3
from contextlib import closing

import pytest

from infield.store.errors import StoreRefused
from infield.store.proposal_rows import Approval
from infield.store.schema import metadata
from infield.store.table_store import MergedRun, TableStore
from infield.table.file import table_to_dict
from ins.records import InputError, TwinModel
from tests.infield.stores import EVIDENCE, SIGNED, commit, table, updated

COLUMNS = [(t.name, c.name) for t in metadata.sorted_tables for c in t.columns]
# rows that no other row points at: nothing inside a store shows that one is gone (SECURITY.md)
ENDS = {
    "recal_proposal",
    "recal_decision",
    "recal_contradiction",
    "recal_policy",
    "recal_priors",
    "recal_priors_decision",
}
FLIPS = 300  # of a bit of the file
# one a kind: what the active revision does not stand on, ends, tags, runs, other tables, columns
# that no hash covers but their place
FEW = (
    "UPDATE recal_revision SET note = 'x' WHERE number = 3",
    "UPDATE recal_revision SET report_json = '{}' WHERE number = 2",
    "UPDATE recal_revision SET number = 1000000000 WHERE number = 3",
    "DELETE FROM recal_revision WHERE number = 3",
    "UPDATE recal_tag SET number = 2 WHERE name = 'factory'",
    "DELETE FROM recal_merged_run WHERE run_sha256 = 'run-1'",
    "UPDATE recal_contradiction SET unit_id = 9",
    "UPDATE recal_proposal SET note = 'x' WHERE number = 1",
    "UPDATE recal_decision SET reason = 'x' WHERE number = 1",
    "UPDATE recal_unit SET twin_sha256 = 'x'",
    "UPDATE recal_unit SET imu_serial = 'SN-9'",
    "UPDATE recal_unit SET gyro_mode = x'00ff'",
    "UPDATE recal_policy SET set_by = 'x'",
    "UPDATE recal_priors SET gyro_technology = 'x'",
)


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """The file of a store with all kinds of rows, and its active revision."""
    file = tmp_path_factory.mktemp("filled") / "recal.db"
    with TableStore.open(f"sqlite:///{file}", create=True) as store:
        twin = TwinModel(imu_serial="SN-1")
        first = store.import_table(table_to_dict(table()), twin=twin, note="from the lab")
        commit(store, commit(store, first, run="run-1"), run="run-2")
        last = store.rollback("SN-1", to=2, **SIGNED)
        store.remember_contradictions("SN-1", "rlg", "", [EVIDENCE])
        for k in range(3):
            runs = [MergedRun(run_id=f"p{k}", sha256=f"p{k}")]
            new = updated(last, 0.001 * (k + 2))
            store.propose(last.sha256, new, runs, '{"verdict": "proposed"}', by="A", note="why")
        store.decide(1, "rejected", by="B", reason="towed")
        store.decide(2, "approved", by="B", reason="good")
        store.set_policy(Approval.ONE_PERSON, by="B", reason="alone")
        store.keep_priors("rlg", '{"schema": "recal.priors/1"}', by="A")
        store.decide_priors("rlg", 1, "approved", by="B", reason="good")
        assert store.verify().intact
        return file, store.active()


def writes(store, active):
    """Every way to change the unit."""
    runs, other = [MergedRun(run_id="n", sha256="n")], table_to_dict(table(high=30.0))
    yield "import", lambda: store.import_table(other)
    yield "import again", lambda: store.import_table(active.table_dict, note="once more")
    yield "commit", lambda: commit(store, active, run="n")
    yield "rollback", lambda: store.rollback("SN-1", to="factory", **SIGNED)
    yield (
        "propose",
        lambda: store.propose(active.sha256, updated(active), runs, "{}", by="A", note="n"),
    )
    yield "approve", lambda: store.decide(3, "approved", by="C", reason="good")
    yield "reject", lambda: store.decide(3, "rejected", by="C", reason="bad")


def is_broken(url):
    """Whether `verify` says so, or cannot read the store."""
    try:
        with TableStore.open(url) as store:
            return not store.verify().intact
    except InputError:
        return True


def taken(url, active):
    """The writes that a store takes."""
    done = []
    try:
        with TableStore.open(url) as store:
            for name, write in writes(store, active):
                try:
                    write()
                    done.append(name)
                except (InputError, StoreRefused) as refused:
                    assert "\n" not in str(refused)
    except InputError as unreadable:
        assert "\n" not in str(unreadable)
    return done


def damaged(file, tmp_path, sql):
    """A copy with an edit made by hand, past foreign keys, its URL; None where there is none."""
    copy = tmp_path / "copy.db"
    shutil.copy(file, copy)
    with closing(sqlite3.connect(copy)) as db:
        try:
            changed = db.execute(sql).rowcount
        except sqlite3.IntegrityError:
            return None
        db.commit()
    return f"sqlite:///{copy}" if changed else None


def test_a_sound_store_takes_every_write_in_turn(filled, tmp_path):
    file, active = filled
    url = damaged(file, tmp_path, "UPDATE recal_tag SET number = number")
    assert not is_broken(url)
    assert taken(url, active) == ["import", "import again", "commit", "rollback", "reject"]
    assert not is_broken(url)


@pytest.mark.parametrize("sql", FEW)
def test_a_damaged_store_takes_no_write(filled, tmp_path, sql):
    file, active = filled
    url = damaged(file, tmp_path, sql)
    assert is_broken(url) and taken(url, active) == []


@pytest.mark.slow
@pytest.mark.parametrize("row", ["max", "min"])
def test_no_damage_of_a_column_is_built_on(filled, tmp_path, row):
    file, active = filled
    unseen = set()
    for name, column in COLUMNS:
        last = f"substr({column}, 1, length({column}) - 1) || '0'"
        for value in ("'x'", "x'00ff'", last, f"{column} + 1"):
            where = f"rowid = (SELECT {row}(rowid) FROM {name}) AND {column} IS NOT {value}"
            url = damaged(file, tmp_path, f"UPDATE {name} SET {column} = {value} WHERE {where}")
            if url is None:
                continue
            if is_broken(url):
                assert taken(url, active) == [], (name, column, value)
            else:
                unseen.add((name, column, value))
    for name in {name for name, _ in COLUMNS}:
        url = damaged(
            file, tmp_path, f"DELETE FROM {name} WHERE rowid = (SELECT {row}(rowid) FROM {name})"
        )
        assert taken(url, active) == [] if is_broken(url) else name in ENDS, name
    assert unseen == set()


@pytest.mark.slow
def test_no_flipped_bit_of_the_file_is_built_on(filled, tmp_path):
    file, active = filled
    raw, rng, found = file.read_bytes(), random.Random(5), 0
    for _ in range(FLIPS):
        flipped = bytearray(raw)
        flipped[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
        (tmp_path / "copy.db").write_bytes(flipped)
        url = f"sqlite:///{tmp_path}/copy.db"
        if is_broken(url):
            found += 1
            assert taken(url, active) == []
    assert found > FLIPS // 10
