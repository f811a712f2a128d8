"""Reading a table of azimuths and self-calibrated gyro biases (CSV), for those who have the biases
but not the logs::

    heading_deg,bias_x_deg_h,bias_y_deg_h,bias_z_deg_h,sigma_x_deg_h,sigma_y_deg_h,sigma_z_deg_h

The azimuth is `heading_deg`, clockwise from north, or `north_to_west_deg`, counted the other way:
the name says which, a bare `azimuth_deg` is refused. Body axes x forward, y right, z down. Without
sigma columns one sigma is given for all.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from infield.misalignment.harmonic_fit import north_to_west_rad
from ins.json_file import read_csv_rows
from ins.records import AXES, InputError
from ins.units import DEG

BIASES = tuple(f"bias_{axis}_deg_h" for axis in AXES)
SIGMA_COLUMNS = tuple(f"sigma_{axis}_deg_h" for axis in AXES)
AZIMUTHS = ("heading_deg", "north_to_west_deg")


@dataclass(frozen=True)
class AzimuthTable:
    """heading_rad (m,), bias_deg_h (m, 3), sigma_deg_h (m, 3)."""

    heading_rad: NDArray
    bias_deg_h: NDArray
    sigma_deg_h: NDArray


def read_azimuth_table(path: Path, *, sigma_deg_h: float | None = None) -> AzimuthTable:
    """The table in a CSV file; InputError names file, row and column."""
    rows = [row for _, row in read_csv_rows(path)]
    if len(rows) < 2:
        raise InputError(
            f"{path}: {max(len(rows) - 1, 0)} rows, needed a header and a row for each azimuth"
        )
    names = [cell.strip() for cell in rows[0]]
    _check_header(path, names, sigma_deg_h)
    columns = {name: _column(path, rows, names, name) for name in names}
    azimuth = next(name for name in AZIMUTHS if name in columns)
    angle = columns[azimuth] * DEG
    if np.max(np.abs(angle)) > 2 * np.pi:
        raise InputError(
            f"{path}: {azimuth} up to {np.max(np.abs(columns[azimuth])):g}, needed within +-360 deg"
        )
    if SIGMA_COLUMNS[0] in columns:
        sigma = np.column_stack([columns[name] for name in SIGMA_COLUMNS])
        if np.min(sigma) <= 0:
            j, k = np.unravel_index(np.argmin(sigma), sigma.shape)
            raise InputError(
                f"{path}: row {j + 1}: {SIGMA_COLUMNS[k]} = {sigma[j, k]:g}, needed more than 0"
            )
    else:
        sigma = np.full((angle.size, 3), sigma_deg_h)
    heading = np.mod(angle, 2 * np.pi) if azimuth == "heading_deg" else north_to_west_rad(angle)
    return AzimuthTable(heading, np.column_stack([columns[name] for name in BIASES]), sigma)


def _check_header(path: Path, names: list[str], sigma_deg_h: float | None) -> None:
    if "azimuth_deg" in names:
        raise InputError(
            f"{path}: column azimuth_deg does not say which way it counts, needed"
            f" {' or '.join(AZIMUTHS)}"
        )
    if sum(name in names for name in AZIMUTHS) != 1:
        raise InputError(
            f"{path}: columns {', '.join(names)[:80]}: needed exactly one of"
            f" {' and '.join(AZIMUTHS)}"
        )
    missing = [name for name in BIASES if name not in names]
    given = [name for name in SIGMA_COLUMNS if name in names]
    if missing or 0 < len(given) < 3:
        lacking = missing or [n for n in SIGMA_COLUMNS if n not in given]
        raise InputError(f"{path}: column {lacking[0]} is missing")
    if not given and sigma_deg_h is None:
        raise InputError(
            f"{path}: no sigma of the biases, needed columns {', '.join(SIGMA_COLUMNS)} or"
            " --sigma-deg-h"
        )
    unknown = [name for name in names if name not in (*AZIMUTHS, *BIASES, *SIGMA_COLUMNS)]
    if unknown or len(set(names)) < len(names):
        raise InputError(f"{path}: column {(unknown or names)[0]!r} is unknown or given twice")


def _column(path: Path, rows: list[list[str]], names: list[str], name: str) -> NDArray:
    values = []
    for number, row in enumerate(rows[1:], start=1):
        if len(row) != len(names):
            raise InputError(f"{path}: row {number}: {len(row)} values, needed {len(names)}")
        text = row[names.index(name)].strip()
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise InputError(
                f"{path}: row {number}: {name} = {text[:40]!r}, needed a finite number"
            )
        values.append(value)
    return np.array(values)
