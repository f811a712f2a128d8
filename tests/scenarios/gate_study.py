"""Rates of the motion gate: seeded events laid over a parked run, and what the gate makes of them.

The events are drawn from what happens to a parked aircraft, not from what the detector looks for:
sizes are log-uniform from where the event still matters (a velocity step of 0.061 m/s, three times
the declared sway, a tilt of 5 arcsec, a way of half a metre), any time, any direction, any heading
of the vehicle.
"""

from dataclasses import dataclass, replace

import numpy as np

from alignment.inertial_start import start_attitude
from alignment.motion import stillness
from alignment.motion.kinds import DISTURBED, STILL
from alignment.motion.stillness import Motion
from ins.records import NavHistory, NavState, Run, TwinModel
from ins.strapdown.mechanization import VerticalChannel, navigate
from tests.alignment.parked import ideal_of, simulate
from tests.scenarios.study import DEFAULT_TWIN
from trajectories.simulator.segments import Park
from trajectories.simulator.vehicle import Boarding, Bump, Event, Gust, Push

RUN_S = 900.0
PARK = (Park(duration_s=RUN_S),)
GUARD_S = 30.0
EPOCH_S = 1.0
KINDS = ("bump", "loading", "gust", "push")


@dataclass(frozen=True)
class Drawn:
    """An event, and the time in which it is at its strength."""

    event: Event
    start_s: float
    end_s: float


@dataclass(frozen=True)
class Gated:
    """One run: was the event with its guard excluded, was the parked heading taken as new, share of
    quiet data lost.
    """

    drawn: Drawn | None
    excluded: bool
    reopened: bool
    quiet_lost: float


def swaying(sway_m_s: float, twin: TwinModel = DEFAULT_TWIN) -> TwinModel:
    return replace(twin, vehicle=replace(twin.vehicle, sway_m_s=sway_m_s))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw(kind: str, rng: np.random.Generator, sway_m_s: float) -> Drawn:
    """One event of a kind, somewhere in the run, with room for its guard."""
    at = float(rng.uniform(100.0, RUN_S - 200.0))
    if kind == "bump":
        length = log_uniform(rng, 0.3, 3.0)
        event: Event = Bump(
            time_s=at,
            velocity_m_s=log_uniform(rng, 0.061, 1.0),
            duration_s=length,
            direction_deg=rng.uniform(0, 360),
        )
        return Drawn(event, at, at + length)
    if kind == "loading":
        direction = rng.standard_normal(3)
        roll, pitch, heading = log_uniform(rng, 5.0, 200.0) * direction / np.linalg.norm(direction)
        settle = log_uniform(rng, 0.5, 5.0)
        event = Boarding(
            time_s=at,
            roll_arcsec=roll,
            pitch_arcsec=pitch,
            heading_arcsec=heading,
            settle_s=settle,
            sink_mm=rng.uniform(0.0, 30.0),
        )
        return Drawn(event, at, at + settle)
    if kind == "gust":
        length = log_uniform(rng, 10.0, 90.0)
        event = Gust(
            time_s=at, duration_s=length, sway_m_s=log_uniform(rng, max(0.03, 3.0 * sway_m_s), 0.3)
        )
        return Drawn(event, at + 0.1 * length, at + 0.9 * length)
    event = Push(
        time_s=at,
        distance_m=rng.choice([-1.0, 1.0]) * log_uniform(rng, 0.5, 10.0),
        speed_m_s=log_uniform(rng, 0.1, 0.7),
        ramp_s=log_uniform(rng, 0.7, 4.0),
        turn_deg=rng.uniform(-1.0, 1.0),
    )
    if event.duration_s > 80.0:
        event = replace(event, speed_m_s=abs(event.distance_m) / 70.0)
    return Drawn(event, at, at + event.duration_s)


def gate(kind: str | None, seed: int, sway_m_s: float = 0.001) -> Gated:
    """One seeded parked run with one event of the kind (None: quiet) through the gate."""
    rng = np.random.default_rng([seed, KINDS.index(kind) if kind else 99, 20260701])
    ideal = ideal_of(PARK, heading_deg=float(rng.integers(0, 12) * 30))
    drawn = draw(kind, rng, sway_m_s) if kind else None
    events = [drawn.event] if drawn else []
    run = simulate(ideal, seed, twin=swaying(sway_m_s), events=events).run
    return judge(stillness.classify(_first_solution(run), imu=run.imu), drawn)


def _first_solution(run: Run) -> NavHistory:
    """The first pass of `linearised.solve`, from the gravity of the first five minutes."""
    start = NavState(
        time_s=0.0,
        site=run.header.site,
        v_n_m_s=np.zeros(3),
        C_nb=start_attitude(run.imu, run.header.site, (0.0, 300.0)),
    )
    return navigate(run.imu, start, epoch_s=1.0, vertical=VerticalChannel(mode="hold"))


def judge(motion: Motion, drawn: Drawn | None) -> Gated:
    t, off = motion.time_s, motion.kind == DISTURBED
    quiet = t > t[0]
    if drawn is None:
        return Gated(None, False, False, float(np.mean(motion.kind[quiet] != STILL)))
    inside = (t > drawn.start_s + EPOCH_S) & (t <= drawn.end_s + GUARD_S - EPOCH_S)
    inside |= (t - EPOCH_S < drawn.end_s) & (t > drawn.start_s)
    span = 0.15 * (drawn.end_s - drawn.start_s)
    quiet &= (t < drawn.start_s - span - 5.0) | (t > drawn.end_s + span + GUARD_S + 5.0)
    near = (t > drawn.start_s - 5.0) & (t < drawn.end_s + 10.0)
    return Gated(
        drawn,
        bool(off[inside].all()),
        bool(motion.jolt_rad[near].max() > 1e-3),
        float(np.mean(motion.kind[quiet] != STILL)),
    )
