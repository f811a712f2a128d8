"""The database under the table store: engine, transactions that wait and retry, schema migration.

SQLite keeps its rollback journal (not WAL): one file, so a copy of it is a whole store, and it
reads from read-only media. synchronous=EXTRA makes a commit survive loss of power; writers take the
lock first (BEGIN IMMEDIATE). On PostgreSQL a reader sees one snapshot (REPEATABLE READ, READ ONLY).
No message holds a password.

Decision: docs/decisions/0022-sqlite-journal.md.
"""

import os
import re
import sqlite3
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

from sqlalchemy import Connection, Engine, create_engine, event, exc, inspect, text
from sqlalchemy.engine import URL, make_url

from infield.store.errors import NoStore, StoreBusy, StoreError
from infield.store.schema import READABLE, SCHEMA_REVISION

LOCK_WAIT_S = 10.0  # for a lock that others hold (docs/store.md)
CONNECT_WAIT_S = 10  # for a server
ATTEMPTS = 6
# any numbers that all writers agree on (PostgreSQL advisory locks)
MIGRATION_LOCK, NUMBERING_LOCK = 5527003, 5527004
HINTS = {"SQLITE_IOERR": " (no room, a limit on file size, or a failing medium)"}
# what a database raises; SQLite also while it connects, and in bytes that are no text
DAMAGES = (exc.DBAPIError, sqlite3.Error, UnicodeDecodeError)
RETRY_SQLSTATES = ("40001", "40P01", "55P03")  # serialization failure, deadlock, lock not available
QUERY_SECRET = re.compile(r"(?i)((?:ssl)?passw(?:or)?d=)[^&]*")
_ONE_MIGRATION = threading.Lock()  # Alembic's context is one per process
T = TypeVar("T")


def utc_now() -> str:
    """The time of this machine, ISO 8601 in UTC."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


class Database:
    """One store by its URL; nothing is created unless `create`.

    any_clock: a clock behind the newest row may write. clock: tells the time that rows get, ISO
    8601 in UTC.
    """

    def __init__(
        self, url: str, *, create: bool, any_clock: bool = False, clock: Callable[[], str] = utc_now
    ) -> None:
        self._engine, self.name = _engine(url, create=create)
        # no connection outlives its store, also where nobody closes it
        weakref.finalize(self, self._engine.dispose)
        self._writer = self._engine.execution_options(writes=True, any_clock=any_clock, clock=clock)
        if create:
            self.write(_migrate)
        else:
            with self.reading() as connection:
                _require_schema(connection, self.name)

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """A transaction that only reads; every fault of the database is a StoreError of one
        line, StoreBusy where another program holds the file.
        """
        try:
            with self._engine.begin() as connection:
                yield connection
        except DAMAGES as error:
            if _worth_a_retry(error):
                raise self._busy() from None
            raise StoreError(f"store {self.name}: {self._line(error)}") from None

    def write(self, work: Callable[[Connection], T]) -> T:
        """`work` in one transaction, repeated where another writer was faster; StoreBusy if it
        stays so.
        """
        until, broken = time.monotonic() + LOCK_WAIT_S, ""
        for attempt in range(ATTEMPTS):
            try:
                with self._writer.begin() as connection:
                    return work(connection)
            except DAMAGES as error:
                if not _worth_a_retry(error):
                    if getattr(error, "connection_invalidated", False):
                        told = "connection lost, look whether it was written"
                    else:
                        told = "not written"
                    raise StoreError(f"store {self.name}: {told}: {self._line(error)}") from None
                broken = self._line(error) if isinstance(error, exc.IntegrityError) else ""
                if time.monotonic() > until:
                    break
                time.sleep(0.01 * 2**attempt)
        if broken:
            told = f"nothing written: {broken}: rows contradict each other; see recal table verify"
            raise StoreError(f"store {self.name}: {told}")
        raise self._busy()

    def close(self) -> None:
        self._engine.dispose()

    def _busy(self) -> StoreBusy:
        return StoreBusy(f"store {self.name}: busy with other writers, nothing written; try again")

    def _line(self, error: Exception) -> str:
        """What the driver says, its first line, with a hint, without the password."""
        said = getattr(error, "orig", error)
        line = (str(said).splitlines() or [type(said).__name__])[0]
        hint = HINTS.get(getattr(said, "sqlite_errorname", "").removesuffix("_WRITE"), "")
        for secret in _secrets(self._engine.url):
            line = line.replace(secret, "***")
        return line + hint


def store_exists(url: str) -> bool:
    """False where an SQLite store's file is missing; a server is taken to be there."""
    parsed = parsed_url(url)
    return parsed.get_backend_name() != "sqlite" or Path(str(parsed.database)).exists()


