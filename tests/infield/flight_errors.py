"""Errors that only a flight shows, laid over a simulated run: a receiver's slow errors, a vertical
that is deflected along the track, accelerometers that change with scale, temperature and vibration,
gyros that read in flight what they do not read at rest.

A run without them is `simulate_run`'s own; scale and misalignment of the gyros are its twin's.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ins.earth import gravity_magnitude, radii_of_curvature
from ins.records import GnssLog, ImuLog
from ins.units import ARCSEC, DEG_PER_HOUR, MICRO_G, PPM, STANDARD_GRAVITY
from trajectories.simulator.sensors import IdealSensors
from trajectories.simulator.session import SimulatedRun

Triple = tuple[float, float, float]
ZERO: Triple = (0.0, 0.0, 0.0)
DRAWN_EVERY_S = 1.0  # slow errors are drawn at these steps, straight in between


@dataclass(frozen=True, kw_only=True)
class FlightErrors:
    """One flight's errors. Slow ones are first-order Gauss-Markov processes, one a component, over
    time or, of the vertical, over the way; the others are constants of sensors x, y, z.

    shift: what gyros and accelerometers read in the air beyond what they read on the ground; slope:
    of the accelerometers, from the temperature at the start; force: of the gyros, by the specific
    force along them beyond that of a level rest.
    """

    slow_position_m: float = 0.0
    slow_position_s: float = 300.0
    slow_velocity_m_s: float = 0.0
    slow_velocity_s: float = 60.0
    deflection_arcsec: float = 0.0
    deflection_m: float = 30_000.0
    accel_scale_ppm: Triple = ZERO
    accel_slope_ug_degC: Triple = ZERO
    accel_shift_ug: Triple = ZERO
    gyro_shift_deg_h: Triple = ZERO
    gyro_force_deg_h_g: Triple = ZERO


def with_flight_errors(
    simulated: SimulatedRun, ideal: IdealSensors, errors: FlightErrors, rng: np.random.Generator
) -> SimulatedRun:
    """The simulated run with these errors in its increments and its fixes.

    Its true biases stay those at rest: a table says nothing of what flying adds.
    """
    run = simulated.run
    gnss = None if run.gnss is None else _strayed(run.gnss, errors, rng)
    in_air = _in_air(ideal)
    imu = run.imu.between(-np.inf, np.inf)
    pushed = imu.dv_m_s * (1.0 + np.asarray(errors.accel_scale_ppm) * PPM)
    pushed = pushed + imu.dt_s[:, None] * _accelerometers(simulated, ideal, errors, in_air)
    pushed = pushed - imu.dt_s[:, None] * _deflected(ideal, errors, rng)
    beyond_rest = imu.dv_m_s / STANDARD_GRAVITY + imu.dt_s[:, None] * np.array([0.0, 0.0, 1.0])
    read = (in_air * imu.dt_s)[:, None] * np.asarray(errors.gyro_shift_deg_h)
    read = read + beyond_rest * np.asarray(errors.gyro_force_deg_h_g)
    turned = imu.dtheta_rad + read * DEG_PER_HOUR
    log = ImuLog(time_s=imu.time_s, dt_s=imu.dt_s, dtheta_rad=turned, dv_m_s=pushed)
    return replace(simulated, run=replace(run, imu=log, gnss=gnss))


def _in_air(ideal: IdealSensors) -> NDArray:
    """Which rows (n,) are flown, as 0 and 1."""
    return 1.0 - np.asarray(ideal.on_wheels, dtype=float)


def _accelerometers(
    simulated: SimulatedRun, ideal: IdealSensors, errors: FlightErrors, in_air: NDArray
) -> NDArray:
    """Bias of the accelerometers (n, 3) by temperature and by flying [m/s^2]."""
    degC = simulated.temperature_true_degC.mean(axis=1)
    warmer = np.interp(ideal.time_s, np.arange(degC.size, dtype=float), degC - degC[0])
    slope, shift = np.asarray(errors.accel_slope_ug_degC), np.asarray(errors.accel_shift_ug)
    return MICRO_G * (warmer[:, None] * slope + in_air[:, None] * shift)


def _deflected(ideal: IdealSensors, errors: FlightErrors, rng: np.random.Generator) -> NDArray:
    """What a deflected vertical adds to gravity (n, 3), body axes [m/s^2]."""
    if not errors.deflection_arcsec:
        return np.zeros((ideal.time_s.size, 3))
    nodes_s = np.arange(0.0, ideal.time_s[-1] + DRAWN_EVERY_S, DRAWN_EVERY_S)
    speed = np.interp(nodes_s, ideal.time_s, ideal.speed_m_s)
    kept = np.exp(-speed * DRAWN_EVERY_S / errors.deflection_m)
    angle = np.empty((nodes_s.size, 2))
    angle[0] = rng.standard_normal(2)
    news = rng.standard_normal(angle.shape)
    for k in range(1, nodes_s.size):
        angle[k] = kept[k] * angle[k - 1] + np.sqrt(1.0 - kept[k] ** 2) * news[k]
    angle *= errors.deflection_arcsec * ARCSEC
    gravity = gravity_magnitude(ideal.truth.site.lat_rad, ideal.height_m)
    pull = np.column_stack(
        [gravity * np.interp(ideal.time_s, nodes_s, column) for column in angle.T]
    )
    return np.einsum("nji,nj->ni", ideal.C_nb[:, :2, :], pull)


def _strayed(log: GnssLog, errors: FlightErrors, rng: np.random.Generator) -> GnssLog:
    """The fixes with their slow errors, level."""
    place = _slow(log.time_s, errors.slow_position_m, errors.slow_position_s, rng)
    velocity = _slow(log.time_s, errors.slow_velocity_m_s, errors.slow_velocity_s, rng)
    meridian, transverse = radii_of_curvature(log.lat_rad)
    v_n = log.v_n_m_s.copy()
    v_n[:, :2] += velocity
    return replace(
        log,
        sigma_horizontal_m=_whole(log.sigma_horizontal_m, errors.slow_position_m),
        sigma_velocity_m_s=_whole(log.sigma_velocity_m_s, errors.slow_velocity_m_s),
        lat_rad=log.lat_rad + place[:, 0] / (meridian + log.height_m),
        lon_rad=log.lon_rad + place[:, 1] / ((transverse + log.height_m) * np.cos(log.lat_rad)),
        v_n_m_s=v_n,
    )


def _whole(white: NDArray | None, slow: float) -> NDArray | None:
    """What a receiver declares: the sigma of its whole error."""
    return None if white is None else np.hypot(white, slow)


def _slow(time_s: NDArray, sigma: float, tau_s: float, rng: np.random.Generator) -> NDArray:
    """Two first-order Gauss-Markov processes (n, 2) at evenly spaced times."""
    kept = float(np.exp(-np.median(np.diff(time_s)) / tau_s))
    news = sigma * np.sqrt(1.0 - kept**2) * rng.standard_normal((time_s.size, 2))
    news[0] = sigma * rng.standard_normal(2)
    return np.asarray(lfilter([1.0], [1.0, -kept], news, axis=0))
