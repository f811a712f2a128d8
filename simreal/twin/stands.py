"""Where a run stands, rolls and flies: the stretches that its twin's motion is made of.

Two judges. A unit that can gyrocompass is judged by its navigation solution
(`alignment.motion.stillness`), up to the first epoch in the air. After that, and for units whose
free solution runs away (mems), the raw rows of each second are held against the first rest, and a
quiet stretch counts as standing only where GNSS or odometer say so, or, without either, where the
speed summed up from the forward accelerometer since the last stand has come back.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.coarse import RestMeans
from alignment.motion.excursions import PUSHED
from alignment.motion.stillness import AIRBORNE, DISTURBED, TAKE_OFF_M_S, Motion
from ins.records import Run
from simreal.evidence.seconds import Seconds

# of a second against the first rest: thermal drift and slope of the apron
QUIET_RATE_RAD_S, QUIET_FORCE_M_S2 = 5e-3, 0.15
QUIET_SIGMAS = 8.0
MARGIN_S = 5.0  # a stand is taken this much shorter at either end: motion begins before it is seen
SHORTEST_STAND_S, SHORTEST_MOVE_S = 6.0, 8.0
GNSS_STILL_M_S, ODOMETER_STILL_M_S = 0.5, 0.15
# summed speed of a stand: at once, and for each second since the last one
SUMMED_M_S, SUMMED_M_S2 = 1.0, 0.02
LONGEST_PUSH_S = 150.0  # a tug's push with its guard; what shakes for longer is wind
BIAS_S = 300.0
OUTLIER = 6.0
CLIMBED_M = 8.0  # GNSS height above the last stand of a vehicle that has left the ground


@dataclass(frozen=True, kw_only=True)
class Stood:
    """A stand: its roll and pitch, mean specific force (3,), and mean rate (3,) over so many of its
    last seconds.
    """

    roll_rad: float
    pitch_rad: float
    force_m_s2: NDArray
    rate_rad_s: NDArray
    seconds: float


def find_stands(
    run: Run, seconds: Seconds, means: RestMeans, rest: tuple[float, float], motion: Motion | None
) -> list[tuple[float, float]]:
    """Start and end [s] of each standing stretch, in order; the first begins with the log.

    seconds: of the log; means: of the first rest; motion: of the navigation solution, None: the raw
    judge for all of it.
    """
    found: list[tuple[float, float]] = []
    judged_to = rest[0]
    if motion is not None:
        found, judged_to = _by_navigation(motion)
    if judged_to < run.imu.end_s - SHORTEST_STAND_S:
        found = _joined(found, _by_rows(run, seconds, means, rest, judged_to))
    found = found or [rest]
    found[0] = (run.imu.start_s, found[0][1])
    return _shortened(found, run.imu.end_s)


def airborne(run: Run, time_s: NDArray, v_n_m_s: NDArray, ground_m: float) -> NDArray:
    """Which epochs (n,) of a moving stretch are in the air: by phase, by speed, or by GNSS height
    above the last stand.
    """
    up = np.linalg.norm(v_n_m_s[:, :2], axis=1) > TAKE_OFF_M_S
    if run.gnss is not None:
        up |= np.interp(time_s, run.gnss.time_s, run.gnss.height_m) > ground_m + CLIMBED_M
    for phase in run.phases:
        if phase.phase == "flight":
            up |= (time_s > phase.start_s) & (time_s <= phase.end_s)
    return up


def _by_navigation(motion: Motion) -> tuple[list[tuple[float, float]], float]:
    """Stands up to the first epoch in the air, and the time of that (end of the solution where it
    never flies).
    """
    up = np.flatnonzero(motion.kind == AIRBORNE)
    count = int(up[0]) if up.size else len(motion.kind)
    still = motion.kind <= DISTURBED
    for a, b in _runs((motion.kind == DISTURBED) & (motion.cause == PUSHED)):
        still[a:b] = motion.time_s[b - 1] - motion.time_s[a] > LONGEST_PUSH_S
    spans = [
        (float(motion.time_s[max(a - 1, 0)]), float(motion.time_s[b - 1]))
        for a, b in _runs(still[:count])
    ]
    return spans, float(motion.time_s[min(count, len(motion.kind) - 1)])


def _by_rows(
    run: Run, seconds: Seconds, means: RestMeans, rest: tuple[float, float], from_s: float
) -> list[tuple[float, float]]:
    at_rest = (seconds.end_s > rest[0]) & (seconds.end_s <= rest[1])
    quiet = np.ones(len(seconds.end_s), dtype=bool)
    for values, centre, limit in (
        (seconds.mean[:, :3], means.omega_ib_b, QUIET_RATE_RAD_S),
        (seconds.mean[:, 3:], means.f_ib_b, QUIET_FORCE_M_S2),
    ):
        off = np.abs(values - centre)
        sigma = 1.4826 * np.median(off[at_rest], axis=0)
        quiet &= np.all(off <= np.maximum(QUIET_SIGMAS * sigma, limit), axis=1)
    found: list[tuple[float, float]] = []
    for a, b in _runs(quiet & (seconds.end_s > from_s)):
        span = (float(seconds.end_s[a] - 1.0), float(seconds.end_s[b - 1]))
        since = max([end for _, end in found] or [rest[0] if from_s <= rest[0] else from_s])
        if span[1] - span[0] >= SHORTEST_STAND_S and _stands(run, seconds, means, span, since):
            found.append(span)
    return found


def _stands(
    run: Run, seconds: Seconds, means: RestMeans, span: tuple[float, float], since_s: float
) -> bool:
    """Whether a quiet stretch is a stand: by the speeds logged in it, by a phase, by the speed
    summed up since `since_s`.
    """
    evidence = []
    if run.gnss is not None:
        evidence.append(
            (run.gnss.time_s, np.linalg.norm(run.gnss.v_n_m_s[:, :2], axis=1), GNSS_STILL_M_S)
        )
    if run.odometer is not None:
        evidence.append((run.odometer.time_s, np.abs(run.odometer.speed_m_s), ODOMETER_STILL_M_S))
    for time_s, speed, limit in evidence:
        inside = (time_s > span[0]) & (time_s <= span[1])
        if inside.any():
            return bool(np.median(speed[inside]) < limit)
    if any(
        p.phase == "parked" and p.start_s < 0.5 * (span[0] + span[1]) <= p.end_s for p in run.phases
    ):
        return True
    rows = (seconds.end_s > since_s) & (seconds.end_s <= span[0])
    summed = float(np.sum(seconds.mean[rows, 3] - means.f_ib_b[0]))
    return abs(summed) < SUMMED_M_S + SUMMED_M_S2 * max(span[0] - since_s, 0.0)


def _joined(
    first: list[tuple[float, float]], later: list[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Both lists as one; stretches that touch or overlap are one."""
    out: list[tuple[float, float]] = []
    for span in sorted([*first, *later]):
        if out and span[0] <= out[-1][1] + 1e-6:
            out[-1] = (out[-1][0], max(out[-1][1], span[1]))
        else:
            out.append(span)
    return out