def holds_store(url: str) -> bool:
    """Whether there is a store at the URL: its file, or on a server the program's own tables."""
    if not store_exists(url):
        return False
    try:
        database = Database(url, create=False)
    except NoStore:
        return False
    database.close()
    return True


def require_folder(url: str) -> None:
    """StoreError where an SQLite store's folder is missing: a mistyped store must not pass for a
    new one.
    """
    parsed = parsed_url(url)
    folder = Path(os.path.abspath(str(parsed.database))).parent
    if parsed.get_backend_name() == "sqlite" and not folder.is_dir():
        raise StoreError(f"store {store_name(parsed)}: no folder {folder}")


def store_name(url: str | URL) -> str:
    """A store's URL as messages and reports name it: without its password."""
    shown = (parsed_url(url) if isinstance(url, str) else url).render_as_string(hide_password=True)
    return QUERY_SECRET.sub(r"\1***", shown)


def _secrets(url: URL) -> list[str]:
    given = [
        url.password,
        *(value for key, value in url.query.items() if QUERY_SECRET.match(f"{key}=")),
    ]
    return [str(secret) for secret in given if secret]


def parsed_url(url: str) -> URL:
    """StoreError where the URL cannot be read, or names a database that is gone with the
    process.
    """
    try:
        parsed = make_url(url)
    except (exc.ArgumentError, ValueError):
        before, at, after = url.rpartition("@")
        scheme, colon, _ = before.partition("://")
        shown = QUERY_SECRET.sub(
            r"\1***", f"{scheme if colon else ''}{colon}***@{after}" if at else url
        )
        raise StoreError(
            f"store {shown[:200]!r}: not an SQLAlchemy URL; needed one like sqlite:///recal.db"
        ) from None
    if "@" in (parsed.host or ""):
        raise StoreError(
            f"store {parsed.drivername}://***: an @ in user or password must be written %40"
        )
    if parsed.get_backend_name() == "sqlite" and (parsed.host or parsed.username):
        raise StoreError(
            "store sqlite://***: a file has no host and no user; needed one like sqlite:///recal.db"
        )
    if parsed.get_backend_name() == "sqlite" and parsed.database in (None, "", ":memory:"):
        raise StoreError(
            f"store {url}: a database in memory keeps nothing; needed a file, like"
            " sqlite:///recal.db"
        )
    return (
        parsed.set(drivername="postgresql+psycopg") if parsed.drivername == "postgresql" else parsed
    )


def _engine(url: str, *, create: bool) -> tuple[Engine, str]:
    parsed = parsed_url(url)
    name = store_name(parsed)
    options: dict[str, Any] = {}
    sqlite = parsed.get_backend_name() == "sqlite"
    if sqlite:
        path = Path(os.path.abspath(str(parsed.database)))
        if not path.exists() and not create:
            raise NoStore(f"no store at {name}")
        options["creator"] = lambda: sqlite3.connect(
            f"file:{quote(str(path))}?mode={'rwc' if create else 'rw'}",
            uri=True,
            timeout=LOCK_WAIT_S,
            check_same_thread=False,
        )
    elif parsed.drivername == "postgresql+psycopg" and "connect_timeout" not in parsed.query:
        options["connect_args"] = {"connect_timeout": CONNECT_WAIT_S}
    try:
        engine = create_engine(parsed, **options)
    except (exc.NoSuchModuleError, ModuleNotFoundError) as error:
        raise StoreError(
            f"store {name}: {error}; needed sqlite:///FILE, or postgresql+psycopg://HOST/NAME with"
            " strapdown-recal[postgres] installed"
        ) from None
    if sqlite:
        event.listen(engine, "connect", _set_pragmas)
    event.listen(engine, "begin", _begin)
    return engine, name


