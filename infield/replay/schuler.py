"""Schuler period of a parked free-inertial solution, fitted to its velocity error; what a healthy
unit shows is 84.4 min::

    v(t) = a + b t + c cos(w t) + s sin(w t),  north and east with one w

Tilts swing at w = sqrt(g/R) whatever the gyros do, so a fit far off says that something else moves
the velocity: the vehicle, a damping that was left on, a wrong accelerometer scale. Foucault's turn
of the plane of swing (34 h at 45 deg) is left out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from infield.replay.drift import Drift
from infield.replay.reasons import SchulerReason
from infield.table.least_squares import fit_rows
from ins.earth import gravity_magnitude, radii_of_curvature
from ins.records import Site
from ins.units import MINUTE
from ins.verdicts import Reason, because, sentence

LEAST_PERIODS = 0.75  # of record, or a trend cannot be told from a swing
RANGE_S = (30.0 * 60.0, 240.0 * 60.0)  # periods that are looked for
LARGEST_SIGMA_S = 15.0 * 60.0  # 18 % of the 84.4 min of a swing
SWING_MEAN_S = 60.0
# of the swing's amplitude above what is left of the fit; 6e-5 of Gaussian errors lie beyond
LEAST_SIGMAS = 4.0


@dataclass(frozen=True, kw_only=True)
class SchulerFit:
    """The period with its sigma and the swing's amplitude, NaN where refused for a reason;
    expected: 2 pi sqrt(R/g).
    """

    period_min: float = float("nan")
    sigma_period_min: float = float("nan")
    amplitude_m_s: float = float("nan")
    expected_period_min: float
    reason: str = ""
    reason_code: str | None = None


def expected_period_s(site: Site) -> float:
    """2 pi sqrt(R/g) at a site [s]; physics.md 6.2."""
    radius = float(np.sqrt(np.prod(radii_of_curvature(site.lat_rad)))) + site.height_m
    return float(2 * np.pi * np.sqrt(radius / gravity_magnitude(site.lat_rad, site.height_m)))


def fit_schuler(parked: Drift | None, site: Site) -> SchulerFit:
    """The period of a parked drift, or why there is none."""
    expected = expected_period_s(site)
    needed = LEAST_PERIODS * expected
    length = 0.0 if parked is None else float(parked.time_s[-1])
    if parked is None or length < needed:
        short = because(SchulerReason.PARKED_TOO_SHORT, parked_s=length, needed_s=needed)
        return _refused(expected, short)
    t, v = _minutes(parked)
    root = np.eye(len(t))
    for _ in range(3):  # ordinary least squares first, then weighted by what it left
        best = _frequency(t, v, root)
        if best is None:
            return _refused(expected, because(SchulerReason.NO_SWING))
        w = best
        left = v - _columns(w, t) @ _solved(w, t, v, root)[0]
        root = _whitening(left)
    amplitude, sigma_w = _spread(w, t, v, root)
    period = 2 * np.pi / w
    sigma = 2 * np.pi / w**2 * sigma_w
    rms = float(np.sqrt(np.mean(left**2)))
    if amplitude < LEAST_SIGMAS * rms:
        small = because(SchulerReason.SMALL_SWING, amplitude_m_s=amplitude, left_m_s=rms)
        return _refused(expected, small)
    if not sigma < LARGEST_SIGMA_S:
        unsure = because(SchulerReason.UNSURE, sigma_s=sigma, needed_s=LARGEST_SIGMA_S)
        return _refused(expected, unsure)
    return SchulerFit(
        period_min=period / MINUTE,
        sigma_period_min=sigma / MINUTE,
        amplitude_m_s=amplitude,
        expected_period_min=expected / MINUTE,
    )


def _refused(expected_s: float, why: Reason) -> SchulerFit:
    return SchulerFit(
        expected_period_min=expected_s / MINUTE, reason=sentence(why), reason_code=why.code.value
    )


def _minutes(parked: Drift) -> tuple[NDArray, NDArray]:
    """Means over SWING_MEAN_S of time (n,) and velocity (n, 2)."""
    block = np.floor((parked.time_s - parked.time_s[0]) / SWING_MEAN_S)
    first = np.flatnonzero(np.diff(block, prepend=-1.0))
    count = np.diff(np.append(first, block.size))
    return (
        np.add.reduceat(parked.time_s, first) / count,
        np.add.reduceat(parked.velocity_m_s, first) / count[:, None],
    )


def _frequency(t: NDArray, v: NDArray, root: NDArray) -> float | None:
    """The best frequency [rad/s]; None where the best is at an end of RANGE_S."""
    grid = 2 * np.pi / np.linspace(*RANGE_S, 64)
    k = int(np.argmin([_solved(w, t, v, root)[1] for w in grid]))
    if k in (0, len(grid) - 1):
        return None
    best = minimize_scalar(
        lambda w: _solved(w, t, v, root)[1],
        bounds=(grid[k + 1], grid[k - 1]),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return float(best.x)


def _columns(w: float, t: NDArray) -> NDArray:
    return np.column_stack([np.ones_like(t), t / t[-1], np.cos(w * t), np.sin(w * t)])


def _solved(w: float, t: NDArray, v: NDArray, root: NDArray) -> tuple[NDArray, float]:
    """Coefficients (4, 2) and sum of whitened squares of the fit at one frequency."""
    fit = fit_rows(root @ _columns(w, t), root @ v)
    return fit.x, fit.chi2


def _whitening(left: NDArray) -> NDArray:
    """(n, n) that whitens what a fit left, taken as white noise and a random walk, from its steps
    and their neighbours.
    """
    step = np.diff(left, axis=0)
    white = max(-float(np.mean(step[1:] * step[:-1])), 0.0)
    walk = max(float(np.mean(step**2)) - 2.0 * white, 0.0)
    n = np.arange(1.0, len(left) + 1)
    floor = 1e-6 * float(np.mean(left**2)) + 1e-18
    return np.asarray(
        np.linalg.inv(
            np.linalg.cholesky((white + floor) * np.eye(len(n)) + walk * np.minimum(n[:, None], n))
        )
    )


def _spread(w: float, t: NDArray, v: NDArray, root: NDArray) -> tuple[float, float]:
    """Amplitude [m/s] and sigma of the frequency [rad/s] of a whitened fit."""
    found, cost = _solved(w, t, v, root)
    A, none = root @ _columns(w, t), np.zeros((len(t), 4))
    slope = [
        root @ (t * (found[3, k] * np.cos(w * t) - found[2, k] * np.sin(w * t))) for k in range(2)
    ]
    J = np.block([[A, none, slope[0][:, None]], [none, A, slope[1][:, None]]])
    variance = fit_rows(J, (root @ v).T.ravel()).covariance[-1, -1]
    scale = max(cost / max(2 * len(t) - 9, 1), 1.0)
    return float(np.linalg.norm(found[2:])), float(np.sqrt(scale * variance))
