"""Gyro errors that go with the input (rate, force, field), and those that are noise."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_trials import processes
from benchmarks.gap_trials.effect import (
    GYROS,
    Drawing,
    Effects,
    Parameters,
    log_uniform,
    seed,
    signed,
)
from benchmarks.gap_trials.gyro_drifts import coil
from benchmarks.gap_trials.seen import Seen, Streams, axis_of, turned_back
from ins.units import ARCSEC, DEG, DEG_PER_SQRT_HOUR, PPM, STANDARD_GRAVITY

FIELD_N_GAUSS = (0.222, 0.42)  # horizontal and down, middle latitudes
DECLINATION_RAD = 3.0 * DEG


EFFECTS = Effects()


def _noise(key: str, size: float) -> Drawing:
    return lambda rng, _: {key: size, "seed": seed(rng)}


SLOW = ("slow_variation",)

TAXI = frozenset({"taxi"})


@EFFECTS.plants(
    "gyro_scale_factor",
    GYROS,
    lambda rng, _: {"scale_ppm": signed(rng, 5.0)},
    needs=TAXI,
    confounded=("gyro_magnetic_sensitivity", "gyro_misalignment", "clock_rate"),
)
def scale_factor(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    return streams.turning(target, size * p["scale_ppm"] * PPM * _rate(seen, target))


@EFFECTS.plants(
    "gyro_scale_asymmetry",
    ("gyro_z",),
    lambda rng, _: {"asymmetry_ppm": signed(rng, 5.0)},
    needs=TAXI,
)
def scale_asymmetry(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """K |w|, and a twentieth as much K w^3 at 0.3 rad/s."""
    w = _rate(seen, target)
    bent = np.abs(w) + 0.05 * w * (w / 0.3) ** 2
    return streams.turning(target, size * p["asymmetry_ppm"] * PPM * bent)


@EFFECTS.plants(
    "gyro_scale_thermal",
    ("gyro_z",),
    lambda rng, _: {"scale_ppm_degC": signed(rng, 2.0)},
    needs=TAXI,
)
def scale_thermal(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    off = coil(seen, target) - 20.0
    return streams.turning(target, size * p["scale_ppm_degC"] * PPM * off * _rate(seen, target))


@EFFECTS.plants(
    "gyro_misalignment",
    GYROS,
    lambda rng, _: {"arcsec_xyz": _crossed(rng, 14.0)},
    needs=TAXI,
    confounded=("gyro_magnetic_sensitivity",),
)
def misalignment(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """Sensitivity to the two other axes: the input axis leans by a vector, of which only the part
    across it counts.
    """
    lean = np.array(p["arcsec_xyz"]) * ARCSEC
    lean[axis_of(target)] = 0.0
    return streams.turning(target, size * (seen.dtheta_rad @ lean) / seen.dt_s)


@EFFECTS.plants(
    "gyro_g_sensitivity",
    GYROS,
    lambda rng, _: {"deg_h_g": signed(rng, 0.001), "direction": _crossed(rng, 1.0)},
    needs=TAXI,
    confounded=("gyro_turn_on_bias",),
)
def g_sensitivity(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """To the specific force along the gyro and, a quarter as much, across it."""
    along = seen.dv_m_s @ np.array(p["direction"]) / seen.dt_s / STANDARD_GRAVITY
    return streams.gyro(target, size * p["deg_h_g"] * along)


@EFFECTS.plants(
    "gyro_magnetic_sensitivity",
    GYROS,
    lambda rng, _: {"deg_h_gauss": 0.005, "direction": _leak(rng)},
    needs=frozenset({"runs"}),
    confounded=("gyro_misalignment", "gyro_scale_factor"),
)
def magnetic(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """To the Earth's field in body axes, along a mostly horizontal direction of the shield's
    leak.
    """
    horizontal, down = FIELD_N_GAUSS
    field_n = np.array(
        [horizontal * np.cos(DECLINATION_RAD), horizontal * np.sin(DECLINATION_RAD), down]
    )
    field_b = turned_back(seen.C_nb, np.broadcast_to(field_n, (seen.rows, 3)))
    return streams.gyro(target, size * p["deg_h_gauss"] * (field_b @ np.array(p["direction"])))


@EFFECTS.plants("gyro_angle_random_walk", GYROS, _noise("deg_sqrt_h", 0.002))
def angle_random_walk(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    density = size * p["deg_sqrt_h"] * DEG_PER_SQRT_HOUR
    more = processes.white(seen.rng(p["seed"]), seen.rows, density=density, dt_s=seen.dt_s)
    return streams.turning(target, more / seen.dt_s)


@EFFECTS.plants("gyro_bias_instability", GYROS, _noise("deg_h", 0.003), answers=SLOW)
def bias_instability(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    more = processes.flicker(seen.rng(p["seed"]), seen.rows, instability=p["deg_h"], dt_s=seen.dt_s)
    return streams.gyro(target, size * more)


@EFFECTS.plants("gyro_rate_random_walk", GYROS, _noise("deg_h_sqrt_h", 0.003), answers=SLOW)
def rate_random_walk(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    walk = processes.random_walk(
        seen.rng(p["seed"]), seen.rows, density=p["deg_h_sqrt_h"] / 60.0, dt_s=seen.dt_s
    )
    return streams.gyro(target, size * walk)


@EFFECTS.plants(
    "gyro_gauss_markov",
    GYROS,
    lambda rng, _: {"deg_h": 0.004, "tau_s": log_uniform(rng, 50, 1000), "seed": seed(rng)},
    answers=SLOW,
)
def gauss_markov(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    more = processes.gauss_markov(
        seen.rng(p["seed"]), seen.rows, rms=p["deg_h"], tau_s=p["tau_s"], dt_s=seen.dt_s
    )
    return streams.gyro(target, size * more)


@EFFECTS.plants(
    "gyro_quantization",
    GYROS,
    lambda rng, _: {"arcsec": float(rng.uniform(0.3, 1.0))},
    linear=False,
)
def quantization(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The accumulated angle counts whole pulses."""
    rows, axis = np.array(streams.dtheta_rad), axis_of(target)
    if size > 0:
        rows[:, axis] = processes.rounded_sum(rows[:, axis], size * p["arcsec"] * ARCSEC)
    return replace(streams, dtheta_rad=rows)


