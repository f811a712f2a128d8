"""Zero-rate bias of a parked unit against temperature, for gyros too uncertain to find a heading at rest (MEMS).

    rate_k = b_k + e + noise,   e = Earth rate in body axes, one and the same vector for the whole session

Levelled by gravity, the vertical part of e is known (-Omega sinL along down), the level part is not: on an unknown
heading it is uniform on a circle of Omega cosL, mean 0, variance (Omega cosL)^2 / 2 on either level direction. It is one
common error of all points of a session, not one of each point, and a surveyed heading takes it away. b_k are the
session's biases over bins, with the joint prior of table and twin that every session has (`infield.session`).
Units inside: deg/h. Source: [derived]; Bayesian update of a Gaussian, Bar-Shalom (2001), eq. (1.4.14-1).
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment import levelling
from alignment.parked_seconds import ParkedSeconds, longest_quiet, parked_seconds
from infield.session import (
    SessionBins,
    SessionEstimate,
    SessionSettings,
    compensated_imu,
    make_bins,
    session_end,
)
from infield.table import ThermalTable
from infield.thermometer import GyroTemperature
from ins.attitude import dcm_from_euler
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.records import AXES, PARKED_PHASES, Run, Site, TwinModel
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, HOUR, MICRO_G, PPM

MIN_PARKED_S = 60.0
SHORTEST_BIN_S, MOST_BINS = 60.0, 60
USED_SHARE = 0.5  # of a bin that must be still
LEVEL_SHARE = 0.3  # of level Earth rate: gyros known worse than this find no heading (as alignment.gyrocompass.align)
NOISIER = 1.2  # times the twin's white noise: worth saying
TOO_NOISY = 10.0
FREE_LEVEL = 1e3  # in sigmas of the innovations: nothing believed of the level


@dataclass(frozen=True)
class ParkedEvidence:
    """What the parked seconds said: rates less table and vertical Earth rate (N, 3) [deg/h], NaN where a bin was not still.

    used_s (N,): still seconds of each bin; walk_deg_sqrt_h (3,): white noise taken, the larger of twin and log;
    noise_scale: of the log over the twin; earth_covariance (3, 3) [(deg/h)^2]: of the session's common error, what of it
    the heading makes being `heading_deg_h` (1 sigma on a level axis, 0 where a survey gives the heading);
    down_b (3,): down in body axes. Against the table with nothing believed of each gyro's level, sums of squares: shape_nis,
    shape_nis_compensated (as if the table had been taken out of the log before), shape_dof.
    """

    seconds: ParkedSeconds
    rate_deg_h: NDArray
    used_s: NDArray
    walk_deg_sqrt_h: NDArray
    noise_scale: float
    earth_covariance: NDArray
    heading_deg_h: float
    down_b: NDArray
    shape_dof: int
    shape_nis: float
    shape_nis_compensated: float


def parked_limits(run: Run) -> tuple[float, float]:
    """Where the first parked stretch may lie: within the phases that the log names, if it names them."""
    named = [p for p in run.phases if p.phase in PARKED_PHASES]
    if not named:
        return run.imu.start_s, session_end(run)
    end = named[0].end_s
    for phase in named[1:]:
        end = max(end, phase.end_s) if phase.start_s <= end + 1.0 else end
    return max(named[0].start_s, run.imu.start_s), min(end, run.imu.end_s)


def find_parked(run: Run) -> tuple[tuple[float, float] | None, str]:
    """The first parked stretch of MIN_PARKED_S or more, or None and why there is none."""
    found = longest_quiet(run.imu, *parked_limits(run), least_s=MIN_PARKED_S)
    if found is None or found[1] - found[0] < MIN_PARKED_S:
        told = "none" if found is None else f"{found[1] - found[0]:.0f} s, from {found[0]:.0f} to {found[1]:.0f} s"
        return None, f"longest rest found: {told}; needed {MIN_PARKED_S:.0f} s, and 10 min or more of warm-up to show a slope"
    return found, ""


def no_heading(run: Run, table: ThermalTable, temperature: GyroTemperature, twin: TwinModel) -> bool:
    """Whether the unit's gyros are known too poorly for a gyrocompass: MEMS, and worse than LEVEL_SHARE of level Earth rate."""
    if run.header.gyro_technology != "mems":
        return False
    sigma = max(float(table.sigma_deg_h(k, temperature.temperature_degC[0, k])[0]) for k in range(3))
    level = EARTH_RATE_RAD_S * np.cos(run.header.site.lat_rad) / DEG_PER_HOUR
    return bool(np.hypot(sigma, twin.gyro.turn_on_deg_h) > LEVEL_SHARE * level)


def bin_seconds(duration_s: float) -> float:
    """Length of the bins of a parked stretch [s]."""
    return max(SHORTEST_BIN_S, duration_s / MOST_BINS)


