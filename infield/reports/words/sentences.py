"""The sentence of a reason: the only place where a code becomes words."""

from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from functools import cache
from importlib import import_module
from string import Formatter
from typing import Any

from ins.verdicts import Reason

# Each has SENTENCES: Mapping[StrEnum, Template].
ROOMS: tuple[str, ...] = (
    "aided",
    "alignment",
    "flight",
    "misalignment",
    "replay",
    "session",
    "taxi",
    "thermal",
    "thermometer",
)

LARGEST_PLAIN = 1e6  # chosen: people read 9370 deg/h, not 9.37e+03; larger ones with an exponent

# What str.format takes, or a function of the reason's values where the wording depends on them.
Template = str | Callable[..., str]


def sentence(reason: Reason) -> str:
    """The reason in words; reasons among its values stand there as their own sentences.

    Raises
    ------
    KeyError, TypeError
        A code without a sentence, or a value that the sentence names and the reason lacks; a test
        goes over all codes.
    """
    template = templates()[type(reason.code), reason.code.name]
    values = {name: _told(value) for name, value in reason.values.items()}
    return template(**values) if callable(template) else _PLAIN.vformat(template, (), values)


def plain(value: Any, spec: str) -> str:
    """As format, but 9370 where that writes 9.37e+03."""
    text = format(value, spec)
    if not isinstance(value, float) or "e+" not in text or abs(value) >= LARGEST_PLAIN:
        return text
    return f"{float(text):+.0f}" if spec[0] == "+" else f"{float(text):.0f}"


class _PlainFormatter(Formatter):
    """As str.format, with plain numbers."""

    def format_field(self, value: Any, format_spec: str) -> Any:
        return plain(value, format_spec)


_PLAIN = _PlainFormatter()


def _told(value: Any) -> Any:
    if isinstance(value, Reason):
        return sentence(value)
    if isinstance(value, tuple) and value and all(isinstance(item, Reason) for item in value):
        return "; ".join(sentence(item) for item in value)
    return value


def sentences(reasons: Iterable[Reason | str]) -> list[str]:
    """Reasons in words; a text (of an estimator that has no codes yet) stands as it is."""
    return [reason if isinstance(reason, str) else sentence(reason) for reason in reasons]


def codes(reasons: Iterable[Reason | str]) -> list[str | None]:
    """The codes of reasons, None for a text without one: what programs compare instead of words."""
    return [None if isinstance(reason, str) else _code(reason) for reason in reasons]


def _code(reason: Reason) -> str:
    """The reason's code, and after a dot that of the reason among its values (not of several)."""
    inner = [_code(value) for value in reason.values.values() if isinstance(value, Reason)]
    return ".".join([reason.code.value, *inner])


@cache
def templates() -> Mapping[tuple[type[StrEnum], str], Template]:
    """The template of every code of every room, by enum and name of the member (members of two
    enums may be equal as texts).
    """
    rooms = (import_module(f"infield.reports.words.{room}") for room in ROOMS)
    return {
        (type(code), code.name): text for room in rooms for code, text in room.SENTENCES.items()
    }
