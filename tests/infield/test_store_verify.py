"""`TableStore.verify` on both databases: whatever is changed, deleted or moved is found and named,
and nothing else is.
"""

import json
from dataclasses import replace

import pytest

from infield.store.rows import record_sha256
from infield.store.table_store import MergedRun
from infield.table.file import table_to_dict
from ins.records import InputError, TwinModel
from tests.infield.stores import EVIDENCE, SIGNED, commit, factory, rows, table, tamper, updated


def report_of(parent, new, **more):
    return json.dumps(
        {
            "schema": "recal.update/1",
            "verdict": "committed",
            "table_before_sha256": parent.sha256,
            "table_after_sha256": new,
            **more,
        }
    )


@pytest.fixture
def full(store):
    """Unit SN-1: factory, two updates, a rollback, an update; a twin; a contradiction. Unit SN-2:
    one table.
    """
    first = store.import_table(table_to_dict(table()), twin=TwinModel(imu_serial="SN-1"))
    second = commit(store, first, run="run-1")
    commit(store, second, run="run-2")
    back = store.rollback("SN-1", to=2, **SIGNED)
    commit(store, back, run="run-3", shift_deg_h=0.002)
    store.remember_contradictions("SN-1", "rlg", "", [EVIDENCE])
    factory(store, "SN-2", technology="fog")
    return store


def faults(store, **outside):
    """What is broken, by serial; the key "" for what belongs to no unit."""
    found = store.verify(**outside)
    said = {"": list(found.faults), **{u.unit.imu_serial: list(u.faults) for u in found.units}}
    assert found.intact == (not any(said.values()))
    return {serial: lines for serial, lines in said.items() if lines}


def test_a_store_as_written_is_intact(full, url):
    before = rows(url, "SELECT * FROM recal_revision ORDER BY unit_id, number")
    found = full.verify()
    assert faults(full) == {}
    assert [(u.unit.imu_serial, u.revisions) for u in found.units] == [("SN-1", 5), ("SN-2", 1)]
    ((head,),) = rows(url, "SELECT record_sha256 FROM recal_revision WHERE number = 5")
    assert found.units[0].head_sha256 == head
    assert rows(url, "SELECT * FROM recal_revision ORDER BY unit_id, number") == before


