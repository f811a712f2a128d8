"""Where and how aided navigation starts: parked, on the gyrocompass; or moving, on the satellite
velocities.

Either way the first covariance is wide beside what the filter will soon know, so that a start taken
from data that it sees again adds next to nothing: heading 0.05 rad or more on the gyrocompass;
three sigmas of the match, and floors, when moving.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment import coarse
from alignment.motion.inertial import Where
from alignment.navigation_filter import DIFFUSE_TILT_RAD, diffuse_heading_rad
from infield.aided.reasons import AidedReason, StartMethod
from infield.aided.velocity_match import match_velocity
from ins.attitude import dcm_from_euler
from ins.earth import EARTH_RATE_RAD_S, geodetic_from_ecef, gravity_magnitude
from ins.filters.aided_records import AidedStart, Fixes
from ins.filters.states import AIDED_ACCEL as ACCEL
from ins.filters.states import AIDED_GYRO as GYRO
from ins.filters.states import AIDED_POS as POS
from ins.filters.states import AIDED_THETA as THETA
from ins.filters.states import AIDED_VEL as VEL
from ins.noise import gyro_densities, walk_with_flicker
from ins.records import ImuLog, ImuSource, NavState, RunHeader, Site, TwinModel
from ins.units import DEG, DEG_PER_HOUR, MICRO_G
from ins.verdicts import Reason, because

# of log to match on, at first and at most; between two tries; chosen: in 60 s a bias of 30 deg/h,
# the default of MEMS units (formats.md section 2), turns by 0.5 deg
FIRST_WINDOW_S, LONGEST_MATCH_S, STRIDE_S = 15.0, 60.0, 20.0
# of satellite velocity within a window that is worth a try: with 0.1 m/s of noise one pair tells
# the heading to 4 deg, and HEADING_LIMIT_RAD is 3
LEAST_CHANGE_M_S = 2.0
# sigma of a match that is taken: three of them are still nearly linear; 1 - cos(9 deg) is 1.2 %
HEADING_LIMIT_RAD = 3.0 * DEG
FLOORS_RAD = (1.0 * DEG, 1.0 * DEG, 2.0 * DEG)  # sigma of tilt and heading after a match
LEAST_LEFT_S = 2.0  # of log after a start: the filter puts out its first row 1 s later
REST_S = 30.0  # of standing before, whose mean rate is the gyros' bias
SOON_S = 60.0  # chosen: a log that stands within its first 60 s began parked
PLACE_M = 10.0  # position prior beside a fix; without one while parked, UNFIXED_PLACE_M
UNFIXED_PLACE_M = 1000.0


@dataclass(frozen=True)
class RateBefore:
    """Gyro bias (3,) and its sigma [rad/s] before a start; means: of the stand that showed it."""

    bias_rad_s: NDArray
    sigma_rad_s: NDArray
    means: coarse.RestMeans | None = None


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """A bounded log that a moving start is found on, and what is known at its end.

    fix: row of the last whole fix.
    """

    log: ImuLog
    fixes: Fixes
    fix: int
    lever_arm_m: NDArray
    gyro: RateBefore
    twin: TwinModel


@dataclass(frozen=True, kw_only=True)
class FoundStart:
    """A start, how it was found and the stretch of log it was found on."""

    start: AidedStart
    method: StartMethod
    span: Where
    sigma_heading_rad: float
    gyro_sigma_rad_s: NDArray


def parked_start(
    imu: ImuSource,
    fixes: Fixes,
    site: Site,
    twin: TwinModel,
    *,
    rest: Where,
    gyro_sigma_deg_h: NDArray,
    lever_arm_m: NDArray,
) -> FoundStart:
    """From the beginning of a rest that a gyrocompass aligns on."""
    log = imu.between(*rest)
    means = coarse.rest_means(log)
    sigma = gyro_sigma_deg_h * DEG_PER_HOUR
    heading = diffuse_heading_rad(np.diag(sigma**2), EARTH_RATE_RAD_S * np.cos(site.lat_rad))
    ground = _Parked(
        rest=rest,
        fixes=fixes,
        site=site,
        lever_arm_m=lever_arm_m,
        gyro=RateBefore(np.zeros(3), sigma, means),
        twin=twin,
    )
    return ground.started(
        log, coarse.gyrocompass_dcm(means), heading, method=StartMethod.GYROCOMPASS
    )


def surveyed_start(
    imu: ImuSource,
    fixes: Fixes,
    header: RunHeader,
    twin: TwinModel,
    *,
    stands: tuple[Where, ...],
    gyro_sigma_deg_h: NDArray,
    lever_arm_m: NDArray,
) -> FoundStart | None:
    """From the beginning of the stand that a log begins with, at the surveyed heading of its
    header; None where it has none, or begins in motion.
    """
    survey = header.survey
    if survey.heading_rad is None or not survey.sigma_heading_rad:
        return None
    rest = next((s for s in stands if s[0] < imu.start_s + SOON_S), None)
    if rest is None:
        return None
    log = imu.between(*rest)
    gyro = bias_before(imu, stands, rest[1], twin, gyro_sigma_deg_h)
    means = coarse.rest_means(log)
    f = means.f_ib_b
    roll = float(np.arctan2(-f[1], -f[2]))
    pitch = float(np.arctan2(f[0], np.hypot(f[1], f[2])))
    ground = _Parked(
        rest=rest,
        fixes=fixes,
        site=header.site,
        lever_arm_m=lever_arm_m,
        gyro=replace(gyro, means=means),
        twin=twin,
    )
    return ground.started(
        log,
        dcm_from_euler(roll, pitch, survey.heading_rad),
        survey.sigma_heading_rad,
        method=StartMethod.SURVEYED,
    )


@dataclass(frozen=True, kw_only=True)
class _Parked:
    """A rest that a parked start is made on, and what is known there."""

    rest: Where
    fixes: Fixes
    site: Site
    lever_arm_m: NDArray
    gyro: RateBefore
    twin: TwinModel

    def started(
        self, log: ImuLog, C_nb: NDArray, sigma_heading_rad: float, *, method: StartMethod
    ) -> FoundStart:
        """At the beginning of the rest, at this attitude."""
        rest, fixes = self.rest, self.fixes
        at = np.flatnonzero(
            (fixes.time_s >= rest[0]) & (fixes.time_s <= rest[1]) & np.isfinite(fixes.r_e_m[:, 0])
        )
        place, place_sigma = self.site, np.full(3, UNFIXED_PLACE_M)
        if at.size:
            place = _site(fixes.r_e_m[at[0]])
            place_sigma = np.maximum(PLACE_M, 10.0 * fixes.sigma_position_m[at[0]]) + float(
                np.linalg.norm(self.lever_arm_m)
            )
        P = _covariance(
            place_sigma,
            0.1,
            np.diag([DIFFUSE_TILT_RAD, DIFFUSE_TILT_RAD, sigma_heading_rad]) ** 2,
            self.gyro.sigma_rad_s,
            self.twin,
            self.gyro.means,
        )
        state = NavState(time_s=float(log.time_s[0]), site=place, v_n_m_s=np.zeros(3), C_nb=C_nb)
        start = AidedStart(
            state=state,
            gyro_bias_rad_s=self.gyro.bias_rad_s,
            accel_bias_m_s2=np.zeros(3),
            covariance=P,
        )
        return FoundStart(
            start=start,
            method=method,
            span=rest,
            sigma_heading_rad=sigma_heading_rad,
            gyro_sigma_rad_s=self.gyro.sigma_rad_s,
        )


def moving_start(
    imu: ImuSource,
    fixes: Fixes,
    twin: TwinModel,
    stands: tuple[Where, ...],
    *,
    gyro_sigma_deg_h: NDArray,
    lever_arm_m: NDArray,
) -> FoundStart | Reason:
    """At the end of the first window whose velocities show the heading; what is missing where none
    does.
    """
    best: float | None = None
    windows_s = np.arange(FIRST_WINDOW_S, LONGEST_MATCH_S + 1.0, FIRST_WINDOW_S)
    for first_s in _candidates(imu, fixes):
        tried_s = [w for w in windows_s if _worth_a_try(imu, fixes, first_s, first_s + w)]
        if not tried_s:  # a rest is read where a window is tried alone: a log may be in its file
            continue
        gyro = bias_before(imu, stands, first_s, twin, gyro_sigma_deg_h)
        for window_s in tried_s:
            log = imu.between(first_s, first_s + window_s)
            found = match_velocity(
                log,
                fixes,
                lever_arm_m=lever_arm_m,
                gyro_bias_rad_s=gyro.bias_rad_s,
                sigma_gyro_rad_s=float(gyro.sigma_rad_s.max()),
            )
            if found is None:
                continue
            best = min(best or np.inf, found.sigma_heading_rad)
            last = last_fix(fixes, log)
            if found.sigma_heading_rad <= HEADING_LIMIT_RAD and last is not None:
                ground = Stretch(
                    log=log, fixes=fixes, fix=last, lever_arm_m=lever_arm_m, gyro=gyro, twin=twin
                )
                theta = 9.0 * found.covariance + np.diag(np.square(FLOORS_RAD))
                return started(ground, found.C_nb, found.rate_b, theta)
    if best is None:
        return because(
            AidedReason.NO_VELOCITY_CHANGE, needed_m_s=LEAST_CHANGE_M_S, longest_s=LONGEST_MATCH_S
        )
    return because(
        AidedReason.HEADING_UNSURE,
        best_rad=best,
        limit_rad=HEADING_LIMIT_RAD,
        longest_s=LONGEST_MATCH_S,
    )


def _candidates(imu: ImuSource, fixes: Fixes) -> Iterator[float]:
    """Times to start a window at: before the first manoeuvre that is worth a try, and every
    STRIDE_S after it.
    """
    first = max(imu.start_s, float(fixes.time_s[0]))
    for t in np.arange(first, imu.end_s - FIRST_WINDOW_S, STRIDE_S):
        if level_change(fixes, t, t + LONGEST_MATCH_S) > 0:
            yield t


def _worth_a_try(imu: ImuSource, fixes: Fixes, start_s: float, end_s: float) -> bool:
    """Whether a window is followed by log, and its velocities change."""
    if end_s + LEAST_LEFT_S > imu.end_s:
        return False
    return level_change(fixes, start_s, end_s) >= LEAST_CHANGE_M_S


def level_change(fixes: Fixes, start_s: float, end_s: float) -> float:
    """The largest change of level satellite velocity within a span, less four sigmas of it
    [m/s].
    """
    first = np.searchsorted(fixes.time_s, start_s, side="left")
    inside = slice(first, np.searchsorted(fixes.time_s, end_s, side="right"))
    v_n = fixes.v_n_m_s[inside]
    measured = np.isfinite(v_n[:, 0])
    if measured.sum() < 2:
        return 0.0
    change = float(np.linalg.norm(np.ptp(v_n[measured, :2], axis=0)))
    sigma = fixes.sigma_velocity_m_s[inside][measured, 0]
    return max(change - 4.0 * float(np.median(sigma)), 0.0)


def bias_before(
    imu: ImuSource,
    stands: tuple[Where, ...],
    first_s: float,
    twin: TwinModel,
    gyro_sigma_deg_h: NDArray,
) -> RateBefore:
    """What is known of the gyros at a time, from the last stand before it; Earth rate is
    within the sigma.
    """
    unknown = gyro_sigma_deg_h * DEG_PER_HOUR
    before = [(a, min(b, first_s)) for a, b in stands if min(b, first_s) - a >= 10.0]
    if not before or float(unknown.max()) < EARTH_RATE_RAD_S:
        return RateBefore(np.zeros(3), unknown)
    start, end = before[-1]
    log = imu.between(max(start, end - REST_S), end)
    seconds = float(log.dt_s.sum())
    noise = gyro_densities(twin.gyro).white / np.sqrt(seconds)
    gyro = twin.gyro
    walk = walk_with_flicker(gyro.rate_random_walk_deg_h_sqrt_h, gyro.bias_instability_deg_h)
    walk *= DEG_PER_HOUR
    late = np.sqrt(max(first_s - end, 0.0) / 3600.0)
    sigma = float(np.sqrt(EARTH_RATE_RAD_S**2 + noise**2 + (walk * late) ** 2))
    mean = log.dtheta_rad.sum(axis=0) / seconds
    return RateBefore(mean, np.full(3, sigma), coarse.rest_means(log))


def last_fix(fixes: Fixes, log: ImuLog) -> int | None:
    """The last whole fix of a log, not more than a second before its end."""
    end_s = log.time_s[-1]
    rows = np.flatnonzero(
        (fixes.time_s <= end_s)
        & (fixes.time_s > end_s - 1.2)
        & np.isfinite(fixes.r_e_m[:, 0] + fixes.v_n_m_s[:, 0])
    )
    return int(rows[-1]) if rows.size else None


def started(at: Stretch, C_nb: NDArray, rate_b: NDArray, theta: NDArray) -> FoundStart:
    """At the end of the log: the last fix brought to its time at its own velocity, antenna to
    unit.

    theta (3, 3): covariance of the attitude's NED error; rate_b (3,): angular rate there.
    """
    log, fixes, fix, lever_arm_m, gyro = at.log, at.fixes, at.fix, at.lever_arm_m, at.gyro
    late_s = float(log.time_s[-1] - fixes.time_s[fix])
    swing = C_nb @ np.cross(rate_b, lever_arm_m)
    v_n = fixes.v_n_m_s[fix] - swing
    lat, lon, height = (float(a) for a in geodetic_from_ecef(fixes.r_e_m[fix]))
    off = late_s * v_n - C_nb @ lever_arm_m
    gravity = float(gravity_magnitude(lat, height))
    radius = 6378137.0 + height
    site = Site(
        lat_rad=lat + off[0] / radius,
        lon_rad=lon + off[1] / (radius * np.cos(lat)),
        height_m=height - off[2],
    )
    late_v = 10.0 * late_s + 0.1  # m/s that the velocity may have changed since the fix
    P = _covariance(
        3.0 * fixes.sigma_position_m[fix] + late_s * late_v + 1.0,
        float(3.0 * fixes.sigma_velocity_m_s[fix].max() + late_v),
        theta,
        gyro.sigma_rad_s,
        at.twin,
        gyro.means,
        gravity=gravity,
    )
    state = NavState(time_s=float(log.time_s[-1]), site=site, v_n_m_s=v_n, C_nb=_orthonormal(C_nb))
    start = AidedStart(
        state=state, gyro_bias_rad_s=gyro.bias_rad_s, accel_bias_m_s2=np.zeros(3), covariance=P
    )
    return FoundStart(
        start=start,
        method=StartMethod.MATCHING,
        span=(float(log.time_s[0]), float(log.time_s[-1])),
        sigma_heading_rad=float(np.sqrt(theta[2, 2])),
        gyro_sigma_rad_s=gyro.sigma_rad_s,
    )


def _covariance(
    position_m: NDArray,
    velocity_m_s: float,
    theta: NDArray,
    gyro_rad_s: NDArray,
    twin: TwinModel,
    means: coarse.RestMeans | None,
    *,
    gravity: float | None = None,
) -> NDArray:
    """P (15, 15); the accelerometers' turn-on, widened by what |f| at rest is off gravity."""
    P = np.zeros((15, 15))
    accel = max(twin.accel.turn_on_ug, 1.0) * MICRO_G
    if means is not None and gravity is not None:
        accel = float(np.hypot(accel, np.linalg.norm(means.f_ib_b) - gravity))
    for part, sigma in (
        (POS, position_m),
        (VEL, np.full(3, velocity_m_s)),
        (GYRO, gyro_rad_s),
        (ACCEL, np.full(3, accel)),
    ):
        P[part, part] = np.diag(np.square(sigma))
    P[THETA, THETA] = theta
    return P


def _site(r_e: NDArray) -> Site:
    lat, lon, height = (float(a) for a in geodetic_from_ecef(r_e))
    return Site(lat_rad=lat, lon_rad=lon, height_m=height)


def _orthonormal(C: NDArray) -> NDArray:
    U, _, Vt = np.linalg.svd(C)
    return np.asarray(U @ Vt)
