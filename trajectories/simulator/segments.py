"""The segments that a motion is made of; `motions.lay` puts them end to end. Angles are right
positive.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Park:
    """At rest. The first one of a run is its alignment and extended alignment."""

    duration_s: float


@dataclass(frozen=True, kw_only=True)
class Straight:
    """A straight taxi leg, reaching its speed at the stated peak acceleration; the duration
    includes that.
    """

    duration_s: float
    speed_m_s: float = 9.5
    acceleration_m_s2: float = 0.6


@dataclass(frozen=True, kw_only=True)
class Turn:
    """A turn on wheels, right positive, at a peak rate of speed / radius; the speed is reached
    before it, straight.
    """

    angle_deg: float
    radius_m: float = 25.0
    speed_m_s: float = 4.0
    acceleration_m_s2: float = 0.6


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Brakes, then stands for `duration_s` (still part of the taxi)."""

    duration_s: float
    deceleration_m_s2: float = 0.6


@dataclass(frozen=True, kw_only=True)
class Pivot:
    """Turns about the reference point without rolling, as a tug does; right positive."""

    angle_deg: float
    duration_s: float = 60.0


@dataclass(frozen=True, kw_only=True)
class TakeOff:
    """Runs to the lift-off speed; the wheels leave the ground over the last seconds."""

    lift_off_speed_m_s: float = 75.0
    acceleration_m_s2: float = 2.5


@dataclass(frozen=True, kw_only=True)
class Climb:
    """Climbs, straight ahead, to a height above the field while reaching a speed."""

    height_m: float
    rate_m_s: float = 10.0
    speed_m_s: float = 150.0


@dataclass(frozen=True, kw_only=True)
class Cruise:
    """Level and straight; the duration includes reaching the speed."""

    duration_s: float
    speed_m_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class TurnFlight:
    """A coordinated level turn, right positive, at a bank."""

    angle_deg: float
    bank_deg: float = 20.0


@dataclass(frozen=True, kw_only=True)
class Descend:
    """Descends, straight ahead, to a height above the field while reaching a speed."""

    height_m: float
    rate_m_s: float = 8.0
    speed_m_s: float = 90.0


@dataclass(frozen=True, kw_only=True)
class Landing:
    """Descends to the field, touches down, brakes to taxi speed."""

    sink_rate_m_s: float = 3.0
    touchdown_speed_m_s: float = 65.0
    deceleration_m_s2: float = 2.0
    taxi_speed_m_s: float = 9.5


Segment = (
    Park
    | Straight
    | Turn
    | Stop
    | Pivot
    | TakeOff
    | Climb
    | Cruise
    | TurnFlight
    | Descend
    | Landing
)
SEGMENTS: dict[str, type] = {
    "park": Park,
    "straight": Straight,
    "taxi": Straight,
    "turn": Turn,
    "stop": Stop,
    "pivot": Pivot,
    "tow": Pivot,
    "take_off": TakeOff,
    "climb": Climb,
    "cruise": Cruise,
    "turn_flight": TurnFlight,
    "descend": Descend,
    "landing": Landing,
}