def _shortened(spans: list[tuple[float, float]], end_s: float) -> list[tuple[float, float]]:
    """Each stand less the margin beside motion; those too short to be one, and moves too short, are
    left out.
    """
    out: list[tuple[float, float]] = []
    for k, (a, b) in enumerate(spans):
        margin = min(MARGIN_S, 0.25 * (b - a))
        a, b = (a if k == 0 else a + margin), (b if b >= end_s - 1.5 else b - margin)
        b = end_s if b >= end_s - 1.5 else b
        if k > 0 and b - a < SHORTEST_STAND_S:
            continue
        if out and a - out[-1][1] < SHORTEST_MOVE_S:
            out[-1] = (out[-1][0], b)
        else:
            out.append((a, b))
    if 0.0 < end_s - out[-1][1] < SHORTEST_MOVE_S:
        out[-1] = (out[-1][0], end_s)
    return out


def level_and_rate(seconds: Seconds, start_s: float, end_s: float) -> Stood:
    """Attitude and rates of a stand; seconds beyond OUTLIER robust sigmas of the median (bumps) do
    not count.
    """
    rows = slice(*np.searchsorted(seconds.end_s, [start_s + 1.0, end_s + 1e-6]))
    last = slice(max(rows.start, rows.stop - round(BIAS_S)), rows.stop)
    x, y, z = force = _clipped_mean(seconds.mean[rows, 3:])
    return Stood(
        roll_rad=float(np.arctan2(-y, -z)),
        pitch_rad=float(np.arctan2(x, np.hypot(y, z))),
        force_m_s2=force,
        rate_rad_s=_clipped_mean(seconds.mean[last, :3]),
        seconds=float(last.stop - last.start),
    )


def _clipped_mean(values: NDArray) -> NDArray:
    off = np.abs(values - np.median(values, axis=0))
    kept = off <= OUTLIER * 1.4826 * np.median(off, axis=0) + 1e-12
    return np.asarray(np.sum(values * kept, axis=0) / np.maximum(kept.sum(axis=0), 1))


def _runs(mask: NDArray) -> list[tuple[int, int]]:
    """[start, end) of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2])]
