"""What `recal plan --flights` promises against what an update of such a flight states, and against
what is known of turns.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from infield.session.points import observability
from ins.records import AXES, InputError, Site
from ins.twin_file import default_twin
from ins.units import DEG
from simreal.plan.flights import FLIGHTS, FlightPlan, best_flight, flown, plan_flights, promise

SITE = Site(lat_rad=45.0 * DEG, lon_rad=0.0, height_m=0.0)
TWIN = default_twin("rlg")
# of a promised sigma: noise moves what an update states of itself by the fixes that it rejects and
# by the parked vehicle's level that it finds
NOISE_SHARE = 0.1
SHORT = FlightPlan(name="test", words="a short flight", cruise_s=600.0, turns_deg=(180.0, 180.0))


@lru_cache(maxsize=2)
def promised(flight=SHORT):
    return promise(flight, TWIN, None, SITE, 0)


def test_an_update_of_the_flight_states_what_was_promised():
    """Another unit, other noise: the same sigmas, and the errors of the table lie within them."""
    told = promised()
    result, table, _ = flown(SHORT, TWIN, None, SITE, 1)
    evidence = result.flight
    estimate = evidence.as_usual or evidence.joined
    seen = observability(estimate, hold_heading=True, flown=True)
    for one, other in zip(told.gyros, seen):
        share = other.sigma_after_deg_h / one.sigma_after_deg_h
        assert share == pytest.approx(1.0, abs=NOISE_SHARE), one.axis
        assert one.verdict is other.verdict
    after = estimate.merged_into(table).candidate
    for node in told.nodes:
        stated = after.sigma_deg_h(AXES.index(node.axis), node.temperature_degC)
        assert stated == pytest.approx(node.after_deg_h, rel=NOISE_SHARE)
        assert node.after_deg_h <= node.before_deg_h


def test_a_cold_flight_reaches_the_cold_nodes_and_a_study_names_the_best():
    told = promised()
    assert told.from_degC < 0.0 < 20.0 < told.to_degC
    cold = [n for n in told.nodes if n.temperature_degC == -10.0]
    assert all(n.after_deg_h < 0.7 * n.before_deg_h for n in cold)
    worse = [replace(m, sigma_after_deg_h=2.0 * m.sigma_after_deg_h) for m in told.gyros]
    other = replace(told, gyros=tuple(worse))
    assert [best_flight((other, told), axis) for axis in AXES] == [told] * 3


def test_turns_stand_where_their_names_say():
    for flight in FLIGHTS:
        turns = [s.angle_deg for s in flight.segments if type(s).__name__ == "TurnFlight"]
        assert tuple(turns) == flight.turns_deg
        cruises = [s.duration_s for s in flight.segments if type(s).__name__ == "Cruise"]
        assert np.max(cruises) == flight.cruise_s


def test_units_without_a_heading_are_refused():
    with pytest.raises(InputError, match="rlg, fog"):
        plan_flights(default_twin("mems"), None, SITE, 0)
