"""The columns of a run's streams, by the names of the run format: unit in the name, degrees.

Records hold radians; `degrees_exact` is the way to the file. This module knows no record, so that
the records can use it.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.units import DEG

if TYPE_CHECKING:
    import pandas as pd

AXES = ("x", "y", "z")


def _triple(pattern: str) -> tuple[str, ...]:
    return tuple(pattern.format(axis) for axis in AXES)


INCREMENT_COLUMNS = _triple("dtheta_{}_rad") + _triple("dv_{}_m_s")
RATE_COLUMNS = _triple("gyro_{}_rad_s") + _triple("accel_{}_m_s2")
GYRO_DEGC = _triple("gyro_{}_degC")
ACCEL_DEGC = _triple("accel_{}_degC")
GRADIENT_DEGC = _triple("gradient_{}_degC")
POSITION = ("lat_deg", "lon_deg", "height_m")
VELOCITY = ("vn_m_s", "ve_m_s", "vd_m_s")
FIX_SIGMA_COLUMNS = ("sigma_horizontal_m", "sigma_vertical_m", "sigma_velocity_m_s")
FIX_TYPE_COLUMN = "fix_type"
ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")


def spread(names: Sequence[str], values: NDArray | None) -> dict[str, NDArray]:
    """The columns of an array by name.

    Parameters
    ----------
    names : sequence of str, k of them
    values : ndarray, shape (n, k), or None

    Returns
    -------
    columns : dict of ndarray, shape (n,)
        Empty where there is no array.
    """
    if values is None:
        return {}
    return {name: values[:, k] for k, name in enumerate(names)}


def given(**columns: NDArray | None) -> dict[str, NDArray]:
    """The columns that are there.

    Parameters
    ----------
    **columns : ndarray, shape (n,), or None

    Returns
    -------
    columns : dict of ndarray, shape (n,)
    """
    return {name: values for name, values in columns.items() if values is not None}


def degrees_exact(angle_rad: ArrayLike) -> NDArray:
    """Degrees for a file, such that the same radians come back.

    Parameters
    ----------
    angle_rad : array_like, shape (...)

    Returns
    -------
    angle_deg : ndarray, shape (...)
        The short decimal a person typed where it gives the same float in radians, else the
        quotient.

    Notes
    -----
    What was read from a file comes back the same in degrees and in radians. Other angles may lose
    one unit in the last place of the radians the first time (1.4e-9 m on the ground), nothing
    after.

    Examples
    --------
    >>> float(degrees_exact(48.1 * DEG))
    48.1
    """
    rad = np.asarray(angle_rad, dtype=float)
    quotient = rad / DEG
    short = np.round(quotient, 10)
    return np.where(short * DEG == rad, short, quotient)


def place(
    lat_rad: NDArray, lon_rad: NDArray, height_m: NDArray, v_n_m_s: NDArray
) -> dict[str, NDArray]:
    """Positions and velocities as columns.

    Parameters
    ----------
    lat_rad, lon_rad, height_m : ndarray, shape (n,)
    v_n_m_s : ndarray, shape (n, 3)
        NED.

    Returns
    -------
    columns : dict of ndarray, shape (n,)
        Named POSITION and VELOCITY.
    """
    position = (degrees_exact(lat_rad), degrees_exact(lon_rad), height_m)
    return {**dict(zip(POSITION, position)), **spread(VELOCITY, v_n_m_s)}


def frame(columns: Mapping[str, NDArray]) -> "pd.DataFrame":
    """Columns as a table of pandas.

    Parameters
    ----------
    columns : mapping of ndarray, shape (n,)
        One of them `time_s`.

    Returns
    -------
    table : pandas.DataFrame
        Its index is `time_s`, seconds from the run's start.
    """
    import pandas as pd

    return pd.DataFrame(dict(columns)).set_index("time_s")


class Stream:
    """What a notebook shows of a stream: its size in a line, its columns as a table."""

    time_s: NDArray

    def columns(self) -> dict[str, NDArray]:
        """The stream as columns of its file.

        Returns
        -------
        columns : dict of ndarray, shape (n,)
            `time_s` first.
        """
        raise NotImplementedError

    def to_frame(self) -> "pd.DataFrame":
        """The stream as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            A row per row of the stream. The index is `time_s`, seconds from the run's start; a
            column has the name, and with it the unit, of the stream's file (angles in degrees).
        """
        return frame(self.columns())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({stream_size(self.time_s)})"


def stream_size(time_s: NDArray) -> str:
    """Rows, span and rate of a stream in words.

    Parameters
    ----------
    time_s : ndarray, shape (n,)

    Returns
    -------
    words : str

    Examples
    --------
    >>> stream_size(np.arange(0.0, 10.5, 0.5))
    '21 rows, 0 to 10 s, 2 Hz'
    """
    if time_s.size < 2:
        return f"{time_s.size} rows"
    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    return f"{time_s.size} rows, {time_s[0]:.6g} to {time_s[-1]:.6g} s, {rate_hz:.4g} Hz"
