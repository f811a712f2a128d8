"""Fine alignment: the navigation-mode filter on the parked stretch, and what it is worth.

Decision: docs/decisions/0013-latitude-alarm.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment import coarse, levelling
from alignment.linearised import Course, NothingStands, RestedLog, solve
from alignment.motion import imu_faults, kinds, stillness
from alignment.motion.inertial import BRIEF_BLOCKS, first_rest
from alignment.motion.seconds import LogSeconds, seconds_of
from alignment.navigation_filter import diffuse_heading_rad, views_of
from alignment.reasons import AlignmentReason, AlignmentVerdict
from alignment.result import Alignment, BiasPrior, Solution
from ins.attitude import dcm_from_rotation_vector, euler_from_dcm
from ins.earth import EARTH_RATE_RAD_S
from ins.errors.table import RAW_BIAS_DEG_H, DEFAULT_SIGMA_deg_h
from ins.estimation.measurements.attitude import error_rows
from ins.kalman import nis_band
from ins.noise import gyro_densities
from ins.records import ImuSource, Phase, Site, Span, TwinModel
from ins.units import DEG, DEG_PER_HOUR
from ins.verdicts import Reason, because

MAX_LATITUDE_RAD = 78.25 * DEG  # aviation practice (requirements.md, R2): none above
# the angle random walk of a ring-laser unit (0.002 deg/sqrt(h)) leaves 1.5 mrad of heading over
# it at 45 deg
MIN_REST_S = 60.0
# of the z axis off the vertical, either way: the parked filter holds the place along x and y, which
# have to be near level. 30 deg: aligned to within its sigma at 45 deg
MAX_TILT_RAD = 45.0 * DEG
# of level Earth rate: gyros known worse than this find no heading; 0.3 is 17 deg, up to where the
# filter is linear to 1.5 %
LEVEL_SHARE = 0.3
DOUBTFUL_SIGMAS = 2.5  # remarked: one of 80 sound runs is
LATITUDE_SIGMAS = 3.0  # alarm level of the latitude test: 0.3 % false alarms
# tried in turn where the residuals exceed the model
NOISE_SCALES = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 13.0)
# share of the measurements that the gate may leave out; chosen: 2e-9 of sound ones lie beyond its
# 6 sigma, so 1 in 20 is a vehicle that moves
MAX_REJECTED = 0.05
# of the diffuse heading prior: above it, the measurements said less than 3 times as much of the
# heading as the prior, next to nothing
NO_BETTER = 0.5
BIAS_BIN_S = 300.0
# measurements beyond the gate and no further apart are one stretch: 1.5 steps (STILL_STEP_S of
# the filter, 10 s)
GATE_GAP_S = 15.0
WARM_UP_S = 1800.0


@dataclass(frozen=True)
class ReadLog:
    """What is known of a log before it is aligned: its seconds, and what was repaired in it; None:
    looked for then.
    """

    seconds: LogSeconds | None = None
    faults: Sequence[imu_faults.ImuFault] | None = None


NOT_READ = ReadLog()


def align(
    imu: ImuSource,
    site: Site,
    twin: TwinModel,
    *,
    bias_sigma_deg_h: NDArray | None = None,
    phases: tuple[Phase, ...] = (),
    hold_heading: bool = True,
    read: ReadLog = NOT_READ,
) -> Alignment:
    """Attitude with sigma at the end of the parked time of a log.

    imu: compensated with the table where there is one. bias_sigma_deg_h (3,): sigma of what is left
    of the gyro biases; None: nothing is known of the unit, the technology's raw bias widened by
    what the parked rates show. Refusals come back as a verdict with reasons, not as exceptions.
    """
    if abs(site.lat_rad) > MAX_LATITUDE_RAD:
        return _refused(
            because(
                AlignmentReason.LATITUDE_TOO_HIGH,
                latitude_deg=site.lat_rad / DEG,
                limit_deg=MAX_LATITUDE_RAD / DEG,
            )
        )
    seconds = read.seconds or seconds_of(imu)
    rest = first_rest(seconds) or first_rest(seconds, BRIEF_BLOCKS)
    if rest is None:
        return _refused(because(AlignmentReason.NEVER_RESTS))
    means = coarse.earth_rate_means(imu.between(*rest))
    arw = gyro_densities(twin.gyro).white
    if bias_sigma_deg_h is None:
        sigma = np.full(3, unknown_bias_sigma_deg_h(twin, means))
    else:
        sigma = np.asarray(bias_sigma_deg_h, dtype=float)
    prior = _drifting_bias(sigma * DEG_PER_HOUR, start_s=rest[0], end_s=imu.end_s + 1.0)
    level_sigma = float(np.max(sigma)) * DEG_PER_HOUR + arw / np.sqrt(means.seconds)
    earth_level = EARTH_RATE_RAD_S * np.cos(site.lat_rad)
    turns = levelling.turns(means)
    if turns and twin.gyro_technology != "mems":
        return _refused(turns)
    if level_sigma > LEVEL_SHARE * earth_level:
        of_technology = bias_sigma_deg_h is None and twin.gyro_technology != "mems"
        doubtful_deg_h = float(sigma[0]) if of_technology else None
        log = RestedLog(imu, site, rest)
        return _level_alone(log, twin, level_sigma, turns=turns, doubtful_deg_h=doubtful_deg_h)
    if rest[1] - rest[0] < MIN_REST_S - coarse.COARSE_BLOCK_S:
        return _refused(because(AlignmentReason.NEVER_RESTS))
    tilt_rad = levelling.tilt_of_z(means)
    if tilt_rad > MAX_TILT_RAD:
        values = {"tilt_deg": tilt_rad / DEG, "limit_deg": MAX_TILT_RAD / DEG}
        return _refused(because(AlignmentReason.ON_ITS_SIDE, **values))
    faults = read.faults
    if faults is None:
        imu, faults = imu_faults.repair(imu, seconds, rest[0], imu.end_s)
    course = Course(parked_only=True, hold_heading=hold_heading, noise_scales=NOISE_SCALES)
    try:
        solution = solve(RestedLog(imu, site, rest, phases, faults), twin, prior, course=course)
        result = _judged(_attitude(solution, phases), solution, twin)
    except NothingStands as error:
        result = _refused(error.reason)
    return _latitude_test(result, site, means, float(np.max(sigma)), arw)


def _level_alone(
    log: RestedLog,
    twin: TwinModel,
    level_sigma_rad_s: float,
    *,
    turns: Reason | None,
    doubtful_deg_h: float | None,
) -> Alignment:
    """Roll and pitch of gyros too uncertain for a heading."""
    reasons = [because(AlignmentReason.TURNS_OR_BIAS, turns=turns)] if turns else []
    if doubtful_deg_h is not None:
        usual = DEFAULT_SIGMA_deg_h[twin.gyro_technology]
        twin, like = levelling.like_mems(twin, doubtful_deg_h, usual)
        reasons.append(like)
    no_heading = because(
        AlignmentReason.NO_HEADING,
        sigma_deg_h=level_sigma_rad_s / DEG_PER_HOUR,
        level_deg_h=EARTH_RATE_RAD_S * np.cos(log.site.lat_rad) / DEG_PER_HOUR,
    )
    found = levelling.level(
        log.imu,
        log.site,
        twin,
        rest=log.rest,
        gyro_sigma_rad_s=level_sigma_rad_s,
        reason=no_heading,
    )
    return replace(found, reasons=(*found.reasons, *reasons))


def _judged(result: Alignment, solution: Solution, twin: TwinModel) -> Alignment:
    """The result, refused where nothing was measured or where the vehicle moves."""
    level_rate = solution.last.level_earth_rate_rad_s
    diffuse = diffuse_heading_rad(solution.last.bias_covariance, level_rate)
    if result.dof == 0 or result.sigma_heading_rad > NO_BETTER * diffuse:
        nothing = because(
            AlignmentReason.NOTHING_MEASURED,
            dof=result.dof,
            sigma_deg=result.sigma_heading_rad / DEG,
            prior_deg=diffuse / DEG,
            used_percent=100 * result.used_share,
        )
        return replace(result, verdict=AlignmentVerdict.REFUSED, reasons=(nothing,))
    scale = solution.fitted.scale.unit
    unexplained = nis_verdict(result.nis_mean, result.dof) is not None
    if unexplained or solution.fitted.rolls or rejected_share(solution) >= MAX_REJECTED:
        moves = because(AlignmentReason.MOVES, scale=NOISE_SCALES[-1], source=twin.source)
        return replace(result, verdict=AlignmentVerdict.REFUSED, reasons=(moves,))
    if scale <= 1.0:
        return result
    noisier = because(AlignmentReason.NOISIER, scale=scale, source=twin.source)
    return replace(result, reasons=(noisier,))


def _drifting_bias(sigma_rad_s: NDArray, *, start_s: float, end_s: float) -> BiasPrior:
    """Gyro biases over five-minute bins, half of each variance constant, half wandering with the
    warm-up.
    """
    edges = np.linspace(start_s, end_s, max(round((end_s - start_s) / BIAS_BIN_S), 1) + 1)
    centre = 0.5 * (edges[1:] + edges[:-1])
    lag = (centre[:, None] - centre[None, :]) / WARM_UP_S
    shape = 0.5 + 0.5 * np.exp(-0.5 * lag**2) + 1e-4 * np.eye(len(centre))
    return BiasPrior(edges, np.kron(shape, np.diag(sigma_rad_s**2)))


def unknown_bias_sigma_deg_h(twin: TwinModel, means: coarse.RestMeans) -> float:
    """Bias sigma of a unit without a table: what is usual of its technology, or the excess of
    ``|omega|`` over Earth rate where that is more: its bias along one axis, beside noise.
    """
    excess = coarse.latitude_from_rates(means)[1] / DEG_PER_HOUR
    noise = twin.gyro.arw_deg_sqrt_h / np.sqrt(means.seconds / 3600.0)
    seen = max(excess**2 - noise**2, 0.0)
    return max(RAW_BIAS_DEG_H[twin.gyro_technology], float(np.sqrt(seen)))


def _attitude(solution: Solution, phases: tuple[Phase, ...]) -> Alignment:
    """Corrected attitude at the end of the filter's plan."""
    flt, views = solution.filter, views_of(solution.history, solution.plan)
    end_s = float(views.end_s[-1])
    rows = np.zeros((3, flt.x.size))
    for row, of_phi in zip(rows, error_rows(views.lat_rad[-1], views.radius_m[-1])):
        for state, coefficient in of_phi.items():
            row[state] = coefficient
    C_nb = dcm_from_rotation_vector(-(rows @ flt.x)) @ views.C_nb[-1]
    P_phi = rows @ flt.P @ rows.T
    roll, pitch, heading = (float(a) for a in euler_from_dcm(C_nb))
    level = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    P_level = level @ P_phi[:2, :2] @ level.T
    tally = flt.tally
    dof = sum(tally.dof.values())
    return Alignment(
        verdict=AlignmentVerdict.ALIGNED,
        reasons=(),
        time_s=end_s,
        roll_rad=roll,
        pitch_rad=pitch,
        heading_rad=heading,
        sigma_roll_rad=float(np.sqrt(P_level[0, 0])),
        sigma_pitch_rad=float(np.sqrt(P_level[1, 1])),
        sigma_heading_rad=float(np.sqrt(P_phi[2, 2])),
        duration_s=end_s - float(solution.history.time_s[0]),
        phases=phases or stillness.detect_phases(solution.motion),
        excluded=solution.motion.excluded(),
        nis_mean=sum(tally.nis.values()) / max(dof, 1),
        dof=dof,
        C_nb=C_nb,
        used_share=_used_share(solution),
        level=solution.level,
    )


