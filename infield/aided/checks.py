"""What a log of fixes says against itself, its header or its sensors: fixes that repeat, velocities
that are not the way of the positions, a site elsewhere, a unit that looks sideways, two clocks.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from infield.aided.reasons import AidedNote, AidedReason, Widened
from infield.aided.start import SOON_S
from ins.attitude import euler_from_dcm, wrap_pi
from ins.earth import dcm_en, ecef_from_geodetic, geodetic_from_ecef
from ins.filters.aided_records import AidedHistory, Fixes
from ins.records import ImuSource, Site
from ins.units import DEG
from ins.verdicts import Reason, because

# no two good fixes are the same above it: of ten a second 5 cm apart, where 1e-7 deg are 1 cm
REPEATS_ABOVE_M_S = 0.5
# 0.1 m/s of the receiver's noise are 1.1 deg of course at 5 m/s; the median of 30 rows has 0.23
# of the scatter of one (1.25 / sqrt(30))
ON_TRACK_M_S, ON_TRACK_ROWS = 5.0, 30
# chosen: mountings are within a degree or two, so 5 deg are no mounting; a scatter beyond 20 deg
# is wind or slip, not a turned unit. It is a note and changes nothing
OFF_TRACK_RAD, SPREAD_RAD = 5.0 * DEG, 20.0 * DEG
# spans over which the way of positions is set beside that of velocities [s]; chosen: errors that
# are the same for longer are the receiver's slow ones, which have states
WAY_SPANS_S = (1.0, 2.0, 3.0, 5.0, 10.0)
# sigmas of that difference, its velocities' errors taken as one for the whole span: of 25 public
# logs 19 stay below 2.7
CONTRADICTS_SIGMAS = 4.0
# chosen: what receivers without corrections are good to, whatever is declared
LEAST_PLACE_M, LEAST_SPEED_M_S = 1.0, 0.3
AGE_S = 0.3  # by which positions may be older than velocities, as infield.aided.antenna
# chosen: of the difference over a span, in its 2 largest steps from fix to fix: a leap is in 1, a
# wild fix in 2
LEAP_SHARE = 0.7
MOST_MISSING_S = 3.0  # between two fixes of a span; chosen: of 1 fix a second 2 may be lost
FEWEST_WAYS = 10  # chosen: fixes, as many as a flight needs (10)
# of the times at which turns are set side by side, and over which they are taken; chosen: a rover's
# turn lasts seconds, and the course of 2 s at 10 Hz is good to 2 deg at 0.5 m/s
TURN_STEP_S, TURN_STEPS = 0.5, 4
MOST_APART_S = 10.0  # chosen: streams that begin together are apart by what each takes to start
# below 0.2 m/s noise of 0.05 m/s, over 20 fixes, is 3 deg of course; beyond 1.5 rad in 2 s a
# vehicle turns back: chosen
LEAST_COURSE_M_S, MOST_TURNED_RAD = 0.2, 1.5
LEAST_TURNS, LEAST_TURN_RAD = 60, 0.1  # chosen: half a minute of turning, 6 deg (RMS) in 2 s
# correlations: 0.75 of a public rover with clocks 4.6 s apart, and 0.45 at its own times or within
# a delay of them; two planes have 0.82 and 0.93 at their own; 40 offsets of what has nothing to do
# with each other reach 0.35 by chance (60 turns; of nine copters at most 0.34)
TURNS_AGREE, TURNS_DIFFER = 0.6, 0.75
# of white noise of the gyros that a log needs, from which on its clocks are doubted: hand-held
# units need 4 to 16 times the declared (docs/real_evidence.md), a rover with two clocks 256
DOUBTED_WHITE = 16.0
SITE_OFF_M, SITE_SIGMAS = 30.0, 5.0  # 5 sigmas: 6e-7 of Gaussian errors lie beyond


def without_repeats(fixes: Fixes) -> tuple[Fixes, tuple[Reason, ...]]:
    """The fixes less those whose position is, bit for bit, that of the one before while the
    receiver says that it moves.
    """
    r_e, speed = fixes.r_e_m, np.linalg.norm(fixes.v_n_m_s, axis=1)
    same = np.zeros(len(r_e), dtype=bool)
    same[1:] = (r_e[1:] == r_e[:-1]).all(axis=1) & (speed[1:] > REPEATS_ABOVE_M_S)
    if not same.any():
        return fixes, ()
    rows = np.flatnonzero(same)
    hole = np.where(same[:, None], np.nan, 0.0)
    note = because(
        AidedNote.REPEATED_FIXES,
        count=rows.size,
        first_s=fixes.time_s[rows[0]],
        last_s=fixes.time_s[rows[-1]],
        speed_m_s=float(np.median(speed[rows])),
    )
    return replace(fixes, r_e_m=r_e + hole, v_n_m_s=fixes.v_n_m_s + hole), (note,)


@dataclass(frozen=True, kw_only=True)
class Contradicted:
    """Fixes whose velocities are not the way of their positions.

    place_m, speed_m_s (n, 3): sigmas, NED, that explain it by either, 0 where nothing is to be
    explained; sigmas: the largest difference over its sigma.
    """

    place_m: NDArray
    speed_m_s: NDArray
    sigmas: float

    @property
    def rows(self) -> NDArray:
        """Which fixes (n,)."""
        return np.asarray((self.place_m > 0.0).any(axis=1))

    @property
    def components(self) -> str:
        """Of which components."""
        names = zip(("north", "east", "down"), self.place_m.T, strict=True)
        return ", ".join(name for name, of in names if (of > 0.0).any())

    def widened(self, fixes: Fixes) -> Mapping[Widened, Fixes]:
        """The fixes with either explanation, and with both."""
        place = np.hypot(fixes.sigma_position_m, self.place_m)
        speed = np.hypot(fixes.sigma_velocity_m_s, self.speed_m_s)
        positions = replace(fixes, sigma_position_m=place)
        return {
            Widened.POSITION: positions,
            Widened.VELOCITY: replace(fixes, sigma_velocity_m_s=speed),
            Widened.BOTH: replace(positions, sigma_velocity_m_s=speed),
        }


def contradicted(fixes: Fixes) -> Contradicted | None:
    """Where the positions go another way than the velocities over spans of 1 to 10 s; None where
    nowhere.

    Both are summed in Earth axes: north and east turn on the way, at 230 m/s eastward and 45 deg
    of latitude by 7 deg in an hour. A difference is resolved where its span begins. The velocities'
    errors count as one error over a span, and the difference in age of the two as AGE_S, so that
    only what no honest receiver does is found. A leap of the positions, or a wild fix, is none of
    it: the filter has its own way with these.
    """
    whole = np.isfinite(fixes.r_e_m).all(axis=1) & np.isfinite(fixes.v_n_m_s).all(axis=1)
    seen = np.flatnonzero(whole)
    if seen.size < FEWEST_WAYS:
        return None
    t, v, r_e = fixes.time_s[seen], fixes.v_n_m_s[seen], fixes.r_e_m[seen]
    lat, lon, _ = geodetic_from_ecef(r_e)
    C_en, dt = dcm_en(lat, lon), np.diff(t)[:, None]
    v_e = np.einsum("kij,kj->ki", C_en, v)
    off_e = r_e - r_e[0] - _summed(0.5 * (v_e[1:] + v_e[:-1]) * dt)
    place = np.maximum(fixes.sigma_position_m[seen], LEAST_PLACE_M)
    speed = np.maximum(fixes.sigma_velocity_m_s[seen], LEAST_SPEED_M_S)
    way = _summed(0.5 * (speed[1:] + speed[:-1]) * dt)
    between = _summed((0.25 * np.diff(v, axis=0) * dt) ** 2)  # of a straight line between two
    piece = np.concatenate([[0], np.cumsum(np.diff(t) > MOST_MISSING_S)])
    place_m, speed_m_s, most = np.zeros(v.shape), np.zeros(v.shape), 0.0
    for span_s in WAY_SPANS_S:
        last = np.searchsorted(t, t + span_s - 1e-6)
        a = np.flatnonzero(last < t.size)
        a = a[piece[last[a]] == piece[a]]
        b = last[a]
        apart = np.abs(np.einsum("kji,kj->ki", C_en[a], off_e[b] - off_e[a]))
        variance = place[a] ** 2 + place[b] ** 2 + (way[b] - way[a]) ** 2
        variance += (AGE_S * (v[b] - v[a])) ** 2 + between[b] - between[a]
        over = apart / np.sqrt(variance)
        for k, axis in zip(*np.nonzero(over > CONTRADICTS_SIGMAS), strict=True):
            of = slice(a[k], b[k] + 1)
            steps = np.sort(np.abs(np.diff(off_e[of] @ C_en[a[k], :, axis])))
            if steps[-2:].sum() > LEAP_SHARE * apart[k, axis]:
                continue
            most = max(most, float(over[k, axis]))
            seconds = t[b[k]] - t[a[k]]
            place_m[of, axis] = np.maximum(place_m[of, axis], apart[k, axis] / np.sqrt(2.0))
            speed_m_s[of, axis] = np.maximum(speed_m_s[of, axis], apart[k, axis] / seconds)
    if most == 0.0:
        return None
    every = np.zeros((2, *fixes.v_n_m_s.shape))
    every[:, seen] = place_m, speed_m_s
    return Contradicted(place_m=every[0], speed_m_s=every[1], sigmas=most)


def _summed(steps: NDArray) -> NDArray:
    """Sums (n, 3) of steps (n - 1, 3), from zero on."""
    return np.vstack([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def site_note(
    fixes: Fixes, stands: tuple[Where, ...], site: Site, start_s: float
) -> tuple[Reason, ...]:
    """Whether a log that begins parked has its first fixes where the header says that it stands."""
    parked = next((s for s in stands if s[0] < start_s + SOON_S), None)
    if parked is None:
        return ()
    rows = np.flatnonzero(
        (fixes.time_s >= parked[0]) & (fixes.time_s <= parked[1]) & np.isfinite(fixes.r_e_m[:, 0])
    )
    if not rows.size:
        return ()
    off = np.median(fixes.r_e_m[rows], axis=0) - ecef_from_geodetic(
        site.lat_rad, site.lon_rad, site.height_m
    )
    off_m = float(np.linalg.norm(off))
    sigma_m = float(np.linalg.norm(fixes.sigma_position_m[rows[0]]))
    if off_m < max(SITE_OFF_M, SITE_SIGMAS * sigma_m):
        return ()
    return (because(AidedNote.SITE_ELSEWHERE, off_m=off_m),)


def mounting_note(history: AidedHistory) -> tuple[Reason, ...]:
    """Whether body x keeps off the track: a unit turned about the vertical is navigated right, and
    its heading is its own.
    """
    v_n = history.v_n_m_s
    rows = np.linalg.norm(v_n[:, :2], axis=1) > ON_TRACK_M_S
    if rows.sum() < ON_TRACK_ROWS:
        return ()
    off = wrap_pi(euler_from_dcm(history.C_nb[rows])[2] - np.arctan2(v_n[rows, 1], v_n[rows, 0]))
    mean = _middle(off)
    spread = float(np.median(np.abs(wrap_pi(off - mean))))
    if abs(mean) < OFF_TRACK_RAD or spread > SPREAD_RAD:
        return ()
    return (because(AidedNote.OFF_THE_TRACK, mean_rad=mean, spread_rad=spread),)


def _middle(angles: NDArray) -> float:
    """Median of angles [rad] about their mean direction."""
    around = np.arctan2(np.sin(angles).mean(), np.cos(angles).mean())
    return float(wrap_pi(around + np.median(wrap_pi(angles - around))))


def clocks_apart(imu: ImuSource, fixes: Fixes, latest_s: float) -> tuple[Reason, ...]:
    """Whether the course of a vehicle that goes where it points turns at other times than its
    gyros, by more than `latest_s`, which a delay explains.
    """
    time_s, turned = _turned(imu)
    course = _courses(fixes, time_s)
    change = wrap_pi(course[TURN_STEPS:] - course[:-TURN_STEPS])
    change[np.abs(change) > MOST_TURNED_RAD] = np.nan
    of_gyros = turned[TURN_STEPS:] - turned[:-TURN_STEPS]
    most = round(MOST_APART_S / TURN_STEP_S)
    steps = np.arange(-most, most + 1)
    agree = np.array([_agreement(change, of_gyros, int(step)) for step in steps])
    own = float(agree[np.abs(steps) * TURN_STEP_S <= latest_s].max(initial=0.0))
    best = int(np.argmax(agree))
    if agree[best] < TURNS_AGREE or own > TURNS_DIFFER * agree[best]:
        return ()
    found = because(
        AidedReason.CLOCKS_APART,
        later_s=float(steps[best] * TURN_STEP_S),
        agree=float(agree[best]),
        own=own,
    )
    return (found,)


def _turned(imu: ImuSource) -> tuple[NDArray, NDArray]:
    """Times (k,) and what the gyros turned about the vertical until then (k,) [rad]."""
    count = int((imu.end_s - imu.start_s) / TURN_STEP_S)
    sums = np.zeros((count + 1, 6))
    for piece in imu.pieces():
        at = np.minimum(((piece.time_s - imu.start_s) / TURN_STEP_S).astype(int), count)
        np.add.at(sums, at, np.hstack([piece.dtheta_rad, piece.dv_m_s]))
    force = np.apply_along_axis(np.convolve, 0, sums[:, 3:], np.ones(2 * TURN_STEPS + 1), "same")
    down = -force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
    turned = np.cumsum(np.sum(sums[:, :3] * down, axis=1))
    return imu.start_s + TURN_STEP_S * np.arange(1, count + 2), turned


def _courses(fixes: Fixes, time_s: NDArray) -> NDArray:
    """The course (k,) of the mean velocity over TURN_STEPS about each time, NaN where slow."""
    seen = np.isfinite(fixes.v_n_m_s).all(axis=1)
    t, v = fixes.time_s[seen], np.cumsum(fixes.v_n_m_s[seen, :2], axis=0)
    v = np.vstack([np.zeros((1, 2)), v])
    half_s = 0.5 * TURN_STEPS * TURN_STEP_S
    first, end = (np.searchsorted(t, time_s + offset) for offset in (-half_s, half_s))
    count = np.maximum(end - first, 1)[:, None]
    mean = (v[end] - v[first]) / count
    course = np.arctan2(mean[:, 1], mean[:, 0])
    course[np.linalg.norm(mean, axis=1) < LEAST_COURSE_M_S] = np.nan
    return course


def _agreement(change: NDArray, of_gyros: NDArray, step: int) -> float:
    """Correlation of changes of course with turns `step` rows later; 0 where too few turn."""
    n = change.size - abs(step)
    a = change[max(-step, 0) :][:n]
    b = of_gyros[max(step, 0) :][:n]
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < LEAST_TURNS or np.sqrt(np.mean(a[both] ** 2)) < LEAST_TURN_RAD:
        return 0.0
    return float(np.corrcoef(a[both], b[both])[0, 1])