def estimate_parked(
    run: Run, table: ThermalTable, temperature: GyroTemperature, twin: TwinModel, settings: SessionSettings,
    *, stretch: tuple[float, float],
) -> SessionEstimate | str:  # fmt: skip
    """The session's biases from its parked seconds, or in words why there is nothing to take."""
    imu = compensated_imu(run, table, temperature, twin)
    seconds = parked_seconds(imu, *stretch)
    if seconds is None or (still_s := float(seconds.dt_s[seconds.still].sum())) < MIN_PARKED_S:
        return f"less than {MIN_PARKED_S:.0f} s still between {stretch[0]:.0f} and {stretch[1]:.0f} s, the rest is motion"
    start, end = float(seconds.start_s[0]), float(seconds.end_s[-1])
    bins = make_bins(table, temperature, twin, replace(settings, bin_s=bin_seconds(end - start)), start_s=start, end_s=end)
    walk, scale = _white_noise(seconds, twin)
    if scale > TOO_NOISY:
        return (
            f"the gyros scatter {scale:.0f} times as much as their noise model ({twin.source}) from second to second, "
            f"needed {TOO_NOISY:.0f} at most: it shakes, or the model is of another unit"
        )
    earth, covariance, heading_deg_h, down_b = _earth_rate(run, seconds, twin, settings)
    rate, used_s = _bin_rates(bins, seconds, earth)
    measured = _measured(bins, rate, walk**2 / (np.maximum(used_s, 1.0)[:, None] / HOUR), covariance)
    shape = _shape_nis(bins, *measured)
    evidence = ParkedEvidence(seconds, rate, used_s, walk, scale, covariance, heading_deg_h, down_b, *shape)
    sigma = float(np.sqrt(np.diag(bins.prior)[:3].max()))
    level = levelling.level(
        imu, run.header.site, twin, rest=(start, end), gyro_sigma_rad_s=sigma * DEG_PER_HOUR,
        reason=_reason(sigma, run.header.site),
    )  # fmt: skip
    mean, P = _posterior(bins, *measured)
    return SessionEstimate(
        bins=bins, mean_deg_h=mean, covariance=P, alignment=replace(level, duration_s=still_s), solution=None, parked=evidence,
        heading_error_rad=float("nan"), sigma_heading_rad=float("nan"), sigma_heading_before_rad=float("nan"),
        nis_mean=evidence.shape_nis / max(evidence.shape_dof, 1), dof=evidence.shape_dof,
    )  # fmt: skip


def mean_zero_rate(run: Run, twin: TwinModel, settings: SessionSettings) -> dict[str, Any] | None:
    """Mean rate of the parked unit less what is known of Earth rate, as logged, with its sigma; None where it never rests."""
    stretch, _ = find_parked(run)
    seconds = None if stretch is None else parked_seconds(compensated_imu(run, None, None, twin), *stretch)
    if seconds is None or not seconds.still.any():
        return None
    mean, used_s = seconds.means(-np.inf, np.inf)
    earth, covariance, heading_deg_h, _ = _earth_rate(run, seconds, twin, settings)
    rate = mean[3:] / DEG_PER_HOUR - earth
    sigma = np.sqrt(np.diag(covariance) + _white_noise(seconds, twin)[0] ** 2 / (used_s / HOUR))
    return {
        "start_s": float(seconds.start_s[0]), "end_s": float(seconds.end_s[-1]), "heading_known": heading_deg_h == 0.0,
        "gyro": {a: {"bias_deg_h": float(b), "sigma_deg_h": float(s)} for a, b, s in zip(AXES, rate, sigma)},
    }  # fmt: skip


def unknown_sigma_deg_h(run: Run, twin: TwinModel, temperature: GyroTemperature | None, least_deg_h: float) -> float:
    """Sigma of the table of an unknown unit, widened by what its parked rates show: their size, and their change.

    A change over a span dT of temperature is set against what a table of that sigma allows there: sqrt(0.3) sigma
    sqrt(2 (1 - exp(-dT^2 / 2 l^2))), the smooth share of formats.md section 2.
    """
    stretch, _ = find_parked(run)
    seconds = None if stretch is None else parked_seconds(compensated_imu(run, None, None, twin), *stretch)
    if seconds is None:
        return least_deg_h
    start, end = float(seconds.start_s[0]), float(seconds.end_s[-1])
    edges = np.linspace(start, end, max(int((end - start) / MIN_PARKED_S), 1) + 1)
    rates = np.array([seconds.means(a, b)[0][3:] for a, b in pairwise(edges)]) / DEG_PER_HOUR
    rates = rates[np.isfinite(rates).all(axis=1)]
    if not rates.size:
        return least_deg_h
    size = float(np.abs(rates).max()) - EARTH_RATE_RAD_S / DEG_PER_HOUR
    if temperature is None or len(rates) < 2:
        return max(least_deg_h, size)
    rows = temperature.between(start, end)
    span = float(np.ptp(temperature.temperature_degC[rows], axis=0).min())
    noise = float(_white_noise(seconds, twin)[0].max()) / np.sqrt(MIN_PARKED_S / HOUR) + twin.gyro.bias_instability_deg_h
    change = float(np.ptp(rates, axis=0).max()) - 4.0 * noise
    allowed = np.sqrt(0.3 * 2.0 * -np.expm1(-(max(span, 1.0) ** 2) / (2.0 * 30.0**2)))
    return max(least_deg_h, size, change / allowed)


