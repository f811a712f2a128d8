"""The twin of a run: what the simulator believes about that very run, with its own noise.

The ideal sensors go along the run's own motion (`run_motion`), at its own sample times; the thermal
bias is the twin's table at the run's own temperatures; everything random (sensor noise, turn-on,
sway, side noise, yaw creep, thermometer, GNSS, odometer) is drawn anew from the twin (formats.md,
section 3). Many replicates of one run give the noise floor.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.session.navigated import table_series
from infield.session.pipeline import with_applied_table_undone
from infield.table.thermal_table import ThermalTable
from infield.thermometer.smoother import nodes_of, smooth_readings
from ins.earth import dcm_en, ecef_from_geodetic, geodetic_from_ecef
from ins.records import GnssLog, ImuLog, InputError, OdometerLog, Run, TemperatureLog, TwinModel
from ins.thermometer_faults import reading_step_degC
from simreal.twin.run_motion import RunMotion, estimate_motion
from simreal.twin.timeline import even_rate
from trajectories.simulator import imperfections
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.truth import rate_from_euler
from trajectories.simulator.vehicle import Disturbed, disturb

Inject = Callable[[Run, tuple[dict[str, Any], ...], np.random.Generator], Run]
"""Adds a twin's `effects` to a simulated run."""
AppliedTable = Callable[[str], ThermalTable]


@dataclass(frozen=True, kw_only=True)
class TwinBasis:
    """All of a run's twin that is not random, made once for many replicates.

    time_s, dt_s (n,): the run's rows; even: they are those of the ideal sensors, row by row.
    bias_deg_h (m, 3): thermal bias at slow_s (m,). temperature: without noise, None where the run
    logs none.
    """

    run: Run
    motion: RunMotion
    twin: TwinModel
    ideal: IdealSensors
    time_s: NDArray
    dt_s: NDArray
    even: bool
    slow_s: NDArray
    bias_deg_h: NDArray
    temperature: TemperatureLog | None


def twin_basis(
    run: Run,
    table: ThermalTable | None,
    twin: TwinModel,
    *,
    motion: RunMotion | None = None,
    applied_table: AppliedTable | None = None,
) -> TwinBasis:
    """Prepare the twin of a run. motion: of this run, estimated here where not given.

    applied_table(sha256) gives the table that the unit had subtracted, where the header names one:
    the twin's unit does the same. Raises InputError where it is unknown, and where the run never
    rests.
    """
    motion = motion or estimate_motion(with_applied_table_undone(run, applied_table), table, twin)
    rate_hz, even = even_rate(run.imu)
    times = [(piece.time_s, piece.dt_s) for piece in run.imu.pieces()]
    time_s, dt_s = (np.concatenate(column) for column in zip(*times))
    count = np.ceil((time_s[-1] - motion.origin_s) * imperfections.SLOW_RATE_HZ) + 1
    slow_s = motion.origin_s + np.arange(count) / imperfections.SLOW_RATE_HZ
    bias_deg_h = np.zeros((slow_s.size, 3))
    if motion.temperature is not None and table is not None:
        bias_deg_h += table_series(table, motion.temperature)(slow_s)
    if (
        motion.temperature is not None
        and run.header.applied_table_sha256 is not None
        and applied_table is not None
    ):
        bias_deg_h -= table_series(
            applied_table(run.header.applied_table_sha256), motion.temperature
        )(slow_s)
    return TwinBasis(
        run=run,
        motion=motion,
        twin=twin,
        ideal=ideal_sensors(motion.truth, rate_hz),
        time_s=time_s,
        dt_s=dt_s,
        even=even,
        slow_s=slow_s,
        bias_deg_h=bias_deg_h,
        temperature=_smoothed(run, motion),
    )


def simulate_twin(
    motion: RunMotion,
    run: Run,
    table: ThermalTable | None,
    twin: TwinModel,
    rng: np.random.Generator,
    *,
    inject: Inject | None = None,
    applied_table: AppliedTable | None = None,
) -> Run:
    """One replicate: the run's header, times, rates, phases and streams with the twin's own errors;
    sha256 is empty.

    Raises InputError where the twin lists effects and nothing is given to inject them.
    """
    return replicate(
        twin_basis(run, table, twin, motion=motion, applied_table=applied_table), rng, inject=inject
    )


