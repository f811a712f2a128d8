"""Drawings that a reader can zoom, in a real browser: what a drag, a double click and the buttons
do, and what is seen without JavaScript, in the dark, on a phone and on paper.
"""

import time

import numpy as np
import pytest

from infield.reports import page as report_page
from infield.reports.zoom import ZoomCurve, ZoomFigure, zoom_figure, zoom_panels, zoom_script
from tests.recal.chromium import chromium, find_chromium

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="no chromium on this machine")

TEMPLATE = """{% extends "base.html.j2" %}{% block title %}Zoom{% endblock %}
{% block content %}<p class="zoom-hint">Drag.</p>
{% for one in figures %}{{ one }}{% endfor %}{% endblock %}
{% block scripts %}{{ script }}{% endblock %}"""
SERIES, PANELS = "time [s] ", "gyro temperature [°C] tables"
END_S, LATE_S = 1000.0, 1500.0
PIXELS = 3.0  # a drag of the mouse is as exact as its pixels
RANGES = """((key) => uPlot.sync(key).plots.map(c => [c.scales.x.min, c.scales.x.max]))"""
SEEN = """((what) => [...document.querySelectorAll(what)].map(e => e.checkVisibility()))"""
WIDTHS = """[...document.querySelectorAll("canvas")].map(e => e.clientWidth)"""
MOST_S = 10.0  # until a drawing follows a window that changed
# the colours of letters, which are opaque in their middle, between 0 (black) and 255
LETTERS = """[...document.querySelectorAll("canvas")].map(c => {
    const data = c.getContext("2d").getImageData(0, c.height - 40, c.width, 40).data;
    let least = 255, most = 0;
    for (let k = 0; k < data.length; k += 4) if (data[k + 3] > 250) {
        least = Math.min(least, data[k]); most = Math.max(most, data[k]); }
    return [least, most]; })"""


def curve(time_s, **more):
    return ZoomCurve(name=more.pop("name", "gyro x"), values=np.sin(time_s / 60.0), **more)


def series(title, start_s, end_s, **more):
    t = np.arange(start_s, end_s + 1.0)
    return ZoomFigure(title=title, unit="deg/h", time_s=t, curves=[curve(t), curve(2 * t)], **more)


