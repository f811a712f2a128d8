"""Figures in a real browser: what a drag, a double click, the key and the bar of tools do; the
dark, a phone, paper; without JavaScript; nothing is fetched.
"""

import numpy as np
import pytest

from infield.reports import page as report_page
from infield.reports.drawing import Line, Marks, Panel, ShadedSpan, Strip, Texts
from tests.recal.chromium import chromium, find_chromium

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="no chromium on this machine")

TEMPLATE = """{% extends "base.html.j2" %}{% block title %}Figures{% endblock %}
{% block content %}{{ stack(series) }}{{ panels(tables) }}{{ figure(rows) }}{% endblock %}"""
FIGURES = 6
END_S, LATE_S = 1000.0, 1500.0
PIXELS = 3.0  # a drag of the mouse is as exact as its pixels
PLACES = "[...document.querySelectorAll('figure.plot .drawing')]"
DRAWN = f"{PLACES}.filter(p => p._fullLayout && p.querySelector('.main-svg')).length"
RANGES = f"{PLACES}.map(p => p._fullLayout.xaxis.range)"
LETTER = "getComputedStyle(document.querySelector('.xtick text')).fill"
HOSTILE = '<a href="javascript:document.title=1">x</a>'


def series(start_s, end_s):
    t = np.arange(start_s, end_s + 1.0)
    items = [
        Line(t, np.sin(t / 60.0), "#000000", "gyro x"),
        Line(t, np.cos(t / 60.0), "#D55E00", "y"),
    ]
    return Panel(
        items=items,
        x_label="time [s]",
        y_label="rate [deg/h]",
        group="log",
        spans=[ShadedSpan(100.0, 200.0)],
        strips=[Strip(0.0, 300.0, "parked", "#009E73")],
        height=220,
    )


def table(axis):
    T = np.linspace(-10.0, 50.0, 61)
    wave = np.cos(T / 20.0)
    items = [
        Line(T, wave, "#D55E00", "before", low=wave - 0.1, high=wave + 0.1),
        Marks(T, wave, "o", "#000000", "points", low=wave - 0.2, high=wave + 0.2),
    ]
    return Panel(items=items, title=f"Gyro {axis}", x_label="temperature [°C]", group="tables")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """By the template, style and script of every report."""
    names = ["a long name of a row, of a unit and its rival", HOSTILE]
    rows = Panel(
        items=[Texts([(1.0, 0.0, HOSTILE, "black", True)])],
        y_ticks=list(enumerate(names)),
        y_limits=(1.6, -0.6),
    )
    template = report_page.page_environment().from_string(TEMPLATE)
    path = tmp_path_factory.mktemp("figures") / "page.html"
    text = template.render(
        series=[series(0.0, END_S), series(0.0, LATE_S)], tables=map(table, "xyz"), rows=rows
    )
    path.write_text(text)
    return path.as_uri()


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture
def browser(started, page):
    """A window of 1280 pixels with the page, in the light, all figures drawn."""
    show(started, page, 1280)
    yield started
    assert not [e for e in started.events if e["method"] == "Runtime.exceptionThrown"]
    assert started.complaints() == []
    asked = [e["params"]["request"]["url"] for e in started.events if "request" in e["params"]]
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []


def show(browser, page, width, *, scheme="light", mobile=False):
    browser.size(width, 3500, mobile=mobile)
    look(browser, scheme=scheme)
    browser.open(page)
    browser.until(f"{DRAWN} === {FIGURES}")


def look(browser, *, scheme="light", media=""):
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.call("Emulation.setEmulatedMedia", media=media, features=features)


def field(browser, number=0):
    return browser.evaluate(
        f"""(() => {{ const e = {PLACES}[{number}].querySelector(".nsewdrag");
        const r = e.getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; }})()"""
    )


def drag(browser, start, end, number=0):
    """Across a figure, between two shares of its width."""
    left, top, width, height = field(browser, number)
    mouse, y = browser.page.mouse, top + height / 2
    mouse.move(left + start * width, y)
    mouse.down()
    mouse.move(left + 0.5 * (start + end) * width, y)
    mouse.move(left + end * width, y)
    mouse.up()
    return width


def double_click(browser, number=0):
    left, top, width, height = field(browser, number)
    browser.page.wait_for_timeout(400)  # of an earlier click it would be the second
    browser.page.mouse.dblclick(left + width / 2, top + height / 2)


def test_a_drag_zooms_the_figures_of_its_group_and_a_double_click_shows_all(browser):
    whole = browser.evaluate(RANGES)
    width = drag(browser, 0.25, 0.75)
    browser.until(f"{RANGES}[1][1] < 800")
    found = browser.evaluate(RANGES)
    assert found[0] == pytest.approx([250.0, 750.0], abs=PIXELS * END_S / width)
    assert found[1] == found[0] and found[2:] == whole[2:]
    double_click(browser)
    browser.until(f"{RANGES}[1][1] > 800")
    assert browser.evaluate(RANGES) == whole


def test_a_name_of_the_key_hides_and_shows_its_lines(browser):
    shown = f"{PLACES}.slice(0, 2).map(p => p.data.map(t => t.visible !== false))"
    button = "document.querySelector('.key button[data-name=y]')"
    browser.evaluate(f"{button}.click()")
    browser.until(f"{shown}.every(one => !one[1])")
    assert browser.evaluate(shown) == [[True, False]] * 2
    assert browser.evaluate(f"{button}.getAttribute('aria-pressed')") == "false"
    browser.evaluate(f"{button}.click()")
    browser.until(f"{shown}.every(one => one[1])")


def test_the_dark_is_drawn_anew(browser):
    """When the system turns dark at night, a page that is open already follows."""
    assert browser.evaluate(LETTER) == "rgb(0, 0, 0)"
    look(browser, scheme="dark")
    browser.until(f"{LETTER} === 'rgb(230, 234, 238)'")
    ground = f"{PLACES}.map(p => p._fullLayout.paper_bgcolor)"
    assert set(browser.evaluate(ground)) == {"#12161a"}


def test_paper_shows_the_whole_in_the_light(browser):
    drag(browser, 0.4, 0.6)
    look(browser, scheme="dark", media="print")
    browser.until(f"{PLACES}.every(p => p._fullLayout.width <= 680)")
    assert browser.evaluate(RANGES)[0] == pytest.approx([0.0, END_S], abs=1.0)
    assert browser.evaluate(LETTER) == "rgb(0, 0, 0)"
    look(browser)
    browser.until(f"{PLACES}[0]._fullLayout.width > 1000")


@pytest.mark.parametrize("turned", [False, True])
def test_a_phone_is_not_pushed_wider(browser, page, turned):
    """Opened on a phone, or turned to its width afterwards."""
    browser.size(390, 5000, mobile=True)
    if not turned:
        browser.open(page)
    browser.until(f"{DRAWN} === {FIGURES} && {PLACES}[0]._fullLayout.width <= 390")
    assert browser.evaluate("document.documentElement.scrollWidth") <= 390
    sizes = "[...document.querySelectorAll('.plot text')].map(e => getComputedStyle(e).fontSize)"
    assert min(float(size.removesuffix("px")) for size in browser.evaluate(sizes)) >= 11.0
    below = f"{PLACES}.map(p => p.getBoundingClientRect().top)"
    tops = browser.evaluate(below)
    assert tops == sorted(tops) and len(set(tops)) == FIGURES
