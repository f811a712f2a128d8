"""A stretch of an aided solution in steps: rows of the solution, the fixes between them, and what
the unit turned and gained over each step; what stays the same in what it reads.
"""

from dataclasses import dataclass, field, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.earth import displacement_ned, geodetic_from_ecef, gravity_n, omega_en_n, omega_ie_n
from ins.filters.aided_records import AidedHistory, Fixes
from ins.records import ImuLog, ImuSource
from ins.strapdown.increments import joined

# rows of the solution, a second apart, whose log is read at a time; chosen: of 200 Hz 8 MB
READ_ROWS = 600
RATE_S = 0.2  # about a fix, to tell its rate: a vehicle takes longer to begin a turn
# squared sigmas of three components beyond which it has changed: chi-square of 3, 1e-3 of noise
CHANGED_SQUARES = 16.27
# steps of the latest mean, which finds slow changes, and of the mean at most; chosen: 5 s and some
# minutes, as ins.filters.aided_kernel.steady_force
LATEST_OF_STEPS, MEAN_OF_STEPS = 10.0, 1500.0
# of squared reading units; far below any sensor's noise, against none at all
NO_NOISE = 1e-18


@dataclass(frozen=True)
class Steps:
    """K steps over R rows of the solution; each ends at a fix or at a row.

    time_s (R,), C_nb (R, 3, 3), v_n_m_s (R, 3): the rows; way_m (R - 1, 3): from a row to the next,
    NED; pull_m_s2 (R, 3): gravity and Coriolis; stands (R,).

    row (K,): the last row at or before a step's start; closes (K,): the step ends at the next row;
    dt_s (K,), C_bb (K, 3, 3), dv_b_m_s (K, 3): the increments; way_b_m (K, 3): of the velocity that
    they gain; angle_b_rad (K, 3), force_b_m_s2 (K, 3): sum of angles, mean specific force;
    turn_n_rad (K, 3): of the frame; warmer_degC (K,): than at the start of the log; bin (K,); flies
    (K,): under way, in the air or on wheels, where vibration may change what gyros read; fix (K,):
    the fix at the end, -1: none; late_s (K,): the end is so much later.

    fix_time_s (F,), fix_way_m (F, 3): from the row before to the antenna, NED; fix_v_n_m_s (F, 3),
    fix_rate_b_rad_s (F, 3): of the body there; fix_variance (F, 6); fix_of_other_type (F,).
    """

    time_s: NDArray
    C_nb: NDArray
    v_n_m_s: NDArray
    way_m: NDArray
    pull_m_s2: NDArray
    stands: NDArray
    row: NDArray
    closes: NDArray
    dt_s: NDArray
    C_bb: NDArray
    dv_b_m_s: NDArray
    way_b_m: NDArray
    angle_b_rad: NDArray
    force_b_m_s2: NDArray
    turn_n_rad: NDArray
    warmer_degC: NDArray
    bin: NDArray
    flies: NDArray
    fix: NDArray
    late_s: NDArray
    fix_time_s: NDArray
    fix_way_m: NDArray
    fix_v_n_m_s: NDArray
    fix_rate_b_rad_s: NDArray
    fix_variance: NDArray
    fix_of_other_type: NDArray


