"""What a flight may hold beside the gyros' biases: prior sigmas, and where each is a state.

The filter's state is that of a parked and taxiing session (`ins.estimation.states`, then the bins);
these states follow the bins. Those whose prior is zero are left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from infield.session.settings import FlightPriors
from ins.units import ARCSEC, DEG_PER_HOUR, MICRO_G, MILLIRADIAN, PPM
from ins.verdicts import ReasonCode


class Further(ReasonCode):
    """States that a flight adds, by name; their order is that of their places in the filter."""

    # of the receiver, level: north, east [m]
    SLOW_POSITION = "slow_position", "slow error of the receiver's positions, level"
    # the same of its velocity [m/s]
    SLOW_VELOCITY = "slow_velocity", "slow error of the receiver's velocities, level"
    # error of the lever arm from the IMU to the antenna, body axes [m]
    ANTENNA = "antenna", "antenna off its declared place, body x, y, z"
    # how much older than their stamp positions and velocities are [s]
    DELAY = "delay", "positions and velocities older than their stamps"
    # bias of the vertical accelerometer [m/s^2]
    ACCEL_Z = "accel_z", "bias of the vertical accelerometer"
    # scale errors of the accelerometers [-]
    ACCEL_SCALE = "accel_scale", "scale of the accelerometers"
    # what they read in flight beyond what they read at rest [m/s^2]
    ACCEL_SHIFT = "accel_shift", "accelerometers in flight against at rest"
    # change of their biases with temperature [m/s^2 per degC]
    ACCEL_SLOPE = "accel_slope", "temperature slope of the accelerometers"
    # scale errors of gyros x and y; that of z is a base state [-]
    GYRO_SCALE = "gyro_scale", "scale of the gyros"
    # of gyro x to y and z, y to x and z, z to x and y [rad]
    MISALIGNMENT = "misalignment", "misalignment of the gyros, xy, xz, yx, yz, zx, zy"
    # what gyros x, y, z read in flight beyond what they read at rest [rad/s]
    SHIFT = "shift", "gyros in flight against at rest"
    # of gyros x, y, z by the specific force along them [rad/s per m/s^2]
    FORCE = "force", "gyros by the specific force along them"
    # of the vertical along the track: north, east [rad]
    DEFLECTION = "deflection", "deflection of the vertical along the track, north, east"


COMPONENTS: Mapping[Further, int] = MappingProxyType(
    {
        Further.SLOW_POSITION: 2,
        Further.SLOW_VELOCITY: 2,
        Further.ANTENNA: 3,
        Further.DELAY: 2,
        Further.ACCEL_Z: 1,
        Further.ACCEL_SCALE: 3,
        Further.ACCEL_SHIFT: 3,
        Further.ACCEL_SLOPE: 3,
        Further.GYRO_SCALE: 2,
        Further.MISALIGNMENT: 6,
        Further.SHIFT: 3,
        Further.FORCE: 3,
        Further.DEFLECTION: 2,
    }
)


# What stands still while it flies; slow errors of the receiver and the vertical come and go.
CONSTANT = (
    Further.ANTENNA,
    Further.DELAY,
    Further.ACCEL_Z,
    Further.ACCEL_SCALE,
    Further.ACCEL_SHIFT,
    Further.ACCEL_SLOPE,
    Further.GYRO_SCALE,
    Further.MISALIGNMENT,
    Further.FORCE,
)
# of each state: name of the unit that it is shown in, and that unit's size in SI
SHOWN_IN: Mapping[Further, tuple[str, float]] = MappingProxyType(
    {
        Further.SLOW_POSITION: ("m", 1.0),
        Further.SLOW_VELOCITY: ("m/s", 1.0),
        Further.ANTENNA: ("m", 1.0),
        Further.DELAY: ("s", 1.0),
        Further.ACCEL_Z: ("micro-g", MICRO_G),
        Further.ACCEL_SCALE: ("ppm", PPM),
        Further.ACCEL_SHIFT: ("micro-g", MICRO_G),
        Further.ACCEL_SLOPE: ("micro-g/degC", MICRO_G),
        Further.GYRO_SCALE: ("ppm", PPM),
        Further.MISALIGNMENT: ("mrad", MILLIRADIAN),
        Further.SHIFT: ("deg/h", DEG_PER_HOUR),
        Further.FORCE: ("deg/h per g", DEG_PER_HOUR / (1e6 * MICRO_G)),
        Further.DEFLECTION: ("arcsec", ARCSEC),
    }
)
FREE = 100.0  # of a prior that says next to nothing: 0.03 deg/h, 1 mrad, 500 ppm


@dataclass(frozen=True)
class Layout:
    """Where each further state stands in the filter, from `first` on, and its prior sigma (k,)."""

    first: int
    sigma: NDArray
    at: Mapping[Further, slice]

    def indices(self, state: Further) -> range:
        """Places of a state's components in the filter; empty where it was left out."""
        where = self.at.get(state, slice(0, 0))
        return range(where.start, where.stop)

    def freed(self) -> "Layout":
        """The same with constants whose priors say next to nothing."""
        other = self.sigma.copy()
        for state in (*CONSTANT, Further.SHIFT):
            other[np.array(self.indices(state), dtype=np.int64) - self.first] *= FREE
        return replace(self, sigma=other)

    def with_sigma(self, state: Further, sigma: float) -> "Layout":
        """The same with another prior sigma of one state."""
        other = self.sigma.copy()
        other[np.array(self.indices(state), dtype=np.int64) - self.first] = sigma
        return replace(self, sigma=other)


def laid_out(
    priors: FlightPriors, technology: str, *, first: int, scale_ppm: float, accel_z_ug: float
) -> Layout:
    """The further states of a technology. scale_ppm: of its gyros; accel_z_ug: turn-on of its
    accelerometers.
    """
    sigma = {
        Further.SLOW_POSITION: priors.slow_position_m,
        Further.SLOW_VELOCITY: priors.slow_velocity_m_s,
        Further.ANTENNA: priors.antenna_m,
        Further.DELAY: priors.delay_s,
        Further.ACCEL_Z: accel_z_ug * MICRO_G,
        Further.ACCEL_SCALE: priors.accel_scale_ppm[technology] * PPM,
        Further.ACCEL_SHIFT: priors.accel_shift_ug[technology] * MICRO_G,
        Further.ACCEL_SLOPE: priors.accel_slope_ug_degC[technology] * MICRO_G,
        Further.GYRO_SCALE: scale_ppm * PPM,
        Further.MISALIGNMENT: priors.misalignment_mrad[technology] * MILLIRADIAN,
        Further.SHIFT: priors.shift_deg_h[technology] * DEG_PER_HOUR,
        Further.FORCE: priors.force_deg_h_g[technology] * DEG_PER_HOUR / (1e6 * MICRO_G),
        Further.DEFLECTION: priors.deflection_rad,
    }
    at: dict[Further, slice] = {}
    sigmas: list[float] = []
    for state in Further:
        if sigma[state] > 0.0:
            begin = first + len(sigmas)
            at[state] = slice(begin, begin + COMPONENTS[state])
            sigmas += [sigma[state]] * COMPONENTS[state]
    return Layout(first, np.array(sigmas), MappingProxyType(at))
