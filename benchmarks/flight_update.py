"""What a flight is worth to the table, and whether its sigmas are right: simulated sessions that
park, taxi, fly two hours, land, taxi and park, each with a unit, a receiver and nuisances of its
own.

The unit is drawn as in the study of recalibration (a MEMS unit from a blank table's prior), the
nuisances of the flight from the priors that the update names (`SessionSettings.flight`); what is
simulated is the simulator's own (`trajectories`). Temperatures at the gyros: 8 degC at power-on, 26
before take-off, -17 at the end of the cruise.
"""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.flight_errors import ZERO, FlightErrors, Triple, with_flight_errors
from benchmarks.study import Record, Work, rms, table
from infield.session.estimate import SessionEstimate
from infield.session.log import table_series
from infield.session.one_run import take_run
from infield.session.reasons import FlightReason
from infield.session.results import SessionResult
from infield.session.settings import SessionSettings
from infield.table.file import table_from_dict, table_to_dict
from infield.table.thermal_table import ThermalTable, default_table
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.records import AXES, GyroNoise, Site, TwinModel
from ins.twin_file import default_twin
from ins.units import ARCSEC, DEG
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Descend,
    Landing,
    Park,
    Segment,
    Stop,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import ThermalHistory
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import UnitTruth, aged_unit

RATE_HZ = 20.0
WHEELS_M, ANTENNA_M = (-6.0, 0.3, 2.0), (1.5, -0.4, -1.8)
NODES_DEGC = np.arange(-30.0, 51.0, 10.0)
HEADINGS_DEG, LATITUDES_DEG = (20.0, 110.0, 245.0, 320.0), (45.0, 30.0, 55.0, -40.0)
FLIGHTS_OF_A_PLACE = 10  # simulated in turn from one place and heading
# of a blank MEMS table: 70 % of the variance common, 30 % smooth (formats.md, section 2)
MEMS_SIGMA_DEG_H, COMMON_SHARE = 30.0, 0.7
WITHIN_SIGMAS = 4.0  # of a committed node: beyond, it is confident and wrong
TAKE_OFF_S = 2250.0  # about; the cold of the cruise begins
SPANS = ("session", "parked", "flight")
HEAD = ("mean biases over", "error over sigma", "of gyros x, y, z", "NEES", "RMS, deg/h")
THERMAL = ThermalHistory(
    ambient_degC=8.0,
    start_degC=8.0,
    settled_degC=30.0,
    flight_degC=-58.0,
    flight_start_s=TAKE_OFF_S + 300.0,
    flight_end_s=TAKE_OFF_S + 5000.0,
    flight_tau_s=2400.0,
)
GROUND: tuple[Segment, ...] = (
    Park(duration_s=1800.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=120.0),
    Stop(duration_s=45.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=100.0),
    Turn(angle_deg=-90.0),
    Straight(duration_s=30.0, speed_m_s=5.0),
)
HOLDING: tuple[Segment, ...] = (TurnFlight(angle_deg=180.0), Cruise(duration_s=90.0)) * 4
FLIGHT: tuple[Segment, ...] = (
    TakeOff(),
    Climb(height_m=9000.0, rate_m_s=10.0, speed_m_s=180.0),
    TurnFlight(angle_deg=60.0),
    Cruise(duration_s=1500.0, speed_m_s=210.0),
    TurnFlight(angle_deg=-80.0),
    Cruise(duration_s=1200.0),
    TurnFlight(angle_deg=-45.0),
    Cruise(duration_s=900.0),
    Descend(height_m=3000.0, rate_m_s=8.0, speed_m_s=120.0),
    *HOLDING,
    Descend(height_m=500.0, rate_m_s=6.0, speed_m_s=90.0),
    TurnFlight(angle_deg=90.0),
    Cruise(duration_s=60.0),
    Landing(),
)
AFTER: tuple[Segment, ...] = (
    Straight(duration_s=60.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=60.0),
    Stop(duration_s=20.0),
    Park(duration_s=900.0),
)


UP: tuple[Segment, ...] = (TakeOff(), Climb(height_m=9000.0, rate_m_s=10.0, speed_m_s=180.0))
DOWN: tuple[Segment, ...] = (
    Descend(height_m=500.0, rate_m_s=8.0, speed_m_s=90.0),
    Cruise(duration_s=30.0),
    Landing(),
)


