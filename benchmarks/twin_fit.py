"""Twins fitted to simulated parked hours whose noise is known: coverage, errors against the bound.

Each hour is simulated at 100 Hz, its sizes drawn by factors 0.3 to 3 about BASES; in one of three
somebody boards, ring-laser gyros have a dither line. The bound is Whittle's integral at the truth,
written here apart from the fit.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

import recal
from benchmarks.study import Work, rms, table
from ins.records import Site, TwinModel
from ins.twin_file import default_twin
from ins.units import (
    ARCSEC,
    DEG,
    DEG_PER_HOUR,
    DEG_PER_HOUR_SQRT_HOUR,
    DEG_PER_SQRT_HOUR,
    HOUR,
    MICRO_G,
    MICRO_G_PER_SQRT_HOUR,
)
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit
from trajectories.simulator.vehicle import Boarding

RATE_HZ, PARKED_S = 100.0, HOUR
ROLL_RAD, PITCH_RAD = 0.01, -0.02
HISTORY = thermal_history("ambient")
BLOCK_S = 20.0  # of the contrasts from which the bound takes what no noise can be told from
FACTOR = 3.0
BASES = {"rlg": 1.0, "fog": 5.0, "mems": 1.0}  # times the default gyro of the technology
QUANTA = (0.5, 3.0)  # over the white noise of a row
LINE_HZ, LINE_RAD_S = 31.7, 3e-5
TOLD_SIGMA = 0.5  # of a log variance by the bound: a parameter that an hour tells
UNTOLD_SIGMA = 1.0  # a parameter that it does not
UNITS = {
    "gyro.arw_deg_sqrt_h": DEG_PER_SQRT_HOUR,
    "gyro.quantization_rad": 1.0 / np.sqrt(12.0),
    "gyro.bias_instability_deg_h": DEG_PER_HOUR,
    "gyro.rate_random_walk_deg_h_sqrt_h": DEG_PER_HOUR_SQRT_HOUR,
    "vehicle.yaw_creep_arcsec_sqrt_h": ARCSEC / np.sqrt(HOUR),
    "accel.vrw_ug_sqrt_hz": MICRO_G,
    "accel.bias_instability_ug": MICRO_G,
    "accel.rate_random_walk_ug_sqrt_h": MICRO_G_PER_SQRT_HOUR,
    "vehicle.sway_m_s": 1.0,
}
HEAD = ("unit", "parameter", "hours that tell it", "in the 95 % interval")
HEAD += ("of those that the fit calls told", "RMS error", "over the bound")
HEAD += ("called told where the bound says not",)
GYRO_NAMES, ACCEL_NAMES = list(UNITS)[:5], list(UNITS)[5:]


@lru_cache(maxsize=1)
def _ideal() -> IdealSensors:
    site = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
    truth = build_truth(
        lay((Park(duration_s=PARKED_S),)),
        site,
        heading_rad=0.6,
        roll_rad=ROLL_RAD,
        pitch_rad=PITCH_RAD,
    )
    return ideal_sensors(truth, RATE_HZ)


def parked_hour(technology: str) -> IdealSensors:
    """The noise-free hour of a unit; gyros of a ring laser have a dither."""
    return _dithered() if technology == "rlg" else _ideal()


@lru_cache(maxsize=1)
def _dithered() -> IdealSensors:
    """The same on gyros that a dither swings, before they count."""
    ideal = _ideal()
    swing = LINE_RAD_S / RATE_HZ * np.sin(2.0 * np.pi * LINE_HZ * ideal.time_s)
    return replace(ideal, dtheta_rad=ideal.dtheta_rad + swing[:, None])


def drawn_twin(
    technology: str, rng: np.random.Generator, quanta: Sequence[float] = QUANTA
) -> TwinModel:
    """A twin whose sizes are off the technology's by factors to FACTOR either way."""
    twin = default_twin(technology)

    def off(value: float) -> float:
        return float(value * np.exp(rng.uniform(-1.0, 1.0) * np.log(FACTOR)))

    base = BASES[technology]
    low, high = np.log(quanta)
    arw = off(base * twin.gyro.arw_deg_sqrt_h)
    row_rad = arw * DEG_PER_SQRT_HOUR / np.sqrt(RATE_HZ)
    gyro = replace(
        twin.gyro,
        arw_deg_sqrt_h=arw,
        bias_instability_deg_h=off(base * twin.gyro.bias_instability_deg_h),
        rate_random_walk_deg_h_sqrt_h=off(base * twin.gyro.rate_random_walk_deg_h_sqrt_h),
        quantization_rad=float(row_rad * np.exp(rng.uniform(low, high))),
    )
    accel = replace(
        twin.accel,
        vrw_ug_sqrt_hz=off(twin.accel.vrw_ug_sqrt_hz),
        bias_instability_ug=off(twin.accel.bias_instability_ug),
        rate_random_walk_ug_sqrt_h=off(twin.accel.rate_random_walk_ug_sqrt_h),
    )
    vehicle = replace(
        twin.vehicle,
        sway_m_s=off(twin.vehicle.sway_m_s),
        sway_hz=off(twin.vehicle.sway_hz),
        yaw_creep_arcsec_sqrt_h=off(twin.vehicle.yaw_creep_arcsec_sqrt_h),
    )
    return replace(twin, gyro=gyro, accel=accel, vehicle=vehicle)


