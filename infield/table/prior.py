"""What is believed of a table's errors before any data: a common shift of each axis plus a smooth
curve over it.

Source: formats.md section 2 (`covariance` null), physics.md 6.8.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

COMMON_FRACTION = 0.7  # of each variance: a common shift of the axis
KERNEL_LENGTH_degC = 30.0  # of the smooth rest


def prior_covariance(
    nodes_degC: tuple[NDArray, NDArray, NDArray],
    sigmas_deg_h: tuple[NDArray, NDArray, NDArray],
    *,
    hermite: bool = False,
    common_fraction: float = COMMON_FRACTION,
    length_degC: float = KERNEL_LENGTH_degC,
) -> NDArray:
    """The covariance that goes with sigmas alone (formats.md, section 2: `covariance` null), shape
    (n, n).

    Per axis sigma_i sigma_j (c + (1 - c) rho), axes uncorrelated. Slopes get the derivatives of the
    same kernel with the sigma of their own node; the change of sigma from node to node is neglected
    there.
    """
    sizes = [t.size for t in nodes_degC]
    count = sum(sizes)
    P = np.zeros((2 * count, 2 * count) if hermite else (count, count))
    for start, nodes, sigma in zip(np.cumsum([0] + sizes[:2]), nodes_degC, sigmas_deg_h):
        unit = (1.0 - common_fraction) * smooth_kernel(nodes, length_degC, slopes=hermite)
        unit[: nodes.size, : nodes.size] += common_fraction
        block = start + np.arange(nodes.size)
        scale = np.asarray(sigma, dtype=float)
        if hermite:
            block, scale = np.r_[block, block + count], np.r_[scale, scale]
        P[np.ix_(block, block)] = unit * np.outer(scale, scale)
    return P


def smooth_kernel(nodes_degC: ArrayLike, length_degC: float, *, slopes: bool = False) -> NDArray:
    """Unit covariance rho = exp(-dT^2 / 2 l^2) of a smooth curve at nodes; with `slopes`, of values
    then slopes.

    cov(v, m') = d rho/dT' = (T - T')/l^2 rho; cov(m, m') = (1/l^2 - dT^2/l^4) rho.
    """
    T = np.asarray(nodes_degC, dtype=float)
    d, l2 = T[:, None] - T[None, :], length_degC**2
    rho = np.exp(-(d**2) / (2.0 * l2))
    if not slopes:
        return rho
    value_slope = d / l2 * rho
    return np.block([[rho, value_slope], [value_slope.T, (1.0 - d**2 / l2) / l2 * rho]])
