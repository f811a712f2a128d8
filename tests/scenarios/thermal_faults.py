"""Rates of the thermometer judge and of the smoother over seeded temperature histories (requirement
R4).

Each run draws a start (cold, ambient, hot, cooling), a sampling (0.5, 1, 10 s), a length (30, 70,
120 min), a step of the thermometers (none, 0.01, 0.1, 0.5, 1 degC) and their noise (0.002, 0.01,
0.05 degC).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from infield.thermometer.gyro_temperature import GyroTemperature, gyro_temperature
from ins.records import AXES, TemperatureLog
from ins.thermometer_faults import check_thermometers
from trajectories.simulator.thermal import STARTS, thermal_history

HOUR_S = 4200.0
WINDOW_S = 121  # of the moving average that the smoother is compared with
SCALES = {
    "Fahrenheit": lambda T: 1.8 * T + 32.0,
    "kelvin": lambda T: T + 273.15,
    "ten times": lambda T: 10.0 * T,
    "a tenth": lambda T: 0.1 * T,
}
FAULTS = (
    "stuck from the start",
    "stuck for a span",
    "absent",
    "jump that stays",
    "jump and back",
    "zeros scattered",
    "zeros in a burst",
    "zero throughout",
    *SCALES,
    *(f"{name}, all gyros" for name in SCALES),
    "steps of 1 degC",
    "hole of 300 s",
)
# a fault that moves no reading by more than this and half a step is none that matters
UNSEEN_degC = 0.6


@dataclass(frozen=True)
class Thermometers:
    """One healthy unit: times (n,), readings by column, and how they were made."""

    time_s: NDArray
    columns: dict[str, NDArray]
    step_degC: float
    sees_the_unit: bool  # block and accelerometer thermometers are logged too


def healthy(
    seed: int, *, step_degC: float | None = None
) -> tuple[Thermometers, np.random.Generator]:
    """A healthy unit; two of three also log the block and the accelerometers."""
    rng = np.random.default_rng([seed, 4])
    history = thermal_history(list(STARTS)[seed % len(STARTS)], rng=rng)
    time_s = np.arange(0.0, rng.choice([1800.0, HOUR_S, 7200.0]), rng.choice([0.5, 1.0, 1.0, 10.0]))
    drawn = float(rng.choice([0.0, 0.01, 0.1, 0.5, 1.0]))
    step, noise = drawn if step_degC is None else step_degC, rng.choice([0.002, 0.01, 0.05])
    true = history.at(time_s)

    def read(T: NDArray) -> NDArray:
        noisy = T + noise * rng.standard_normal(T.shape)
        return step * np.round(noisy / step) if step else noisy

    columns = {f"gyro_{a}_degC": read(true.gyro_degC[:, k]) for k, a in enumerate(AXES)}
    if seed % 3:
        columns["block_degC"] = read(true.block_degC)
        columns |= {f"accel_{a}_degC": read(true.accel_degC[:, k]) for k, a in enumerate(AXES)}
        columns["ambient_degC"] = read(true.ambient_degC)
    return Thermometers(time_s, columns, step, bool(seed % 3)), rng


def with_fault(
    fault: str, unit: Thermometers, rng: np.random.Generator
) -> tuple[Thermometers, str]:
    """The unit with one fault, on one random gyro or on all; the column that has it."""
    n, name = unit.time_s.size, f"gyro_{rng.choice(list(AXES))}_degC"
    columns, time_s = dict(unit.columns), unit.time_s
    a = int(rng.integers(20, n - 60))
    sign = rng.choice([-1.0, 1.0])
    if fault.endswith(", all gyros"):
        for axis in AXES:
            columns[f"gyro_{axis}_degC"] = SCALES[fault.removesuffix(", all gyros")](
                unit.columns[f"gyro_{axis}_degC"]
            )
        return Thermometers(time_s, columns, unit.step_degC, unit.sees_the_unit), name
    if fault == "hole of 300 s":
        a = int(rng.integers(20, np.searchsorted(time_s, time_s[-1] - 400.0)))
        kept = (time_s < time_s[a]) | (time_s > time_s[a] + 300.0)
        cut = {k: c[kept] for k, c in columns.items()}
        return Thermometers(time_s[kept], cut, unit.step_degC, unit.sees_the_unit), "temperature"
    columns[name] = _spoilt(fault, unit.columns[name].copy(), rng, a, sign)
    return Thermometers(time_s, columns, unit.step_degC, unit.sees_the_unit), name


def _spoilt(fault: str, v: NDArray, rng: np.random.Generator, a: int, sign: float) -> NDArray:
    """Readings of one thermometer with a fault that begins at row `a`."""
    n = v.size
    if fault in SCALES:
        v = SCALES[fault](v)
    elif fault == "stuck from the start":
        v[:] = v[0]
    elif fault == "stuck for a span":
        v[n // 4 + a // 4 : n // 4 + a // 4 + n // 3] = v[n // 4 + a // 4]
    elif fault == "absent":
        v[:] = np.nan
    elif fault == "jump that stays":
        v[a:] += sign * rng.uniform(3.0, 20.0)
    elif fault == "jump and back":
        v[a : a + int(rng.integers(8, 40))] += sign * rng.uniform(4.0, 20.0)
    elif fault == "zeros scattered":
        v[rng.choice(n, int(rng.integers(1, 30)), replace=False)] = 0.0
    elif fault == "zeros in a burst":
        v[a : a + int(rng.integers(5, 60))] = 0.0
    elif fault == "zero throughout":
        v[:] = 0.0
    return v


def matters(fault: str, before: Thermometers, after: Thermometers, name: str) -> bool:
    """Does the fault move any reading by more than a healthy thermometer's own step hides?"""
    if fault in ("absent", "hole of 300 s", "steps of 1 degC"):
        return True
    moved = np.abs(after.columns[name] - before.columns[name])
    return bool(np.max(moved) > UNSEEN_degC + 2.0 * before.step_degC)


