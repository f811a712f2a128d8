"""Witnesses of motion, each alone and joined by one rule (issue 14, point 2)."""

from dataclasses import replace

import numpy as np
import pytest

from alignment.motion.excursions import find_excursions, velocity_noise
from alignment.motion.imu_faults import repair
from alignment.motion.inertial import first_rest
from alignment.motion.kinds import (
    AIRBORNE,
    DISTURBED,
    ROLLING,
    STILL,
    UNKNOWN,
    Disturbance,
    Says,
    Witness,
    WitnessEvidence,
)
from alignment.motion.seconds import seconds_of
from alignment.motion.speeds import gnss_evidence, steady_roll, watched_seconds, wheel_evidence
from alignment.motion.stillness import Motion
from alignment.motion.timeline import joined_kinds, phase_evidence, without_dead
from ins.records import GnssLog, ImuLog, OdometerLog, Phase
from tests.frozen import motion_runs as runs
from trajectories.simulator.vehicle import Gust

T = np.arange(1.0, 201.0)
STANDS, MOVES, SILENT = Says.STANDS, Says.MOVES, Says.SILENT


def receiver(speed_m_s, sigma_m_s=None):
    v = np.zeros((T.size, 3))
    v[:, 0] = speed_m_s
    place = np.full(T.size, 0.5)
    return GnssLog(
        time_s=T,
        lat_rad=place,
        lon_rad=place,
        height_m=np.zeros(T.size),
        v_n_m_s=v,
        sigma_velocity_m_s=None if sigma_m_s is None else np.full(T.size, sigma_m_s),
    )


def of(start_s, end_s, value):
    return np.where((start_s < T) & (end_s >= T), value, 0.0)


@pytest.mark.parametrize(
    ("speed", "sigma", "said"),
    [
        (of(50.0, 71.0, 6.0), None, MOVES),
        (of(50.0, 60.0, 6.0), None, SILENT),  # too short for one witness against the sensors
        (of(50.0, 120.0, 0.4), None, STANDS),
        (of(50.0, 120.0, 1.5), 0.5, STANDS),  # within its declared noise
        (of(50.0, 120.0, 6.0), 5.0, MOVES),  # a receiver that declares anything is not believed
    ],
)
def test_a_receiver_moves_what_it_sees_move_for_long(speed, sigma, said):
    heard = gnss_evidence(receiver(speed, sigma), T)
    assert heard.says[55] == said and heard.says[10] == STANDS
    assert heard.strength[55] == heard.seen[55] / heard.allowed


def test_positions_alone_are_heard_and_gaps_are_silent():
    way_rad = np.cumsum(of(50.0, 120.0, 6.0)) / 6.37e6
    still = receiver(0.0)
    rolls = replace(
        still, lat_rad=still.lat_rad + way_rad, v_n_m_s=np.full_like(still.v_n_m_s, np.nan)
    )
    heard = gnss_evidence(rolls, T)
    assert (heard.says[65:105] == MOVES).all() and (heard.says[:35] == STANDS).all()
    kept = (T <= 80.0) | (T > 100.0)
    gap = OdometerLog(time_s=T[kept], speed_m_s=np.zeros(kept.sum()))
    wheels = wheel_evidence(gap, T)
    assert (wheels.says[87:93] == SILENT).all() and np.isnan(wheels.seen[90])
    assert wheels.says[60] == STANDS
    assert (wheel_evidence(None, T).says == SILENT).all()


def navigated(kind):
    return Motion(
        time_s=T,
        kind=np.asarray(kind),
        jolt_rad=np.zeros(T.size),
        sigma_v_m_s=1e-3,
        cause=np.full(T.size, "", dtype=object),
    )


