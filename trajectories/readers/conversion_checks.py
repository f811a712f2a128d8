"""What the rows of a whole log say of its logger: a unit that changes on the way, values that stand
still.

Gravity holds the accelerometers to one unit all along (feet are not told from a tight turn); of
gyros, whose mean may be anything once they move, the noise shows it: it changes by the factor
between two units from one row to the next, and that of the accelerometers does not.

Decision: docs/decisions/0040-known-by-gravity.md.
"""

import numpy as np
from numpy.typing import NDArray

from ins.records import PIECE_ROWS, ImuLog
from ins.units import DEG, DEG_PER_HOUR, STANDARD_GRAVITY
from trajectories.runs.checks import LISTED, Findings

NOISE_BLOCK_S = 1.0  # length of a block
SIDE = 10  # blocks on either side of a change that are looked at
FEWEST_CHANGED = 2  # and at least 2: one block is a shock
F_CHANGES = {
    STANDARD_GRAVITY: "g to m/s2",
    1e3 / STANDARD_GRAVITY: "m/s2 to mg",
    1e3: "m/s2 to mm/s2",
    1e2: "m/s2 to cm/s2",
}
W_CHANGES = {
    1 / DEG: "rad/s to deg/s",
    1e3: "rad/s to mrad/s",
    3600.0: "deg/s to deg/h",
    1 / DEG_PER_HOUR: "rad/s to deg/h",
}
# Of a factor between two units: how far the medians of the two sides may be off it.
F_TOLERANCE = 0.15
W_TOLERANCE = 0.2
# by which |f| may change on one side: 1.5 g is a turn banked by 48 deg, units are 9.8 apart
# (tests/trajectories/test_conversion_checks.py fails at half of it)
STEADY_F = 1.5
# by which the noise of the accelerometers may change beside a change of the gyros' unit, whose
# units are 57 apart or more
STEADY_FACTOR = 3.0
QUIET_BLOCKS = 0.1  # of all; chosen: a vehicle rests or goes smoothly in a tenth of them
SAME_RATE = 1e-9  # of a rate: no change but rounding, 1e-16 each of a product and a quotient
FROZEN_S = 1.0  # length of a stretch that is told: 10 rows at the slowest rate of a run, 10 Hz
# of all rows: chosen; more than every 5th repeating in short stretches, and the resolution is
# coarse
COARSE_SHARE = 0.2
# of all rows: more that stand still, and the log has no noise; chosen: 5 % may move
NOISE_FREE = 0.95


def check_rows(imu: ImuLog, *, time_shift_s: float, label: str, findings: Findings) -> None:
    """Adds an error where a unit changes within the log, a warning where all values stand still for
    a while.
    """
    blocks = _Blocks(imu)
    told, k = _force_unit(blocks) if blocks.count > 2 * FEWEST_CHANGED else ("", 0)
    if not told and blocks.count > 2 * FEWEST_CHANGED:
        told, k = _rate_unit(blocks)
    if told:
        rows = k * blocks.rows, min((k + 2) * blocks.rows, imu.rows) - 1
        log_s = [float(imu.time_s[row]) + time_shift_s for row in rows]
        findings.error(
            f"{label}: between rows {rows[0] + 1} and {rows[1] + 1}: {told} within the log? needed"
            f" one unit: take one side, --to-s {log_s[0]:.1f} or --from-s {log_s[1]:.1f}"
        )
        return
    _warn_frozen(blocks, imu, label, findings)


