"""The thermal compensation itself at fault: the table misapplied (effects.md D05), or fed by a slow
or offset thermometer (D04).

Temperatures are the readings, and what an effect adds is measured less what the twin's table
predicts at them; so the same series serves as the signature and, the readings untouched, as the
injection.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.errors.base import AXIS, GYROS, Coefficient, Shape, Words, error, on_gyro, one
from ins.errors.parts.formula import with_parts
from ins.errors.parts.gyro_needs import gyro_degC, gyro_degC_min, lacks_temperature_rate
from ins.errors.telemetry import Telemetry, Trace
from ins.records import InputError
from ins.units import DEG_PER_HOUR

# a blunder is -2, -1 or 1 times the table; any other share is a drift that looks like it
WHOLE_LOG_PRIOR = -1.0
# a table that moves by less over the runs has no temperature in it; 1e-6 deg/h is what R6 takes
# for no change
LEAST_TABLE_RAD_S = 1e-6 * DEG_PER_HOUR
# readings that move by less tell no slope: 20 steps of the default thermometer
LEAST_SPAN_degC = 0.2
SLOPE_STEP_degC = 0.5


def table_rad_s(run: Telemetry) -> NDArray:
    """The twin's table at the readings (n, 3); InputError without one."""
    if run.table_deg_h is None:
        raise InputError(
            f"run {run.run_index}: no thermal table at its temperatures, needed by this effect"
        )
    return DEG_PER_HOUR * run.table_deg_h


def misapplied(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """The table once more: +1 not applied, -1 applied twice, +2 applied with the wrong sign."""
    return on_gyro(target, table_rad_s(run)[:, AXIS[target]])


def lacks_table(runs: Sequence[Telemetry], target: str) -> str:
    """The table of this gyro must move with the temperatures of the runs."""
    if any(run.table_deg_h is None for run in runs):
        return "a thermal table and a gyro temperature"
    return (
        ""
        if _moves([table_rad_s(run)[:, AXIS[target]] for run in runs])
        else "a gyro temperature that moves the table"
    )


def lacks_moving_table(runs: Sequence[Telemetry], target: str) -> str:
    """An error of the thermometers shows where the table moves within a run, on any gyro."""
    if any(run.table_deg_h is None for run in runs):
        return "a thermal table and a gyro temperature"
    moves = any(_moves([table_rad_s(run)[:, k]]) for run in runs for k in range(3))
    return lacks_temperature_rate(runs, GYROS[0]) or (
        "" if moves else "a gyro temperature that moves the table"
    )


def table_slope(run: Telemetry) -> NDArray:
    """Slope of the twin's table at the readings (n, 3) [rad/s per degC]; 0 for a gyro whose
    readings do not move.

    From the run's own readings: the table at even steps of temperature, so that noise of the
    readings does not enter.
    """
    table = table_rad_s(run)
    return np.stack([_slope(gyro_degC(run, gyro), table[:, AXIS[gyro]]) for gyro in GYROS], axis=1)


def _slope(T: NDArray, table: NDArray) -> NDArray:
    low, high = float(T.min()), float(T.max())
    if high - low < LEAST_SPAN_degC:
        return np.zeros(T.size)
    grid = np.linspace(low, high, max(round((high - low) / SLOPE_STEP_degC), 2) + 1)
    order = np.argsort(T)
    return np.interp(
        T, grid, np.gradient(np.interp(grid, T[order], table[order]), grid, edge_order=2)
    )


def sensor_error(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Thermometers that are slow by 1 s, and that read high by 1 degC, all three alike.

    The gyros follow the table at the true temperature, T_read + tau dT_read/dt (a first-order lag,
    exactly) or T_read - offset: measured - predicted = slope (tau dT_read/dt - offset). Left out:
    the curvature of the table, a part shift / 2 x (slope of the slope) / slope of it.
    """
    slope = table_slope(run)
    rate = np.stack([gyro_degC_min(run, gyro) for gyro in GYROS], axis=1) / 60.0
    return Trace(gyro_rad_s=slope * rate), Trace(gyro_rad_s=-slope)


def _moves(tables: Sequence[NDArray]) -> bool:
    return float(np.ptp(np.concatenate(tables))) > LEAST_TABLE_RAD_S if tables else False


COMPENSATION = (
    *with_parts(
        error(
            "D04",
            "temperature_sensor_error",
            ("temperature",),
            (*one("s", 10.0, 300.0), Coefficient("offset", "degC", 0.2, 5.0)),
            formula=sensor_error,
            need=lacks_moving_table,
            source="k1 tau dT/dt; k1 offset",
            words=Words(
                what="The thermometer that enters the table is late, off, or coarse.",
                brought_on_by="Ramps for the lag; the offset is always there.",
                size="It makes a bias of the table's slope times the error in degC.",
                remedy="Check the thermometer against another at rest; log finer steps.",
            ),
        ),
        lag="coefficient",
        offset="offset",
    ),
    error(
        "D05",
        "compensation_misapplied",
        GYROS,
        one("times the table", 0.5, 2.0),
        formula=misapplied,
        need=lacks_table,
        log_prior=WHOLE_LOG_PRIOR,
        words=Words(
            what="The thermal table was subtracted twice, not at all, or with the wrong sign.",
            brought_on_by="A log that says wrongly whether its gyros are compensated.",
            size="It is the table itself, times 1, -1 or -2.",
            remedy="Check `applied_table_sha256` of the run and the settings of the unit.",
        ),
    ),
)