def _used_share(solution: Solution) -> float:
    """Share of the parked seconds that the filter used."""
    plan, time_s = solution.plan, solution.history.time_s
    seconds = time_s[plan.last] - time_s[plan.first]
    parked = seconds[plan.kind <= kinds.DISTURBED].sum()
    return float(seconds[plan.kind == kinds.STILL].sum() / max(parked, 1e-9))


def _latitude_test(
    result: Alignment, site: Site, means: coarse.RestMeans, bias_deg_h: float, arw: float
) -> Alignment:
    """Compare the entered latitude with the angle between gravity and Earth rate."""
    found, excess = coarse.latitude_from_rates(means)
    rate_noise = max(1.25 * arw / np.sqrt(means.seconds), float(np.max(means.sigma_omega_rad_s)))
    noise = np.hypot(bias_deg_h * DEG_PER_HOUR, rate_noise)
    sigma = float(noise / EARTH_RATE_RAD_S)
    refused = result.verdict is AlignmentVerdict.REFUSED
    if refused and abs(excess) > LATITUDE_SIGMAS * noise:
        return result
    near = LATITUDE_SIGMAS * float(np.hypot(sigma, site.sigma_lat_rad))
    wrong = abs(found - site.lat_rad) > near
    if refused:
        reason = _wrong_latitude(site, found, sigma)
        return _refused(reason) if wrong else result
    result = replace(result, latitude_rad=found, sigma_latitude_rad=sigma)
    if not wrong:
        apart = LATITUDE_SIGMAS * abs(found - site.lat_rad) / near
        if apart < DOUBTFUL_SIGMAS:
            return result
        values = _latitudes(site, found, sigma)
        doubtful = because(AlignmentReason.LATITUDE_DOUBTFUL, apart=apart, **values)
        return replace(result, reasons=(*result.reasons, doubtful))
    # what the latitude leaves of Earth rate looks like noise beyond the model
    others = [r for r in result.reasons if r.code is not AlignmentReason.NOISIER]
    reasons = (*others, _wrong_latitude(site, found, sigma))
    return replace(result, verdict=AlignmentVerdict.INCONSISTENT, reasons=reasons)


