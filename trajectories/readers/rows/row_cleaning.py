"""Which rows of a raw log are good: the clock set right where it wrapped, filler, damaged and late
rows named.

Nothing is made up for a row that is missing or dropped; a gap that a run may not hold ends in an
InputError that says which stretch could be taken instead.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ins.records import InputError
from trajectories.readers.rows.clocks import going_on
from trajectories.runs.checks import MAX_GAP_S
from trajectories.runs.text_rows import LISTED_ROWS, MAX_BAD, MENDED_LINES

PLAUSIBLE_RAD_S = 100.0  # beyond any gyro: 5700 deg/s
PLAUSIBLE_M_S2 = 2000.0  # beyond any accelerometer: 200 g
# behind the latest row before it: more is a clock set back, or the rows of another log; chosen:
# ten times the longest gap of a run (docs/log_formats.md)
MAX_LATE_S = 10.0
# before the median of the five rows around it: between rows that were written 2 and 3 places
# early; garbled ones lie anywhere (tests/trajectories/readers/test_clocks.py fails at twice of
# it)
AHEAD_INTERVALS = 2.5
BACKWARD = "time repeats or goes back"
NOT_FINITE_ROW = "missing or not finite"
# Dropped, but no sign of a wrong map.
OTHERS = "no value of the imu (rows of other streams)"
NOT_COUNTED = ("filler", "repeat an earlier row", "time is zero", OTHERS)


@dataclass(frozen=True, kw_only=True)
class CleanRows:
    """rows (n,): indices in the log, in the order of time; time_s (n,): their times; notes: what
    was dropped or changed.

    clock_s: the times of all rows of the log, going on where its clock started again, by the
    periods `wraps_s`; others: rows that have a time and no value of the imu.
    """

    rows: NDArray
    time_s: NDArray
    notes: list[str]
    clock_s: NDArray
    wraps_s: tuple[float, ...]
    others: NDArray


class LogGapError(InputError):
    """A log with gaps that a run may not hold.

    stretches: (from, to) of those without one, by the log's own clock [s].
    """

    def __init__(self, line: str, stretches: tuple[tuple[float, float], ...]) -> None:
        super().__init__(line)
        self.stretches = stretches


@dataclass(frozen=True, kw_only=True)
class LogSpan:
    """Log time to take [s]; `base_s` is what the log's own clock shows at time 0 of the columns."""

    from_s: float = -np.inf
    to_s: float = np.inf
    base_s: float = 0.0


def clean_rows(time_s: NDArray, w: NDArray, f: NDArray, stretch: LogSpan, label: str) -> CleanRows:
    """The good rows of a stretch, w [rad/s] and f [m/s2] (n, 3). InputError where too many are
    damaged, or a gap is left.
    """
    time_s, wraps = going_on(time_s)
    notes = [
        f"{label}: clock starts again at row {row + 1} ({name}): {period_s:.6f} s added from there"
        for row, period_s, name in wraps[:LISTED_ROWS]
    ] + (
        [f"{label}: and at {len(wraps) - LISTED_ROWS} more rows"]
        if len(wraps) > LISTED_ROWS
        else []
    )
    with np.errstate(invalid="ignore"):
        outside = (time_s < stretch.from_s - stretch.base_s) | (
            time_s > stretch.to_s - stretch.base_s
        )
    inside = np.flatnonzero(~outside)
    if inside.size < 2 <= time_s.size and np.isfinite(time_s).any():
        span = (
            f"{np.nanmin(time_s) + stretch.base_s:.3f} to"
            f" {np.nanmax(time_s) + stretch.base_s:.3f} s"
        )
        raise InputError(
            f"{label}: {inside.size} rows in the stretch that was asked for (from_s, to_s), the log"
            f" has {span}"
        )
    if inside.size < time_s.size:
        notes.append(
            f"{label}: {time_s.size - inside.size} rows outside the stretch that was asked for"
            " (from_s, to_s)"
        )
    all_inside = inside.size == time_s.size
    parts = (time_s, w, f) if all_inside else (time_s[inside], w[inside], f[inside])
    kept, faults, resorted = _judged(*parts)
    dropped = sum(rows.size for why, rows in faults.items() if why not in NOT_COUNTED)
    if dropped > max(MENDED_LINES, MAX_BAD * inside.size):
        worst = max(faults, key=lambda why: 0 if why in NOT_COUNTED else faults[why].size)
        hint = _hint(worst, inside[faults[worst]], time_s, w, f)
        raise InputError(
            f"{label}: {dropped} of {inside.size} rows are damaged (first row"
            f" {inside[faults[worst][0]] + 1}: {worst}): {hint}"
        )
    _refuse_lost_time(parts[0], faults[BACKWARD], inside, label)
    notes += [
        f"{label}: {row_ranges(inside[rows])} dropped: {why}"
        for why, rows in faults.items()
        if rows.size
    ]
    if resorted.size:
        notes.append(
            f"{label}: {row_ranges(inside[resorted])} written late, put back in the order of time"
        )
    rows = kept if all_inside else inside[kept]
    if (steps := np.diff(time_s[rows])).size == 0:
        raise InputError(f"{label}: {rows.size} usable rows, needed at least 2 with rising times")
    _refuse_gaps(steps, time_s[rows] + stretch.base_s, rows, label)
    periods = tuple(period_s for _, period_s, _ in wraps)
    return CleanRows(
        rows=rows,
        time_s=time_s[rows],
        notes=notes,
        clock_s=time_s,
        wraps_s=periods,
        others=inside[faults[OTHERS]],
    )


