"""How much a parked vehicle moves about its place: a level over time, in place of a verdict.

Gusts, people, doors and loading sway a vehicle by millimetres to centimetres and yaw it about its
gear. The gyros see every turn, so none of it spoils an attitude; what is left is noise of the two
things that a parked vehicle warrants: its place and its heading. The level of that noise is the RMS
of what a cubic leaves of 30 s of it, which errors of the solution do not reach.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.excursions import PUSHED_M
from alignment.motion.kinds import DISTURBED, ROLLING, STILL, Disturbance
from alignment.motion.stillness import (
    NEW_PLACE_RAD,
    PUSH_TURN_RAD,
    Motion,
    beside_rolling,
    turn_about_down,
)
from ins.records import NavHistory
from ins.robust import runs_of_true
from ins.units import ARCSEC

# epochs of a second; a cubic in the solution's position errors reaches over them: of Schuler
# motion 6e-10 are left
PIECE_S = 30
CUBIC = 3
# A piece of so many times the median variance is rougher than the stretch; quiet pieces (26 degrees
# of freedom) are so by chance in 1e-8 of all.
ROUGHER = 4.0
CHI2_MEDIAN = 0.4549  # median of chi-square with one degree of freedom
# A moored ship surges by a metre in a minute (0.1 m/s at most) and comes back; a tug's push of
# that speed does not.
FASTEST_SWAY_M_S, LONGEST_SWAY_M = 0.25, 2.0
SMALLEST_YAW_RAD = 0.05 * ARCSEC
# of a standing vehicle: its noise has a level, and the gyros saw its turns
ABSORBED = (Disturbance.MOTION, Disturbance.BUMP, Disturbance.LOADING, Disturbance.GUST)


@dataclass(frozen=True)
class ParkedLevel:
    """RMS of the parked vehicle's place, per axis [m], and of its heading [rad], over time (k,)."""

    place_m: NDArray
    yaw_rad: NDArray


def standing(history: NavHistory, motion: Motion) -> Motion:
    """The motion with all that a level describes taken for rest: what shook the vehicle, left it
    where it was, and is no slow start or end of rolling; and a surge to and fro (a moored ship).
    """
    kind, cause = motion.kind.copy(), motion.cause.copy()
    for a, b in runs_of_true(kind == ROLLING):
        if _sways(history, motion.kind, a, b):
            kind[a:b] = STILL
    apart = ~beside_rolling(motion.time_s, kind)
    for a, b in runs_of_true(kind == DISTURBED):
        stays = _stays(history, a, b)
        if (motion.jolt_rad[a:b] >= NEW_PLACE_RAD).any() and not stays:
            continue
        absorbed = np.isin(cause[a:b], (*ABSORBED, Disturbance.PUSH) if stays else ABSORBED)
        absorbed &= apart[a:b]
        kind[a:b][absorbed], cause[a:b][absorbed] = STILL, ""
    return replace(motion, kind=kind, cause=cause)


def believed(motion: Motion, rest_end_s: float) -> Motion:
    """The motion with rolling and pushes before the end of the rest taken for rest."""
    kind, cause = motion.kind.copy(), motion.cause.copy()
    moved = (kind == ROLLING) | np.isin(cause, (*ABSORBED, Disturbance.PUSH))
    moved &= motion.time_s <= rest_end_s
    kind[moved], cause[moved] = STILL, ""
    return replace(motion, kind=kind, cause=cause)


def _stays(history: NavHistory, first: int, end: int) -> bool:
    """Whether what looks like a push is a constant velocity of the solution (a log that begins
    while somebody boards) and goes nowhere about it.
    """
    if end - first < PIECE_S:
        return False
    v = history.v_n_m_s[first:end, :2]
    way = np.cumsum(v - np.median(v, axis=0), axis=0)
    return bool(np.ptp(way, axis=0).max() < PUSHED_M)


def _sways(history: NavHistory, kind: NDArray, first: int, end: int) -> bool:
    """Whether what looks like rolling is slow all the while, comes back, and keeps its heading,
    about the drift of the solution on either side.
    """
    if abs(turn_about_down(history)[first:end].sum()) > PUSH_TURN_RAD or end - first < PIECE_S:
        return False
    v = history.v_n_m_s[first:end, :2] - _drift(history, kind, first, end)
    if np.linalg.norm(v, axis=1).max() > FASTEST_SWAY_M_S:
        return False
    way = np.cumsum(v - v.mean(axis=0), axis=0)
    straight = np.linalg.norm(v.sum(axis=0))
    return bool(np.ptp(way, axis=0).max() < LONGEST_SWAY_M and straight < LONGEST_SWAY_M)