def steps_between(
    imu: ImuSource,
    history: AidedHistory,
    fixes: Fixes,
    rows: slice,
    *,
    temperature: GyroTemperature,
    bin_ends_s: NDArray,
    stands: tuple[Where, ...],
) -> Steps:
    """The steps between rows of the solution. imu: compensated, holds them; bin_ends_s (N,)."""
    degC = temperature.temperature_degC.mean(axis=1)
    t, v = history.time_s[rows], history.v_n_m_s[rows]
    lat, lon, height = history.lat_rad[rows], history.lon_rad[rows], history.height_m[rows]
    here = np.flatnonzero((fixes.time_s > t[0] + 1e-6) & (fixes.time_s <= t[-1] - 1e-6))
    fix_s = fixes.time_s[here]
    edges = [*range(0, t.size - 1, READ_ROWS), t.size - 1]
    log = _joined([_increments(imu, t, (a, b), fix_s) for a, b in pairwise(edges)])
    end_s, fix, dt = log.end_s, log.fix, log.dt_s
    late = np.zeros(end_s.size)
    late[fix >= 0] = end_s[fix >= 0] - fix_s[fix[fix >= 0]]
    start_s = np.concatenate([t[:1], end_s[:-1]])
    row = np.searchsorted(t, start_s + 1e-6, side="right") - 1
    earth, transport = omega_ie_n(lat), omega_en_n(lat, height, v)
    pull = gravity_n(lat, height) - np.cross(2.0 * earth + transport, v)
    of = np.searchsorted(t, fix_s - 1e-6) - 1
    return Steps(
        time_s=t,
        C_nb=history.C_nb[rows],
        v_n_m_s=v,
        way_m=_ways((lat[1:], lon[1:], height[1:]), (lat[:-1], lon[:-1], height[:-1])),
        pull_m_s2=pull,
        stands=_within(t, stands),
        row=row,
        closes=log.closes,
        dt_s=dt,
        C_bb=log.C_bb,
        dv_b_m_s=log.dv_b_m_s,
        way_b_m=log.way_b_m,
        angle_b_rad=log.angle_b_rad,
        force_b_m_s2=log.dv_b_m_s / dt[:, None],
        turn_n_rad=(earth + transport)[row] * dt[:, None],
        warmer_degC=np.interp(end_s, temperature.time_s, degC - degC[0]),
        bin=np.minimum(np.searchsorted(bin_ends_s, 0.5 * (start_s + end_s)), bin_ends_s.size - 1),
        flies=~_within(end_s, stands),
        fix=fix,
        late_s=late,
        fix_time_s=fix_s,
        fix_way_m=_to_fixes(fixes.r_e_m[here], (lat[of], lon[of], height[of])),
        fix_v_n_m_s=fixes.v_n_m_s[here],
        fix_rate_b_rad_s=log.fix_rate_b_rad_s,
        fix_variance=np.hstack(
            [fixes.sigma_position_m[here] ** 2, fixes.sigma_velocity_m_s[here] ** 2]
        ),
        fix_of_other_type=fixes.other_type[here],
    )


@dataclass(frozen=True)
class _Increments:
    """What the log did over its steps, as in `Steps`; end_s: of each step."""

    end_s: NDArray
    closes: NDArray
    fix: NDArray
    dt_s: NDArray
    C_bb: NDArray
    dv_b_m_s: NDArray
    way_b_m: NDArray
    angle_b_rad: NDArray
    fix_rate_b_rad_s: NDArray


def _increments(imu: ImuSource, t: NDArray, rows: Where, fix_s: NDArray) -> _Increments:
    """Those between two rows of the solution. t (R,): its times; fix_s (F,): of all fixes."""
    first, last = (int(k) for k in rows)
    begin_s, end_s = float(t[first]), float(t[last])
    # a row before, whose angles the next one's coning needs, and RATE_S about the fixes
    log = imu.between(
        max(begin_s - RATE_S, float(t[0])) + 1e-6, min(end_s + RATE_S, float(t[-1])) + 1e-6
    )
    before = int(np.searchsorted(log.time_s, begin_s + 1e-6, side="right"))
    at_row = np.searchsorted(log.time_s, t[first + 1 : last + 1] - 1e-6)
    here = np.flatnonzero((fix_s > begin_s + 1e-6) & (fix_s <= end_s + 1e-6))
    at_fix = np.searchsorted(log.time_s, fix_s[here] - 1e-6)
    ends = np.unique(np.concatenate([at_row, at_fix]))
    fix = np.full(ends.size, -1)
    fix[np.searchsorted(ends, at_fix)] = here  # of several in one row, the last
    starts = np.concatenate([[before], ends[:-1] + 1])
    edges = ends + 1 if before == 0 else np.concatenate([[before], ends + 1])
    C_bb, dv, way = joined(log.between(-np.inf, float(log.time_s[ends[-1]])), edges)
    own = slice(int(before > 0), None)
    inside = slice(None, int(ends[-1]) + 1)
    return _Increments(
        end_s=log.time_s[ends],
        closes=np.isin(ends, at_row),
        fix=fix,
        dt_s=np.add.reduceat(log.dt_s[inside], starts),
        C_bb=C_bb[own],
        dv_b_m_s=dv[own],
        way_b_m=way[own],
        angle_b_rad=np.add.reduceat(log.dtheta_rad[inside], starts, axis=0),
        fix_rate_b_rad_s=_rates(log, fix_s[here]),
    )


