"""Formulas as MathML, which browsers draw themselves: no script, no font and no request to another
machine.

Bold and bold italic letters are written as the letters that Unicode has for them, since browsers no
longer read the mathvariant attribute. (docutils' own converter puts an accent over all that follows
a braced letter, so it is not used.)

Decision: docs/decisions/0088-plotly-draws.md.
"""

import html
import re
import unicodedata
from typing import Any

from docutils.nodes import SkipNode
from latex2mathml.converter import convert
from sphinx.util import logging

logger = logging.getLogger(__name__)
BOLD = re.compile(r'<(m[io]) mathvariant="(bold|bold-italic)">([^<]+)</\1>')


class FormulaError(ValueError):
    """A formula that cannot be drawn."""


def mathml(latex: str, *, block: bool) -> str:
    """The <math> element of a formula; FormulaError where a part of it is not understood."""
    text = re.sub(r"\s+", " ", latex).strip()
    try:
        found = convert(text, display="block" if block else "inline")
    except Exception as error:  # the converter's own kinds have no common base
        raise FormulaError(f"{text}: {type(error).__name__} {error}") from None
    if unknown := re.search(r"\\[A-Za-z]+", html.unescape(found)):
        raise FormulaError(f"{text}: {unknown[0]} is not understood")
    return BOLD.sub(lambda m: f"<{m[1]}>{_bold(html.unescape(m[3]), m[2])}</{m[1]}>", found)


def _bold(letters: str, variant: str) -> str:
    kind = "MATHEMATICAL BOLD ITALIC" if variant == "bold-italic" else "MATHEMATICAL BOLD"
    return "".join(_letter(character, kind) for character in letters)


def _letter(character: str, kind: str) -> str:
    """The bold letter; numbers and signs that have none stay as they are."""
    name = unicodedata.name(character, "").removeprefix("GREEK ").removeprefix("LATIN ")
    for wanted in (
        f"{kind} {name.replace(' LETTER', '')}",
        f"MATHEMATICAL BOLD {name.replace(' LETTER', '')}",
    ):
        try:
            return unicodedata.lookup(wanted)
        except KeyError:
            continue
    return character


def visit_inline(self: Any, node: Any) -> None:
    """An inline formula."""
    self.body.append(_drawn(node, block=False))
    raise SkipNode


def visit_block(self: Any, node: Any) -> None:
    """A formula on a line of its own."""
    self.body.append(f'<div class="math-block">{_drawn(node, block=True)}</div>\n')
    raise SkipNode


def _drawn(node: Any, *, block: bool) -> str:
    """A formula that cannot be drawn is a warning (an error with -W), with its text."""
    try:
        return mathml(node.astext(), block=block)
    except FormulaError as error:
        logger.warning("formula %s", error, location=node)
        return f"<code>{html.escape(node.astext())}</code>"


def setup(app: Any) -> dict[str, Any]:
    """Registers the renderer under html_math_renderer = "mathml"."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"version": "2", "parallel_read_safe": True, "parallel_write_safe": True}
