"""The couplings of a fit over azimuths, judged: what each is worth beside what was believed, and
what given headings are worth beside what the gyros say.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from infield.misalignment.geometry import AzimuthSettings, Geometry, azimuth_geometry
from infield.misalignment.harmonic_fit import COUPLINGS, AzimuthFit, azimuth_columns, fit_azimuths
from infield.misalignment.reasons import MisalignmentNote, MisalignmentReason, MisalignmentVerdict
from ins.documents import UNWRITTEN
from ins.records import AXES
from ins.units import ARCSEC, DEG, MILLIRADIAN
from ins.verdicts import Observability, Reason, because

# of one stop's heading beyond what was declared: what is tried, 3 arcsec to 2 deg
STOP_SIGMAS_rad = np.geomspace(3.0 * ARCSEC, 2.0 * DEG, 60)
# log evidence that it must gain: with 1, one stop off puts couplings beyond 3 sigmas in up to a
# quarter of all studies, with 0 in a tenth, and sound ones have 0.77 in squared error over variance
STOP_NATS = 0.2
# sigmas beyond which a turn of both level gyros about down is no coupling of the unit and no error
# within the declared one: 1 % of sound studies
TURNED_SIGMAS = 2.58

NOT_AT_ONE_ATTITUDE = ("xz", "yz", "z own axis")


@dataclass(frozen=True, kw_only=True)
class CouplingEstimate:
    """One coefficient with its sigma and what that is worth beside the prior; the values in border
    units are NaN (null in the file) where the data do not see it.
    """

    entry: str
    value_rad: float = field(metadata=UNWRITTEN)
    sigma_rad: float = field(metadata=UNWRITTEN)
    value_arcsec: float
    sigma_arcsec: float
    value_mrad: float
    sigma_mrad: float
    verdict: Observability


@dataclass(frozen=True, kw_only=True)
class Misalignment:
    """The judged result. fit and couplings are None and empty where the azimuths do not carry an
    answer.

    couplings: xy, yx, zx, zy, and "xy+yx", the gyros' own non-orthogonality, which needs no north.
    """

    verdict: MisalignmentVerdict
    reasons: tuple[Reason, ...]
    geometry: Geometry
    fit: AzimuthFit | None = None
    couplings: tuple[CouplingEstimate, ...] = ()

    def coupling(self, name: str) -> CouplingEstimate:
        return next(c for c in self.couplings if c.entry == name)


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
    both = _weights(xy=1.0, yx=1.0)
    found.append(_judged("xy+yx", *fit.combination(both), np.sqrt(2.0) * prior))
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
        verdict=verdict, reasons=reasons, geometry=geometry, fit=fit, couplings=tuple(found)
    )


def with_heading_errors(
    result: Misalignment,
    covariance: NDArray,
    *,
    own_axis_sigma_rad: float | None = None,
    settings: AzimuthSettings,
) -> tuple[NDArray, tuple[Reason, ...]]:
    """Covariance (3m, 3m) of a study with given headings, wider where the gyros say so, and notes.

    An error that all headings share turns both level gyros about down, (yx - xy) / 2, and only what
    a coupling may be tells the two apart: beyond that and the declared sigma, the headings have the
    rest. An error of one stop leaves a residual, and its sigma is that of the best restricted
    likelihood. What contradicts itself is left as it is.
    """
    fit, notes = result.fit, []
    if fit is None or result.verdict is not MisalignmentVerdict.MEASURED:
        return covariance, ()
    columns = azimuth_columns(fit.heading_rad, fit.level_rate_deg_h)
    gain = fit.heading_gain(STOP_SIGMAS_rad)
    best = int(np.argmax(gain))
    if gain[best] > STOP_NATS:
        sigma_rad = float(STOP_SIGMAS_rad[best])
        covariance = covariance + sigma_rad**2 * columns @ columns.T
        notes.append(because(MisalignmentNote.HEADINGS_SCATTER, sigma_rad=sigma_rad))
        fit = fit_azimuths(
            fit.heading_rad,
            fit.bias_deg_h,
            covariance,
            level_rate_deg_h=fit.level_rate_deg_h,
            own_axis_sigma_rad=own_axis_sigma_rad,
        )
    turned, sigma = fit.combination(_weights(xy=-0.5, yx=0.5))
    allowed = float(np.hypot(sigma, settings.prior_mrad * MILLIRADIAN / np.sqrt(2.0)))
    if abs(turned) > TURNED_SIGMAS * allowed:
        common = columns.sum(axis=1)
        covariance = covariance + (turned**2 - allowed**2) * np.outer(common, common)
        notes.append(
            because(
                MisalignmentNote.HEADINGS_TURNED,
                turned_rad=turned,
                times=abs(turned / allowed),
                prior_mrad=settings.prior_mrad,
            )
        )
    return covariance, tuple(notes)


def _weights(**of_coupling: float) -> NDArray:
    """Of the parameters (9,), for a combination of couplings."""
    weights = np.zeros(9)
    for name, weight in of_coupling.items():
        gyro, column, sign = COUPLINGS[name]
        weights[3 * gyro + column] = sign * weight
    return weights


def _judged(name: str, value: float, sigma: float, prior: float) -> CouplingEstimate:
    """The verdict by what the sigma is after the measurement over what it was before."""
    ratio = 1.0 / np.sqrt(1.0 + (prior / sigma) ** 2)
    seen = value if np.isfinite(sigma) else float("nan")
    return CouplingEstimate(
        entry=name,
        value_rad=value,
        sigma_rad=sigma,
        value_arcsec=seen / ARCSEC,
        sigma_arcsec=sigma / ARCSEC,
        value_mrad=seen / MILLIRADIAN,
        sigma_mrad=sigma / MILLIRADIAN,
        verdict=Observability.of(float(ratio)),
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
