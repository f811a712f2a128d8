"""What runs hold, as effects ask for it: temperatures, turns, headings, changes of specific force."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from simreal.telemetry import PARKED, Telemetry

TURN_RAD = 0.5
TURNING_RAD_S = 2e-3  # slower is Earth rate, transport rate or noise
TEMPERATURE_CHANGE_degC = 1.0
GRADIENT_CHANGE_degC = 0.1
TURN_TEMPERATURES_degC = 3.0  # between turns "at two temperatures"
HEADING_APART_RAD = 0.5
FORCE_CHANGE_M_S2 = 0.5  # of a component, about 0.05 g


def gyro_degC(run: Telemetry, axis: int) -> NDArray:
    """Temperature of a gyro (n,); InputError where it is not logged."""
    if run.temperature_degC is None:
        raise InputError(f"run {run.run_index}: no gyro temperature, needed by this effect")
    return run.temperature_degC[:, axis]


def gyro_degC_min(run: Telemetry, axis: int) -> NDArray:
    """Rate of a gyro's temperature (n,) [degC/min]; from the temperature where the run does not hold it."""
    if run.temperature_rate_degC_min is not None:
        return run.temperature_rate_degC_min[:, axis]
    return 60.0 * run.rate_of(gyro_degC(run, axis))


def gradient_degC(run: Telemetry, axis: int) -> NDArray:
    """Temperature difference reading of a gyro (n,); InputError where it is not logged."""
    if run.gradient_degC is None:
        raise InputError(f"run {run.run_index}: no gradient_{'xyz'[axis]}_degC, needed by this effect")
    return run.gradient_degC[:, axis]


def lacks_temperature(runs: Sequence[Telemetry], axis: int) -> str:
    """For effects of the gyro's temperature itself: a temperature in all runs, not one and the same throughout."""
    if any(run.temperature_degC is None for run in runs):
        return "a gyro temperature"
    return "" if _span([gyro_degC(r, axis) for r in runs]) > TEMPERATURE_CHANGE_degC else "a gyro temperature that changes"


def lacks_temperature_rate(runs: Sequence[Telemetry], axis: int) -> str:
    """For effects of the temperature's past: it must change within a run."""
    if any(run.temperature_degC is None for run in runs):
        return "a gyro temperature"
    changes = max((_span([gyro_degC(run, axis)]) for run in runs), default=0.0)
    return "" if changes > TEMPERATURE_CHANGE_degC else "a gyro temperature that changes within a run"


def lacks_heating_and_cooling(runs: Sequence[Telemetry], axis: int) -> str:
    """For hysteresis: temperature rising as well as falling, in one run or in two."""
    if lack := lacks_temperature_rate(runs, axis):
        return lack
    swings = np.array([swing(gyro_degC(run, axis)) for run in runs]).max(axis=0)
    return "" if swings.min() > TEMPERATURE_CHANGE_degC else "temperature rising and falling (a run that cools)"


def lacks_gradient(runs: Sequence[Telemetry], axis: int) -> str:
    """For effects of a gyro's own temperature difference."""
    if any(run.gradient_degC is None for run in runs):
        return f"a temperature difference reading (gradient_{'xyz'[axis]}_degC)"
    changes = _span([gradient_degC(run, axis) for run in runs])
    return "" if changes > GRADIENT_CHANGE_degC else "a temperature difference that changes"


def swing(values: NDArray) -> tuple[float, float]:
    """Largest rise and largest fall of a series (n,): how far it goes from an earlier low, or from an earlier high."""
    up = values - np.minimum.accumulate(values)
    down = np.maximum.accumulate(values) - values
    return float(up.max(initial=0.0)), float(down.max(initial=0.0))


def turns_rad(run: Telemetry, axis: int) -> tuple[float, float]:
    """Largest rotation of a moving run about a body axis one way and the other [rad]."""
    rate = np.where(_turning(run, axis), run.rate_rad_s[:, axis], 0.0)
    return swing(np.cumsum(rate) * run.dt_s)


def lacks_turns(runs: Sequence[Telemetry], axis: int) -> str:
    """For effects of the gyro's own rate."""
    return _lacks_turns_about(runs, (axis,), "turns about its own axis")


def lacks_cross_turns(runs: Sequence[Telemetry], axis: int) -> str:
    """For effects of the rate about the other two axes: turns, or Earth rate at several headings."""
    others = tuple(k for k in range(3) if k != axis)
    lack = _lacks_turns_about(runs, others, "turns about another axis")
    several = any(run.heading_known for run in runs) and headings(runs) > 1
    return "" if several or not lack else f"{lack} or several headings"


def lacks_left_and_right_turns(runs: Sequence[Telemetry], axis: int) -> str:
    """For effects that tell one sense of rotation from the other."""
    both = np.array([turns_rad(run, axis) for run in runs] or [(0.0, 0.0)]).max(axis=0)
    return "" if both.min() > TURN_RAD else "left and right turns"


def lacks_turns_at_two_temperatures(runs: Sequence[Telemetry], axis: int) -> str:
    """For a scale factor that depends on temperature."""
    if any(run.temperature_degC is None for run in runs):
        return "a gyro temperature"
    at = [] if lacks_turns(runs, axis) else [gyro_degC(run, axis)[_turning(run, axis)] for run in runs]
    return "" if _span(at) > TURN_TEMPERATURES_degC else "turns at two temperatures"


def headings(runs: Sequence[Telemetry]) -> int:
    """How many headings at least HEADING_APART_RAD from each other the runs hold."""
    found: list[float] = []
    for heading in (h for run in runs for h in np.unique(np.round(run.heading_rad, 1))):
        if all(abs(np.angle(np.exp(1j * (heading - other)))) > HEADING_APART_RAD for other in found):
            found.append(float(heading))
    return len(found)


def lacks_headings(runs: Sequence[Telemetry], axis: int) -> str:
    """For effects of the direction in the Earth's field."""
    if not all(run.heading_known for run in runs):
        return "a known heading"
    return "" if headings(runs) > 1 else "several headings"


def lacks_force_changes(runs: Sequence[Telemetry], axis: int) -> str:
    """For effects of the specific force: parked and level it is the same in all runs."""
    spans = [np.ptp(np.concatenate([run.force_m_s2[:, k] for run in runs])) for k in range(3)] if runs else [0.0]
    return "" if max(spans) > FORCE_CHANGE_M_S2 else "changes of acceleration (flight, tumbling)"


def _turning(run: Telemetry, axis: int) -> NDArray:
    return (run.kind != PARKED) & (np.abs(run.rate_rad_s[:, axis]) > TURNING_RAD_S)


def _lacks_turns_about(runs: Sequence[Telemetry], axes: Sequence[int], otherwise: str) -> str:
    """Empty with a turn about one of the axes; "turns" with none about any, `otherwise` with turns about others."""
    turned = [any(max(turns_rad(run, k)) > TURN_RAD for run in runs) for k in range(3)]
    if any(turned[k] for k in axes):
        return ""
    return otherwise if any(turned) else "turns"


def _span(series: Sequence[NDArray]) -> float:
    values = np.concatenate(series) if series else np.zeros(0)
    return float(np.ptp(values)) if values.size else 0.0
