"""Parked stretches of a log by its raw seconds alone, for gyros whose drift no navigation solution
survives.

A navigation solution of a gyro that is off by 100 deg/h is no baseline to judge rest against. Here
a second is quiet where it scatters no more than this unit's own quiet seconds do; what drifts
slowly (a warm-up) is quiet. All limits are in sigmas of this unit, the caps aside. A turn at one
steady rate from the first row to the last cannot be told from a bias.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import QUIET_S
from alignment.motion.kinds import DISTURBED, STILL, Disturbance
from alignment.motion.seconds import LogSeconds, QuietSeconds, quiet_seconds
from alignment.motion.stillness import Motion
from ins.robust import robust_scatter
from ins.units import DEG_PER_HOUR, HOUR

GUARD_S = 2.0
BESIDE_S = 20  # seconds on either side of a disturbance, for level and rate before and after it
# turned or tilted by more, 1.1 deg: what follows stands on another heading;
# tests/alignment/test_parked_seconds.py turns by 0.002 and 0.3 rad
NEW_PLACE_RAD = 0.02
PLACE = "stands elsewhere"


@dataclass(frozen=True)
class ParkedSeconds:
    """Seconds (m) of a parked stretch: start_s, end_s (m,), sums (m, 6) of dv [m/s] then dtheta
    [rad], still (m,) bool.

    moved: in words, why the stretch ends before the log's rest does; empty where it does not.
    """

    start_s: NDArray
    end_s: NDArray
    sums: NDArray
    still: NDArray
    moved: str = ""

    @property
    def dt_s(self) -> NDArray:
        return self.end_s - self.start_s

    @property
    def motion(self) -> Motion:
        """The stretch as the epochs of a motion, bumps DISTURBED."""
        kind = np.where(np.append(True, self.still), STILL, DISTURBED)
        cause = np.where(kind == DISTURBED, Disturbance.BUMP, "").astype(object)
        return Motion(
            np.append(self.start_s[0], self.end_s), kind, np.zeros(kind.size), float("nan"), cause
        )

    def means(self, start_s: float, end_s: float) -> tuple[NDArray, float]:
        """Mean specific force and rate (6,) over the still seconds of a span, and how many seconds
        those are.
        """
        rows = self.still & (self.start_s >= start_s - 0.5) & (self.end_s <= end_s + 0.5)
        seconds = float(self.dt_s[rows].sum())
        return (self.sums[rows].sum(axis=0) / seconds if seconds else np.full(6, np.nan)), seconds

    def walk(self) -> NDArray:
        """Angle random walk (3,) [rad/sqrt(s)] that neighbouring still seconds show, robust; all
        that is white is in it.
        """
        rate = self.sums[:, 3:] / self.dt_s[:, None]
        pairs = np.diff(rate, axis=0)[self.still[1:] & self.still[:-1]]
        spread = robust_scatter(pairs) / np.sqrt(2.0)
        return np.asarray(spread * np.sqrt(float(np.median(self.dt_s))))


def parked_seconds(log: LogSeconds, start_s: float, end_s: float) -> ParkedSeconds | None:
    """The seconds of a quiet stretch, judged once more on their own; it ends where the unit is
    turned or tilted.

    None where less than a minute is left.
    """
    return _first_place(log, start_s, end_s)[0]


def parked_places(log: LogSeconds, start_s: float, end_s: float) -> tuple[ParkedSeconds, ...]:
    """The same, and what follows each turn or tilt as a place of its own, where that is a minute or
    more.
    """
    found = []
    while np.isfinite(start_s) and start_s < end_s:
        place, start_s = _first_place(log, start_s, end_s)
        found += [] if place is None else [place]
    return tuple(found)


def _first_place(
    log: LogSeconds, start_s: float, end_s: float
) -> tuple[ParkedSeconds | None, float]:
    """Seconds up to the first turn or tilt, None below a minute, and from when on the unit stands
    again (NaN: never).
    """
    part = log.between(start_s, end_s)
    seconds = quiet_seconds(part)
    if seconds is None:
        return None, float("nan")
    sums, still = part.sums, ~seconds.touched
    moved, last, again_s = "", still.size, float("nan")
    for a, b in _runs(~still):
        turn, tilt = _change(sums, seconds, a, b)
        if max(turn, tilt) > NEW_PLACE_RAD:
            moved = (
                f"{PLACE} from {seconds.start_s[a]:.0f} s on: turned by {turn:.2g} rad, tilted by"
                f" {tilt:.2g} rad"
            )
            last, again_s = a, float(seconds.end_s[b - 1]) + GUARD_S
            break
    guard = int(np.ceil(GUARD_S))
    near = np.convolve(~still, np.ones(2 * guard + 1), "same") > 0
    rows = slice(0, last)
    if last < QUIET_S:
        return None, again_s
    return (
        ParkedSeconds(seconds.start_s[rows], seconds.end_s[rows], sums[rows], ~near[rows], moved),
        again_s,
    )


def _runs(touched: NDArray) -> list[tuple[int, int]]:
    """[first, behind last) of the disturbances, those a few seconds apart taken as one."""
    runs: list[tuple[int, int]] = []
    for k in np.flatnonzero(touched):
        if runs and k - runs[-1][1] < 5:
            runs[-1] = (runs[-1][0], int(k) + 1)
        else:
            runs.append((int(k), int(k) + 1))
    return runs


def _change(sums: NDArray, seconds: QuietSeconds, a: int, b: int) -> tuple[float, float]:
    """How far a disturbance turned the unit, by its gyros, and tilted it, by gravity before and
    after [rad].
    """
    dt = seconds.end_s - seconds.start_s
    before, after = slice(max(a - BESIDE_S, 0), a), slice(b, b + BESIDE_S)
    sides = [s for s in (before, after) if dt[s].size]
    if not sides:
        return float("inf"), 0.0
    rate = np.mean([sums[s, 3:].sum(axis=0) / dt[s].sum() for s in sides], axis=0)
    turn = float(np.linalg.norm(sums[a:b, 3:].sum(axis=0) - rate * dt[a:b].sum()))
    if len(sides) < 2:
        return turn, 0.0
    f0, f1 = (sums[s, :3].sum(axis=0) for s in (before, after))
    return turn, float(np.arctan2(np.linalg.norm(np.cross(f0, f1)), f0 @ f1))


SEGMENT_S = 600  # of the spectrum: swings of a minute and a half stand apart from the bias's wander
PIECES = 4  # a stretch of less than so many segments is cut into so many
SHORTEST_SEGMENT_S = 30  # of two or three swells
FROM_TREND = 2  # lowest frequencies that a segment's own trend reaches
SMOOTH = 3  # neighbouring frequencies that are averaged
# of the median power: white noise does not reach it (chi-square of 12 degrees of freedom beyond
# eight medians: 3e-14)
STANDS_OUT = 8.0


@dataclass(frozen=True)
class Sway:
    """Two-sided spectrum (m, 3) of the rates about body axes [(deg/h)^2/Hz] at frequencies (m,)
    [Hz] from zero on, by the seconds of a stretch.
    """

    frequency_hz: NDArray
    power: NDArray

    @property
    def walk_deg_sqrt_h(self) -> NDArray:
        """Angle random walk (3,) of the same power at the lowest frequency."""
        return np.asarray(np.sqrt(self.power[0] / HOUR))

    def covariance(self, averages: NDArray, axis: int) -> NDArray:
        """Of the means (n, n) [(deg/h)^2] that `averages` (n, seconds) takes of one axis' rates."""
        size = 2 * averages.shape[1]
        transform = np.fft.rfft(averages, n=size, axis=1)
        power = np.interp(np.fft.rfftfreq(size), self.frequency_hz, self.power[:, axis])
        twice = np.full(power.size, 2.0)
        twice[0] = twice[-1] = 1.0
        weighted = transform * (power * twice / size)
        return np.asarray((weighted @ transform.conj().T).real)


