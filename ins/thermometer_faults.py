"""What can be wrong with logged thermometers, and which readings may still be trusted.

One judge for `recal check`, which lists it, and for the recalibration, which leaves it out. A fault
is judged against the column's own past, the other thermometers of the run and what a housing can
do; never against the true bias. Temperatures in degC, times in s throughout.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ins.records import PIECE_ROWS
from ins.robust import norm, runs_of_true, white_sigma

PLAUSIBLE_MEDIAN_degC = (
    -60.0,
    70.0,
)  # of a run's median where no table says that the unit works beyond
KELVIN_degC = 150.0  # a median above this is no Celsius; 20 degC are 293 K, and 68 degF
# steps at least so large are worth a remark; chosen: a step is then the change of a bin of 5 min
# at 0.05 degC/min
COARSE_degC = 0.25
FASTEST_degC_s = 0.05  # 3 degC/min: faster no housing changes
# the fastest housing (FASTEST_degC_s) takes 10 s for 0.5 degC; 10 sigmas of the readings' own
# noise; more than two steps of the thermometer and less than three
JUMP_degC, READING_JUMP_SIGMAS, JUMP_STEPS = 0.5, 10.0, 2.5
# a step that is less than half of what the temperature changes by, the same way, from 10 s before
# to 10 s after it is no jump: a board that the wash of a propeller cools loses 2.3 degC in 20 s and
# 0.9 of them in 3 s (a public copter log); a log that has fewer rows than 4 in 10 s does not tell
AROUND_S, AROUND_ROWS, SHARE_OF_CHANGE = 10.0, 4, 0.5
# a jump that comes back within this leaves the rest of the log as it was; chosen: 15 min, short
# beside a session of an hour
TRANSIENT_S = 900.0
# Readings that differ by less are one: a second's mean of 20 readings of 21.1111 degC (70 degF)
# differs from the next one by 4e-15, and a thermometer that was stuck all along looked alive
READING_DECIMALS = 9
STUCK_S, LONG_STUCK_S = 120.0, 600.0  # FASTEST_degC_s passes 6 and 30 degC meanwhile
# of a reading that is held: nats by which its own noise denies it, and steps that its warming
# should have passed meanwhile; chosen: noise holds so long once in e^20; no sound unit of 600
# (tests/scenarios/thermal_faults.py) missed 10 steps
DENIED_NATS, MISSED_STEPS = 20.0, 15.0
# by which its noise is judged; chosen: the slowest log, of 10 s, has 30 rows in it
NOISE_BEFORE_S = 300.0
# by whose last two thirds its warming is judged: those whose last third passes three steps; a chip
# in the wash of a propeller settles within 20 s, a block within an hour
BEFORE_SPANS_S = tuple(6.0 * 2.0 ** (0.5 * k) for k in range(14))
# rounding by half a step is then 17 % of its slope; chosen: below that of half an hour's decay
THIRD_STEPS = 3.0
# no warm-up ends faster, unless it was seen to: the block's (trajectories/simulator/thermal.py)
WARM_UP_S = 1500.0
# of the times between changes that are no longer than one reading lasts; chosen: bursts
# are fewer than 1 in 10
QUICK_SHARE = 0.1
# changes in NOISE_BEFORE_S, and readings held: with fewer nothing is known; chosen: 3 a half
FEWEST_CHANGES = 6
HOLE_S = 60.0  # FASTEST_degC_s passes 3 degC meanwhile
# of a log, by which readings may go on after its end: a recorder writes what it still holds;
# chosen: the sessions of one day differ by more
OVERHANG_SHARE = 0.1
LONG_ENOUGH_S = 300.0  # of a log that is judged so; a session needs 5 min at rest
# no two thermometers of one unit differ by more for long; above -25 degC, Fahrenheit for Celsius
# does (0.8 T + 32)
OTHER_SCALE_degC = 12.0
# of a log: by then a unit that came in cold has warmed up; of an hour, the last 15 min
LAST_SHARE = 0.25
# of the readings of the air that are its coldest; chosen: spikes are fewer, and a unit cools within
# a twentieth of a log to the air of a cruise that is no longer
COLDEST_SHARE = 0.05
# a guessed scale that brings them so near is named: less than half of the 12 above
SAME_SCALE_degC = 5.0
SPIKE_ROWS = 11  # window of the running median: bursts of up to five rows are spikes; (11 - 1) / 2
SCALES = (
    ("Fahrenheit?", lambda T: (T - 32.0) / 1.8),
    ("kelvin?", lambda T: T - 273.15),
    ("ten times too large?", lambda T: T / 10.0),
    ("ten times too small?", lambda T: T * 10.0),
    ("degC read as Fahrenheit?", lambda T: 1.8 * T + 32.0),
)


class FaultKind(StrEnum):
    """What can be wrong with a thermometer."""

    ABSENT = "absent"
    ZERO = "zero"
    SPIKE = "spike"
    STUCK = "stuck"
    CONSTANT = "constant"
    JUMP = "jump"
    JUMP_OF_UNKNOWN_SIDE = "jump_of_unknown_side"
    SCALE = "scale"
    IMPLAUSIBLE = "implausible"
    COARSE = "coarse"
    HOLE = "hole"


# faults after which no reading of the column is trusted
OF_THE_COLUMN = (
    FaultKind.ABSENT,
    FaultKind.SCALE,
    FaultKind.IMPLAUSIBLE,
    FaultKind.JUMP_OF_UNKNOWN_SIDE,
)


@dataclass(frozen=True, kw_only=True)
class ThermometerFault:
    """A fault of a thermometer.

    Parameters
    ----------
    column : str
        Its name in the file; "temperature" for all.
    kind : FaultKind
    start_s, end_s : float
        From when to when it is seen.
    text : str
        What is seen, for people.
    """

    column: str
    kind: FaultKind
    start_s: float
    end_s: float
    text: str


@dataclass(frozen=True, kw_only=True)
class ThermometerCheck:
    """What the judge of thermometers found.

    Parameters
    ----------
    faults : tuple of ThermometerFault
        In the order found.
    valid : dict of ndarray of bool, shape (n,)
        By column: rows to be trusted.
    resolution_degC : dict of float
        By column: step of its readings, 0 where none is seen.
    """

    faults: tuple[ThermometerFault, ...]
    valid: dict[str, NDArray]
    resolution_degC: dict[str, float]


class _Judge:
    """The columns as the faults are taken out of them one after the other."""

    def __init__(self, time_s: NDArray, columns: Mapping[str, NDArray]) -> None:
        self.t = time_s
        self.columns = {name: np.round(v, READING_DECIMALS) for name, v in columns.items()}
        self.valid = {name: np.isfinite(v) for name, v in columns.items()}
        self.step = {
            name: reading_step_degC(v[self.valid[name]]) for name, v in self.columns.items()
        }
        self.faults: list[ThermometerFault] = []

    def add(self, name: str, kind: FaultKind, rows: NDArray, text: str) -> None:
        at = self.t[rows] if rows.size else self.t
        fault = ThermometerFault(
            column=name, kind=kind, start_s=float(at[0]), end_s=float(at[-1]), text=text
        )
        self.faults.append(fault)

    def drop(self, name: str, kind: FaultKind, rows: NDArray, text: str) -> None:
        """Say it, and trust these rows no more."""
        self.add(name, kind, rows, text)
        self.valid[name][rows] = False

    def rows(self, name: str) -> NDArray:
        return np.flatnonzero(self.valid[name])

    def values(self, name: str) -> NDArray:
        return self.columns[name][self.valid[name]]

    def limit(self, name: str, values: NDArray) -> float:
        """A change that noise and resolution do not explain."""
        noise = white_sigma(values) if values.size > 2 else 0.0
        return float(max(JUMP_degC, JUMP_STEPS * self.step[name], READING_JUMP_SIGMAS * noise))


def check_thermometers(
    time_s: NDArray,
    columns: Mapping[str, NDArray],
    *,
    plausible_degC: tuple[float, float] = PLAUSIBLE_MEDIAN_degC,
    constant: bool = False,
) -> ThermometerCheck:
    """Judge the thermometers of a run.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Times of the rows.
    columns : mapping of ndarray, shape (n,)
        Readings [degC] by their names in the file (gyro_x_degC ... block_degC). Columns gyro_* are
        compared with each other and with accel_* and block; ambient_degC is not part of the unit.
    plausible_degC : (float, float)
        Within what the median of a gyro's thermometer must lie.
    constant : bool
        Whether one that never changes, like all others, is accepted as it is.

    Returns
    -------
    check : ThermometerCheck

    Notes
    -----
    Not to be found: a fault that all thermometers of the run share and that keeps them plausible.
    """
    judge = _Judge(time_s, columns)
    _holes(judge)
    for name in columns:
        if not judge.valid[name].any():
            judge.add(name, FaultKind.ABSENT, judge.rows(name), "has no reading")
            continue
        _zeros(judge, name)
        _spikes(judge, name)
    _scales(judge, plausible_degC)
    for name in columns:
        if constant and _never_changes(judge, name):
            _accept_constant(judge, name)
        elif not name.startswith("ambient"):
            _stuck(judge, name)
    _stuck_together(judge)
    for name in columns:
        _jumps(judge, name)
    for name, step in judge.step.items():
        if step >= COARSE_degC:
            judge.add(
                name,
                FaultKind.COARSE,
                judge.rows(name),
                f"has steps of {step:g} degC: its rate of change is poorly known",
            )
    return ThermometerCheck(
        faults=tuple(judge.faults), valid=judge.valid, resolution_degC=judge.step
    )


def reading_step_degC(values: NDArray) -> float:
    """The step of a rounded thermometer.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Finite readings [degC].

    Returns
    -------
    step_degC : float
        0 where the readings lie on no common grid or hardly ever repeat.

    Examples
    --------
    >>> reading_step_degC(np.array([20.0, 20.5, 20.5, 21.0, 21.0, 20.0, 20.0, 20.5]))
    0.5
    """
    levels = np.unique(np.round(values, 9))
    if levels.size < 2 or levels.size > 0.5 * values.size:
        return 0.0
    step = float(np.min(np.diff(levels)))
    counts = (levels - levels[0]) / step
    even = step > 1e-6 and np.max(np.abs(counts - np.round(counts))) < 0.02
    return step if even else 0.0


def _holes(judge: _Judge) -> None:
    gaps = np.diff(judge.t)
    if not gaps.size:
        return
    for k in np.flatnonzero(gaps > max(HOLE_S, 5.0 * float(np.median(gaps)))):
        text = f"no reading from {judge.t[k]:.1f} to {judge.t[k + 1]:.1f} s ({gaps[k]:.0f} s)"
        judge.add("temperature", FaultKind.HOLE, np.array([k, k + 1]), text)


def _zeros(judge: _Judge, name: str) -> None:
    """Readings of exactly 0 beside others that are far from it."""
    rows, values = judge.rows(name), judge.values(name)
    zero = values == 0.0
    if zero.all():
        if name.startswith("ambient"):  # a day at freezing point
            return
        judge.drop(
            name, FaultKind.ABSENT, rows, f"is exactly 0 in all {rows.size} rows: missing values?"
        )
        return
    limit, missing = judge.limit(name, values[~zero]), np.zeros(rows.size, dtype=bool)
    for a, b in runs_of_true(zero):
        beside = values[[k for k in (a - 1, b) if 0 <= k < values.size]]
        missing[a:b] = np.max(np.abs(beside)) > limit
    if missing.any():
        judge.drop(
            name,
            FaultKind.ZERO,
            rows[missing],
            f"is exactly 0 in {int(missing.sum())} rows: missing values?",
        )


def _spikes(judge: _Judge, name: str) -> None:
    """Bursts of up to five rows far from their neighbours' median."""
    from scipy.ndimage import median_filter  # half of the time that reading a broken run takes

    rows = judge.rows(name)
    if rows.size < SPIKE_ROWS:
        return
    values, half = judge.values(name), SPIKE_ROWS // 2
    around = median_filter(np.pad(values, half, mode="reflect", reflect_type="odd"), SPIKE_ROWS)[
        half:-half
    ]
    far = np.abs(values - around) > judge.limit(name, values)
    if far.any():
        worst = int(np.argmax(np.abs(values - around)))
        text = (
            f"has {int(far.sum())} readings far from their neighbours, {values[worst]:g} at"
            f" {judge.t[rows[worst]]:.1f} s"
        )
        judge.drop(name, FaultKind.SPIKE, rows[far], text)


