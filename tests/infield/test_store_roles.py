"""The PostgreSQL roles of docs/store.md: the SQL there is run as it stands, then the roles try what
they may and may not.
"""

import re
import uuid
from contextlib import contextmanager
from pathlib import Path

import pytest
from sqlalchemy import create_engine, make_url, text
from sqlalchemy.pool import NullPool

import infield
from infield.store.table_store import MergedRun, TableStore
from infield.table.file import table_to_dict
from ins.records import InputError, TwinModel
from tests.infield.stores import (
    EVIDENCE,
    SIGNED,
    commit,
    database_url,
    factory,
    rows,
    table,
    tamper,
    updated,
)

DOCUMENT = Path(infield.__file__).parent.parent / "docs/store.md"


def documented_sql(schema, names):
    """The statements of the document, for a schema and role names of their own."""
    (block,) = re.findall(r"```sql\n(.*?)```", DOCUMENT.read_text(), re.S)
    block = re.sub(r"^--.*$", "", block, flags=re.M).replace("SCHEMA public", f"SCHEMA {schema}")
    for name, own in names.items():
        block = block.replace(name, own)
    return [statement.strip() for statement in block.split(";") if statement.strip()]


@contextmanager
def made_roles(url):
    """The two roles, by name; gone afterwards."""
    names = {name: f"{name}_{uuid.uuid4().hex}" for name in ("recal_writer", "recal_reader")}
    schema = make_url(url).query["options"].rpartition("=")[2]
    engine = create_engine(url, poolclass=NullPool)
    with engine.begin() as c:
        for statement in documented_sql(schema, names):
            c.execute(text(statement))
    try:
        yield names
    finally:
        with engine.begin() as c:
            for own in names.values():
                c.execute(text(f"DROP OWNED BY {own}"))
                c.execute(text(f"DROP ROLE {own}"))


@pytest.fixture
def urls(tmp_path):
    """URLs of the owner, a writer and a reader of a store with one unit."""
    with database_url("postgresql", tmp_path) as url:
        with TableStore.open(url, create=True) as store:
            commit(store, factory(store))
        with made_roles(url) as names:
            own = make_url(url)
            writer = own.set(username=names["recal_writer"], password="change me")
            reader = own.set(username=names["recal_reader"], password="change me too")
            yield url, *(u.render_as_string(hide_password=False) for u in (writer, reader))


def test_the_writer_can_do_its_work(urls):
    _, writer, reader = urls
    with TableStore.open(writer, create=True) as store:
        third = commit(store, store.active("SN-1"), run="run-2")
        assert store.rollback("SN-1", to=2, **SIGNED).number == 4 and not store.has_run("run-2")
        assert store.remember_contradictions("SN-1", "rlg", "", [EVIDENCE]) == 1
        store.import_table(table_to_dict(table("SN-2")), twin=TwinModel(imu_serial="SN-2"))
        parent = store.active("SN-1")
        store.propose(
            parent.sha256,
            updated(parent),
            [MergedRun(run_id="p", sha256="p")],
            "{}",
            by="A",
            note="why",
        )
        assert store.decide(1, "approved", "SN-1", by="B", reason="good").state == "approved"
        assert third.number == 3 and store.verify().intact
    with TableStore.open(reader) as store:
        assert store.active("SN-1").number == 5 and store.verify().intact
        with pytest.raises(InputError, match="not written: permission denied"):
            commit(store, store.active("SN-1"), run="run-9")


FORBIDDEN = (
    "UPDATE recal_revision SET note = 'x'",
    "DELETE FROM recal_revision",
    "TRUNCATE recal_revision CASCADE",
    "UPDATE recal_contradiction SET evidence_json = '{}'",
    "DELETE FROM recal_contradiction",
    "DELETE FROM recal_proposal",
    "UPDATE recal_decision SET verdict = 'approved'",
    "DELETE FROM recal_unit",
    "UPDATE recal_unit SET imu_serial = 'SN-9'",
    "DELETE FROM recal_tag",
    "DROP TABLE recal_merged_run",
    "ALTER TABLE recal_revision DISABLE TRIGGER recal_append_only",
    "DROP FUNCTION recal_append_only() CASCADE",
    "SET session_replication_role = replica",
    "UPDATE alembic_version SET version_num = '0000'",
)


def tried(url, statement):
    engine = create_engine(url, poolclass=NullPool)
    with engine.begin() as c:
        c.execute(text(statement))


def test_writer_and_reader_cannot_change_or_delete_what_is_written(urls):
    owner, *others = urls
    before = rows(owner, "SELECT * FROM recal_revision ORDER BY number")
    for url in others:
        for statement in FORBIDDEN:
            with pytest.raises(Exception, match=r"permission denied|must be owner"):
                tried(url, statement)
    assert rows(owner, "SELECT * FROM recal_revision ORDER BY number") == before


@pytest.mark.parametrize("statement", FORBIDDEN[:7])
def test_the_owner_is_stopped_by_the_triggers(urls, statement):
    with pytest.raises(Exception, match=r"is append-only: (UPDATE|DELETE|TRUNCATE) refused"):
        tried(urls[0], statement)


def test_verify_says_where_a_trigger_is_off(urls):
    tried(urls[0], "ALTER TABLE recal_revision DISABLE TRIGGER recal_append_only")
    tamper(urls[0], "DROP TRIGGER recal_append_only ON recal_proposal")
    with TableStore.open(urls[2]) as store:
        said = store.verify().faults
    assert said == (
        "recal_proposal: its trigger recal_append_only is off or gone",
        "recal_revision: its trigger recal_append_only is off or gone",
    )
