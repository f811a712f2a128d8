"""Levelling and analytic gyrocompass: attitude of a resting unit from gravity and Earth rate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.earth import EARTH_RATE_RAD_S
from ins.records import ImuLog
from ins.robust import robust_scatter

COARSE_BLOCK_S = 10.0  # a person who steps in spoils a block, not the mean


@dataclass(frozen=True)
class RestMeans:
    """Mean specific force [m/s^2] and angular rate [rad/s] in body axes over a rest, with the
    seconds used.

    Medians over 10 s blocks: a person stepping in spoils a block, not the mean.
    """

    f_ib_b: NDArray
    omega_ib_b: NDArray
    sigma_omega_rad_s: NDArray
    seconds: float


def rest_means(imu: ImuLog) -> RestMeans:
    """Block medians of a resting log; sigma_omega is that of the mean, from the scatter of the
    blocks.
    """
    block = np.floor((imu.time_s - imu.time_s[0]) / COARSE_BLOCK_S).astype(int)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    seconds = np.add.reduceat(imu.dt_s, starts)
    keep = (
        seconds > 0.5 * COARSE_BLOCK_S
        if np.any(seconds > 0.5 * COARSE_BLOCK_S)
        else np.ones(len(starts), bool)
    )
    f = np.add.reduceat(imu.dv_m_s, starts, axis=0)[keep] / seconds[keep, None]
    omega = np.add.reduceat(imu.dtheta_rad, starts, axis=0)[keep] / seconds[keep, None]
    spread = robust_scatter(omega)
    return RestMeans(
        f_ib_b=np.median(f, axis=0),
        omega_ib_b=np.median(omega, axis=0),
        sigma_omega_rad_s=1.25 * spread / np.sqrt(len(f)),
        seconds=float(seconds.sum()),
    )


def gyrocompass_dcm(means: RestMeans) -> NDArray:
    """C_nb (3, 3) of a resting unit: down against the specific force, north along the level part of
    the rate.

    Raises ValueError where the specific force or the level rate vanishes.
    Source: Groves (2013), section 5.6.1 and 5.6.2 (TRIAD of gravity and Earth rate).
    """
    force = np.linalg.norm(means.f_ib_b)
    down = -means.f_ib_b / force
    level_rate = means.omega_ib_b - (means.omega_ib_b @ down) * down
    size = np.linalg.norm(level_rate)
    if not force > 0 or not size > 0:
        raise ValueError("no gravity or no level rate to align on")
    north = level_rate / size
    return np.stack([north, np.cross(down, north), down])


def latitude_from_rates(means: RestMeans) -> tuple[float, float]:
    """Latitude [rad] from the angle between gravity and Earth rate, and |omega| less Earth rate
    [rad/s].
    """
    down = -means.f_ib_b / np.linalg.norm(means.f_ib_b)
    vertical = float(means.omega_ib_b @ down)
    level = float(np.linalg.norm(means.omega_ib_b - vertical * down))
    return float(np.arctan2(-vertical, level)), float(
        np.linalg.norm(means.omega_ib_b) - EARTH_RATE_RAD_S
    )