def cruise(duration_s: float) -> Cruise:
    return Cruise(duration_s=duration_s, speed_m_s=210.0)


@lru_cache(maxsize=8)
def ideal_session(
    place: int, rate_hz: float = RATE_HZ, flight: tuple[Segment, ...] = FLIGHT
) -> IdealSensors:
    """The noise-free session from one of the places and headings, any flight between its taxis."""
    k = place % len(HEADINGS_DEG)
    truth = build_truth(
        lay([*GROUND, *flight, *AFTER]),
        Site(lat_rad=LATITUDES_DEG[k] * DEG, lon_rad=7.0 * DEG, height_m=250.0),
        heading_rad=HEADINGS_DEG[k] * DEG,
        roll_rad=0.0,
        pitch_rad=0.0,
        wheel_reference_m=WHEELS_M,
    )
    return ideal_sensors(truth, rate_hz)


@dataclass(frozen=True)
class Drawn:
    """A simulated session, its unit, its table and what the update believes of it."""

    simulated: SimulatedRun
    unit: UnitTruth
    table: ThermalTable
    twin: TwinModel


def triple(rng: np.random.Generator, sigma: float) -> Triple:
    x, y, z = sigma * rng.standard_normal(3)
    return float(x), float(y), float(z)


def drawn_errors(rng: np.random.Generator, technology: str) -> FlightErrors:
    """Nuisances of a flight, from the priors that the update names."""
    p = SessionSettings().flight
    force = p.force_deg_h_g[technology]
    return FlightErrors(
        slow_position_m=p.slow_position_m,
        slow_position_s=p.slow_position_s,
        slow_velocity_m_s=p.slow_velocity_m_s,
        slow_velocity_s=p.slow_velocity_s,
        deflection_arcsec=p.deflection_rad / ARCSEC,
        deflection_m=p.deflection_m,
        accel_scale_ppm=triple(rng, p.accel_scale_ppm[technology]),
        accel_slope_ug_degC=triple(rng, p.accel_slope_ug_degC[technology]),
        accel_shift_ug=triple(rng, p.accel_shift_ug[technology]),
        gyro_shift_deg_h=triple(rng, p.shift_deg_h[technology]),
        gyro_force_deg_h_g=triple(rng, force) if force else ZERO,
    )


def drawn_gyro(rng: np.random.Generator, gyro: GyroNoise, technology: str) -> GyroNoise:
    """The gyros of a unit: scale and misalignment that its twin does not know."""
    settings = SessionSettings()
    scale = triple(rng, settings.sigma_scale_factor_ppm[technology])
    mrad = settings.flight.misalignment_mrad[technology]
    first, second = triple(rng, mrad), triple(rng, mrad)
    return replace(gyro, scale_factor_ppm=scale, misalignment_mrad=(*first, *second))


def drawn_unit(rng: np.random.Generator, technology: str) -> UnitTruth:
    """A unit and its ageing. A MEMS unit is drawn from a blank table's prior: between nodes 10 degC
    apart the random curve of such a unit is off by 0.2 deg/h, 30 times what its table would say.
    """
    if technology != "mems":
        return aged_unit(rng, gyro_technology=technology)
    blank = default_table(
        imu_serial="SN-0042",
        gyro_technology=technology,
        created_utc="2026-01-01T00:00:00Z",
        sigma_deg_h=MEMS_SIGMA_DEG_H,
    )
    return aged_unit(
        rng,
        gyro_technology=technology,
        table=table_to_dict(blank),
        ageing_offset_deg_h=MEMS_SIGMA_DEG_H * np.sqrt(COMMON_SHARE),
        ageing_shape_deg_h=MEMS_SIGMA_DEG_H * np.sqrt(1.0 - COMMON_SHARE),
    )


