"""The base of what a verb gives: a verdict, why, the document, and where a notebook looks for them.

A result is frozen. Its `record` is what was found, typed, and `document` what its JSON file holds.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Generic, TypeVar

from ins.documents import plain, to_json
from recal.service.results.files import AnyPath, output_directory, write_files, write_text

SHOWN_LINES = 8  # of a result's summary in its repr; chosen: a third of a screen of 25 lines


Record = TypeVar("Record")


@dataclass(frozen=True, repr=False, eq=False)
class Result(Generic[Record]):
    """What a verb found.

    Parameters
    ----------
    record : dataclass
        The result, a field for each key of its JSON file, units in the names.
    page : callable or None
        Draws the report as one HTML page; None where the verb has no report.
    """

    record: Record
    page: Callable[[], str] | None = field(default=None, kw_only=True)

    @cached_property
    def document(self) -> Mapping[str, Any]:
        """The result as its JSON file holds it, units in the keys."""
        return dict(plain(self.record))

    @property
    def verdict(self) -> str:
        """One word of docs, results: what came out."""
        return str(getattr(self.record, "verdict", "ok"))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the verdict is what it is, a sentence each."""
        return tuple(map(str, getattr(self.record, "reasons", ())))

    def lines(self, *, verbose: bool = False) -> list[str]:
        """The result in a few lines for people."""
        return [f"{type(self).__name__}: {self.verdict}", *self.reasons]

    def to_json(self) -> str:
        """The result as text, exactly what the command writes with --json."""
        return to_json(self.record)

    def to_dict(self) -> dict[str, Any]:
        """The result as plain values; numbers that are not finite are None."""
        return dict(json.loads(self.to_json()))

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


def write_report(
    found: Result[Any], folder: AnyPath, name: str, more: Mapping[str, str] | None = None
) -> Path:
    """Write NAME.json, its report NAME.html where there is one, and more texts by file name to a
    directory, made if need be; returns it.
    """
    directory = output_directory(Path(folder), "")
    texts = {f"{name}.json": found.to_json()}
    if found.page is not None:
        texts[f"{name}.html"] = found.page()
    write_files({directory / file: text for file, text in {**texts, **(more or {})}.items()})
    return directory
