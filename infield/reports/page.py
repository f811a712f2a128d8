"""One self-contained HTML page from a template of `infield/reports/templates`: what every report of
the program shares.

A report's template begins with `{% extends "base.html.j2" %}` and fills the blocks title, kind,
subtitle, content and footer; `parts.html.j2` has the figure, badge, facts and nothing macros.
Figures come from `infield.reports.drawing`; a page with one gets the script that shows them.
"""

import math
from functools import lru_cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from infield.reports.drawing import figure, page_script, panels, stack
from infield.reports.issuer import issuer
from ins.user_input import visible

NOT_AVAILABLE = "n/a"
MINUS = "\u2212"


def render_page(template: str, package: str = "", **context: Any) -> str:
    """The page; every text in the context is escaped, drawings excepted (they are Markup). package:
    of a template that is not shared.
    """
    return page_environment(package).get_template(template).render(**context)


def number(value: float | None, decimals: int = 2, *, sign: bool = False) -> str:
    """A number with fixed decimals and a true minus; `n/a` where it is null or not finite."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return NOT_AVAILABLE
    text = f"{value:{'+' if sign else ''}.{decimals}f}"
    if float(text) == 0.0:
        text = text.replace("-", "+" if sign else "")
    return text.replace("-", MINUS)


def decimals_for(sigmas: list[float | None]) -> int:
    """Decimals that show the smallest of some sigmas with two digits, 0 to 6."""
    found = [s for s in sigmas if isinstance(s, int | float) and math.isfinite(s) and s > 0]
    return min(max(1 - math.floor(math.log10(min(found))), 0), 6) if found else 4


def significant(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits, never with an exponent: a small sigma is not
    zero.
    """
    if not isinstance(value, int | float) or not math.isfinite(value) or value == 0.0:
        return number(value, digits - 1)
    return number(value, min(max(digits - 1 - math.floor(math.log10(abs(value))), 0), 12))


def duration(seconds: float | None) -> str:
    """Seconds in words that people read: `82.8 min`, `45 s`."""
    if not isinstance(seconds, int | float) or not math.isfinite(seconds):
        return NOT_AVAILABLE
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 7200 else f"{seconds / 3600:.2f} h"


def heading(degrees: float | None, decimals: int = 2) -> str:
    """A heading in [0, 360) degrees."""
    if not isinstance(degrees, int | float) or not math.isfinite(degrees):
        return NOT_AVAILABLE
    return number(round(degrees % 360.0, decimals) % 360.0, decimals)


def short_hash(sha256: str | None) -> str:
    """The first twelve digits of a hash."""
    return str(sha256)[:12] if sha256 else NOT_AVAILABLE


def _visible_text(value: Any) -> Any:
    """A text without what a browser would obey, its "+-" as the sign; drawings, numbers and line
    ends as they are.
    """
    if not isinstance(value, str) or isinstance(value, Markup):
        return value
    value = value.replace(" +- ", " \u00b1 ")
    if value.isprintable():
        return value
    return "\n".join(map(visible, value.split("\n")))


@lru_cache(maxsize=8)
def page_environment(package: str = "", folder: str = "templates") -> Environment:
    """The shared templates with their filters; of a package its own templates before those."""
    if package:
        shared = page_environment()
        assert shared.loader is not None
        own = PackageLoader(package, folder)
        return shared.overlay(loader=ChoiceLoader([own, shared.loader]))
    found = Environment(
        loader=PackageLoader("infield.reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_visible_text,
    )
    found.filters.update(
        {f.__name__: f for f in (number, significant, decimals_for, duration, heading, short_hash)}
    )
    found.globals |= {
        "issuer": issuer,
        "page_script": page_script,
        "figure": figure,
        "panels": panels,
        "stack": stack,
    }
    return found