OF_SN_1 = "unit_id = (SELECT id FROM recal_unit WHERE imu_serial = 'SN-1')"
DAMAGE = {  # what was done, and how the line that tells it begins
    "UPDATE recal_revision SET table_json = replace(table_json, '0.001', '0.2') WHERE number = 2": (
        "revision 2: the table"
    ),
    "UPDATE recal_revision SET note = 'better' WHERE number = 3": "revision 3: the row",
    "UPDATE recal_revision SET report_json = '{}' WHERE number = 3": "revision 3: the row",
    "UPDATE recal_revision SET created_utc = '2020' WHERE number = 5": "revision 5: the row",
    f"DELETE FROM recal_revision WHERE number = 1 AND {OF_SN_1}": "revision 1 is missing",
    "DELETE FROM recal_revision WHERE number = 3": "revision 3 is missing",
    "DELETE FROM recal_revision WHERE number = 5": "revision 5 is missing",
    "UPDATE recal_tag SET number = 2 WHERE name = 'active' AND number = 5": "tag active is on",
    f"DELETE FROM recal_tag WHERE name = 'factory' AND {OF_SN_1}": "tag factory is missing",
    "DELETE FROM recal_merged_run WHERE run_sha256 = 'run-3'": "merged run run-3 is missing",
    "UPDATE recal_merged_run SET run_sha256 = 'run-9' WHERE run_sha256 = 'run-3'": (
        "merged run run-9"
    ),
    "UPDATE recal_unit SET twin_json = replace(twin_json, '0.002', '0.001')": "twin: the row",
    "UPDATE recal_unit SET twin_json = NULL": "twin: the record is missing",
    "UPDATE recal_contradiction SET evidence_json = replace(evidence_json, '1.0', '2.0')": (
        "contradicting run odd"
    ),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_found_and_named(full, url, damage):
    said = DAMAGE[damage]
    tamper(url, damage)
    found = faults(full)
    assert list(found) == ["SN-1"] and any(line.startswith(said) for line in found["SN-1"]), found


def test_a_row_moved_to_another_unit_is_found(full, url):
    (one,), (two,) = rows(url, "SELECT id FROM recal_unit ORDER BY imu_serial")
    tamper(
        url,
        f"UPDATE recal_revision SET unit_id = {two}, number = 2 WHERE number = 5 AND unit_id ="
        f" {one}",
    )
    found = faults(full)
    assert any("revision 5" in said for said in found["SN-1"])
    assert any("revision 2" in said for said in found["SN-2"])


def test_a_unit_deleted_altogether_leaves_its_rows_behind(full, url):
    tamper(url, "DELETE FROM recal_unit WHERE imu_serial = 'SN-1'")
    assert any("recal_revision" in line for line in faults(full)[""])


def test_the_last_revision_cut_off_with_its_tag_and_runs(full, url):
    """Consistent inside: what was kept elsewhere finds it."""
    head, last = full.verify().units[0].head_sha256, full.active("SN-1")
    assert faults(full, heads=[head[:12]]) == {}
    tamper(
        url,
        "DELETE FROM recal_contradiction",
        "UPDATE recal_tag SET number = 4 WHERE number = 5",
        "DELETE FROM recal_revision WHERE number = 5",
        "DELETE FROM recal_merged_run WHERE run_sha256 = 'run-3'",
    )
    assert faults(full) == {}
    assert faults(full, heads=[head]) == {
        "": [f"head {head}: in no chain of the store: revisions were cut off or rewritten"]
    }
    kept = {"verdict": "committed", "imu_serial": "SN-1", "gyro_technology": "rlg", "revision": 5}
    said = faults(full, reports={"update.json": {**kept, "table_after_sha256": last.sha256}})
    assert said == {"": ["update.json: SN-1 revision 5 is not in the store"]}


def test_a_row_rewritten_with_its_hash_breaks_the_next_link(full, url):
    """Who can compute the hash of one row has to rewrite all that follow."""
    key = full.active("SN-1").unit
    names = (
        "number, kind, created_utc, parent_sha256, sha256, table_json, runs_json, restored_number,"
        " report_json, note"
    )
    found = rows(url, f"SELECT {names} FROM recal_revision WHERE number = 3")[0]
    before = rows(url, "SELECT record_sha256 FROM recal_revision WHERE number = 2")[0][0]
    values = {**dict(zip(names.split(", "), found)), "note": "forged"}
    forged = record_sha256(key, values, before)
    tamper(
        url,
        (
            "UPDATE recal_revision SET note = 'forged', record_sha256 = :r WHERE number = 3",
            {"r": forged},
        ),
    )
    (line,) = faults(full)["SN-1"]
    assert line.startswith("revision 4: the row, or its link to the one before")


def test_a_report_is_compared_with_the_stored_one(store):
    first = factory(store)
    new = updated(first)
    sha256 = store.commit_update(
        first.sha256, new, [MergedRun(run_id="r", sha256="r")], "{}"
    ).sha256
    store.rollback(**SIGNED)
    report = report_of(first, sha256, points=[1.0], imu_serial="SN-1", gyro_technology="rlg")
    done = store.commit_update(first.sha256, new, [MergedRun(run_id="r", sha256="r")], report)
    kept = {
        **json.loads(report),
        "revision": done.number,
        "rollback_command": "recal table rollback ...",
    }
    assert faults(store, reports={"update.json": kept}) == {}
    said = faults(store, reports={"update.json": {**kept, "points": [2.0]}})[""]
    assert said == [
        "update.json: SN-1 revision 4: the report differs from the stored one in points"
    ]
    said = faults(store, reports={"update.json": {**kept, "table_after_sha256": "0" * 64}})[""]
    assert said == ["update.json: SN-1 revision 4 is another table in the store"]
    with pytest.raises(InputError, match="needed a report of a committed update"):
        store.verify(reports={"update.json": {**kept, "verdict": "proposed"}})
    with pytest.raises(InputError, match="needed at least 12 hexadecimal digits"):
        store.verify(["abc"])


def test_proposals_are_checked_too(store, url):
    first = factory(store)
    runs = [MergedRun(run_id="r", sha256="r")]
    proposed = store.propose(
        first.sha256, updated(first), runs, report_of(first, "x"), by="A", note="why"
    )
    other = updated(replace(first), 0.003)
    store.propose(
        first.sha256, other, [MergedRun(run_id="s", sha256="s")], "{}", by="A", note="why"
    )
    assert faults(store) == {}
    store.decide(2, "approved", "SN-1", by="B", reason="good")
    assert faults(store) == {} and proposed.number == 1
    tamper(url, "UPDATE recal_proposal SET table_json = replace(table_json, '0.003', '0.004')")
    assert faults(store)["SN-1"] == [
        "proposal 2: the row was changed or is missing, its hash does not match"
    ]
    tamper(
        url,
        "UPDATE recal_proposal SET table_json = replace(table_json, '0.004', '0.003')",
        "UPDATE recal_tag SET number = 1",
        "DELETE FROM recal_revision WHERE number = 2",
        "DELETE FROM recal_merged_run",
    )
    assert faults(store)["SN-1"] == [
        "proposal 2: approved as revision 2, which does not hold its table"
    ]