def _stuck(judge: _Judge, name: str) -> None:
    """One reading for minutes while the unit's other thermometers moved."""
    rows = judge.rows(name)
    values, t = judge.values(name), judge.t[rows]
    changes = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [values.size]])
    begins, ends = changes[:-1], changes[1:]
    held = np.where(ends > begins, t[ends - 1] - t[begins], 0.0) if t.size else np.zeros(1)
    for k in np.flatnonzero(held > STUCK_S):
        a, b, lasts = int(begins[k]), int(ends[k]), float(held[k])
        span = np.arange(rows[a], rows[b - 1] + 1)
        moved = _others_moved(judge, name, span)
        need = 1.5 * _step_or_others(judge, name) + (0.3 if lasts > LONG_STUCK_S else 0.5)
        never = lasts > LONG_STUCK_S and not moved and changes.size == 2
        if never or (moved and min(moved) > need) or _missed_its_changes(judge, name, span, lasts):
            text = f"is stuck at {values[a]:g} degC from {t[a]:.0f} s for {lasts:.0f} s"
            judge.drop(name, FaultKind.STUCK, rows[a:b], text)


def _stuck_together(judge: _Judge) -> None:
    """One fault in place of those of all gyros from one time on: it is the unit's, not theirs. A
    third gyro that holds its reading as long as two that are stuck is stuck with them.
    """
    stuck = [f for f in judge.faults if f.kind is FaultKind.STUCK]
    gyros = [name for name in judge.columns if name.startswith("gyro_")]
    for first in [f for f in stuck if f.column.startswith("gyro_")]:
        alike = [
            f
            for f in stuck
            if abs(f.start_s - first.start_s) < STUCK_S and abs(f.end_s - first.end_s) < STUCK_S
        ]
        named = {f.column for f in alike}
        start_s = max(f.start_s for f in alike)
        end_s = min(f.end_s for f in alike)
        rest = [name for name in gyros if name not in named]
        if len(rest) > 1 or not all(_holds(judge, name, start_s, end_s) for name in rest):
            continue
        for name in rest:
            judge.valid[name][(judge.t >= start_s) & (judge.t <= end_s)] = False
        judge.faults = [f for f in judge.faults if f not in alike]
        text = f"all gyro thermometers are stuck from {start_s:.0f} s for {end_s - start_s:.0f} s"
        inside = np.flatnonzero((judge.t >= start_s) & (judge.t <= end_s))
        judge.add("temperature", FaultKind.STUCK, inside, text)
        return


