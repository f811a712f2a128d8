"""JSON documents that packages hand on as they were written, so that their hash stays what it was.

What is read of them becomes a record (`infield.table.file.table_from_dict`); these types name the
keys of formats.md for what is only kept, hashed and written again.
"""

from typing import Any, NotRequired, TypedDict


class AxisDocument(TypedDict):
    """One gyro of a table; slopes with hermite interpolation only."""

    temperature_degC: list[float]
    bias_deg_h: list[float]
    sigma_deg_h: list[float]
    slope_deg_h_degC: NotRequired[list[float]]


class TableDocument(TypedDict):
    """A thermal table as written (recal.table/1); provenance: what whoever made it says of it."""

    schema: str
    imu_serial: str
    gyro_technology: str
    gyro_mode: NotRequired[str]
    created_utc: str
    interpolation: str
    axes: dict[str, AxisDocument]
    covariance: NotRequired[list[list[float]] | None]
    provenance: NotRequired[dict[str, Any]]
