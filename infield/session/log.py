"""The log of a session: which part of it counts, and what is taken out of it before."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import REST_BLOCKS, first_rest
from alignment.motion.seconds import LogSeconds
from alignment.motion.speeds import watched_seconds
from alignment.motion.stillness import ALIGNMENT_S
from infield.table.thermal_table import TemperatureModel, ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature, gyro_temperature, plausible_range
from ins.records import (
    AIRBORNE_PHASES,
    PARKED_PHASES,
    ImuLog,
    ImuSource,
    InputError,
    Run,
    TwinModel,
)
from ins.strapdown.compensation import compensate, corrected
from ins.units import DEG_PER_HOUR, MICRO_G


def compensated_imu(
    run: Run, table: TemperatureModel | None, temperature: GyroTemperature | None, twin: TwinModel
) -> ImuSource:
    """The log less the table at each row's temperature, less the twin's nominal scale, misalignment
    and biases.

    No table, or no temperature: only the twin's. A log that is in its file stays there.
    """
    return corrected(run.imu, _correction(run, table, temperature, twin))


def compensated_seconds(
    run: Run, table: TemperatureModel | None, temperature: GyroTemperature | None, twin: TwinModel
) -> LogSeconds:
    """The seconds of `compensated_imu`, from the log's own: no row is read again."""
    return watched_seconds(run).corrected(_correction(run, table, temperature, twin))


def _correction(
    run: Run, table: TemperatureModel | None, temperature: GyroTemperature | None, twin: TwinModel
) -> Callable[[ImuLog], ImuLog]:
    bias_at = None
    if table is not None and temperature is not None:
        refuse_without_settled_part(run)
        bias_at = table_series(table, temperature)

    def correct(piece: ImuLog) -> ImuLog:
        return compensate(
            piece,
            gyro_bias_rad_s=None if bias_at is None else bias_at(piece.time_s) * DEG_PER_HOUR,
            accel_bias_m_s2=np.asarray(twin.accel.bias_ug) * MICRO_G,
            gyro_scale_factor_ppm=twin.gyro.scale_factor_ppm,
            gyro_misalignment_mrad=twin.gyro.misalignment_mrad,
        )

    return correct


def refuse_without_settled_part(run: Run) -> None:
    """InputError for a run that a whole thermal model was taken out of: a table would be subtracted
    on top of it.
    """
    gone = run.header.removed_model
    if gone is not None and gone.part == "all":
        raise InputError(
            f"run {run.header.run_id}: thermal model {gone.sha256[:12]} was taken out whole, needed"
            " the raw run or --part rates"
        )


def table_series(
    table: TemperatureModel, temperature: GyroTemperature
) -> Callable[[NDArray], NDArray]:
    """Table bias (k, 3) [deg/h] at any times: the table at the smoothed temperature's nodes,
    straight lines in between.
    """
    nodes_s, T = temperature.time_s, temperature.temperature_degC
    bias = table.settled_deg_h(T)
    return lambda time_s: np.stack([np.interp(time_s, nodes_s, b) for b in bias.T], axis=1)


def alignment_end(run: Run, start_s: float) -> float:
    """End of the logged alignment phase, else ten minutes after the rest began at `start_s`."""
    logged = [p.end_s for p in run.phases if p.phase == "alignment" and p.end_s > start_s]
    return logged[0] if logged else start_s + ALIGNMENT_S


def find_rest(run: Run, blocks_needed: int = REST_BLOCKS) -> tuple[float, float] | None:
    """The first rest of a minute or of so many blocks of 10 s: within the logged alignment phase
    where there is one.
    """
    log = watched_seconds(run)
    logged = [p for p in run.phases if p.phase in PARKED_PHASES]
    parked = log.between(logged[0].start_s, logged[0].end_s) if logged else log
    return first_rest(parked, blocks_needed)


def session_end(run: Run, after_s: float = -np.inf) -> float:
    """Where a ground session ends that begins at after_s: the next take-off or flight phase, else
    the end of the log.
    """
    airborne = [
        p.start_s for p in run.phases if p.phase in AIRBORNE_PHASES and p.start_s >= after_s
    ]
    return min([*airborne, run.imu.end_s])


def applied_table_of(
    run: Run, applied_table: Callable[[str], ThermalTable] | None
) -> ThermalTable | None:
    """The table that the unit had subtracted, None for raw output; InputError where it is unknown,
    or of another unit.
    """
    sha256 = run.header.applied_table_sha256
    if sha256 is None:
        return None
    if applied_table is None:
        raise InputError(
            f"run {run.header.run_id}: applied_table_sha256 {sha256[:12]} is unknown: no store to"
            " find it in"
        )
    table = applied_table(sha256)
    if table.imu_serial != run.header.imu_serial:
        raise InputError(
            f"run {run.header.run_id}: run.json: applied_table_sha256 {sha256[:12]} is a table of"
            f" unit {table.imu_serial}, needed one of {run.header.imu_serial}"
        )
    return table


def with_applied_table_undone(run: Run, applied_table: Callable[[str], ThermalTable] | None) -> Run:
    """The run with raw gyro output: a table that the unit had subtracted is added back; InputError
    where it cannot be.
    """
    refuse_without_settled_part(run)
    table = applied_table_of(run, applied_table)
    if table is None:
        return run
    if run.temperature is None:
        raise InputError(
            f"run {run.header.run_id}: a table was applied but no temperature is logged: cannot be"
            " undone"
        )
    bias_at = table_series(
        table, gyro_temperature(run.temperature, plausible_degC=plausible_range(table))
    )

    def restored(piece: ImuLog) -> ImuLog:
        return compensate(piece, gyro_bias_rad_s=-bias_at(piece.time_s) * DEG_PER_HOUR)

    return replace(run, imu=corrected(run.imu, restored))
