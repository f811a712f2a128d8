"""Specifications of figures: what plotly is given for panels, lines, bands, marks and texts."""

import re

import numpy as np
import pytest
from plotly.graph_objects import Figure

from infield.reports.drawing import (
    DASHED,
    MOST_PLAIN,
    Band,
    Boxes,
    Cells,
    FarEdge,
    Line,
    Marks,
    Panel,
    ShadedSpan,
    Strip,
    Texts,
    Uprights,
    figure,
    panels,
    spanned,
    specification,
)
from tests.drawn import column, specifications

X = np.linspace(0.0, 10.0, 11)
HOSTILE = '</script><b onclick="x">&lt; <a href="javascript:x">SN</a>'


def drawn(*items, **panel):
    return specification([Panel(items=list(items), **panel)])


@pytest.mark.parametrize("size", [11, MOST_PLAIN + 1])
def test_numbers_arrive_as_they_were_and_gaps_stay_gaps(size):
    x = np.linspace(0.0, 1.0, size)
    y = np.where(x == x[5], np.nan, 1.0 / 3.0 + x)
    (line,) = drawn(Line(x, y, "#000000"))["data"]
    np.testing.assert_allclose(column(line["x"]), x, rtol=1e-5)
    np.testing.assert_allclose(column(line["y"]), y, rtol=1e-5)


def test_every_item_is_what_plotly_knows():
    """Its own package refuses what it does not know."""
    low, high = X - 1.0, X + 1.0
    every = drawn(
        Band(X, low, high, "#0000FF", 0.2, "band"),
        Line(X, X, "#000000", "line", dash=DASHED, low=low, high=high),
        Marks(X, X, "^", "#FF0000", "marks", hollow=True, low=low, high=high),
        Marks(X, X, "x", "#FF0000"),
        Uprights(X, low, high, "#00FF00", name="bars"),
        Boxes([(2.0, 4.0, 0.0, 1.0)], "#EEEEEE"),
        Cells([(0.0, 1.0, 0.0, 1.0, "#123456", "said")]),
        Texts([(1.0, 1.0, "word", "black", True)]),
        spans=[ShadedSpan(1.0, 2.0), ShadedSpan(3.0, 3.0, "#59636E")],
        strips=[Strip(0.0, 5.0, "parked", "#009E73")],
        x_log=True,
        x_limits=(1.0, 100.0),
        y_ticks=[(0.0, "none")],
        far=(FarEdge([(0.5, "7.5")], "east"), FarEdge([(0.5, "45.2")], "north")),
        circle=True,
        equal=True,
        upright=True,
    )
    found = Figure(every)
    assert len(found.data) == len(every["data"]) and len(found.layout.shapes) == 3
    assert found.layout.xaxis.range == (0.0, 2.0)


def test_a_band_is_closed_around_each_stretch_of_finite_edges():
    low = np.where(X == 5.0, np.nan, X - 1.0)
    (area,) = drawn(Band(X, low, X + 1.0, "#0000FF", 0.5))["data"]
    x = column(area["x"])
    assert np.isnan(x).sum() == 2 and area["fill"] == "toself" and area["fillcolor"] == "#0000FF80"
    np.testing.assert_array_equal(x[:10], [0, 1, 2, 3, 4, 4, 3, 2, 1, 0])


def test_texts_of_a_user_stay_texts():
    """Neither the page nor plotly, which knows some tags, obeys them."""
    line = Line(X, X, "#000000", HOSTILE)
    panel = Panel(
        items=[line, Line(X, -X, "#000000", "other"), Texts([(0.0, 0.0, HOSTILE, "black", False)])],
        title=HOSTILE,
        label=HOSTILE,
        x_label=HOSTILE,
        y_ticks=[(0.0, HOSTILE)],
        group=HOSTILE,
    )
    page = str(figure(panel, HOSTILE))
    (found,) = specifications(page)
    assert page.count("<script") == page.count("</script>") == 1
    assert "<b onclick" not in page and "<a href" not in page
    layout, data = found["layout"], found["data"]
    texts = [
        layout["title"]["text"],
        layout["xaxis"]["title"]["text"].replace("<br>", ""),
        layout["yaxis"]["ticktext"][0],
        data[0]["name"],
        data[2]["text"][0],
    ]
    assert not any("<" in text for text in texts) and all("&lt;" in text for text in texts)


def test_a_key_names_each_item_once_and_a_press_finds_its_traces():
    one, two = (
        Panel(items=[Line(X, X, "#000000", "first"), Line(X, -X, "#D55E00", "second")])
        for _ in range(2)
    )
    page = str(panels([one, two]))
    assert page.count('data-name="first"') == 1 and page.count("<button") == 2
    found = [t["meta"] for spec in specifications(page) for t in spec["data"]]
    assert found == ["first", "second"] * 2
    assert "<button" not in panels([Panel(items=[Line(X, X, "#000000", "alone")])])


@pytest.mark.parametrize(
    "first, second, key",
    [("abd", "abcd", "abcd"), ("ab", "cd", "abcd"), ("ad", "bcd", "adbc"), ("ac", "ab", "abc")],
)
def test_a_key_keeps_the_order_of_every_panel(first, second, key):
    held = [
        Panel(items=[Line(X, X, "#000000", name) for name in names]) for names in (first, second)
    ]
    assert re.findall(r'data-name="(\w)"', str(panels(held))) == list(key)


def test_several_panels_are_one_figure_with_one_legend():
    items = [Line(X, X, "#000000", "first")]
    found = specification([Panel(items=items, title=name) for name in "xyz"], columns=3)
    assert [t.get("xaxis", "x") for t in found["data"]] == ["x", "x2", "x3"]
    assert [t["showlegend"] for t in found["data"]] == [True, False, False]
    domains = [found["layout"][f"xaxis{n}"]["domain"] for n in ("", "2", "3")]
    assert domains[0][1] < domains[1][0] and domains[1][1] < domains[2][0]
    assert [a["text"] for a in found["layout"]["annotations"]] == ["x", "y", "z"]


def test_a_heading_is_labelled_in_a_circle():
    heading = np.array([350.0, 359.0, 365.0, 371.0])
    found = drawn(Line(X[:4], heading, "#000000"), circle=True)
    alias = found["layout"]["yaxis"]["labelalias"]
    assert alias["365"] == "5" and alias["360"] == "0" and alias["365.5"] == "5.5"
    assert "350" not in alias
    np.testing.assert_allclose(column(found["data"][0]["customdata"]), [350, 359, 5, 11])
    below = drawn(Line(X[:2], np.array([-90.0, 90.0]), "#000000"), circle=True)
    assert below["layout"]["yaxis"]["labelalias"]["\u221290"] == "270"


def test_limits_hold_all_with_room():
    low, high = spanned([X])
    assert low == pytest.approx(-0.5) and high == pytest.approx(10.5)
    assert spanned([np.array([np.nan])]) == (0.0, 1.0)
