"""Claim 1 of US 5,527,003 step by step, as a separate path beside the filter, to be compared with
it.

(a) initial alignment -> (b) navigation mode -> (c) rates and accelerations, (d) gyro temperatures
-> (e) acceleration against the computed platform -> (f) acceleration rate -> (g) tilt rate -> (h)
set 1 of (tilt rate, temperature) -> (i) bias errors -> (j) set 2 -> (k) taxi -> (l) heading error
from cross-track motion -> (m) set 3 = set 2 less Omega cosL psi on the east axis -> (n) ready to be
merged. Steps (o) to (q) are `infield.table.merge` and the table's use.

Set 1 is taken twice: by the Schuler bracket on windows of the velocity, (e) to (g) to the letter,
and by a filter over the parked phase that is smoothed over the whole of it
(`alignment.tilt_rate`). Sets 2 and 3 go on with the smoothed rates.

Known limits, kept on purpose: one heading error for all points (the vertical gyro's drift since is
not removed), the windows do not share their common errors, accelerometer drift counts as tilt rate.
The filter does all three.

Decision: docs/decisions/0010-points-exclude-prior.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from alignment.motion.kinds import ROLLING, STILL
from alignment.motion.stillness import Motion
from alignment.result import Alignment
from alignment.tilt_rate import SmoothedTiltRate, TiltRate, smoothed_tilt_rates, tilt_rates
from infield.session.reasons import ChainNote
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.attitude import euler_from_dcm
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.noise import accel_densities, gyro_densities
from ins.records import ImuSource, NavHistory, NavState, Site, TwinModel
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG_PER_HOUR, MICRO_G

# a heading sigma above this share of its prior means that the taxi did not show it: it told 0.1
# nats
UNSEEN = 0.9


@dataclass(frozen=True)
class ChainPoint:
    """Set 2 and set 3 of one window: bias errors left by the table, north and east at the parked
    heading [deg/h].

    sigma_filtered_deg_h: of the same filter without smoothing; bracket_*: set 1 by the bracket (NaN
    where too little of the window was at rest).
    """

    time_s: float
    temperature_degC: float
    north_deg_h: float
    east_relative_deg_h: float
    east_deg_h: float
    sigma_deg_h: float
    sigma_filtered_deg_h: float
    bracket_north_deg_h: float
    bracket_east_relative_deg_h: float
    bracket_sigma_deg_h: float


@dataclass(frozen=True)
class ClaimChain:
    """psi: heading error at the end of the alignment [rad], NaN where the taxi does not show it."""

    points: tuple[ChainPoint, ...]
    heading_rad: float
    psi_rad: float
    sigma_psi_rad: float
    note: ChainNote


@dataclass(frozen=True)
class ChainSpan:
    """What the chain navigates: from the alignment of step (a) at a site, until a time."""

    site: Site
    aligned: Alignment
    until_s: float


def run_claim_chain(
    imu: ImuSource,
    span: ChainSpan,
    twin: TwinModel,
    temperature: GyroTemperature,
    *,
    motion: Motion,
    prior_sigma_deg_h: float,
) -> ClaimChain:
    """Steps (b) to (n). imu: compensated with the stored table; motion: of the run."""
    site, aligned = span.site, span.aligned
    if aligned.C_nb is None:
        raise ValueError("the chain starts from an alignment that found an attitude")
    start = NavState(time_s=aligned.time_s, site=site, v_n_m_s=np.zeros(3), C_nb=aligned.C_nb)
    pieces = imu.pieces(aligned.time_s, span.until_s)
    # (b), (c)
    history = navigate(pieces, start, epoch_s=1.0, vertical=VerticalChannel(mode="hold"))
    motion = motion.at(history.time_s)
    parked = motion.time_s <= motion.parked_until_s
    arw = gyro_densities(twin.gyro).white
    still = parked & (motion.kind == STILL)
    bracket = tilt_rates(history, still, arw=arw, velocity_sigma_m_s=motion.sigma_v_m_s)  # (e-h)
    set_1 = smoothed_tilt_rates(
        history,
        still,
        arw=arw,
        vrw=accel_densities(twin.accel).white,
        velocity_sigma_m_s=max(motion.sigma_v_m_s, twin.vehicle.sway_m_s),
        rate_sigma_rad_s=prior_sigma_deg_h * DEG_PER_HOUR,
    )
    # (k, l)
    psi, sigma, note = _heading_from_taxi(
        history, motion.kind, twin, aligned, prior_sigma_deg_h * DEG_PER_HOUR
    )
    coupling = EARTH_RATE_RAD_S * np.cos(site.lat_rad)
    # (i), (j), (m)
    points = tuple(
        _set_3(rate, _same_window(rate, bracket), temperature, coupling * psi) for rate in set_1
    )
    return ClaimChain(points, aligned.heading_rad, psi, sigma, note)


def _same_window(rate: TiltRate, others: Sequence[TiltRate]) -> TiltRate | None:
    return next((other for other in others if abs(other.time_s - rate.time_s) < 1.0), None)


def _set_3(
    rate: SmoothedTiltRate,
    bracket: TiltRate | None,
    temperature: GyroTemperature,
    east_offset_rad_s: float,
) -> ChainPoint:
    """(i) tilt rate -> bias error: north direct, east relative; (m) subtract Omega cosL psi."""
    rows = temperature.between(rate.time_s - 0.5 * rate.window_s, rate.time_s + 0.5 * rate.window_s)
    return ChainPoint(
        time_s=rate.time_s,
        temperature_degC=float(temperature.temperature_degC[rows].mean()),  # (d)
        north_deg_h=rate.u_north_rad_s / DEG_PER_HOUR,
        east_relative_deg_h=rate.u_east_rad_s / DEG_PER_HOUR,
        east_deg_h=(rate.u_east_rad_s - east_offset_rad_s) / DEG_PER_HOUR,
        sigma_deg_h=rate.sigma_rad_s / DEG_PER_HOUR,
        sigma_filtered_deg_h=rate.sigma_filtered_rad_s / DEG_PER_HOUR,
        bracket_north_deg_h=bracket.u_north_rad_s / DEG_PER_HOUR if bracket else float("nan"),
        bracket_east_relative_deg_h=(
            bracket.u_east_rad_s / DEG_PER_HOUR if bracket else float("nan")
        ),
        bracket_sigma_deg_h=bracket.sigma_rad_s / DEG_PER_HOUR if bracket else float("nan"),
    )


def _heading_from_taxi(
    history: NavHistory, kind: NDArray, twin: TwinModel, aligned: Alignment, prior_rad_s: float
) -> tuple[float, float, ChainNote]:
    """(l): least squares of cross-track velocity while rolling and of both velocities at stops."""
    rolling = np.flatnonzero(kind == ROLLING)
    lat = float(history.lat_rad[0])
    coupling = EARTH_RATE_RAD_S * np.cos(lat)
    if not rolling.size:
        return float("nan"), float("nan"), ChainNote.NO_TAXI
    rows = slice(max(int(rolling[0]) - 60, 1), int(np.flatnonzero(kind <= ROLLING)[-1]) + 1)
    gravity = float(gravity_magnitude(lat, history.height_m[0]))
    response, v = _responses(history, rows, gravity, aligned.heading_rad)
    seen = _observations(history, kind, rows, response, v, twin)
    level = twin.accel.turn_on_ug * MICRO_G
    prior = np.array([prior_rad_s, level, level, 0.01, 1.0, 1.0, 1e-3, 1e-3])
    whitener = np.linalg.cholesky(_covariance(seen, history.time_s[rows], gravity, twin))
    # unknowns in units of their prior sigma
    scaled = solve_triangular(whitener, seen.A * prior, lower=True)
    P = np.linalg.inv(scaled.T @ scaled + np.eye(len(prior)))
    x = P @ (scaled.T @ solve_triangular(whitener, seen.z, lower=True))
    eps, sigma = float(x[0]) * prior_rad_s, float(np.sqrt(P[0, 0])) * prior_rad_s
    if sigma > UNSEEN * prior_rad_s:
        return float("nan"), float("nan"), ChainNote.BLIND
    return -eps / coupling, sigma / coupling, ChainNote.FOUND


def _responses(
    history: NavHistory, rows: slice, gravity: float, parked_heading_rad: float
) -> tuple[NDArray, NDArray]:
    """Velocity error (n, 2, 8) in north, east per unknown over the rows, and the computed velocity
    (n, 2).

    Unknowns: east bias error, accelerometer x, y biases, crab (none here), velocity at the start
    (2), acceleration at the start (2). Tilt rate -> acceleration -> velocity by sums over the
    epochs (physics.md 6.5, under ten minutes).
    """
    dt = np.diff(history.time_s)[rows.start - 1 : rows.stop - 1, None]
    heading = euler_from_dcm(history.C_nb[rows])[2]
    t = np.cumsum(dt[:, 0])
    out = np.zeros((len(heading), 2, 8))
    # body parts of a bias along parked east
    b_x, b_y = np.sin(parked_heading_rad), np.cos(parked_heading_rad)
    eps_n = b_x * np.cos(heading) - b_y * np.sin(heading)
    eps_e = b_x * np.sin(heading) + b_y * np.cos(heading) - 1.0
    tilt = np.cumsum(np.stack([eps_n, eps_e], axis=1) * dt, axis=0)
    out[:, :, 0] = np.cumsum(gravity * np.stack([-tilt[:, 1], tilt[:, 0]], axis=1) * dt, axis=0)
    c, s = np.cos(heading), np.sin(heading)
    c0, s0 = np.cos(parked_heading_rad), np.sin(parked_heading_rad)
    out[:, :, 1] = np.cumsum(np.stack([c - c0, s - s0], axis=1) * dt, axis=0)
    out[:, :, 2] = np.cumsum(np.stack([-s + s0, c - c0], axis=1) * dt, axis=0)
    out[:, 0, 4] = out[:, 1, 5] = 1.0
    out[:, 0, 6] = out[:, 1, 7] = t
    return out, history.v_n_m_s[rows, :2]


@dataclass(frozen=True)
class _Observations:
    """Rows A (m, 8) and values z (m,); the epoch, direction (m, 2) in north, east and own sigma of
    each.
    """

    A: NDArray
    z: NDArray
    epoch: NDArray
    direction: NDArray
    sigma: NDArray


def _observations(
    history: NavHistory, kind: NDArray, rows: slice, response: NDArray, v: NDArray, twin: TwinModel
) -> _Observations:
    """Every third epoch: lateral velocity while rolling straight, both components while
    standing.
    """
    heading = euler_from_dcm(history.C_nb[rows])[2]
    forward = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    side = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    turning = np.abs(np.gradient(np.unwrap(heading))) > 2e-3
    every = np.arange(len(heading)) % 3 == 0
    roll = np.flatnonzero((kind[rows] == ROLLING) & ~turning & every)
    stop = np.flatnonzero((kind[rows] == STILL) & every)
    epoch = np.concatenate([roll, stop, stop])
    north, east = (np.tile(d, (stop.size, 1)) for d in ([1.0, 0.0], [0.0, 1.0]))
    direction = np.concatenate([side[roll], north, east])
    A = np.einsum("mi,mij->mj", direction, response[epoch])
    A[: roll.size, 3] = np.einsum("ni,ni->n", forward, v)[roll]
    lateral = np.full(roll.size, max(twin.vehicle.lateral_noise_m_s, 1e-3))
    sway = np.full(2 * stop.size, max(twin.vehicle.sway_m_s, 1e-3))
    return _Observations(
        A,
        np.einsum("mi,mi->m", direction, v[epoch]),
        epoch,
        direction,
        np.concatenate([lateral, sway]),
    )


def _covariance(seen: _Observations, time_s: NDArray, gravity: float, twin: TwinModel) -> NDArray:
    """Noise of the observations: their own, and the velocity error that angle and velocity random
    walk build up.

    For s < t: g^2 N^2 s^2 (3 t - s) / 6 from the angle, n^2 s from the velocity, in north and east
    alike.
    """
    t = (time_s - time_s[0] + 1.0)[seen.epoch]
    early, late = np.minimum(t[:, None], t[None, :]), np.maximum(t[:, None], t[None, :])
    angle = (gravity * gyro_densities(twin.gyro).white) ** 2 * early**2 * (3.0 * late - early) / 6.0
    velocity = accel_densities(twin.accel).white ** 2 * early
    return (seen.direction @ seen.direction.T) * (angle + velocity) + np.diag(seen.sigma**2)
