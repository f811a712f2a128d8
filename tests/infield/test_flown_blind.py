"""Flights whose truth no package of the project made (`benchmarks.blind_flights`)."""

from functools import lru_cache

import numpy as np
import pytest

from alignment.motion.kinds import ROLLING
from alignment.motion.stillness import Motion
from alignment.navigation_filter import filter_steps, plan_steps, views_of
from benchmarks import blind_flights as blind
from infield.session.flown.flight import OF_POSITION, OF_VELOCITY, receiver_states
from infield.session.flown.gates import deflected
from infield.session.flown.priors import Further
from infield.session.navigated.receiver import FixAid, Sigmas
from infield.session.one_run import take_run
from infield.session.reasons import FlightReason
from infield.session.settings import FlightPriors, SessionSettings
from ins.estimation.measurements.antenna import Antenna, RowSums
from ins.estimation.tape import Tape
from ins.records import GnssLog, ImuLog, NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.twin_file import default_twin
from ins.units import ARCSEC
from recal.service.inputs.records import read_table
from recal.service.look.own_runs import read_run
from tests.infield.flown_cases import layout_of

ARM_M = np.array([1.5, -0.5, -2.5])
LATE_S = 0.04
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


def of_solution(time_s, error, at_s):
    """A solution's own errors (n, 2) at other times (2, m)."""
    return np.stack([np.interp(at_s, time_s, column) for column in error.T])


def test_the_generator_and_the_mechanization_agree():
    _, history = solution()
    true = truth().at(history.time_s)
    north_m = 6.37e6 * (history.lat_rad - true.lat)
    # the normal field's own slope at height, which the mechanization leaves out: 0.8 micro-g a km
    slope_m = 0.5 * 0.8e-6 * 9.8 * 9.0 * (UNTIL_S - FROM_S) ** 2
    assert np.abs(north_m).max() < 1.5 * slope_m
    assert np.abs(history.v_n_m_s[:, 1] - true.v_n[:, 1]).max() < 1e-3
    assert np.abs(history.C_nb - true.C_nb).max() < 1e-6


def test_a_turning_antenna_is_where_and_as_fast_as_the_rows_say():
    """Perfect late fixes of an antenna 3 m away in turbulence: what the filter is shown is nothing
    but the solution's own error.
    """
    log, history = solution()
    stamps = np.arange(FROM_S + 2.0, UNTIL_S - 1.0)
    r_e, v_n = truth().at(stamps - LATE_S).antenna(ARM_M)
    lat, lon, height = blind.geodetic(r_e)
    fixes = GnssLog(time_s=stamps, lat_rad=lat, lon_rad=lon, height_m=height, v_n_m_s=v_n)
    moving = Motion(
        history.time_s,
        np.full(history.time_s.size, int(ROLLING)),
        np.zeros(history.time_s.size),
        1e-3,
    )
    plan = plan_steps(moving, np.array([FROM_S, UNTIL_S]))
    views = views_of(history, plan)
    tape = Tape(filter_steps(views))
    antenna = Antenna(ARM_M, LATE_S, LATE_S)
    FixAid(
        log=fixes,
        sigmas=Sigmas(0.5, 0.03),
        antenna=antenna,
        states=receiver_states(layout_of()),
        history=history,
        rows=RowSums(log),
        names=(OF_POSITION, OF_VELOCITY),
    ).measure(tape, views)
    done = tape.compiled()

    def shown(kind):
        rows = done.ops[done.name == done.names.index(kind), 2]
        return done.z[np.stack([rows, rows + 1])]

    # what is shown is about the stamps as they are: what the delay moves is in it
    measured_s = stamps - LATE_S
    sides = [truth().at(measured_s + side).antenna(ARM_M)[1] for side in (-0.05, 0.0, 0.05)]
    true = truth().at(history.time_s)
    own_m = np.column_stack(
        [
            6.37e6 * (history.lat_rad - true.lat),
            6.38e6 * np.cos(true.lat) * (history.lon_rad - true.lon),
        ]
    )
    place = shown(OF_POSITION) - of_solution(history.time_s, own_m, measured_s)
    assert np.abs(place - LATE_S * sides[1][:, :2].T).max() < 0.02
    own_m_s = (history.v_n_m_s - true.v_n)[:, :2]
    speed = shown(OF_VELOCITY) - of_solution(history.time_s, own_m_s, measured_s)
    speed -= LATE_S * ((sides[2] - sides[0]) / 0.1)[:, :2].T
    assert np.sqrt(np.mean(speed**2)) < 2e-4  # of 14e-3 that turning makes; 6e-3 with epochs' means


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
