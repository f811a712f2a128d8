"""The line of a text that names its columns, wherever near the start it stands, and the lines
before it.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ins.records import InputError
from trajectories.readers.rows.column_map import LayoutKeys
from trajectories.runs.text_rows import text_parts

SIGHTED_TEXT = 1 << 16  # bytes; as many as a log without a head is looked at
LINES_BEFORE = 100  # at most, before the names; chosen: MT Manager writes some 15
SEPARATED_BY = "\t,;"


@dataclass(frozen=True)
class Heading:
    """names: of the columns, each once; layout: how the rows below them lie; before: the lines
    above.
    """

    names: tuple[str, ...]
    layout: LayoutKeys
    before: tuple[str, ...]


def heading(path: Path, are_names: Callable[[Sequence[str]], bool]) -> Heading | None:
    """The first line whose fields are such names; None where there is none near the start."""
    try:
        head = next(iter(text_parts(path, [], block_bytes=SIGHTED_TEXT)), b"")[:SIGHTED_TEXT]
    except InputError:
        return None
    lines = head.decode("utf-8-sig", errors="replace").splitlines()[: LINES_BEFORE + 1]
    for k, line in enumerate(lines):
        for sign in SEPARATED_BY:
            names = [name.strip().strip('"') for name in line.split(sign)]
            if are_names(names):
                return _found(names, lines[:k], sign)
    return None


def _found(names: Sequence[str], before: Sequence[str], sign: str) -> Heading:
    """A name that stands there twice counts the first time."""
    seen: Counter[str] = Counter()
    once = []
    for name in names:
        seen[name] += 1
        once.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    layout = LayoutKeys(
        format="csv", delimiter=sign, columns=once, header_lines=len(before) + 1, names_line=None
    )
    return Heading(tuple(once), layout, tuple(before))