def _holds(judge: _Judge, name: str, start_s: float, end_s: float) -> bool:
    """Whether a thermometer reads one value over a span."""
    inside = (judge.t >= start_s) & (judge.t <= end_s) & judge.valid[name]
    return bool(inside.any()) and float(np.ptp(judge.columns[name][inside])) == 0.0


def _missed_its_changes(judge: _Judge, name: str, span: NDArray, lasts_s: float) -> bool:
    """Whether a reading held over the rows `span` should have changed, by what it did before."""
    rows = judge.rows(name)
    until_s = judge.t[span[0]]
    kept = rows[(rows <= span[0]) & (judge.t[rows] >= until_s - max(BEFORE_SPANS_S))]
    t, values = judge.t[kept], judge.columns[name][kept]
    recent = t >= until_s - NOISE_BEFORE_S
    steps = np.diff(values[recent])
    changed_s = t[recent][1:][steps != 0.0]
    if min(changed_s.size, span.size) < FEWEST_CHANGES:
        return False
    step = judge.step[name] or float(np.median(np.abs(steps[steps != 0.0])))
    # one reading may be written many times
    reading_s = float(np.quantile(np.diff(changed_s), QUICK_SHARE))
    readings = min(lasts_s / reading_s, span.size)  # a hole holds none
    nats = _by_noise(t[recent], values[recent], step, reading_s) * readings
    if nats > DENIED_NATS:
        return True
    if step >= COARSE_degC or _another_lives(judge, name, span):
        return False  # an oven ends its ramp within such a step
    return _by_warming(t, values, step, lasts_s) > MISSED_STEPS


