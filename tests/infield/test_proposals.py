"""Proposals: kept without touching the active table, decided once, refused when the table has
moved, every change found.
"""

import json

import pytest

from infield.store.errors import AlreadyRejected
from infield.store.proposals import signed_note
from infield.store.table_store import MergedRun, StoreConflict, TableStore, UnknownUnit
from infield.table.file import canonical_json, table_sha256, table_to_dict
from ins.records import InputError
from tests.infield import stores
from tests.infield.stores import SIGNED, table, tamper

url, store = stores.url, stores.store

UTC = "2026-03-01T05:00:00Z"
LATER = "2099-03-01T05:00:00Z"
REPORT = '{"verdict": "proposed", "nis": 1.0000000000000002}'


def updated(parent, shift_deg_h=0.001):
    """An update of a revision, or of a table that no store holds yet: every node moved."""
    old, sha256 = (
        (parent.table, parent.sha256)
        if hasattr(parent, "number")
        else (parent, table_sha256(table_to_dict(parent)))
    )
    return old.replaced(
        parameters=old.parameters + shift_deg_h, provenance={"parent_sha256": sha256, "runs": []}
    )


def propose(store, parent, *, run="run-1", shift_deg_h=0.001, **more):
    new, merged = updated(parent, shift_deg_h), [MergedRun(run_id=run, sha256=run)]
    return store.propose(
        new.provenance["parent_sha256"], new, merged, REPORT, **{"by": "fleet", **more}
    )


def decide(store, number, verdict="approved", **more):
    return store.decide(
        number, verdict, **{"by": "A. Reviewer", "reason": "residuals are white", **more}
    )


def test_a_proposal_changes_no_table(store, url):
    first = store.import_table(table_to_dict(table()))
    with TableStore.open(url, clock=lambda: UTC) as earlier:
        kept = propose(earlier, first, by="fleet", note="night of 1 March")
    assert store.active() == first and len(store.history()) == 1 and not store.has_run("run-1")
    assert (kept.number, kept.state, kept.proposed_by) == (1, "open", "fleet")
    assert (kept.note, kept.proposed_utc) == ("night of 1 March", UTC)
    assert kept.runs == (MergedRun(run_id="run-1", sha256="run-1"),)
    assert kept.parent_sha256 == first.sha256
    full = store.proposal(1, "SN-1")
    assert full.table_json == canonical_json(table_to_dict(updated(first)))
    assert full.report == json.loads(REPORT)
    assert store.proposals() == [kept]
    assert store.proposals("SN-2") == [] == store.proposals(state="approved")


def test_approval_commits_what_was_proposed_and_says_who(store, url):
    first = store.import_table(table_to_dict(table()))
    kept = propose(store, first)
    with TableStore.open(url, clock=lambda: LATER) as later:
        done = decide(later, 1)
    active = store.active()
    assert active.number == 2
    assert active.kind == "update"
    assert active.sha256 == kept.sha256
    assert active.parent_sha256 == first.sha256
    assert active.note == "proposal 1 approved by A. Reviewer: residuals are white"
    report = json.loads(active.report_json)
    assert report["verdict"] == "committed"
    assert report["proposal"] == 1
    assert report["nis"] == 1.0000000000000002
    assert done.state == "approved"
    assert done.decision.revision_number == 2
    assert done.decision.decided_utc == LATER
    assert done.decision.decided_by == "A. Reviewer"
    assert done.decision.reason == "residuals are white"
    assert store.has_run("run-1", "SN-1")


def test_rejection_leaves_the_table_and_is_final(store):
    first = store.import_table(table_to_dict(table()))
    propose(store, first)
    assert decide(store, 1, "rejected").state == "rejected" and store.active() == first
    for verdict in ("approved", "rejected"):
        with pytest.raises(InputError, match="proposal 1 was rejected"):
            decide(store, 1, verdict)
    assert store.active() == first and len(store.history()) == 1


def test_approval_is_refused_where_the_table_has_moved(store):
    first = store.import_table(table_to_dict(table()))
    propose(store, first)
    propose(store, first, run="run-2", shift_deg_h=0.002)
    decide(store, 1)
    assert [p.state for p in store.proposals()] == ["approved", "out of date"]
    second = store.active()
    with pytest.raises(StoreConflict, match="update again"):
        decide(store, 2)
    # neither table nor decision
    assert store.active() == second and store.proposals()[1].decision is None
    store.rollback(to="factory", **SIGNED)  # its parent is active again
    assert store.proposals()[1].state == "open" and decide(store, 2).decision.revision_number == 4
    assert store.active().number == 4