def _joined(parts: list[_Increments]) -> _Increments:
    """One after the other."""
    names = [column.name for column in fields(_Increments)]
    return _Increments(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


Places = tuple[NDArray, NDArray, NDArray]


def _ways(to: Places, of: Places) -> NDArray:
    """From places to places, north, east, down (n, 3) [m]."""
    lat0, lon0, height0 = of
    level = displacement_ned(to[0], to[1], lat0_rad=lat0, lon0_rad=lon0, height0_m=height0)
    return np.column_stack([level, height0 - to[2]])


def _to_fixes(r_e_m: NDArray, of: Places) -> NDArray:
    """From places to fixes (n, 3) [m]; NaN where a fix has no position."""
    way = np.full(r_e_m.shape, np.nan)
    seen = np.isfinite(r_e_m).all(axis=1)
    if seen.any():
        way[seen] = _ways(geodetic_from_ecef(r_e_m[seen]), tuple(p[seen] for p in of))
    return way


def _rates(log: ImuLog, time_s: NDArray) -> NDArray:
    """Angular rate (n, 3) around times, over RATE_S."""
    t = np.concatenate([[log.time_s[0] - log.dt_s[0]], log.time_s])
    angle = np.concatenate([np.zeros((1, 3)), np.cumsum(log.dtheta_rad, axis=0)])
    a, b = (np.clip(time_s + half, t[0], t[-1]) for half in (-0.5 * RATE_S, 0.5 * RATE_S))
    turned = np.stack([np.interp(b, t, of) - np.interp(a, t, of) for of in angle.T], axis=1)
    return np.asarray(turned / (b - a)[:, None])


def _within(time_s: NDArray, spans: tuple[Where, ...]) -> NDArray:
    """Whether each time (n,) lies in one of the spans."""
    inside = np.zeros(time_s.size, dtype=bool)
    for start, end in spans:
        inside |= (time_s > start) & (time_s <= end)
    return inside


@dataclass
class Steady:
    """The mean of a reading (3,) while it stays the same, else the reading.

    A filter that moves its covariance by what accelerometers read takes their noise for motion of a
    known size: fixes do not confirm it, and each step adds to what the filter believes to know of
    the heading. Its compiled sister is `steady_force` of `ins.filters.aided_kernel`.
    """

    steps: float = 0.0
    mean: NDArray = field(default_factory=lambda: np.zeros(3))
    latest: NDArray = field(default_factory=lambda: np.zeros(3))

    def of(self, read: NDArray, white: float, unsure: NDArray | float = 0.0) -> NDArray:
        """The next step's. white: variance of its noise; unsure (3,): of what else moves it."""
        self.latest = self.latest + (read - self.latest) / LATEST_OF_STEPS
        n = self.steps
        if n == 0.0 or self._squares(read, white * (1.0 + 1.0 / n) + unsure) > CHANGED_SQUARES:
            self.steps, self.mean, self.latest = 1.0, read.copy(), read.copy()
            return read
        of_latest = white / (2.0 * LATEST_OF_STEPS - 1.0) + white / n + unsure
        if n > LATEST_OF_STEPS and self._squares(self.latest, of_latest) > CHANGED_SQUARES:
            self.steps, self.mean = LATEST_OF_STEPS, self.latest.copy()
            return self.mean
        self.steps = min(n + 1.0, MEAN_OF_STEPS)
        self.mean = self.mean + (read - self.mean) / self.steps
        return self.mean

    def _squares(self, value: NDArray, variance: NDArray | float) -> float:
        return float(np.sum((value - self.mean) ** 2 / (variance + NO_NOISE)))