def found_rates(fault: str, runs: int) -> tuple[int, int, int]:
    """Runs where the fault matters, in which it is found, and in which a healthy gyro is blamed."""
    total = found = blamed = 0
    for seed in range(runs):
        before, rng = healthy(seed, step_degC=1.0 if fault == "steps of 1 degC" else None)
        after, name = (
            (before, "gyro_x_degC")
            if fault == "steps of 1 degC"
            else with_fault(fault, before, rng)
        )
        if not matters(fault, before, after, name):
            continue
        faults = check_thermometers(after.time_s, after.columns).faults
        coarse = fault == "steps of 1 degC"
        seen = [f for f in faults if (f.kind == "coarse") == coarse]
        total += 1
        found += any(f.column == name for f in seen)
        others = {f.column for f in seen if f.column.startswith("gyro_")} - {name}
        blamed += bool(others) and not coarse and not fault.endswith("all gyros")
    return total, found, blamed


def false_alarms(runs: int) -> int:
    """Healthy runs in which anything but coarse steps is said of a thermometer."""
    alarms = 0
    for seed in range(runs):
        unit, _ = healthy(seed)
        alarms += any(
            f.kind != "coarse" for f in check_thermometers(unit.time_s, unit.columns).faults
        )
    return alarms


@dataclass(frozen=True)
class RateError:
    """RMS error of dT/dt over the run and its three gyros, as a share of the true RMS rate; and the
    sigmas' honesty.
    """

    ours: float
    moving_average: float
    normalised: float  # mean square of (temperature - true) / sigma over five-minute means


def rate_error(seed: int, *, step_degC: float = 0.1, noise_degC: float = 0.01) -> RateError:
    """A 70 min run of a thermometer with steps, 1 Hz, against truth."""
    rng = np.random.default_rng([seed, 41])
    time_s = np.arange(HOUR_S)
    true = thermal_history(list(STARTS)[seed % len(STARTS)], rng=rng).at(time_s).gyro_degC
    rate = 60.0 * np.gradient(true, time_s, axis=0)
    read = step_degC * np.round((true + noise_degC * rng.standard_normal(true.shape)) / step_degC)
    found = gyro_temperature(TemperatureLog(time_s=time_s, gyro_degC=read))
    ours = np.stack([np.interp(time_s, found.time_s, r) for r in found.rate_degC_min.T], axis=1)
    pad = np.pad(read, ((WINDOW_S // 2, WINDOW_S // 2), (0, 0)), mode="edge")
    total = np.cumsum(np.vstack([np.zeros(3), pad]), axis=0)
    mean = (total[WINDOW_S:] - total[:-WINDOW_S]) / WINDOW_S
    moving = 60.0 * np.gradient(mean, time_s, axis=0)
    size = np.sqrt(np.mean(rate**2))
    return RateError(
        float(np.sqrt(np.mean((ours - rate) ** 2)) / size),
        float(np.sqrt(np.mean((moving - rate) ** 2)) / size),
        _normalised(found, time_s, true),
    )


def _normalised(found: GyroTemperature, time_s: NDArray, true: NDArray) -> float:
    edges = np.linspace(time_s[0], time_s[-1], 15)
    sigma2 = np.diagonal(found.of_bins(edges).covariance, axis1=1, axis2=2).T
    mean = np.stack([np.interp(found.time_s, time_s, T) for T in true.T], axis=1)
    W = np.stack([found.mean_rows(a, b) for a, b in pairwise(edges)])
    return float(np.mean((W @ (found.temperature_degC - mean)) ** 2 / sigma2))
