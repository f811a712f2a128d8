"""Accelerometer offsets from stops on several azimuths: the two-position levelling, for all
positions at once.

The tilt of what the unit stands on keeps its place in the room while the unit turns, its
accelerometers' biases turn with it::

    f_x(H) = o_x + p cosH + q sinH,     f_y(H) = o_y - p sinH + q cosH

From two stops 180 deg apart o = (f(H) + f(H + 180)) / 2. o is the bias and g times the angle
between the unit's base and the axis it is turned about: the two cannot be told apart at one
attitude, so a bias is only stated where the mounting is. Source: Groves (2013), section 5.6.1, for
the level; the two-position mean is elementary.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.misalignment.azimuth_runs import AzimuthStop
from infield.table.least_squares import fit_correlated
from ins.earth import gravity_magnitude
from ins.records import AccelNoise, Site
from ins.robust import chi2 as chi_square
from ins.units import ARCSEC, HOUR, MICRO_G, STANDARD_GRAVITY

CONFIDENCE = 0.999  # 1 of 1000 sound studies is said to disagree
FLOOR_UG = 1.0  # of a stop's level: mean of sway and of the last digit of a table's bearing


@dataclass(frozen=True, kw_only=True)
class LevelOffsets:
    """offset_ug, sigma_offset_ug (2,): x and y, bias and mounting together, mean over the
    power-ons; ground_tilt_arcsec (2,): slope to north and east (p, q over g); chi2 with dof: that
    the ground was the same under all stops; bias_ug, sigma_bias_ug (2,): where the sigma of the
    mounting is known.
    """

    offset_ug: NDArray
    sigma_offset_ug: NDArray
    ground_tilt_arcsec: NDArray
    chi2: float
    dof: int
    bias_ug: NDArray | None
    sigma_bias_ug: NDArray | None
    sigma_mounting_arcsec: float | None

    @property
    def same_ground(self) -> bool:
        return self.chi2 <= float(chi_square.ppf(CONFIDENCE, self.dof))


def level_offsets(
    stops: Sequence[AzimuthStop],
    heading_rad: NDArray,
    accel: AccelNoise,
    site: Site,
    sigma_mounting_arcsec: float | None = None,
) -> LevelOffsets | None:
    """Least squares over all stops; None where their headings do not tell offset from tilt.
    `accel`: noise of the unit, its nominal bias being off the stops' means already; it is added
    back.
    """
    m = len(stops)
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    one, zero = np.ones(m), np.zeros(m)
    A = np.vstack([np.column_stack([one, zero, cos, sin]), np.column_stack([zero, one, -sin, cos])])
    if m < 2 or np.linalg.cond(A) > 10.0:
        return None
    f = np.array([s.f_m_s2 for s in stops])[:, :2].T.ravel() / MICRO_G
    same_run = np.equal.outer([s.run for s in stops], [s.run for s in stops])
    hours = np.array([s.end_s for s in stops]) / HOUR
    used = np.array([s.used_s for s in stops])
    steady = accel.bias_instability_ug**2 + FLOOR_UG**2
    own = steady + accel.rate_random_walk_ug_sqrt_h**2 * hours + accel.vrw_ug_sqrt_hz**2 / used
    R = np.kron(np.eye(2), accel.turn_on_ug**2 * same_run + np.diag(own))
    fit = fit_correlated(A, f, R)
    g_ug = float(gravity_magnitude(site.lat_rad, site.height_m)) / MICRO_G
    offset_ug = fit.x[:2] + np.asarray(accel.bias_ug)[:2]
    sigma_ug = np.sqrt(np.diag(fit.covariance)[:2])
    bias_ug = sigma_bias_ug = None
    if sigma_mounting_arcsec is not None:
        of_mounting = sigma_mounting_arcsec * ARCSEC * STANDARD_GRAVITY / MICRO_G
        bias_ug, sigma_bias_ug = offset_ug, np.hypot(sigma_ug, of_mounting)
    return LevelOffsets(
        offset_ug=offset_ug,
        sigma_offset_ug=sigma_ug,
        ground_tilt_arcsec=fit.x[2:] / g_ug / ARCSEC,
        chi2=fit.chi2,
        dof=fit.dof,
        bias_ug=bias_ug,
        sigma_bias_ug=sigma_bias_ug,
        sigma_mounting_arcsec=sigma_mounting_arcsec,
    )
