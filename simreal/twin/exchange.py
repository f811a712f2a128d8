"""Noise models of other programs: Kalibr's imu.yaml, what imu_utils writes, data sheets; and pyins.

Such files hold numbers by key, one a line, in blocks by indentation. They are read by our own
bounded reader: no tags, no lists, no references.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum

import numpy as np

from ins.noise import FLICKER_FLOOR, accel_densities, gyro_densities
from ins.records import InputError, TwinModel
from ins.units import (
    DEG,
    DEG_PER_HOUR,
    DEG_PER_HOUR_SQRT_HOUR,
    DEG_PER_SQRT_HOUR,
    HOUR,
    MICRO_G,
    MICRO_G_PER_SQRT_HOUR,
)

MOST_LINES = 400  # of a noise file: Kalibr writes 15, imu_utils 30
MOST_BLOCKS = 4  # blocks within blocks: imu_utils has 2
KEYED_LINE = re.compile(r"^(\s*)([A-Za-z_][\w\-]*)\s*:\s*([^#]*?)\s*(?:#.*)?$")
PASSED_OVER = re.compile(r"^\s*(#.*)?$|^%YAML.*$|^---\s*$")


class Dialect(StrEnum):
    """Whose file it is."""

    KALIBR = "kalibr"
    IMU_UTILS = "imu_utils"
    DATASHEET = "datasheet"


# (section, key of the twin, factor from the file's unit to the twin's)
KALIBR_KEYS = {
    "gyroscope_noise_density": ("gyro", "arw_deg_sqrt_h", 1.0 / DEG_PER_SQRT_HOUR),
    "gyroscope_random_walk": ("gyro", "rate_random_walk_deg_h_sqrt_h", 1 / DEG_PER_HOUR_SQRT_HOUR),
    "accelerometer_noise_density": ("accel", "vrw_ug_sqrt_hz", 1.0 / MICRO_G),
    "accelerometer_random_walk": ("accel", "rate_random_walk_ug_sqrt_h", 1 / MICRO_G_PER_SQRT_HOUR),
}
# n: density; w: the floor of the Allan deviation (FLICKER_FLOOR of it is B)
IMU_UTILS_KEYS = {
    "Gyr.avg-axis.gyr_n": ("gyro", "arw_deg_sqrt_h", 1.0 / DEG_PER_SQRT_HOUR),
    "Gyr.avg-axis.gyr_w": ("gyro", "bias_instability_deg_h", 1.0 / FLICKER_FLOOR / DEG_PER_HOUR),
    "Acc.avg-axis.acc_n": ("accel", "vrw_ug_sqrt_hz", 1.0 / MICRO_G),
    "Acc.avg-axis.acc_w": ("accel", "bias_instability_ug", 1.0 / FLICKER_FLOOR / MICRO_G),
}
DATASHEET_KEYS = {
    "gyro_arw_deg_sqrt_h": ("gyro", "arw_deg_sqrt_h", 1.0),
    "gyro_noise_density_deg_s_sqrt_hz": ("gyro", "arw_deg_sqrt_h", DEG / DEG_PER_SQRT_HOUR),
    "gyro_bias_instability_deg_h": ("gyro", "bias_instability_deg_h", 1.0 / FLICKER_FLOOR),
    "gyro_rate_random_walk_deg_h_sqrt_h": ("gyro", "rate_random_walk_deg_h_sqrt_h", 1.0),
    "gyro_turn_on_deg_h": ("gyro", "turn_on_deg_h", 1.0),
    "gyro_quantization_rad": ("gyro", "quantization_rad", 1.0),
    "accel_noise_density_ug_sqrt_hz": ("accel", "vrw_ug_sqrt_hz", 1.0),
    "accel_vrw_m_s_sqrt_h": ("accel", "vrw_ug_sqrt_hz", 1.0 / np.sqrt(HOUR) / MICRO_G),
    "accel_bias_instability_ug": ("accel", "bias_instability_ug", 1.0 / FLICKER_FLOOR),
    "accel_rate_random_walk_ug_sqrt_h": ("accel", "rate_random_walk_ug_sqrt_h", 1.0),
    "accel_quantization_m_s": ("accel", "quantization_m_s", 1.0),
    "accel_turn_on_ug": ("accel", "turn_on_ug", 1.0),
}
KEYS = {
    Dialect.KALIBR: KALIBR_KEYS,
    Dialect.IMU_UTILS: IMU_UTILS_KEYS,
    Dialect.DATASHEET: DATASHEET_KEYS,
}


def flat_values(text: str, *, name: str) -> dict[str, str]:
    """Values by dotted key of a file of blocks. InputError names the line that is none."""
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        raise InputError(f"{name}: {len(lines)} lines, needed at most {MOST_LINES}")
    found: dict[str, str] = {}
    blocks: list[tuple[int, str]] = []
    for number, line in enumerate(lines, 1):
        if PASSED_OVER.match(line):
            continue
        match = KEYED_LINE.match(line)
        if match is None:
            raise InputError(f"{name}: line {number}: {line.strip()[:60]!r}, needed key: value")
        indent, key, value = len(match[1]), match[2], match[3]
        while blocks and blocks[-1][0] >= indent:
            blocks.pop()
        if len(blocks) >= MOST_BLOCKS:
            raise InputError(f"{name}: line {number}: blocks deeper than {MOST_BLOCKS}")
        path = ".".join([*(block for _, block in blocks), key])
        if value:
            found[path] = value
        else:
            blocks.append((indent, key))
    return found


def twin_from_text(text: str, dialect: Dialect, believed: TwinModel, *, name: str) -> TwinModel:
    """A twin with the numbers of another program's file; what that lacks is as believed.

    InputError where no key of the dialect is there, or a value is no positive number.
    """
    values = flat_values(text, name=name)
    if dialect is Dialect.KALIBR:  # newer files hold a block for each unit
        values = {key.split(".")[-1]: value for key, value in reversed(values.items())}
    keys = KEYS[dialect]
    unknown = sorted(set(values) - set(keys))
    if dialect is Dialect.DATASHEET and unknown:
        raise InputError(f"{name}: unknown key {unknown[0]!r}, needed one of {', '.join(keys)}")
    known = {key: values[key] for key in keys if key in values}
    if not known:
        raise InputError(f"{name}: no key of {dialect}, needed one of {', '.join(keys)}")
    twin = replace(believed, source=name)
    for key, value in known.items():
        section, of_twin, factor = keys[key]
        size = _positive(value, f"{name}: {key}") * factor
        record = replace(getattr(twin, section), **{of_twin: float(size)})
        twin = replace(twin, **{section: record})
    return twin


def _positive(text: str, where: str) -> float:
    try:
        value = float(text.strip("\"' "))
    except ValueError:
        raise InputError(f"{where}: {text[:40]!r}, needed a number") from None
    if not 0.0 <= value < float("inf"):
        raise InputError(f"{where}: {text[:40]!r}, needed a number that is not negative")
    return value


def kalibr_text(twin: TwinModel, rate_hz: float) -> str:
    """imu.yaml of Kalibr. It knows white noise and a random walk; the walk here meets the flicker
    an hour on, as a filter without a flicker state needs.
    """
    gyro, accel = gyro_densities(twin.gyro), accel_densities(twin.accel)
    values = {
        "accelerometer_noise_density": accel.white,
        "accelerometer_random_walk": float(np.hypot(accel.walk, accel.instability / HOUR**0.5)),
        "gyroscope_noise_density": gyro.white,
        "gyroscope_random_walk": float(np.hypot(gyro.walk, gyro.instability / HOUR**0.5)),
    }
    units = ("m/s^2/sqrt(Hz)", "m/s^3/sqrt(Hz)", "rad/s/sqrt(Hz)", "rad/s^2/sqrt(Hz)")
    lines = [f"{key}: {value:.6e}  # {unit}" for (key, value), unit in zip(values.items(), units)]
    return "\n".join([*lines, "rostopic: /imu0", f"update_rate: {rate_hz:g}", ""])


def pyins_parameters(twin: TwinModel) -> Mapping[str, Mapping[str, float]]:
    """Arguments of pyins.inertial_sensor.EstimationModel for gyro and accel, in SI: bias_sd, noise
    (a density), bias_walk (a density).
    """
    found = {}
    for name, d in (("gyro", gyro_densities(twin.gyro)), ("accel", accel_densities(twin.accel))):
        found[name] = {
            "bias_sd": d.turn_on,
            "noise": d.white,
            "bias_walk": float(np.hypot(d.walk, d.instability / HOUR**0.5)),
        }
    return found
