"""Gyro misalignment from the biases that a unit shows on several azimuths: harmonic least squares
with redundancy::

    k_i(H) = k'_i + w_N [a_i cosH + b_i sinH],   w_N = Omega cosL,  H: heading, clockwise from north

k_i is what gyro i reads beyond the Earth rate that an ideal gyro would see there. At rest and
level, body axes x forward, y right, z down, the sensor model of `ins.strapdown.compensation`
(entry ij: sensitivity of gyro i to rate about j) makes::

    x: a = s_x, b = -M_xy      y: a = M_yx, b = -s_y      z: a = M_zx, b = -M_zy

and k' = bias - Omega sinL (M_xz, M_yz, s_z): what the vertical couples in is a bias at one latitude
and attitude, and cannot be told from it. Source: physics.md section 4 (the document's model with
both couplings of each gyro). Everything here is pure; `infield.misalignment.azimuth_runs` makes
azimuths and biases out of runs, `infield.misalignment.closed_forms` has the document's own closed
forms.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from infield.table.least_squares import fit_rows
from ins.earth import EARTH_RATE_RAD_S
from ins.records import InputError, frozen_array
from ins.robust import chi2 as chi_square
from ins.units import DEG_PER_HOUR

CONFIDENCE = 0.999  # of the redundancy check; 1 of 1000 sound studies fails it
# share of the null space in a combination that makes it unobservable: far above rounding (1e-15),
# far below the share of one that is not seen (about 1)
UNSEEN_SHARE = 1e-6
# gyro, column, sign
COUPLINGS = {"xy": (0, 2, -1.0), "yx": (1, 1, 1.0), "zx": (2, 1, 1.0), "zy": (2, 2, -1.0)}
OWN_AXIS = {"x": (0, 1, 1.0), "y": (1, 2, -1.0)}


def level_rate_deg_h(lat_rad: float) -> float:
    """w_N = Omega cosL [deg/h]."""
    return float(EARTH_RATE_RAD_S * np.cos(lat_rad) / DEG_PER_HOUR)


def north_to_west_rad(heading_rad: ArrayLike) -> NDArray:
    """Azimuth counted from north to west, [0, 2 pi), of headings; its own inverse."""
    return np.mod(-np.asarray(heading_rad, dtype=float), 2 * np.pi)


@dataclass(frozen=True, kw_only=True)
class AzimuthFit:
    """Harmonic least squares of three gyros over m stops.

    parameters (3, 3): rows x, y, z; columns k' [deg/h], a, b [rad]; covariance (9, 9) in that
    order, row by row. null (9 + q, r): directions of the parameters and the q unknowns that the
    data do not see, as unit columns. unknowns (q,): their estimates [rad]; residual_deg_h (m, 3);
    chi2 of the residual with dof degrees of freedom; rank of all 9 + q unknowns.
    heading_residual (n, 1 + m): whitened, of the biases and of an error of each stop's azimuth.
    """

    heading_rad: NDArray
    bias_deg_h: NDArray
    level_rate_deg_h: float
    parameters: NDArray
    covariance: NDArray
    null: NDArray
    unknowns: NDArray
    residual_deg_h: NDArray
    heading_residual: NDArray
    chi2: float
    dof: int
    rank: int

    def combination(self, weights: ArrayLike) -> tuple[float, float]:
        """Value and sigma of weights (9,) times the parameters; sigma is infinite where the data do
        not see it.
        """
        c = np.asarray(weights, dtype=float)
        size = np.linalg.norm(c)
        unseen = self.null.size and np.max(np.abs(c @ self.null[:9])) > UNSEEN_SHARE * size
        return float(c @ self.parameters.ravel()), float(
            "inf" if unseen else np.sqrt(c @ self.covariance @ c)
        )

    def entry(self, gyro: int, column: int, sign: float = 1.0) -> tuple[float, float]:
        """Value and sigma of one parameter."""
        return self.combination(sign * np.eye(9)[3 * gyro + column])

    def heading_gain(self, sigma_rad: NDArray) -> NDArray:
        """Restricted log likelihood (k,) gained by an error of each stop's azimuth of its own, by
        its sigma (k,).
        """
        U, size, _ = np.linalg.svd(self.heading_residual[:, 1:], full_matrices=False)
        square = (U.T @ self.heading_residual[:, 0]) ** 2
        wider = 1.0 + np.outer(sigma_rad**2, size**2)
        return np.asarray(0.5 * np.sum(square - square / wider - np.log(wider), axis=1))

    @property
    def band(self) -> float:
        """Upper 99.9 % bound of chi2; infinite without redundancy."""
        return float(chi_square.ppf(CONFIDENCE, self.dof)) if self.dof else float("inf")

    def compensated_deg_h(self) -> NDArray:
        """Biases (m, 3) with what Earth rate couples in taken off, (31) to (33): the same at every
        azimuth but for noise.
        """
        return (
            self.bias_deg_h
            - self.level_rate_deg_h * harmonics(self.heading_rad)[:, 1:] @ self.parameters[:, 1:].T
        )


def fit_azimuths(
    heading_rad: ArrayLike,
    bias_deg_h: ArrayLike,
    covariance: ArrayLike,
    *,
    level_rate_deg_h: float,
    unknown: ArrayLike | None = None,
    own_axis_sigma_rad: float | None = None,
) -> AzimuthFit:
    """Generalised least squares of k(H) for three gyros at once.

    Parameters
    ----------
    heading_rad : shape (m,)
    bias_deg_h : shape (m, 3), measured - true
    covariance : shape (3m, 3m) [(deg/h)^2]
        Order x, y, z of stop 0, then of stop 1 ...; positive definite.
    unknown : shape (3m, q) [deg/h per rad], or None
        What q further unknowns, of which nothing is known before, do to the biases (an azimuth that
        nobody measured).
    own_axis_sigma_rad : float or None
        How well the scale factors of x and y are known to be right; two more measurements. None:
        not at all.

    Raises
    ------
    InputError
        Shapes that disagree, values that are not finite, a covariance that is not positive
        definite.
    """
    heading = frozen_array(heading_rad, (None,), "heading_rad")
    m = heading.size
    bias = frozen_array(bias_deg_h, (m, 3), "bias_deg_h")
    R = frozen_array(covariance, (3 * m, 3 * m), "covariance")
    extra = (
        np.zeros((3 * m, 0)) if unknown is None else frozen_array(unknown, (3 * m, None), "unknown")
    )
    if not all(np.isfinite(a).all() for a in (heading, bias, R, extra)) or not m:
        raise InputError(
            "azimuths, biases and covariance: needed at least one stop and finite values"
        )
    scale = np.array([1.0, level_rate_deg_h, level_rate_deg_h])
    design = np.vstack([np.kron(np.eye(3), row * scale) for row in harmonics(heading)])
    try:
        root = np.linalg.cholesky(R)
    except np.linalg.LinAlgError:
        raise InputError("covariance of the biases: not positive definite") from None
    A = np.linalg.solve(root, np.hstack([design, extra]))
    y = np.linalg.solve(root, bias.ravel())
    stops = np.linalg.solve(root, azimuth_columns(heading, level_rate_deg_h))
    if own_axis_sigma_rad is not None:
        own = np.eye(A.shape[1])[[3 * gyro + column for gyro, column, _ in OWN_AXIS.values()]]
        A = np.vstack([A, own / own_axis_sigma_rad])
        y, stops = (np.concatenate([v, np.zeros((2, *v.shape[1:]))]) for v in (y, stops))
    fit = fit_rows(A, y)
    return AzimuthFit(
        heading_rad=heading,
        bias_deg_h=bias,
        level_rate_deg_h=level_rate_deg_h,
        parameters=fit.x[:9].reshape(3, 3),
        covariance=fit.covariance[:9, :9],
        null=fit.null,
        unknowns=fit.x[9:],
        residual_deg_h=(root @ fit.left[: 3 * m]).reshape(m, 3),
        heading_residual=np.column_stack([fit.left, fit_rows(A, stops).left]),
        chi2=fit.chi2,
        dof=fit.dof,
        rank=fit.rank,
    )


def harmonics(heading: NDArray) -> NDArray:
    return np.column_stack([np.ones_like(heading), np.cos(heading), np.sin(heading)])


def azimuth_columns(heading_rad: Sequence[float] | NDArray, level_rate_deg_h: float) -> NDArray:
    """What an error of each stop's azimuth (computed - true) does to its biases, (3m, m) [deg/h per
    rad].
    """
    out = np.zeros((3 * len(heading_rad), len(heading_rad)))
    for j, H in enumerate(heading_rad):
        out[3 * j : 3 * j + 2, j] = level_rate_deg_h * np.sin(H), level_rate_deg_h * np.cos(H)
    return out
