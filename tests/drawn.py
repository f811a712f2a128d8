"""Figures of a page as tests read them: their specifications; the page without its scripts."""

import base64
import json
import re

import numpy as np

from infield.reports.drawing import page_script

FIGURE = re.compile(
    r'<figure class="(wide )?plot".*?<script type="application/json">(.*?)</script>', re.DOTALL
)


def specifications(page):
    """Of each figure in turn, as JSON that ends no element."""
    found = [text for _, text in FIGURE.findall(page)]
    assert not any("<" in text or "&" in text for text in found)
    return [json.loads(text) for text in found]


def unscripted(page):
    """The page without its library and without the numbers of its figures."""
    assert page.count(page_script()) == 1
    rest = page.replace(page_script(), "")
    return re.sub(r'<script type="application/json">.*?</script>', "", rest, flags=re.DOTALL)


def column(values):
    """Numbers of a trace, packed or not; NaN where there is none."""
    if isinstance(values, dict):
        return np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"]).astype(float)
    return np.array(values, dtype=float)


def traces(specification, **wanted):
    """The traces that have such values, such as mode="markers"."""
    return [
        trace
        for trace in specification["data"]
        if all(trace.get(key) == value for key, value in wanted.items())
    ]
