"""A log in steps of a second: sums, extremes, and which seconds hold something beyond the quiet
level.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ins.records import ImuLog, ImuSource
from ins.robust import robust_sigmas

# times the quiet second's largest deviation (1.5 to 3 sigmas of a row): about 10 sigmas
PEAK_SPREADS = 4.0
SECOND_SIGMAS = 8.0
# the reader holds the next row's rate over so much; more of it is worse than a quiet jump
LOST_S = 0.15
SAME = 1e-7  # relative: compensation leaves the rows of a saturated sensor that much alike


@dataclass(frozen=True)
class Seconds:
    """Seconds (m) of a log; columns are dv x, y, z [m/s], then dtheta x, y, z [rad].

    start_s, end_s (m,); integral (m, 6): running sums less the quiet `level` (6,) per second;
    channels (m, 6): where rows or the sum lie beyond the quiet level; stuck (m,): three rows on end
    read the log's largest or smallest value; lost (m,): a row that stands for more than LOST_S of
    lost ones.
    """

    start_s: NDArray
    end_s: NDArray
    integral: NDArray
    level: NDArray
    channels: NDArray
    stuck: NDArray
    lost: NDArray

    @cached_property
    def touched(self) -> NDArray:
        return np.asarray(self.channels.any(axis=1) | self.lost)


def in_seconds(imu: ImuSource, start_s: float, end_s: float) -> Seconds | None:
    """Read the rows of (start_s, end_s] once, piece by piece; None where there is less than a
    minute.
    """
    parts = [_reduced(piece, start_s) for piece in whole_seconds(imu, start_s, end_s)]
    if not parts:
        return None
    begin, end, dt, longest, sums, high, low, at_high, at_low = (
        np.concatenate(column) for column in zip(*parts)
    )
    if len(dt) < 60:
        return None
    mean = sums / dt[:, None]
    level, local = np.median(mean, axis=0), _running_median(mean)
    peak = np.maximum(high - local, local - low)
    sigma = robust_sigmas(mean - local)
    channels = peak > PEAK_SPREADS * np.median(peak, axis=0) + 1e-9
    channels |= np.abs(mean - local) > SECOND_SIGMAS * sigma + 1e-9
    most, least = high.max(axis=0), low.min(axis=0)
    stuck = at_high & (high >= most - SAME * np.abs(most)) | at_low & (
        low <= least + SAME * np.abs(least)
    )
    return Seconds(
        start_s=begin,
        end_s=end,
        integral=np.cumsum(sums - level * dt[:, None], axis=0),
        level=level,
        channels=channels,
        stuck=(stuck & channels).any(axis=1),
        lost=longest > LOST_S + 1.0 / imu.rate_hz,
    )


def whole_seconds(
    imu: ImuSource, start_s: float, end_s: float
) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """Times, intervals and increments (n, 6) of rows, cut at full seconds whatever the pieces of
    the log are.
    """
    kept: list[NDArray] = [np.zeros(0), np.zeros(0), np.zeros((0, 6))]
    for piece in imu.pieces(start_s, end_s):
        kept = [np.concatenate(pair) for pair in zip(kept, _columns(piece))]
        cut = int(
            np.searchsorted(
                kept[0], start_s + np.floor(kept[0][-1] - start_s - 1e-9) + 1e-9, side="right"
            )
        )
        if cut:
            yield kept[0][:cut], kept[1][:cut], kept[2][:cut]
            kept = [column[cut:] for column in kept]
    if kept[0].size:
        yield kept[0], kept[1], kept[2]


def _columns(piece: ImuLog) -> tuple[NDArray, NDArray, NDArray]:
    return piece.time_s, piece.dt_s, np.concatenate([piece.dv_m_s, piece.dtheta_rad], axis=1)


def _reduced(rows: tuple[NDArray, NDArray, NDArray], start_s: float) -> tuple[NDArray, ...]:
    """Start, end, length, longest row, sums, highest and lowest rate of each second, and whether
    three rows on end read it.
    """
    time_s, dt_s, increments = rows
    first = np.flatnonzero(np.diff(np.ceil(time_s - start_s - 1e-9), prepend=-1.0))
    rate = increments / dt_s[:, None]
    high, low = np.maximum.reduceat(rate, first), np.minimum.reduceat(rate, first)
    width = SAME * np.maximum(np.abs(high), np.abs(low))
    second = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(time_s))))
    runs = []
    for extreme in (high, low):
        same = np.abs(rate - extreme[second]) <= width[second]
        same[1:-1] = same[:-2] & same[1:-1] & same[2:]
        same[[0, -1]] = False
        runs.append(np.logical_or.reduceat(same, first))
    last = np.append(first[1:], len(time_s)) - 1
    return (
        time_s[first] - dt_s[first],
        time_s[last],
        np.add.reduceat(dt_s, first),
        np.maximum.reduceat(dt_s, first),
        np.add.reduceat(increments, first),
        high,
        low,
        *runs,
    )


def _running_median(values: NDArray, half: int = 30) -> NDArray:
    """Median of 61 seconds about each, of every fifth; the ends repeat."""
    at = np.arange(0, len(values), 5)
    medians = np.stack([np.median(values[max(k - half, 0) : k + half + 1], axis=0) for k in at])
    return np.asarray(medians[np.minimum((np.arange(len(values)) + 2) // 5, len(at) - 1)])
