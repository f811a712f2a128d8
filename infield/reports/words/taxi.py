"""Sentences of what a taxi showed of wind, tyres and installation (`infield.session.navigated`)."""

from collections.abc import Mapping, Sequence
from enum import StrEnum

import numpy as np

from infield.reports.words.sentences import Template
from infield.session.reasons import Nuisance
from ins.units import DEG, MILLIRADIAN

Numbers = Sequence[float]
MILLISECOND = 1e-3


def _size(value: float, sigma: float, unit: float, name: str) -> str:
    return f"{value / unit:+.3g} +- {sigma / unit:.2g} {name}"


def _crab(*, value: Numbers, sigma: Numbers, prior: Numbers) -> str:
    size = _size(-value[0], sigma[0], MILLIRADIAN, "mrad")
    return f"crab {size} (taken for within {prior[0] / MILLIRADIAN:g} mrad)"


def _wheel_arm_x(*, value: Numbers, sigma: Numbers, prior: Numbers) -> str:
    return (
        f"the point that does not slip lies {_size(-value[0], sigma[0], 1.0, 'm')} further along"
        f" body x than declared (taken for within {prior[0]:g} m)"
    )


def _wheel_scale(*, value: Numbers, sigma: Numbers, prior: Numbers) -> str:
    return (
        f"the wheels read {_size(100 * value[0], 100 * sigma[0], 1.0, '%')} too much (taken for"
        f" within {100 * prior[0]:g} %)"
    )


def _cross_wind(*, value: Numbers, sigma: Numbers, prior: Numbers) -> str:
    towards = np.arctan2(value[1], value[0])
    along = np.array([np.cos(towards), np.sin(towards)])
    unsure = float(np.linalg.norm(along * np.asarray(sigma)))
    size = _size(float(np.linalg.norm(value)), unsure, MILLIRADIAN, "mrad")
    return (
        f"a steady cross wind pushed the rolling vehicle towards {towards / DEG % 360.0:.0f} deg:"
        f" up to {size} off its body x; estimated (each way taken for within"
        f" {prior[0] / MILLIRADIAN:g} mrad)"
    )


def _turning_crab(*, value: Numbers, sigma: Numbers | None, prior: Numbers) -> str:
    return (
        f"the crab changed from leg to leg, by about {value[0] / MILLIRADIAN:.2g} mrad RMS: taken"
        " for another one after each turn"
    )


def _gusts(*, value: Numbers, sigma: Numbers | None, prior: Numbers) -> str:
    return (
        f"the crab wandered along the legs by about {value[0] / MILLIRADIAN:.2g} mrad RMS, as in"
        " gusts: taken for noise of that size"
    )


def _side_slip(*, value: Numbers, sigma: Numbers, prior: Numbers) -> str:
    return (
        f"side slip in turns of {_size(value[0], sigma[0], MILLIRADIAN, 'mrad')} by m/s^2 of"
        f" lateral acceleration; estimated (taken for within {prior[0] / MILLIRADIAN:g})"
    )


def _wheel_arm_y(*, value: Numbers, sigma: Numbers, prior: Numbers) -> str:
    return (
        f"the wheels that are read lie {_size(-value[0], sigma[0], 1.0, 'm')} further along body y"
        f" than declared; estimated (taken for within {prior[0]:g} m)"
    )


def _odometer_delay(*, value: Numbers, sigma: Numbers, prior: Numbers) -> str:
    return (
        f"the wheels' speeds are {_size(value[0], sigma[0], MILLISECOND, 'ms')} older than their"
        f" stamps; estimated (taken for within {prior[0] / MILLISECOND:g} ms)"
    )


def _antenna(*, value: Numbers, sigma: Numbers, prior: Numbers) -> str:
    along = [f"{_size(v, s, 1.0, 'm')} along body {axis}" for v, s, axis in zip(value, sigma, "xy")]
    return (
        f"the antenna lies {' and '.join(along)} from where it is declared; estimated (taken for"
        f" within {prior[0]:g} m)"
    )


def _gnss_delay(*, value: Numbers, sigma: Numbers, prior: Numbers) -> str:
    positions, velocities = (
        _size(v, s, MILLISECOND, "ms") for v, s in zip(value, sigma, strict=True)
    )
    return (
        f"the receiver's positions are {positions} and its velocities {velocities} older than their"
        f" stamps; estimated (taken for within {prior[0] / MILLISECOND:g} ms)"
    )


def _gnss_slow_position(*, value: Numbers, sigma: Numbers | None, prior: Numbers) -> str:
    return (
        f"the receiver's positions wandered by about {value[0]:.2g} m RMS over minutes: taken for"
        " a slow error of that size"
    )


def _gnss_slow_velocity(*, value: Numbers, sigma: Numbers | None, prior: Numbers) -> str:
    return (
        f"the receiver's velocities wandered by about {value[0]:.2g} m/s RMS over a minute: taken"
        " for a slow error of that size"
    )


SENTENCES: Mapping[StrEnum, Template] = {
    Nuisance.CRAB: _crab,
    Nuisance.WHEEL_ARM_X: _wheel_arm_x,
    Nuisance.WHEEL_SCALE: _wheel_scale,
    Nuisance.CROSS_WIND: _cross_wind,
    Nuisance.TURNING_CRAB: _turning_crab,
    Nuisance.GUSTS: _gusts,
    Nuisance.SIDE_SLIP: _side_slip,
    Nuisance.WHEEL_ARM_Y: _wheel_arm_y,
    Nuisance.ODOMETER_DELAY: _odometer_delay,
    Nuisance.ANTENNA: _antenna,
    Nuisance.GNSS_DELAY: _gnss_delay,
    Nuisance.GNSS_SLOW_POSITION: _gnss_slow_position,
    Nuisance.GNSS_SLOW_VELOCITY: _gnss_slow_velocity,
}
