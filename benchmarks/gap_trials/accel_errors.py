"""Accelerometer errors, and where the accelerometers sit."""

from dataclasses import replace

import numpy as np

from benchmarks.gap_trials import processes
from benchmarks.gap_trials.effect import ACCELS, Effects, Parameters, log_uniform, seed, signed
from benchmarks.gap_trials.gyro_drifts import two_decays
from benchmarks.gap_trials.seen import Seen, Streams, arm_force, axis_of
from ins.units import MICRO_G, PPM

EFFECTS = Effects()


def _arm(rng: np.random.Generator, _: tuple[Seen, ...]) -> Parameters:
    angle = rng.uniform(0, 2 * np.pi)
    length = rng.uniform(0.02, 0.06)
    return {"arm_m": [float(length * np.cos(angle)), float(length * np.sin(angle)), 0.01]}


@EFFECTS.plants("accel_thermal", ACCELS, lambda rng, _: {"ug_degC": signed(rng, 2.0)})
def thermal(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """k (T - 20) with a square part of 10 % at 40 degC off."""
    off = seen.accel_degC[:, axis_of(target)] - 20.0
    return streams.accel(target, size * p["ug_degC"] * off * (1 + 0.1 * off / 40.0))


@EFFECTS.plants(
    "accel_warmup_transient",
    ACCELS,
    lambda rng, _: {"amplitude_ug": signed(rng, 40.0), "tau_s": log_uniform(rng, 300, 1200)},
)
def warmup(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    return streams.accel(target, size * p["amplitude_ug"] * two_decays(seen.time_s, p["tau_s"]))


@EFFECTS.plants(
    "accel_thermal_hysteresis",
    ACCELS,
    lambda rng, _: {"half_split_ug": signed(rng, 20.0), "width_degC": log_uniform(rng, 1.0, 5.0)},
    needs=frozenset({"runs"}),
)
def hysteresis(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    loop = (
        processes.play(seen.accel_degC[:, axis_of(target)], width=p["width_degC"]) / p["width_degC"]
    )
    return streams.accel(target, size * p["half_split_ug"] * loop)


@EFFECTS.plants(
    "accel_scale_factor",
    ("accel_z",),
    lambda rng, _: {"scale_ppm": signed(rng, 100.0)},
    confounded=("vertical_deflection", "clock_rate"),
)
def scale_factor(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """K f, K growing by 2 % over 40 degC."""
    warmer = 1 + 0.02 * (seen.accel_degC[:, axis_of(target)] - 20.0) / 40.0
    force = seen.dv_m_s[:, axis_of(target)] / seen.dt_s
    return streams.pushed(target, size * p["scale_ppm"] * PPM * warmer * force)


@EFFECTS.plants("accel_noise", ACCELS, lambda rng, _: {"ug_sqrt_hz": 15.0, "seed": seed(rng)})
def noise(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    more = processes.white(
        seen.rng(p["seed"]), seen.rows, density=p["ug_sqrt_hz"] * MICRO_G, dt_s=seen.dt_s
    )
    return streams.pushed(target, size * more / seen.dt_s)


@EFFECTS.plants(
    "imu_size_effect",
    ("accel_x", "accel_y"),
    _arm,
    needs=frozenset({"taxi"}),
    accepted=("vehicle",),
)
def size_effect(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """One accelerometer sits beside the point that the unit's output refers to."""
    felt = np.array(streams.dv_m_s)
    felt[:, axis_of(target)] += size * arm_force(seen, np.array(p["arm_m"]))[:, axis_of(target)]
    return replace(streams, dv_m_s=felt)
