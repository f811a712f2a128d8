"""The figures of the concepts show what their text says."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from ins.units import DEG_PER_HOUR

DOCS = Path(__file__).parents[2] / "docs"
MM_S = 1e-3
GRAVITY_M_S2 = 9.806


@pytest.fixture(scope="module")
def figures():
    spec = importlib.util.spec_from_file_location("concept_figures", DOCS / "figures.py")
    module = importlib.util.module_from_spec(spec)
    path = list(sys.path)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    sys.path[:] = path
    del sys.modules[spec.name]


def test_a_straight_taxi_shows_heading_error_across_the_track_alone(figures):
    time_s, body, track, turned = figures.cross_velocities(None)
    assert turned is None and np.max(np.abs(body)) < 0.1 * MM_S
    psi = -figures.DRIFT_DEG_H * DEG_PER_HOUR / (7.292115e-5 * np.cos(np.pi / 4))
    assert track[time_s > 60] == pytest.approx(10.0 * psi, abs=0.1 * MM_S)  # -9.4 mm/s at 10 m/s


def test_after_a_turn_the_body_shows_the_bias(figures):
    time_s, body, _, turned = figures.cross_velocities(90.0)
    since = time_s[-1] - np.mean(turned)
    expected = -0.5 * GRAVITY_M_S2 * figures.DRIFT_DEG_H * DEG_PER_HOUR * since**2
    assert body[-1] == pytest.approx(expected, rel=0.05)


def test_a_second_start_parts_what_one_warm_up_does_not(figures):
    titles = [panel.title for panel in figures.draw_gap()]
    one, both = (float(title.split("start, ")[1].split()[0]) for title in titles)
    assert one > 0.98 and both < 0.5


def test_every_figure_is_there_and_shown(figures):
    shown = (DOCS / "concepts.md").read_text("utf-8")
    for name in ("update", "heading", "observability", "merge", "gap"):
        svg = (DOCS / "figures" / f"{name}.svg").read_text("utf-8")
        assert "</svg>" in svg and len(svg) < 150_000 and f"(figures/{name}.svg)" in shown
