"""What gyro effects need of the runs: temperatures, turns, headings, changes of specific force.

A function `lacks_*` of (runs, target) gives the plain words of what they lack, empty for nothing.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.errors.base import AXIS, GYROS
from ins.errors.parts.recordings import over, span
from ins.errors.telemetry import PARKED, Telemetry
from ins.records import InputError

NEEDED_TURN_RAD = 0.5  # 29 deg: level Earth rate changes by 12 % on one axis and 48 % on the other
# slower is Earth rate, transport rate or noise; 7e-5 rad/s, 4e-5 rad/s at 250 m/s
TURNING_RAD_S = 2e-3
TEMPERATURE_CHANGE_degC = 1.0  # ten steps of a thermometer of 0.1 degC (R4)
GRADIENT_CHANGE_degC = 0.1  # ten steps of the default thermometer (0.01 degC)
# between turns "at two temperatures"; chosen: 3 of TEMPERATURE_CHANGE_degC
TURN_TEMPERATURES_degC = 3.0
HEADING_APART_RAD = 0.5  # 29 deg, as a turn
FORCE_CHANGE_M_S2 = 0.5  # of a component, about 0.05 g


def gyro_degC(run: Telemetry, target: str) -> NDArray:
    """Temperature of a gyro (n,); InputError where it is not logged."""
    if run.temperature_degC is None:
        raise InputError(f"run {run.run_index}: no gyro temperature, needed by this effect")
    return run.temperature_degC[:, AXIS[target]]


def gyro_degC_min(run: Telemetry, target: str) -> NDArray:
    """Rate of a gyro's temperature (n,) [degC/min]; from the temperature where the run does not
    hold it.
    """
    if run.temperature_rate_degC_min is not None:
        return run.temperature_rate_degC_min[:, AXIS[target]]
    return 60.0 * run.rate_of(gyro_degC(run, target))


def gradient_degC(run: Telemetry, target: str) -> NDArray:
    """Temperature difference reading of a gyro (n,); InputError where it is not logged."""
    if run.gradient_degC is None:
        raise InputError(
            f"run {run.run_index}: no gradient_{target[-1]}_degC, needed by this effect"
        )
    return run.gradient_degC[:, AXIS[target]]


def lacks_temperature(runs: Sequence[Telemetry], target: str) -> str:
    """For effects of the gyro's temperature itself: a temperature in all runs, not one and the same
    throughout.
    """
    if any(run.temperature_degC is None for run in runs):
        return "a gyro temperature"
    changes = span(over(runs, lambda run: gyro_degC(run, target)))
    return "" if changes > TEMPERATURE_CHANGE_degC else "a gyro temperature that changes"


def lacks_temperature_rate(runs: Sequence[Telemetry], target: str) -> str:
    """For effects of the temperature's past: it must change within a run."""
    if any(run.temperature_degC is None for run in runs):
        return "a gyro temperature"
    changes = max((span(gyro_degC(run, target)) for run in runs), default=0.0)
    return (
        "" if changes > TEMPERATURE_CHANGE_degC else "a gyro temperature that changes within a run"
    )


def lacks_heating_and_cooling(runs: Sequence[Telemetry], target: str) -> str:
    """For hysteresis: temperature rising as well as falling, in one run or in two."""
    if lack := lacks_temperature_rate(runs, target):
        return lack
    swings = np.array([swing(gyro_degC(run, target)) for run in runs]).max(axis=0)
    return (
        ""
        if swings.min() > TEMPERATURE_CHANGE_degC
        else "temperature rising and falling (a run that cools)"
    )


def lacks_gradient(runs: Sequence[Telemetry], target: str) -> str:
    """For effects of a gyro's own temperature difference."""
    if any(run.gradient_degC is None for run in runs):
        return f"a temperature difference reading (gradient_{target[-1]}_degC)"
    changes = span(over(runs, lambda run: gradient_degC(run, target)))
    return "" if changes > GRADIENT_CHANGE_degC else "a temperature difference that changes"


def swing(values: NDArray) -> tuple[float, float]:
    """Largest rise and largest fall of a series (n,): how far it goes from an earlier low, or from
    an earlier high.
    """
    up = values - np.minimum.accumulate(values)
    down = np.maximum.accumulate(values) - values
    return float(up.max(initial=0.0)), float(down.max(initial=0.0))


