"""People aboard and on the wing: `boarding` and `maintenance`.

A person is a weight that steps in at a door, walks to a place and stays; each footfall pushes down
by DOWN_SHARE of the weight and to the side by SIDE_SHARE at half the pace.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajectories.simulator.environments.gear import (
    GRAVITY_M_S2,
    PITCH,
    ROLL,
    YAW,
    Forcing,
    push,
    still,
    weigh,
)
from trajectories.simulator.environments.scene import Scene, closed
from trajectories.simulator.environments.spectra import band, gaussian
from trajectories.simulator.vehicle import smooth_step

PERSON_KG, PERSON_SIGMA_KG = 84.0, 15.0  # with cabin baggage: EASA survey of 2009
PACE_HZ, PACE_SIGMA_HZ = 1.8, 0.15  # in an aisle; Bachmann & Ammann (1987): 1.6 to 2.4
DOWN_SHARE, SIDE_SHARE = 0.4, 0.1  # first harmonics: the same
FLOOR_M = 3.4  # of the cabin above the ground
DOOR_M = (9.5, -1.9)  # first door on the left: ahead of the main gear, to the right
CABIN_M = (-13.0, 9.0)  # rows of seats, ahead of the main gear
PASSENGERS, EVERY_S = 150, 6.0  # ten a minute through one door
AISLE_M_S = 0.45  # with waiting
CREW, CREW_M_S, PAUSE_S = 4, 1.0, 45.0
# before the vehicle starts, nobody sets out any more: a walk (24 s from end to end), the fading
# (20 s) and ringing of the gear (12 s) fit in
LAST_WALK_S = 90.0
RESTLESS_NEWTON = 120.0  # RMS of 150 seated people, who shift a few kilogrammes each
SHIFT_M = 1.5  # by which a seated crowd's restlessness is off the centre line


@dataclass(frozen=True, kw_only=True)
class PersonPath:
    """A person's way over the grid: start and end [s], place at either end (ahead, right) [m].

    stays: the weight was not aboard before and stays (or it was, and only walks).
    """

    start_s: float
    end_s: float
    from_m: tuple[float, float]
    to_m: tuple[float, float]
    stays: bool


def boarding(scene: Scene, rng: np.random.Generator) -> Forcing:
    """Passengers come for a quarter of an hour, crew walk all the time, the seated are restless."""
    first_s, last_s = scene.stand_s
    wanted_s = PASSENGERS * EVERY_S
    begin_s = first_s + rng.uniform(0.02, 0.3) * max(last_s - first_s - wanted_s, 0.0)
    came_s = begin_s + np.cumsum(rng.exponential(EVERY_S, PASSENGERS))
    loads = still(scene)
    for start_s in came_s:
        seat = (rng.uniform(*CABIN_M), rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5))
        end_s = start_s + 3.0 + abs(seat[0] - DOOR_M[0]) / AISLE_M_S
        if end_s < last_s - 60.0:
            walk = PersonPath(start_s=start_s, end_s=end_s, from_m=DOOR_M, to_m=seat, stays=True)
            _walk(scene, loads, walk, rng)
    _crew(scene, loads, CREW, rng)
    aboard = smooth_step((scene.time_s - begin_s) / wanted_s) * scene.parked
    for column, arm_m in ((ROLL, SHIFT_M), (PITCH, 0.5 * CABIN_M[1])):
        restless = gaussian(
            scene, lambda f: band(f, rms=RESTLESS_NEWTON, low_hz=0.1, high_hz=3.0), rng
        )
        loads[:, column] += arm_m * aboard * restless
    return Forcing(loads=closed(scene, loads), motions=still(scene))


TECHNICIANS = 3
ON_WING_M = 8.0  # where people stand on the wing
SURFACES_NM = {ROLL: 1.5e3, PITCH: 2.0e3, YAW: 4.0e3}  # reaction of control surfaces, both ways
CHECK_S, CHECK_HZ = 25.0, 0.25  # of a check of the controls
BLOW_N_S, BLOW_S = 15.0, 0.1  # a blow with a soft hammer, a panel shut


def maintenance(scene: Scene, rng: np.random.Generator) -> Forcing:
    """People walk aboard, stand on the wing, move the controls, shut panels, drive parts in."""
    first_s, last_s = scene.stand_s
    span_s = last_s - first_s
    loads = still(scene)
    _crew(scene, loads, TECHNICIANS, rng)
    for start_s in first_s + np.sort(rng.uniform(0.0, 1.0, int(span_s / 400.0))) * span_s:
        _on_the_wing(scene, loads, start_s, rng)
    for start_s in first_s + rng.uniform(0.0, 0.95, int(np.ceil(span_s / 900.0))) * span_s:
        _controls(scene, loads, start_s, rng)
    for start_s in first_s + rng.uniform(0.0, 0.98, int(span_s / 60.0)) * span_s:
        _blow(scene, loads, start_s, rng)
    loads *= scene.parked[:, None]
    return Forcing(loads=loads, motions=still(scene))


def _walk(scene: Scene, loads: NDArray, walk: PersonPath, rng: np.random.Generator) -> None:
    """Adds a person's weight and footfalls; from the end on the weight stays at its place."""
    newton = GRAVITY_M_S2 * max(rng.normal(PERSON_KG, PERSON_SIGMA_KG), 40.0)
    first, last = (int(np.searchsorted(scene.time_s, t)) for t in (walk.start_s, walk.end_s))
    since = scene.time_s[first:last] - walk.start_s
    lasts = walk.end_s - walk.start_s
    u = smooth_step(since / lasts)
    x, y = (a + (b - a) * u for a, b in zip(walk.from_m, walk.to_m))
    going = smooth_step(since) * smooth_step(lasts - since)
    pace = 2 * np.pi * rng.normal(PACE_HZ, PACE_SIGMA_HZ) * since + rng.uniform(0, 2 * np.pi)
    part = loads[first:last]
    weigh(part, newton * DOWN_SHARE * going * np.sin(pace), x, y)
    push(part, newton * SIDE_SHARE * going * np.sin(0.5 * pace), FLOOR_M, x)
    if walk.stays:
        weigh(part, newton * smooth_step(since), x, y)
        weigh(loads[last:], newton, *walk.to_m)