@EFFECTS.plants(
    "gyro_noise_thermal",
    GYROS,
    lambda rng, _: {"growth": 0.3, "with": str(rng.choice(["rate", "level"])), "seed": seed(rng)},
    linear=False,
)
def noise_thermal(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """White noise (1 + a g(t)) times the declared one; g: |dT/dt| in degC/min, or degC above 20, in
    tens.
    """
    if p["with"] == "rate":
        g = np.abs(np.gradient(coil(seen, target), seen.dt_s)) * 60.0
    else:
        g = np.maximum(coil(seen, target) - 20.0, 0.0) / 10.0
    more = np.sqrt((1 + size * p["growth"] * g) ** 2 - 1)
    density = seen.twin.gyro.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR
    drawn = processes.white(seen.rng(p["seed"]), seen.rows, density=density, dt_s=seen.dt_s)
    return streams.turning(target, more * drawn / seen.dt_s)


@EFFECTS.plants(
    "clock_rate",
    ("gyro_z",),
    lambda rng, _: {"ppm": signed(rng, 20.0)},
    needs=TAXI,
    accepted=(*GYROS, "accel_z", "vehicle"),
    confounded=("accel_scale_factor", "gyro_scale_factor"),
)
def clock_rate(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The unit's clock is slow: what it calls a tenth of a second is longer, for gyros and
    accelerometers alike.
    """
    c = size * p["ppm"] * PPM
    return replace(
        streams,
        dtheta_rad=streams.dtheta_rad + c * seen.dtheta_rad,
        dv_m_s=streams.dv_m_s + c * seen.dv_m_s,
    )


def _rate(seen: Seen, target: str) -> NDArray:
    return seen.dtheta_rad[:, axis_of(target)] / seen.dt_s


def _crossed(rng: np.random.Generator, size: float) -> list[float]:
    """Components about x, y, z of a vector of this length in a random direction."""
    v = rng.standard_normal(3)
    return (size * v / np.linalg.norm(v)).tolist()


def _leak(rng: np.random.Generator) -> list[float]:
    """A unit direction whose horizontal part, at a random azimuth, has 95 % of its length."""
    azimuth = rng.uniform(0, 2 * np.pi)
    return [0.95 * float(np.cos(azimuth)), 0.95 * float(np.sin(azimuth)), 0.31]
