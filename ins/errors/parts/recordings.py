"""What a set of runs holds, as questions with a yes or no, and the plain words for what it
lacks.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ins.errors.telemetry import AIRBORNE, Telemetry

TURN_rad_s = 0.02  # a taxi turn of 90 deg takes less than 80 s
MOVES_m_s = 1.0
BRAKING_m_s2 = 0.3
Runs = Sequence[Telemetry]


def lacking(*asked: tuple[bool, str]) -> str:
    """The words of what is not there, joined; empty where all is."""
    return " and ".join(words for there, words in asked if not there)


def over(runs: Runs, values: Callable[[Telemetry], NDArray]) -> NDArray:
    """A quantity of each run, one after the other (n, ...); empty where there is none."""
    parts = [values(run) for run in runs]
    return np.concatenate(parts) if parts else np.zeros(0)


def span(values: NDArray) -> float:
    """Largest less smallest, 0 of nothing."""
    return float(np.ptp(values)) if values.size else 0.0


def moving(run: Telemetry) -> NDArray:
    """On the way, with a speed that navigation knows (n,)."""
    return ~run.parked & (np.abs(run.speed_m_s) > MOVES_m_s)


def rolls(runs: Runs) -> bool:
    return any(bool(np.any(run.rolling & moving(run))) for run in runs)


def flies(runs: Runs) -> bool:
    return any(bool(np.any(run.kind == AIRBORNE)) for run in runs)


def turns(runs: Runs) -> bool:
    return bool(np.any(np.abs(over(runs, lambda run: run.turn_rad_s[moving(run)])) > TURN_rad_s))


def brakes(runs: Runs) -> bool:
    """Both gains and loses speed."""
    change = over(runs, lambda run: run.acceleration_m_s2[moving(run)])
    return bool(np.any(change > BRAKING_m_s2) and np.any(change < -BRAKING_m_s2))


def has_gnss(runs: Runs) -> bool:
    return any(run.has_gnss for run in runs)


def has_odometer(runs: Runs) -> bool:
    return any(run.has_odometer for run in runs)


def has_accel_temperatures(runs: Runs) -> bool:
    return bool(runs) and all(run.accel_degC is not None for run in runs)


def knows_way(runs: Runs) -> bool:
    """A unit that does not find north is not navigated: its taxi has no known speed."""
    return any(run.heading_known for run in runs)


def needs_turns(runs: Runs, target: str) -> str:
    return lacking((turns(runs), "turns"))


def taxi(runs: Runs, target: str) -> str:
    return lacking((knows_way(runs), "a known heading"), (rolls(runs), "taxi"))


def odometer_taxi(runs: Runs, target: str) -> str:
    return lacking((has_odometer(runs), "an odometer"), (rolls(runs), "taxi"))


def odometer_braking(runs: Runs, target: str) -> str:
    return lacking((has_odometer(runs), "an odometer"), (brakes(runs), "braking and acceleration"))
