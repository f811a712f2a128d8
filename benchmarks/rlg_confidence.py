"""Are the sigmas of the ring-laser terms right where the data hold less than the model asks: lines
that go with the rate, thermometers that read late?

Minute means from a truth written apart from the fit (tests/infield/gradient_cases.py), the readings
of thermometers and lines then made late by a first-order lag in steps of a second.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.study import Work, table
from infield.thermal.gradient_runs import GradientRun
from infield.thermal.rlg.fit import AxisModel
from infield.thermal.rlg.gradients import fit_gradients
from infield.thermal.rlg.terms import TERMS
from ins.records import AXES
from tests.infield.gradient_cases import SIDES, TWIN, Unit, case

STEPS = 60  # of a minute, for the lag
SCORED = ("K2", "K4", "K6x", "K6y", "K6z")


def late(values: NDArray, lag_s: float) -> NDArray:
    """Readings (n, 3), minute by minute, of thermometers that follow with a lag."""
    if not lag_s:
        return values
    minutes = np.arange(len(values), dtype=float)
    fine = np.arange(0.0, minutes[-1] + 1e-9, 1.0 / STEPS)
    out = np.empty_like(values)
    keep = np.exp(-60.0 / STEPS / lag_s)
    for k in range(values.shape[1]):
        true = np.interp(fine, minutes, values[:, k])
        reading, read = true[0], np.empty_like(true)
        for i, value in enumerate(true):
            reading = value + (reading - value) * keep
            read[i] = reading
        out[:, k] = read[::STEPS]
    return out


def read_late(run: GradientRun, gyros_s: float, lines_s: float) -> GradientRun:
    """The run as late thermometers tell it; the bias is what it was."""
    T = late(run.blocks.temperature_degC, gyros_s)
    blocks = replace(run.blocks, temperature_degC=T, rate_degC_min=np.gradient(T, axis=0))
    return replace(run, blocks=blocks, gradient_degC=late(run.gradient_degC, lines_s))


def heated(rng: np.random.Generator, unit: Unit, sides: int) -> list[GradientRun]:
    """Days in the chamber, each heated from another side; sides 0: two without a heater."""
    if not sides:
        rate = rng.uniform(0.6, 1.4)
        return [case(rng, unit, heater=0.0, rate=r, run_id=f"{r:.2f}") for r in (rate, 0.6 * rate)]
    rates, periods = (0.8, 1.2, 1.0), (90, 75, 105)
    return [
        case(rng, unit, run_id=f"day-{k}", side=SIDES[k], rate=rates[k], period=periods[k])
        for k in range(sides)
    ]


CASES = {
    "three sides heated": (3, 0.0, 0.0),
    "no heater": (0, 0.0, 0.0),
    "one side heated": (1, 0.0, 0.0),
    "two sides heated": (2, 0.0, 0.0),
    "three sides, gyro thermometers 60 s late": (3, 60.0, 0.0),
    "three sides, gyro thermometers 180 s late": (3, 180.0, 0.0),
    "three sides, gyro thermometers 600 s late": (3, 600.0, 0.0),
    "three sides, all 180 s late": (3, 180.0, 180.0),
    "three sides, all 600 s late": (3, 600.0, 600.0),
    "no heater, gyro thermometers 180 s late": (0, 180.0, 0.0),
}


def scores(name: str, units: int) -> dict[str, list[float]]:
    """Normalised errors by term, of the terms in use."""
    sides, gyros_s, lines_s = CASES[name]
    found: dict[str, list[float]] = {term: [] for term in SCORED}
    found["lag"] = []
    for seed in range(units):
        rng = np.random.default_rng([seed, 91])
        unit = Unit(rng, wave=0.003)
        runs = [read_late(run, gyros_s, lines_s) for run in heated(rng, unit, sides)]
        study = fit_gradients(runs, TWIN)
        for a in study.axes:
            _score(a, unit, study.reference_degC, found)
            if gyros_s:
                found["lag"].append((a.lag.gyro_s - gyros_s) / a.lag.sigma_gyro_s)
    return found


def _score(a: AxisModel, unit: Unit, reference: float, found: dict[str, list[float]]) -> None:
    truth = unit.terms(AXES.index(a.axis), reference)
    for term in SCORED:
        k = TERMS.index(term)
        if term in a.used:
            found[term].append(float((a.theta[k] - truth[k]) / a.sigma[k]))


def row(name: str, found: dict[str, list[float]]) -> list[str]:
    """Mean squared normalised errors, worst of all, the share of a two-sided test at 99 %."""
    cells = []
    for term in (*SCORED, "lag"):
        z = np.array(found[term])
        if not z.size:
            cells.append("-")
            continue
        low, high = chi2.ppf([0.005, 0.995], z.size) / z.size
        mean = float(np.mean(z**2))
        cells.append(f"{mean:.2f} ({'' if low < mean < high else '!'}{z.size})")
    worst = max((np.max(np.abs(z)) for z in found.values() if z), default=0.0)
    return [name, *cells, f"{worst:.1f}"]


def run(work: Work, *, units: int = 40) -> str:
    found = work.each(scores, [(name, units) for name in CASES])
    head = ("case", *SCORED, "lag", "worst")
    return table(head, [row(name, one) for name, one in zip(CASES, found)])
