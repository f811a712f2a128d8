"""Stores on SQLite and PostgreSQL for the tests: the fixtures `url` and `store`, tables, updates,
edits from behind.

PostgreSQL takes part where RECAL_TEST_POSTGRES_URL names a database (`.ci/postgres run COMMAND`
makes one); each test gets a schema of its own in it.
"""

import os
import subprocess
import uuid
from contextlib import contextmanager

import numpy as np
import pytest
from sqlalchemy import create_engine, make_url, text
from sqlalchemy.pool import NullPool
from sqlalchemy.schema import CreateSchema, DropSchema

from infield.session.disagreement import SessionEvidence
from infield.store.table_store import MergedRun, TableStore
from infield.table.file import table_to_dict
from infield.table.thermal_table import EvenNodes, default_table

UTC = "2026-03-01T05:00:00Z"
DATABASES = ("sqlite", "postgresql")
EVIDENCE = SessionEvidence(
    run_id="odd",
    run_sha256="odd",
    start_utc="2026-04-01T00:00:00Z",
    temperature_degC=np.zeros(3),
    bias_deg_h=np.zeros(3),
    bend_deg_h=np.zeros(3),
    covariance=np.eye(3),
)
SIGNED = {"by": "B", "reason": "wrong run"}  # of a rollback


@contextmanager
def database_url(kind, folder):
    """The URL of a database that holds nothing yet."""
    if kind == "sqlite":
        yield f"sqlite:///{folder}/recal.db"
        return
    server = os.environ.get("RECAL_TEST_POSTGRES_URL")
    if not server:
        pytest.skip(
            "RECAL_TEST_POSTGRES_URL names no PostgreSQL database; .ci/postgres run COMMAND"
            " makes one"
        )
    schema = f"t_{uuid.uuid4().hex}"
    admin = create_engine(server, isolation_level="AUTOCOMMIT", poolclass=NullPool)
    with admin.connect() as c:
        c.execute(CreateSchema(schema))
    try:
        yield in_schema(server, schema)
    finally:
        with admin.connect() as c:
            c.execute(DropSchema(schema, cascade=True))


def in_schema(server, schema):
    return (
        make_url(server)
        .update_query_dict({"options": f"-csearch_path={schema}"})
        .render_as_string(hide_password=False)
    )


@pytest.fixture(params=DATABASES)
def url(request, tmp_path):
    with database_url(request.param, tmp_path) as made:
        yield made


@pytest.fixture
def store(url):
    with TableStore.open(url, create=True) as opened:
        yield opened


def tamper(url, *statements):
    """SQL on the database itself, past foreign keys and triggers; a statement may bring its
    parameters.
    """
    engine = create_engine(url, poolclass=NullPool)
    with engine.begin() as c:
        if c.dialect.name == "postgresql":
            c.execute(text("SET session_replication_role = replica"))
        for statement in statements:
            sql, parameters = statement if isinstance(statement, tuple) else (statement, {})
            c.execute(text(sql), parameters)
    engine.dispose()


def rows(url, sql):
    """What a query gives."""
    engine = create_engine(url, poolclass=NullPool)
    with engine.connect() as c:
        found = [tuple(row) for row in c.execute(text(sql)).all()]
    engine.dispose()
    return found


def table(serial="SN-1", technology="rlg", mode="", high=20.0):
    return default_table(
        imu_serial=serial,
        gyro_technology=technology,
        gyro_mode=mode,
        created_utc=UTC,
        span=EvenNodes(low_degC=0, high_degC=high),
    )


def updated(revision, shift_deg_h=0.001):
    """An update of a stored table: every node moved."""
    return revision.table.replaced(
        parameters=revision.table.parameters + shift_deg_h,
        provenance={"parent_sha256": revision.sha256, "runs": []},
    )


def commit(store, parent, *, run="run-1", **changes):
    runs = [MergedRun(run_id=run, sha256=run)] if run else []
    return store.commit_update(
        parent.sha256, updated(parent, **changes), runs, '{"verdict": "committed"}'
    )


def factory(store, serial="SN-1", **changes):
    """A unit's first revision."""
    return store.import_table(table_to_dict(table(serial, **changes)))


@contextmanager
def small_disk(folder, size="256k"):
    """A folder on a disk of its own; only root may mount one."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "none", str(folder)]
    mounted = subprocess.run(command, capture_output=True, text=True)
    if mounted.returncode != 0:
        pytest.skip(f"no disk can be mounted here: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@contextmanager
def read_only(folder):
    """A folder whose files nobody may write: by its mode, for root by mounting it so."""
    if os.geteuid() == 0:
        done = subprocess.run(
            ["mount", "--bind", str(folder), str(folder)], capture_output=True, text=True
        )
        if done.returncode != 0:
            pytest.skip(
                f"root writes what it likes, and nothing can be mounted here: {done.stderr.strip()}"
            )
        subprocess.run(["mount", "-o", "remount,bind,ro", str(folder)], check=True)
    else:
        folder.chmod(0o555)
        for file in folder.iterdir():
            file.chmod(0o444)
    try:
        yield
    finally:
        if os.geteuid() == 0:
            subprocess.run(["umount", "-l", str(folder)], check=True)
        else:
            folder.chmod(0o755)
