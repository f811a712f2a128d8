"""A vehicle on a ship that is moored in a harbour: `ship`.

Motions in place of loads: the wave's spectrum through the ship's own resonances, the swing on the
mooring lines, and the harbour's seiche.
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from ins.units import DEG
from trajectories.simulator.environments.gear import (
    DOWN,
    FORE,
    PITCH,
    ROLL,
    SIDE,
    YAW,
    Forcing,
    still,
)
from trajectories.simulator.environments.scene import Scene
from trajectories.simulator.environments.spectra import Spectrum, gaussian, jonswap, resonance

# A ferry of 150 m. RMS is a quarter of the significant double amplitude; about half of the limits
# for safe work of PIANC (1995), working group 24 (surge 1 m, roll 3 deg, yaw 1 deg), is usual.
WAVE_S = 8.0  # peak period of the swell that enters the harbour
FOLLOWS_HZ = 0.15  # half amplitude there: waves of 70 m in deep water, half of the ship's length
ROLL_S, ROLL_DAMPING, ROLL_RMS_DEG = 12.0, 0.08, 0.4
PITCH_RMS_DEG, HEAVE_RMS_M = 0.12, 0.06
MOORED_S, MOORED_DAMPING = 90.0, 0.1  # natural period on the lines, surge, sway and yaw
SURGE_RMS_M, SWAY_RMS_M, YAW_RMS_DEG = 0.10, 0.08, 0.06
SEICHE_S, SEICHE_DAMPING = 600.0, 0.05  # of a harbour of a kilometre: Rabinovich (2009)
SEICHE_SURGE_M, SEICHE_YAW_DEG = 0.10, 0.03


def ship(scene: Scene, rng: np.random.Generator) -> Forcing:
    """Rolling, pitching and heaving in swell, swinging on the lines."""
    spectra: dict[int, list[Spectrum]] = {
        FORE: [_moored(SURGE_RMS_M), _seiche(SEICHE_SURGE_M)],
        SIDE: [_moored(SWAY_RMS_M)],
        DOWN: [_waves(HEAVE_RMS_M)],
        ROLL: [
            partial(resonance, rms=ROLL_RMS_DEG * DEG, peak_hz=1 / ROLL_S, damping=ROLL_DAMPING)
        ],
        PITCH: [_waves(PITCH_RMS_DEG * DEG)],
        YAW: [_moored(YAW_RMS_DEG * DEG), _seiche(SEICHE_YAW_DEG * DEG)],
    }
    motions = still(scene)
    for column, parts in spectra.items():
        for spectrum in parts:
            motions[:, column] += scene.parked * gaussian(scene, spectrum, rng)
    return Forcing(loads=still(scene), motions=motions)


def _waves(rms: float) -> Spectrum:
    """Swell as the hull follows it: waves that are shorter than the ship lift it nowhere."""

    def felt(f: NDArray) -> NDArray:
        power = jonswap(f, height_m=4 * rms, peak_s=WAVE_S) / (1 + (f / FOLLOWS_HZ) ** 4) ** 2
        return power * rms**2 / (power.sum() * (f[1] - f[0]))

    return felt


def _moored(rms: float) -> Spectrum:
    return partial(resonance, rms=rms, peak_hz=1 / MOORED_S, damping=MOORED_DAMPING)


def _seiche(rms: float) -> Spectrum:
    return partial(resonance, rms=rms, peak_hz=1 / SEICHE_S, damping=SEICHE_DAMPING)
