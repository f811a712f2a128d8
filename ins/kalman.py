"""Kalman filter steps with checks: the only door to filterpy.

filterpy 2.0 is the engine for small filters at 1 to 10 Hz and of the smoother, and the yardstick of
the compiled error filter (ins.estimation.kernel). Guarded here, because filterpy does not:
shapes, NaN, scalar Q (which it would add to every element), symmetry of P after predict.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ins.robust import chi2


class Innovation(NamedTuple):
    """What a measurement said before it was used.

    Parameters
    ----------
    residual : ndarray, shape (m,)
        Measured less predicted.
    S : ndarray, shape (m, m)
        Covariance of the residual.
    nis : float
        y' S^-1 y: chi-square distributed with m degrees of freedom.
    """

    residual: NDArray
    S: NDArray
    nis: float


def predict(x: NDArray, P: NDArray, F: NDArray, Q: NDArray) -> tuple[NDArray, NDArray]:
    """Prediction over one step: x = F x, P = F P F' + Q, P symmetrised.

    Parameters
    ----------
    x : ndarray, shape (n,)
        State.
    P, F, Q : ndarray, shape (n, n)
        Covariance, transition, process noise.

    Returns
    -------
    x_minus : ndarray, shape (n,)
    P_minus : ndarray, shape (n, n)

    Raises
    ------
    ValueError
        Where a shape is wrong or P, F or Q holds a NaN.

    Examples
    --------
    >>> x, P = predict(np.ones(1), np.eye(1), 2 * np.eye(1), np.eye(1))
    >>> float(x[0]), float(P[0, 0])
    (2.0, 5.0)
    """
    from filterpy.kalman import predict as filterpy_predict

    n = x.shape[0]
    for name, matrix in (("P", P), ("F", F), ("Q", Q)):
        if np.shape(matrix) != (n, n):
            raise ValueError(
                f"kalman.predict: {name} has shape {np.shape(matrix)}, needed {(n, n)}"
            )
    x_minus, P_minus = filterpy_predict(x, P, F=F, Q=Q)
    if not np.isfinite(P_minus).all():
        raise ValueError("kalman.predict: covariance is not finite")
    return x_minus, 0.5 * (P_minus + P_minus.T)


def innovation(x: NDArray, P: NDArray, z: NDArray, H: NDArray, R: NDArray) -> Innovation:
    """Residual of a measurement, its covariance and its NIS.

    Parameters
    ----------
    x, P : ndarray, shapes (n,), (n, n)
        State and covariance before the measurement.
    z, H, R : ndarray, shapes (m,), (m, n), (m, m)
        Measurement, its rows and its noise.

    Returns
    -------
    seen : Innovation
    """
    y = z - H @ x
    S = H @ P @ H.T + R
    return Innovation(y, S, float(y @ np.linalg.solve(S, y)))


def update(
    x: NDArray, P: NDArray, z: NDArray, H: NDArray, R: NDArray, seen: Innovation | None = None
) -> tuple[NDArray, NDArray, Innovation]:
    """Measurement update in Joseph form.

    Parameters
    ----------
    x, P : ndarray, shapes (n,), (n, n)
        State and covariance before the measurement.
    z, H, R : ndarray, shapes (m,), (m, n), (m, m)
        Measurement, its rows and its noise.
    seen : Innovation, optional
        Its innovation, where that is worked out already.

    Returns
    -------
    x_plus, P_plus : ndarray, shapes (n,), (n, n)
    seen : Innovation

    Raises
    ------
    ValueError
        On a wrong shape or a NaN in any of the five. filterpy would turn the whole state into NaN.
    """
    from filterpy.kalman import update as filterpy_update

    m, n = H.shape
    if z.shape != (m,) or R.shape != (m, m) or x.shape != (n,) or P.shape != (n, n):
        raise ValueError(
            f"kalman.update: z {z.shape}, H {H.shape}, R {R.shape}, x {x.shape}, P {P.shape} do"
            " not fit"
        )
    if not np.isfinite(z).all():
        raise ValueError("kalman.update: measurement is not finite; leave it out instead")
    seen = seen or innovation(x, P, z, H, R)
    if not np.isfinite(seen.nis):
        raise ValueError("kalman.update: x, P, H or R is not finite")
    x_plus, P_plus = filterpy_update(x, P, z, R, H)
    return x_plus, 0.5 * (P_plus + P_plus.T), seen


def rts_smooth(x: NDArray, P: NDArray, F: NDArray, Q: NDArray) -> tuple[NDArray, NDArray]:
    """Fixed-interval smoothing of a filter's estimates (Rauch, Tung and Striebel).

    Parameters
    ----------
    x, P : ndarray, shapes (k, n), (k, n, n)
        After the update of each step.
    F, Q : ndarray, shape (k, n, n)
        F[j] took step j - 1 to step j; F[0] is not used.

    Returns
    -------
    x_s, P_s : ndarray, shapes (k, n), (k, n, n)
        Given all measurements.

    Raises
    ------
    ValueError
        Where shapes do not fit or the result is not finite.

    Notes
    -----
    It calls KalmanFilter.rts_smoother of filterpy; the function of that name in filterpy's module
    takes F[j] where F[j + 1] is due.

    Source: Rauch, Tung, Striebel, AIAA Journal 3(8), 1965, eqs. (3.30)-(3.31). Pinned by:
    tests/ins/test_kalman.py
    """
    from filterpy.kalman import KalmanFilter

    k, n = x.shape
    if P.shape != (k, n, n) or F.shape != (k, n, n) or Q.shape != (k, n, n):
        raise ValueError(
            f"kalman.rts_smooth: x {x.shape}, P {P.shape}, F {F.shape}, Q {Q.shape} do not fit"
        )
    x_s, P_s, *_ = KalmanFilter(dim_x=n, dim_z=1).rts_smoother(x, P, F, Q)
    if not (np.isfinite(x_s).all() and np.isfinite(P_s).all()):
        raise ValueError(
            "kalman.rts_smooth: x, P, F or Q is not finite, or a predicted covariance is singular"
        )
    return x_s, 0.5 * (P_s + np.swapaxes(P_s, 1, 2))


def nis_band(dof: int, probability: float) -> tuple[float, float]:
    """Two-sided band of the mean NIS per degree of freedom.

    Parameters
    ----------
    dof : int
        Degrees of freedom over all measurements.
    probability : float
        That a consistent filter lies within the band.

    Returns
    -------
    low, high : float
        Chi-square quantiles over dof; 0 and infinity below one degree of freedom.

    Examples
    --------
    >>> low, high = nis_band(100, 0.95)
    >>> round(low, 3), round(high, 3)
    (0.742, 1.296)
    """
    if dof < 1:
        return 0.0, float("inf")
    tail = 0.5 * (1.0 - probability)
    return float(chi2.ppf(tail, dof) / dof), float(chi2.ppf(1.0 - tail, dof) / dof)
