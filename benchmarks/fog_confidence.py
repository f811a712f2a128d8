"""Are the sigmas of the fibre-optic coefficients right where the chamber or the coil does more than
the model says: hysteresis between up and down, a chamber whose control ripples, curves with knees?

Truth of its own: curves of tests/infield/ramp_cases.py or straight pieces between knees; hysteresis
by recursion over an exponential width; thermometer readings (noise and steps of 0.01 degC) read by
the program as in a log, rates and all.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.study import Work, table
from infield.thermal.fog.piecewise import piecewise_pair
from infield.thermal.fog.ramps import RampFit, RampStudy, separate
from infield.thermal.ramp_runs import RampRun, read_ramps
from infield.thermometer.causal_rate import causal_rates, time_constant_s
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import TemperatureLog
from tests.infield.ramp_cases import TWIN, Truth, flicker, ramp

HYSTERESIS_WIDTH_degC = 3.0
KNEES_degC = (-4.0, 14.0, 30.0)
READING_s = {False: 2.0, True: 10.0}  # between readings, of fast ramps and of slow ones
SCORED_degC = np.linspace(-18.0, 38.0, 12)


class Knees(Truth):
    """K_T of straight pieces with knees, K_delta as it was."""

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self.slopes = rng.choice([-1.0, 1.0], (3, 4)) * rng.uniform(0.003, 0.008, (3, 4))
        self.slopes[:, 1::2] = -self.slopes[:, ::2]

    def K_T(self, k: int, T: NDArray) -> NDArray:
        edges = np.r_[-60.0, KNEES_degC, 90.0]
        value = np.r_[0.0, np.cumsum(np.diff(edges) * self.slopes[k])]
        return np.interp(T, edges, value)


@dataclass(frozen=True)
class Way:
    """What the chamber and the coil do: hysteresis [deg/h], ripple amplitude [degC] and period [s],
    whether there is a slow ramp.
    """

    hysteresis_deg_h: float = 0.0
    ripple_degC: float = 0.0
    period_s: float = 480.0
    slow: bool = True
    knees: bool = False


CASES = {
    "plain": Way(),
    "hysteresis 0.005 deg/h": Way(hysteresis_deg_h=0.005),
    "hysteresis 0.02 deg/h": Way(hysteresis_deg_h=0.02),
    "hysteresis 0.05 deg/h": Way(hysteresis_deg_h=0.05),
    "ripple 0.3 degC in 8 min": Way(ripple_degC=0.3),
    "ripple 0.5 degC in 20 min": Way(ripple_degC=0.5, period_s=1200.0),
    "fast ramps alone": Way(slow=False),
    "fast ramps alone, hysteresis 0.003 deg/h": Way(slow=False, hysteresis_deg_h=0.003),
    "fast ramps alone, ripple 0.3 degC in 8 min": Way(slow=False, ripple_degC=0.3),
    "three knees in K_T": Way(knees=True),
}


def sense_of(T: NDArray) -> NDArray:
    """From -1 (cooling) to 1 (heating), forgotten over a width; starts at 0."""
    state, out = 0.0, np.empty_like(T)
    step = np.diff(T, prepend=T[0])
    for i, change in enumerate(step):
        keep = np.exp(-abs(change) / HYSTERESIS_WIDTH_degC)
        state = np.sign(change) + (state - np.sign(change)) * keep
        out[i] = state
    return out


def run_of(rng: np.random.Generator, truth: Truth, rate: float, way: Way) -> RampRun:
    """A run up and down as the program reads it; the bias by the true temperatures."""
    made = ramp(rng, truth, rates=(rate, -rate))
    slow = rate < 0.2
    end_s = float(made.time_s[-1]) + 30.0
    t = np.arange(0.0, end_s, 1.0)
    corner_s = np.r_[0.0, 0.5 * end_s, end_s]
    T = np.interp(t, corner_s, np.array([-20.0, 40.0, -20.0]))
    T = T + way.ripple_degC * np.sin(2 * np.pi * t / way.period_s)
    each = int(READING_s[slow])
    read = T[::each, None] + 0.01 * rng.standard_normal((t[::each].size, 3))
    log = TemperatureLog(time_s=t[::each], gyro_degC=np.round(read, 2))
    read_as = read_ramps(gyro_temperature(log), made.time_s)
    minute = made.time_s[:, None] + np.arange(-29.5, 30.0)
    mean_T = np.interp(minute.ravel(), t, T).reshape(minute.shape).mean(axis=1)
    rate_true = np.interp(made.time_s + 30.0, t, T) - np.interp(made.time_s - 30.0, t, T)
    bias = np.empty((made.time_s.size, 3))
    sense = np.interp(made.time_s, t, sense_of(T))
    n, g = made.time_s.size, TWIN.gyro
    for k in range(3):
        walk = np.cumsum(rng.standard_normal(n)) * g.rate_random_walk_deg_h_sqrt_h / np.sqrt(60.0)
        drift = walk + g.turn_on_deg_h * rng.standard_normal()
        drift = drift + flicker(rng, n, g.bias_instability_deg_h)
        bias[:, k] = truth.K_T(k, mean_T) + truth.K_delta(k, mean_T) * rate_true + drift
        bias[:, k] += way.hysteresis_deg_h * sense + made.sigma_deg_h[k] * rng.standard_normal(n)
    return replace(
        made,
        bias_deg_h=bias,
        temperature_degC=read_as.temperature_degC,
        rate_degC_min=read_as.rate_degC_min,
        rate_sigma_degC_min=read_as.rate_sigma_degC_min,
        legs=read_as.legs,
    )


def study_of(name: str, seed: int) -> tuple[Truth, RampStudy]:
    """A unit and what came of its ramps."""
    way, rng = CASES[name], np.random.default_rng([seed, 93])
    truth = Knees(rng) if way.knees else Truth(rng)
    rate = rng.uniform(0.5, 1.0)
    fast = run_of(rng, truth, rate, way)
    slow = [run_of(rng, truth, 0.1 * rate, way)] if way.slow else []
    return truth, separate([fast], slow, TWIN)


def scores(name: str, units: int) -> dict[str, list[float]]:
    """Normalised errors of both curves at temperatures apart, and of the hysteresis."""
    found: dict[str, list[float]] = {"K_delta": [], "K_T": [], "hysteresis": [], "knees": []}
    found["refused"], found["of three"] = [], []
    for seed in range(units):
        truth, study = study_of(name, seed)
        found["refused"].append(float(not study.axes))
        for k, a in enumerate(study.axes):
            _score(a, k, truth, CASES[name], found)
    return found


def _score(a: RampFit, k: int, truth: Truth, way: Way, found: dict[str, list[float]]) -> None:
    c, T = a.curves, a.curves.temperature_degC
    assert c.K_delta_covariance is not None and c.K_T_covariance is not None
    off = (c.K_delta - truth.K_delta(k, T)) / np.sqrt(np.diag(c.K_delta_covariance))
    found["K_delta"] += np.interp(SCORED_degC, T, off).tolist()
    centre = np.eye(T.size) - 1 / T.size
    shape = centre @ (c.K_T_deg_h - truth.K_T(k, T))
    sigma = np.sqrt(np.diag(centre @ c.K_T_covariance @ centre))
    found["K_T"] += np.interp(SCORED_degC, T, shape / sigma).tolist()
    hysteresis = getattr(a, "hysteresis", None)
    if hysteresis is not None and way.hysteresis_deg_h:
        found["hysteresis"].append(
            (hysteresis.value_deg_h - way.hysteresis_deg_h) / hysteresis.sigma_deg_h
        )
    if way.knees:
        marks = [b for b in piecewise_pair(a.reduced).K_T.breakpoints if b.called_for]
        inside = [any(b.low_degC <= knee <= b.high_degC for knee in KNEES_degC) for b in marks]
        found["knees"] += [float(yes) for yes in inside]
        found["of three"].append(float(sum(inside)))


def row(name: str, found: dict[str, list[float]]) -> list[str]:
    """Mean squared normalised errors and the worst; `!`: outside 99 % of chi-square, the twelve
    temperatures of one curve counted as four.
    """
    cells = []
    for what, share in (("K_delta", 1 / 3), ("K_T", 1 / 3), ("hysteresis", 1.0)):
        z = np.array(found[what])
        if not z.size:
            cells.append("-")
            continue
        dof = z.size * share
        low, high = chi2.ppf([0.005, 0.995], dof) / dof
        mean = float(np.mean(z**2))
        mark = "" if low < mean < high else "!"
        cells.append(f"{mean:.2f}{mark}, {np.max(np.abs(z)):.1f}")
    knees = "-"
    if found["knees"]:
        knees = f"{np.mean(found['knees']):.0%}; {np.mean(found['of three']):.1f}"
    return [name, *cells, knees, f"{np.mean(found['refused']):.0%}"]


def in_time() -> str:
    """What the rate leaves of K_delta dT/dt in minute means, over their noise: in real-time order
    with a time constant of 60 s, with the one that the thermometers allow, and smoothed.
    """
    rng = np.random.default_rng(97)
    rows = []
    t = np.arange(0.0, 7200.0)
    white = TWIN.gyro.arw_deg_sqrt_h * np.sqrt(60.0)
    for ripple, period in ((0.0, 480.0), (0.3, 480.0), (0.3, 1200.0)):
        T = 0.5 * t / 60.0 + ripple * np.sin(2 * np.pi * t / period)
        true = 0.5 + 60.0 * ripple * 2 * np.pi / period * np.cos(2 * np.pi * t / period)
        read = np.round(T[:, None] + 0.01 * rng.standard_normal((t.size, 3)), 2)
        smooth = gyro_temperature(TemperatureLog(time_s=t, gyro_degC=read))
        rates = [
            causal_rates(t, read)[1][:, 0],
            causal_rates(t, read, time_constant_s(t, read))[1][:, 0],
            np.interp(t, smooth.time_s, smooth.rate_degC_min[:, 0]),
        ]
        left = [0.3 * (rate - true)[600:].reshape(-1, 60).mean(axis=1) for rate in rates]
        over = [f"{np.hypot(1.0, np.std(one) / white):.2f}" for one in left]
        rows.append([f"{ripple:g} degC in {period / 60:g} min", *over])
    head = ("ripple, K_delta 0.3", "60 s", "as the thermometers allow", "smoothed")
    return table(head, rows)


def run(work: Work, *, units: int = 40) -> str:
    found = work.each(scores, [(name, units) for name in CASES])
    head = ("case", "K_delta", "K_T", "hysteresis", "breakpoints on a knee; of three", "refused")
    rows = [row(name, one) for name, one in zip(CASES, found)]
    return in_time() + "\n" + table(head, rows)
