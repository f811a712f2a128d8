"""A log in steps of a second, read once: sums, extremes and scatter of its rows, for every judge of
rest and motion.

`read_seconds` goes over the rows; all that follows works on seconds. `judged` says which seconds of
a stretch hold something beyond the stretch's own quiet level.

Decision: docs/decisions/0009-motion-two-ways.md.
"""

import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.coarse import COARSE_BLOCK_S
from ins.records import ImuLog, ImuSource
from ins.robust import robust_sigmas

# times the quiet second's largest deviation (1.5 to 3 sigmas of a row): about 10 sigmas
PEAK_SPREADS = 4.0
SECOND_SIGMAS = 8.0  # of a second's mean: 1e-15 of Gaussian ones lie beyond
# of the median spread of rows within a second, beside what force and rate change by from second to
# second: less than any touched second of a unit at rest has (6 sigmas off 3 of spread), more than
# the crest of a swell (tests/alignment/test_imu_faults.py)
ABRUPT_SPREADS = 2.0
# the reader holds the next row's rate over so much; more of it is worse than a quiet jump: a sway
# of 0.02 m/s at 0.28 Hz (R1) is 5 mm/s in it
LOST_S = 0.15
# relative: compensation leaves the rows of a saturated sensor that much alike; float32 rounds by
# 6e-8
SAME = 1e-7
# seconds: below, there is no quiet level to judge by; of 60 a robust sigma is known to 15 %
SHORTEST_JUDGED = 60
# less of a second, at either end of a log, is counted to the one beside it; 1/2 rounds
HALF_S = 0.5
EDGE_ROWS = 1.5  # a second may lack so many rows at the start of a stretch and still count


@dataclass(frozen=True)
class LogSeconds:
    """Seconds (m) of a log, counted in whole seconds of the run; those without rows are left out.

    start_s, end_s (m,): where the second's rows begin and end; first_s: time of its first row;
    dt_s: seconds that its rows cover; longest_s: its longest row; rows: how many. Columns (m, 6)
    are dv x, y, z [m/s], then dtheta x, y, z [rad]: sums; high, low, of the rows' rates; at_high,
    at_low: three rows on end read that rate; scatter: sum of squares of the rows' rates about the
    second's mean. moves (m,): a receiver or the wheels say that the vehicle moves
    (`alignment.motion.speeds.watched_seconds`); False where nobody was asked.
    """

    start_s: NDArray
    end_s: NDArray
    first_s: NDArray
    dt_s: NDArray
    longest_s: NDArray
    rows: NDArray
    sums: NDArray
    high: NDArray
    low: NDArray
    at_high: NDArray
    at_low: NDArray
    scatter: NDArray
    moves: NDArray
    rate_hz: float

    @property
    def mean(self) -> NDArray:
        """Mean specific force and rate (m, 6)."""
        return np.asarray(self.sums / self.dt_s[:, None])

    def where(self, chosen: NDArray | slice) -> "LogSeconds":
        """Some of the seconds."""
        columns = {f.name: getattr(self, f.name)[chosen] for f in fields(self) if f.type == NDArray}
        return replace(self, **columns)

    def between(self, start_s: float, end_s: float) -> "LogSeconds":
        """The seconds that lie in a stretch; one at its start may lack a row."""
        edge = EDGE_ROWS / self.rate_hz
        return self.where((self.start_s >= start_s - edge) & (self.end_s <= end_s + 1e-6))

    def corrected(self, correct: Callable[[ImuLog], ImuLog]) -> "LogSeconds":
        """The seconds with their sums compensated as rows are (`ins.strapdown.compensation`):
        what a bias changes within a second is below 1e-9 of it.
        """
        if self.end_s.size < 2:
            return self
        rows = ImuLog(
            time_s=self.end_s - 0.5 * self.dt_s,
            dt_s=self.dt_s,
            dtheta_rad=self.sums[:, 3:],
            dv_m_s=self.sums[:, :3],
            source="increments",
        )
        found = correct(rows)
        return replace(self, sums=np.concatenate([found.dv_m_s, found.dtheta_rad], axis=1))

    def blocks(self) -> "Blocks":
        """Ten seconds at a time since the first second."""
        number = np.floor((self.end_s - self.end_s[0] + 0.5) / COARSE_BLOCK_S).astype(int)
        first = np.flatnonzero(np.diff(number, prepend=-1))
        last = np.append(first[1:], number.size) - 1
        return Blocks(
            begin_s=self.first_s[first],
            end_s=self.end_s[last],
            seconds=np.add.reduceat(self.dt_s, first),
            dv_m_s=np.add.reduceat(self.sums[:, :3], first),
            dtheta_rad=np.add.reduceat(self.sums[:, 3:], first),
            moves=np.logical_or.reduceat(self.moves, first),
        )


