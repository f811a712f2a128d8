"""The thermal compensation itself at fault: the table misapplied (gap.md D05), or fed by a slow thermometer (D04).

Temperatures are the readings, and what an effect adds is measured less what the twin's table predicts at them; so the
same series serves as the signature and, the readings untouched, as the injection.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.units import DEG_PER_HOUR
from simreal.effects.base import AXIS, GYROS, Effect, Shape
from simreal.effects.gyro_effect import gyro_effect, on_gyro, one
from simreal.effects.gyro_needs import lacks_temperature_rate
from simreal.telemetry import Telemetry, Trace

LEAST_TABLE_RAD_S = 1e-6 * DEG_PER_HOUR  # a table that moves by less over the runs has no temperature in it


def table_rad_s(run: Telemetry) -> NDArray:
    """The twin's table at the readings (n, 3); InputError without one."""
    if run.table_deg_h is None:
        raise InputError(f"run {run.run_index}: no thermal table at its temperatures, needed by this effect")
    return DEG_PER_HOUR * run.table_deg_h


def misapplied(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """The table once more: +1 not applied, -1 applied twice, +2 applied with the wrong sign."""
    return on_gyro(target, table_rad_s(run)[:, AXIS[target]])


def lacks_table(runs: Sequence[Telemetry], target: str) -> str:
    """The table of this gyro must move with the temperatures of the runs."""
    if any(run.table_deg_h is None for run in runs):
        return "a thermal table and a gyro temperature"
    return "" if _moves([table_rad_s(run)[:, AXIS[target]] for run in runs]) else "a gyro temperature that moves the table"


def lacks_moving_table(runs: Sequence[Telemetry], target: str) -> str:
    """A thermometer's lag shows where the table moves within a run, on any gyro."""
    if any(run.table_deg_h is None for run in runs):
        return "a thermal table and a gyro temperature"
    moves = any(_moves([table_rad_s(run)[:, k]]) for run in runs for k in range(3))
    return lacks_temperature_rate(runs, GYROS[0]) or ("" if moves else "a gyro temperature that moves the table")


def sensor_lag(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Thermometers that are slow by 1 s, all three alike.

    True T = T_read + tau dT_read/dt (first order in tau), so the gyros follow the table at a temperature that the log does
    not show yet: measured - predicted = tau d/dt table(T_read). Positive: the reading comes late.
    """
    return (Trace(gyro_rad_s=run.rate_of(table_rad_s(run))),)


def _moves(tables: Sequence[NDArray]) -> bool:
    return float(np.ptp(np.concatenate(tables))) > LEAST_TABLE_RAD_S if tables else False


COMPENSATION: tuple[Effect, ...] = (
    gyro_effect(
        "temperature_sensor_error", targets=("temperature",), coefficients=one("s", 10.0, 300.0),
        formula=sensor_lag, need=lacks_moving_table,
        rivals=("gyro_thermal_rate", "gyro_thermal_lag"), source="gap.md D04: k1 tau dT/dt",
    ),
    gyro_effect(
        "compensation_misapplied", coefficients=one("times the table", 0.5, 2.0),
        formula=misapplied, need=lacks_table, rivals=("gyro_thermal_linear", "gyro_thermal_quadratic"),
        source="gap.md D05",
    ),
)  # fmt: skip
