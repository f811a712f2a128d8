"""The ceiling of the gap study, and effects in other forms, as far as no trial is needed."""

import json

import numpy as np
import pytest

from benchmarks.gap_oracle import over_sphere
from benchmarks.gap_study_document import ON_TOP, ORACLE, oracle_shares
from benchmarks.gap_study_summary import QUESTIONS
from benchmarks.gap_trials.effects import EFFECTS, FORMS, effect_named, possible
from simreal.effects.catalogue import catalogue


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_the_likelihood_of_any_direction_is_the_mean_over_the_sphere(k):
    rng = np.random.default_rng(k)
    way = rng.standard_normal((200_000, k))
    cos = way[:, 0] / np.linalg.norm(way, axis=1)
    for x in (0.5, 2.0, 5.0):
        # 200,000 draws: a relative sigma of at most 1 %
        assert over_sphere(np.array([x]), k)[0] == pytest.approx(
            np.log(np.mean(np.exp(x * cos))), abs=0.03
        )


def test_the_ceilings_rise_with_the_size_and_stand_beside_a_question_of_the_study():
    shares = oracle_shares()
    assert list(shares) == ["3", "5", "8", "12"]
    assert sorted(shares.values()) == list(shares.values())
    assert {q.cell for q in QUESTIONS if q.words == ON_TOP} >= {"5", "8", "12"}
    rows = json.loads(ORACLE.read_text())["rows"]
    assert all(r["oracle_right_and_alarm"] <= r["oracle_right"] <= r["draws"] for r in rows)


def test_other_forms_are_planted_by_name_only_and_answered_by_the_catalogue():
    assert not FORMS.keys() & EFFECTS.keys()
    everything = frozenset({"taxi", "gnss", "odometer", "runs"})
    assert not {e.name for e in possible(everything)} & FORMS.keys()
    names = {e.name for e in catalogue()}
    for name in FORMS:
        effect = effect_named(name)
        assert {*effect.right_answers, *effect.confounded} <= names
