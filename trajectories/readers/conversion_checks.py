"""What the rows of a whole log say of its logger: a unit that changes on the way, values that stand
still.

Gravity holds the accelerometers to one unit all along (feet are not told from a tight turn); of
gyros, whose mean may be anything once they move, the noise shows it: it changes by the factor
between two units from one row to the next, and that of the accelerometers does not.

Decision: docs/decisions/0040-known-by-gravity.md.
"""

import numpy as np
from numpy.typing import NDArray

from ins.earth import displacement_ned
from ins.records import PIECE_ROWS, GnssLog, ImuLog, OdometerLog
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
COMPARED_ABOVE_M_S = 2.0  # three sigmas of the difference of fixes of 0.5 m a second apart
CLIMBING_M_S = 0.5  # chosen: 100 ft/min, a fifth of a usual slow climb (500)
LEAST_PAIRS = 20  # of fixes: the median has 0.28 of one pair's scatter, 1.25 / sqrt(20)
# of two fixes: one of a fix a second may be lost (2 s); a turn between would show
MAX_APART_S = 2.5
# of the speed, median: what velocities may be off their positions; the nearest wrong unit, m/s
# taken for kn, is off by 0.49
OFF = 0.3
# of the speed, median: what the right unit leaves; kn and mph are 0.15 apart, and
# tests/trajectories/test_conversion_streams.py fails at half and at twice of it
FITS = 0.1
SPEED_FACTORS = {  # a speed that reads so many times what it is
    3.6: "km/h taken for m/s",
    1 / 3.6: "m/s taken for km/h",
    3600 / 1852: "kn taken for m/s",
    1852 / 3600: "m/s taken for kn",
    1.852: "km/h taken for kn",
    1 / 1.852: "kn taken for km/h",
    1 / 0.44704: "mph taken for m/s",
    1e3: "mm/s taken for m/s",
    1e2: "cm/s taken for m/s",
    1e-2: "m/s taken for cm/s",
}


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


def check_streams(
    gnss: GnssLog | None, odometer: OdometerLog | None, *, label: str, findings: Findings
) -> None:
    """Adds an error where velocities or a wheel show another unit, order or sign than they were
    taken for.
    """
    if gnss is None or gnss.time_s.size <= LEAST_PAIRS:
        return
    for told in (_velocities(gnss), _wheel(gnss, odometer) if odometer is not None else ""):
        findings.error(*([f"{label}: {told}"] if told else []))


def _velocities(gnss: GnssLog) -> str:
    """What is wrong with the velocities against the positions, and what would be right."""
    way, v = _pairs(gnss)
    moving = np.linalg.norm(way[:, :2], axis=1) > COMPARED_ABOVE_M_S
    if np.count_nonzero(moving) >= LEAST_PAIRS:
        level, seen = way[moving, :2], v[moving, :2]
        orders = {
            "": seen,
            "east taken for north (frame?)": seen[:, ::-1],
            "signs turned round": -seen,
        }
        found = []
        for order, values in orders.items():
            for factor, unit in {1.0: "", **SPEED_FACTORS}.items():
                cause = ", ".join(filter(None, (order, unit)))
                found.append((_off(values / factor, level), cause))
        off, cause = min(found)
        if found[0][0] > OFF and off < FITS and cause:
            return (
                f"velocities of the fixes are {found[0][0]:.0%} off what their positions do:"
                f" {cause}?"
            )
    climbing = np.abs(way[:, 2]) > CLIMBING_M_S
    if (
        np.count_nonzero(climbing) >= LEAST_PAIRS
        and abs(np.median(v[climbing, 2] / way[climbing, 2]) + 1) < OFF
    ):
        return "the fixes rise where their velocity says down: up taken for down (frame?)"
    return ""


def _pairs(gnss: GnssLog) -> tuple[NDArray, NDArray]:
    """Mean velocity north, east, down between fixes by their positions, and by their velocities,
    (n, 3) each [m/s].
    """
    step = np.diff(gnss.time_s)
    k = np.flatnonzero((step > 0) & (step <= MAX_APART_S))
    level = displacement_ned(
        gnss.lat_rad[k + 1],
        gnss.lon_rad[k + 1],
        lat0_rad=gnss.lat_rad[k],
        lon0_rad=gnss.lon_rad[k],
        height0_m=gnss.height_m[k],
    )
    way = np.column_stack([level[:, :2], gnss.height_m[k] - gnss.height_m[k + 1]]) / step[k, None]
    return way, 0.5 * (gnss.v_n_m_s[k] + gnss.v_n_m_s[k + 1])


def _off(values: NDArray, right: NDArray) -> float:
    return float(np.median(np.linalg.norm(values - right, axis=1) / np.linalg.norm(right, axis=1)))


def _wheel(gnss: GnssLog, odometer: OdometerLog) -> str:
    """The unit in which the wheel would agree with the velocity of the fixes."""
    speed = np.linalg.norm(gnss.v_n_m_s[:, :2], axis=1)
    beside = np.interp(gnss.time_s, odometer.time_s, odometer.speed_m_s, left=np.nan, right=np.nan)
    rows = np.isfinite(beside) & (speed > COMPARED_ABOVE_M_S) & (beside != 0.0)
    if np.count_nonzero(rows) < LEAST_PAIRS:
        return ""
    ratio = np.abs(beside[rows]) / speed[rows]
    typical = float(np.median(ratio))
    steady = np.median(np.abs(ratio / typical - 1)) < FITS
    cause = next(
        (told for factor, told in SPEED_FACTORS.items() if abs(typical / factor - 1) < FITS), ""
    )
    return (
        f"the wheel reads {typical:.3g} times the speed of the fixes: {cause}?"
        if steady and cause
        else ""
    )
