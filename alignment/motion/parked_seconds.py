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

from alignment.motion.excursions import DISTURBED, STILL
from alignment.motion.imu_seconds import Seconds, in_seconds
from alignment.motion.stillness import Motion
from ins.records import ImuSource
from ins.robust import robust_scatter, runs_of_true

WINDOW = 10  # seconds over which scatter is taken
QUIET_S = 60.0  # the quietest minute of the log is where the quiet level is looked for
QUIETEST = 0.6  # of a sigma: RMS of the quietest of many windows
LOUD = 3.0  # times the quiet scatter is motion
# m/s^2 and rad/s of scatter: beyond, a vehicle that moves, not a noisy unit
CAPS = np.array([0.3] * 3 + [3e-3] * 3)
GRAVITY_M_S2, GRAVITY_LIMIT_M_S2 = 9.81, 1.0
SPIN_RAD_S = 0.35  # 20 deg/s: the zero-rate output of a consumer gyro may be that large
BRIDGED_S = 15.0  # of disturbance inside a stretch
GUARD_S = 2.0
BESIDE_S = 20  # seconds on either side of a disturbance, for level and rate before and after it
NEW_PLACE_RAD = 0.02  # turned or tilted by more: what follows stands on another heading
BUMP, PLACE = "bump", "stands elsewhere"


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
        cause = np.where(kind == DISTURBED, BUMP, "").astype(object)
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


def quiet_stretches(
    imu: ImuSource, start_s: float, end_s: float
) -> tuple[tuple[float, float], ...]:
    """Start and end [s] of every quiet stretch of a span, however short."""
    seconds = in_seconds(imu, start_s, end_s)
    if seconds is None:
        return ()
    return tuple(
        _stretches(seconds, _quiet(_sums(seconds) / (seconds.end_s - seconds.start_s)[:, None]))
    )


def parked_seconds(imu: ImuSource, start_s: float, end_s: float) -> ParkedSeconds | None:
    """The seconds of a quiet stretch, judged once more on their own; it ends where the unit is
    turned or tilted.

    None where less than a minute is left.
    """
    return _first_place(imu, start_s, end_s)[0]


def parked_places(imu: ImuSource, start_s: float, end_s: float) -> tuple[ParkedSeconds, ...]:
    """The same, and what follows each turn or tilt as a place of its own, where that is a minute or
    more.
    """
    found = []
    while np.isfinite(start_s) and start_s < end_s:
        place, start_s = _first_place(imu, start_s, end_s)
        found += [] if place is None else [place]
    return tuple(found)


def _first_place(
    imu: ImuSource, start_s: float, end_s: float
) -> tuple[ParkedSeconds | None, float]:
    """Seconds up to the first turn or tilt, None below a minute, and from when on the unit stands
    again (NaN: never).
    """
    seconds = in_seconds(imu, start_s, end_s)
    if seconds is None:
        return None, float("nan")
    sums, still = _sums(seconds), ~seconds.touched
    moved, last, again_s = "", still.size, float("nan")
    for a, b in _runs(~still, seconds):
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


def _sums(seconds: Seconds) -> NDArray:
    dt = (seconds.end_s - seconds.start_s)[:, None]
    return np.asarray(
        np.diff(seconds.integral, axis=0, prepend=np.zeros((1, 6))) + seconds.level * dt
    )


def _quiet(mean: NDArray) -> NDArray:
    """Seconds (m,) whose surroundings scatter like the quietest ones of the log, with one gravity
    and no spin.
    """
    step = np.diff(mean, axis=0, prepend=mean[:1]) / np.sqrt(2.0)
    kernel = np.ones(WINDOW) / WINDOW
    rms = np.sqrt(np.stack([np.convolve(s, kernel, "same") for s in (step**2).T], axis=1))
    share = min(max(QUIET_S / len(mean), 0.02), 1.0)
    level = np.quantile(rms, share, axis=0) / QUIETEST
    for _ in range(3):
        quiet = (rms <= LOUD * level + 1e-12).all(axis=1)
        level = np.median(rms[quiet], axis=0) if quiet.any() else level
    calm = np.all(rms <= np.minimum(LOUD * level + 1e-12, CAPS), axis=1)
    gravity = np.abs(np.linalg.norm(mean[:, :3], axis=1) - GRAVITY_M_S2) < GRAVITY_LIMIT_M_S2
    return np.asarray(calm & gravity & (np.linalg.norm(mean[:, 3:], axis=1) < SPIN_RAD_S))


def _stretches(seconds: Seconds, quiet: NDArray) -> list[tuple[float, float]]:
    """Start and end of the quiet stretches, short disturbances bridged."""
    found: list[tuple[float, float]] = []
    for a, b in runs_of_true(quiet):
        start, end = float(seconds.start_s[a]), float(seconds.end_s[b - 1])
        if found and start - found[-1][1] <= BRIDGED_S:
            found[-1] = (found[-1][0], end)
        else:
            found.append((start, end))
    return found


def _runs(touched: NDArray, seconds: Seconds) -> list[tuple[int, int]]:
    """[first, behind last) of the disturbances, those a few seconds apart taken as one."""
    runs: list[tuple[int, int]] = []
    for k in np.flatnonzero(touched):
        if runs and k - runs[-1][1] < 5:
            runs[-1] = (runs[-1][0], int(k) + 1)
        else:
            runs.append((int(k), int(k) + 1))
    return runs


def _change(sums: NDArray, seconds: Seconds, a: int, b: int) -> tuple[float, float]:
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