def _by_noise(t: NDArray, values: NDArray, step: float, reading_s: float) -> float:
    """Minus the log of the probability that noise leaves a reading in the middle of its step.

    A reading at the edge of two steps flickers by the least noise: only readings that go back by
    two steps, against the course, tell how large it is. sigma is at least what makes a difference
    of one step as frequent as theirs.
    """
    read = values[np.searchsorted(t, np.arange(t[0], t[-1], reading_s))]
    back = -np.sign(read[-1] - read[0]) * np.diff(read) > 1.5 * step
    half = back.size // 2
    if half < FEWEST_CHANGES:
        return 0.0
    share = 2.0 * min(float(back[:half].mean()), float(back[half:].mean()))
    if not share:
        return 0.0
    sigma = step / (math.sqrt(2.0) * norm.isf(0.5 * min(share, 1.0)))
    return -math.log(math.erf(step / (math.sqrt(8.0) * sigma)))


def _by_warming(t: NDArray, values: NDArray, step: float, lasts_s: float) -> float:
    """Steps that the temperature would have passed, had it gone on with its time constant: the
    fewest of those by spans before.
    """
    missed = []
    for span_s in BEFORE_SPANS_S:
        third_s = span_s / 3.0
        if t[0] > t[-1] - 2.0 * third_s:
            break
        last = _slope(t, values, t[-1] - third_s, t[-1])
        before = _slope(t, values, t[-1] - 2.0 * third_s, t[-1] - third_s)
        if abs(last) * third_s < THIRD_STEPS * step:
            continue
        if last * before <= 0.0:
            return 0.0
        decay = max(np.log(before / last) / third_s, 1.0 / WARM_UP_S)
        at_end = abs(last) * np.exp(-0.5 * decay * third_s)
        missed.append(float(at_end * -np.expm1(-decay * lasts_s) / decay / step))
    return min(missed, default=0.0)


