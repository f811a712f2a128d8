"""Motion and phases of simulated runs against what the simulator did."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from alignment.motion import level, stillness
from alignment.motion.kinds import AIRBORNE, DISTURBED, ROLLING, STILL
from ins.records import Phase
from ins.units import ARCSEC
from tests.alignment.parked import ideal_of, parked_history, simulate
from tests.scenarios.study import DEFAULT_TWIN
from trajectories.simulator.scenario import read_scenario, simulate_scenario
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Park,
    Pivot,
    Stop,
    Straight,
    TakeOff,
    Turn,
)
from trajectories.simulator.vehicle import Boarding, Bump, Gust, Push

QUARTER_HOUR = (Park(duration_s=900.0),)
EDGE_S = 3.0  # epochs of a second, and starts that creep away
TAXI = (
    Park(duration_s=900.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=100.0),
    Stop(duration_s=60.0),
    Turn(angle_deg=-90.0),
    Straight(duration_s=60.0),
    Stop(duration_s=40.0),
)


def motion_of(segments=QUARTER_HOUR, seed=1, twin=DEFAULT_TWIN, phases=(), **options):
    run = simulate(ideal_of(segments), seed, twin=twin, **options).run
    return stillness.classify(parked_history(run), phases, run.imu)


def during(motion, start_s, end_s):
    return motion.kind[(motion.time_s > start_s) & (motion.time_s <= end_s)]


@pytest.mark.parametrize("seed", range(5))
def test_a_quiet_park_is_still_throughout(seed):
    motion = motion_of(seed=seed)
    assert motion.seconds(STILL) >= 0.99 * 900.0
    assert not motion.jolt_rad.any()


def test_velocity_noise_is_that_of_the_sway():
    """Samples of a 1 mm/s sway a second apart are nearly independent; the coarse solution's drift
    does not count.
    """
    assert 0.5e-3 < motion_of().sigma_v_m_s < 2e-3


@pytest.mark.parametrize("seed", range(4))
def test_sway_of_20_mm_s_loses_at_most_a_hundredth(seed):
    """A threshold in m/s alone would throw most of it away."""
    swaying = replace(DEFAULT_TWIN, vehicle=replace(DEFAULT_TWIN.vehicle, sway_m_s=0.02))
    motion = motion_of(seed=seed, twin=swaying)
    assert motion.seconds(STILL) >= 0.99 * 900.0
    assert motion.sigma_v_m_s == pytest.approx(0.02, rel=0.4)


@pytest.mark.parametrize("sway_m_s", [0.03, 0.05, 0.1])
@pytest.mark.parametrize("seed", range(3))
def test_a_gust_is_left_out_with_its_guard(seed, sway_m_s):
    motion = motion_of(seed=seed, events=[Gust(time_s=400.0, duration_s=60.0, sway_m_s=sway_m_s)])
    # fades in over 6 s; guard 30 s behind
    assert np.mean(during(motion, 408.0, 482.0) == DISTURBED) > 0.99
    assert motion.seconds(ROLLING) == 0.0
    quiet = np.concatenate([during(motion, 0.0, 399.0), during(motion, 500.0, 900.0)])
    assert np.mean(quiet == STILL) > 0.99


def test_a_bump_that_is_gone_within_an_epoch_is_seen_in_the_raw_rows():
    """0.1 m/s to and fro in half a second: nothing is left of it in the velocity at the end."""
    bump = Bump(time_s=450.2, velocity_m_s=0.1, duration_s=0.5, direction_deg=60.0)
    run = simulate(ideal_of(QUARTER_HOUR), 1, events=[bump]).run
    assert (stillness.classify(parked_history(run)).kind == STILL).all()
    motion = stillness.classify(parked_history(run), imu=run.imu)
    assert (during(motion, 450.0, 480.0) == DISTURBED).all()
    (span,) = motion.excluded()
    assert span.reason == "bump" and span.start_s <= 450.2 and 480.7 <= span.end_s <= 490.0


@pytest.mark.parametrize(
    ("change", "found"),
    [({"roll_arcsec": 8.0}, True), ({"sink_mm": 20.0}, True), ({"roll_arcsec": 1.0}, False)],
)
def test_loading_is_left_out_and_listed(change, found):
    motion = motion_of(events=[Boarding(time_s=300.0, **change)])
    assert (during(motion, 300.0, 330.0) == DISTURBED).all() == found
    assert {s.reason for s in motion.excluded()} == (
        {"bump" if "sink_mm" in change else "loading"} if found else set()
    )


@pytest.mark.parametrize(
    ("distance_m", "speed_m_s", "turn_deg"),
    [(0.5, 0.2, 0.0), (-3.0, 0.1, 0.0), (8.0, 0.4, 1.0), (5.0, 0.6, -0.3)],
)
def test_a_tug_push_is_left_out_and_gives_a_new_parked_heading(distance_m, speed_m_s, turn_deg):
    push = Push(time_s=400.0, distance_m=distance_m, speed_m_s=speed_m_s, turn_deg=turn_deg)
    motion = motion_of(events=[push])
    end = 400.0 + push.duration_s
    assert (during(motion, 401.0, end + 30.0) == DISTURBED).all()
    assert motion.seconds(ROLLING) == 0.0
    assert {s.reason for s in motion.excluded()} >= {"tug push"}
    assert motion.jolt_rad[(motion.time_s > 400.0) & (motion.time_s < end + 10.0)].max() > 1e-3
    assert (during(motion, end + 45.0, 900.0) == STILL).all()


@pytest.mark.parametrize("arcsec", [4.0, 8.0, 30.0])
def test_boarding_shows_as_a_jolt_of_its_size(arcsec):
    motion = motion_of(
        events=[Boarding(time_s=300.0, roll_arcsec=20.0, pitch_arcsec=-15.0, heading_arcsec=arcsec)]
    )
    jolts = motion.jolt_rad[(motion.time_s >= 300.0) & (motion.time_s < 304.0)]
    assert np.sqrt(np.sum(jolts**2)) / ARCSEC == pytest.approx(arcsec, rel=0.35)
    assert not motion.jolt_rad[motion.time_s > 304.0].any()


def test_taxi_with_stops():
    ideal = ideal_of(TAXI)
    motion = motion_of(TAXI)
    rest = ideal.truth.motion.rest
    for (_, start_s), (end_s, _) in pairwise(rest):
        assert (during(motion, start_s + EDGE_S, end_s - EDGE_S) == ROLLING).all()
    for start_s, end_s in rest:
        assert np.mean(during(motion, start_s + EDGE_S, end_s - EDGE_S) == STILL) > 0.99
    moving_s = sum(b - a for (_, a), (b, _) in pairwise(rest))
    assert motion.seconds(ROLLING) == pytest.approx(moving_s, abs=10.0)


def test_a_slow_tow_rolls_and_a_pivot_turns():
    """0.5 m/s behind a tug; then 30 deg on the spot in 60 s, which moves the wheels nowhere."""
    segments = (
        Park(duration_s=600.0),
        Straight(duration_s=60.0, speed_m_s=0.5, acceleration_m_s2=0.1),
        Stop(duration_s=30.0),
        Pivot(angle_deg=30.0),
        Park(duration_s=200.0),
    )
    motion = motion_of(segments)
    (_, left), (stopped, again), (back, _) = ideal_of(segments).truth.motion.rest
    assert (during(motion, left + 5.0, stopped - EDGE_S) == ROLLING).all()
    # the slow beginning and end, below the rate that makes a pivot, belong to it
    assert (during(motion, again + 1.5, back - 1.5) == ROLLING).all()
    assert np.mean(during(motion, back + EDGE_S, 950.0) == STILL) > 0.99


def test_take_off_and_what_follows_is_airborne():
    flying = (*TAXI[:3], TakeOff(), Climb(height_m=300.0), Cruise(duration_s=60.0))
    motion = motion_of(flying)
    lift_off = next(p.start_s for p in ideal_of(flying).truth.motion.phases if p.phase == "flight")
    assert (motion.kind[motion.time_s > lift_off] == AIRBORNE).all()
    assert (during(motion, 905.0, 1000.0) == ROLLING).all()


def test_a_phase_that_says_parked_is_not_believed_and_one_that_says_flight_is():
    wrong = (
        Phase(phase="parked", start_s=0.0, end_s=2000.0),
        Phase(phase="flight", start_s=1200.0, end_s=2000.0),
    )
    motion = motion_of(TAXI, phases=wrong)
    assert (during(motion, 910.0, 1050.0) == ROLLING).all()
    assert (during(motion, 1200.0, 2000.0) == AIRBORNE).all()


@pytest.mark.parametrize(
    ("name", "phases"),
    [
        ("cold_parked_taxi", ("alignment", "extended_alignment", "taxi")),
        ("flight", ("alignment", "extended_alignment", "taxi", "flight")),
    ],
)
def test_phases_of_the_shipped_scenarios(name, phases):
    """Found from the motion alone; `flight` begins where the take-off run passes 35 m/s, and so
    within `takeoff`.
    """
    scenario = read_scenario(name)
    simulated, _ = simulate_scenario(replace(scenario, imu=replace(scenario.imu, rate_hz=10.0)))
    true: dict[str, float] = {}
    for p in simulated.run.phases:
        true.setdefault(p.phase, p.start_s)
    found = {
        p.phase: p
        for p in stillness.detect_phases(stillness.classify(parked_history(simulated.run)))
    }
    for phase in ("alignment", "extended_alignment", "taxi"):
        assert found[phase].start_s == pytest.approx(true[phase], abs=4.0)
    if "flight" in phases:
        assert true["takeoff"] < found["flight"].start_s < true["flight"]
    assert set(phases) <= set(found)


def test_spans_and_seconds_by_hand():
    motion = stillness.Motion(
        time_s=np.arange(6.0),
        kind=np.array([STILL, STILL, DISTURBED, DISTURBED, STILL, ROLLING]),
        jolt_rad=np.zeros(6),
        sigma_v_m_s=1e-3,
    )
    (span,) = motion.spans(DISTURBED, "motion")
    assert (span.start_s, span.end_s, span.reason) == (1.0, 3.0, "motion")
    assert motion.seconds(STILL) == 2.0
    assert motion.seconds(ROLLING) == 1.0


def test_position_jitter_of_the_sway():
    """Sway velocity s at 0.28 Hz: position s / (2 pi 0.28), less what a cubic over 20 s takes;
    gusts left out.
    """
    history = parked_history(simulate(ideal_of(QUARTER_HOUR), 3).run)
    motion = stillness.classify(history)
    expected = 1e-3 / (2 * np.pi * 0.28)
    assert level.sway_position_sigma(history, motion) == pytest.approx(expected, rel=0.35)
    moved = replace(motion, kind=np.full(len(motion.kind), ROLLING))
    assert level.sway_position_sigma(history, moved) == 0.0


def test_yaw_jitter_is_zero_without_and_found_with_it():
    history = parked_history(simulate(ideal_of(QUARTER_HOUR), 3).run)
    motion = stillness.classify(history)
    assert level.yaw_jitter_sigma(history, motion) < 0.3 * ARCSEC
    jitter = 2 * ARCSEC * np.random.default_rng(1).standard_normal(len(history.time_s))
    shaken = history.dtheta_b_rad.copy()
    shaken[1:, 2] += np.diff(jitter)
    found = level.yaw_jitter_sigma(replace(history, dtheta_b_rad=shaken), motion)
    assert found == pytest.approx(2 * ARCSEC, rel=0.15)
