"""Sessions kept in a store, as the likelihood takes them: what each measured of the biases at its
temperatures, with its covariance, prior excluded.

Decision: docs/decisions/0067-drawn-posterior.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from infield.table.thermal_table import ThermalTable
from ins.records import AXES, InputError, frozen_array
from ins.units import HOUR

ARCSEC_PER_DEG = 3600.0
# eigenvalues of a measured covariance below this share of its largest are rounding (float64 sums
# of a filter with 75 states keep 1e-9)
LEAST_VARIANCE = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredSession:
    """Bias points of one session.

    axis_index, temperature_degC, time_s, duration_s, bias_deg_h: shape (m,), times from the run's
    start, bias comparable with the table; covariance (m, m) [(deg/h)^2]: of the measurement alone,
    the airframe's yaw creep of `yaw_creep_arcsec_sqrt_h` in it. run_length_s: of the whole run.
    year: of its start, from any epoch. crab_mrad: what the taxi measured of the crab, value and
    sigma, its prior excluded; None: not shown. heading_source: empty where heading was not found.
    """

    run_id: str
    run_sha256: str
    year: float
    axis_index: NDArray
    temperature_degC: NDArray
    time_s: NDArray
    duration_s: NDArray
    bias_deg_h: NDArray
    covariance: NDArray
    run_length_s: float
    yaw_creep_arcsec_sqrt_h: float
    crab_mrad: tuple[float, float] | None = None
    heading_source: str = ""

    def __post_init__(self) -> None:
        axis = np.array(self.axis_index, dtype=np.int64)
        axis.flags.writeable = False
        object.__setattr__(self, "axis_index", axis)
        m = axis.size
        for name in ("temperature_degC", "time_s", "duration_s", "bias_deg_h"):
            checked = frozen_array(getattr(self, name), (m,), f"session {self.run_id}: {name}")
            object.__setattr__(self, name, checked)
        covariance = frozen_array(
            self.covariance, (m, m), f"session {self.run_id}: covariance of its points"
        )
        object.__setattr__(self, "covariance", covariance)
        if not m or not np.all(np.isfinite(covariance)) or not np.all(np.isfinite(self.bias_deg_h)):
            raise InputError(f"session {self.run_id}: no points, or some that are not finite")

    @property
    def creep_variance(self) -> NDArray:
        """Variance (m,) [(deg/h)^2] that 1 arcsec/sqrt(h) of yaw creep puts into each point: a
        random walk of heading over the point's duration, on the vertical gyro alone.
        """
        hours = np.maximum(self.duration_s, 1.0) / HOUR
        variance = (1.0 / ARCSEC_PER_DEG) ** 2 / hours
        return np.where(self.axis_index == AXES.index("z"), variance, 0.0)

    @property
    def covariance_without_creep(self) -> NDArray:
        """Of the measurement on an airframe that does not turn; positive."""
        R = self.covariance - self.yaw_creep_arcsec_sqrt_h**2 * np.diag(self.creep_variance)
        values, vectors = np.linalg.eigh(0.5 * (R + R.T))
        return np.asarray((vectors * np.maximum(values, LEAST_VARIANCE * values[-1])) @ vectors.T)


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredUnit:
    """One unit: the table that it began with at `year`, and its sessions since, oldest first."""

    imu_serial: str
    gyro_technology: str
    gyro_mode: str
    table: ThermalTable
    year: float
    sessions: tuple[StoredSession, ...]

    @property
    def name(self) -> str:
        """For people."""
        return " ".join(filter(None, (self.imu_serial, self.gyro_mode)))

    @property
    def kind(self) -> str:
        """Its type: the technology, and the gyro mode where it has one."""
        return " ".join(filter(None, (self.gyro_technology, self.gyro_mode)))


def ordered(sessions: Sequence[StoredSession]) -> tuple[StoredSession, ...]:
    """Oldest first, each run once."""
    once = {session.run_sha256: session for session in sessions}
    return tuple(sorted(once.values(), key=lambda s: (s.year, s.run_id)))


def covering(unit: StoredUnit) -> ThermalTable:
    """The unit's table with nodes over all temperatures of its sessions."""
    if not unit.sessions:
        return unit.table
    seen = np.concatenate([s.temperature_degC for s in unit.sessions])
    return unit.table.extended_to(float(seen.min()), float(seen.max()))


def curve_rows(table: ThermalTable, axis: int, temperature_degC: NDArray) -> NDArray:
    """Rows (k, n) that take the values at the nodes of an axis to the curve through them.

    What a unit ages by is smooth over temperature, so a cubic spline: straight lines between nodes
    10 degC apart miss 5 % of a change that is correlated over 20 degC, which would pass for more
    ageing over a shorter length. Beyond the nodes the end value is held.
    """
    nodes = table.temperature_degC[axis]
    inside = np.clip(temperature_degC, nodes[0], nodes[-1])
    return np.asarray(make_interp_spline(nodes, np.eye(nodes.size), min(3, nodes.size - 1))(inside))