def one_hour(technology: str, seed: int, quanta: Sequence[float] = QUANTA) -> dict:
    """Truth, fit and bound of one hour."""
    rng = np.random.default_rng([seed, list(BASES).index(technology), 16])
    twin = drawn_twin(technology, rng, quanta)
    events = ()
    if seed % 3 == 0:
        events = (Boarding(time_s=float(rng.uniform(600.0, 3000.0)), roll_arcsec=20.0),)
    unit = aged_unit(rng, gyro_technology=technology)
    simulated = simulate_run(
        parked_hour(technology), HISTORY, unit, twin, rng=rng, plan=SessionPlan(events=events)
    )
    run = simulated.run
    began = time.process_time()
    fitted = recal.fit_twin(run)
    cpu_s = time.process_time() - began
    found = {p.name: [p.value, p.sigma, p.low, p.high, p.identified] for p in fitted.parameters}
    truth = {n: getattr(getattr(twin, n.split(".")[0]), n.split(".")[1]) for n in UNITS}
    return {
        "technology": technology,
        "seed": seed,
        "cpu_s": cpu_s,
        "boarded": bool(events),
        "truth": truth,
        "found": {n: found[n] for n in UNITS if n in found},
        "lines": [line.frequency_hz for line in fitted.record.lines],
        "bound": bounds(twin, [event.time_s for event in events]),
    }


def bounds(twin: TwinModel, steps_s: Sequence[float] = ()) -> dict[str, float]:
    """Cramer-Rao bound on the sigma of each log variance, by Whittle's integral over a parked hour
    of three axes; sway has its shape beside it.

    Below the half of 1 / BLOCK_S it is a sum over slow contrasts, less what no noise can be told
    from: a level before and after each step, the bias against temperature. The vertical
    accelerometer feels 5e-4 of the sway (the unit is tilted), but the level ones tell that part to
    within their own noise: of all three together its spectrum is its own noise.
    """
    slow_hz = np.arange(1, round(PARKED_S / BLOCK_S)) / (2.0 * PARKED_S)
    fast_hz = np.geomspace(0.5 / BLOCK_S, 0.5 * RATE_HZ, 2000)
    slow, fast = (_axes(twin, f) for f in (slow_hz, fast_hz))
    df = np.gradient(fast_hz)
    found = {}
    for names, of_slow, of_fast in zip((GYRO_NAMES, ACCEL_NAMES), slow, fast):
        information = np.zeros((len(of_fast[0]), len(of_fast[0])))
        for axis, (below, above) in enumerate(zip(of_slow, of_fast)):
            relative = above / above[: len(names)].sum(axis=0)
            information += PARKED_S * (relative * df) @ relative.T
            information += _slow_information(below, len(names), _no_noise(axis, steps_s))
        covariance = np.linalg.pinv(information)
        found |= {n: float(np.sqrt(covariance[k, k])) for k, n in enumerate(names)}
    return found


