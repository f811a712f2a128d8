"""Named motions: segments laid end to end give speed, course, climb and lift-off as smooth
functions of time.

A profile is constant but for quintic blends (C2: value, rate and acceleration join), so a vehicle
at rest starts and stops with zero acceleration and zero jerk. Speed is that of the no-slip
reference point P along body x; the heading of body x is the course of P (crab and side noise are
added in `vehicle`). Height is above the start.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.interpolate import PPoly

from ins.records import InputError, Phase
from ins.units import DEG
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Descend,
    Landing,
    Park,
    Pivot,
    Segment,
    Stop,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)

PEAK = 15.0 / 8.0  # largest slope of the quintic blend 10 u^3 - 15 u^4 + 6 u^5 over its mean slope
TURN_BLEND_S = 3.0  # time over which a turn on wheels reaches its rate
FLIGHT_BLEND_S = 6.0  # the same for bank and climb
LIFT_OFF_S = 4.0  # wheels leave the ground over this time
# A shorter change than this is none: the fifth power of the time, 1e-30, divides it (_profile).
SHORTEST_BLEND_S = 1e-6
CHANNELS = ("speed_m_s", "course_rate_rad_s", "climb_rate_m_s", "airborne")


@dataclass(frozen=True, kw_only=True)
class SimulatedMotion:
    """A whole motion: profiles of time (PPoly), the spans at rest, and the phases by name.

    `course_rad` starts at 0 and is relative to the first heading; `climb_rate_m_s` is up.
    """

    end_s: float
    speed_m_s: PPoly
    course_rate_rad_s: PPoly
    course_rad: PPoly
    climb_rate_m_s: PPoly
    airborne: PPoly
    rest: tuple[tuple[float, float], ...]
    phases: tuple[Phase, ...]


@dataclass
class _Plan:
    """What has been laid down so far."""

    time_s: float = 0.0
    height_m: float = 0.0
    level: dict[str, float] = field(default_factory=lambda: dict.fromkeys(CHANNELS, 0.0))
    blends: dict[str, list[tuple[float, float, float, float]]] = field(
        default_factory=lambda: {name: [] for name in CHANNELS}
    )
    rest: list[tuple[float, float]] = field(default_factory=list)

    def blend(self, channel: str, to: float, *, start_s: float, duration_s: float) -> None:
        if duration_s > SHORTEST_BLEND_S and to != self.level[channel]:
            self.blends[channel].append((start_s, start_s + duration_s, self.level[channel], to))
            self.level[channel] = to

    def reach_speed(self, speed_m_s: float, *, peak_m_s2: float) -> float:
        """Lays the speed change down from now; returns how long it takes [s]."""
        duration_s = PEAK * abs(speed_m_s - self.level["speed_m_s"]) / peak_m_s2
        self.blend("speed_m_s", speed_m_s, start_s=self.time_s, duration_s=duration_s)
        return duration_s

    def sweep(self, channel: str, amount: float, *, peak: float, blend_s: float) -> float:
        """A rate channel up, held and back to zero so that its integral is `amount`; returns the
        time taken [s].
        """
        if amount == 0:
            return 0.0
        rate = np.copysign(min(abs(peak), abs(amount) / blend_s), amount)
        hold_s = amount / rate - blend_s
        self.blend(channel, rate, start_s=self.time_s, duration_s=blend_s)
        self.blend(channel, 0.0, start_s=self.time_s + blend_s + hold_s, duration_s=blend_s)
        return float(hold_s + 2 * blend_s)

    def stand(self, duration_s: float) -> None:
        if duration_s > 0:
            self.rest.append((self.time_s, self.time_s + duration_s))
            self.time_s += duration_s


def lay(segments: Sequence[Segment], *, alignment_s: float = 600.0) -> SimulatedMotion:
    """Segments end to end, from rest at time 0, as smooth profiles with their phases.

    Raises InputError where a segment cannot follow from the one before (parking at speed, flying
    before take-off).
    """
    if not segments:
        raise InputError("motion: no segments, needed at least one")
    plan = _Plan()
    spans: list[tuple[str, float, float]] = []
    for number, segment in enumerate(segments):
        start_s = plan.time_s
        _check(segment, plan, f"motion[{number}] {type(segment).__name__}")
        phase = _STEPS[type(segment)](plan, segment)
        spans.append(
            ("first_park" if number == 0 and phase == "parked" else phase, start_s, plan.time_s)
        )
    course_rate = _profile(plan.blends["course_rate_rad_s"], plan.time_s)
    return SimulatedMotion(
        end_s=plan.time_s,
        speed_m_s=_profile(plan.blends["speed_m_s"], plan.time_s),
        course_rate_rad_s=course_rate,
        course_rad=_antiderivative(course_rate),
        climb_rate_m_s=_profile(plan.blends["climb_rate_m_s"], plan.time_s),
        airborne=_profile(plan.blends["airborne"], plan.time_s),
        rest=tuple(plan.rest),
        phases=_phases(spans, alignment_s),
    )


def _check(segment: Segment, plan: _Plan, name: str) -> None:
    for key, value in vars(segment).items():
        if value is not None and not np.isfinite(value):
            raise InputError(f"{name}: {key} = {value}, needed a finite number")
        if (
            key not in ("angle_deg", "height_m", "speed_m_s")
            and value is not None
            and not value > 0
        ):
            raise InputError(f"{name}: {key} = {value}, needed more than 0")
    airborne, moving = plan.level["airborne"] == 1.0, plan.level["speed_m_s"] > 0
    if isinstance(segment, Climb | Cruise | TurnFlight | Descend | Landing) != airborne:
        raise InputError(
            f"{name}: the vehicle is {'in the air' if airborne else 'on the ground'} here"
        )
    if isinstance(segment, Park | Pivot) and moving:
        raise InputError(
            f"{name}: still rolling at {plan.level['speed_m_s']:g} m/s; a stop must come before"
        )
    speed = getattr(segment, "speed_m_s", None)
    if speed is not None and not speed > 0:
        raise InputError(
            f"{name}: speed_m_s = {speed}, needed more than 0 (use a stop or a park to stand)"
        )


def _park(plan: _Plan, s: Park) -> str:
    plan.stand(s.duration_s)
    return "parked"


def _straight(plan: _Plan, s: Straight) -> str:
    taken_s = plan.reach_speed(s.speed_m_s, peak_m_s2=s.acceleration_m_s2)
    plan.time_s += max(taken_s, s.duration_s)
    return "taxi"


def _turn(plan: _Plan, s: Turn) -> str:
    plan.time_s += plan.reach_speed(s.speed_m_s, peak_m_s2=s.acceleration_m_s2)
    rate = s.speed_m_s / s.radius_m
    plan.time_s += plan.sweep(
        "course_rate_rad_s", s.angle_deg * DEG, peak=rate, blend_s=TURN_BLEND_S
    )
    return "taxi"


def _stop(plan: _Plan, s: Stop) -> str:
    plan.time_s += plan.reach_speed(0.0, peak_m_s2=s.deceleration_m_s2)
    plan.stand(s.duration_s)
    return "taxi"


def _pivot(plan: _Plan, s: Pivot) -> str:
    blend_s = s.duration_s / 2
    plan.time_s += plan.sweep("course_rate_rad_s", s.angle_deg * DEG, peak=np.inf, blend_s=blend_s)
    return "taxi"


def _take_off(plan: _Plan, s: TakeOff) -> str:
    plan.time_s += plan.reach_speed(s.lift_off_speed_m_s, peak_m_s2=s.acceleration_m_s2)
    plan.blend("airborne", 1.0, start_s=plan.time_s, duration_s=LIFT_OFF_S)
    plan.time_s += LIFT_OFF_S
    return "takeoff"


def _climb(plan: _Plan, s: Climb | Descend) -> str:
    speed_s = plan.reach_speed(s.speed_m_s, peak_m_s2=1.0)
    climb_s = plan.sweep(
        "climb_rate_m_s", s.height_m - plan.height_m, peak=s.rate_m_s, blend_s=FLIGHT_BLEND_S
    )
    plan.height_m = s.height_m
    plan.time_s += max(speed_s, climb_s)
    return "flight"


def _cruise(plan: _Plan, s: Cruise) -> str:
    taken_s = plan.reach_speed(s.speed_m_s or plan.level["speed_m_s"], peak_m_s2=1.0)
    plan.time_s += max(taken_s, s.duration_s)
    return "flight"


def _turn_flight(plan: _Plan, s: TurnFlight) -> str:
    # truth.py banks by the course rate itself
    rate = 9.81 * np.tan(s.bank_deg * DEG) / plan.level["speed_m_s"]
    plan.time_s += plan.sweep(
        "course_rate_rad_s", s.angle_deg * DEG, peak=rate, blend_s=FLIGHT_BLEND_S
    )
    return "flight"


def _landing(plan: _Plan, s: Landing) -> str:
    speed_s = plan.reach_speed(s.touchdown_speed_m_s, peak_m_s2=1.0)
    sink_s = plan.sweep(
        "climb_rate_m_s", -plan.height_m, peak=s.sink_rate_m_s, blend_s=FLIGHT_BLEND_S
    )
    plan.height_m = 0.0
    plan.time_s += max(speed_s, sink_s)
    plan.blend("airborne", 0.0, start_s=plan.time_s, duration_s=LIFT_OFF_S)
    plan.time_s += LIFT_OFF_S
    plan.time_s += plan.reach_speed(s.taxi_speed_m_s, peak_m_s2=s.deceleration_m_s2)
    return "landing"


# each lays its segment down and names the phase
_STEPS: dict[type, Callable[[_Plan, Any], str]] = {
    Park: _park,
    Straight: _straight,
    Turn: _turn,
    Stop: _stop,
    Pivot: _pivot,
    TakeOff: _take_off,
    Climb: _climb,
    Cruise: _cruise,
    TurnFlight: _turn_flight,
    Descend: _climb,
    Landing: _landing,
}


def _profile(blends: list[tuple[float, float, float, float]], end_s: float) -> PPoly:
    """Constants joined by quintic blends (start, end, from, to), held beyond both ends. Blends are
    in time order.
    """
    breaks, rows, value = [-1.0], [], 0.0
    for start_s, stop_s, y0, y1 in blends:
        if start_s > breaks[-1]:
            rows.append([0, 0, 0, 0, 0, y0])
            breaks.append(start_s)
        T, d = stop_s - start_s, y1 - y0
        if T < SHORTEST_BLEND_S:
            raise InputError(
                f"a change by {d:g} within {T:g} s, needed at least {SHORTEST_BLEND_S:g} s"
            )
        rows.append([6 * d / T**5, -15 * d / T**4, 10 * d / T**3, 0, 0, y0])
        breaks.append(stop_s)
        value = y1
    rows.append([0, 0, 0, 0, 0, value])
    breaks.append(max(end_s, breaks[-1]) + 1.0)
    return PPoly(np.array(rows, dtype=float).T, np.array(breaks))


def _antiderivative(profile: PPoly) -> PPoly:
    """The integral from time 0."""
    integral = profile.antiderivative()
    integral.c[-1] -= integral(0.0)
    return integral


def _phases(spans: list[tuple[str, float, float]], alignment_s: float) -> tuple[Phase, ...]:
    named: list[tuple[str, float, float]] = []
    for phase, start_s, end_s in spans:
        if phase == "first_park":
            cut_s = min(start_s + alignment_s, end_s)
            named += [("alignment", start_s, cut_s), ("extended_alignment", cut_s, end_s)]
        elif named and named[-1][0] == phase:
            named[-1] = (phase, named[-1][1], end_s)
        else:
            named.append((phase, start_s, end_s))
    return tuple(Phase(phase=p, start_s=a, end_s=b) for p, a, b in named if b > a)
