"""Draws of the noise that effects add (`AddedNoise`), at the rows of a log.

White noise, flicker, walks and Gauss-Markov as `trajectories` makes them for the twin itself. Three
kinds are made as what they are, not by their variance: quantisation rounds (the accumulated angle,
the odometer's speed), sway is one velocity of the vehicle that accelerometers and GNSS share, and
gusts rock it about angles that gyros and accelerometers share.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.errors.base import AXIS, GYROS, AddedNoise
from ins.errors.platform import ROTATIONAL_SWAY_s
from ins.errors.telemetry import AIRBORNE, Telemetry
from ins.errors.wheels import CENTIMETRE_PER_S
from ins.records import VehicleNoise
from ins.units import ARCSEC
from simreal.declared.twin_effects import TwinEffect
from trajectories.simulator import imperfections
from trajectories.simulator.vehicle import gauss_markov, sway_velocity

# id: unit of the quantum
ROUNDED = {"gyro_quantization": ARCSEC, "odometer_quantization": CENTIMETRE_PER_S}
ROCKING = "platform_sway_rotation"


@dataclass
class NoiseDraws:
    """What is added to a log of m rows that end at `time_s` after `dt_s`.

    dtheta_rad, dv_m_s (m, 3). slow_gyro_rad_s, slow_accel_m_s2 (k, 3): slow errors at slow_s (k,),
    in the increments too. quantum_rad (3,) to round the accumulated angle to; speed_quantum_m_s of
    the odometer; 0: none. speed_sigma_m_s, temperature_sigma_degC, position_sigma_m: white noise of
    a sample. sway_m_s (m, 2): north and east, at the rows' ends.
    """

    time_s: NDArray
    dt_s: NDArray
    dtheta_rad: NDArray
    dv_m_s: NDArray
    slow_s: NDArray
    slow_gyro_rad_s: NDArray
    slow_accel_m_s2: NDArray
    quantum_rad: NDArray
    sway_m_s: NDArray
    tilt_rad: NDArray
    speed_quantum_m_s: float = 0.0
    speed_variance: float = 0.0
    temperature_variance: float = 0.0
    position_variance: float = 0.0


def draw(
    effects: Sequence[TwinEffect],
    run: Telemetry,
    time_s: NDArray,
    dt_s: NDArray,
    vehicle: VehicleNoise,
    rng: np.random.Generator,
) -> NoiseDraws:
    """Noise of all effects (coefficients not negative) over the rows of a log."""
    m, start_s = time_s.size, float(time_s[0] - dt_s[0])
    slow_s = (
        start_s
        + np.arange(np.ceil((time_s[-1] - start_s) * imperfections.SLOW_RATE_HZ - 1e-6) + 1)
        / imperfections.SLOW_RATE_HZ
    )
    out = NoiseDraws(
        time_s=time_s,
        dt_s=dt_s,
        dtheta_rad=np.zeros((m, 3)),
        dv_m_s=np.zeros((m, 3)),
        slow_s=slow_s,
        slow_gyro_rad_s=np.zeros((slow_s.size, 3)),
        slow_accel_m_s2=np.zeros((slow_s.size, 3)),
        quantum_rad=np.zeros(3),
        sway_m_s=np.zeros((m, 2)),
        tilt_rad=np.zeros((m, 2)),
    )
    for item in effects:
        if not item.is_noise or not item.square:
            continue
        if item.effect.id in ROUNDED:
            _round(out, item)
        elif item.effect.id == ROCKING:
            _rock(out, item, run, rng)
        else:
            added = item.effect.noise(run, item.target, item.shape)
            for noise in added:
                _add(out, noise, item.square, run, rng)
            sway = max((noise.sway for noise in added), default=0.0) * item.square
            if sway:
                _sway(out, float(np.sqrt(sway)), run, vehicle, rng)
    middle_s = time_s - 0.5 * dt_s
    out.dtheta_rad += at(middle_s, slow_s, out.slow_gyro_rad_s) * dt_s[:, None]
    out.dv_m_s += at(middle_s, slow_s, out.slow_accel_m_s2) * dt_s[:, None]
    return out


def swayed(draws: NoiseDraws, time_s: NDArray) -> tuple[NDArray, NDArray]:
    """Way [m] and velocity [m/s] of the sway at any times (n, 3), NED."""
    before = np.concatenate([draws.sway_m_s[:1], draws.sway_m_s[:-1]])
    way = np.cumsum(0.5 * (draws.sway_m_s + before) * draws.dt_s[:, None], axis=0)
    flat = np.zeros((time_s.size, 1))
    way, velocity = (
        np.hstack([at(time_s, draws.time_s, level), flat]) for level in (way, draws.sway_m_s)
    )
    return way, velocity


def at(time_s: NDArray, sample_s: NDArray, values: NDArray) -> NDArray:
    """Columns (n, c) at other times, straight in between."""
    return np.stack([np.interp(time_s, sample_s, column) for column in values.T], axis=-1)


def _round(out: NoiseDraws, item: TwinEffect) -> None:
    quantum = ROUNDED[item.effect.id] * item.coefficients[0]
    if item.target in GYROS:
        out.quantum_rad[AXIS[item.target]] = np.hypot(out.quantum_rad[AXIS[item.target]], quantum)
    else:
        out.speed_quantum_m_s = float(np.hypot(out.speed_quantum_m_s, quantum))


def _rock(out: NoiseDraws, item: TwinEffect, run: Telemetry, rng: np.random.Generator) -> None:
    """Roll and pitch of this RMS while on wheels; their spectrum at low frequency is that of the
    effect.

    A real rotation q: gyros feel q' - q x w, accelerometers -q x f.
    """
    tau_s = 0.5 * ROTATIONAL_SWAY_s  # two-sided PSD 2 tau at frequency 0
    rate_hz, rms = float(1.0 / np.median(out.dt_s)), ARCSEC * item.coefficients[0]
    q = np.zeros((out.time_s.size, 3))
    for axis in range(2):
        q[:, axis] = _grounded(out, run) * gauss_markov(
            rng, out.time_s.size, rms=rms, tau_s=tau_s, rate_hz=rate_hz
        )
    before = np.concatenate([q[:1], q[:-1]])
    middle_s, mean = out.time_s - 0.5 * out.dt_s, 0.5 * (q + before) * out.dt_s[:, None]
    out.tilt_rad += q[:, :2]
    out.dtheta_rad += q - before - np.cross(mean, at(middle_s, run.time_s, run.rate_rad_s))
    out.dv_m_s -= np.cross(mean, at(middle_s, run.time_s, run.force_m_s2))


def _grounded(out: NoiseDraws, run: Telemetry) -> NDArray:
    nearest = np.clip(np.searchsorted(run.time_s, out.time_s), 0, run.n - 1)
    return (run.kind[nearest] != AIRBORNE).astype(float)


def _sway(
    out: NoiseDraws, rms_m_s: float, run: Telemetry, vehicle: VehicleNoise, rng: np.random.Generator
) -> None:
    rate_hz = float(1.0 / np.median(out.dt_s))
    for axis in range(2):
        out.sway_m_s[:, axis] += _grounded(out, run) * sway_velocity(
            rng,
            out.time_s.size,
            rms_m_s=rms_m_s,
            frequency_hz=vehicle.sway_hz,
            damping=vehicle.sway_damping,
            rate_hz=rate_hz,
        )


def _add(
    out: NoiseDraws, noise: AddedNoise, square: float, run: Telemetry, rng: np.random.Generator
) -> None:
    """White, bounded and slow noise of one sensor, or of the samples of another channel."""
    if noise.channel not in AXIS:
        _add_to_samples(out, noise, square)
        return
    gyro, axis = noise.channel in GYROS, AXIS[noise.channel]
    rows = (out.dtheta_rad if gyro else out.dv_m_s)[:, axis]
    slow = (out.slow_gyro_rad_s if gyro else out.slow_accel_m_s2)[:, axis]
    profile = (
        np.ones(1)
        if noise.profile is None
        else np.interp(out.time_s - 0.5 * out.dt_s, run.time_s, noise.profile)
    )
    if noise.white:
        rows += np.sqrt(noise.white * square * profile * out.dt_s) * rng.standard_normal(rows.size)
    if noise.bounded:
        bounded = np.sqrt(noise.bounded * square * profile) * rng.standard_normal(rows.size)
        rows += np.diff(bounded, prepend=0.0)
    n, size = slow.size, float(np.sqrt(square))
    if noise.flicker:
        slow += imperfections.flicker(
            rng,
            n,
            instability=size * float(np.sqrt(noise.flicker)),
            rate_hz=imperfections.SLOW_RATE_HZ,
        )
    if noise.walk:
        slow += imperfections.random_walk(
            rng, n, density=size * float(np.sqrt(noise.walk)), rate_hz=imperfections.SLOW_RATE_HZ
        )
    if noise.markov:
        slow += gauss_markov(
            rng,
            n,
            rms=size * float(np.sqrt(noise.markov)),
            tau_s=noise.markov_tau_s,
            rate_hz=imperfections.SLOW_RATE_HZ,
        )


def _add_to_samples(out: NoiseDraws, noise: AddedNoise, square: float) -> None:
    if noise.channel == "odometer":
        out.speed_variance += noise.sample * square
    elif noise.channel == "temperature":
        out.temperature_variance += noise.sample * square
    else:
        out.position_variance += noise.sample * square
