"""A single-aisle airliner on its gear: six modes under loads, each a spring, a mass and a damper.

Loads and motions are columns FORE, SIDE, DOWN [N, m] and ROLL, PITCH, YAW [N m, rad], about the
point on the ground beneath the main gear, in body axes. Coupling of the modes is left out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajectories.simulator.environments.scene import Scene

FORE, SIDE, DOWN, ROLL, PITCH, YAW = range(6)
COLUMNS = 6
GRAVITY_M_S2 = 9.81  # of loads, good to 0.3 % anywhere


@dataclass(frozen=True, kw_only=True)
class Gear:
    """Mass [kg] or inertia [kg m^2], frequency and damping ratio of each column's mode."""

    inertia: tuple[float, ...]
    frequency_hz: tuple[float, ...]
    damping: tuple[float, ...]

    @property
    def stiffness(self) -> NDArray:
        """N/m and N m/rad, (6,)."""
        return np.array(self.inertia) * (2 * np.pi * np.array(self.frequency_hz)) ** 2

    def response(self, frequency_hz: NDArray) -> NDArray:
        """Motion for a unit of load at frequencies (F,): (F, 6), complex.

        Source: Crandall & Mark (1963), chapter 2 (one degree of freedom).
        """
        ratio = frequency_hz[:, None] / np.array(self.frequency_hz)
        return 1 / (self.stiffness * (1 - ratio**2 + 2j * np.array(self.damping) * ratio))


# 60 t, as an A320 or 737 at the gate; roll inertia about the ground. Frequencies of 1 to 2 Hz and
# a tenth of critical damping: docs/environments.md, "The gear".
AIRLINER = Gear(
    inertia=(60e3, 60e3, 60e3, 2.0e6, 3.2e6, 4.5e6),
    frequency_hz=(1.5, 1.0, 1.6, 1.1, 1.3, 1.0),
    damping=(0.10, 0.08, 0.12, 0.07, 0.10, 0.08),
)


@dataclass(frozen=True, kw_only=True)
class Vibration:
    """A vibration at one frequency: RMS acceleration [m/s^2] (3,), RMS rate [rad/s] (3,); phase and
    envelope (J,) on the grid.
    """

    frequency_hz: float
    acceleration_m_s2: NDArray
    rate_rad_s: NDArray
    phase_rad: float
    envelope: NDArray


@dataclass(frozen=True, kw_only=True)
class Forcing:
    """What an environment does over the grid: loads (J, 6) on the gear, motions (J, 6), lines."""

    loads: NDArray
    motions: NDArray
    lines: tuple[Vibration, ...] = ()


def still(scene: Scene) -> NDArray:
    """No load at all, (J, 6); a column lies in one piece, since loads are added by columns."""
    return np.zeros((scene.time_s.size, COLUMNS), order="F")


Size = NDArray | float


def weigh(loads: NDArray, newton: Size, x_m: Size, y_m: Size) -> None:
    """Adds weights at places ahead of the main gear and to the right of the centre line."""
    loads[:, DOWN] += newton
    loads[:, ROLL] += newton * y_m
    loads[:, PITCH] -= newton * x_m


def push(loads: NDArray, newton: Size, height_m: float, x_m: Size) -> None:
    """Adds forces to the right, at a height above the ground and a place ahead of the main gear."""
    loads[:, SIDE] += newton
    loads[:, ROLL] += newton * height_m
    loads[:, YAW] += newton * x_m