def test_wheels_that_read_zero_on_the_way_are_dead():
    kind = np.where((T > 50.0) & (T <= 80.0), ROLLING, STILL)
    nothing = wheel_evidence(OdometerLog(time_s=T, speed_m_s=np.zeros(T.size)), T)
    assert (without_dead(nothing, T, navigated(kind)).says == SILENT).all()
    short = np.where((T > 50.0) & (T <= 60.0), ROLLING, STILL)
    assert (without_dead(nothing, T, navigated(short)).says == STANDS).all()


def test_phases_add_the_air_and_stand_for_nobody():
    phases = (
        Phase(phase="parked", start_s=0.0, end_s=100.0),
        Phase(phase="flight", start_s=100.0, end_s=150.0),
    )
    said = phase_evidence(phases, T).says
    assert said[50] == STANDS and said[120] == MOVES and said[180] == SILENT


# kind by navigation, its speed, then words of navigation, rows, receiver, wheels, phases
RULE = [
    (STILL, 0.0, (STANDS, STANDS, SILENT, SILENT, SILENT), STILL),
    (STILL, 0.0, (STANDS, STANDS, MOVES, SILENT, SILENT), ROLLING),  # a steady roll
    (STILL, 0.0, (STANDS, STANDS, STANDS, MOVES, STANDS), ROLLING),
    (DISTURBED, 0.0, (STANDS, SILENT, STANDS, STANDS, SILENT), DISTURBED),
    (ROLLING, 0.4, (MOVES, STANDS, STANDS, SILENT, SILENT), ROLLING),  # a slow tow
    (ROLLING, 2.0, (MOVES, STANDS, STANDS, SILENT, SILENT), STILL),  # drift: it would be seen
    (ROLLING, 2.0, (MOVES, SILENT, STANDS, SILENT, SILENT), ROLLING),
    (ROLLING, 2.0, (MOVES, STANDS, SILENT, SILENT, STANDS), ROLLING),  # a wrong parked phase
    (ROLLING, 9.5, (MOVES, STANDS, STANDS, SILENT, SILENT), ROLLING),
    (AIRBORNE, 1.0, (SILENT, STANDS, SILENT, SILENT, SILENT), STILL),  # landed
    (AIRBORNE, 1.0, (SILENT, STANDS, MOVES, SILENT, SILENT), ROLLING),
    (AIRBORNE, 1.0, (SILENT, SILENT, STANDS, SILENT, SILENT), DISTURBED),
    (AIRBORNE, 1.0, (SILENT, SILENT, SILENT, SILENT, SILENT), UNKNOWN),
    (AIRBORNE, 90.0, (MOVES, STANDS, SILENT, SILENT, SILENT), AIRBORNE),
    (STILL, 0.0, (STANDS, STANDS, SILENT, SILENT, MOVES), AIRBORNE),
]


@pytest.mark.parametrize(("kind", "speed", "words", "found"), RULE)
def test_the_rule(kind, speed, words, found):
    seen = np.array([speed, 0.0, 0.0, 0.0, np.nan])
    allowed = (0.25, 0.02, 0.5, 0.5, 1.0)
    evidence = {
        witness: WitnessEvidence(witness, np.full(T.size, said), np.full(T.size, s), limit)
        for witness, said, s, limit in zip(
            (Witness.NAVIGATION, Witness.ROWS, Witness.GNSS, Witness.WHEELS, Witness.PHASES),
            words,
            seen,
            allowed,
        )
    }
    kinds = joined_kinds(None, T, np.full(T.size, kind), evidence, np.ones(T.size, bool))
    assert (kinds == found).all()


def test_stands_parked_time_and_words_of_a_motion():
    kind = np.full(T.size, STILL)
    kind[40:60], kind[65:100], kind[120:130] = ROLLING, UNKNOWN, DISTURBED
    motion = navigated(kind)
    assert motion.parked_until_s == 40.0
    spans = [(s.start_s, s.end_s) for s in motion.stands(8)]
    assert spans == [(1.0, 40.0), (101.0, 200.0)]
    assert [s.start_s for s in motion.stands(3, after_s=50.0, where=T < 110.0)] == [61.0, 101.0]
    assert navigated(np.full(T.size, STILL)).parked_until_s == 200.0