def test_the_same_update_is_kept_once(store):
    first = store.import_table(table_to_dict(table()))
    assert propose(store, first) == propose(store, first, by="again")
    # the same table from other runs is another update
    assert propose(store, first, run="run-2").number == 2
    decide(store, 1, "rejected")
    with pytest.raises(AlreadyRejected, match=r"rejected by .* as proposal 1"):
        propose(store, first)
    again = propose(store, first, note="thermometer replaced, see log 12")
    assert (again.number, again.state) == (3, "open") and propose(store, first) == again


def test_a_unit_without_a_table_stays_unknown_until_approval(store):
    store.import_table(table_to_dict(table()))
    new = table("NEW")
    propose(store, new, first_table=table_to_dict(new))
    assert [u.unit.imu_serial for u in store.units()] == ["SN-1"]
    assert store.active().unit.imu_serial == "SN-1"
    with pytest.raises(UnknownUnit, match="no table for serial NEW"):
        store.active("NEW")
    assert store.proposals("NEW")[0].state == "open"
    decide(store, 1, serial="NEW")
    assert [r.kind for r in store.history("NEW")] == ["factory", "update"]
    assert store.active("NEW").parent_sha256 == table_sha256(table_to_dict(new))


def test_two_first_proposals_exclude_each_other(store):
    old, other = table("NEW"), table("NEW").replaced(created_utc="2026-03-02T05:00:00Z")
    propose(store, old, first_table=table_to_dict(old))
    propose(store, other, run="run-2", first_table=table_to_dict(other))
    decide(store, 2)
    with pytest.raises(StoreConflict):
        decide(store, 1)
    assert [p.state for p in store.proposals()] == ["out of date", "approved"]


def test_wrong_parent_is_a_broken_promise(store):
    first = store.import_table(table_to_dict(table()))
    with pytest.raises(ValueError, match="parent"):
        store.propose("0" * 64, updated(first), [], "{}", by="fleet")
    with pytest.raises(ValueError, match="first table"):
        propose(store, first, first_table=table_to_dict(table("SN-2")))


@pytest.mark.parametrize(
    "wrong",
    [
        {"by": ""},
        {"by": "  "},
        {"by": "a\nb"},
        {"by": "x" * 201},
        {"reason": ""},
        {"reason": "\x1b[2J"},
        {"reason": "x" * 4001},
        {"reason": "nul \x00"},
        {"verdict": "maybe"},
        {"number": 2},
        {"number": 0},
        {"number": -1},
        {"serial": "SN-2"},
    ],
)
def test_a_decision_needs_a_name_and_a_reason(store, wrong):
    first = store.import_table(table_to_dict(table()))
    propose(store, first)
    with pytest.raises(InputError, match=r"^[^\n]*$"):
        decide(store, **{"number": 1, **wrong})
    assert store.proposals()[0].decision is None and store.active() == first
    with pytest.raises(InputError):
        signed_note(wrong.get("by", ""), wrong.get("reason", ""))


@pytest.mark.parametrize(
    "column",
    [
        "proposed_utc",
        "proposed_by",
        "parent_sha256",
        "sha256",
        "report_sha256",
        "runs_json",
        "note",
        "record_sha256",
        "number",
        "table_json",
        "report_json",
    ],
)
def test_a_changed_proposal_is_found(store, url, column):
    first = store.import_table(table_to_dict(table()))
    for k in range(2):
        propose(store, first, run=f"run-{k}")
    tamper(
        url,
        f"UPDATE recal_proposal SET {column} = {9 if column == 'number' else repr('[]')} WHERE"
        " number = 1",
    )
    with pytest.raises(InputError, match=r"the row was changed|no proposal 1"):
        decide(store, 1)
    assert store.active() == first


def test_rollback_only_from_the_revision_that_was_seen(store):
    first = store.import_table(table_to_dict(table()))
    propose(store, first)
    decide(store, 1)
    with pytest.raises(StoreConflict, match=r"revision 2.*1"):
        store.rollback(to="factory", active_number=1, **SIGNED)
    back = store.rollback(to="factory", active_number=2, **SIGNED)
    assert back.note == "rolled back by B: wrong run"
