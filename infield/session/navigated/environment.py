"""What the parked vehicle went through: how far it swayed, tilted and yawed, at which frequencies,
and when it was roughest.

Sway and yaw are those of the fitted level (`alignment.level_fit`). Tilt and the bands are measured
on the navigation solution, so the noise of the unit is in them.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from alignment.motion.kinds import STILL
from alignment.motion.level import CUBIC, ROUGHER, parked_level
from alignment.motion.stillness import Motion, turn_about_down
from alignment.result import Solution
from ins.records import NavHistory
from ins.robust import runs_of_true

# Epochs of a second; over a minute a cubic takes the solution's own errors out (Schuler's period is
# 84 minutes).
WINDOW = 64
EDGES_HZ = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2)  # octaves up to half the epochs' rate


@dataclass(frozen=True, kw_only=True)
class MotionBand:
    """RMS of the parked vehicle's place, per axis, tilt, per axis, and heading over an octave."""

    from_hz: float
    to_hz: float
    sway_m: float
    tilt_rad: float
    yaw_rad: float


@dataclass(frozen=True, kw_only=True)
class RoughSpan:
    """A span in which the vehicle moved more than over the rest of its parked time, RMS."""

    start_s: float
    end_s: float
    sway_m: float
    yaw_rad: float


@dataclass(frozen=True, kw_only=True)
class StandingMotion:
    """The motion of a parked vehicle.

    sway_m, yaw_rad: RMS of its place, per axis, and heading in the middle of the filter's steps, by
    the fitted level; tilt_rad: RMS per axis over all `bands`; `bands` is empty, and the tilt NaN,
    where it never stood for a minute on end.
    """

    sway_m: float
    tilt_rad: float
    yaw_rad: float
    bands: tuple[MotionBand, ...]
    spans: tuple[RoughSpan, ...]


def environment(solution: Solution) -> StandingMotion:
    """What a solution shows of its parked vehicle."""
    history, motion = solution.history, solution.motion
    found = solution.level
    bands = _bands(_paths(history), motion)
    tilt_rad = float(np.sqrt(sum(b.tilt_rad**2 for b in bands))) if bands else np.nan
    return StandingMotion(
        sway_m=float(np.hypot(found.place_m, found.swing_m)),
        tilt_rad=tilt_rad,
        yaw_rad=found.yaw_rad,
        bands=bands,
        spans=_rough(history, motion),
    )


def _paths(history: NavHistory) -> NDArray:
    """Place north and east [m], tilt about north and east, heading [rad]: (k, 5)."""
    place = np.cumsum(history.displacement_n_m[:, :2], axis=0)
    step = np.einsum("kij,klj->kil", history.C_nb[1:], history.C_nb[:-1])
    tilt = np.zeros((len(history.C_nb), 2))
    tilt[1:, 0] = np.cumsum(0.5 * (step[:, 2, 1] - step[:, 1, 2]))
    tilt[1:, 1] = np.cumsum(0.5 * (step[:, 0, 2] - step[:, 2, 0]))
    return np.column_stack([place, tilt, np.cumsum(turn_about_down(history))])


def _bands(paths: NDArray, motion: Motion) -> tuple[MotionBand, ...]:
    """RMS by octave, over all minutes in which the vehicle stands."""
    firsts = [
        first
        for a, b in runs_of_true(motion.kind == STILL)
        for first in range(max(a, 1), b - WINDOW + 1, WINDOW)
    ]
    if not firsts:
        return ()
    cubic = np.linalg.qr(np.vander(np.linspace(-1, 1, WINDOW), CUBIC + 1))[0]
    stack = np.stack([paths[i : i + WINDOW] - paths[i] for i in firsts])
    left = stack - cubic @ (cubic.T @ stack)
    # Parseval: the squares of one side, doubled but for the last, sum to the variance.
    power = np.mean(np.abs(np.fft.rfft(left, axis=1)) ** 2, axis=0) / WINDOW**2
    power[1:-1] *= 2.0
    hz = np.fft.rfftfreq(WINDOW)
    found = []
    for low, high in pairwise(EDGES_HZ):
        inside = (hz >= low) & ((hz < high) | (high == EDGES_HZ[-1]))
        rms = np.sqrt(power[inside].sum(axis=0))
        found.append(
            MotionBand(
                from_hz=low,
                to_hz=high,
                sway_m=float(np.hypot(rms[0], rms[1]) / np.sqrt(2.0)),
                tilt_rad=float(np.hypot(rms[2], rms[3]) / np.sqrt(2.0)),
                yaw_rad=float(rms[4]),
            )
        )
    return tuple(found)


def _rough(history: NavHistory, motion: Motion) -> tuple[RoughSpan, ...]:
    """The stretches whose level, of place or heading, is above that of the parked time."""
    level = parked_level(history, motion)
    if not (motion.kind == STILL).any():
        return ()
    calm = [np.median(values[motion.kind == STILL]) for values in (level.place_m, level.yaw_rad)]
    above = level.place_m > np.sqrt(ROUGHER) * calm[0]
    above |= level.yaw_rad > np.sqrt(ROUGHER) * calm[1]
    t = motion.time_s
    return tuple(
        RoughSpan(
            start_s=float(t[max(a - 1, 0)]),
            end_s=float(t[b - 1]),
            sway_m=float(np.sqrt(np.mean(level.place_m[a:b] ** 2))),
            yaw_rad=float(np.sqrt(np.mean(level.yaw_rad[a:b] ** 2))),
        )
        for a, b in runs_of_true(above & (motion.kind == STILL))
    )