def replicates(
    run: Run,
    table: ThermalTable | None,
    twin: TwinModel,
    n: int,
    rng: np.random.Generator,
    *,
    inject: Inject | None = None,
    motion: RunMotion | None = None,
    applied_table: AppliedTable | None = None,
) -> Iterator[Run]:
    """n twins of one run, one after the other; replicate k is the same however many are asked
    for.
    """
    basis = twin_basis(run, table, twin, motion=motion, applied_table=applied_table)
    for child in rng.spawn(n):
        yield replicate(basis, child, inject=inject)


def replicate(basis: TwinBasis, rng: np.random.Generator, *, inject: Inject | None = None) -> Run:
    """One replicate of a prepared twin."""
    twin, run = basis.twin, basis.run
    if twin.effects and inject is None:
        raise InputError(
            f"twin: effect {twin.effects[0].get('effect')!r} is listed, needed something to inject"
            " it with"
        )
    moved = disturb(basis.ideal, twin.vehicle, (), rng)
    simulated = replace(
        run,
        imu=_imu(basis, moved, rng),
        temperature=_temperature(basis, rng),
        gnss=_gnss(basis, moved, rng),
        odometer=_odometer(basis, rng),
        sha256="",
        faults=(),
    )
    return simulated if inject is None or not twin.effects else inject(simulated, twin.effects, rng)


def _imu(basis: TwinBasis, moved: Disturbed, rng: np.random.Generator) -> ImuLog:
    twin, m, rate_hz = basis.twin, basis.slow_s.size, imperfections.SLOW_RATE_HZ
    gyro = basis.bias_deg_h + imperfections.gyro_session_bias(rng, twin.gyro, m, rate_hz=rate_hz)
    accel = imperfections.accel_session_bias(rng, twin.accel, m, rate_hz=rate_hz)
    middle_s = basis.time_s - 0.5 * basis.dt_s
    dtheta, dv, dt = moved.dtheta_rad, moved.dv_m_s, basis.dt_s[:, None]
    if not basis.even:
        dtheta, dv = (_over_rows(basis, increments) for increments in (dtheta, dv))
    return ImuLog(
        time_s=basis.time_s,
        dt_s=basis.dt_s,
        source=basis.run.imu.source,
        dtheta_rad=imperfections.gyro_output(
            rng, dtheta, _at(middle_s, basis.slow_s, gyro), twin.gyro, dt_s=dt
        ),
        dv_m_s=imperfections.accel_output(
            rng, dv, _at(middle_s, basis.slow_s, accel), twin.accel, dt_s=dt
        ),
    )


def _over_rows(basis: TwinBasis, increments: NDArray) -> NDArray:
    """Increments without noise (n, 3) of the even clock, over the rows of the log."""
    clock_s = basis.motion.origin_s + np.append(0.0, basis.ideal.time_s)
    total = np.vstack([np.zeros(3), np.cumsum(increments, axis=0)])
    return _at(basis.time_s, clock_s, total) - _at(basis.time_s - basis.dt_s, clock_s, total)


def _at(time_s: NDArray, sample_s: NDArray, values: NDArray) -> NDArray:
    """Columns (n, c) at other times, straight in between; the last interval is carried on beyond
    the end.
    """
    inside = np.minimum(time_s, sample_s[-1])
    beyond = (time_s - inside)[:, None] * (
        (values[-1] - values[-2]) / (sample_s[-1] - sample_s[-2])
    )
    return np.stack([np.interp(inside, sample_s, column) for column in values.T], axis=-1) + beyond


def _smoothed(run: Run, motion: RunMotion) -> TemperatureLog | None:
    """The run's temperatures without noise, at their own times; what cannot be smoothed stays as
    read.
    """
    log = run.temperature
    if log is None:
        return None
    gyro = (
        _smooth_columns(log.time_s, log.gyro_degC)
        if motion.temperature is None
        else motion.temperature.at(log.time_s)
    )
    others = {
        name: getattr(log, name)
        for name in ("accel_degC", "gradient_degC", "block_degC", "ambient_degC")
    }
    smooth = {
        name: None if values is None else _smooth_columns(log.time_s, values)
        for name, values in others.items()
    }
    return TemperatureLog(time_s=log.time_s, gyro_degC=gyro, **smooth)