def _set_pragmas(connection: Any, record: Any) -> None:
    # transactions begin where `_begin` says, not where sqlite3 guesses
    connection.isolation_level = None
    connection.execute("PRAGMA foreign_keys=ON").close()
    # the wait for a lock is the connection's timeout
    connection.execute("PRAGMA synchronous=EXTRA").close()


def _begin(connection: Connection) -> None:
    """A writer takes SQLite's lock first; on PostgreSQL it does not wait for ever, and a reader
    sees one snapshot.
    """
    writes = connection.get_execution_options().get("writes")
    if connection.dialect.name == "postgresql" and writes:
        milliseconds = {"wait": str(int(1000 * LOCK_WAIT_S))}
        connection.execute(text("SELECT set_config('lock_timeout', :wait, true)"), milliseconds)
    elif connection.dialect.name == "postgresql":
        connection.exec_driver_sql("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ, READ ONLY")
    elif connection.dialect.name == "sqlite" and writes:
        connection.exec_driver_sql("BEGIN IMMEDIATE")
    elif connection.dialect.name == "sqlite":
        connection.exec_driver_sql("BEGIN")


def schema_of(connection: Connection) -> str | None:
    """The newest migration that the database has seen."""
    if not inspect(connection).has_table("alembic_version"):
        return None
    return connection.execute(text("SELECT version_num FROM alembic_version")).scalar()


def _require_schema(connection: Connection, name: str) -> None:
    found = schema_of(connection)
    if found is None:
        raise NoStore(f"no store at {name}: the database holds no recal tables")
    if found not in READABLE:
        _refuse_newer(found, f"store {name}")
        raise StoreError(
            f"store {name}: schema {found}, needed {SCHEMA_REVISION} (importing a table"
            " upgrades it)"
        )


def _refuse_newer(found: str | None, name: str) -> None:
    if found is not None and found > SCHEMA_REVISION:
        raise StoreError(
            f"{name}: schema {found}, needed {SCHEMA_REVISION}: a newer recal made it, use that one"
        )


def _migrate(connection: Connection) -> None:
    found = schema_of(connection)
    if found != SCHEMA_REVISION and connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": MIGRATION_LOCK})
        found = schema_of(connection)
    if found == SCHEMA_REVISION:
        return
    _refuse_newer(found, "store")
    from alembic import command  # 0.6 s, needed once in a store's life
    from alembic.util import CommandError

    try:
        with _ONE_MIGRATION:
            command.upgrade(alembic_config(connection), "head")
    except CommandError as error:
        raise StoreError(
            f"store: cannot be upgraded to schema {SCHEMA_REVISION}: {error}"
        ) from None


def alembic_config(connection: Connection) -> Any:
    """Alembic's configuration for the packaged migrations on an open connection."""
    from alembic.config import Config

    config = Config()
    config.set_main_option(
        "script_location", str(Path(__file__).parent / "migrations").replace("%", "%%")
    )
    config.attributes["connection"] = connection
    return config


def _worth_a_retry(error: Exception) -> bool:
    said = getattr(error, "orig", error)
    if isinstance(error, exc.IntegrityError) or getattr(said, "sqlstate", None) in RETRY_SQLSTATES:
        return True
    return getattr(said, "sqlite_errorname", "").startswith(("SQLITE_BUSY", "SQLITE_LOCKED"))