@dataclass(frozen=True)
class Blocks:
    """Blocks (n) of ten seconds: times of their first and last rows, the seconds that the rows
    cover, sums dv_m_s and dtheta_rad (n, 3); moves (n,): a second of it does.
    """

    begin_s: NDArray
    end_s: NDArray
    seconds: NDArray
    dv_m_s: NDArray
    dtheta_rad: NDArray
    moves: NDArray


_READ: dict[int, tuple[weakref.ref, LogSeconds]] = {}  # by identity, while the log lives


def seconds_of(imu: ImuSource) -> LogSeconds:
    """The seconds of a log, gone over once for as long as it is kept, whoever asks."""
    known = _READ.get(id(imu))
    if known is not None and known[0]() is imu:
        return known[1]
    found = read_seconds(imu)
    key = id(imu)
    _READ[key] = (weakref.ref(imu, lambda _: _READ.pop(key, None)), found)
    return found


def read_seconds(imu: ImuSource) -> LogSeconds:
    """Go over a log, piece by piece."""
    origin_s = float(np.floor(imu.start_s - 0.5 / imu.rate_hz))
    parts = [_reduced(rows, origin_s) for rows in _whole_seconds(imu, origin_s)]
    columns = {name: np.concatenate([part[name] for part in parts], axis=0) for name in parts[0]}
    found = LogSeconds(rate_hz=imu.rate_hz, **columns)
    if found.end_s.size > 1 and found.dt_s[-1] < HALF_S:
        found = _joined(found, -2)
    if found.end_s.size > 1 and found.dt_s[0] < HALF_S:
        found = _joined(found, 0)
    return found


def _joined(log: LogSeconds, k: int) -> LogSeconds:
    """The seconds with k (0 or -2) and the one after it as one."""
    pair = slice(k, k + 2 or None)
    whole = {
        "start_s": log.start_s[pair][0],
        "end_s": log.end_s[pair][1],
        "first_s": log.first_s[pair][0],
        "longest_s": log.longest_s[pair].max(),
        "high": log.high[pair].max(axis=0),
        "low": log.low[pair].min(axis=0),
        "at_high": log.at_high[pair].any(axis=0),
        "at_low": log.at_low[pair].any(axis=0),
        "moves": log.moves[pair].any(),
    }
    for name in ("dt_s", "rows", "sums", "scatter"):
        whole[name] = getattr(log, name)[pair].sum(axis=0)
    columns: dict[str, Any] = {}
    for name, value in whole.items():
        column, one = getattr(log, name), np.asarray(value)[None]
        columns[name] = np.concatenate([one, column[2:]] if k == 0 else [column[:-2], one])
    return replace(log, **columns)


def _whole_seconds(imu: ImuSource, origin_s: float) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """Times, intervals and increments (n, 6) of rows, cut at full seconds whatever the pieces of
    the log are.
    """
    kept: list[NDArray] = [np.zeros(0), np.zeros(0), np.zeros((0, 6))]
    for piece in imu.pieces():
        kept = [np.concatenate(pair) for pair in zip(kept, _columns(piece))]
        until_s = origin_s + np.floor(kept[0][-1] - origin_s - 1e-9) + 1e-9
        cut = int(np.searchsorted(kept[0], until_s, side="right"))
        if cut:
            yield kept[0][:cut], kept[1][:cut], kept[2][:cut]
            kept = [column[cut:] for column in kept]
    if kept[0].size:
        yield kept[0], kept[1], kept[2]


def _columns(piece: ImuLog) -> tuple[NDArray, NDArray, NDArray]:
    return piece.time_s, piece.dt_s, np.concatenate([piece.dv_m_s, piece.dtheta_rad], axis=1)


def _reduced(rows: tuple[NDArray, NDArray, NDArray], origin_s: float) -> dict[str, NDArray]:
    """The columns of LogSeconds for the rows of some whole seconds."""
    time_s, dt_s, increments = rows
    second = np.ceil(time_s - origin_s - 1e-9)
    first = np.flatnonzero(np.diff(second, prepend=-1.0))
    count = np.diff(np.append(first, time_s.size))
    rate = increments / dt_s[:, None]
    high, low = np.maximum.reduceat(rate, first), np.minimum.reduceat(rate, first)
    width = np.repeat(SAME * np.maximum(np.abs(high), np.abs(low)), count, axis=0)
    covered_s = np.add.reduceat(dt_s, first)
    sums = np.add.reduceat(increments, first)
    off = rate - np.repeat(sums / covered_s[:, None], count, axis=0)
    return {
        "start_s": time_s[first] - dt_s[first],
        "end_s": time_s[np.append(first[1:], time_s.size) - 1],
        "first_s": time_s[first],
        "dt_s": covered_s,
        "longest_s": np.maximum.reduceat(dt_s, first),
        "rows": count,
        "sums": sums,
        "high": high,
        "low": low,
        "at_high": _three_on_end(np.abs(rate - np.repeat(high, count, axis=0)) <= width, first),
        "at_low": _three_on_end(np.abs(rate - np.repeat(low, count, axis=0)) <= width, first),
        "scatter": np.add.reduceat(off**2, first),
        "moves": np.zeros(first.size, dtype=bool),
    }


