"""Pages with empty frames in the place of their figures: drawing takes 0.8 of an update, and few
tests look at a drawing.

The rest of a page is made as ever: figures are set up, texts, tables and links are written. What is
drawn is the matter of tests/infield/test_report.py and of its like beside each report.
"""

from contextlib import contextmanager

import pytest


@contextmanager
def figures_left_out():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", _frame)
        # svg_text lays a figure out before it is saved: 0.36 of an update's time
        patch.setattr("matplotlib.layout_engine.ConstrainedLayoutEngine.execute", _not_laid_out)
        yield


def _frame(figure, file, *, format, **options):
    assert format == "svg"
    file.write('<svg viewBox="0 0 1 1">\n</svg>\n')


def _not_laid_out(engine, figure):
    """The figure stays as it is."""