def drawn_session(
    seed: int, technology: str, *, rate_hz: float = RATE_HZ, flight: tuple[Segment, ...] = FLIGHT
) -> Drawn:
    """One flight of one unit; flight: between the taxis, empty: none."""
    rng = np.random.default_rng([17, seed])
    twin = default_twin(technology)
    unit = drawn_unit(rng, technology)
    ideal = ideal_session(seed // FLIGHTS_OF_A_PLACE, rate_hz, flight)
    truth = replace(twin, gyro=drawn_gyro(rng, twin.gyro, technology))
    plan = SessionPlan(with_gnss=True, gnss_lever_arm_m=ANTENNA_M, run_id=f"flight-{seed}")
    errors = drawn_errors(rng, technology)
    simulated = simulate_run(ideal, THERMAL, unit, truth, rng=rng, plan=plan)
    simulated = with_flight_errors(simulated, ideal, errors, rng)
    table = table_from_dict(unit.factory_table(NODES_DEGC), name="factory table")
    return Drawn(simulated, unit, table, twin)


def bin_errors(drawn: Drawn, estimate: SessionEstimate, T: GyroTemperature) -> NDArray:
    """Estimate less truth (N, 3) [deg/h] of the bins' mean biases beyond the table."""
    simulated, bins = drawn.simulated, estimate.bins
    low, high = float(T.temperature_degC.min()), float(T.temperature_degC.max())
    of_table = table_series(drawn.table.extended_to(low, high), T)
    time_s = simulated.bias_time_s
    true = simulated.gyro_bias_true_deg_h - of_table(time_s)
    means = [
        true[(time_s >= a) & (time_s < b)].mean(axis=0) for a, b in zip(bins.start_s, bins.end_s)
    ]
    return estimate.mean_deg_h.reshape(-1, 3) - np.array(means)


def mean_rows(estimate: SessionEstimate, start_s: float, end_s: float) -> NDArray:
    """Rows (3, 3N) that average the bins of each axis between two times."""
    bins = estimate.bins
    inside = (bins.start_s >= start_s) & (bins.end_s <= end_s)
    weight = bins.duration_s * inside / float(np.sum(bins.duration_s * inside))
    rows = np.zeros((3, estimate.mean_deg_h.size))
    for axis in range(3):
        rows[axis, axis::3] = weight
    return rows


def node_errors(drawn: Drawn, result: SessionResult) -> tuple[NDArray, NDArray, NDArray]:
    """Errors of the table after the session (m,), its sigmas and what the errors were before, at
    the temperatures of the session, five degrees apart [deg/h].
    """
    assert result.temperature is not None
    T = result.temperature.temperature_degC
    after = drawn.table if result.merged is None else result.merged.table
    found: list[tuple[float, float, float]] = []
    for k, axis in enumerate(AXES):
        at = np.arange(np.ceil(T[:, k].min()), T[:, k].max(), 5.0)
        true = drawn.unit.bias_deg_h(axis, at)
        before = drawn.table.bias_deg_h(k, at) - true
        error, sigma = after.bias_deg_h(k, at) - true, after.sigma_deg_h(k, at)
        found += list(zip(error.tolist(), sigma.tolist(), before.tolist()))
    error, sigma, before = np.array(found).T
    return error, sigma, before


Line = Mapping[str, object]


def scored(seed: int, drawn: Drawn) -> Line:
    """One flight's line: errors over sigma, table before and after, CPU."""
    began = time.process_time()
    run, settings = drawn.simulated.run, SessionSettings()
    result = take_run(run, drawn.table, drawn.twin, settings, False)
    cpu_s = time.process_time() - began
    flight = result.flight
    line: dict[str, object] = {
        "seed": seed,
        "outcome": result.verdict.outcome.value,
        "joined": flight is not None and flight.joined is not None,
        "reasons": [reason.code.value for reason in result.verdict.reasons],
        "notes": [] if flight is None else [reason.code.value for reason in flight.notes],
        "left_out": [] if flight is None else [reason.code.value for reason in flight.reasons],
        "cpu_s": cpu_s,
    }
    for note in () if flight is None else flight.notes:
        if note.code is FlightReason.DEFLECTED:
            line["deflected"] = dict(note.values)
    if result.estimate is None or result.temperature is None or flight is None:
        return line
    estimate = result.estimate
    error = bin_errors(drawn, estimate, result.temperature).ravel()
    spans = {
        "session": (-np.inf, np.inf),
        "parked": (-np.inf, flight.flight.start_s),
        "flight": (flight.flight.start_s, flight.flight.end_s),
    }
    for name, span in spans.items():
        if not ((estimate.bins.start_s >= span[0]) & (estimate.bins.end_s <= span[1])).any():
            continue
        rows = mean_rows(estimate, *span)
        P = rows @ estimate.covariance @ rows.T
        line[f"{name}_error"] = (rows @ error).tolist()
        line[f"{name}_covariance"] = P.tolist()
    nodes, sigma, before = node_errors(drawn, result)
    line |= {
        "nodes_rms": float(np.sqrt(np.mean(nodes**2))),
        "nodes_sigma_rms": float(np.sqrt(np.mean(sigma**2))),
        "nodes_before_rms": float(np.sqrt(np.mean(before**2))),
        "nodes_worst_sigmas": float(np.max(np.abs(nodes) / sigma)),
    }
    if estimate.solution is not None:  # a unit that finds its heading at rest
        tally = estimate.navigated.filter.tally
        line |= {
            "nis": {kind: tally.nis[kind] / tally.dof[kind] for kind in tally.nis},
            "heading_sigma_mrad": 1e3 * estimate.sigma_heading_rad,
            "heading_sigma_before_mrad": 1e3 * flight.heading_before_rad,
        }
    return line


def one(technology: str, seed: int) -> Line:
    return scored(seed, drawn_session(seed, technology))


def run(work: Work, *, technology: str = "rlg", flights: int = 40, first: int = 0) -> str:
    lines = work.each(one, [(technology, seed) for seed in range(first, first + flights)])
    return told(lines)


def summary(paths: Sequence[Path]) -> None:
    """Print what the lines of some files say together."""
    print(told([json.loads(text) for path in paths for text in path.read_text().splitlines()]))


def told(lines: Sequence[Record]) -> str:
    """What lines of flights say together: errors over sigma of mean biases over some spans."""
    if any("hostile" in line for line in lines):
        return _of_hostile(lines)
    joined = [line for line in lines if line["joined"]]
    rows = [
        row(span, joined) for span in SPANS if joined and all(f"{span}_error" in r for r in joined)
    ]
    words = [f"{len(lines)} flights, {len(joined)} joined"]
    for key in ("nodes_before_rms", "nodes_rms", "nodes_sigma_rms") if joined else ():
        words.append(f"{key} {rms([line[key] for line in joined]):.5f} deg/h")
    worst = max((line["nodes_worst_sigmas"] for line in joined), default=0.0)
    words.append(f"worst node {worst:.2f} sigmas")
    words.append(f"CPU {np.median([line['cpu_s'] for line in lines]):.1f} s")
    for line in lines:
        if not line["joined"] or line["outcome"] != "accepted":
            why = ", ".join([*line["reasons"], *line["left_out"]])
            words.append(f"seed {line['seed']}: {line['outcome']} ({why})")
    return table(HEAD, rows) + "\n" + "".join(f"- {word}\n" for word in words)


def row(span: str, lines: Sequence[Record]) -> list[str]:
    error = np.array([line[f"{span}_error"] for line in lines])
    P = np.array([line[f"{span}_covariance"] for line in lines])
    z = error / np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(P), error) / 3.0
    axes = ", ".join(f"{v:.2f}" for v in np.sqrt(np.mean(z**2, axis=0)))
    each = ", ".join(f"{v:.5f}" for v in np.sqrt(np.mean(error**2, axis=0)))
    over = f"{rms(z):.3f} +- {np.sqrt(0.5 / z.size):.3f}"
    return [span, over, axes, f"{nees.mean():.3f}", each]


def _of_hostile(lines: Sequence[Record]) -> str:
    rows = []
    for name in dict.fromkeys(line["hostile"] for line in lines):
        of = [line for line in lines if line["hostile"] == name]
        accepted = [line for line in of if line["outcome"] == "accepted"]
        worst = [line["nodes_worst_sigmas"] for line in accepted]
        wrong = sum(w > WITHIN_SIGMAS for w in worst)
        flown = sum(line["joined"] for line in accepted)
        rows.append([name, len(of), len(accepted), flown, wrong, f"{max(worst, default=0.0):.1f}"])
    head = ("hostile", "flights", "merged", "with the flight", "wrong", "worst node, sigmas")
    return table(head, rows)
