"""The aided solution given the whole log: a fixed-interval smoother over what the filter wrote
down.

The modified form of Bryson and Frazier: from the end to the beginning, adjoints lambda (43,) and
Lambda (43, 43) gather what later fixes say of the errors, and at each row::

    x_s = -P lambda,    P_s = P - P Lambda P

with the filter's P. No covariance is inverted, and process noise does not enter: a solution that
was begun anew needs no case of its own. Bierman (1977), section X.5; Bierman, Automatica 9 (1973),
503-511, for scalar measurements::

    lambda <- (1 - K H)' lambda - H' y / s,    Lambda <- (1 - K H)' Lambda (1 - K H) + H' H / s

at a measurement with residual y of variance s and gain K, and lambda <- Phi' lambda,
Lambda <- Phi' Lambda Phi at a step. It is the smoother of the filter's own linearisation: where the
start was far off, the log is to be flown again from the smoothed start.

Decision: docs/decisions/0061-adjoint-smoother.md.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_rotation_vector
from ins.earth import SEMI_MAJOR_AXIS_M, dcm_en, ecef_from_geodetic, geodetic_from_ecef
from ins.filters.aided_records import AidedHistory
from ins.filters.aided_tape import AidedTape, TapedPiece
from ins.filters.states import (
    AIDED_ACCEL,
    AIDED_GYRO,
    AIDED_MOTION,
    AIDED_POS,
    AIDED_STATES,
    AIDED_THETA,
    AIDED_VEL,
)
from ins.records import NavState

POLE_TAN = 1e6  # of the latitude, as in the filter's rows


def smoothed(history: AidedHistory, tape: AidedTape) -> tuple[AidedHistory, NDArray, NDArray]:
    """The solution given all fixes.

    Parameters
    ----------
    history : AidedHistory
        The filter's.
    tape : AidedTape
        Of the same flight, with the antenna estimated.

    Returns
    -------
    smoothed : AidedHistory
        What became of the fixes is the filter's; the covariance of the 15 errors is kept.
    errors : ndarray, shape (k, 15)
        That were taken off the filter's rows (computed - true).
    start_errors : ndarray, shape (43,)
        Errors of the start (computed - true).
    """
    adjoint, information = np.zeros(AIDED_STATES), np.zeros((AIDED_STATES, AIDED_STATES))
    errors, covariances = [], []
    for piece in reversed(tape.pieces):
        x, P = _piece(piece, tape.noise, adjoint, information)
        errors.append(x)
        covariances.append(P)
    x_s, P_s = np.concatenate(errors[::-1]), np.concatenate(covariances[::-1])
    return without_errors(history, x_s, P_s), x_s, np.asarray(-tape.P_start @ adjoint)


def without_errors(history: AidedHistory, x: NDArray, P: NDArray) -> AidedHistory:
    """A solution less its errors.

    Parameters
    ----------
    history : AidedHistory
    x : ndarray, shape (k, 15)
        Errors, computed - true, order of `ins.filters.states`.
    P : ndarray, shape (k, 15, 15)
        What is left of them.

    Returns
    -------
    history : AidedHistory
    """
    C_en = dcm_en(history.lat_rad, history.lon_rad)
    r_e = ecef_from_geodetic(history.lat_rad, history.lon_rad, history.height_m)
    r_e = r_e - np.einsum("kij,kj->ki", C_en, x[:, AIDED_POS])
    v_e = np.einsum("kij,kj->ki", C_en, history.v_n_m_s - x[:, AIDED_VEL])
    C_eb = C_en @ dcm_from_rotation_vector(-x[:, AIDED_THETA]) @ history.C_nb
    lat, lon, height = geodetic_from_ecef(r_e)
    now = dcm_en(lat, lon)
    return replace(
        history,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        v_n_m_s=np.einsum("kji,kj->ki", now, v_e),
        C_nb=np.swapaxes(now, 1, 2) @ C_eb,
        gyro_bias_rad_s=history.gyro_bias_rad_s + x[:, AIDED_GYRO],
        accel_bias_m_s2=history.accel_bias_m_s2 + x[:, AIDED_ACCEL],
        variance=np.diagonal(P, axis1=1, axis2=2).copy(),
        phi_covariance=_phi_covariance(lat, height, P),
        covariance=P,
    )


def started_again(state: NavState, errors: NDArray) -> NavState:
    """A start at the attitude that all fixes show, place and velocity as they were.

    Parameters
    ----------
    state : NavState
    errors : ndarray, shape (43,)
        Of the start (computed - true).

    Returns
    -------
    state : NavState
    """
    turned = dcm_from_rotation_vector(-errors[AIDED_THETA]) @ state.C_nb
    return replace(state, C_nb=turned)


def _phi_covariance(lat_rad: NDArray, height_m: NDArray, P: NDArray) -> NDArray:
    """Covariance (k, 3, 3) of the NED attitude error: phi_N = theta_N - p_E / R, phi_E = theta_E +
    p_N / R, phi_D = theta_D + p_E tan(lat) / R.
    """
    radius = SEMI_MAJOR_AXIS_M + height_m
    rows = np.zeros((lat_rad.size, 3, AIDED_MOTION))
    rows[:, :, AIDED_THETA] = np.eye(3)
    rows[:, 0, 1] = -1.0 / radius
    rows[:, 1, 0] = 1.0 / radius
    rows[:, 2, 1] = np.clip(np.tan(lat_rad), -POLE_TAN, POLE_TAN) / radius
    return np.asarray(rows @ P @ np.swapaxes(rows, 1, 2))


def _piece(
    piece: TapedPiece, noise: NDArray, adjoint: NDArray, information: NDArray
) -> tuple[NDArray, NDArray]:
    """Errors (rows, 15) and their covariances (rows, 15, 15); the adjoints are taken through."""
    rows = int(piece.emits.sum())
    from ins.filters.aided_smoother_kernel import backward

    x, P = np.zeros((rows, AIDED_MOTION)), np.zeros((rows, AIDED_MOTION, AIDED_MOTION))
    backward(
        piece.step_s,
        piece.phis,
        piece.measurements,
        piece.ends,
        piece.emits,
        piece.P_rows,
        noise,
        adjoint,
        information,
        x,
        P,
    )
    return x, P