def _three_on_end(same: NDArray, first: NDArray) -> NDArray:
    """Seconds (m, 6) in which three rows on end (n, 6) are the `same`."""
    middle = same[:-2] & same[1:-1] & same[2:]
    ends = np.zeros((1, same.shape[1]), bool)
    rows = np.concatenate([ends, middle, ends]) if len(same) > 2 else np.zeros_like(same)
    return np.asarray(np.logical_or.reduceat(rows, first))


@dataclass(frozen=True)
class QuietSeconds:
    """Seconds (m) of a stretch against its own quiet level; columns as in `LogSeconds`.

    start_s, end_s (m,); mean (m, 6): specific force and rate; integral (m, 6): running sums less
    the quiet `level` (6,) per second; channels (m, 6): where rows or the sum lie beyond the quiet
    level; stuck (m,): three rows on end read the stretch's largest or smallest value; lost (m,): a
    row that stands for more than LOST_S of lost ones; longest_s, high, low: of the rows. felt (6,):
    how far a row's rate is off the level where a channel is touched by it.
    """

    start_s: NDArray
    end_s: NDArray
    mean: NDArray
    integral: NDArray
    level: NDArray
    channels: NDArray
    stuck: NDArray
    lost: NDArray
    longest_s: NDArray
    high: NDArray
    low: NDArray
    felt: NDArray

    @cached_property
    def touched(self) -> NDArray:
        return np.asarray(self.channels.any(axis=1) | self.lost)

    @cached_property
    def abrupt(self) -> NDArray:
        """Touched seconds (m,) that do not follow from the seconds beside them, as the crest of a
        swell does: their rows spread by more than the change from second to second, or their mean
        is off that of its neighbours.
        """
        beside = np.pad(self.mean, ((1, 1), (0, 0)), mode="edge")
        change = 0.5 * np.abs(beside[2:] - beside[:-2])
        off = self.mean - 0.5 * (beside[2:] + beside[:-2])
        spread = self.high - self.low
        sudden = spread - change > ABRUPT_SPREADS * np.median(spread, axis=0)
        sudden |= np.abs(off) > SECOND_SIGMAS * robust_sigmas(off) + 1e-9
        return np.asarray((sudden & self.channels).any(axis=1) | self.lost | self.stuck)


def quiet_seconds(part: LogSeconds) -> QuietSeconds | None:
    """A stretch against its own quiet level; None where it is shorter than a minute."""
    if part.end_s.size < SHORTEST_JUDGED:
        return None
    mean = part.mean
    level, local = np.median(mean, axis=0), _running_median(mean)
    peak = np.maximum(part.high - local, local - part.low)
    sigma = robust_sigmas(mean - local)
    felt = PEAK_SPREADS * np.median(peak, axis=0) + 1e-9
    channels = peak > felt
    channels |= np.abs(mean - local) > SECOND_SIGMAS * sigma + 1e-9
    most, least = part.high.max(axis=0), part.low.min(axis=0)
    stuck = part.at_high & (part.high >= most - SAME * np.abs(most))
    stuck |= part.at_low & (part.low <= least + SAME * np.abs(least))
    return QuietSeconds(
        start_s=part.start_s,
        end_s=part.end_s,
        mean=mean,
        integral=np.cumsum(part.sums - level * part.dt_s[:, None], axis=0),
        level=level,
        channels=channels,
        stuck=(stuck & channels).any(axis=1),
        lost=part.longest_s > LOST_S + 1.0 / part.rate_hz,
        longest_s=part.longest_s,
        high=part.high,
        low=part.low,
        felt=felt,
    )


def _running_median(values: NDArray, half: int = 30) -> NDArray:
    """Median of 61 seconds about each, of every fifth; the ends repeat."""
    at = np.arange(0, len(values), 5)
    medians = np.empty((at.size, values.shape[1]))
    inner = (at >= half) & (at + half < len(values))
    if inner.any():
        windows = np.lib.stride_tricks.sliding_window_view(values, 2 * half + 1, axis=0)
        medians[inner] = np.median(windows[at[inner] - half], axis=-1)
    for j in np.flatnonzero(~inner):
        medians[j] = np.median(values[max(at[j] - half, 0) : at[j] + half + 1], axis=0)
    return np.asarray(medians[np.minimum((np.arange(len(values)) + 2) // 5, len(at) - 1)])
