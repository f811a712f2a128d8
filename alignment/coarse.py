"""Levelling and analytic gyrocompass: attitude of a resting unit from gravity and Earth rate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.earth import EARTH_RATE_RAD_S
from ins.records import ImuLog, ImuSource
from ins.robust import robust_scatter, robust_sigmas

BLOCK_S = 10.0


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
    block = np.floor((imu.time_s - imu.time_s[0]) / BLOCK_S).astype(int)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    seconds = np.add.reduceat(imu.dt_s, starts)
    keep = (
        seconds > 0.5 * BLOCK_S if np.any(seconds > 0.5 * BLOCK_S) else np.ones(len(starts), bool)
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


REST_BLOCKS = 6
REST_FORCE_M_S2 = 0.03
REST_RATE_RAD_S = 3e-4
# block means that scatter by more (0.17 deg/s, 0.3 m/s^2) are a vehicle that moves, not a noisy
# unit
NOISIEST = 10.0
LONGEST_COARSE_S = 600.0


def first_rest(imu: ImuSource) -> tuple[float, float] | None:
    """Start and end [s] of the first stretch of at least a minute that looks at rest, at most 10
    min of it.

    Judged on 10 s block means against their median over the stretch; three bad blocks in a row end
    it, single ones (somebody boards) do not. None: the log never rests.
    """
    begins, ends, seconds, dv, dtheta = block_sums(imu)
    f, omega = dv / seconds[:, None], dtheta / seconds[:, None]
    for i in range(len(begins) - REST_BLOCKS + 1):
        reference = slice(i, i + REST_BLOCKS)
        good = _near(f, reference, REST_FORCE_M_S2) & _near(omega, reference, REST_RATE_RAD_S)
        if not good[reference].all():
            continue
        last = i + REST_BLOCKS - 1
        while good[last + 1 : last + 4].any() and ends[last + 1] - ends[i] < LONGEST_COARSE_S:
            last += 1
        while not good[last]:
            last -= 1
        return float(begins[i]), float(ends[last])
    return None


def block_sums(imu: ImuSource) -> list[NDArray]:
    """Of each 10 s block since the first row: times of its first and last row, sums of dt, dv and
    dtheta.

    A block that a piece of the log ends in waits for the next piece, so that each is one sum,
    however the log is cut.
    """
    found: list[tuple[NDArray, ...]] = []
    rows: list[NDArray] = []
    for piece in imu.pieces():
        columns = (piece.time_s, piece.dt_s, piece.dv_m_s, piece.dtheta_rad)
        rows = [np.concatenate(pair) for pair in zip(rows, columns)] if rows else list(columns)
        block = np.floor((rows[0] - imu.start_s) / BLOCK_S)
        whole = int(np.searchsorted(block, block[-1]))
        if whole:
            found.append(_sums(block[:whole], [column[:whole] for column in rows]))
            rows = [column[whole:] for column in rows]
    found.append(_sums(np.floor((rows[0] - imu.start_s) / BLOCK_S), rows))
    return [np.concatenate(column) for column in zip(*found)]


def _sums(block: NDArray, rows: list[NDArray]) -> tuple[NDArray, ...]:
    starts = np.flatnonzero(np.diff(block, prepend=-1.0))
    ends = np.append(starts[1:], block.size) - 1
    return (
        rows[0][starts],
        rows[0][ends],
        *(np.add.reduceat(column, starts, axis=0) for column in rows[1:]),
    )


def _near(values: NDArray, reference: slice, limit: float) -> NDArray:
    """Rows within `limit`, or within 6 robust sigmas (up to NOISIEST limits), of the median of the
    reference rows.
    """
    centre = np.median(values[reference], axis=0)
    noise = robust_sigmas(np.diff(values, axis=0)) / np.sqrt(2.0)
    return np.asarray(
        (np.abs(values - centre) <= np.clip(6.0 * noise, limit, NOISIEST * limit)).all(axis=1)
    )
