"""Learnt priors in the store: kept in order, put to use by an approval, and every change found."""

import pytest
from sqlalchemy import exc

from infield.store.errors import RowFault, UnknownUnit
from infield.store.table_store import TableStore
from ins.records import InputError
from tests.infield.stores import rows, tamper

SIGNED = {"by": "K. Reviewer", "reason": "240 sessions"}


def test_the_last_approval_is_in_use(store):
    assert store.priors() == [] and store.priors_in_use("rlg") is None
    first = store.keep_priors("rlg", '{"a": 1}', by="night", note="first")
    assert (first.number, first.state, first.learnt_by, first.note) == (1, "open", "night", "first")
    assert store.keep_priors("rlg", '{"a": 1}') == first  # the same again
    second = store.keep_priors("rlg", '{"a": 2}')
    assert store.keep_priors("fog", '{"a": 1}').number == 1
    assert store.decide_priors("rlg", 1, "approved", **SIGNED).state == "in use"
    assert store.priors_in_use("rlg").number == 1 and store.priors_in_use("fog") is None
    store.decide_priors("rlg", second.number, "approved", **SIGNED)
    assert [r.state for r in store.priors("rlg")] == ["approved", "in use"]
    back = store.decide_priors("rlg", 1, "approved", by="K. Reviewer", reason="2 was a summer")
    assert back.state == "in use" and [d.number for d in back.decisions] == [1, 3]
    assert store.verify().intact


def test_decisions_are_signed_and_made_once(store):
    with pytest.raises(UnknownUnit, match="no priors of rlg: recal fleet learn"):
        store.decide_priors("rlg", 1, "approved", **SIGNED)
    store.keep_priors("rlg", "{}")
    for wrong in ({"by": "", "reason": "x"}, {"by": "K.", "reason": ""}):
        with pytest.raises(InputError):
            store.decide_priors("rlg", 1, "approved", **wrong)
    with pytest.raises(InputError, match=r"priors 2.*needed 1.*1"):
        store.decide_priors("rlg", 2, "approved", **SIGNED)
    store.decide_priors("rlg", 1, "rejected", **SIGNED)
    with pytest.raises(InputError, match="were rejected by K"):
        store.decide_priors("rlg", 1, "approved", **SIGNED)


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE recal_priors SET priors_json = '{\"a\": 9}' WHERE number = 1",
        "UPDATE recal_priors SET note = 'x' WHERE number = 1",
        "DELETE FROM recal_priors WHERE number = 1",
        "UPDATE recal_priors_decision SET priors_number = 2",
        "UPDATE recal_priors_decision SET decided_by = 'somebody else'",
    ],
)
def test_a_changed_row_is_found(url, statement):
    with TableStore.open(url, create=True) as store:
        for text in ("{}", '{"a": 1}'):
            store.keep_priors("rlg", text)
        store.decide_priors("rlg", 1, "approved", **SIGNED)
        tamper(url, statement)
        with pytest.raises(RowFault, match="was changed or is missing"):
            store.priors_in_use("rlg")
        assert not store.verify().intact


def test_postgresql_refuses_to_change_them(url):
    from sqlalchemy import create_engine, text

    with TableStore.open(url, create=True) as store:
        store.keep_priors("rlg", "{}")
    if url.startswith("sqlite"):
        return
    engine = create_engine(url)
    with pytest.raises(exc.DBAPIError, match="append-only"), engine.begin() as c:
        c.execute(text("DELETE FROM recal_priors"))
    engine.dispose()
    assert rows(url, "SELECT count(*) FROM recal_priors") == [(1,)]
