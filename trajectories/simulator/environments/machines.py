"""Engines and a ground power unit: `engines` and `gpu`.

A turning machine shakes the airframe at its shaft's frequency, with a little of it in rotation.
What a recorder's rows show of a line above half their rate is what integrating sensors show: the
difference of the angle and of the velocity between the ends of a row.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from trajectories.simulator.environments.gear import FORE, PITCH, YAW, Forcing, Vibration, still
from trajectories.simulator.environments.scene import Scene, closed
from trajectories.simulator.environments.spectra import band, gaussian
from trajectories.simulator.vehicle import smooth_step

ARM_M = 10.0  # rotation that goes with an acceleration: that of a body of this size


@dataclass(frozen=True, kw_only=True)
class Shaker:
    """A machine's line: frequency and its spread between machines, RMS acceleration at the IMU."""

    frequency_hz: float
    spread: float
    acceleration_m_s2: float


# Idle of a CFM56-5B: N1 20 % of 5200, N2 58 % of 14500 rpm; 10 and 5 mg at the avionics, of the
# order of a tenth of what MIL-STD-810H, method 514.8, takes for jet transports in flight.
FAN = Shaker(frequency_hz=17.3, spread=0.05, acceleration_m_s2=0.10)
CORE = Shaker(frequency_hz=140.0, spread=0.02, acceleration_m_s2=0.05)
# A diesel set at 2000 rpm: its shaft and the half order of a four-stroke, through a cable and the
# apron: 0.5 and 0.3 mg; the aircraft's own cooling fans, 400 Hz motors at 190 Hz: 1 mg.
SHAFT = Shaker(frequency_hz=33.3, spread=0.03, acceleration_m_s2=0.005)
HALF_ORDER = Shaker(frequency_hz=16.7, spread=0.03, acceleration_m_s2=0.003)
FANS = Shaker(frequency_hz=190.0, spread=0.02, acceleration_m_s2=0.010)

IDLE_NEWTON = 6000.0  # of one engine, 5 % of 120 kN
THRUST_ARM_M, THRUST_HEIGHT_M = 5.75, 1.6  # from the centre line; above the ground
SPOOL_S = 30.0
BETWEEN_S = (40.0, 90.0)  # from one engine's start to the other's
UNSTEADY = 0.01  # of the thrust, RMS, 0.2 to 5 Hz
AIR_HOSE_NM = 150.0  # RMS about the level axes: flow in the hose of an air-conditioning cart


def engines(scene: Scene, rng: np.random.Generator) -> Forcing:
    """Two engines started one after the other, running at idle whenever it stands from then on."""
    first_s, last_s = scene.stand_s
    starts = first_s + rng.uniform(0.1, 0.7) * (last_s - first_s)
    sides = rng.permutation([-1.0, 1.0])
    loads = still(scene)
    lines: list[Vibration] = []
    for side in sides:
        spool = smooth_step((scene.time_s - starts) / SPOOL_S)
        running = spool * scene.parked
        rough = gaussian(scene, partial(band, rms=UNSTEADY, low_hz=0.2, high_hz=5.0), rng)
        # thrust stays on the brakes until the vehicle starts, then it is the motion's own
        thrust = IDLE_NEWTON * running * (1.0 + rough)
        loads[:, FORE] += thrust
        loads[:, PITCH] += thrust * THRUST_HEIGHT_M
        loads[:, YAW] -= thrust * side * THRUST_ARM_M
        lines += [_line(shaker, running, rng) for shaker in (FAN, CORE)]
        starts += rng.uniform(*BETWEEN_S)
    return Forcing(loads=closed(scene, loads), motions=still(scene), lines=tuple(lines))


def gpu(scene: Scene, rng: np.random.Generator) -> Forcing:
    """A ground power unit and an air-conditioning cart beside the aircraft."""
    loads = still(scene)
    for column in (PITCH, YAW):
        flow = gaussian(scene, partial(band, rms=AIR_HOSE_NM, low_hz=0.5, high_hz=8.0), rng)
        loads[:, column] = flow * scene.parked
    lines = tuple(_line(shaker, scene.parked, rng) for shaker in (SHAFT, HALF_ORDER, FANS))
    return Forcing(loads=loads, motions=still(scene), lines=lines)


def _line(shaker: Shaker, envelope: np.ndarray, rng: np.random.Generator) -> Vibration:
    """The line of one machine, in a random direction."""
    frequency_hz = shaker.frequency_hz * (1.0 + shaker.spread * rng.standard_normal())
    direction = rng.standard_normal((2, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rate_rad_s = shaker.acceleration_m_s2 / (ARM_M * 2 * np.pi * frequency_hz)
    return Vibration(
        frequency_hz=frequency_hz,
        acceleration_m_s2=shaker.acceleration_m_s2 * direction[0],
        rate_rad_s=rate_rad_s * direction[1],
        phase_rad=float(rng.uniform(0.0, 2 * np.pi)),
        envelope=envelope,
    )