def _axes(twin: TwinModel, f: NDArray) -> tuple[list[NDArray], list[NDArray]]:
    """Powers (terms, k) of each gyro's and each accelerometer's terms, then those that the sway
    would have for another frequency and damping.
    """
    v, w, dt = twin.vehicle, 2.0 * np.pi * f, 1.0 / RATE_HZ
    flicker, walk = 1.0 / (2.0 * np.pi * f), 1.0 / w**2
    ones, quantum = np.ones_like(f), 4.0 * np.sin(0.5 * w * dt) ** 2 / dt

    def swaying(hz: float, zeta: float) -> NDArray:
        at = 2.0 * np.pi * hz
        density = 4.0 * zeta * at * w**2 / ((at**2 - w**2) ** 2 + (2.0 * zeta * at * w) ** 2)
        return np.asarray(size("vehicle.sway_m_s") * density * quantum / dt)

    def size(name: str) -> float:
        section, key = name.split(".")
        return float((getattr(getattr(twin, section), key) * UNITS[name]) ** 2)

    shapes = dict(zip(GYRO_NAMES, (ones, quantum, flicker, walk, ones)))
    gyro = [size(n) * shapes[n] for n in GYRO_NAMES]
    level = [*gyro[:4], 0.0 * ones]
    sway = swaying(v.sway_hz, v.sway_damping)
    sway_w = swaying(1.001 * v.sway_hz, v.sway_damping)
    sway_z = swaying(v.sway_hz, 1.001 * v.sway_damping)
    still = [size(n) * s for n, s in zip(ACCEL_NAMES[:3], (ones, flicker, walk))]
    moved = [*still, sway, (sway_w - sway) / 1e-3, (sway_z - sway) / 1e-3]
    upright = [*still, *(0.0 * part for part in moved[3:])]
    gyros = [np.stack(axis) for axis in (level, level, gyro)]
    return gyros, [np.stack(axis) for axis in (moved, moved, upright)]


def _slow_information(parts: NDArray, count: int, X: NDArray) -> NDArray:
    """Fisher information of the parts (p, k), powers of cosines k, of which the first `count` make
    the noise, less regressors X (k, r): restricted likelihood.
    """
    inverse = np.diag(1.0 / parts[:count].sum(axis=0))
    told = inverse @ X
    P = inverse - told @ np.linalg.pinv(X.T @ told) @ told.T
    return np.asarray(0.5 * parts @ (P * P.T) @ parts.T)


def _no_noise(axis: int, steps_s: Sequence[float]) -> NDArray:
    """Cosines (k, r) of what is taken out of a gyro or an accelerometer of an axis."""
    middle = (np.arange(round(PARKED_S / BLOCK_S)) + 0.5) * BLOCK_S
    T = HISTORY.at(middle).gyro_degC[:, axis]
    u = (T - T.mean()) / np.ptp(T)
    columns = [u, u**2, u**3, np.gradient(T)]
    columns += [(middle > step).astype(float) for step in steps_s]
    return np.asarray(dct(np.stack(columns, axis=1), axis=0, norm="ortho")[1:])


def row(technology: str, name: str, own: list[dict]) -> list[str]:
    """Of a technology and a parameter: what an hour tells, and how well."""
    told = [h for h in own if h["bound"][name] < TOLD_SIGMA and name in h["found"]]
    untold = [h for h in own if h["bound"][name] > UNTOLD_SIGMA and name in h["found"]]
    wrong = sum(bool(h["found"][name][4]) for h in untold)
    head, called = [technology, f"`{name}`"], f"{wrong} of {len(untold)}"
    if not told:
        return [*head, f"0 of {len(own)}", *[""] * 4, called]
    true = np.array([h["truth"][name] for h in told])
    value, _, low, high, _ = np.array([h["found"][name] for h in told], dtype=float).T
    inside = int(np.sum((low <= true) & (true <= high)))
    error = np.log(np.maximum(value, 1e-6 * true) / true)
    bound = np.array([0.5 * h["bound"][name] for h in told])
    return [
        *head,
        f"{len(told)} of {len(own)}",
        f"{inside} of {len(told)} ({100 * inside / len(told):.0f} %)",
        _of_told(own, name),
        f"{100 * rms(error):.2g} %",
        f"{rms(error / bound):.2f}",
        called,
    ]


def _of_told(own: list[dict], name: str) -> str:
    """How many intervals hold the truth of all hours in which the fit, not the bound, told it."""
    told = [h for h in own if name in h["found"] and h["found"][name][4]]
    inside = [h["found"][name][2] <= h["truth"][name] <= h["found"][name][3] for h in told]
    return f"{sum(inside)} of {len(told)}"


def run(
    work: Work,
    *,
    technologies: tuple[str, ...] = tuple(BASES),
    hours: int = 23,
    first: int = 0,
    quanta: tuple[float, ...] = QUANTA,
) -> str:
    """quanta: least and largest, over the white noise of a row."""
    seeds = range(first, first + hours)
    asked = [(technology, seed, list(quanta)) for technology in technologies for seed in seeds]
    found = work.each(one_hour, asked)
    rows = []
    for technology in technologies:
        own = [h for h in found if h["technology"] == technology]
        rows += [row(technology, name, own) for name in UNITS]
    cpu_s = np.median([h["cpu_s"] for h in found])
    return table(HEAD, rows) + f"\n{len(found)} hours; CPU a fit {cpu_s:.1f} s (median).\n"
