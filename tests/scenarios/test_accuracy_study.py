"""The accuracy study: a real cell, and cells made to miss, each of which must be named."""

import numpy as np
import pytest

from benchmarks import accuracy, accuracy_summary
from benchmarks.study import Work

CELL = "10 min alignment"


def bound_line(**changes):
    line = {
        "row": CELL,
        "lat_deg": 45.0,
        "gnss": False,
        "hold": True,
        "bound_deg_h": [0.002, 0.0099, 0.002],
        "prior_deg_h": [0.01] * 3,
        "heading_bound_rad": 1e-3,
    }
    return {**line, **changes}


def run_lines(count, *, scale=1.0, sigma=1.0, verdicts=("observed", "not_observable", "observed")):
    """Runs whose errors are `scale` times the bound, and whose sigmas are `sigma` times it."""
    rng, least = np.random.default_rng(1), np.array(bound_line()["bound_deg_h"])
    lines = []
    for seed in range(count):
        z = rng.standard_normal(3)
        lines.append(
            {
                "row": CELL,
                "lat_deg": 45.0,
                "gnss": False,
                "hold": True,
                "seed": seed,
                "error_deg_h": (scale * least * z).tolist(),
                "sigma_deg_h": (sigma * least).tolist(),
                "verdicts": list(verdicts),
                "outcome": "accepted",
                "nees": float((scale / sigma) ** 2 * z @ z),
                "nis_mean": 1.0,
                "dof": 100,
                "nis_by_kind": {"still": [100.0, 100]},
                "heading_normalised": 0.5,
                "sigma_heading_rad": 1e-3,
            }
        )
    return lines


def summary(lines):
    return accuracy_summary.summarise([bound_line(), *lines], [CELL])


@pytest.mark.slow
def test_a_cell_runs():
    text = accuracy.run(Work(), runs=2, rows=(CELL,), latitudes=(45.0,))
    assert f"| {CELL} |  | yes | 2 |" in text


def test_an_estimator_at_the_bound_misses_nothing():
    study = summary(run_lines(400))
    assert list(accuracy.misses(study["cells"])) == []
    totals = study["totals"]
    assert totals["observable_axes"] == 2 == totals["within_goal"]
    assert totals["verdicts_agreed"] == 1.0
    assert totals["nees_inside"] == 1 and totals["overconfident_axes"] == 0
