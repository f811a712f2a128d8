"""Who approves is not who put forward, unless the store says that one person may; numbers of
proposals are of the store; a rollback is signed and says what it takes back.
"""

import pytest

from infield.store.errors import SamePerson
from infield.store.proposal_rows import Approval
from infield.store.table_store import MergedRun
from infield.table.file import table_to_dict
from ins.records import InputError
from tests.infield.stores import SIGNED, commit, factory, rows, table, tamper, updated


def put_forward(store, parent, *, by="Anna Groß", run="p", shift_deg_h=0.001, note=""):
    runs = [MergedRun(run_id=run, sha256=run)]
    new = updated(parent, shift_deg_h)
    return store.propose(parent.sha256, new, runs, '{"verdict": "proposed"}', by=by, note=note)


def approve(store, number, by, **unit):
    return store.decide(number, "approved", by=by, reason="residuals white", **unit)


SAME = ("Anna Groß", " anna  groß ", "ANNA GROSS", "Ａｎｎａ Groß")


@pytest.mark.parametrize("by", SAME)
def test_who_put_it_forward_does_not_approve_it(store, by):
    first = factory(store)
    put_forward(store, first)
    with pytest.raises(SamePerson) as refused:
        approve(store, 1, by)
    assert "proposal 1" in str(refused.value) and refused.value.code == "same_person"
    assert store.active() == first and store.proposals()[0].state == "open"
    assert approve(store, 1, "Ben").decision.revision_number == 2


def test_composed_and_decomposed_letters_are_one_name(store):
    put_forward(store, factory(store), by="Rene\u0301")
    with pytest.raises(SamePerson):
        approve(store, 1, "REN\u00c9")


def test_who_put_it_forward_may_take_it_back(store):
    put_forward(store, factory(store))
    done = store.decide(1, "rejected", by="Anna Groß", reason="the wrong run")
    assert done.state == "rejected"


def test_a_proposal_of_nobody_finds_no_second_person(store, monkeypatch):
    """As stores of before hold them; a new one needs a name."""
    first = factory(store)
    with pytest.raises(InputError, match="by: got"):
        put_forward(store, first, by=" ")
    monkeypatch.setattr("infield.store.proposals.signed_line", lambda text, name: text)
    put_forward(store, first, by="")
    monkeypatch.undo()
    with pytest.raises(SamePerson, match="names nobody"):
        approve(store, 1, "Ben")
    assert store.active() == first


def test_a_store_of_one_person(store, url):
    assert store.policy().approval == Approval.TWO_PEOPLE and store.policy().number == 0
    first = store.import_table(table_to_dict(table()), one_person="Anna")
    rule = store.policy()
    assert (rule.number, rule.approval, rule.set_by) == (1, Approval.ONE_PERSON, "Anna")
    put_forward(store, first, by="Anna")
    assert approve(store, 1, "Anna").state == "approved"
    assert store.set_policy(Approval.ONE_PERSON, by="Anna").number == 1  # in force already
    rule = store.set_policy(Approval.TWO_PEOPLE, by="Ben", reason="we are two now")
    assert (rule.number, rule.reason) == (2, "we are two now")
    put_forward(store, store.active(), by="Anna", run="q")
    with pytest.raises(SamePerson):
        approve(store, 2, "Anna")
    assert store.verify().intact and len(rows(url, "SELECT * FROM recal_policy")) == 2


@pytest.mark.parametrize(
    "damage",
    [
        "UPDATE recal_policy SET approval = 'one_person' WHERE number = 2",
        "UPDATE recal_policy SET set_by = 'Ben' WHERE number = 1",
        "UPDATE recal_policy SET number = 9 WHERE number = 2",
        "DELETE FROM recal_policy WHERE number = 1",
    ],
)
def test_a_changed_rule_is_found_and_nothing_is_approved(store, url, damage):
    put_forward(store, factory(store), by="Anna")
    store.set_policy(Approval.ONE_PERSON, by="Anna")
    store.set_policy(Approval.TWO_PEOPLE, by="Anna")
    tamper(url, damage)
    assert any("policy" in fault for fault in store.verify().faults)
    for by in ("Anna", "Ben"):
        with pytest.raises(InputError, match="policy"):
            approve(store, 1, by)
    assert store.active().number == 1


def test_a_store_where_each_unit_counted_for_itself_needs_the_serial(store, monkeypatch):
    firsts = [factory(store, serial) for serial in ("SN-1", "SN-2")]
    monkeypatch.setattr("infield.store.proposals.next_number", lambda c: 1)
    for first in firsts:
        put_forward(store, first)
    monkeypatch.undo()
    assert store.verify().intact
    with pytest.raises(InputError, match="several units"):
        approve(store, 1, "Ben")
    assert approve(store, 1, "Ben", serial="SN-2").decision.revision_number == 2
    assert put_forward(store, firsts[0], run="q").number == 2 and store.verify().intact


@pytest.mark.parametrize("wrong", [{"by": ""}, {"by": " "}, {"reason": ""}, {"reason": "\x1b[2J"}])
def test_a_rollback_needs_a_name_and_a_reason(store, wrong):
    commit(store, factory(store))
    with pytest.raises(InputError, match=r"^(by|reason): got"):
        store.rollback("SN-1", **{**SIGNED, **wrong})
    assert store.active().number == 2
