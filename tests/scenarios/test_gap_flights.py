"""A flight diagnosed as a whole, with an effect of flight made row by row and without any."""

import pytest

from benchmarks.gap_flights import PLANTED, diagnosed, flights, trial
from simreal.effects.catalogue import catalogue


def test_every_planted_effect_of_flight_and_its_neighbours_are_in_the_catalogue():
    effects = {(e.name, target) for e in catalogue() for target in e.targets}
    names = {name for name, _ in effects}
    for planted in PLANTED:
        assert (planted.effect, planted.target) in effects
        assert set(planted.neighbours) <= names
    assert len({p.effect for p in PLANTED}) == len(PLANTED) >= 12


@pytest.mark.slow
def test_a_whole_diagnosis_names_an_effect_of_flight_and_nothing_in_a_flight_without_one():
    found, _ = diagnosed([f.run for f in flights(1)])
    assert found.verdict == "no_gap"
    outcome = trial("gyro_pressure_sensitivity", 1, 12.0)
    assert outcome["outcome"] == "right"
    assert outcome["reached"] == pytest.approx(12.0, rel=0.05)
