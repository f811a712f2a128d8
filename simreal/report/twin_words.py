"""The sentences of a twin's fit and check: why a parameter cannot be told, and what would tell
it."""

import math

from ins.units import HOUR
from simreal.plan.recordings import Recording
from simreal.twin.fit.result import Needs, Parameter, Why

WHY_WORDS = {
    Why.NOTHING_SEEN: "none of it is seen beside the rest",
    Why.TOO_LOOSE: "something of it is seen, too little to tell its size",
    Why.FEW_RUNS: "too few power-ons",
    Why.NO_STREAM: "no such stream at rest in these runs",
    Why.EXACT_ZERO: "all readings are the same, which shows no noise",
    Why.BELOW_RESOLUTION: "the readings' step hides it",
    Why.ROUNDED: "rows are rounded one by one, to steps that hide their noise",
    Why.NOT_ON_A_GRID: "readings lie on no grid",
    Why.CONTRADICTED: (
        "the data contradict the model by far: filtered by the logger, or shaken by what it"
        " does not know"
    ),
    Why.GYROS_DIFFER: "the gyros differ, and nothing beside the vertical one witnesses a yaw",
}
PARAMETER_NAMES = {
    "gyro.arw_deg_sqrt_h": ("angle random walk", "deg/sqrt(h)"),
    "gyro.quantization_rad": ("gyro quantisation", "rad"),
    "gyro.bias_instability_deg_h": ("gyro flicker B", "deg/h"),
    "gyro.rate_random_walk_deg_h_sqrt_h": ("gyro rate random walk", "deg/h/sqrt(h)"),
    "gyro.gauss_markov_deg_h": ("gyro Gauss-Markov", "deg/h"),
    "gyro.gauss_markov_tau_s": ("its correlation time", "s"),
    "gyro.turn_on_deg_h": ("gyro turn-on", "deg/h"),
    "accel.vrw_ug_sqrt_hz": ("velocity random walk", "ug/sqrt(Hz)"),
    "accel.quantization_m_s": ("accelerometer quantisation", "m/s"),
    "accel.bias_instability_ug": ("accelerometer flicker B", "ug"),
    "accel.rate_random_walk_ug_sqrt_h": ("accelerometer random walk", "ug/sqrt(h)"),
    "accel.gauss_markov_ug": ("accelerometer Gauss-Markov", "ug"),
    "accel.gauss_markov_tau_s": ("its correlation time", "s"),
    "accel.turn_on_ug": ("accelerometer turn-on", "ug"),
    "vehicle.sway_m_s": ("sway of the vehicle", "m/s"),
    "vehicle.sway_hz": ("frequency of the sway", "Hz"),
    "vehicle.sway_damping": ("damping of the sway", ""),
    "vehicle.yaw_creep_arcsec_sqrt_h": ("yaw creep", "arcsec/sqrt(h)"),
    "temperature.noise_degC": ("thermometer noise", "degC"),
    "temperature.resolution_degC": ("thermometer resolution", "degC"),
    "gnss.sigma_horizontal_m": ("receiver, horizontal", "m"),
    "gnss.sigma_vertical_m": ("receiver, vertical", "m"),
    "gnss.sigma_velocity_m_s": ("receiver, velocity", "m/s"),
    "odometer.noise_m_s": ("wheels", "m/s"),
}
YAW_NOTE = (
    "yaw creep is what the vertical gyro has beyond the level ones: nothing else witnesses a yaw,"
    " so a vertical gyro that is noisier in itself looks the same"
)


def why_words(p: Parameter) -> str:
    """Why a parameter cannot be told, and what would; empty where it is told."""
    if p.why is None:
        return ""
    said = f"cannot be told from these runs: {WHY_WORDS[p.why]}"
    lacks = needs_words(p)
    return f"{said}; {lacks}" if lacks else said


def needs_words(p: Parameter) -> str:
    """The recording that would tell a parameter, as `recal plan` names it."""
    if p.needs is Needs.RUNS:
        return (
            f"{p.needed:.0f} power-ons of a unit would tell it, each: {Recording(hours=0.5).words}"
        )
    if p.needs is Needs.PARKED_SECONDS:
        if not math.isfinite(p.needed):
            return "no parked recording of 128 h or less would"
        asked = Recording(start="ambient", hours=round(p.needed / HOUR, 1) or 0.1)
        return f"one recording would tell it: {asked.words}"
    return ""


def size_words(p: Parameter) -> str:
    """The value with its interval, or the limit."""
    unit = PARAMETER_NAMES[p.name][1]
    tail = f" {unit}" if unit else ""
    if p.identified:
        return f"{p.value:.4g} +- {p.sigma:.2g}{tail}"
    limit = f", below {p.high:.3g}" if math.isfinite(p.high) else ""
    return f"{p.value:.3g}{tail} taken{limit}"
