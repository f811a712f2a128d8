"""The reference pages of the list: `python -m ins.errors.reference --write` renews the tables of
docs/reference/effects.md, whose other text is written by hand.
"""

import argparse
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from inspect import getdoc
from itertools import groupby
from pathlib import Path

from ins.errors.base import (
    COEFFICIENT,
    SLOW_NAME,
    Coefficient,
    Effect,
    ErrorSource,
    ShapeParameter,
    Words,
)
from ins.errors.catalogue import OWN, catalogue, rivals_of
from ins.errors.parts.formula import EachAlone
from ins.errors.prior import Prior
from ins.errors.unnamed import FREE_FUNCTIONS

PAGE = Path("docs/reference/effects.md")
# a table of the page: the first letters of its numbers, then its rows up to an empty line
TABLE = re.compile(r"(<!-- rows of (\w+), from the list -->\n).*?(?=\n\n|\n\Z)", re.S)
PRIORS = "| no. | error | recipes | one sigma | process | where the number comes from |"
ROWS = "| no. | error | usual size | |"
ALL = "TGAPOFD"  # the first letters of all numbers
SECTIONS: Mapping[str, str] = {
    "What they are": "",
    "Answers without a name": (
        "Free functions that compete with the named effects on every channel."
    ),
    "Known to estimators alone": "",
}


def renewed(page: str) -> str:
    """The page with its tables as the list has them.

    Parameters
    ----------
    page : str
        Markdown, with a comment before each table that says which numbers it holds.

    Returns
    -------
    page : str
    """
    return TABLE.sub(lambda found: found[1] + _table(found[2]), page)


def words_page() -> str:
    """Every error and free function with its parameters, in sentences; the priors of estimators.

    Returns
    -------
    page : str
        Markdown.
    """
    lines = ["# Effects", ""]
    lines += ["The catalogue of `recal diagnose`, `recal plan` and of a twin's `effects`.", ""]
    lines += ["| effect | id | targets | parameters: usual size | rivals |", "|---" * 5 + "|"]
    for effect in sorted(catalogue(), key=lambda e: (e.name, e.id)):
        lines.append(
            f"| `{effect.name}` | `{effect.id}` | {_names(effect.targets)} |"
            f" {'; '.join(_sizes([effect]))} | {_names(rivals_of(effect))} |"
        )
    lines += ["", "## What estimators assume", "", _priors(ALL)]
    worded = [e for e in catalogue() if isinstance(e, ErrorSource) and e.words]
    named = {e.name: e.words for e in worded}
    of_estimators = {e.name: e.words for e in OWN if not e.diagnosed}
    parts = (named, FREE_FUNCTIONS, of_estimators)
    for (title, text), words in zip(SECTIONS.items(), parts, strict=True):
        lines += ["", f"## {title}", "", *([text, ""] if text else [])]
        for name in sorted(words):
            lines += _sentences(name, words[name])
    return "\n".join(lines)


def _sentences(name: str, words: Words | None) -> list[str]:
    assert words is not None
    adds = dict.fromkeys(line for e in OWN if e.name == name and (line := _adds(e)))
    return [
        f"### {name}",
        "",
        words.what,
        "",
        *(f"- Adds, for one unit: {line}" for line in adds),
        f"- Brought on by: {words.brought_on_by}",
        f"- Size: {words.size}",
        f"- What to do: {words.remedy}",
        "",
    ]


def _table(letters: str) -> str:
    """One row a number that begins with one of the letters."""

    rows = [_row(kinds) for kinds in _numbered(letters)]
    return "\n".join([ROWS, "|---" * 4 + "|", *rows])


def _numbered(letters: str) -> list[list[ErrorSource]]:
    """The kinds of each number that begins with one of the letters, in the order of numbers."""

    def place(source: ErrorSource) -> tuple[int, str]:
        return letters.index(source.number[0]), source.number

    chosen = sorted((e for e in OWN if e.number[0] in letters), key=place)
    return [list(kinds) for _, kinds in groupby(chosen, key=lambda e: e.number)]


def _priors(letters: str) -> str:
    """One row a prior that an estimator takes from the list, or from a key of the twin."""
    rows = [row for kinds in _numbered(letters) for row in dict.fromkeys(_priors_of(kinds))]
    return "\n".join([PRIORS, "|---" * 6 + "|", *rows])


def _priors_of(kinds: list[ErrorSource]) -> Iterator[str]:
    for kind in kinds:
        begin = f"| {kind.number} | `{_name(kind)}`"
        for prior in kind.priors:
            part = f" {prior.part}" if prior.part else ""
            assumed = f"{prior.recipes} | {_sigma(prior)} | {prior.process} | {prior.source}"
            yield f"{begin}{part} | {assumed} |"
        if kind.twin:
            key = f"`{kind.twin[0]}.{kind.twin[1]}`"
            yield f"{begin} | all | the twin's {key} | | `recal twin fit` |"


def _sigma(prior: Prior) -> str:
    if isinstance(prior.sigma, Mapping):
        numbers = ", ".join(f"{name} {size:g}" for name, size in prior.sigma.items())
        return f"{numbers} {prior.unit}"
    return f"{prior.sigma:g} {prior.unit}" if prior.sigma else "fitted"


def _name(source: ErrorSource) -> str:
    return source.id if source.name == SLOW_NAME else source.name


def _row(kinds: list[ErrorSource]) -> str:
    """The kinds of one number; the first gives the name."""
    first = kinds[0]
    repeats = dict.fromkeys(kind.repeats for kind in kinds)
    cells = (first.number, f"`{_name(first)}`", "; ".join(_sizes(kinds)), ", ".join(repeats))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _adds(source: ErrorSource) -> str:
    """The first paragraph on its formula; of what is out of reach, where it is described."""
    formula: object = source.formula or source.noise_formula
    if isinstance(formula, EachAlone):
        formula = formula.alone
    if isinstance(formula, partial):
        formula = formula.func
    if formula is None:
        return source.source
    return " ".join((getdoc(formula) or "").split("\n\n")[0].split())


def _sizes(effects: Iterable[Effect]) -> list[str]:
    """Usual sizes of all parameters; those of one size together, a single coefficient unnamed."""
    names: dict[str, dict[str, None]] = {}
    for effect in effects:
        parameters: tuple[Coefficient | ShapeParameter, ...] = effect.coefficients + effect.shape
        for parameter in parameters:
            size = f"{parameter.low:g} to {parameter.high:g} {parameter.unit}".strip()
            names.setdefault(size, {})[parameter.name] = None
    return [
        size if list(of_size) == [COEFFICIENT] else f"{_names(of_size)} {size}"
        for size, of_size in names.items()
    ]


def _names(names: Iterable[str]) -> str:
    return " ".join(f"`{name}`" for name in names)


def main(arguments: list[str] | None = None) -> int:
    """0: the page is as the list; 1: it is not, and was not written.

    Parameters
    ----------
    arguments : list of str, optional
        Default: those of the process.

    Returns
    -------
    code : int
    """
    parser = argparse.ArgumentParser(prog="python -m ins.errors.reference", description=__doc__)
    parser.add_argument("--write", action="store_true", help=f"renew {PAGE}")
    given = parser.parse_args(arguments)
    page = PAGE.read_text("utf-8")
    new = renewed(page)
    if given.write:
        PAGE.write_text(new, "utf-8")
    elif new != page:
        print(f"{PAGE}: not as the list of errors; renew it with --write")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
