"""The base of what a verb gives: a verdict, why, the document, and where a notebook looks for them.

A result is frozen. Its `document` is what its JSON file holds; the typed values of a result are
attributes of its own class.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from html import escape
from os import PathLike, fspath
from pathlib import Path

from recal.service.results.files import write_text
from recal.service.results.text import Document, result_text

SHOWN_LINES = 8  # of a result's summary in its repr


@dataclass(frozen=True, repr=False, eq=False)
class Result:
    """What a verb found.

    Parameters
    ----------
    document : Mapping
        The result as its JSON file holds it, units in the keys.
    page : callable or None
        Draws the report as one HTML page; None where the verb has no report.
    """

    document: Document
    page: Callable[[], str] | None = field(default=None, kw_only=True)

    @property
    def verdict(self) -> str:
        """One word of docs, results: what came out."""
        return str(self.document.get("verdict", "ok"))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the verdict is what it is, a sentence each."""
        return tuple(map(str, self.document.get("reasons", ())))

    def lines(self, *, verbose: bool = False) -> list[str]:
        """The result in a few lines for people."""
        return [f"{type(self).__name__}: {self.verdict}", *self.reasons]

    def to_json(self) -> str:
        """The result as text, exactly what the command writes with --json."""
        return result_text(self.document)

    def to_dict(self) -> dict[str, object]:
        """The result as plain values; numbers that are not finite are None."""
        plain: dict[str, object] = json.loads(self.to_json())
        return plain

    def to_html(self, path: str | PathLike[str]) -> Path:
        """Write the report as one page that fetches nothing.

        Parameters
        ----------
        path : str or path
            The file to write; its folder must be there.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        NotImplementedError
            Where this verb has no report.
        InputError
            Where the file cannot be written.
        """
        if self.page is None:
            raise NotImplementedError(f"{type(self).__name__} has no report; its JSON is to_json()")
        return write_text(Path(fspath(path)), self.page())

    def __repr__(self) -> str:
        said = self.lines()
        more = [f"  ... {len(said) - SHOWN_LINES} more lines"] if len(said) > SHOWN_LINES else []
        return "\n".join([*said[:SHOWN_LINES], *more])

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"
