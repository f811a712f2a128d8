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


INCREMENTS = _triple("dtheta_{}_rad") + _triple("dv_{}_m_s")
RATES = _triple("gyro_{}_rad_s") + _triple("accel_{}_m_s2")
GYRO_DEGC = _triple("gyro_{}_degC")
ACCEL_DEGC = _triple("accel_{}_degC")
GRADIENT_DEGC = _triple("gradient_{}_degC")
POSITION = ("lat_deg", "lon_deg", "height_m")
VELOCITY = ("vn_m_s", "ve_m_s", "vd_m_s")
SIGMAS = ("sigma_horizontal_m", "sigma_vertical_m", "sigma_velocity_m_s")
ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")


def spread(names: Sequence[str], values: NDArray | None) -> dict[str, NDArray]:
    """The columns of an array (n, k) by name; none where there is no array."""
    if values is None:
        return {}
    return {name: values[:, k] for k, name in enumerate(names)}


def given(**columns: NDArray | None) -> dict[str, NDArray]:
    """The columns that are there."""
    return {name: values for name, values in columns.items() if values is not None}


def degrees_exact(angle_rad: ArrayLike) -> NDArray:
    """Degrees for a file: the short decimal a person typed where it gives the same float in
    radians, else the quotient.

    What was read from a file comes back the same in degrees and in radians; other angles may lose
    one unit in the last place of the radians the first time (1.4e-9 m on the ground), nothing
    after.
    """
    rad = np.asarray(angle_rad, dtype=float)
    quotient = rad / DEG
    short = np.round(quotient, 10)
    return np.where(short * DEG == rad, short, quotient)


def place(
    lat_rad: NDArray, lon_rad: NDArray, height_m: NDArray, v_n_m_s: NDArray
) -> dict[str, NDArray]:
    """Positions and velocities as columns."""
    position = (degrees_exact(lat_rad), degrees_exact(lon_rad), height_m)
    return {**dict(zip(POSITION, position)), **spread(VELOCITY, v_n_m_s)}


def frame(columns: Mapping[str, NDArray]) -> "pd.DataFrame":
    """Columns as a table of pandas whose index is `time_s`, seconds from the run's start."""
    import pandas as pd

    return pd.DataFrame(dict(columns)).set_index("time_s")


class Stream:
    """What a notebook shows of a stream: its size in a line, its columns as a table."""

    time_s: NDArray

    def columns(self) -> dict[str, NDArray]:
        """The stream as columns of its file, `time_s` first."""
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
    """Rows, span and rate of a stream in words."""
    if time_s.size < 2:
        return f"{time_s.size} rows"
    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    return f"{time_s.size} rows, {time_s[0]:.6g} to {time_s[-1]:.6g} s, {rate_hz:.4g} Hz"