def _drift(history: NavHistory, kind: NDArray, first: int, end: int) -> NDArray:
    """Velocity (n, 2) that a solution has in some epochs by what it has as long before and after,
    where the vehicle goes nowhere fast: between the two; zero where neither is known.
    """
    t, v = history.time_s, history.v_n_m_s[:, :2]
    slow = (kind <= DISTURBED) | (np.linalg.norm(v, axis=1) < FASTEST_SWAY_M_S)
    sides = []
    for rows in (slice(max(2 * first - end, 0), first), slice(end, 2 * end - first)):
        if np.count_nonzero(slow[rows]) >= PIECE_S:
            sides.append((t[rows][slow[rows]].mean(), v[rows][slow[rows]].mean(axis=0)))
    if not sides:
        return np.zeros((end - first, 2))
    (t0, v0), (t1, v1) = sides[0], sides[-1]
    share = np.zeros(end - first) if t1 == t0 else (t[first:end] - t0) / (t1 - t0)
    return np.asarray(v0 + (v1 - v0) * share[:, None])


def parked_level(history: NavHistory, motion: Motion) -> ParkedLevel:
    """The level at each epoch: that of the whole stretch, and where a piece is rougher its own."""
    pieces = _pieces(motion)
    place = np.full(len(motion.kind), sway_position_sigma(history, motion))
    yaw = np.full(len(motion.kind), max(yaw_jitter_sigma(history, motion), SMALLEST_YAW_RAD))
    turn = np.cumsum(turn_about_down(history))[:, None]
    for level, path in ((place, np.cumsum(history.displacement_n_m[:, :2], axis=0)), (yaw, turn)):
        variances = _variances(path, pieces).mean(axis=1)
        if not variances.size:
            continue
        rougher = variances > ROUGHER * np.median(variances)
        for (a, b), variance in zip(np.array(pieces)[rougher], variances[rougher]):
            level[a:b] = np.maximum(level[a:b], np.sqrt(variance))
    return ParkedLevel(place, yaw)


def sway_position_sigma(history: NavHistory, motion: Motion) -> float:
    """RMS of the parked vehicle's horizontal position jitter [m], per axis; rougher pieces do not
    count.
    """
    path = np.cumsum(history.displacement_n_m[:, :2], axis=0)
    v = _variances(path, _pieces(motion)).ravel()
    if not v.size:
        return 0.0
    return float(np.sqrt(np.mean(v[v <= ROUGHER * np.median(v)])))


def _pieces(motion: Motion) -> list[tuple[int, int]]:
    """First and last epoch of each piece; from the start of each stretch."""
    pieces = []
    for a, b in runs_of_true(motion.kind == STILL):
        first = max(a, 1)
        pieces += [(i, i + PIECE_S) for i in range(first, b - PIECE_S + 1, PIECE_S)]
    return pieces


def _variances(path: NDArray, pieces: list[tuple[int, int]]) -> NDArray:
    """Variance (n, columns) of a path about a cubic over each piece."""
    if not pieces:
        return np.zeros((0, path.shape[1]))
    cubic = np.linalg.qr(np.vander(np.linspace(-1, 1, PIECE_S), CUBIC + 1))[0]
    stack = np.stack([path[a:b] - path[a] for a, b in pieces])
    left = stack - cubic @ (cubic.T @ stack)
    return np.asarray(np.sum(left**2, axis=1) / (PIECE_S - CUBIC - 1))


def yaw_jitter_sigma(history: NavHistory, motion: Motion) -> float:
    """RMS of the parked vehicle's heading about its slow creep [rad], gyro quantization included.

    Turns over 1 s and over 10 s: gyro noise and creep add up with time, the jitter e of an angle
    does not, so V1 = w + 2 e^2 and V10 = 10 w + 2 e^2. Robust variances (median of squares).
    """
    turn, still = turn_about_down(history), motion.kind == STILL
    tens = [
        turn[k : k + 10].sum() for a, b in runs_of_true(still) for k in range(max(a, 1), b - 9, 10)
    ]
    if len(tens) < 20:
        return 0.0
    ones, rate = turn[still], float(np.median(tens)) / 10.0
    v1, v10 = (
        np.median((x - centre) ** 2) / CHI2_MEDIAN
        for x, centre in ((ones, rate), (np.array(tens), 10.0 * rate))
    )
    return float(np.sqrt(max(10.0 * v1 - v10, 0.0) / 18.0))
