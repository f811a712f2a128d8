"""Formulas as MathML, which browsers draw themselves: no script, no font and no request to another machine.

The converter is docutils' own (docutils.utils.math.latex2mathml), so nothing beyond Sphinx is installed.
"""

import re
from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

logger = logging.getLogger(__name__)


def visit_inline(self: Any, node: Any) -> None:
    """An inline formula."""
    self.body.append(_mathml(node, block=False))
    raise SkipNode


def visit_block(self: Any, node: Any) -> None:
    """A formula on a line of its own."""
    self.body.append(f'<div class="math-block">{_mathml(node, block=True)}</div>\n')
    raise SkipNode


def _mathml(node: Any, *, block: bool) -> str:
    """A formula that cannot be converted is a warning (an error with -W), with its text."""
    text = re.sub(r"\s+", " ", node.astext()).strip()
    try:
        return tex2mathml(text, as_block=block)
    except (MathError, SyntaxError, ValueError, KeyError, IndexError) as error:
        logger.warning("formula %r: %s", text, error, location=node)
        return f"<code>{text}</code>"


def setup(app: Any) -> dict[str, Any]:
    """Registers the renderer under html_math_renderer = "mathml"."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
