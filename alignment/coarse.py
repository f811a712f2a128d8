"""Levelling and analytic gyrocompass: attitude of a resting unit from gravity and Earth rate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.earth import EARTH_RATE_RAD_S
from ins.records import ImuLog
from ins.robust import robust_scatter

END_BLOCKS = 6  # a minute at either end, over which a sway of 1 cm leaves 2 microradians
# a person who steps in spoils a block, not the mean; chosen: 60 blocks in the 10 min of
# LONGEST_COARSE_S
COARSE_BLOCK_S = 10.0


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
    f, omega, _, whole_s = _blocks(imu)
    return _medians(f, omega, whole_s)


def earth_rate_means(imu: ImuLog) -> RestMeans:
    """The same with the base's own turn about level axes taken out of the rate.

    A vehicle that is loaded by 0.1 deg in 20 min turns at 0.3 deg/h, which is no gyro bias and no
    wrong latitude. The specific force shows that turn: the mean rate between the first and the last
    blocks, less what gravity turned by in the body meanwhile. Means, not medians: a step in the
    tilt is in both. A turn about the vertical stays in, as does what gravity shows to 3 sigma.
    """
    f, omega, seconds, whole_s = _blocks(imu)
    n = len(f)
    ends = max(min(END_BLOCKS, n // 3), 1)
    if n < 3:
        return _medians(f, omega, whole_s)
    u = f / np.linalg.norm(f, axis=1, keepdims=True)
    turned = np.mean(u[-ends:], axis=0) - np.mean(u[:ends], axis=0)
    # what lies between any of the first and any of the last blocks
    weight = np.clip(np.minimum(np.arange(n) + 0.5, n - np.arange(n) - 0.5) / ends, 0.0, 1.0)
    between_s = float(weight @ seconds)
    rate = (weight * seconds) @ omega / between_s
    base = -np.cross(np.mean(u, axis=0), turned) / between_s
    noise = robust_scatter(np.diff(u, axis=0)) / np.sqrt(2.0)
    of_level = np.linalg.norm(noise) * np.sqrt(2.0 / ends) / between_s
    if np.linalg.norm(base) < 3.0 * of_level:
        return _medians(f, omega, whole_s)
    return RestMeans(
        f_ib_b=np.median(f, axis=0),
        omega_ib_b=rate - base,
        sigma_omega_rad_s=np.hypot(1.25 * robust_scatter(omega) / np.sqrt(n), of_level),
        seconds=whole_s,
    )


def _medians(f: NDArray, omega: NDArray, seconds: float) -> RestMeans:
    """The medians of blocks (n, 3)."""
    return RestMeans(
        f_ib_b=np.median(f, axis=0),
        omega_ib_b=np.median(omega, axis=0),
        sigma_omega_rad_s=1.25 * robust_scatter(omega) / np.sqrt(len(f)),
        seconds=seconds,
    )


def _blocks(imu: ImuLog) -> tuple[NDArray, NDArray, NDArray, float]:
    """Specific force and rate (n, 3) of blocks of ten seconds, their lengths (n,), and the length
    of the log [s].
    """
    block = np.floor((imu.time_s - imu.time_s[0]) / COARSE_BLOCK_S).astype(int)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    seconds = np.add.reduceat(imu.dt_s, starts)
    whole = seconds > 0.5 * COARSE_BLOCK_S
    keep = whole if np.any(whole) else np.ones(len(starts), bool)
    f = np.add.reduceat(imu.dv_m_s, starts, axis=0)[keep] / seconds[keep, None]
    omega = np.add.reduceat(imu.dtheta_rad, starts, axis=0)[keep] / seconds[keep, None]
    return f, omega, seconds[keep], float(seconds.sum())


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
    """Latitude [rad] from the angle between gravity and Earth rate, and ``|omega|`` less Earth rate
    [rad/s].
    """
    down = -means.f_ib_b / np.linalg.norm(means.f_ib_b)
    vertical = float(means.omega_ib_b @ down)
    level = float(np.linalg.norm(means.omega_ib_b - vertical * down))
    return float(np.arctan2(-vertical, level)), float(
        np.linalg.norm(means.omega_ib_b) - EARTH_RATE_RAD_S
    )