def turns_rad(run: Telemetry, target: str) -> tuple[float, float]:
    """Largest rotation of a moving run about the axis of a gyro one way and the other [rad]."""
    if target not in run.turns_rad:
        rate = np.where(_turning(run, target), run.rate_rad_s[:, AXIS[target]], 0.0)
        run.turns_rad[target] = swing(np.cumsum(rate) * run.dt_s)
    return run.turns_rad[target]


def lacks_turns(runs: Sequence[Telemetry], target: str) -> str:
    """For effects of the gyro's own rate."""
    return _lacks_turns_about(runs, (target,), "turns about its own axis")


def lacks_turns_or_earth_rate(runs: Sequence[Telemetry], target: str) -> str:
    """For a scale factor: turns about its own axis; where vehicles turn at all, Earth rate on
    several starts will do.

    That shows only errors far beyond the usual (0.2 % for 0.02 deg/h), which must not go by another
    name.
    """
    lack = lacks_turns(runs, target)
    turn = not _lacks_turns_about(runs, GYROS, "turns")
    starts = np.array([run.heading_rad[0] for run in runs if run.heading_known])
    apart = np.abs(np.angle(np.exp(1j * np.subtract.outer(starts, starts))))
    return "" if turn and apart.max(initial=0.0) > HEADING_APART_RAD else lack


def lacks_cross_turns(runs: Sequence[Telemetry], target: str) -> str:
    """For effects of the rate about the other two axes: turns, or Earth rate at several
    headings.
    """
    others = [gyro for gyro in GYROS if gyro != target]
    lack = _lacks_turns_about(runs, others, "turns about another axis")
    several = several_headings([run for run in runs if run.heading_known])
    return "" if several or not lack else f"{lack} or several headings"


def lacks_left_and_right_turns(runs: Sequence[Telemetry], target: str) -> str:
    """For effects that tell one sense of rotation from the other."""
    both = np.array([turns_rad(run, target) for run in runs] or [(0.0, 0.0)]).max(axis=0)
    return "" if both.min() > NEEDED_TURN_RAD else "left and right turns"


def lacks_turns_at_two_temperatures(runs: Sequence[Telemetry], target: str) -> str:
    """For a scale factor that depends on temperature."""
    if any(run.temperature_degC is None for run in runs):
        return "a gyro temperature"
    turning = over(runs, lambda run: gyro_degC(run, target)[_turning(run, target)])
    several = not lacks_turns(runs, target) and span(turning) > TURN_TEMPERATURES_degC
    return "" if several else "turns at two temperatures"


def several_headings(runs: Sequence[Telemetry]) -> bool:
    """Two headings at least HEADING_APART_RAD from each other."""
    if not runs:
        return False
    first = float(runs[0].heading_rad[0])
    off = np.concatenate([_headings_from(run, first) for run in runs])
    return bool(
        np.abs(np.angle(np.exp(1j * np.subtract.outer(off, off)))).max() > HEADING_APART_RAD
    )


def _headings_from(run: Telemetry, first_rad: float) -> NDArray:
    """Headings of a run less another, rounded to 0.1 rad, each once."""
    if first_rad not in run.headings_from:
        off = np.angle(np.exp(1j * (run.heading_rad - first_rad)))
        run.headings_from[first_rad] = np.unique(np.round(off, 1))
    return run.headings_from[first_rad]


def lacks_headings(runs: Sequence[Telemetry], target: str) -> str:
    """For effects of the direction in the Earth's field."""
    if not all(run.heading_known for run in runs):
        return "a known heading"
    return "" if several_headings(runs) else "several headings"


def lacks_force_changes(runs: Sequence[Telemetry], target: str) -> str:
    """For effects of the specific force: parked and level it is the same in all runs."""
    most = max(span(over(runs, lambda run, k=k: run.force_m_s2[:, k])) for k in range(3))  # type: ignore[misc]
    return "" if most > FORCE_CHANGE_M_S2 else "changes of acceleration (flight, tumbling)"


def _turning(run: Telemetry, target: str) -> NDArray:
    return (run.kind != PARKED) & (np.abs(run.rate_rad_s[:, AXIS[target]]) > TURNING_RAD_S)


def _lacks_turns_about(runs: Sequence[Telemetry], gyros: Sequence[str], otherwise: str) -> str:
    """Empty with a turn about one of these gyros' axes; "turns" with none about any, `otherwise`
    with others only.
    """
    turned = {
        gyro: any(max(turns_rad(run, gyro)) > NEEDED_TURN_RAD for run in runs) for gyro in GYROS
    }
    if any(turned[gyro] for gyro in gyros):
        return ""
    return otherwise if any(turned.values()) else "turns"
