"""Effects put into a simulated run: what they add to the IMU, the odometer, GNSS and the
thermometers, noise included.

Rates become increments that add up exactly over each interval of the telemetry. A side velocity
l(t) along body y is a real motion: the accelerometers feel l' e_y + (w_ib + w_ie) x l e_y, the
gyros the turn of the local level, GNSS the way; sway is laid over alike. First order: left out are
products of two effects, and a rotation's swing of the antenna (300 arcsec of roll at 5 m: 7 mm).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ins.earth import omega_en_n, omega_ie_n, radii_of_curvature
from ins.errors.telemetry import Telemetry, Trace
from ins.records import GnssLog, ImuLog, OdometerLog, Run, TemperatureLog, VehicleNoise
from simreal.declared.twin_effects import TwinEffect, twin_traces
from simreal.twin.added_noise import NoiseDraws, at, draw, swayed
from trajectories.runs.directory import run_sha256

BEYOND_S = 60.0  # the first and the last value hold this far outside the telemetry


@dataclass(frozen=True)
class SideMotion:
    """The side velocity laid over the motion, sway apart: v_n_m_s, way_n_m (n, 3) at the
    telemetry's instants, NED.
    """

    v_n_m_s: NDArray
    way_n_m: NDArray


@dataclass(frozen=True)
class Injected:
    """The run with its effects, and what was added."""

    run: Run
    trace: Trace
    draws: NoiseDraws
    side: SideMotion


def injected(
    run: Run,
    telemetry: Telemetry,
    effects: Sequence[TwinEffect],
    rng: np.random.Generator,
    *,
    vehicle: VehicleNoise | None = None,
) -> Injected:
    """The run with its effects, and what was added; effects of other runs are passed over.

    Parameters
    ----------
    run, telemetry : the run, and its telemetry.
    effects : to add, none with a negative noise coefficient (see `without_excess`).
    rng : of the noise that effects add.
    vehicle : the twin's, for the frequency of sway.
    """
    own = [item for item in effects if item.in_run(run.header.run_id)]
    imu = run.imu.whole()
    trace = twin_traces(own, telemetry, run.header.run_id)
    draws = draw(own, telemetry, imu.time_s, imu.dt_s, vehicle or VehicleNoise(), rng)
    side = _side_motion(telemetry, trace)
    changed = replace(
        run,
        imu=_imu(imu, telemetry, trace, draws, side),
        temperature=_temperature(run.temperature, telemetry, trace, draws, rng),
        odometer=_odometer(run.odometer, telemetry, trace, draws, rng),
        gnss=_gnss(run.gnss, telemetry, trace, draws, side, rng),
    )
    return Injected(replace(changed, sha256=run_sha256(changed)), trace, draws, side)


def increments(telemetry: Telemetry, rate: NDArray, time_s: NDArray, dt_s: NDArray) -> NDArray:
    """Increments (m, c) over rows of a rate (n, c) that is constant in each interval of the
    telemetry.
    """
    edge = np.append(
        telemetry.time_s - 0.5 * telemetry.dt_s, telemetry.time_s[-1] + 0.5 * telemetry.dt_s
    )
    edge = np.concatenate([[edge[0] - BEYOND_S], edge, [edge[-1] + BEYOND_S]])
    held = np.concatenate([rate[:1], rate, rate[-1:]])
    total = np.concatenate(
        [np.zeros_like(held[:1]), np.cumsum(held * np.diff(edge)[:, None], axis=0)]
    )
    return at(time_s, edge, total) - at(time_s - dt_s, edge, total)


def _side_motion(telemetry: Telemetry, trace: Trace) -> SideMotion:
    v_n = np.zeros((telemetry.n, 3))
    if trace.lateral_m_s is not None:
        v_n += trace.lateral_m_s[:, None] * telemetry.C_nb[:, :, 1]
    step = np.diff(telemetry.time_s, prepend=telemetry.time_s[0])[:, None]
    before = np.concatenate([v_n[:1], v_n[:-1]])
    return SideMotion(v_n, np.cumsum(0.5 * (v_n + before) * step, axis=0))


def _imu(
    imu: ImuLog, telemetry: Telemetry, trace: Trace, draws: NoiseDraws, side: SideMotion
) -> ImuLog:
    t, dt = imu.time_s, imu.dt_s
    dtheta, dv = imu.dtheta_rad + draws.dtheta_rad, imu.dv_m_s + draws.dv_m_s
    if trace.gyro_rad_s is not None:
        dtheta += increments(telemetry, trace.gyro_rad_s, t, dt)
    if trace.accel_m_s2 is not None:
        dv += increments(telemetry, trace.accel_m_s2, t, dt)
    if side.v_n_m_s.any() or draws.sway_m_s.any():
        velocity = side.v_n_m_s + swayed(draws, telemetry.time_s)[1]
        level_n = omega_en_n(telemetry.lat_rad, telemetry.height_m, velocity)
        dtheta += increments(telemetry, in_body(telemetry.C_nb, level_n), t, dt)
        C_nb = _between(t - 0.5 * dt, telemetry)
        dv += _felt(imu, telemetry, trace, C_nb) + _felt_sway(draws, telemetry, C_nb)
    return replace(imu, dtheta_rad=_rounded(dtheta, draws.quantum_rad), dv_m_s=dv)


def _felt(imu: ImuLog, telemetry: Telemetry, trace: Trace, C_nb: NDArray) -> NDArray:
    """Velocity increments (m, 3) of a side velocity along body y; it is 0 before the first row."""
    if trace.lateral_m_s is None:
        return np.zeros((imu.rows, 3))
    end = np.interp(imu.time_s, telemetry.time_s, trace.lateral_m_s)
    start = np.append(0.0, end[:-1])
    earth = in_body(C_nb, np.broadcast_to(omega_ie_n(telemetry.lat_rad), (imu.rows, 3)))
    turn = imu.dtheta_rad + earth * imu.dt_s[:, None]
    way = 0.5 * (start + end)
    return np.stack([-turn[:, 2] * way, end - start, turn[:, 0] * way], axis=1)


def _felt_sway(draws: NoiseDraws, telemetry: Telemetry, C_nb: NDArray) -> NDArray:
    """Velocity increments (m, 3) of level sway."""
    velocity = np.column_stack([draws.sway_m_s, np.zeros(draws.time_s.size)])
    before = np.concatenate([np.zeros((1, 3)), velocity[:-1]])
    coriolis = np.cross(2 * omega_ie_n(telemetry.lat_rad), 0.5 * (velocity + before))
    return in_body(C_nb, velocity - before + coriolis * draws.dt_s[:, None])


def _between(time_s: NDArray, telemetry: Telemetry) -> NDArray:
    """Attitude (m, 3, 3) at other times, straight between the telemetry's (its columns a little
    short in a turn).
    """
    return at(time_s, telemetry.time_s, telemetry.C_nb.reshape(-1, 9)).reshape(-1, 3, 3)


def in_body(C_nb: NDArray, vector_n: NDArray) -> NDArray:
    """Vectors (n, 3) of the navigation frame in body axes."""
    return np.asarray(np.einsum("nij,ni->nj", C_nb, vector_n))


def _rounded(dtheta: NDArray, quantum_rad: NDArray) -> NDArray:
    """Increments whose sum is rounded to whole quanta, on the axes that have one."""
    for axis in np.flatnonzero(quantum_rad):
        total = quantum_rad[axis] * np.round(np.cumsum(dtheta[:, axis]) / quantum_rad[axis])
        dtheta[:, axis] = np.diff(total, prepend=0.0)
    return dtheta


def _temperature(
    log: TemperatureLog | None,
    telemetry: Telemetry,
    trace: Trace,
    draws: NoiseDraws,
    rng: np.random.Generator,
) -> TemperatureLog | None:
    if log is None or (trace.temperature_degC is None and not draws.temperature_variance):
        return log
    gyro = log.gyro_degC + np.sqrt(draws.temperature_variance) * rng.standard_normal(
        log.gyro_degC.shape
    )
    if trace.temperature_degC is not None:
        gyro += at(log.time_s, telemetry.time_s, trace.temperature_degC)
    return replace(log, gyro_degC=gyro)


def _odometer(
    log: OdometerLog | None,
    telemetry: Telemetry,
    trace: Trace,
    draws: NoiseDraws,
    rng: np.random.Generator,
) -> OdometerLog | None:
    if log is None:
        return None
    speed = log.speed_m_s + np.sqrt(draws.speed_variance) * rng.standard_normal(log.time_s.size)
    if trace.odometer_m_s is not None:
        speed += np.interp(log.time_s, telemetry.time_s, trace.odometer_m_s)
    if draws.speed_quantum_m_s:
        speed = draws.speed_quantum_m_s * np.round(speed / draws.speed_quantum_m_s)
    return replace(log, speed_m_s=speed)


def _gnss(
    log: GnssLog | None,
    telemetry: Telemetry,
    trace: Trace,
    draws: NoiseDraws,
    side: SideMotion,
    rng: np.random.Generator,
) -> GnssLog | None:
    if log is None:
        return None
    way, velocity = swayed(draws, log.time_s)
    way += at(log.time_s, telemetry.time_s, side.way_n_m)
    velocity += at(log.time_s, telemetry.time_s, side.v_n_m_s)
    if trace.gnss_position_m is not None:
        way += at(log.time_s, telemetry.time_s, trace.gnss_position_m)
    if trace.gnss_velocity_m_s is not None:
        velocity += at(log.time_s, telemetry.time_s, trace.gnss_velocity_m_s)
    way[:, :2] += np.sqrt(draws.position_variance) * rng.standard_normal((log.time_s.size, 2))
    lat, lon, height = moved_by(log.lat_rad, log.lon_rad, log.height_m, way)
    return replace(log, lat_rad=lat, lon_rad=lon, height_m=height, v_n_m_s=log.v_n_m_s + velocity)


def moved_by(
    lat_rad: NDArray, lon_rad: NDArray, height_m: NDArray, way_n_m: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """A place moved by a short way (n, 3), NED."""
    meridian, transverse = radii_of_curvature(lat_rad)
    east_rad = way_n_m[:, 1] / ((transverse + height_m) * np.cos(lat_rad))
    return (
        lat_rad + way_n_m[:, 0] / (meridian + height_m),
        lon_rad + east_rad,
        height_m - way_n_m[:, 2],
    )
