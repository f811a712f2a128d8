"""The accuracy study: a real cell end to end, resumed; and cells made to miss, each of which must
be named.
"""

import json
from concurrent.futures import Executor, Future

import numpy as np
import pytest

from benchmarks import accuracy_document, accuracy_study, accuracy_summary

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


class InThisProcess(Executor):
    """A pool whose work is done by the time it is handed in."""

    def __init__(self, workers, mp_context):
        assert workers == 1

    def submit(self, work, /, *arguments):
        done = Future()
        done.set_result(work(*arguments))
        return done


def test_a_cell_runs_goes_on_and_is_drawn(tmp_path, monkeypatch):
    """Two seeds in a pool of processes, then one more in this one: the first two are not done
    again; page, figure and summary stand.
    """
    keep = tmp_path / "runs.jsonl"
    common = [
        "--rows",
        CELL,
        "--latitudes",
        "45",
        "--jobs",
        "1",
        "--keep",
        str(keep),
        "-o",
        str(tmp_path),
    ]
    accuracy_study.main(["--runs", "2", *common])
    first = keep.read_text().splitlines()
    assert len(first) == 3
    keep.write_text("\n".join(first) + '\n{"row": "cut o')  # interrupted while writing
    monkeypatch.setattr(accuracy_study, "ProcessPoolExecutor", InThisProcess)
    accuracy_study.main(["--runs", "3", *common])
    kept = accuracy_study.read(keep)
    assert sorted(line["seed"] for line in kept if "seed" in line) == [0, 1, 2]
    cell = json.loads((tmp_path / "accuracy.json").read_text())["cells"][0]
    assert cell["runs"] == 3 and cell["failed"] == 0
    assert np.all(np.array(cell["sigma_deg_h"]) > 0.98 * np.array(cell["bound_deg_h"]))
    assert cell["expected"][1] == "not_observable" and cell["verdicts"][1] == {"not_observable": 3}
    assert (
        CELL in (tmp_path / "accuracy.md").read_text()
        and (tmp_path / "accuracy.svg").stat().st_size > 5000
    )


def test_an_estimator_at_the_bound_misses_nothing():
    study = summary(run_lines(400))
    assert accuracy_document.page(study).count("None.") == 1
    totals = study["totals"]
    assert (
        totals["observable_axes"] == 2 == totals["within_goal"] and totals["verdicts_agreed"] == 1.0
    )
    assert totals["nees_inside"] == 1 and totals["overconfident_axes"] == 0


@pytest.mark.parametrize(
    ("made", "said"),
    [
        ({"scale": 1.4}, "north: RMS 1."),
        ({"sigma": 0.8}, "east: sigma 0.800 of the bound"),
        ({"sigma": 0.8}, "NEES 1."),
    ],
)
def test_what_misses_is_named(made, said):
    assert said in accuracy_document.page(summary(run_lines(400, **made)))


def test_a_verdict_that_the_bound_does_not_call_for_is_counted():
    study = summary(run_lines(10, verdicts=("observed", "weak", "observed")))
    assert study["totals"]["verdicts_agreed"] == pytest.approx(2 / 3)
    assert "owo (100 % differ)" in accuracy_document.page(study)


def test_a_failed_run_is_listed_and_not_scored():
    lines = run_lines(3)
    lines[1] = {k: lines[1][k] for k in ("row", "lat_deg", "gnss", "hold", "seed")} | {
        "failed": "ArithmeticError: lost"
    }
    study = summary(lines)
    assert study["totals"]["failed"] == 1
    assert "1 runs failed, ArithmeticError: lost" in accuracy_document.page(study)
