"""Effects that a diagnosis found, taken out of a log before it is compared with the table.

Estimators know an effect by one record alone: what it adds to the sensors along a run, and how well
that is known. What it is, and how its columns follow from temperatures or motion, is the business
of the program that found it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ins.records import ImuLog, Run, TwinModel
from ins.strapdown.compensation import compensate, corrected
from ins.units import DEG_PER_HOUR


@dataclass(frozen=True)
class FoundEffect:
    """What one effect adds to a run, as found: time_s (n,) middles of seconds; gyro_rad_s,
    accel_m_s2 (n, 3); gyro_sigma_rad_s (n, 3): one sigma of it, of one and the same cause at all
    times.
    """

    effect: str
    target: str
    time_s: NDArray
    gyro_rad_s: NDArray
    accel_m_s2: NDArray
    gyro_sigma_rad_s: NDArray

    @property
    def rms_deg_h(self) -> NDArray:
        """Of each gyro (3,)."""
        return np.asarray(np.sqrt(np.mean(self.gyro_rad_s**2, axis=0)) / DEG_PER_HOUR)

    @property
    def sigma_deg_h(self) -> NDArray:
        """RMS of its sigma on each gyro (3,)."""
        return np.asarray(np.sqrt(np.mean(self.gyro_sigma_rad_s**2, axis=0)) / DEG_PER_HOUR)


def without_effects(run: Run, effects: Sequence[FoundEffect]) -> Run:
    """The run less its effects, known by the hash of the raw run."""
    if not effects:
        return run
    time_s = effects[0].time_s
    gyro = np.sum([e.gyro_rad_s for e in effects], axis=0)
    accel = np.sum([e.accel_m_s2 for e in effects], axis=0)

    def correct(piece: ImuLog) -> ImuLog:
        middle = piece.time_s - 0.5 * piece.dt_s
        return compensate(
            piece,
            gyro_bias_rad_s=_at(middle, time_s, gyro),
            accel_bias_m_s2=_at(middle, time_s, accel),
        )

    return replace(run, imu=corrected(run.imu, correct))


def _at(time_s: NDArray, nodes_s: NDArray, values: NDArray) -> NDArray:
    return np.stack([np.interp(time_s, nodes_s, column) for column in values.T], axis=1)


def with_effect_sigma(twin: TwinModel, found: Sequence[Sequence[FoundEffect]]) -> TwinModel:
    """The twin with what is not known of the effects in its turn-on: one constant more of each
    session. found: of each run.
    """
    variances = [
        np.sum([e.sigma_deg_h**2 for e in effects], axis=0) for effects in found if effects
    ]
    if not variances:
        return twin
    return with_wider_turn_on(twin, float(np.sqrt(np.max(variances))), "found effects")


def with_wider_turn_on(twin: TwinModel, sigma_deg_h: float, because_of: str) -> TwinModel:
    """The twin whose turn-on has one constant more of each session."""
    wider = float(np.hypot(twin.gyro.turn_on_deg_h, sigma_deg_h))
    source = f"{twin.source}, turn-on widened by {sigma_deg_h:.4f} deg/h for {because_of}"
    return replace(twin, gyro=replace(twin.gyro, turn_on_deg_h=wider), source=source)