def _crew(scene: Scene, loads: NDArray, count: int, rng: np.random.Generator) -> None:
    """Adds people who were aboard before and walk to and fro, with pauses, while it is parked."""
    first_s, last_s = scene.stand_s
    for _ in range(count):
        time_s = first_s + rng.exponential(PAUSE_S)
        place = rng.uniform(*CABIN_M)
        while time_s < last_s - LAST_WALK_S:
            to = rng.uniform(*CABIN_M)
            end_s = time_s + 2.0 + abs(to - place) / CREW_M_S
            walk = PersonPath(
                start_s=time_s, end_s=end_s, from_m=(place, 0.0), to_m=(to, 0.0), stays=False
            )
            _walk(scene, loads, walk, rng)
            _carry(scene, loads, walk)
            place = to
            time_s = end_s + rng.exponential(PAUSE_S)


def _carry(scene: Scene, loads: NDArray, walk: PersonPath) -> None:
    """Adds the moment of a person who was aboard before and has moved along the cabin."""
    newton_metre = PERSON_KG * GRAVITY_M_S2 * (walk.to_m[0] - walk.from_m[0])
    first, last = (int(np.searchsorted(scene.time_s, t)) for t in (walk.start_s, walk.end_s))
    u = (scene.time_s[first:last] - walk.start_s) / (walk.end_s - walk.start_s)
    loads[first:last, PITCH] -= newton_metre * smooth_step(u)
    loads[last:, PITCH] -= newton_metre


def _on_the_wing(scene: Scene, loads: NDArray, start_s: float, rng: np.random.Generator) -> None:
    """Adds a person who climbs on a wing, stays for some minutes and leaves."""
    newton = GRAVITY_M_S2 * rng.normal(PERSON_KG, PERSON_SIGMA_KG)
    stay_s = rng.uniform(60.0, 400.0)
    up = smooth_step((scene.time_s - start_s) / 3.0)
    down = smooth_step((scene.time_s - start_s - stay_s) / 3.0)
    weigh(loads, newton * (up - down), 1.0, rng.choice([-1.0, 1.0]) * rng.uniform(2.0, ON_WING_M))


def _controls(scene: Scene, loads: NDArray, start_s: float, rng: np.random.Generator) -> None:
    """Adds a check of ailerons, elevators and rudder, one after the other."""
    for column, newton_metre in SURFACES_NM.items():
        since = scene.time_s - start_s
        swing = smooth_step(since / 2.0) * smooth_step((CHECK_S - since) / 2.0)
        loads[:, column] += (
            newton_metre * rng.uniform(0.5, 1.5) * swing * np.sin(2 * np.pi * CHECK_HZ * since)
        )
        start_s += CHECK_S


def _blow(scene: Scene, loads: NDArray, start_s: float, rng: np.random.Generator) -> None:
    """Adds a blow from the side somewhere along the fuselage."""
    first = int(np.searchsorted(scene.time_s, start_s))
    rows = slice(first, first + max(round(BLOW_S / scene.dt_s), 1))
    newton = rng.normal(0.0, 1.0) * BLOW_N_S / BLOW_S
    push(loads[rows], newton, rng.uniform(1.0, 4.0), rng.uniform(*CABIN_M))
