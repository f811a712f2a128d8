"""Noise of gyros beyond what the twin declares (effects.md G21 to G26, G29), in the twin's units;
variances add.

Slow processes are `slow_variation` in reports (formats.md, section 5); their ids, and the rivals of
others, say which.
"""

from collections.abc import Sequence

import numpy as np

from ins.units import ARCSEC, DEG_PER_HOUR, DEG_PER_HOUR_SQRT_HOUR, DEG_PER_SQRT_HOUR
from simreal.effects.base import SLOW_NAME, AddedNoise, Effect, Shape, ShapeParameter
from simreal.effects.gyro_thermal import above_reference
from simreal.effects.parts.gyro_effect import gyro_effect, one
from simreal.effects.parts.gyro_needs import gyro_degC_min, lacks_temperature_rate
from simreal.effects.telemetry import Telemetry

WARMTH_degC = 20.0  # over which noise that grows with temperature grows e-fold in variance
NOISE_OF_TIME = "gyro_noise_of_time"


def quantization(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """A pulse of 1 arcsec: the accumulated angle is off by a uniform error of variance 1/12
    arcsec^2.
    """
    return (AddedNoise(target, bounded=ARCSEC**2 / 12.0),)


def angle_random_walk(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """1 deg/sqrt(h)."""
    return (AddedNoise(target, white=DEG_PER_SQRT_HOUR**2),)


def bias_instability(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """B = 1 deg/h: two-sided PSD B^2 / (2 pi f)."""
    return (AddedNoise(target, flicker=DEG_PER_HOUR**2),)


def rate_random_walk(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """K = 1 deg/h/sqrt(h)."""
    return (AddedNoise(target, walk=DEG_PER_HOUR_SQRT_HOUR**2),)


def gauss_markov(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """1 deg/h RMS with the correlation time `tau_s`."""
    return (AddedNoise(target, markov=DEG_PER_HOUR**2, markov_tau_s=shape["tau_s"]),)


def thermal_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """1 deg/sqrt(h) at 25 degC (rate_share 0, variance exp((T - 25) / 20)) or at 1 degC/min
    (rate_share 1, its square).
    """
    share = shape["rate_share"]
    warm, ramp = np.exp(above_reference(run, target) / WARMTH_degC), gyro_degC_min(run, target) ** 2
    return (
        AddedNoise(target, white=DEG_PER_SQRT_HOUR**2, profile=(1.0 - share) * warm + share * ramp),
    )


def noise_of_time(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """1 deg/sqrt(h) in the mean over the parked stretch, of variance exp(slope u + bend (3 u^2 -
    1) / 2): u goes from -1 to 1 over that stretch.

    A ramp of noise and its bend, up to 400 times from end to end: what a temperature does that goes
    one way, or there and back.
    """
    inside = run.time_s[run.parked] if run.parked.any() else run.time_s
    half = max(0.5 * float(inside[-1] - inside[0]), run.dt_s)
    u = np.clip((run.time_s - inside[0]) / half - 1.0, -1.0, 1.0)
    grows = np.exp(shape["slope"] * u + shape["bend"] * 0.5 * (3.0 * u**2 - 1.0))
    mean = float(grows[run.parked].mean()) if run.parked.any() else float(grows.mean())
    return (AddedNoise(target, white=DEG_PER_SQRT_HOUR**2, profile=grows / mean),)


def lacks_ten_minutes(runs: Sequence[Telemetry], target: str) -> str:
    """For noise that varies over minutes."""
    return _lacks_minutes(runs, 10.0)


def lacks_half_an_hour(runs: Sequence[Telemetry], target: str) -> str:
    """For noise that grows without end."""
    return _lacks_minutes(runs, 30.0)


def _lacks_minutes(runs: Sequence[Telemetry], minutes: float) -> str:
    longest = max((run.n * run.dt_s for run in runs), default=0.0)
    return "" if longest >= 60.0 * minutes else f"a run of {minutes:g} minutes"


def lacks_seconds(runs: Sequence[Telemetry], target: str) -> str:
    """Quantisation is told from white noise by neighbouring samples."""
    return "" if any(run.dt_s <= 1.0 for run in runs) else "samples at 1 Hz"


GYRO_NOISE: tuple[Effect, ...] = (
    gyro_effect(
        "gyro_quantization",
        repeats="S",
        coefficients=one("arcsec", 0.3, 1.0, signed=False),
        noise_formula=quantization,
        need=lacks_seconds,
        rivals=(
            "gyro_angle_random_walk",
            "timestamp_jitter",
            "saturation_or_rounding",
            "platform_sway",
        ),
        source="IEEE Std 952-1997, annex C, and formats.md section 3",
    ),
    gyro_effect(
        "gyro_angle_random_walk",
        repeats="S",
        coefficients=one("deg/sqrt(h)", 1e-3, 5e-3, signed=False),
        noise_formula=angle_random_walk,
        rivals=(
            "gyro_quantization",
            "gyro_noise_thermal",
            NOISE_OF_TIME,
            "platform_sway",
            "timestamp_jitter",
            "saturation_or_rounding",
        ),
        source="IEEE Std 952-1997, annex C",
    ),
    gyro_effect(
        SLOW_NAME,
        id="gyro_bias_instability",
        repeats="S",
        coefficients=one("deg/h", 1e-3, 5e-3, signed=False),
        noise_formula=bias_instability,
        need=lacks_half_an_hour,
        rivals=("gyro_gauss_markov", "gyro_rate_random_walk"),
        source="IEEE Std 952-1997, annex C",
    ),
    gyro_effect(
        SLOW_NAME,
        id="gyro_rate_random_walk",
        repeats="S",
        coefficients=one("deg/h/sqrt(h)", 5e-4, 5e-3, signed=False),
        noise_formula=rate_random_walk,
        need=lacks_half_an_hour,
        rivals=("gyro_rate_ramp", "gyro_bias_instability", "gyro_gauss_markov", "gyro_mode_hop"),
        source="IEEE Std 952-1997, annex C",
    ),
    gyro_effect(
        SLOW_NAME,
        id="gyro_gauss_markov",
        repeats="S",
        coefficients=one("deg/h", 1e-3, 0.01, signed=False),
        shape=(ShapeParameter("tau_s", "s", 50.0, 1000.0, 3),),
        noise_formula=gauss_markov,
        need=lacks_ten_minutes,
        rivals=("gyro_bias_instability", "gyro_rate_random_walk", "gyro_mode_hop"),
        source="IEEE Std 952-1997, annex C",
    ),
    gyro_effect(
        "gyro_noise_thermal",
        repeats="S",
        coefficients=one("deg/sqrt(h)", 5e-4, 3e-3, signed=False),
        shape=(ShapeParameter("rate_share", "", 0.0, 1.0, 3, "linear"),),
        noise_formula=thermal_noise,
        need=lacks_temperature_rate,
        rivals=("gyro_angle_random_walk", NOISE_OF_TIME),
        source="effects.md G26",
    ),
    gyro_effect(
        NOISE_OF_TIME,
        repeats="S",
        coefficients=one("deg/sqrt(h)", 5e-4, 3e-3, signed=False),
        shape=(
            ShapeParameter("slope", "", -3.0, 3.0, 4, "linear"),
            ShapeParameter("bend", "", -2.0, 2.0, 3, "linear"),
        ),
        noise_formula=noise_of_time,
        rivals=("gyro_noise_thermal", "gyro_angle_random_walk"),
        source="effects.md G29",
    ),
)