def sway_of(seconds: ParkedSeconds) -> Sway | None:
    """The spectrum of a stretch that sways; None where nothing stands out of its noise."""
    from scipy.signal import welch  # half a second of CPU, which units that find north never need

    rate = seconds.sums[:, 3:] / seconds.dt_s[:, None] / DEG_PER_HOUR
    segment = int(np.clip(len(rate) // PIECES, SHORTEST_SEGMENT_S, SEGMENT_S))
    if len(rate) < 2 * segment:
        return None
    frequency, power = welch(rate, fs=1.0, nperseg=segment, detrend="linear", axis=0)
    power = 0.5 * power  # of one side
    kernel = np.ones(SMOOTH) / SMOOTH
    power = np.stack([np.convolve(p, kernel, "same") for p in power.T], axis=1)
    inner = power[FROM_TREND:-1]
    if not (inner.max(axis=0) > STANDS_OUT * np.median(inner, axis=0)).any():
        return None
    power[:FROM_TREND] = power[FROM_TREND]
    power[-1] = power[-2]
    return Sway(frequency, power)


def averages(seconds: ParkedSeconds, start_s: NDArray, end_s: NDArray) -> NDArray:
    """What each bin takes of the seconds of a stretch: weights (bins, seconds) that add up to one,
    of its still seconds as `ParkedSeconds.means` takes them.
    """
    inside = seconds.still & (seconds.start_s >= start_s[:, None] - 0.5)
    inside &= seconds.end_s <= end_s[:, None] + 0.5
    weight = inside * seconds.dt_s
    return np.asarray(weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-9))
