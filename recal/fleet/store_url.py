"""The store's URL as every worker understands it, whatever folder it works in."""

import os

from infield.store.database import parsed_url


def absolute_store(url: str) -> tuple[str, str | None]:
    """The URL with the absolute path of an SQLite file, and that path; None for a server."""
    parsed = parsed_url(url)
    if parsed.get_backend_name() != "sqlite":
        return url, None
    path = os.path.abspath(str(parsed.database))
    return parsed.set(database=path).render_as_string(hide_password=False), path
