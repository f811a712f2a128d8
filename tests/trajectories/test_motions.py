"""Motions: profiles are smooth, turn and climb by what is asked, and refuse what cannot follow."""

import numpy as np
import pytest

from ins.records import InputError
from ins.units import DEG
from tests.reference_motions import REFERENCE_MOTIONS, reference_motion
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Descend,
    Landing,
    Park,
    Stop,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)

FLIGHT = [
    Park(duration_s=30.0),
    Turn(angle_deg=-90.0),
    TakeOff(),
    Climb(height_m=1000.0),
    TurnFlight(angle_deg=200.0),
    Cruise(duration_s=60.0, speed_m_s=180.0),
    Descend(height_m=300.0),
    Landing(),
    Stop(duration_s=5.0),
    Park(duration_s=30.0),
]


@pytest.mark.parametrize(
    "channel", ["speed_m_s", "course_rate_rad_s", "climb_rate_m_s", "airborne"]
)
def test_value_rate_and_acceleration_join_at_every_break(channel):
    profile = getattr(lay(FLIGHT), channel)
    for derivative in range(3):
        curve = profile.derivative(derivative) if derivative else profile
        inner = profile.x[1:-1]
        before, after = curve(inner - 1e-7), curve(inner + 1e-7)
        scale = np.max(np.abs(curve(np.linspace(0, profile.x[-1], 5000)))) + 1e-9
        np.testing.assert_allclose(before, after, atol=1e-5 * scale)


def test_flight_returns_to_the_field_and_turns_by_the_sum_of_its_turns():
    motion = lay(FLIGHT)
    t = np.linspace(0, motion.end_s, 400_001)
    height = np.sum(motion.climb_rate_m_s(t)) * (t[1] - t[0])
    assert abs(height) < 0.01
    assert motion.course_rad(motion.end_s) == pytest.approx(110 * DEG, abs=1e-12)
    assert np.max(motion.speed_m_s(t)) == pytest.approx(180.0)
    assert motion.speed_m_s(motion.end_s) == 0 and motion.airborne(motion.end_s) == 0


def test_turn_keeps_its_radius_and_acceleration_its_limit():
    motion = lay(
        [
            Turn(angle_deg=180.0, radius_m=30.0, speed_m_s=5.0, acceleration_m_s2=0.4),
            Stop(duration_s=1.0),
        ]
    )
    t = np.linspace(0, motion.end_s, 20_001)
    assert np.max(motion.course_rate_rad_s(t)) == pytest.approx(5.0 / 30.0)
    # the stop's default
    assert np.max(np.abs(motion.speed_m_s.derivative()(t))) == pytest.approx(0.6, rel=1e-4)
    assert np.max(motion.speed_m_s.derivative()(t)) == pytest.approx(0.4, rel=1e-4)


def test_phases_cover_the_run_without_holes():
    motion = lay(FLIGHT, alignment_s=10.0)
    names = [p.phase for p in motion.phases]
    assert names == [
        "alignment",
        "extended_alignment",
        "taxi",
        "takeoff",
        "flight",
        "landing",
        "taxi",
        "parked",
    ]
    assert motion.phases[0].end_s == 10.0 and motion.phases[-1].end_s == motion.end_s
    assert all(a.end_s == b.start_s for a, b in zip(motion.phases, motion.phases[1:]))


@pytest.mark.parametrize(
    ("segments", "word"),
    [
        ([], "no segments"),
        ([Straight(duration_s=10.0), Park(duration_s=5.0)], "still rolling"),
        ([Cruise(duration_s=5.0)], "on the ground"),
        ([TakeOff(), Straight(duration_s=10.0)], "in the air"),
        ([Park(duration_s=-1.0)], "duration_s = -1.0, needed more than 0"),
        ([Park(duration_s=float("nan"))], "finite"),
        ([Straight(duration_s=5.0, speed_m_s=0.0)], "speed_m_s = 0.0"),
    ],
)
def test_impossible_motions_are_refused_by_name(segments, word):
    with pytest.raises(InputError, match=word):
        lay(segments)


@pytest.mark.parametrize("name", REFERENCE_MOTIONS)
def test_reference_motions_park_70_minutes_with_10_of_alignment(name):
    heading_rad, motion = reference_motion(name)
    assert motion.phases[0].end_s == 600.0 and motion.phases[1].end_s == 4200.0
    assert motion.rest[0] == (0.0, 4200.0) and -np.pi <= heading_rad <= np.pi


def test_realistic_taxi_is_that_of_the_requirements():
    """Legs after turns of +90, +90, -90 deg, 120 s each at 9-10 m/s, stops of 60, 120 and 60 s
    after them.
    """
    _, motion = reference_motion("realistic_taxi")
    stops = [(a, b) for a, b in motion.rest if a > 4200.0]
    np.testing.assert_allclose([b - a for a, b in stops], [60.0, 120.0, 60.0])
    headings = [float(motion.course_rad(a)) / DEG for a, _ in stops]
    np.testing.assert_allclose(headings, [90.0, 180.0, 90.0], atol=1e-9)
    speed = motion.speed_m_s(np.linspace(0, motion.end_s, 50_001))
    assert 9.0 <= speed.max() <= 10.0
