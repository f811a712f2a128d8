"""Zero-rate bias of a parked unit against temperature, for gyros too uncertain to find a heading at
rest (MEMS)::

    rate_k = b_k + e_s + noise

with e_s the Earth rate in body axes, one and the same vector for a stretch s of rest. Levelled by
gravity, the vertical part of e is known (-Omega sinL along down), the level part is not: on an
unknown heading it is uniform on a circle of Omega cosL, mean 0, variance (Omega cosL)^2 / 2 on
either level direction. It is one common error of all points of a stretch, not one of each point,
and a surveyed heading takes it away; what stretches of one log have in common of it is for the
turns between them to say (`infield.session.parked.earth`). b_k are the session's biases over bins,
with the joint prior of table and twin that every session has (`infield.session.bins`): one turn-on,
while flicker and random walk go on between the stretches. Where it does not stand there is no bin.
Units inside: deg/h. Source: [derived]; Bayesian update of a Gaussian, Bar-Shalom (2001), eq.
(1.4.14-1).

Decision: docs/decisions/0032-no-heading-no-navigation.md.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from alignment import levelling
from alignment.gyrocompass import LEVEL_SHARE
from alignment.motion.parked_seconds import ParkedSeconds, parked_places
from alignment.motion.seconds import LogSeconds
from alignment.motion.sway import averages, sway_of
from alignment.motion.turn_between import levelled, turn_between
from infield.session.bins import SessionBins, bins_between, equal_edges
from infield.session.estimate import ParkedEvidence, ParkedStretch, SessionEstimate
from infield.session.log import compensated_imu, compensated_seconds
from infield.session.parked.earth import session_earth
from infield.session.parked.stretches import MIN_PARKED_S, StationarySegments
from infield.session.reasons import ParkedReason
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.earth import EARTH_RATE_RAD_S
from ins.errors.catalogue import prior
from ins.noise import FLICKER_FLOOR
from ins.records import Run, Site, Span, TwinModel
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, HOUR, PPM
from ins.verdicts import Reason, because

SHORTEST_RATE_BIN_S, MOST_BINS = 60.0, 60
USED_SHARE = 0.5  # of a bin that must be still: its sigma is at most 1.41 of that of a whole one
NOISIER = 1.2  # times the twin's white noise: 20 % of a sigma is worth saying
# times the twin's white noise, and nothing is taken: 100 times the variance is another unit or no
# rest
TOO_NOISY = 10.0
# between two up vectors: 20 deg. A vehicle parks within that, and what its own tilt adds is in the
# table
ANOTHER_ATTITUDE = 0.35
FREE_LEVEL = 1e3  # in sigmas of the innovations: nothing believed of the level


def no_heading(
    run: Run, table: ThermalTable, temperature: GyroTemperature, twin: TwinModel
) -> bool:
    """Whether the unit's gyros are known too poorly for a gyrocompass: MEMS, and worse than
    LEVEL_SHARE of level Earth rate.
    """
    if run.header.gyro_technology != "mems":
        return False
    sigma = max(
        float(table.sigma_deg_h(k, temperature.temperature_degC[0, k])[0]) for k in range(3)
    )
    level = EARTH_RATE_RAD_S * np.cos(run.header.site.lat_rad) / DEG_PER_HOUR
    return bool(np.hypot(sigma, twin.gyro.turn_on_deg_h) > LEVEL_SHARE * level)


def bin_seconds(duration_s: float) -> float:
    """Length of the bins of a parked stretch [s]."""
    return max(SHORTEST_RATE_BIN_S, duration_s / MOST_BINS)


def estimate_parked(
    run: Run,
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    settings: SessionSettings,
    *,
    rests: StationarySegments,
) -> SessionEstimate | Reason:
    """The session's biases from its parked seconds, or why there is nothing to take."""
    imu = compensated_imu(run, table, temperature, twin)
    log = compensated_seconds(run, table, temperature, twin)
    stretches, left_out = _settled(log, rests.stretches, twin)
    if not stretches:
        why = left_out[0].reason
        assert isinstance(why, Reason)
        return why
    places = [s.seconds for s in stretches]
    edges, stretch = _edges(places)
    bins = bins_between(table, temperature, twin, settings, edges)
    if (stretch < 0).any():
        bins = bins.only(stretch >= 0)
    stretch = stretch[stretch >= 0]
    bins = bins.doubted(_by_attitude(places, stretch, twin))
    scale = settings.sigma_scale_factor_ppm[run.header.gyro_technology] * PPM
    turns = tuple(
        turn_between(imu, a, b, twin.gyro, log=log, sigma_scale=scale) for a, b in pairwise(places)
    )
    earth = session_earth(
        run, places, turns, twin, settings, survey=surveyed_first(run, rests, places[0])
    )
    rate, used_s = _bin_rates(bins, stretches, stretch, earth.known)
    noise = _noise(bins, stretches, stretch, used_s)
    measured = _measured(rate, noise, earth.covariance, stretch)
    left_out = tuple(sorted([*rests.left_out, *left_out], key=lambda span: span.start_s))
    evidence = ParkedEvidence(
        stretches, stretch, rate, used_s, earth, turns, left_out, *_shape_nis(bins, *measured)
    )
    sigma = float(np.sqrt(np.diag(bins.prior)[:3].max()))
    level = levelling.level(
        imu,
        run.header.site,
        twin,
        rest=(float(places[0].start_s[0]), float(places[0].end_s[-1])),
        gyro_sigma_rad_s=sigma * DEG_PER_HOUR,
        reason=_reason(sigma, run.header.site),
    )
    mean, P = _posterior(bins, *measured)
    return SessionEstimate(
        bins=bins,
        mean_deg_h=mean,
        covariance=P,
        alignment=replace(level, duration_s=stretches[0].still_s),
        solution=None,
        parked=evidence,
        heading_error_rad=float("nan"),
        sigma_heading_rad=float("nan"),
        sigma_heading_before_rad=float("nan"),
        nis_mean=evidence.shape_nis / max(evidence.shape_dof, 1),
        dof=evidence.shape_dof,
    )