def _white_noise(seconds: ParkedSeconds, twin: TwinModel) -> tuple[NDArray, float]:
    """Angle random walk (3,) [deg/sqrt(h)], the larger of the twin's and the log's, and the log's over the twin's."""
    seen = seconds.walk() / DEG_PER_SQRT_HOUR
    creep = twin.vehicle.yaw_creep_arcsec_sqrt_h * ARCSEC / DEG
    declared = float(np.hypot(twin.gyro.arw_deg_sqrt_h, creep))
    return np.maximum(seen, declared), float(seen.max() / max(declared, 1e-12))


def _earth_rate(
    run: Run, seconds: ParkedSeconds, twin: TwinModel, settings: SessionSettings
) -> tuple[NDArray, NDArray, float, NDArray]:
    """Known part of Earth rate (3,) and covariance of the rest (3, 3) [deg/h], the heading's share of it, down (3,)."""
    site, survey = run.header.site, run.header.survey
    f_b = seconds.means(-np.inf, np.inf)[0][:3]
    down = -f_b / np.linalg.norm(f_b)
    level = np.eye(3) - np.outer(down, down)
    gravity = float(gravity_magnitude(site.lat_rad, site.height_m))
    tilt = np.hypot(twin.accel.turn_on_ug * MICRO_G, abs(np.linalg.norm(f_b) - gravity)) / gravity
    omega = EARTH_RATE_RAD_S / DEG_PER_HOUR
    north, up = omega * np.cos(site.lat_rad), omega * np.sin(site.lat_rad)
    scale = omega * settings.sigma_scale_factor_ppm[run.header.gyro_technology] * PPM
    covariance = (up * tilt) ** 2 * level + (north * tilt) ** 2 * np.outer(down, down) + scale**2 * np.eye(3)
    if survey.heading_rad is None or not survey.sigma_heading_rad:
        return -up * down, covariance + 0.5 * north**2 * level, float(north / np.sqrt(2.0)), down
    roll, pitch = np.arctan2(-f_b[1], -f_b[2]), np.arctan2(f_b[0], np.hypot(f_b[1], f_b[2]))
    C_nb = dcm_from_euler(roll, pitch, survey.heading_rad)
    east = C_nb[1]
    covariance = covariance + (north * survey.sigma_heading_rad) ** 2 * np.outer(east, east)
    return north * C_nb[0] - up * C_nb[2], covariance, 0.0, down


def _bin_rates(bins: SessionBins, seconds: ParkedSeconds, earth: NDArray) -> tuple[NDArray, NDArray]:
    """Mean rate of each bin less known Earth rate (N, 3) [deg/h] and its still seconds (N,)."""
    found = [seconds.means(a, b) for a, b in pairwise(bins.edges_s)]
    used = np.array([s for _, s in found])
    rate = np.array([mean[3:] for mean, _ in found]) / DEG_PER_HOUR - earth
    rate[used < USED_SHARE * bins.duration_s] = np.nan
    return rate, used


def _measured(bins: SessionBins, rate: NDArray, white: NDArray, common: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Rows of the bins that were still, their rates (m,) and the covariance (m, m) of rates less biases; white (N, 3)."""
    kept = np.isfinite(rate).all(axis=1)
    count = int(kept.sum())
    R = np.kron(np.ones((count, count)), common) + np.diag(white[kept].ravel())
    return np.flatnonzero(np.repeat(kept, 3)), rate[kept].ravel(), R


def _posterior(bins: SessionBins, rows: NDArray, y: NDArray, R: NDArray) -> tuple[NDArray, NDArray]:
    """Mean (3N,) and covariance (3N, 3N) of the biases beyond the table [deg/h]."""
    C = bins.prior
    gain = np.linalg.solve(C[np.ix_(rows, rows)] + R, C[rows]).T
    left = np.eye(len(C))
    left[:, rows] -= gain
    P = left @ C @ left.T + gain @ R @ gain.T
    return gain @ y, 0.5 * (P + P.T)


def _shape_nis(bins: SessionBins, rows: NDArray, y: NDArray, R: NDArray) -> tuple[int, float, float]:
    """Do the bins change along the session as table and noise allow? Degrees of freedom, sum of squares, and the same as
    if the table had been taken out of the log before."""
    S, count = bins.prior[np.ix_(rows, rows)] + R, y.size // 3
    if count < 2:
        return 0, 0.0, 0.0
    S = S + (FREE_LEVEL**2 * np.max(np.diag(S))) * np.kron(np.ones((count, count)), np.eye(3))
    again = y + bins.table_deg_h[rows]
    return y.size - 3, float(y @ np.linalg.solve(S, y)), float(again @ np.linalg.solve(S, again))


def _reason(sigma_deg_h: float, site: Site) -> str:
    level = EARTH_RATE_RAD_S * np.cos(site.lat_rad) / DEG_PER_HOUR
    return (
        f"gyro uncertainty {sigma_deg_h:.3g} deg/h against {level:.3g} deg/h of level Earth rate: no heading at rest, and no "
        "gyro bias by gyrocompass; zero-rate biases against temperature are taken instead"
    )
