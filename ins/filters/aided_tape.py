"""What the aided filter writes down for a smoother: transitions, measurements, covariances."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ins.filters.states import AIDED_DRIVING, AIDED_GYRO

# of a step's transition: the rows of position, velocity and attitude; the others are unit, or fade
TAPED_PHI = (AIDED_GYRO.start, AIDED_DRIVING)


@dataclass(frozen=True, kw_only=True)
class TapedPiece:
    """The steps of a piece of log.

    Parameters
    ----------
    step_s : ndarray, shape (k,)
        Length of each step.
    phis : ndarray, shape (k, 9, 29)
        Rows of its transition that are not unit.
    measurements : ndarray, shape (m, TAPE)
        Scalar measurements in the order of their use (`ins.filters.aided_kernel`).
    ends : ndarray of int64, shape (k,)
        How many of them were used up to the end of each step.
    emits : ndarray of bool, shape (k,)
        Whether a row was put out there.
    P_rows : ndarray, shape (rows, 41, 41)
        Covariance of all errors at these rows.
    """

    step_s: NDArray
    phis: NDArray
    measurements: NDArray
    ends: NDArray
    emits: NDArray
    P_rows: NDArray

    def shortened(self) -> "TapedPiece":
        """The same without the room that was not needed.

        Returns
        -------
        piece : TapedPiece
        """
        used = int(self.ends[-1]) if self.ends.size else 0
        return replace(self, measurements=self.measurements[:used].copy())


@dataclass(frozen=True, kw_only=True)
class AidedTape:
    """All of a flight.

    Parameters
    ----------
    pieces : tuple of TapedPiece
    P_start : ndarray, shape (43, 43)
        Covariance at its start.
    noise : ndarray, shape (15,)
        In the order of the kernel: time constants of slow errors.
    """

    pieces: tuple[TapedPiece, ...]
    P_start: NDArray
    noise: NDArray

    @property
    def nbytes(self) -> int:
        """Memory that it takes.

        Returns
        -------
        size : int
            In bytes.
        """
        arrays = [a for p in self.pieces for a in vars(p).values() if isinstance(a, np.ndarray)]
        return sum(a.nbytes for a in arrays)
