"""The store fixtures, on SQLite and PostgreSQL."""

from tests.infield.stores import store, url

__all__ = ("store", "url")
