"""Charts drawn by this project's own hand: where values land, round labels, what is left out."""

import re

import numpy as np
import pytest

from infield.reports.charts import (
    MOST_ALONG_AXIS,
    Band,
    Boxes,
    FarEdge,
    Line,
    Marks,
    Panel,
    Place,
    Uprights,
    chart,
    log_ticks,
    round_step,
    text_width,
    tick_labels,
    ticks_of,
)

TENTH = 0.05 + 1e-9  # points are written to 0.1 of a point
X = np.linspace(0.0, 10.0, 11)


def _paths(svg):
    """The points (n, 2) of each path that is no grid, axis or mark."""
    found = re.findall(r"<g clip-path[^>]*>(.*?)</g>", svg, flags=re.DOTALL)
    return [
        np.array([[float(v) for v in pair.split()] for pair in re.split("[ML]", path) if pair])
        for body in found
        for path in re.findall(r'<path d="([ML0-9. -]*)"', body)
    ]


def _labels(svg):
    return re.findall(r"<text[^>]*>([^<]*)</text>", svg)


def test_values_land_where_the_labels_say():
    """Read back from the drawing: the labelled ticks give the scale, the path gives the values."""
    y = 3.0 + 0.7 * X
    svg = str(chart([Panel(items=[Line(X, y, "#000")])], "a line"))
    across = dict(re.findall(r'<text x="([\d.]+)" y="[\d.]+" text-anchor="middle">(\d+)<', svg))
    at, value = np.array([(float(a), float(v)) for a, v in across.items()]).T
    (points,) = _paths(svg)
    slope, offset = np.polyfit(value, at, 1)
    np.testing.assert_allclose(points[[0, -1], 0], slope * X[[0, -1]] + offset, atol=2 * TENTH)
    rows = re.findall(r'y="([\d.]+)" text-anchor="end">([\d.]+)<', svg)
    down, value = np.array([(float(a), float(v)) for a, v in rows]).T
    slope, offset = np.polyfit(value, down, 1)
    middle = offset - 0.36 * 9.5  # letters stand a third of their size below their tick
    np.testing.assert_allclose(points[[0, -1], 1], slope * y[[0, -1]] + middle, atol=2 * TENTH)


def test_a_logarithmic_axis_has_equal_decades():
    place = Place(0.0, 0.0, 300.0, 100.0, (0.1, 100.0), (0.0, 1.0), x_log=True)
    np.testing.assert_allclose(place.across([0.1, 1.0, 10.0, 100.0]), [0, 100, 200, 300])
    np.testing.assert_allclose(place.down([0.0, 1.0]), [100.0, 0.0])


def test_logarithmic_panels_have_few_round_ticks_and_room_for_what_is_positive():
    y = np.array([-1.0, 0.0, 3e-4, 0.02, 7.0])
    svg = str(_drawn(Line(X[:5], y, "#abc"), y_log=True))
    rows = re.findall(r'y="([\d.]+)" text-anchor="end">([\d.]+)<', svg)
    down, value = np.array([(float(a), float(v)) for a, v in rows]).T
    assert 2 <= value.size <= MOST_ALONG_AXIS and value.min() > 1e-4 and value.max() < 15.0
    slope, offset = np.polyfit(np.log10(value), down - 0.36 * 9.5, 1)
    (points,) = _paths(svg)
    np.testing.assert_allclose(
        points[-3:, 1], slope * np.log10(y[-3:]) + offset, atol=2 * TENTH + 0.1
    )


@pytest.mark.parametrize(
    ("limits", "most", "labels"),
    [
        ((0.9, 11.0), 9, ["1", "2", "5", "10"]),
        ((1e-3, 1.0), 9, ["0.001", "0.003", "0.01", "0.03", "0.1", "0.3", "1"]),
        ((1e-3, 1e3), 4, ["0.01", "1", "100"]),
        ((3.0, 4.5), 4, ["3.0", "3.5", "4.0", "4.5"]),
    ],
)
def test_ticks_of_decades(limits, most, labels):
    assert [text for _, text in log_ticks(limits, most)] == labels


def test_equal_scales_and_far_edges():
    """A square of the data is a square of the drawing; the far edges have numbers of their own."""
    square = Line(np.array([0.0, 1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0, 1.0]), "#abc")
    far = FarEdge([(0.5, "7.5")], "longitude [deg]"), FarEdge([(0.25, "45.2")], "latitude [deg]")
    panel = Panel(items=[square], equal=True, far=far, x_limits=(-1.0, 2.0), y_limits=(-0.5, 1.5))
    svg = str(chart([panel], "a map", width=6.0, height=6.0))
    (points,) = _paths(svg)
    assert np.ptp(points[:, 0]) == pytest.approx(np.ptp(points[:, 1]), abs=2 * TENTH)
    at = {text: (float(x), float(y)) for x, y, text in _places(svg)}
    assert at["7.5"][0] == pytest.approx(points[:, 0].mean(), abs=2 * TENTH)
    assert at["7.5"][1] < points[:, 1].min() and at["longitude [deg]"][1] < at["7.5"][1]
    assert at["45.2"][0] > points[:, 0].max()
    middle = points[0, 1] - 0.25 * np.ptp(points[:, 1])
    assert at["45.2"][1] - 0.36 * 9.5 == pytest.approx(middle, abs=2 * TENTH)