class _Blocks:
    """Medians over blocks of NOISE_BLOCK_S: of |f| [m/s^2], and of the differences from row to row
    of both sensors, (blocks,).
    """

    def __init__(self, imu: ImuLog) -> None:
        self.rows = max(5, round(NOISE_BLOCK_S * imu.rate_hz))
        self.count = imu.rows // self.rows
        # a long log a piece at a time, of whole blocks
        whole = max(PIECE_ROWS // self.rows, 1) * self.rows
        parts = [self._part(imu, a, min(a + whole, imu.rows)) for a in range(0, imu.rows, whole)]
        self.size_f, self.noise_w, self.noise_f, self.same = (
            np.concatenate(column) for column in zip(*parts)
        )
        self.same = self.same[:-1]  # the last row has none behind it

    def _part(self, imu: ImuLog, a: int, b: int) -> tuple[NDArray, ...]:
        """The medians over the blocks of rows a to b, and which rows the next one repeats, (b -
        a,).
        """
        part = slice(a, min(b + 1, imu.rows))
        rates = [values[part] / imu.dt_s[part, None] for values in (imu.dtheta_rad, imu.dv_m_s)]
        changes = [np.abs(np.diff(v, axis=0, append=v[-1:]))[: b - a] for v in rates]
        same = np.all(
            [np.all(d <= SAME_RATE * np.abs(v[: b - a]), axis=1) for d, v in zip(changes, rates)],
            axis=0,
        )
        used = ((b - a) // self.rows) * self.rows
        sizes = np.linalg.norm(rates[1][:used], axis=1), *(d[:used].sum(axis=1) for d in changes)
        return *(np.median(v.reshape(-1, self.rows), axis=1) for v in sizes), same

    def ratio(self, values: NDArray, k: int) -> float:
        """Of the blocks after block k to those before it, medians; NaN where either is nought."""
        before, after = (np.median(side) for side in self.sides(values, k))
        return float(after / before) if before > 0 and after > 0 else np.nan

    @staticmethod
    def sides(values: NDArray, k: int) -> tuple[NDArray, NDArray]:
        return values[max(k - SIDE, 0) : k], values[k + 1 : k + 1 + SIDE]

    def as_quiet_as_before(self, k: int) -> bool:
        """Whether the gyros' noise in the quiet blocks of all that follows block k is that of all
        before it: what changed was the motion then, as at the end of a turn, and no unit.
        """
        before, after = (
            float(np.quantile(side, QUIET_BLOCKS))
            for side in (self.noise_w[:k], self.noise_w[k + 1 :])
        )
        return before / STEADY_FACTOR < after < STEADY_FACTOR * before

    def places(self) -> range:
        return range(FEWEST_CHANGED, self.count - FEWEST_CHANGED)

    def place(self, values: NDArray, k: int) -> int:
        """The block that holds the change, or the one before it: where the values leap, near block
        k.
        """
        near = np.arange(max(k - SIDE, 0), min(k + SIDE, self.count - 1))
        with np.errstate(divide="ignore", invalid="ignore"):
            leap = np.abs(np.log(values[near + 1] / values[near]))
        return int(near[np.argmax(np.nan_to_num(leap))])


def _force_unit(blocks: _Blocks) -> tuple[str, int]:
    """What of |f| changes by the factor between two units, and in which block."""
    for k in blocks.places():
        told = _unit(blocks.ratio(blocks.size_f, k), F_CHANGES, F_TOLERANCE)
        if told and all(
            side.max() < STEADY_F * side.min() for side in blocks.sides(blocks.size_f, k)
        ):
            before, after = (np.median(side) for side in blocks.sides(blocks.size_f, k))
            return f"|f| goes from {before:.4g} to {after:.4g} m/s2: {told}", blocks.place(
                blocks.size_f, k
            )
    return "", 0


def _rate_unit(blocks: _Blocks) -> tuple[str, int]:
    """Where the gyros' noise changes by such a factor, at once, and that of the accelerometers does
    not.
    """
    for k in blocks.places():
        ratio, f_ratio = blocks.ratio(blocks.noise_w, k), blocks.ratio(blocks.noise_f, k)
        told = _unit(ratio, W_CHANGES, W_TOLERANCE)
        steady = np.isnan(f_ratio) or 1 / STEADY_FACTOR < f_ratio < STEADY_FACTOR
        if (
            told
            and steady
            and all(
                side.max() < STEADY_FACTOR * side.min() for side in blocks.sides(blocks.noise_w, k)
            )
            and not blocks.as_quiet_as_before(k)
        ):
            k = blocks.place(blocks.noise_w, k)
            return (
                f"the gyros' noise changes {ratio:.4g} times, the accelerometers' does not: {told}",
                k,
            )
    return "", 0


def _unit(ratio: float, units: dict[float, str], tolerance: float) -> str:
    for factor, told in units.items():
        if abs(ratio / factor - 1) < tolerance:
            return told
        if abs(ratio * factor - 1) < tolerance:
            return " to ".join(reversed(told.split(" to ")))
    return ""


def _warn_frozen(blocks: _Blocks, imu: ImuLog, label: str, findings: Findings) -> None:
    same = blocks.same
    edges = np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    long = imu.time_s[ends] - imu.time_s[starts] >= FROZEN_S
    told = int((ends[long] - starts[long]).sum())
    if np.count_nonzero(same) - told > COARSE_SHARE * same.size or told > NOISE_FREE * same.size:
        return
    spans = [
        f"{a:.1f} to {b:.1f} s" for a, b in zip(imu.time_s[starts[long]], imu.time_s[ends[long]])
    ]
    if spans:
        more = f" and {len(spans) - LISTED} more" if len(spans) > LISTED else ""
        findings.warn(
            f"{label}: all six values stand still from {', '.join(spans[:LISTED])}{more}: a logger"
            " that hangs?"
        )
