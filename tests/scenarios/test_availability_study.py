"""The availability study: draws by number alone, published intervals."""

from collections import Counter

import numpy as np
import pytest

from benchmarks.availability import (
    STATIONS,
    accepted,
    at_usual_strength,
    draw,
    sigma_ratio,
    squared_error,
    stations,
    study_session,
    wilson,
)


def record(index, **changes):
    """An accepted session."""
    return {
        **vars(draw(index, 1)),
        "outcome": "accepted",
        "reasons": [],
        "sigma_deg_h": [1.0, 2.0, 3.0],
        "normalised": [1.0, -1.0, 0.5],
        "dropped_s": 10.0,
        "cpu_s": 0.4,
        "revision": "abc",
        **changes,
    }


def test_a_round_holds_every_environment_with_every_technology():
    for first in (0, 27):
        pairs = Counter(
            (d.environment, d.technology) for d in (draw(first + k, 4) for k in range(27))
        )
        assert len(pairs) == 27 and set(pairs.values()) == {1}
    assert draw(5, 1) == draw(5, 1) != draw(5, 2)
    strengths = np.log([draw(k, 1).strength for k in range(500)])
    assert abs(strengths.mean()) < 0.1 and abs(strengths.std() - 0.5) < 0.05
    assert len(stations()) == STATIONS


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [(0, 10, 0.0, 0.278), (10, 10, 0.722, 1.0), (5, 10, 0.237, 0.763)],
)
def test_intervals_are_wilsons(count, of, low, high):
    """Agresti & Coull (1998), table of ten trials."""
    np.testing.assert_allclose(wilson(count, of), (low, high), atol=1e-3)


def test_the_scores_count_what_the_records_say():
    records = [record(k) for k in range(54)]
    records[0] = record(0, outcome="refused", reasons=["too_noisy"])
    calm = {(r["technology"], r["station"]): {"sigma_deg_h": [1.0, 1.0, 1.0]} for r in records}
    assert accepted(records) == "98 % (90 to 100)"
    assert squared_error(records)[0] == pytest.approx(0.75)
    assert all(2 / 3 < r["strength"] < 1.5 for r in at_usual_strength(records))
    assert sigma_ratio(records, calm) == f"{np.sqrt(14 / 3):.2f}"


def test_a_calm_session_is_scored_against_the_truth():
    made = next(d for d in (draw(k, 1) for k in range(27)) if d.environment == "calm")
    scored = study_session(made)
    assert scored["outcome"] == "accepted"
    assert np.max(np.abs(scored["normalised"])) < 5.0
    assert np.all(np.array(scored["sigma_deg_h"]) < scored["sigma_before_deg_h"])
