"""What is said of a value beside its sigma: whether it differs from zero, and one table from
another.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from infield.replay.reasons import ReplayVerdict
from infield.reports.documents.replay import (
    DifferenceDocument,
    ReplayChangeDocument,
    _sigma_of_change,
)
from infield.reports.replay_page import verdict_words
from ins.verdicts import differs


def test_chance_passes_for_a_difference_in_one_of_twenty_cases():
    drawn = np.random.default_rng(1).standard_normal(20_000)
    share = np.mean([differs(x, 1.0) for x in drawn])
    assert 0.040 < share < 0.051  # 4.55 %, 3 sigma of 20,000 draws


def flown(role, sha256, sigma_nm_h, parent):
    table = SimpleNamespace(provenance={"parent_sha256": parent})
    choice = SimpleNamespace(role=role, sha256=sha256, table=table)
    return SimpleNamespace(choice=choice, predicted=SimpleNamespace(sigma_nm_h=sigma_nm_h))


def test_the_error_of_an_updated_table_is_a_part_of_its_parents():
    """Bayes: cov(after, before) = var(after), so the variance of their difference is before less
    after; drawn here with a scalar bias and one measurement of it.
    """
    rng = np.random.default_rng(2)
    truth = 0.8 * rng.standard_normal(50_000)
    measured = truth + 0.6 * rng.standard_normal(truth.size)
    after = measured * 0.8**2 / (0.8**2 + 0.6**2)
    sigma_after = np.std(after - truth)
    old, new = flown("previous", "a", 0.8, None), flown("active", "b", sigma_after, "a")
    assert np.std(after - 0.0) == pytest.approx(_sigma_of_change(old, new), rel=0.01)
    assert _sigma_of_change(new, old) == pytest.approx(_sigma_of_change(old, new))
    other = flown("active", "b", sigma_after, None)
    assert _sigma_of_change(old, other) == pytest.approx(np.hypot(0.8, sigma_after))
    old.predicted = None
    assert _sigma_of_change(old, new) is None


@pytest.mark.parametrize(
    ("change", "significant", "words"),
    [
        (0.068, False, "no significant difference between the tables"),
        (-2.0, True, "the active table drifts significantly less than the previous"),
        (2.0, True, "the active table drifts significantly more than the previous"),
    ],
)
def test_a_replay_says_whether_the_tables_differ(change, significant, words):
    rate = ReplayChangeDocument(previous=3.0, active=3.0 + change, change=change)
    difference = DifferenceDocument(
        heading_deg=0.0,
        heading_mrad=0.0,
        heading_expected_mrad=0.0,
        rate_nm_h=rate,
        sigma_rate_nm_h=0.466,
        significant=differs(change, 0.466),
    )
    document = SimpleNamespace(verdict=ReplayVerdict.REPLAYED, difference=difference)
    assert difference.significant is significant and verdict_words(document) == words
    document.verdict = ReplayVerdict.REFUSED
    assert verdict_words(document) == "refused"