def _settled(
    log: LogSeconds, found: tuple[tuple[float, float], ...], twin: TwinModel
) -> tuple[tuple[ParkedStretch, ...], tuple[Span, ...]]:
    """The stretches that stand up to their own seconds, and the others with why not."""
    kept: list[ParkedStretch] = []
    left_out: list[Span] = []
    for start, end in found:
        places = parked_places(log, start, end)
        before = len(kept)
        for seconds in places:
            stretch = _stretch(seconds, twin)
            a, b = float(seconds.start_s[0]), float(seconds.end_s[-1])
            if stretch.still_s < MIN_PARKED_S:
                continue
            if stretch.noise_scale > TOO_NOISY:
                noisy = because(
                    ParkedReason.TOO_NOISY,
                    scale=stretch.noise_scale,
                    source=twin.source,
                    limit=TOO_NOISY,
                )
                left_out.append(Span(start_s=a, end_s=b, reason=noisy))
                continue
            kept.append(stretch)
        if len(kept) == before and not (left_out and left_out[-1].start_s >= start):
            not_still = because(
                ParkedReason.NOT_STILL, needed_s=MIN_PARKED_S, start_s=start, end_s=end
            )
            left_out.append(Span(start_s=start, end_s=end, reason=not_still))
    return tuple(kept), tuple(left_out)


def _stretch(seconds: ParkedSeconds, twin: TwinModel) -> ParkedStretch:
    """A stretch with its noise: white, or where it is noisier than the twin and sways the spectrum
    of its sway.
    """
    walk, scale = white_noise(seconds, twin)
    sway = sway_of(seconds) if scale > NOISIER else None
    if sway is None:
        return ParkedStretch(seconds, walk, scale)
    declared = declared_walk(twin)
    slow = sway.walk_deg_sqrt_h
    return ParkedStretch(seconds, np.maximum(slow, declared), float(slow.max() / declared), sway)


def _edges(places: list[ParkedSeconds]) -> tuple[NDArray, NDArray]:
    """Edges (M + 1,) of the bins of all stretches and of what lies between them."""
    spans = [(float(p.start_s[0]), float(p.end_s[-1])) for p in places]
    bin_s = bin_seconds(sum(b - a for a, b in spans))
    own = [equal_edges(a, b, bin_s) for a, b in spans]
    stretch = [np.append(np.full(len(e) - 1, k), -1) for k, e in enumerate(own)]
    return np.concatenate(own), np.concatenate(stretch)[:-1]


def surveyed_first(
    run: Run, rests: StationarySegments, first: ParkedSeconds
) -> tuple[float, float] | None:
    """The surveyed heading and its sigma [rad], where the first stretch is the first rest of the
    log.
    """
    survey = run.header.survey
    if survey.heading_rad is None or not survey.sigma_heading_rad:
        return None
    surveyed = rests.from_first and float(first.start_s[0]) <= rests.stretches[0][0] + 1.0
    return (survey.heading_rad, survey.sigma_heading_rad) if surveyed else None


def white_noise(seconds: ParkedSeconds, twin: TwinModel) -> tuple[NDArray, float]:
    """Angle random walk (3,) [deg/sqrt(h)], the larger of the twin's and the log's, and what
    neighbouring seconds of the log show over what the twin has them show.
    """
    seen = seconds.walk() / DEG_PER_SQRT_HOUR
    expected = _neighbours(twin, float(np.median(seconds.dt_s)))
    return np.maximum(seen, declared_walk(twin)), float(seen.max() / expected)


def _neighbours(twin: TwinModel, dt_s: float) -> float:
    """The random walk [deg/sqrt(h)] for which neighbouring means over dt_s take all noise of the
    twin: its Allan deviation there (IEEE Std 952, annex C). Of a MEMS unit's flicker as much may be
    in a second as of its white noise.
    """
    gyro, hours = twin.gyro, dt_s / HOUR
    flicker = (FLICKER_FLOOR * gyro.bias_instability_deg_h) ** 2 * hours
    walk = (gyro.rate_random_walk_deg_h_sqrt_h * hours) ** 2 / 3.0
    counted = (gyro.quantization_rad / DEG) ** 2 / 12.0 * 3.0 / hours
    return float(np.sqrt(declared_walk(twin) ** 2 + flicker + walk + counted))


