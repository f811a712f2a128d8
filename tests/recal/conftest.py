"""The store fixtures, on SQLite and PostgreSQL, and a folder to work in."""

import pytest

from tests.infield.stores import store, url

__all__ = ("store", "url")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
