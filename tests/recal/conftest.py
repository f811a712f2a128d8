"""The store fixtures, on SQLite and PostgreSQL; pages without drawings."""

import pytest

from tests.infield.stores import store, url
from tests.undrawn import figures_left_out


@pytest.fixture
def undrawn():
    with figures_left_out():
        yield


__all__ = ("store", "url")
