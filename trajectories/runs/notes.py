"""What a reader noticed, in words for people and with a code for the program."""

import enum
from collections.abc import Iterable
from typing import Self


class About(enum.Enum):
    """What a note is about, where something depends on it."""

    DAMAGE = "damage"  # of the file: cut off, garbled, dropped
    FIXES = "fixes"  # that are missing or left out
    DATE = "date"  # that a clock does not show
    TEMPERATURE = "temperature"  # readings that no thermometer shows, left out


class Note(str):
    """A line of text that knows what it is about.

    Nothing decides by its words: `about` says what they tell. A note made of it by `labelled` or
    `joined` keeps the code.
    """

    __slots__ = ("about",)
    about: About

    def __new__(cls, text: str, about: About) -> Self:
        """The line `text` about `about`."""
        note = super().__new__(cls, text)
        note.about = about
        return note

    def __reduce__(self) -> tuple[type[Self], tuple[str, About]]:
        """A copy in another process keeps the code."""
        return type(self), (str(self), self.about)


def about(note: str) -> About | None:
    """What a note is about; None for one without a code."""
    return note.about if isinstance(note, Note) else None


def labelled(label: str, note: str) -> str:
    """The note with `label: ` before it."""
    return _with_code(f"{label}: {note}", about(note))


def joined(notes: Iterable[str]) -> str:
    """One line of all notes that are not empty, with the first code among them."""
    lines = [note for note in notes if note]
    codes = (code for code in map(about, lines) if code is not None)
    return _with_code("; ".join(lines), next(codes, None))


def _with_code(text: str, code: About | None) -> str:
    return text if code is None else Note(text, code)