def panel(axis):
    T = np.linspace(-10.0, 50.0, 61)
    wave = np.cos(T / 20.0)
    known = {"low": wave - 0.1, "high": wave + 0.1}
    lines = [ZoomCurve(name="before", values=wave, **known, colour="#D55E00", dashed=True)]
    lines += [ZoomCurve(name="after", values=wave + 0.05, colour="#0072B2")]
    lines += [ZoomCurve(name="points", values=wave, mark="o", colour="#000000")]
    more = {"x_name": "gyro temperature [°C]", "group": "tables", "panel": True}
    return ZoomFigure(title=f"Gyro {axis}", unit="deg/h", time_s=T, curves=lines, **more)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Two series of one group, the second longer; a table in three panels; by the template, style
    and script of every report.
    """
    figures = [
        zoom_figure(series("heading", 0.0, END_S)),
        zoom_figure(series("velocity", 0.0, LATE_S)),
        zoom_panels([panel(axis) for axis in "xyz"]),
    ]
    template = report_page.page_environment().from_string(TEMPLATE)
    path = tmp_path_factory.mktemp("zoom") / "page.html"
    path.write_text(template.render(figures=figures, script=zoom_script()))
    return path.as_uri()


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture
def browser(started, page):
    """A window of 1280 pixels with the page, in the light."""
    started.size(1280)
    look(started)
    started.open(page)
    yield started
    assert not [e for e in started.events if e["method"] == "Runtime.exceptionThrown"]


def look(browser, *, scheme="light", media=""):
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.call("Emulation.setEmulatedMedia", media=media, features=features)


def ranges(browser, key=SERIES):
    return browser.evaluate(f"{RANGES}({key!r})")


def seen(browser, what):
    return browser.evaluate(f"{SEEN}({what!r})")


def mouse(browser, kind, x, y, clicks=1):
    place = {"x": x, "y": y, "button": "left", "clickCount": clicks}
    browser.call(
        "Input.dispatchMouseEvent", type=kind, buttons=int(kind != "mouseReleased"), **place
    )


def field(browser, number=0):
    """Left, top, width, height of the field of a drawing in the window."""
    return browser.evaluate(
        f"""(() => {{ const e = document.querySelectorAll(".u-over")[{number}];
        e.scrollIntoView({{block: "center"}}); const r = e.getBoundingClientRect();
        return [r.left, r.top, r.width, r.height]; }})()"""
    )


def drag(browser, start, end, *, number=0, below=0.0):
    """Across a drawing, between two shares of its width; below: pixels under its lower end at
    which the button is let go.
    """
    left, top, width, height = field(browser, number)
    y = top + height / 2
    mouse(browser, "mousePressed", left + start * width, y)
    for share in (0.5 * (start + end), end):
        mouse(browser, "mouseMoved", left + share * width, y, clicks=0)
    last = top + height + below if below else y
    if below:
        mouse(browser, "mouseMoved", left + end * width, last, clicks=0)
    mouse(browser, "mouseReleased", left + end * width, last)
    settle(browser)
    return width


def settle(browser):
    """Until what was put off to the next turn is done and drawn."""
    browser.call(
        "Runtime.evaluate",
        expression="new Promise(done => setTimeout(() => requestAnimationFrame(done), 30))",
        awaitPromise=True,
    )


def double_click(browser, number=0):
    left, top, width, height = field(browser, number)
    for clicks in (1, 2):
        for kind in ("mousePressed", "mouseReleased"):
            mouse(browser, kind, left + width / 2, top + height / 2, clicks)
    settle(browser)


def test_a_loaded_page_shows_the_live_drawings_alone(browser):
    assert browser.evaluate("document.querySelectorAll('figure.zoom.live').length") == 5
    assert seen(browser, "figure.zoom canvas") == [True] * 5 and seen(browser, ".zoom-hint") == [
        True
    ]
    assert seen(browser, "figure.zoom .drawing") == [False] * 5
    assert ranges(browser) == [[0.0, END_S], [0.0, LATE_S]]


@pytest.mark.parametrize("below", [0.0, 60.0])
def test_a_drag_zooms_the_drawings_of_its_group(browser, below):
    """Also where the button is let go under the drawing; the tables, of another group, stay."""
    others = ranges(browser, PANELS)
    width = drag(browser, 0.25, 0.75, below=below)
    found = ranges(browser)
    pixel = PIXELS * END_S / width
    assert found[0] == pytest.approx([0.25 * END_S, 0.75 * END_S], abs=pixel)
    assert found[1] == found[0] and ranges(browser, PANELS) == others


def test_a_finger_zooms_as_the_mouse_does(browser, page):
    browser.size(390, mobile=True)
    browser.open(page)
    browser.call("Emulation.setTouchEmulationEnabled", enabled=True)
    settle(browser)  # the drawings take the new width
    try:
        left, top, width, height = field(browser)
        along = [(left + share * width, top + height / 2) for share in (0.25, 0.4, 0.6, 0.75)]
        for kind, (x, y) in zip(("touchStart", *["touchMove"] * 3), along):
            browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}])
        browser.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        settle(browser)
        pixel = PIXELS * END_S / width
        assert ranges(browser)[0] == pytest.approx([0.25 * END_S, 0.75 * END_S], abs=pixel)
        assert ranges(browser)[1] == ranges(browser)[0]
    finally:
        browser.call("Emulation.setTouchEmulationEnabled", enabled=False)


def test_a_double_click_takes_each_drawing_back_to_its_own(browser):
    whole = ranges(browser)
    for number in (0, 1):
        drag(browser, 0.4, 0.6)
        assert ranges(browser) != whole
        double_click(browser, number)
        assert ranges(browser) == whole


def test_a_click_moves_nothing(browser):
    whole = ranges(browser)
    drag(browser, 0.5, 0.5)
    assert ranges(browser) == whole


def test_buttons_do_the_same_without_a_mouse(browser):
    whole = ranges(browser)
    named = "[...document.querySelectorAll('.zoomer')].map(r => r.innerText.split(/\\s+/))"
    rest = ["closer", "wider", "all"]
    rows = browser.evaluate(named)
    assert rows == [["earlier", "later", *rest]] * 2 + [["lower", "higher", *rest]]
    press = "document.querySelectorAll('.zoomer')[0].children[{}].click()"
    browser.evaluate(press.format(2))
    settle(browser)
    assert ranges(browser) == [[0.25 * END_S, 0.75 * END_S]] * 2
    browser.evaluate(press.format(1))
    settle(browser)
    assert ranges(browser) == [[0.5 * END_S, END_S]] * 2
    browser.evaluate(press.format(4))
    settle(browser)
    assert ranges(browser) == whole


def test_the_dark_is_drawn_anew(browser):
    """When the system turns dark at night, a page that is open already follows."""
    light = browser.evaluate(LETTERS)
    look(browser, scheme="dark")
    settle(browser)
    dark = browser.evaluate(LETTERS)
    assert all(least < 90 for least, _ in light) and all(most > 200 for _, most in dark)
    assert all(least > 120 for least, _ in dark), dark  # none of the dark letters is left
    mark = "getComputedStyle(document.querySelector('.key .mark')).color"
    assert browser.evaluate(mark) == "rgb(230, 234, 238)"  # black points are drawn in this, too


def test_without_javascript_the_drawing_is_seen(started, page):
    started.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        for width in (1280, 390):
            started.size(width, mobile=width < 600)
            look(started)
            started.open(page)
            assert seen(started, "figure.zoom .drawing svg") == [True] * 5
            assert started.evaluate("document.querySelectorAll('canvas, .zoomer').length") == 0
            assert not any(seen(started, ".zoom-hint"))
            assert started.evaluate("document.documentElement.scrollWidth") <= width
    finally:
        started.call("Emulation.setScriptExecutionDisabled", value=False)


def test_a_phone_is_not_pushed_wider(browser, page):
    browser.size(390, mobile=True)
    for turned in (False, True):  # opened on a phone, or turned to its width afterwards
        if turned:
            browser.size(1280)
            browser.open(page)
            browser.size(390, mobile=True)
            until = time.monotonic() + MOST_S
            while max(browser.evaluate(WIDTHS)) > 390 and time.monotonic() < until:
                settle(browser)
        else:
            browser.open(page)
        assert browser.evaluate("document.documentElement.scrollWidth") <= 390
        widths = browser.evaluate(WIDTHS)
        assert len(widths) == 5 and all(300 < width <= 390 for width in widths), widths


def test_paper_shows_the_whole_drawing(browser):
    drag(browser, 0.4, 0.6)
    look(browser, media="print")
    assert seen(browser, "figure.zoom .drawing svg") == [True] * 5
    assert not any(seen(browser, "canvas, .zoomer, .chart-key, .zoom-hint"))