def test_a_steady_roll_is_no_rest_where_a_receiver_or_wheels_see_it():
    run = next(n for n in runs.SIMULATED if n.name == "never at rest").make().run
    assert first_rest(seconds_of(run.imu)) is not None  # the rows alone are taken in
    for seen in (replace(run, odometer=None), replace(run, gnss=None)):
        assert first_rest(watched_seconds(seen)) is None
        assert steady_roll(seen).values["fastest_m_s"] == pytest.approx(6.0, abs=0.3)
    blind = replace(run, odometer=None, gnss=None)
    assert first_rest(watched_seconds(blind)) is not None and steady_roll(blind) is None


# Drift and start of a solution's velocity ---------------------------------------------------------


def excursions_of(speed_m_s, seed=1):
    v = np.random.default_rng(seed).normal(0.0, 1e-3, (T.size, 2))
    v[:, 0] += speed_m_s
    return find_excursions(T, v, velocity_noise(v))[0]


@pytest.mark.parametrize("slope", [1e-3, 3e-3, -4.5e-3])
@pytest.mark.parametrize("from_s", [0.0, 15.0, 100.0])
def test_a_velocity_that_runs_off_along_a_gentle_line_is_drift(slope, from_s):
    """3 mm/s^2 for 200 s is 0.6 m/s: no vehicle starts so gently for so long."""
    kind = excursions_of(slope * np.maximum(T - from_s, 0.0))
    assert (kind <= DISTURBED).all()


@pytest.mark.parametrize("acceleration", [0.02, 0.1, 1.0])
def test_a_vehicle_that_leaves_accelerates(acceleration):
    speed = np.clip(acceleration * (T - 100.0), 0.0, 0.5)
    kind = excursions_of(speed)
    assert (kind[:95] == STILL).all() and (kind[110:] == ROLLING).all()


def test_a_solution_that_leaves_at_once_knows_where_it_stood():
    """0.5 m/s from its second epoch on, then a stop: the mean of the first epochs is no rest."""
    kind = excursions_of(np.where((T > 2.0) & (T <= 100.0), 0.5, 0.0))
    assert (kind[5:98] == ROLLING).all() and (kind[106:] <= DISTURBED).all()


@pytest.mark.parametrize("seed", range(3))
def test_rows_lost_in_a_gust_do_not_end_the_parked_time(seed):
    gust = Gust(time_s=400.0, duration_s=40.0, sway_m_s=0.06)
    case = runs.simulated(100 * seed + 13, runs.TAXI, events=[gust])
    run = runs.changed(case, lambda run: runs.without_rows(run, 420.15, 420.85)).run
    (fault,) = repair(run.imu, seconds_of(run.imu), 0.0, run.imu.end_s)[1]
    assert fault.reason == Disturbance.DROPOUT and fault.start_s < 420.0 < fault.end_s < 460.0


def test_rows_lost_on_the_way_are_no_repair_of_a_taxi():
    run = runs.simulated(13, runs.TAXI).run
    lost = runs.without_rows(run, 602.15, 602.85)
    assert repair(lost.imu, seconds_of(lost.imu), 0.0, lost.imu.end_s)[1] == ()


@pytest.mark.parametrize("seconds", [1, 9, 15, 49])
def test_less_than_a_minute_is_no_rest(seconds):
    """However little there is to take a median of."""
    rows = 10 * seconds
    rest = np.tile([0.0, 0.0, -0.981], (rows, 1))
    log = ImuLog(
        time_s=0.1 * np.arange(1, rows + 1),
        dt_s=np.full(rows, 0.1),
        dtheta_rad=np.zeros((rows, 3)),
        dv_m_s=rest,
    )
    assert first_rest(seconds_of(log)) is None