def are_all(rows: NDArray, count: int) -> bool:
    """Whether indices are all from 0 to `count`, in order."""
    return rows.size == count and (count == 0 or rows[0] == 0) and bool(np.all(np.diff(rows) == 1))


def _hint(worst: str, rows: NDArray, time_s: NDArray, w: NDArray, f: NDArray) -> str:
    """What may be wrong with a log most of whose damaged rows have one fault."""
    if worst == BACKWARD:
        stamped = np.flatnonzero(np.isfinite(time_s))
        with np.errstate(over="ignore"):
            steps = np.diff(time_s[stamped])
        if np.median(steps) == 0:
            return "stamps too coarse? rate_hz in the map instead of [time]"
        k = int(np.argmin(steps))
        told = _goes_back(-steps[k], stamped[k + 1] + 1)
        return f"{told} --to-s or --from-s takes one side"
    if worst == NOT_FINITE_ROW:
        gyro, accel = (int(np.isfinite(v).all(axis=1).sum()) for v in (w, f))
        if max(gyro, accel) > 1.5 * min(gyro, accel):
            return (
                f"{gyro} rows have all gyros, {accel} all accelerometers: of two rates? needed rows"
                " that have both"
            )
    return "wrong columns or units?"


def _goes_back(by_s: float, row: int) -> str:
    return f"clock goes back by {by_s:.3f} s at row {row}: set back, or logs joined?"


def _judged(time_s: NDArray, w: NDArray, f: NDArray) -> tuple[NDArray, dict[str, NDArray], NDArray]:
    """Indices of the good rows in the order of time; the others by what is wrong with them; the
    good ones written late.
    """
    stamped, seen = np.isfinite(time_s), (np.isfinite(w), np.isfinite(f))
    finite = stamped & seen[0].all(axis=1) & seen[1].all(axis=1)
    others = stamped & ~seen[0].any(axis=1) & ~seen[1].any(axis=1)
    with np.errstate(invalid="ignore"):
        sane = (np.abs(w) < PLAUSIBLE_RAD_S).all(axis=1) & (np.abs(f) < PLAUSIBLE_M_S2).all(axis=1)
    filler, empty, unstamped = _filler(time_s, (w == 0).all(axis=1) & (f == 0).all(axis=1))
    dropped = filler | unstamped | others
    whole = np.flatnonzero(finite & sane & ~empty & ~dropped)
    ahead, early = _ahead(time_s[whole])
    jumps, held, whole = whole[ahead], whole[early], whole[~(ahead | early)]
    latest = np.concatenate([[-np.inf], np.maximum.accumulate(time_s[whole])[:-1]])
    late = time_s[whole] <= latest
    kept, rest = whole[~late], np.sort(np.concatenate([whole[late], held]))
    same = _repeats(time_s, w, f, kept, rest)
    near = np.setdiff1d(rest[~same], whole[time_s[whole] < latest - MAX_LATE_S])
    back = _fitting(time_s, kept, near)
    faults = {
        "filler": np.flatnonzero(filler),
        "time is zero": np.flatnonzero(unstamped & ~filler),
        OTHERS: np.flatnonzero(others & ~filler & ~unstamped),
        NOT_FINITE_ROW: np.flatnonzero(~finite & ~dropped),
        f"beyond {PLAUSIBLE_RAD_S:g} rad/s or {PLAUSIBLE_M_S2:g} m/s2": np.flatnonzero(
            finite & ~sane & ~dropped
        ),
        "all six values are zero": np.flatnonzero(empty & finite & ~dropped),
        "time jumps ahead and comes back": jumps,
        "repeat an earlier row": rest[same],
        BACKWARD: np.setdiff1d(rest[~same], back),
    }
    merged = np.concatenate([kept, back])
    return merged[np.argsort(time_s[merged], kind="stable")], faults, back


