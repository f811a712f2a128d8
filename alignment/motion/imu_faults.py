"""What a sensor says that a parked vehicle cannot have done: clipping, shocks, and gaps that were
bridged.

A shake of a parked vehicle leaves no velocity behind, and what the gyros turn the accelerometers
tilt. A transient of the raw rows that breaks either rule is no motion: what it left is measured by
straight lines through 20 s of the integrated rows on either side, and taken out. Sigmas come from
the same lines laid across the quiet rest of the log. Only up to the first real motion: a taxi
begins with a velocity that stays, and takes longer than a shock.

Decision: docs/decisions/0009-motion-two-ways.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from alignment.motion.excursions import ROLLED_M
from alignment.motion.kinds import Disturbance
from alignment.motion.seconds import LogSeconds, QuietSeconds, quiet_seconds
from ins.records import ImuLog, ImuSource
from ins.robust import robust_sigma, robust_sigmas, runs_of_true
from ins.strapdown.compensation import corrected
from ins.units import STANDARD_GRAVITY

WINDOW = 20  # seconds on either side
FEWEST = 8  # of them: the end of a line through 8 is known to 0.7 of one's noise (2 / sqrt(8))
# of a shock, in touched seconds; a vehicle that starts to move accelerates for longer, to 5 m/s
# at 1 m/s^2; at half of it tests/alignment/test_imu_faults.py fails
LONGEST_S = 5
# a push or a slow tow comes to rest again within this time; chosen: 15 min, 900 m at walking pace
RETURN_S = 900.0
# 7e-6 of Gaussian jumps lie beyond; only transients are asked, a handful in a session
JUMP_SIGMAS = 4.5
SMALLEST_JUMP_M_S = 0.003
SMALLEST_TILT_RAD = 2e-5
EARTH_WINDOW = 300  # seconds on either side: did the vehicle turn against Earth rate?
# 62 arcsec about down, within a shock; chosen: what loads the vehicle turns it by less in so
# short a time
SMALLEST_TURN_RAD = 3e-4
SHOCK_TURN_RAD = 5e-6  # an arcsecond: how much a shock may really turn the vehicle
# A real turn is felt by the level gyros, for its axis is not that of the vertical gyro: by a
# milliradian (3 arcmin) at least, on an aircraft by its attitude at rest of half a degree and more
NEAREST_AXIS_RAD = 1e-3
# and by the accelerometers, for it does not go through the unit; tests/alignment/test_imu_faults.py
# chosen: less than from a bay to where the vehicle turns about; a turntable does not sway
NEAREST_AXIS_M = 0.2
# no turn begins and ends within a few rows: at 100 Hz SMALLEST_TURN_RAD in 5 of them would take
# 27 deg/s^2; a gyro that sticks does so for 1 to 3 rows (requirement R5)
STUCK_ROWS = 5


@dataclass(frozen=True)
class ImuFault:
    """A stretch that was repaired, and the sigmas of what may be left in velocity [m/s] and
    attitude [rad].

    reason None: a shake that was recorded rightly as far as can be seen; nothing is excluded for it
    here.
    """

    start_s: float
    end_s: float
    reason: Disturbance | None
    velocity_sigma_m_s: float
    turn_sigma_rad: float


@dataclass(frozen=True)
class _Jump:
    """Steps of the lines at the middle (6,), and of their slopes (6,): velocity and angle, force
    and rate.
    """

    value: NDArray
    slope: NDArray


@dataclass(frozen=True)
class _Edit:
    """Rows that end in (start_s, end_s] read these rates (6,) instead, where not NaN."""

    start_s: float
    end_s: float
    rate: NDArray


def repair(
    imu: ImuSource, log: LogSeconds, start_s: float, end_s: float
) -> tuple[ImuSource, tuple[ImuFault, ...]]:
    """The log without what clipping and shocks left behind while the vehicle was parked, and the
    list of them.

    log: its seconds, looked at from start_s, where the vehicle rests, to end_s. The log itself
    where nothing is found.
    """
    seconds = quiet_seconds(log.between(start_s, end_s))
    quiet = _quiet_jumps(seconds) if seconds is not None else None
    if seconds is None or quiet is None:
        return imu, ()
    faults: list[ImuFault] = []
    edits: list[_Edit] = []
    groups = _groups(seconds.touched)
    jumps = [_jump(seconds, a, b) for a, b in groups]
    k = 0
    while k < len(groups):
        (a, b), jump = groups[k], jumps[k]
        end = _returns(seconds, groups, jumps, k, quiet)
        if jump is None:
            break  # nothing to compare with
        if end is None and b - a > LONGEST_S and not _lost_in_a_shake(seconds, (a, b), jump, quiet):
            break  # the vehicle drives off
        if (end is None or end == k or seconds.lost[a:b].any()) and seconds.abrupt[a:b].any():
            fault, edit = _judge(seconds, (a, b), jump, quiet, stays=end is None)
            faults.append(fault)
            edits += [edit] if np.isfinite(edit.rate).any() else []
        k = k + 1 if end is None else end + 1
    return (corrected(imu, partial(_edited, edits=tuple(edits))) if edits else imu), tuple(faults)


def _edited(imu: ImuLog, edits: Sequence[_Edit]) -> ImuLog:
    columns = [np.array(imu.dv_m_s), np.array(imu.dtheta_rad)]
    for edit in edits:
        rows = slice(*np.searchsorted(imu.time_s, [edit.start_s + 1e-6, edit.end_s + 1e-6]))
        for axis in np.flatnonzero(np.isfinite(edit.rate)):
            columns[axis // 3][rows, axis % 3] = edit.rate[axis] * imu.dt_s[rows]
    return replace(imu, dv_m_s=columns[0], dtheta_rad=columns[1])


def _judge(
    seconds: QuietSeconds, group: tuple[int, int], jump: _Jump, quiet: _Jump, *, stays: bool
) -> tuple[ImuFault, _Edit]:
    """What one transient was, and the rates that take out what the bad axes left."""
    a, b = group
    stuck, lost, short = seconds.stuck[a:b].any(), seconds.lost[a:b].any(), b - a <= LONGEST_S
    bad = _contradiction(jump, quiet, b - a) if stays else np.zeros(6, bool)
    turned = _turned(seconds, a, b, jump) if short else None
    if stuck:
        bad |= np.abs(jump.value) > JUMP_SIGMAS * quiet.value
    bad |= lost
    alone = not seconds.channels[a:b, :5].any() and abs(jump.value[5]) > SMALLEST_TURN_RAD
    bad[5] |= turned is False or (alone and _unfelt(seconds, a, b, jump))
    edit = _edit_of(seconds, (a, b) if short else _lost_rows(seconds, a, b), jump, bad)
    if lost:
        reason: Disturbance | None = Disturbance.DROPOUT
    elif stuck:
        reason = Disturbance.CLIPPING
    else:
        reason = Disturbance.SHOCK if bad.any() else None
    fault = _fault(seconds, a, b, reason, jump, quiet)
    if turned is None and alone and not bad[5]:  # the vertical gyro turned, no other sensor felt it
        fault = replace(
            fault, reason=reason or Disturbance.SHOCK, turn_sigma_rad=abs(float(jump.value[5]))
        )
    return fault, edit


def _unfelt(seconds: QuietSeconds, a: int, b: int, jump: _Jump) -> bool:
    """Whether a turn of a few rows that the vertical gyro alone read would have been felt by the
    others, about any axis that a vehicle turns about. A longer one is a turntable's.
    """
    turn, level = jump.value[5], seconds.level[5]
    peak = seconds.high[a:b, 5].max() - level if turn > 0.0 else level - seconds.low[a:b, 5].min()
    row_s = np.median(seconds.longest_s)
    if abs(turn) > STUCK_ROWS * row_s * peak:
        return False
    gyro, force = seconds.felt[3:5].max(), seconds.felt[:2].max()
    return bool(gyro < NEAREST_AXIS_RAD * peak and force * row_s < NEAREST_AXIS_M * peak)


def _edit_of(seconds: QuietSeconds, rows: tuple[int, int], jump: _Jump, bad: NDArray) -> _Edit:
    """The rates of the seconds [a, b) that take the jump of the bad axes out of their sum."""
    a, b = rows
    total = seconds.integral[b - 1] - (seconds.integral[a - 1] if a else 0.0)
    length = float(seconds.end_s[b - 1] - seconds.start_s[a])
    rate = np.where(bad, seconds.level + (total - jump.value) / length, np.nan)
    return _Edit(float(seconds.start_s[a]), float(seconds.end_s[b - 1]), rate)


def _lost_rows(seconds: QuietSeconds, a: int, b: int) -> tuple[int, int]:
    """First of the seconds [a, b) that lost rows, and the one after the last; [a, b) itself where
    none did.
    """
    lost = a + np.flatnonzero(seconds.lost[a:b])
    return (int(lost[0]), int(lost[-1]) + 1) if lost.size else (a, b)


def _lost_in_a_shake(
    seconds: QuietSeconds, group: tuple[int, int], jump: _Jump, quiet: _Jump
) -> bool:
    """Whether the vehicle only shook before and after rows were lost, so that the velocity that
    stays is what the row that stands for them left.
    """
    a, b = group
    lost = a + np.flatnonzero(seconds.lost[a:b])
    beside = _beside(seconds, a, b, WINDOW)
    if not lost.size or lost[-1] - lost[0] > LONGEST_S or beside is None:
        return False
    spread = seconds.high[a:b, :3].max(axis=0) - seconds.low[a:b, :3].min(axis=0)
    left = seconds.longest_s[lost].sum() * spread
    if np.any(np.abs(jump.value[:3]) > left + _velocity_limit(jump, quiet, b - a)):
        return False
    ways = []
    for rows, part in zip(beside, (slice(a, lost[0]), slice(lost[-1] + 1, b))):
        value, slope = _line(seconds, rows, 0.0)
        t = seconds.end_s[part, None]
        way = np.cumsum(seconds.integral[part, :2] - value[:2] - slope[:2] * t, axis=0)
        ways.append(float(np.linalg.norm(way, axis=1).max(initial=0.0)))  # of seconds: metres
    return max(ways) <= ROLLED_M


def _groups(touched: NDArray) -> list[tuple[int, int]]:
    """[a, b) of touched seconds, those closer than 3 s together."""
    near = np.convolve(touched, np.ones(3), "same") > 0
    return runs_of_true(near)


def _line(seconds: QuietSeconds, rows: NDArray, at: float) -> tuple[NDArray, NDArray]:
    """Value at a time and slope of the line through the integrals of some seconds, both (6,)."""
    values, slopes = _lines(seconds, rows[None], np.array([at]))
    return values[0], slopes[0]


def _lines(seconds: QuietSeconds, rows: NDArray, at: NDArray) -> tuple[NDArray, NDArray]:
    """`_line` of several stretches rows (m, n) of as many seconds: values and slopes (m, 6)."""
    centre = seconds.end_s[rows].mean(axis=1)
    s = seconds.end_s[rows] - centre[:, None]
    integral = seconds.integral[rows]
    slope = np.einsum("mi,mik->mk", s, integral) / np.sum(s**2, axis=1)[:, None]
    return integral.mean(axis=1) + slope * (at - centre)[:, None], slope


def _beside(seconds: QuietSeconds, a: int, b: int, window: int) -> tuple[NDArray, NDArray] | None:
    """Quiet seconds next to [a, b): before and after, up to the next touched one; None where there
    are too few.
    """
    before, after = (
        np.arange(max(a - window, 0), a),
        np.arange(b, min(b + window, len(seconds.touched))),
    )
    hit_before, hit_after = (
        np.flatnonzero(seconds.touched[before]),
        np.flatnonzero(seconds.touched[after]),
    )
    before = before[hit_before[-1] + 1 :] if hit_before.size else before
    after = after[: hit_after[0]] if hit_after.size else after
    return None if min(len(before), len(after)) < FEWEST else (before, after)


def _jump(seconds: QuietSeconds, a: int, b: int) -> _Jump | None:
    beside = _beside(seconds, a, b, WINDOW)
    if beside is None:
        return None
    middle = 0.5 * float(seconds.start_s[a] + seconds.end_s[b - 1])
    (v0, s0), (v1, s1) = (_line(seconds, rows, middle) for rows in beside)
    return _Jump(v1 - v0, s1 - s0)


def _quiet_jumps(seconds: QuietSeconds) -> _Jump | None:
    """Spreads of the jumps across stretches where nothing happens."""
    first = np.arange(WINDOW, len(seconds.touched) - WINDOW - 3, 7)
    hit = np.concatenate([[0], np.cumsum(seconds.touched)])
    first = first[hit[first + WINDOW + 3] == hit[first - WINDOW]]
    if first.size < 5:
        return None
    middle = 0.5 * (seconds.start_s[first] + seconds.end_s[first + 2])
    window = np.arange(WINDOW)
    (v0, s0), (v1, s1) = (
        _lines(seconds, begins[:, None] + window, middle) for begins in (first - WINDOW, first + 3)
    )
    return _Jump(robust_sigmas(v1 - v0), robust_sigmas(s1 - s0))


def _velocity_limit(jump: _Jump, quiet: _Jump, length: int) -> NDArray:
    """Velocity (3,) that may seem to stay: noise, and a real change of tilt at an unknown time
    within the group.
    """
    noise = np.maximum(JUMP_SIGMAS * quiet.value[:3], SMALLEST_JUMP_M_S)
    return np.asarray(noise + 0.5 * length * np.abs(jump.slope[:3]))


def _contradiction(jump: _Jump, quiet: _Jump, length: int) -> NDArray:
    """Which of dv x, y, z and dtheta x, y cannot be: a velocity that stays, a turn that gravity
    does not show.
    """
    bad = np.zeros(6, bool)
    bad[:3] = np.abs(jump.value[:3]) > _velocity_limit(jump, quiet, length)
    limit = np.maximum(JUMP_SIGMAS * quiet.slope[1::-1] / STANDARD_GRAVITY, SMALLEST_TILT_RAD)
    bad[3:5] = np.abs(jump.value[3:5] - _tilted(jump)) > limit
    return bad


def _tilted(jump: _Jump) -> NDArray:
    """Turn about x, y (2,) [rad] of a roughly level unit that a change of its specific force shows:
    df = -turn x f.
    """
    return np.array([-jump.slope[1], jump.slope[0]]) / STANDARD_GRAVITY


def _returns(
    seconds: QuietSeconds,
    groups: list[tuple[int, int]],
    jumps: list[_Jump | None],
    k: int,
    quiet: _Jump,
) -> int | None:
    """The group with which the velocity of group k is back at rest (k itself: it never left)."""
    total, limit = np.zeros(2), np.zeros(2)
    start_s = seconds.start_s[groups[k][0]]
    for m in range(k, len(groups)):
        jump, (a, b) = jumps[m], groups[m]
        if jump is None or seconds.start_s[a] - start_s > RETURN_S:
            return None
        if m == k and _contradiction(jump, quiet, b - a)[2:5].any():
            return None
        total = total + jump.value[:2]
        limit = np.hypot(limit, _velocity_limit(jump, quiet, b - a)[:2])
        if np.all(np.abs(total) <= limit):
            return m
    return None


def _turned(seconds: QuietSeconds, a: int, b: int, jump: _Jump) -> bool | None:
    """Did the vehicle turn with its vertical gyro? The level Earth rate, in body axes, tells."""
    turn, beside = jump.value[5], _beside(seconds, a, b, EARTH_WINDOW)
    if abs(turn) < SMALLEST_TURN_RAD or beside is None:
        return None
    before, after = (
        seconds.level[3:5]
        + (seconds.integral[rows[-1], 3:5] - seconds.integral[rows[0], 3:5]) / (len(rows) - 1)
        for rows in beside
    )
    c, s = np.cos(turn), np.sin(turn)
    # body axes turn by +turn
    expected = np.array([c * before[0] + s * before[1], -s * before[0] + c * before[1]])
    steps = np.diff(seconds.integral[beside[0], 3:5], axis=0)
    noise = robust_sigma(steps - np.median(steps, axis=0))
    noise *= np.sqrt(sum(1.0 / len(rows) for rows in beside))
    if np.linalg.norm(expected - before) < 2.0 * JUMP_SIGMAS * noise:
        return None
    return bool(np.linalg.norm(after - expected) < np.linalg.norm(after - before))


def _fault(
    seconds: QuietSeconds, a: int, b: int, reason: Disturbance | None, jump: _Jump, quiet: _Jump
) -> ImuFault:
    unknown = 0.5 * (b - a) * float(np.max(np.abs(jump.slope[:2]))) if reason else 0.0
    turn = float(max(np.max(quiet.value[3:]), SHOCK_TURN_RAD))
    if b - a > LONGEST_S:  # a shake that long may have turned the vehicle for good
        turn = float(np.hypot(turn, np.max(np.abs(jump.value[3:]))))
    return ImuFault(
        start_s=float(seconds.start_s[a]),
        end_s=float(seconds.end_s[b - 1]),
        reason=reason,
        velocity_sigma_m_s=float(np.max(quiet.value[:2])) + unknown,
        turn_sigma_rad=turn if reason else 0.0,
    )
