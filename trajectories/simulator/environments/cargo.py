"""Fuel and freight: `refuelling` and `loading`."""

import numpy as np

from ins.units import DEG
from trajectories.simulator.environments.gear import (
    AIRLINER,
    DOWN,
    FORE,
    GRAVITY_M_S2,
    PITCH,
    ROLL,
    Forcing,
    still,
    weigh,
)
from trajectories.simulator.environments.scene import Scene, closed
from trajectories.simulator.vehicle import smooth_step

TILT_DEG, REFUEL_S = 0.1, 1200.0  # the usual, as required of the simulator
FUEL_KG = 6000.0  # 20 min at 375 l/min; one hose gives up to 900
STUCK_SHARE = 0.3  # of the tilt that comes in slips of the oleo struts, whose seals stick
STUCK_EVERY_S, SLIP_S = 120.0, 0.8

CONTAINERS, CONTAINER_EVERY_S = 14, 100.0  # seven in either hold of an A321
CONTAINER_KG, CONTAINER_SIGMA_KG = 900.0, 250.0  # AKH: at most 1134 kg (IATA ULD Regulations)
HOLD_DOORS_M = (6.0, -7.0)  # ahead of the main gear; both on the right side
SILL_M = 1.9  # of a container on the sill, right of the centre line
# seconds and metres over the sill and along the hold: estimates (docs/environments.md)
ROLL_IN_S, ROLL_AFT_S, HOLD_M = 8.0, 15.0, 4.0
LOCK_NEWTON, LOCK_S = 2000.0, 0.15  # a container meets its stop: estimates (docs/environments.md)
# the last load is aboard so long before the vehicle starts: loads fade (20 s) and the gear rings
# down (12 s) in it
ENDS_BEFORE_S = 60.0


def refuelling(scene: Scene, rng: np.random.Generator) -> Forcing:
    """A slow tilt about a random level axis, smooth for the most part, the rest in slips."""
    first_s, last_s = scene.stand_s
    free_s = last_s - first_s - ENDS_BEFORE_S
    lasts_s = min(REFUEL_S, 0.9 * free_s)
    begin_s = first_s + rng.uniform(0.05, 0.95) * max(free_s - lasts_s, 0.0)
    since = scene.time_s - begin_s
    share = _flow(since / lasts_s)
    slips = np.sort(rng.uniform(0.0, lasts_s, max(int(lasts_s / STUCK_EVERY_S), 1)))
    stuck = np.mean([smooth_step((since - slip) / SLIP_S) for slip in slips], axis=0)
    tilt = TILT_DEG * DEG * lasts_s / REFUEL_S * ((1 - STUCK_SHARE) * share + STUCK_SHARE * stuck)
    axis = rng.uniform(0.0, 2 * np.pi)
    loads = still(scene)
    loads[:, ROLL] = AIRLINER.stiffness[ROLL] * np.cos(axis) * tilt
    loads[:, PITCH] = AIRLINER.stiffness[PITCH] * np.sin(axis) * tilt
    loads[:, DOWN] = FUEL_KG * GRAVITY_M_S2 * lasts_s / REFUEL_S * share
    return Forcing(loads=closed(scene, loads), motions=still(scene))


def loading(scene: Scene, rng: np.random.Generator) -> Forcing:
    """Containers come over the sill, roll in, then along the hold to their stop."""
    first_s, last_s = scene.stand_s
    begin_s = first_s + rng.uniform(0.02, 0.3) * (last_s - first_s)
    every_s = rng.uniform(0.6, 1.4, CONTAINERS) * CONTAINER_EVERY_S
    loads = still(scene)
    for k, start_s in enumerate(begin_s + np.cumsum(every_s)):
        if start_s + ROLL_IN_S + ROLL_AFT_S < last_s - ENDS_BEFORE_S:
            door = HOLD_DOORS_M[k % 2]
            along = rng.uniform(-1.0, 1.0) * HOLD_M
            _container(scene, loads, start_s, (door, door + along), rng)
    return Forcing(loads=closed(scene, loads), motions=still(scene))


def _flow(u: np.ndarray) -> np.ndarray:
    """From 0 to 1 at a steady rate, with a twentieth of the time to come and to go."""
    soft = 0.05
    ramp = np.clip(u, 0.0, 1.0)
    comes = soft * (np.minimum(ramp / soft, 1.0) ** 2 / 2 - np.minimum(ramp / soft, 1.0))
    left = np.clip((1.0 - ramp) / soft, 0.0, 1.0)
    goes = soft * (left - left**2 / 2)
    whole = 1.0 - soft
    return np.asarray((ramp + comes - soft / 2 + goes) / whole)


def _container(
    scene: Scene,
    loads: np.ndarray,
    start_s: float,
    x_m: tuple[float, float],
    rng: np.random.Generator,
) -> None:
    """Adds a container: over the sill, to the centre line, then from the door to its place."""
    newton = GRAVITY_M_S2 * max(rng.normal(CONTAINER_KG, CONTAINER_SIGMA_KG), 100.0)
    first = int(np.searchsorted(scene.time_s, start_s))
    rows = loads[first:]
    since = scene.time_s[first:] - start_s
    inward = smooth_step(since / ROLL_IN_S)
    along = smooth_step((since - ROLL_IN_S) / ROLL_AFT_S)
    x = x_m[0] + (x_m[1] - x_m[0]) * along
    weigh(rows, newton * smooth_step(since / 2.0), x, SILL_M * (1.0 - inward))
    met = (since > ROLL_IN_S + ROLL_AFT_S) & (since < ROLL_IN_S + ROLL_AFT_S + LOCK_S)
    rows[:, FORE] += LOCK_NEWTON * np.sign(x_m[1] - x_m[0]) * met