def declared_walk(twin: TwinModel) -> float:
    """Angle random walk of the twin [deg/sqrt(h)], the vehicle's yaw creep with it."""
    creep = twin.vehicle.yaw_creep_arcsec_sqrt_h * ARCSEC / DEG
    return max(float(np.hypot(twin.gyro.arw_deg_sqrt_h, creep)), 1e-12)


def _noise(
    bins: SessionBins, stretches: tuple[ParkedStretch, ...], stretch: NDArray, used_s: NDArray
) -> NDArray:
    """Covariance (3N, 3N) [(deg/h)^2] of what noise and sway leave in the bins' mean rates."""
    walk = np.stack([s.walk_deg_sqrt_h for s in stretches])[stretch]
    R = np.diag((walk**2 / (np.maximum(used_s, 1.0)[:, None] / HOUR)).ravel())
    for k, one in enumerate(stretches):
        if one.sway is None:
            continue
        of = np.flatnonzero(stretch == k)
        weights = averages(one.seconds, bins.start_s[of], bins.end_s[of])
        for axis in range(3):
            own = 3 * of + axis
            R[np.ix_(own, own)] = one.sway.covariance(weights, axis)
    return R


def _bin_rates(
    bins: SessionBins, stretches: tuple[ParkedStretch, ...], stretch: NDArray, earth: NDArray
) -> tuple[NDArray, NDArray]:
    """Mean rate of each bin less known Earth rate (N, 3) [deg/h] and its still seconds (N,)."""
    found = [stretches[k].seconds.means(a, b) for k, a, b in zip(stretch, bins.start_s, bins.end_s)]
    used = np.array([s for _, s in found])
    rate = np.array([mean[3:] for mean, _ in found]) / DEG_PER_HOUR - earth[stretch]
    rate[used < USED_SHARE * bins.duration_s] = np.nan
    return rate, used


def _measured(
    rate: NDArray, noise: NDArray, common: NDArray, stretch: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Rows of the bins that were still, their rates (m,) and the covariance (m, m) of rates less
    biases; noise (3N, 3N), common (3S, 3S): of the stretches.
    """
    kept = np.isfinite(rate).all(axis=1)
    of = (3 * stretch[kept][:, None] + np.arange(3)).ravel()
    rows = np.flatnonzero(np.repeat(kept, 3))
    return rows, rate[kept].ravel(), common[np.ix_(of, of)] + noise[np.ix_(rows, rows)]


def _posterior(bins: SessionBins, rows: NDArray, y: NDArray, R: NDArray) -> tuple[NDArray, NDArray]:
    """Mean (3N,) and covariance (3N, 3N) of the biases beyond the table [deg/h]."""
    C = bins.prior
    gain = np.linalg.solve(C[np.ix_(rows, rows)] + R, C[rows]).T
    left = np.eye(len(C))
    left[:, rows] -= gain
    P = left @ C @ left.T + gain @ R @ gain.T
    return gain @ y, 0.5 * (P + P.T)


def _shape_nis(
    bins: SessionBins, rows: NDArray, y: NDArray, R: NDArray
) -> tuple[int, float, float]:
    """Do the bins change along the session as table and noise allow? Degrees of freedom, sum of
    squares, and the same as if the table had been taken out of the log before.
    """
    S, count = bins.prior[np.ix_(rows, rows)] + R, y.size // 3
    if count < 2:
        return 0, 0.0, 0.0
    S = S + (FREE_LEVEL**2 * np.max(np.diag(S))) * np.kron(np.ones((count, count)), np.eye(3))
    again = y + bins.table_deg_h[rows]
    return y.size - 3, float(y @ np.linalg.solve(S, y)), float(again @ np.linalg.solve(S, again))


def _by_attitude(places: list[ParkedSeconds], stretch: NDArray, twin: TwinModel) -> NDArray | None:
    """Covariance (3N, 3N) [(deg/h)^2] of what the specific force adds to gyros that stand otherwise
    than a table's, whose z is down; None where they do not.

    A gyro's three coefficients are alike and apart: ``sigma^2 (u_s - u_0).(u_t - u_0)``, u up.
    """
    tilt = np.array([[0.0, 0.0, 1.0] - levelled(place)[2] for place in places])
    turned = np.linalg.norm(tilt, axis=1) > ANOTHER_ATTITUDE
    if not turned.any():
        return None
    tilt[~turned] = 0.0
    sigma = prior("gyro_g_sensitivity", "attitude").of(twin.gyro_technology)
    return np.asarray(sigma**2 * np.kron((tilt @ tilt.T)[np.ix_(stretch, stretch)], np.eye(3)))


def _reason(sigma_deg_h: float, site: Site) -> Reason:
    level = EARTH_RATE_RAD_S * np.cos(site.lat_rad) / DEG_PER_HOUR
    return because(ParkedReason.NO_HEADING, sigma_deg_h=sigma_deg_h, level_deg_h=level)
