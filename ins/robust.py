"""Spreads that a few wild values do not move, the stretches in which a condition holds, and the
quantiles and tails of the laws that gates and intervals need.

The laws are those of `scipy.stats`, by `scipy.special` and to the last bit; importing the former
costs every command 0.7 s of CPU.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

# Sigma of a normal distribution over its median absolute deviation: 1 / 0.674490, the inverse of
# its upper quartile (tests/ins/test_robust.py).
SIGMA_OF_MAD = 1.4826


def robust_sigma(residuals: ArrayLike) -> float:
    """Sigma of residuals about zero, from the median of their sizes.

    Parameters
    ----------
    residuals : array_like, any shape, at least one value
        Deviations from what was expected. The sigma has their unit.

    Returns
    -------
    sigma : float
        Over all values together. For normal residuals its own relative sigma is 1.17 / sqrt(n),
        1.65 times that of their root mean square; half of them may be wild.

    Examples
    --------
    >>> robust_sigma([-1.0, 1.0, -1.0, 1.0, 1000.0])
    1.4826
    """
    return float(SIGMA_OF_MAD * np.median(np.abs(residuals)))


def robust_sigmas(residuals: NDArray) -> NDArray:
    """Sigma of residuals about zero, column by column.

    Parameters
    ----------
    residuals : ndarray, shape (n, ...), n at least 1
        Deviations from what was expected, one row an observation.

    Returns
    -------
    sigma : ndarray, shape (...)
        In the unit of the residuals.
    """
    return np.asarray(SIGMA_OF_MAD * np.median(np.abs(residuals), axis=0))


def robust_scatter(values: NDArray) -> NDArray:
    """Sigma of values about their median, column by column.

    Parameters
    ----------
    values : ndarray, shape (n, ...), n at least 1
        One row an observation.

    Returns
    -------
    sigma : ndarray, shape (...)
        In the unit of the values.
    """
    return robust_sigmas(values - np.median(values, axis=0))


def white_sigma(values: NDArray) -> float:
    """Sigma of the white noise on a smooth course, from second differences.

    Parameters
    ----------
    values : ndarray, shape (n,) or (n, k), n at least 3
        Samples at equal intervals. All columns are taken together.

    Returns
    -------
    sigma : float
        In the unit of the values: a second difference of white noise has 6 times its variance.

    Notes
    -----
    A straight course counts nothing; a curved one counts its second difference.
    """
    return float(robust_sigma(np.diff(values, n=2, axis=0)) / np.sqrt(6.0))


def runs_of_true(mask: NDArray) -> list[tuple[int, int]]:
    """Stretches of a mask in which it is true.

    Parameters
    ----------
    mask : ndarray of bool, shape (n,)

    Returns
    -------
    runs : list of (first, end)
        Indices in order; `first` is true, `end` the index behind the last that is true.

    Examples
    --------
    >>> runs_of_true(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
    return [(int(first), int(end)) for first, end in zip(edges[::2], edges[1::2])]


class _Chi2:
    """Chi-square with some degrees of freedom."""

    @staticmethod
    def ppf(p: ArrayLike, dof: ArrayLike) -> np.ndarray:
        """What a draw stays below with probability p."""
        return np.asarray(2.0 * special.gammaincinv(np.asarray(dof) / 2.0, p))

    @staticmethod
    def isf(p: ArrayLike, dof: ArrayLike) -> np.ndarray:
        """What a draw is beyond with probability p."""
        return np.asarray(special.chdtri(dof, p))

    @staticmethod
    def sf(x: ArrayLike, dof: ArrayLike) -> np.ndarray:
        """Probability of a draw beyond x."""
        return np.asarray(special.chdtrc(dof, x))


class _Normal:
    """Standard normal."""

    @staticmethod
    def isf(p: ArrayLike) -> np.ndarray:
        """What a draw is beyond with probability p."""
        return np.asarray(-special.ndtri(p))


class _Gamma:
    """Gamma of some shape and scale 1."""

    @staticmethod
    def ppf(p: ArrayLike, shape: ArrayLike) -> np.ndarray:
        """What a draw stays below with probability p."""
        return np.asarray(special.gammaincinv(shape, p))

    @staticmethod
    def isf(p: ArrayLike, shape: ArrayLike) -> np.ndarray:
        """What a draw is beyond with probability p."""
        return np.asarray(special.gammainccinv(shape, p))

    @staticmethod
    def cdf(x: ArrayLike, shape: ArrayLike) -> np.ndarray:
        """Probability of a draw below x."""
        return np.asarray(special.gammainc(shape, x))

    @staticmethod
    def sf(x: ArrayLike, shape: ArrayLike) -> np.ndarray:
        """Probability of a draw beyond x."""
        return np.asarray(special.gammaincc(shape, x))


chi2, norm, gamma = _Chi2(), _Normal(), _Gamma()
