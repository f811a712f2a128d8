"""The store fixtures, on SQLite and PostgreSQL."""

from tests.infield.stores import store, url  # noqa: F401
