"""Measured increments to corrected ones: biases, scale factors and misalignment removed. Holds no
parameter values.

The sensor model is measured = (I + S + M) true + bias, in sensor axes x, y, z.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.records import ImuLog, ImuSource, InputError
from ins.units import MILLIRADIAN, PPM

NO_SCALE_FACTOR = (0.0, 0.0, 0.0)
NO_MISALIGNMENT = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
OFF_DIAGONAL = ([0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1])  # xy, xz, yx, yz, zx, zy


def gyro_matrix(*, scale_factor_ppm: ArrayLike, misalignment_mrad: ArrayLike) -> NDArray:
    """Sensitivity of a gyro triad: I + S + M.

    Parameters
    ----------
    scale_factor_ppm : array_like, shape (3,)
        Scale factor errors, positive where a gyro reads high.
    misalignment_mrad : array_like, shape (6,)
        [xy, xz, yx, yz, zx, zy]; entry ij is the sensitivity of gyro i to rate about j.

    Returns
    -------
    matrix : ndarray, shape (3, 3)
        measured = matrix @ true.

    Raises
    ------
    InputError
        Where one of the two has another length.
    """
    scale = np.asarray(scale_factor_ppm, dtype=float)
    misalignment = np.asarray(misalignment_mrad, dtype=float)
    if scale.shape != (3,) or misalignment.shape != (6,):
        raise InputError(
            f"gyro matrix: shapes {scale.shape} and {misalignment.shape}, needed (3,) and (6,)"
        )
    matrix = np.diag(1 + scale * PPM)
    matrix[OFF_DIAGONAL] = misalignment * MILLIRADIAN
    return matrix


def compensate(
    imu: ImuLog,
    *,
    gyro_bias_rad_s: ArrayLike | None = None,
    accel_bias_m_s2: ArrayLike | None = None,
    gyro_scale_factor_ppm: ArrayLike = NO_SCALE_FACTOR,
    gyro_misalignment_mrad: ArrayLike = NO_MISALIGNMENT,
) -> ImuLog:
    """The log with its sensor errors removed.

    It is the exact inverse of measured = (I + S + M) true + bias.

    Parameters
    ----------
    imu : ImuLog
        Measured increments, n rows.
    gyro_bias_rad_s, accel_bias_m_s2 : array_like, shape (3,) or (n, 3), or None
        Measured minus true at zero scale error; None: zero. Integrated over each row's dt_s.
    gyro_scale_factor_ppm : shape (3,)
    gyro_misalignment_mrad : shape (6,)
        [xy, xz, yx, yz, zx, zy]; entry ij is the sensitivity of gyro i to rate about j (formats.md,
        section 3).

    Returns
    -------
    ImuLog
        Same times and source.

    Raises
    ------
    InputError
        A bias of another shape or not finite; a matrix that has no inverse.
    """
    matrix = gyro_matrix(
        scale_factor_ppm=gyro_scale_factor_ppm, misalignment_mrad=gyro_misalignment_mrad
    )
    if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < 3:
        raise InputError("gyro scale factors and misalignment: the matrix I + S + M has no inverse")
    dtheta = imu.dtheta_rad - _integrated(gyro_bias_rad_s, imu, "gyro_bias_rad_s")
    if not np.array_equal(matrix, np.eye(3)):
        dtheta = _turned(np.linalg.inv(matrix), dtheta)
    return ImuLog(
        time_s=imu.time_s,
        dt_s=imu.dt_s,
        dtheta_rad=dtheta,
        dv_m_s=imu.dv_m_s - _integrated(accel_bias_m_s2, imu, "accel_bias_m_s2"),
        source=imu.source,
    )


@dataclass(frozen=True)
class CorrectedImu:
    """A log in its file, seen through a correction of its rows that is made anew for each piece.

    It is an `ImuSource`; its properties and methods are those of the raw log.

    Parameters
    ----------
    raw : ImuSource
        The log as it was written.
    correct : callable
        Takes an `ImuLog` and returns it corrected, each row by itself.
    """

    raw: ImuSource
    correct: Callable[[ImuLog], ImuLog]

    @property
    def source(self) -> str:
        """ "increments" or "rates": what the file held."""
        return self.raw.source

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.raw.rows

    @property
    def start_s(self) -> float:
        """Time of the first row."""
        return self.raw.start_s

    @property
    def end_s(self) -> float:
        """Time of the last row."""
        return self.raw.end_s

    @property
    def rate_hz(self) -> float:
        """Nominal sample rate: one over the median interval."""
        return self.raw.rate_hz

    def between(self, start_s: float, end_s: float) -> ImuLog:
        """The corrected rows whose interval ends in a span.

        Parameters
        ----------
        start_s, end_s : float
            The span (start_s, end_s].

        Returns
        -------
        imu : ImuLog
            In memory.
        """
        return self.correct(self.raw.between(start_s, end_s))

    def pieces(self, start_s: float = -np.inf, end_s: float = np.inf) -> Iterator[ImuLog]:
        """The corrected rows of a span, piece by piece.

        Parameters
        ----------
        start_s, end_s : float
            The span (start_s, end_s].

        Returns
        -------
        pieces : iterator of ImuLog
            Each of two or more rows.
        """
        return map(self.correct, self.raw.pieces(start_s, end_s))

    def whole(self) -> ImuLog:
        """All rows, corrected.

        Returns
        -------
        imu : ImuLog
            In memory.
        """
        return self.correct(self.raw.whole())


def corrected(imu: ImuSource, correct: Callable[[ImuLog], ImuLog]) -> ImuSource:
    """A log with each row corrected by itself.

    Parameters
    ----------
    imu : ImuSource
        In memory or in its file.
    correct : callable
        Takes an `ImuLog` and returns it corrected, each row by itself (for example `compensate`).

    Returns
    -------
    imu : ImuSource
        Corrected at once where the log is in memory, else as it is read.
    """
    return correct(imu) if isinstance(imu, ImuLog) else CorrectedImu(imu, correct)


def _turned(matrix: NDArray, rows: NDArray) -> NDArray:
    """matrix @ each row (n, 3), one product and sum a time: a row's bits do not depend on how many
    there are.
    """
    return rows[:, :1] * matrix[:, 0] + rows[:, 1:2] * matrix[:, 1] + rows[:, 2:] * matrix[:, 2]


def _integrated(bias: ArrayLike | None, imu: ImuLog, name: str) -> NDArray:
    """The bias of shape (3,) or (n, 3) times dt, shape (n, 3)."""
    value = np.zeros(3) if bias is None else np.asarray(bias, dtype=float)
    if value.shape not in ((3,), imu.dtheta_rad.shape):
        raise InputError(f"{name}: shape {value.shape}, needed (3,) or {imu.dtheta_rad.shape}")
    if not np.isfinite(value).all():
        raise InputError(f"{name}: holds a value that is not finite")
    return value * imu.dt_s[:, None]
