"""The database under the table store: engine, transactions that wait and retry, schema migration.

SQLite keeps its rollback journal (not WAL): one file, so a copy of it is a whole store, and it reads from read-only
media. synchronous=EXTRA makes a commit survive loss of power; writers take the lock first (BEGIN IMMEDIATE).
"""

import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

from sqlalchemy import Connection, Engine, create_engine, event, exc, inspect, text
from sqlalchemy.engine import URL, make_url

from infield.store_schema import READABLE, SCHEMA_REVISION
from ins.records import InputError

LOCK_WAIT_S = 5.0
ATTEMPTS = 6
MIGRATION_LOCK = 5527003  # any number that all writers agree on (PostgreSQL advisory lock)
RETRY_SQLSTATES = ("40001", "40P01", "55P03")  # serialization failure, deadlock, lock not available
_ONE_MIGRATION = threading.Lock()  # Alembic's context is one per process
T = TypeVar("T")


class StoreConflict(RuntimeError):
    """Somebody else changed this unit meanwhile, or holds the store: read again and retry."""


class Database:
    """One store by its URL; nothing is created unless `create`."""

    def __init__(self, url: str, *, create: bool) -> None:
        self._engine, self.name = _engine(url, create=create)
        if create:
            self.write(_migrate)
        else:
            with self.reading() as connection:
                _require_schema(connection, self.name)

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """A transaction that only reads; every fault of the database is an InputError of one line."""
        try:
            with self._engine.begin() as connection:
                yield connection
        except exc.DBAPIError as error:
            raise InputError(f"store {self.name}: {_first_line(error)}") from None

    def write(self, work: Callable[[Connection], T]) -> T:
        """`work` in one transaction, repeated where another writer was faster; StoreConflict if it stays so."""
        writers = self._engine.execution_options(begin="BEGIN IMMEDIATE")
        for attempt in range(ATTEMPTS):
            try:
                with writers.begin() as connection:
                    return work(connection)
            except exc.DBAPIError as error:
                if not _worth_a_retry(error):
                    raise InputError(f"store {self.name}: not written: {_first_line(error)}") from None
                time.sleep(0.01 * 2**attempt)
        raise StoreConflict(f"store {self.name}: busy with other writers, nothing written; try again")

    def close(self) -> None:
        self._engine.dispose()


def store_exists(url: str) -> bool:
    """False where an SQLite store's file is missing; a server is taken to be there."""
    parsed = _parsed(url)
    path = parsed.database
    return parsed.get_backend_name() != "sqlite" or bool(path and Path(path).exists())


def _parsed(url: str) -> URL:
    try:
        parsed = make_url(url)
    except exc.ArgumentError:
        raise InputError(f"store {url[:200]!r}: not an SQLAlchemy URL; needed one like sqlite:///recal.db") from None
    return parsed.set(drivername="postgresql+psycopg") if parsed.drivername == "postgresql" else parsed


def _engine(url: str, *, create: bool) -> tuple[Engine, str]:
    parsed = _parsed(url)
    name = parsed.render_as_string(hide_password=True)
    options: dict[str, Any] = {}
    sqlite = parsed.get_backend_name() == "sqlite"
    if sqlite and parsed.database and parsed.database != ":memory:":
        path = Path(os.path.abspath(parsed.database))
        if not path.exists() and not create:
            raise InputError(f"no store at {name}")
        options["creator"] = lambda: sqlite3.connect(
            f"file:{quote(str(path))}?mode={'rwc' if create else 'rw'}", uri=True, timeout=LOCK_WAIT_S,
            check_same_thread=False,
        )  # fmt: skip
    try:
        engine = create_engine(parsed, **options)
    except (exc.NoSuchModuleError, ModuleNotFoundError) as error:
        raise InputError(f"store {name}: {error}; for PostgreSQL install strapdown-recal[postgres]") from None
    if sqlite:
        event.listen(engine, "connect", _set_pragmas)
        event.listen(engine, "begin", _begin)
    return engine, name


def _set_pragmas(connection: Any, record: Any) -> None:
    connection.isolation_level = None  # transactions begin where `_begin` says, not where sqlite3 guesses
    for pragma in ("foreign_keys=ON", "synchronous=EXTRA", f"busy_timeout={int(1000 * LOCK_WAIT_S)}"):
        connection.execute(f"PRAGMA {pragma}").close()


def _begin(connection: Connection) -> None:
    connection.exec_driver_sql(connection.get_execution_options().get("begin", "BEGIN"))


def _schema_of(connection: Connection) -> str | None:
    if not inspect(connection).has_table("alembic_version"):
        return None
    return connection.execute(text("SELECT version_num FROM alembic_version")).scalar()


def _require_schema(connection: Connection, name: str) -> None:
    found = _schema_of(connection)
    if found is None:
        raise InputError(f"no store at {name}: the database holds no recal tables")
    if found not in READABLE:
        _refuse_newer(found, f"store {name}")
        raise InputError(f"store {name}: schema {found}, needed {SCHEMA_REVISION} (importing a table upgrades it)")


def _refuse_newer(found: str | None, name: str) -> None:
    if found is not None and found > SCHEMA_REVISION:
        raise InputError(f"{name}: schema {found}, needed {SCHEMA_REVISION}: a newer recal made it, use that one")


def _migrate(connection: Connection) -> None:
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": MIGRATION_LOCK})
    found = _schema_of(connection)
    if found == SCHEMA_REVISION:
        return
    _refuse_newer(found, "store")
    from alembic import command  # 0.6 s, needed once in a store's life
    from alembic.util import CommandError

    try:
        with _ONE_MIGRATION:
            command.upgrade(alembic_config(connection), "head")
    except CommandError as error:
        raise InputError(f"store: cannot be upgraded to schema {SCHEMA_REVISION}: {error}") from None


def alembic_config(connection: Connection) -> Any:
    """Alembic's configuration for the packaged migrations on an open connection."""
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations").replace("%", "%%"))
    config.attributes["connection"] = connection
    return config


def _worth_a_retry(error: exc.DBAPIError) -> bool:
    if isinstance(error, exc.IntegrityError) or getattr(error.orig, "sqlstate", None) in RETRY_SQLSTATES:
        return True
    return getattr(error.orig, "sqlite_errorname", "").startswith(("SQLITE_BUSY", "SQLITE_LOCKED"))


def _first_line(error: exc.DBAPIError) -> str:
    return (str(error.orig).splitlines() or [type(error.orig).__name__])[0]
