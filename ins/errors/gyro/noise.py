"""Noise of gyros beyond what the twin declares (effects.md G21 to G26, G29), in the twin's units;
variances add.

Slow processes are `slow_variation` in reports (formats.md, section 5); their ids, and the rivals of
others, say which.
"""

from collections.abc import Sequence

import numpy as np

from ins.errors.base import GYROS, SLOW_NAME, AddedNoise, Shape, ShapeParameter, Words, error, one
from ins.errors.gyro.thermal import above_reference
from ins.errors.parts.gyro_needs import gyro_degC_min, lacks_temperature_rate
from ins.errors.telemetry import Telemetry
from ins.units import ARCSEC, DEG_PER_HOUR, DEG_PER_HOUR_SQRT_HOUR, DEG_PER_SQRT_HOUR

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


SLOW_WORDS = Words(
    what="A slow drift tied to nothing logged: flicker, random walk or a process with a "
    "correlation time. It is a description, not a cause.",
    brought_on_by="Unknown; temperature that was not logged is the first suspect.",
    size="Flicker of a navigation-grade gyro is a few 0.001 deg/h.",
    remedy="Correct the twin's noise, or log more: temperatures, voltages, events.",
)
GYRO_NOISE = (
    error(
        "G21",
        "gyro_quantization",
        GYROS,
        one("arcsec", 0.3, 1.0, signed=False),
        repeats="S",
        noise_formula=quantization,
        twin=("gyro", "quantization_rad", ARCSEC),
        need=lacks_seconds,
        rivals=(
            "gyro_angle_random_walk",
            "timestamp_jitter",
            "saturation_or_rounding",
            "platform_sway",
        ),
        source="IEEE Std 952-1997, annex C, and formats.md section 3",
        words=Words(
            what="The angle is read in steps, as pulses of a ring laser are counted.",
            brought_on_by="Nothing; it shows at sampling rates of 1 Hz and more.",
            size="It does not grow: the accumulated angle stays within one step.",
            remedy="Give the twin the unit's step, `quantization_rad`.",
        ),
    ),
    error(
        "G22",
        "gyro_angle_random_walk",
        GYROS,
        one("deg/sqrt(h)", 1e-3, 5e-3, signed=False),
        repeats="S",
        noise_formula=angle_random_walk,
        twin=("gyro", "arw_deg_sqrt_h", 1.0),
        rivals=(
            "gyro_noise_thermal",
            NOISE_OF_TIME,
            "platform_sway",
            "timestamp_jitter",
            "saturation_or_rounding",
        ),
        source="IEEE Std 952-1997, annex C",
        words=Words(
            what="White noise of the rate, more or less than the twin declares.",
            brought_on_by="Nothing; it is there at all times.",
            size="It limits alignment: sigma of heading falls with the root of time.",
            remedy="Correct `arw_deg_sqrt_h` in the twin.",
        ),
    ),
    error(
        "G23",
        SLOW_NAME,
        GYROS,
        one("deg/h", 1e-3, 5e-3, signed=False),
        id="gyro_bias_instability",
        repeats="S",
        noise_formula=bias_instability,
        twin=("gyro", "bias_instability_deg_h", 1.0),
        need=lacks_half_an_hour,
        rivals=("gyro_gauss_markov", "gyro_rate_random_walk"),
        source="IEEE Std 952-1997, annex C",
        words=SLOW_WORDS,
    ),
    error(
        "G24",
        SLOW_NAME,
        GYROS,
        one("deg/h/sqrt(h)", 5e-4, 5e-3, signed=False),
        id="gyro_rate_random_walk",
        repeats="S",
        noise_formula=rate_random_walk,
        twin=("gyro", "rate_random_walk_deg_h_sqrt_h", 1.0),
        need=lacks_half_an_hour,
        rivals=("gyro_gauss_markov",),
        source="IEEE Std 952-1997, annex C",
        words=SLOW_WORDS,
    ),
    error(
        "G25",
        SLOW_NAME,
        GYROS,
        one("deg/h", 1e-3, 0.01, signed=False),
        id="gyro_gauss_markov",
        shape=(ShapeParameter("tau_s", "s", 50.0, 1000.0, 3),),
        repeats="S",
        noise_formula=gauss_markov,
        need=lacks_ten_minutes,
        source="IEEE Std 952-1997, annex C",
        words=SLOW_WORDS,
    ),
    error(
        "G26",
        "gyro_noise_thermal",
        GYROS,
        one("deg/sqrt(h)", 5e-4, 3e-3, signed=False),
        shape=(ShapeParameter("rate_share", "", 0.0, 1.0, 3, "linear"),),
        repeats="S",
        noise_formula=thermal_noise,
        need=lacks_temperature_rate,
        rivals=(NOISE_OF_TIME,),
        words=Words(
            what="The gyro is noisier while its temperature changes, or when hot.",
            brought_on_by="Warm-up and other ramps.",
            size="Ten to fifty percent of the noise on a plateau.",
            remedy="Align on a plateau, or give early minutes less weight.",
        ),
    ),
    error(
        "G29",
        NOISE_OF_TIME,
        GYROS,
        one("deg/sqrt(h)", 5e-4, 3e-3, signed=False),
        shape=(
            ShapeParameter("slope", "", -3.0, 3.0, 4, "linear"),
            ShapeParameter("bend", "", -2.0, 2.0, 3, "linear"),
        ),
        repeats="S",
        noise_formula=noise_of_time,
        words=Words(
            what="The gyro's noise changes smoothly through the run, tied to nothing logged. It "
            "is a description, not a cause.",
            brought_on_by="Unknown; a temperature that was not logged, or vibration nearby.",
            size="Ten to fifty percent of the noise of the quieter part.",
            remedy="Record a second start: noise of a temperature comes again with it.",
        ),
    ),
)
