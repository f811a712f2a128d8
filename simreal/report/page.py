"""Pages of `simreal`: its own templates, and those of `infield` that every report shares."""

from functools import lru_cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader

from infield.reports import page as report_page


def render_page(template: str, **context: Any) -> str:
    """The page of a template in `simreal/report/templates`; filters and base page as in
    `infield.reports.page`.
    """
    return _environment().get_template(template).render(**context)


@lru_cache(maxsize=1)
def _environment() -> Environment:
    shared = report_page._environment()
    assert shared.loader is not None
    return shared.overlay(
        loader=ChoiceLoader([PackageLoader("simreal.report", "templates"), shared.loader])
    )