def _filler(time_s: NDArray, empty: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Rows of zeros before the first or after the last real one, all rows of zeros, leading rows
    whose time alone is zero.
    """
    filler, unstamped = np.zeros(time_s.size, dtype=bool), np.zeros(time_s.size, dtype=bool)
    real = np.flatnonzero(~empty)
    if not real.size:
        return filler, empty, unstamped
    filler[: real[0]] = filler[real[-1] + 1 :] = True
    stamped = np.flatnonzero(np.isfinite(time_s) & (time_s != 0.0))
    if stamped.size and time_s[stamped[0]] > MAX_GAP_S:
        unstamped[: stamped[0]] = time_s[: stamped[0]] == 0.0
    return filler, empty, unstamped


def _ahead(time_s: NDArray) -> tuple[NDArray, NDArray]:
    """Which times are later than the median of the five around them by more than a gap (garbled,
    one at a time), and which by some intervals: garbled or written early.

    Left in, such a time would make all that follow it go back.
    """
    none = np.zeros(time_s.size, dtype=bool)
    steps = np.diff(time_s)
    if time_s.size < 5 or not np.any(steps > 0):
        return none, none
    with np.errstate(over="ignore", invalid="ignore"):
        off = time_s - median_filter(time_s, size=5, mode="mirror")
        ahead = off > MAX_GAP_S
        early = (off > AHEAD_INTERVALS * np.median(steps[steps > 0])) & ~ahead
    early[-2:] = False  # what the rows behind them would be is not known
    return ahead, early


def _repeats(time_s: NDArray, w: NDArray, f: NDArray, kept: NDArray, late: NDArray) -> NDArray:
    """Which of the late rows are one of the kept rows once more, value for value."""
    if not late.size:
        return np.zeros(0, dtype=bool)
    twin = kept[np.clip(np.searchsorted(time_s[kept], time_s[late]), 0, kept.size - 1)]
    return (
        (time_s[twin] == time_s[late])
        & (w[twin] == w[late]).all(axis=1)
        & (f[twin] == f[late]).all(axis=1)
    )


def _fitting(time_s: NDArray, kept: NDArray, late: NDArray) -> NDArray:
    """The late rows whose times fill a hole in those of the kept ones, each at least half an
    interval from its neighbours.
    """
    if not late.size or kept.size < 3:
        return late[:0]
    nominal_s = float(np.median(np.diff(time_s[kept])))
    order = late[np.argsort(time_s[late], kind="stable")]
    both = np.sort(np.concatenate([time_s[kept], time_s[order]]))
    at = np.searchsorted(both, time_s[order])
    room = np.diff(np.concatenate([[-np.inf], both, [np.inf]]))
    return order[
        (room[at] > 0.5 * nominal_s) & (room[at + 1] > 0.5 * nominal_s) & np.isfinite(room[at])
    ]


def _refuse_lost_time(time_s: NDArray, late: NDArray, inside: NDArray, label: str) -> None:
    """InputError where rows one after the other, for longer than a gap may be, carry times that
    were written already and are no copies: the clock was set back, and what happened meanwhile is
    a hole in the motion that no time shows.
    """
    late = np.sort(late)
    for block in np.split(late, np.flatnonzero(np.diff(late) > 1) + 1):
        if block.size and time_s[block[-1]] - time_s[block[0]] > MAX_GAP_S:
            before_s, first_s = np.nanmax(time_s[: block[0]]), time_s[block[0]]
            raise InputError(
                f"{label}: {_goes_back(before_s - first_s, inside[block[0]] + 1)} {block.size} rows"
                f" have times that were written before, needed at most {MAX_GAP_S:g} s of such;"
                " --to-s or --from-s takes one side"
            )


def _refuse_gaps(steps: NDArray, log_s: NDArray, rows: NDArray, label: str) -> None:
    """InputError naming the first gap that a run may not hold, and the longest stretch without
    one.
    """
    gaps = np.flatnonzero(steps > MAX_GAP_S)
    if not gaps.size:
        return
    k = int(gaps[0])
    starts, ends = np.concatenate([[0], gaps + 1]), np.concatenate([gaps, [log_s.size - 1]])
    begins_s, stops_s = np.floor(log_s[starts] * 1e3) / 1e3, np.ceil(log_s[ends] * 1e3) / 1e3
    best = int(np.argmax(log_s[ends] - log_s[starts]))
    start_s, end_s = begins_s[best], stops_s[best]
    more = f" and {gaps.size - 1} more" if gaps.size > 1 else ""
    raise LogGapError(
        f"{label}: gap of {steps[k]:.3f} s after row {rows[k] + 1} (log time {log_s[k]:.3f}"
        f" s){more}, needed at most {MAX_GAP_S:g} s; the longest stretch without one: --from-s"
        f" {start_s:.3f} --to-s {end_s:.3f} ({end_s - start_s:.1f} s), or --split for all",
        tuple(zip(begins_s.tolist(), stops_s.tolist())),
    )


def row_ranges(rows: NDArray) -> str:
    """Rows by number, from 1: "row 7" or "rows 7, 9-12"; long lists are cut."""
    rows = np.sort(rows)
    breaks = np.flatnonzero(np.diff(rows) > 1) + 1
    parts = [
        f"{p[0] + 1}" + (f"-{p[-1] + 1}" if len(p) > 1 else "") for p in np.split(rows, breaks)
    ]
    text = ", ".join(parts[:LISTED_ROWS]) + (
        f" and {len(parts) - LISTED_ROWS} more stretches" if len(parts) > LISTED_ROWS else ""
    )
    return ("row " if rows.size == 1 else "rows ") + text
