"""The sentence of a reason: the only place where a code becomes words."""

from collections.abc import Mapping
from enum import StrEnum
from functools import cache
from importlib import import_module

from ins.verdicts import Reason

# Each has SENTENCES: Mapping[StrEnum, str], templates of str.format over the reason's values.
ROOMS: tuple[str, ...] = ()


def sentence(reason: Reason) -> str:
    """The reason in words.

    Raises
    ------
    KeyError
        A code without a sentence, or a value that the sentence names and the reason lacks; a test
        goes over all codes.
    """
    return templates()[type(reason.code), reason.code.name].format(**reason.values)


@cache
def templates() -> Mapping[tuple[type[StrEnum], str], str]:
    """The template of every code of every room, by enum and name of the member (members of two
    enums may be equal as texts).
    """
    rooms = (import_module(f"infield.reports.words.{room}") for room in ROOMS)
    return {
        (type(code), code.name): text for room in rooms for code, text in room.SENTENCES.items()
    }
