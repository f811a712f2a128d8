"""The store's URL as every worker understands it, whatever folder it works in."""

import os

from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError

from ins.records import InputError


def absolute_store(url: str) -> tuple[str, str | None]:
    """The URL with the absolute path of an SQLite file, and that path; None for a server."""
    try:
        parsed = make_url(url)
    except ArgumentError:
        raise InputError(f"store {url[:200]!r}: not an SQLAlchemy URL; needed one like sqlite:///recal.db") from None
    if parsed.get_backend_name() != "sqlite":
        return url, None
    if not parsed.database or parsed.database == ":memory:":
        raise InputError(f"store {url}: a fleet update needs a store in a file or on a server")
    path = os.path.abspath(parsed.database)
    return parsed.set(database=path).render_as_string(hide_password=False), path


def shown_store(url: str) -> str:
    """The URL without its password, for files."""
    return make_url(url).render_as_string(hide_password=True)
