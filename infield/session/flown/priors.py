"""What a flight may hold beside the gyros' biases: prior sigmas, and where each is a state.

The filter's state is that of a parked and taxiing session (`ins.estimation.states`, then the bins);
these states follow the bins. Those whose prior is zero are left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

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


class _State(NamedTuple):
    """Of a further state: its components, the unit that it is shown in with its size in SI, and
    whether it stands still while it flies (slow errors and the vertical come and go).
    """

    components: int
    unit: str
    size: float
    constant: bool = True


_STATES: Mapping[Further, _State] = {
    Further.SLOW_POSITION: _State(2, "m", 1.0, constant=False),
    Further.SLOW_VELOCITY: _State(2, "m/s", 1.0, constant=False),
    Further.ANTENNA: _State(3, "m", 1.0),
    Further.DELAY: _State(2, "s", 1.0),
    Further.ACCEL_Z: _State(1, "micro-g", MICRO_G),
    Further.ACCEL_SCALE: _State(3, "ppm", PPM),
    Further.ACCEL_SHIFT: _State(3, "micro-g", MICRO_G),
    Further.ACCEL_SLOPE: _State(3, "micro-g/degC", MICRO_G),
    Further.GYRO_SCALE: _State(2, "ppm", PPM),
    Further.MISALIGNMENT: _State(6, "mrad", MILLIRADIAN),
    Further.SHIFT: _State(3, "deg/h", DEG_PER_HOUR, constant=False),
    Further.FORCE: _State(3, "deg/h per g", DEG_PER_HOUR / (1e6 * MICRO_G)),
    Further.DEFLECTION: _State(2, "arcsec", ARCSEC, constant=False),
}
CONSTANT = tuple(state for state, of in _STATES.items() if of.constant)
SHOWN_IN: Mapping[Further, tuple[str, float]] = {
    state: (of.unit, of.size) for state, of in _STATES.items()
}
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
            at[state] = slice(begin, begin + _STATES[state].components)
            sigmas += [sigma[state]] * _STATES[state].components
    return Layout(first, np.array(sigmas), MappingProxyType(at))