def _places(svg):
    return re.findall(r'<text x="([\d.]+)" y="([\d.]+)"[^>]*>([^<]*)</text>', svg)


def test_a_cloud_is_one_path():
    svg = str(_drawn(Marks(X, X, ".", "#123", size=1.8)))
    (dots,) = re.findall(r'<path class="dots" d="([^"]*)"', svg)
    assert dots.count("M") == dots.count("h0") == X.size


@pytest.mark.parametrize("span", [3e-7, 0.013, 0.8, 1.0, 7.0, 83.0, 1234.0, 5e8])
@pytest.mark.parametrize("most", [1, 4, MOST_ALONG_AXIS])
def test_steps_are_round_and_not_too_many(span, most):
    step = round_step(span, most)
    digits = step / 10.0 ** np.floor(np.log10(step) + 1e-9)
    assert min(abs(digits - s) for s in (1.0, 2.0, 2.5, 5.0)) < 1e-6
    assert span / step <= most * (1 + 1e-6) and span / step > most / 2.6
    assert len(ticks_of((0.0, span), step)) <= most + 1


@pytest.mark.parametrize(
    ("limits", "step", "labels"),
    [
        ((-0.021, 0.02), 0.01, ["\u22120.02", "\u22120.01", "0.00", "0.01", "0.02"]),
        ((0.0, 5.0), 2.5, ["0.0", "2.5", "5.0"]),
        ((0.0, 0.05), 0.025, ["0.000", "0.025", "0.050"]),
        ((-5.0, 35.0), 20.0, ["0", "20"]),
        ((0.0, 2e-5), 1e-5, ["0", "1e\u221205", "2e\u221205"]),
    ],
)
def test_labels_have_the_digits_of_their_step(limits, step, labels):
    assert tick_labels(ticks_of(limits, step), step) == labels


def test_degrees_begin_anew_at_north():
    assert tick_labels([-90.0, 0.0, 270.0, 450.0], 90.0, circle=True) == ["270", "0", "270", "90"]
    assert tick_labels([-360.0, 0.0, 360.0], 360.0, circle=True) == ["\u2212360", "0", "360"]


def test_gaps_stay_gaps_and_straight_stretches_lose_their_middle():
    y = np.where(X == 5.0, np.nan, 1.0)
    y[9] = 2.0
    paths = re.findall(r'd="(M[^"]*)" fill="none" stroke="#abc"', str(_drawn(Line(X, y, "#abc"))))
    (path,) = paths
    assert path.count("M") == 2
    first, second = path.split("M")[1:]
    assert len(first.split("L")) == 2 and len(second.split("L")) == 4


def _drawn(*items, **panel):
    return chart([Panel(items=list(items), **panel)], "drawn")


def test_marks_bars_and_bands_are_all_there():
    low, high = X - 1.0, X + 1.0
    svg = str(
        _drawn(
            Band(X, low, high, "#00f", 0.2),
            Uprights(X, low, high, "#0f0"),
            Marks(X, X, "^", "#f00"),
            Boxes([(2.0, 4.0, None, None)], "#eee"),
        )
    )
    assert svg.count('<path transform="translate') == X.size
    uprights = re.search(r'd="([^"]*)" fill="none" stroke="#0f0"', svg)
    assert uprights and uprights[1].count("M") == X.size
    (box,) = re.findall(r'<rect [^>]*width="([\d.]+)"[^>]*fill="#eee"', svg)
    clip = re.search(r"<clipPath[^>]*><rect [^>]*width=\"([\d.]+)\"", svg)
    assert clip and float(box) == pytest.approx(0.2 / 1.1 * float(clip[1]), abs=2 * TENTH)


def test_panels_share_x_and_legends_stand_in_the_drawing():
    one = Panel(items=[Line(X, X, "#000", name="first <")], legend="beside")
    two = Panel(
        items=[Line(X, -X, "#000", name="second")], legend="beside", x_label="t", x_limits=(0, 20)
    )
    svg = str(chart([one, two], "two", width=10.0, height=4.0))
    upper, lower = _paths(svg)
    np.testing.assert_array_equal(upper[:, 0], lower[:, 0])
    assert upper[:, 1].max() < lower[:, 1].min() and "first &lt;" in _labels(svg)
    for x, text in re.findall(r'<text x="([\d.]+)"[^>]*text-anchor="start"[^>]*>([^<]*)<', svg):
        assert float(x) + text_width(text.replace("&lt;", "<")) < 720.0
    assert "t" in _labels(svg) and _labels(svg).count("20.0") == 1  # of x, below the last


def test_equal_charts_give_equal_text_and_others_other_ids():
    one, again, other = (_drawn(Line(X, k * X, "#000")) for k in (1.0, 1.0, 2.0))
    assert one == again
    ids = [set(re.findall(r'id="([^"]*)"', str(svg))) for svg in (one, other)]
    assert ids[0] and not ids[0] & ids[1]


@pytest.mark.parametrize("y", [np.full(11, np.nan), np.zeros(11), np.full(11, 4.5), np.zeros(0)])
def test_nothing_to_see_is_drawn_too(y):
    svg = str(_drawn(Line(X[: y.size], y, "#000"), title="empty"))
    assert "nan" not in svg and "inf" not in svg and "empty" in _labels(svg)