def _latitudes(site: Site, found_rad: float, sigma_rad: float) -> dict[str, float]:
    return {
        "entered_deg": site.lat_rad / DEG,
        "found_deg": found_rad / DEG,
        "sigma_deg": sigma_rad / DEG,
    }


def _wrong_latitude(site: Site, found_rad: float, sigma_rad: float) -> Reason:
    """What was entered in place of the latitude that the gyros show."""
    near, values = LATITUDE_SIGMAS * sigma_rad, _latitudes(site, found_rad, sigma_rad)
    if abs(site.lat_rad / DEG - found_rad) <= near:
        return because(AlignmentReason.LATITUDE_IN_RADIANS, **values)
    if abs(site.lon_rad - found_rad) <= near:
        return because(AlignmentReason.LATITUDE_IS_LONGITUDE, **values)
    return because(AlignmentReason.WRONG_LATITUDE, **values)


def nis_verdict(nis_mean: float, dof: int) -> Reason | None:
    """A reason where the filter's NIS is above its 99.9 % band; None where it is not."""
    high = nis_band(dof, 0.999)[1]
    if nis_mean <= high:
        return None
    return because(AlignmentReason.EXCESS_RESIDUALS, nis_mean=nis_mean, limit=high)


def rejected_share(solution: Solution) -> float:
    """Share of the measurements that the gate left out."""
    tally = solution.filter.tally
    return len(tally.rejected) / max(
        len(tally.rejected) + sum(len(v) for v in tally.normalised.values()), 1
    )


def _refused(reason: Reason) -> Alignment:
    return Alignment(verdict=AlignmentVerdict.REFUSED, reasons=(reason,))


def excluded_spans(solution: Solution) -> tuple[Span, ...]:
    """What the filter did not use and why: disturbed stretches and single measurements beyond the
    gate.
    """
    gated: list[Span] = []
    last_kind = None
    for time_s, kind in solution.filter.tally.rejected:
        if gated and kind == last_kind and time_s - gated[-1].end_s < GATE_GAP_S:
            gated[-1] = replace(gated[-1], end_s=time_s)
        else:
            gated.append(Span(start_s=max(time_s - 1.0, 0.0), end_s=time_s, reason=f"gate: {kind}"))
        last_kind = kind
    return tuple(sorted([*solution.motion.excluded(), *gated], key=lambda s: s.start_s))
