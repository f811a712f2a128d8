"""The ceiling of the gap study, and effects in other forms, as far as no trial is needed."""

import numpy as np
import pytest

from benchmarks.gap_oracle import Candidate, Oracle, over_sphere
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


def test_the_oracle_names_the_nearer_of_two_signatures_and_the_more_usual_of_two_alike():
    def point(name, column, log_prior=0.0):
        one = np.ones((1, 1))
        return Candidate((name, "gyro_x"), np.array([column]), one, one, np.array([log_prior]))

    names = [("first", "gyro_x"), ("second", "gyro_x")]
    score = np.array([[8.0], [6.0]])  # products of the data with two unit columns
    apart = Oracle([point("first", 0), point("second", 1)], names, np.zeros(2), 8.0)
    said = apart.by_name(score)[:, 0]
    # two directions of one line, of which the data take the nearer: 8 (8 - 6) nats between them
    assert said[0] - said[1] == pytest.approx(16.0, abs=1e-6)
    alike = Oracle([point("first", 0), point("second", 0)], names, np.log([0.2, 0.8]), 8.0)
    said = alike.by_name(score)[:, 0]
    assert said[1] - said[0] == pytest.approx(np.log(4.0))


def test_other_forms_are_planted_by_name_only_and_answered_by_the_catalogue():
    assert not FORMS.keys() & EFFECTS.keys()
    everything = frozenset({"taxi", "gnss", "odometer", "runs"})
    assert not {e.name for e in possible(everything)} & FORMS.keys()
    names = {e.name for e in catalogue()}
    for name in FORMS:
        effect = effect_named(name)
        assert {*effect.right_answers, *effect.confounded} <= names
