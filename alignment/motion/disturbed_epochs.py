"""What moves the parked vehicle and is gone within an epoch: a bump to and fro, people who board, a
gust.

The raw rows, less what a unit at rest reads, are summed over lags of 0.2 to 3 s. A velocity step or
a turn beyond the limit excludes its epoch. Limits are in SI units and in sigmas of this unit on
this day: the sums' own quiet spread.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.earth import gravity_magnitude, omega_ie_n
from ins.records import ImuSource, NavHistory

EXCESS_MOTION_M_S = 0.061  # 0.2 ft/s, the aviation gate for excess motion during alignment
# above the random walk of a quiet solution about its own trend over a minute
SMALLEST_GATE_M_S = 0.015
JOLT_RAD = 1.5e-5  # 3 arcsec: less than the yaw creep of an hour
LAGS_S = (0.2, 0.5, 1.0, 3.0)
# of each lag's quiet spread (2e-9 for one sum; of 3 s an epoch knows the spread less well)
SIGMAS = (6.0, 6.0, 6.0, 7.5)
WIDE_SIGMAS = 8.0  # where that is still below the aviation gate
# epochs; energy of the sums over a second, the steepest part of an oscillation at 0.1 to 0.5 Hz
GUST_WINDOW = 8
# times the quiet mean square over the window: 3e-6 of 8 Gaussian epochs have as much; at half of
# it a sway of 20 mm/s loses more than R1 allows (tests/alignment/test_stillness.py)
GUST_ENERGY = 5.0
# a unit whose quiet spread is smaller is not called rocked by a few millimetres a second
GUST_FLOOR_M_S = 0.005


@dataclass(frozen=True)
class DisturbedEpochs:
    """Epochs (k,) of a history in which the parked vehicle was bumped (velocity), loaded (turn) or
    rocked (energy).
    """

    bump: NDArray
    loading: NDArray
    gust: NDArray


def find_disturbed_epochs(
    imu: ImuSource, history: NavHistory, *, quiet: NDArray, parked: NDArray
) -> DisturbedEpochs:
    """Judge the epochs `parked` (k,) by their raw rows; `quiet` (k,) are those that the quiet level
    is learnt from.

    imu: the rows that `history` was made of (biases may differ: their constant part is taken out).
    """
    if not quiet[1:].any():
        nothing = np.zeros(len(quiet), bool)
        return DisturbedEpochs(nothing, nothing, nothing)
    largest, energy = _extremes(imu, history, quiet, int(np.flatnonzero(parked)[-1]))
    level = _quiet_mean(energy[1:][quiet[1:]])
    level[:, :2] = level[:, :2].mean(axis=1, keepdims=True)  # the level pair is judged together
    sigma = np.sqrt(level)
    beyond = np.array(SIGMAS[-len(sigma) :])[:, None] * sigma
    step = np.maximum(
        np.clip(WIDE_SIGMAS * sigma[:, :3], SMALLEST_GATE_M_S, EXCESS_MOTION_M_S), beyond[:, :3]
    )
    turn = np.maximum(beyond[:, 3:], JOLT_RAD)
    second = max(len(sigma) - 2, 0)
    ratio = (energy[:, second, :2] / np.maximum(level[second, :2], GUST_FLOOR_M_S**2)).mean(axis=1)
    return DisturbedEpochs(
        bump=(largest[:, :, :3] > step).any(axis=(1, 2)) & parked,
        loading=(largest[:, :, 3:] > turn).any(axis=(1, 2)) & parked,
        gust=_rocked(ratio, parked) & parked,
    )


def _extremes(
    imu: ImuSource, history: NavHistory, quiet: NDArray, last: int
) -> tuple[NDArray, NDArray]:
    """Largest |sum| and mean square (k, lags, 6) of each epoch up to `last`, as
    `alignment.motion.disturbed_epochs_kernel` fills them.
    """
    from alignment.motion.disturbed_epochs_kernel import add_rows

    t = history.time_s
    lat, height = float(history.lat_rad[0]), float(history.height_m[0])
    f_n, omega_n = (
        np.array([0.0, 0.0, -gravity_magnitude(lat, height)]),
        np.asarray(omega_ie_n(lat)),
    )
    dt = np.diff(t)[:, None]
    C_bn = history.C_nb[:-1].transpose(0, 2, 1)
    f_off = np.einsum("kij,kj->ki", C_bn, history.dv_f_n_m_s[1:] / dt - f_n)
    omega_off = history.dtheta_b_rad[1:] / dt - C_bn @ omega_n
    offset = np.median(np.concatenate([f_off, omega_off], axis=1)[quiet[1:]], axis=0)
    lags = np.unique(np.maximum(np.round(np.array(LAGS_S) * imu.rate_hz).astype(int), 1))
    largest, energy = np.zeros((2, len(t), len(lags), 6))
    ring, rows, counts = np.zeros((lags.max() + 1, 6)), 0, np.zeros(len(t), dtype=np.int64)
    for piece in imu.pieces(t[0], t[last] + 1e-9):
        epoch = np.searchsorted(t + 1e-9, piece.time_s)
        add_rows(
            rows,
            piece.dt_s,
            piece.dtheta_rad,
            piece.dv_m_s,
            epoch,
            history.C_nb,
            f_n,
            omega_n,
            offset,
            lags,
            ring,
            largest,
            energy,
        )
        rows, counts = rows + piece.rows, counts + np.bincount(epoch, minlength=len(t))
    return largest, energy / np.maximum(counts, 1)[:, None, None]


def _quiet_mean(energy: NDArray) -> NDArray:
    """Mean (lags, 6) of the mean squares (n, lags, 6) of quiet epochs."""
    few = energy <= 4.0 * np.median(energy, axis=0)
    return np.asarray((energy * few).sum(axis=0) / few.sum(axis=0))


def _rocked(ratio: NDArray, parked: NDArray) -> NDArray:
    """Epochs with more than twice the quiet energy, in a window of GUST_WINDOW whose mean energy is
    beyond the limit.
    """
    window = np.ones(GUST_WINDOW) / GUST_WINDOW
    if len(ratio) < 2 * GUST_WINDOW:
        return np.zeros(len(ratio), bool)
    high = np.convolve(np.where(parked, ratio, 0.0), window, "valid") > GUST_ENERGY
    return np.asarray((np.convolve(high, np.ones(GUST_WINDOW), "full") > 0.5) & (ratio > 2.0))
