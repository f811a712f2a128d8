"""The couplings of a fit over azimuths, judged: what each is worth beside what was believed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from infield.misalignment.geometry import Geometry, azimuth_geometry
from infield.misalignment.harmonic_fit import COUPLINGS, OWN_AXIS, AzimuthFit, fit_azimuths
from infield.misalignment.reasons import MisalignmentReason, MisalignmentVerdict
from infield.misalignment.settings import AzimuthSettings
from ins.records import AXES
from ins.units import MILLIRADIAN
from ins.verdicts import Observability, Reason, because

NOT_AT_ONE_ATTITUDE = ("xz", "yz", "z own axis")


@dataclass(frozen=True, kw_only=True)
class Coupling:
    """One coefficient with its sigma [rad] and what that is worth beside the prior."""

    name: str
    value_rad: float
    sigma_rad: float
    verdict: Observability


@dataclass(frozen=True, kw_only=True)
class Misalignment:
    """The judged result. fit and couplings are None and empty where the azimuths do not carry an
    answer.

    couplings: xy, yx, zx, zy, and "xy+yx", the gyros' own non-orthogonality, which needs no north;
    own_axis: x and y, the scale-like terms that belong to the same harmonics.
    """

    verdict: MisalignmentVerdict
    reasons: tuple[Reason, ...]
    geometry: Geometry
    fit: AzimuthFit | None = None
    couplings: tuple[Coupling, ...] = ()
    own_axis: tuple[Coupling, ...] = ()

    def coupling(self, name: str) -> Coupling:
        return next(c for c in self.couplings if c.name == name)


def measure_misalignment(
    heading_rad: ArrayLike,
    bias_deg_h: ArrayLike,
    covariance: ArrayLike,
    *,
    level_rate_deg_h: float,
    unknown: ArrayLike | None = None,
    own_axis_sigma_rad: float | None = None,
    settings: AzimuthSettings | None = None,
) -> Misalignment:
    """Couplings with verdicts, or why there are none; arguments as `fit_azimuths` and
    `azimuth_geometry`.
    """
    settings = settings or AzimuthSettings()
    geometry = azimuth_geometry(heading_rad, max_off_deg=settings.max_off_deg)
    if geometry.reasons:
        return Misalignment(
            verdict=MisalignmentVerdict.REFUSED, reasons=geometry.reasons, geometry=geometry
        )
    fit = fit_azimuths(
        heading_rad,
        bias_deg_h,
        covariance,
        level_rate_deg_h=level_rate_deg_h,
        unknown=unknown,
        own_axis_sigma_rad=own_axis_sigma_rad,
    )
    prior = settings.prior_mrad * MILLIRADIAN
    found = [_judged(name, *fit.entry(*place), prior) for name, place in COUPLINGS.items()]
    weights = np.zeros(9)
    for name in ("xy", "yx"):
        gyro, column, sign = COUPLINGS[name]
        weights[3 * gyro + column] = sign
    found.append(_judged("xy+yx", *fit.combination(weights), np.sqrt(2.0) * prior))
    own = tuple(_judged(name, *fit.entry(*place), prior) for name, place in OWN_AXIS.items())
    reasons: tuple[Reason, ...] = ()
    verdict = MisalignmentVerdict.MEASURED
    if all(c.verdict is Observability.NOT_OBSERVABLE for c in found):
        verdict = MisalignmentVerdict.REFUSED
        best_mrad = min(c.sigma_rad for c in found) / MILLIRADIAN
        reasons = (
            because(
                MisalignmentReason.NOTHING_GAINED,
                best_mrad=best_mrad,
                prior_mrad=settings.prior_mrad,
            ),
        )
    elif fit.chi2 > fit.band:
        verdict, reasons = MisalignmentVerdict.INCONSISTENT, (_disagreement(fit),)
    return Misalignment(
        verdict=verdict,
        reasons=reasons,
        geometry=geometry,
        fit=fit,
        couplings=tuple(found),
        own_axis=own,
    )


def _judged(name: str, value: float, sigma: float, prior: float) -> Coupling:
    """The verdict by what the sigma is after the measurement over what it was before."""
    ratio = 1.0 / np.sqrt(1.0 + (prior / sigma) ** 2)
    return Coupling(
        name=name, value_rad=value, sigma_rad=sigma, verdict=Observability.of(float(ratio))
    )


def _disagreement(fit: AzimuthFit) -> Reason:
    j, i = np.unravel_index(np.argmax(np.abs(fit.residual_deg_h)), fit.residual_deg_h.shape)
    return because(
        MisalignmentReason.AZIMUTHS_CONTRADICT,
        chi2=fit.chi2,
        dof=fit.dof,
        limit=fit.band,
        residual_deg_h=fit.residual_deg_h[j, i],
        axis=AXES[i],
        stop=int(j) + 1,
    )