def _slope(t: NDArray, values: NDArray, start_s: float, end_s: float) -> float:
    """Of the line through the readings of a span; 0 where they are too few."""
    inside = (t >= start_s) & (t <= end_s)
    if np.count_nonzero(inside) < 3:
        return 0.0
    since = t[inside] - np.mean(t[inside])
    return float(since @ values[inside] / (since @ since))


def _another_lives(judge: _Judge, name: str, span: NDArray) -> bool:
    """Whether another thermometer of the unit changes in the second half of a span."""
    late = span[span.size // 2 :]
    others = [n for n in judge.columns if n != name and not n.startswith("ambient")]
    for other in others:
        values = judge.columns[other][late][judge.valid[other][late]]
        if values.size and np.ptp(values) > 0.0:
            return True
    return False


def _never_changes(judge: _Judge, name: str) -> bool:
    """One reading throughout, while no other thermometer of the unit moved."""
    values, rows = judge.values(name), judge.rows(name)
    if not values.size or np.ptp(values) > 0.0:
        return False
    return not _others_moved(judge, name, np.arange(rows[0], rows[-1] + 1))


def _accept_constant(judge: _Judge, name: str) -> None:
    """Say that a thermometer never changes."""
    value, t = judge.values(name)[0], judge.t[judge.rows(name)]
    text = f"reads {value:g} degC throughout ({t[-1] - t[0]:.0f} s): accepted as constant"
    judge.add(name, FaultKind.CONSTANT, judge.rows(name), text)


def _others_moved(judge: _Judge, name: str, span: NDArray) -> list[float]:
    """How far each other live thermometer moved over a span for sure: its steps and what is not a
    gyro count less.
    """
    gyros = [n for n in judge.columns if n.startswith("gyro_") and n != name]
    rest = [n for n in judge.columns if n.startswith(("accel_", "block")) and n != name]
    for group in (gyros, rest):
        moved = []
        for other in group:
            kept = judge.valid[other][span]
            v, t = judge.columns[other][span][kept], judge.t[span][kept]
            if v.size < 3 or np.ptp(v) == 0.0:
                continue
            if np.any(np.abs(np.diff(v)) > judge.limit(other, v) + FASTEST_degC_s * np.diff(t)):
                continue  # it jumps itself
            ends = [
                np.median(part) for part in (v[:5], v[v.size // 2 - 2 : v.size // 2 + 3], v[-5:])
            ]
            far = float(np.ptp(ends)) - judge.step[other]
            moved.append(far if group is gyros and name.startswith("gyro_") else far / 3.0)
        if moved:
            return moved if len(moved) > 1 else [moved[0] / 2.0]
    return []


def _step_or_others(judge: _Judge, name: str) -> float:
    """The column's step; of one that never moved, the coarsest of the others'."""
    if np.ptp(judge.values(name)) > 0.0:
        return judge.step[name]
    return max(judge.step.values())


def _jumps(judge: _Judge, name: str) -> None:
    """Steps faster than a housing changes: the span where it comes back soon, else the whole
    column.
    """
    rows = judge.rows(name)
    if rows.size < 4:
        return
    values, t = judge.values(name), judge.t[rows]
    limit = judge.limit(name, values)
    found = np.zeros(rows.size, dtype=bool)
    for lag in (1, 3):
        step = values[lag:] - values[:-lag]
        found[lag:] |= np.abs(step) > limit + FASTEST_degC_s * (t[lag:] - t[:-lag])
    jumps = []
    for a, b in runs_of_true(found):
        after = float(
            np.median(values[b - 1 : b + 4]) - np.median(values[max(a - 6, 0) : max(a, 1)])
        )
        if abs(after) > 0.5 * limit and not _goes_on(t, values, a, b):
            steps = np.diff(values[max(a - 1, 0) : b])
            largest = float(steps[np.argmax(np.abs(steps))])
            size = largest if abs(largest - after) < 0.5 * abs(after) else after
            jumps.append((a, b, size))
    if jumps:
        _drop_jumps(judge, name, rows, jumps)


def _goes_on(t: NDArray, values: NDArray, a: int, b: int) -> bool:
    """Whether a step within rows a to b is part of a larger change, before and after it."""
    first = int(np.searchsorted(t, t[a] - AROUND_S))
    end = int(np.searchsorted(t, t[b - 1] + AROUND_S, side="right"))
    if a - first < AROUND_ROWS or end - b < AROUND_ROWS:
        return False
    change = float(np.median(values[end - 3 : end]) - np.median(values[first : first + 3]))
    steps = [values[k] - values[max(k - lag, 0)] for k in range(a, b) for lag in (1, 3)]
    largest = float(max(steps, key=abs))
    return largest * change > 0.0 and abs(largest) < SHARE_OF_CHANGE * abs(change)


def _drop_jumps(
    judge: _Judge, name: str, rows: NDArray, jumps: list[tuple[int, int, float]]
) -> None:
    t = judge.t[rows]
    k = 0
    while k < len(jumps):
        a, b, size = jumps[k]
        back = jumps[k + 1] if k + 1 < len(jumps) else None
        text = f"jumps by {size:+.1f} degC at {t[a]:.1f} s"
        if (
            back is not None
            and t[back[0]] - t[a] < TRANSIENT_S
            and abs(size + back[2]) < 0.35 * abs(size)
        ):
            judge.drop(
                name, FaultKind.JUMP, rows[a : back[1]], f"{text} and back at {t[back[0]]:.1f} s"
            )
            k += 2
        elif a < SPIKE_ROWS or rows.size - b < SPIKE_ROWS:
            judge.drop(name, FaultKind.JUMP, rows[:a] if a < SPIKE_ROWS else rows[a:], text)
            k += 1
        else:
            judge.drop(
                name,
                FaultKind.JUMP_OF_UNKNOWN_SIDE,
                rows,
                f"{text}: which side is right is not known ({len(jumps)} jumps)",
            )
            return


def _scales(judge: _Judge, plausible_degC: tuple[float, float]) -> None:
    """Kelvin; a column far from the unit's other thermometers; gyros that no unit reaches."""
    for name in judge.columns:
        if judge.valid[name].any() and np.median(judge.values(name)) > KELVIN_degC:
            middle = np.median(judge.values(name))
            guess = "kelvin?" if middle < KELVIN_degC + 210.0 else "ten times too large?"
            judge.drop(
                name,
                FaultKind.IMPLAUSIBLE,
                judge.rows(name),
                f"is about {middle:.0f}, needed degC: {guess}",
            )
    unit = [
        n
        for n in judge.columns
        if n.startswith(("gyro_", "accel_", "block")) and judge.valid[n].any()
    ]
    gyros = [n for n in unit if n.startswith("gyro_")]
    if len(unit) > 1:
        values = np.array([np.where(judge.valid[n], judge.columns[n], np.nan) for n in unit])
        _odd_ones(judge, unit, gyros, values)
    _colder_than_ambient(judge, [name for name in gyros if judge.valid[name].any()])
    for name in gyros:
        rows = judge.rows(name)
        if not rows.size:
            continue
        middle = np.median(judge.columns[name][rows])
        peak = np.percentile(judge.columns[name][rows], 95)
        low, high = plausible_degC
        if not low <= middle <= high or peak > high + 15.0:
            guess = "Fahrenheit?" if peak > high else "wrong scale?"
            judge.drop(
                name,
                FaultKind.SCALE,
                judge.rows(name),
                f"is about {middle:.0f} degC, needed {low:g} to {high:g} degC: {guess}",
            )


def _odd_ones(judge: _Judge, unit: list[str], gyros: list[str], values: NDArray) -> None:
    """Columns far from the median of the unit's thermometers over a fifth of the log."""
    middle = np.full(values.shape[1], np.nan)
    for first in range(0, middle.size, PIECE_ROWS):  # a median takes 20 times its numbers
        part = values[:, first : first + PIECE_ROWS]
        seen = np.flatnonzero(np.isfinite(part).any(axis=0))
        middle[first + seen] = np.nanmedian(part[:, seen], axis=0)
    if len(unit) == 2 or (len(unit) == len(gyros) + 1 and len(gyros) == 3):
        middle = _against_one(unit, gyros, values, middle)
    for name, v in zip(unit, values):
        off = np.abs(v - middle)
        off = off[np.isfinite(off)]
        if not off.size or np.percentile(off, 80) <= OTHER_SCALE_degC:
            continue
        near = [
            word
            for word, scale in SCALES
            if np.nanpercentile(np.abs(scale(v) - middle), 80) < SAME_SCALE_degC
        ]
        text = (
            f"is {np.nanmedian(v - middle):+.0f} degC off the other thermometers:"
            f" {near[0] if near else 'wrong scale?'}"
        )
        judge.drop(name, FaultKind.SCALE, judge.rows(name), text)


def _against_one(unit: list[str], gyros: list[str], values: NDArray, middle: NDArray) -> NDArray:
    """Where all gyros stand against one other column: that one is the measure if a scale of the
    gyros explains it, or if it moves. Three gyros that agree may share a fault; a thermometer of
    the block that lives and lies elsewhere says that one of the two is wrong, and a bias without a
    temperature is better than one at a wrong temperature.
    """
    others = [k for k, n in enumerate(unit) if n not in gyros]
    if len(others) != 1:
        return middle
    other = values[others[0]]
    of_gyros = np.median(np.nan_to_num(np.delete(values, others, axis=0)), axis=0)
    explained = any(
        np.nanpercentile(np.abs(scale(of_gyros) - other), 80) < SAME_SCALE_degC
        for _, scale in SCALES
    )
    lives = np.nanmax(other) - np.nanmin(other) > JUMP_degC
    return other if explained or lives else middle


def _colder_than_ambient(judge: _Judge, gyros: list[str]) -> None:
    """A powered unit heats itself: at the end of a log it is not colder than the coldest air that
    it was in. After a cruise it is colder than the air at the ground for an hour.
    """
    name = "ambient_degC"
    if name not in judge.columns or not judge.valid[name].any() or not gyros:
        return
    late = judge.t >= judge.t[-1] - LAST_SHARE * (judge.t[-1] - judge.t[0])
    air = judge.columns[name][judge.valid[name]]
    inside = [judge.columns[g][judge.valid[g] & late] for g in gyros]
    if not air.size or not all(v.size for v in inside):
        return
    coldest = float(np.quantile(air, COLDEST_SHARE))
    colder = coldest - float(max(np.median(v) for v in inside))
    if colder <= OTHER_SCALE_degC:
        return
    for g in gyros:
        text = f"is {colder:.0f} degC colder at the end of the log than the coldest ambient air"
        judge.drop(g, FaultKind.SCALE, judge.rows(g), f"{text}: wrong offset?")


def of_another_run(time_s: NDArray, start_s: float, end_s: float) -> bool:
    """Whether temperatures are hardly of the log that they lie beside: they go on long after it.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Of the readings.
    start_s, end_s : float
        Of the log [s].

    Returns
    -------
    other : bool
    """
    lasts_s = end_s - start_s
    allowed_s = max(OVERHANG_SHARE * lasts_s, HOLE_S)
    return bool(lasts_s >= LONG_ENOUGH_S and time_s[-1] - end_s > allowed_s)
