"""How well a table is known where an update measured: its U(k=2) before and after.

An update's `observability` holds another sigma, that of one run's mean bias: the table is the mean
over power-ons, so the turn-on bias of each run stays between the two.
"""

from dataclasses import dataclass

import numpy as np

from infield.reports.documents.update_records import UpdateDocument
from infield.table.file import table_from_dict

COVERAGE = 2.0  # U(k=2)


@dataclass(frozen=True, kw_only=True)
class TableUncertainty:
    """U(k=2) [deg/h] of one gyro's table, RMS over the temperatures of the bias points [degC]."""

    U_before_k2_deg_h: float
    U_after_k2_deg_h: float
    low_degC: float
    high_degC: float


def table_uncertainty(document: UpdateDocument) -> dict[str, TableUncertainty]:
    """Gyro by gyro, for those with bias points."""
    before = table_from_dict(document.table_before, name="table_before")
    after = table_from_dict(document.table_after or document.table_before, name="table_after")
    found = {}
    for axis in document.observability:
        T = np.array([p.temperature_degC for p in document.points if p.axis == axis])
        if T.size == 0:
            continue
        found[axis] = TableUncertainty(
            U_before_k2_deg_h=_rms(COVERAGE * before.sigma_deg_h(axis, T)),
            U_after_k2_deg_h=_rms(COVERAGE * after.sigma_deg_h(axis, T)),
            low_degC=float(T.min()),
            high_degC=float(T.max()),
        )
    return found


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