def _smooth_columns(time_s: NDArray, readings: NDArray) -> NDArray:
    """Readings (n,) or (n, c) without their noise; missing ones stay missing."""
    out = readings.reshape(time_s.size, -1).copy()
    for column in out.T:
        known = np.flatnonzero(np.isfinite(column))
        if known.size < 10:
            continue
        nodes, t = nodes_of(time_s[known]), time_s[known]
        found = smooth_readings(nodes, t, column[known], reading_step_degC(column[known]))
        column[known] = np.interp(t, nodes, found.value_degC)
    return out.reshape(readings.shape)


def _temperature(basis: TwinBasis, rng: np.random.Generator) -> TemperatureLog | None:
    if basis.temperature is None:
        return None
    noise = basis.twin.temperature
    read = {
        name: (
            values
            if name == "time_s" or values is None
            else imperfections.thermometer(rng, values, noise)
        )
        for name, values in vars(basis.temperature).items()
    }
    return TemperatureLog(**read)


def _gnss(basis: TwinBasis, moved: Disturbed, rng: np.random.Generator) -> GnssLog | None:
    """Fixes of the antenna at the run's own times; the sigmas of the file are kept, the errors are
    the twin's.
    """
    log, ideal = basis.run.gnss, basis.ideal
    if log is None:
        return None
    t = np.clip(log.time_s - basis.motion.origin_s, 0.0, basis.motion.truth.motion.end_s)
    point = basis.motion.truth.kinematics(t)
    lat, lon, height = geodetic_from_ecef(point.r_e)
    offset = np.column_stack(
        [
            moved.lat_rad - ideal.lat_rad,
            moved.lon_rad - ideal.lon_rad,
            moved.v_n_m_s - ideal.v_n_m_s,
        ]
    )
    offset = np.stack([np.interp(t, ideal.time_s, column) for column in offset.T], axis=-1)
    row = np.clip(np.searchsorted(ideal.time_s, t), 0, ideal.time_s.size - 1)
    lever = np.asarray(basis.run.header.gnss_lever_arm_m, dtype=float)
    C_nb, C_en = moved.C_nb[row], dcm_en(lat, lon)
    arm_n = C_nb @ lever
    swing = np.cross(rate_from_euler(point.euler_rad, point.euler_rate_rad_s), lever)
    place = ecef_from_geodetic(lat + offset[:, 0], lon + offset[:, 1], height) + np.einsum(
        "nij,nj->ni", C_en, arm_n
    )
    lat, lon, height = geodetic_from_ecef(place)
    v_n = (
        np.einsum("nji,nj->ni", C_en, point.v_e)
        + offset[:, 2:]
        + np.einsum("nij,nj->ni", C_nb, swing)
    )
    true = GnssLog(time_s=log.time_s, lat_rad=lat, lon_rad=lon, height_m=height, v_n_m_s=v_n)
    return replace(
        imperfections.gnss_output(rng, true, basis.twin.gnss),
        sigma_horizontal_m=log.sigma_horizontal_m,
        sigma_vertical_m=log.sigma_vertical_m,
        sigma_velocity_m_s=log.sigma_velocity_m_s,
    )


def _odometer(basis: TwinBasis, rng: np.random.Generator) -> OdometerLog | None:
    """Speed of the wheel reference point along body x at the run's own times; in the air the wheels
    stand.
    """
    log = basis.run.odometer
    if log is None:
        return None
    motion = basis.motion.truth.motion
    t = np.clip(log.time_s - basis.motion.origin_s, 0.0, motion.end_s)
    pitch = basis.motion.truth.kinematics(t).euler_rad[:, 1]
    speed = motion.speed_m_s(t) * np.cos(pitch) * (1.0 - motion.airborne(t))
    return imperfections.odometer_output(
        rng, OdometerLog(time_s=log.time_s, speed_m_s=speed), basis.twin.odometer
    )
