"""Flights whose truth no package of the project made (`benchmarks.blind_flights`)."""

from functools import lru_cache

import numpy as np
import pytest

from benchmarks import blind_flights as blind
from infield.session.flown.gates import deflected
from infield.session.flown.priors import Further
from infield.session.one_run import take_run
from infield.session.reasons import FlightReason
from infield.session.settings import FlightPriors, SessionSettings
from ins.records import ImuLog, NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.twin_file import default_twin
from ins.units import ARCSEC
from recal.service.inputs.records import read_table
from recal.service.look.own_runs import read_run

# 0.3, 0.2 and 0.1 deg RMS below 0.35 Hz move the antenna by 14 mm/s RMS in north and east
FROM_S, UNTIL_S = 3000.0, 3120.0


@lru_cache(maxsize=1)
def truth():
    rng = np.random.default_rng(5)
    return blind.motion_of(rng, 0, blind.World(deflection_arcsec=0.0, deflection_km=30.0))


@lru_cache(maxsize=1)
def solution():
    """The free solution of perfect rows over two minutes of a flight in turbulence."""
    time_s, turned, pushed = blind.increments(truth(), FROM_S, UNTIL_S)
    dt_s = np.full(time_s.size, 1.0 / blind.RATE_HZ)
    log = ImuLog(time_s=time_s, dt_s=dt_s, dtheta_rad=turned, dv_m_s=pushed)
    first = truth().at(np.array([FROM_S]))
    heights_s = np.arange(FROM_S, UNTIL_S)
    start = NavState(
        time_s=FROM_S,
        site=Site(lat_rad=first.lat[0], lon_rad=first.lon[0], height_m=first.height[0]),
        v_n_m_s=first.v_n[0],
        C_nb=first.C_nb[0],
    )
    held = VerticalChannel(mode="aided", time_s=heights_s, height_m=truth().at(heights_s).height)
    return log, navigate([log], start, vertical=held)


def test_the_generator_and_the_mechanization_agree():
    _, history = solution()
    true = truth().at(history.time_s)
    north_m = 6.37e6 * (history.lat_rad - true.lat)
    # the normal field's own slope at height, which the mechanization leaves out: 0.8 micro-g a km
    slope_m = 0.5 * 0.8e-6 * 9.8 * 9.0 * (UNTIL_S - FROM_S) ** 2
    assert np.abs(north_m).max() < 1.5 * slope_m
    assert np.abs(history.v_n_m_s[:, 1] - true.v_n[:, 1]).max() < 1e-3
    assert np.abs(history.C_nb - true.C_nb).max() < 1e-6


def test_a_deflection_that_was_given_is_named():
    assert deflected(FlightPriors()) == ()
    (note,) = deflected(FlightPriors(deflection_arcsec=12.0))
    assert note.values["arcsec"] == pytest.approx(12.0) and note.values["km"] == 30.0


@pytest.mark.slow  # 10 s: a flight and two updates of it
def test_the_vertical_over_mountains_is_found_and_blames_no_gyro(tmp_path):
    faults = blind.Faults(deflection_arcsec=30.0)
    made = blind.write_flight(tmp_path, 3, "rlg", faults)
    run, table = read_run(tmp_path), read_table(tmp_path / "table.json")
    twin = default_twin("rlg")
    flight = take_run(run, table, twin, SessionSettings(), False).flight
    assert flight.joined is not None and flight.reasons == ()
    note = next(n for n in flight.notes if n.code is FlightReason.DEFLECTED)
    assert 0.5 < note.values["arcsec"] / made.world.deflection_arcsec < 1.5
    of_vertical = next(c for c in flight.carried if c.state is Further.DEFLECTION)
    assert of_vertical.prior[0] == pytest.approx(note.values["arcsec"] * ARCSEC)
    # with 5 arcsec for certain the same flight is left out
    usual = FlightPriors(deflection_arcsec=5.0, deflection_km=30.0)
    flight = take_run(run, table, twin, SessionSettings(flight=usual), False).flight
    assert flight.joined is None and flight.reasons
