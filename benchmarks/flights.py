"""Are the sigmas of a session that flies right, and are its faults seen? Blind flights
(`benchmarks.blind_flights`): parked, taxi, an hour in the air, taxi, parked, each with a unit, a
receiver and weather of its own; sound ones, or hostile ones of eight kinds in turn.
"""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind_flights import HOSTILE, NODES_DEGC, SOUND, Made, write_flight
from benchmarks.study import Record, Work, rms, table
from infield.session.estimate import SessionEstimate
from infield.session.log import table_series
from infield.session.one_run import take_run
from infield.session.reasons import FlightReason
from infield.session.results import SessionResult
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.twin_file import default_twin
from recal.service.inputs.records import read_table
from recal.service.look.own_runs import read_run

WITHIN_SIGMAS = 4.0  # of a committed node: beyond, it is confident and wrong
SPANS = ("session", "parked", "flight")
HEAD = ("mean biases over", "error over sigma", "of gyros x, y, z", "NEES", "RMS, deg/h")
HOSTILE_HEAD = ("fault", "flights", "merged", "with the flight", "wrong", "worst node, sigmas")


def bin_errors(
    made: Made, stored: ThermalTable, estimate: SessionEstimate, T: GyroTemperature
) -> NDArray:
    """Estimate less truth (3N,) [deg/h] of the bins' mean biases beyond the table."""
    bins, time_s = estimate.bins, np.arange(float(len(made.bias_deg_h)))
    low, high = float(T.temperature_degC.min()), float(T.temperature_degC.max())
    true = made.bias_deg_h - table_series(stored.extended_to(low, high), T)(time_s)
    means = [
        true[(time_s >= a) & (time_s < b)].mean(axis=0) for a, b in zip(bins.start_s, bins.end_s)
    ]
    return estimate.mean_deg_h - np.ravel(means)


def mean_rows(estimate: SessionEstimate, start_s: float, end_s: float) -> NDArray:
    """Rows (3, 3N) that average the bins of each axis between two times."""
    bins = estimate.bins
    inside = (bins.start_s >= start_s) & (bins.end_s <= end_s)
    weight = bins.duration_s * inside / float(np.sum(bins.duration_s * inside))
    rows = np.zeros((3, estimate.mean_deg_h.size))
    for axis in range(3):
        rows[axis, axis::3] = weight
    return rows


def node_errors(made: Made, stored: ThermalTable, result: SessionResult) -> NDArray:
    """Errors, sigmas and errors before (3, m) [deg/h] of the table after the session, at the
    temperatures of the session, five degrees apart.
    """
    assert result.temperature is not None
    T = result.temperature.temperature_degC
    after = stored if result.merged is None else result.merged.table
    found = []
    for k in range(3):
        at = np.arange(np.ceil(T[:, k].min()), T[:, k].max(), 5.0)
        true = np.interp(at, NODES_DEGC, made.nodes_deg_h[:, k])
        before, error = stored.bias_deg_h(k, at) - true, after.bias_deg_h(k, at) - true
        found.append(np.stack([error, after.sigma_deg_h(k, at), before]))
    return np.concatenate(found, axis=1)


def one(kind: str, technology: str, seed: int) -> Record:
    """A flight's line: written, read, updated, held against its truth."""
    name = list(HOSTILE)[seed % len(HOSTILE)]
    faults = HOSTILE[name] if kind == "hostile" else SOUND
    with tempfile.TemporaryDirectory() as folder:
        made = write_flight(Path(folder), seed, technology, faults)
        run, stored = read_run(made.folder), read_table(made.folder / "table.json")
        began = time.process_time()
        result = take_run(run, stored, default_twin(technology), SessionSettings(), False)
        cpu_s = time.process_time() - began
    flight = result.flight
    line: Record = {
        "seed": seed,
        "fault": name if kind == "hostile" else None,
        "deflection_arcsec": made.world.deflection_arcsec,
        "outcome": result.verdict.outcome.value,
        "joined": flight is not None and flight.joined is not None,
        "reasons": [reason.code.value for reason in result.verdict.reasons],
        "cpu_s": cpu_s,
    }
    if flight is None or result.estimate is None or result.temperature is None:
        return line
    line["left_out"] = [reason.code.value for reason in flight.reasons]
    for note in flight.notes:
        if note.code is FlightReason.DEFLECTED:
            line["deflected_arcsec"] = note.values["arcsec"]
    spans = ((-np.inf, np.inf), (-np.inf, flight.flight.start_s))
    spans = (*spans, (flight.flight.start_s, flight.flight.end_s))
    error = bin_errors(made, stored, result.estimate, result.temperature)
    for span, of in zip(SPANS, spans):
        rows = mean_rows(result.estimate, *of)
        line[f"{span}_error"] = (rows @ error).tolist()
        line[f"{span}_covariance"] = (rows @ result.estimate.covariance @ rows.T).tolist()
    nodes, sigma, before = node_errors(made, stored, result)
    line["nodes_rms"], line["nodes_before_rms"] = rms(nodes), rms(before)
    line["nodes_sigma_rms"] = rms(sigma)
    line["nodes_worst_sigmas"] = float(np.max(np.abs(nodes) / sigma))
    return line


def run(
    work: Work, *, kind: str = "sound", technology: str = "rlg", flights: int = 40, first: int = 0
) -> str:
    """kind: sound, or hostile; technology: rlg, fog."""
    lines = work.each(one, [(kind, technology, k) for k in range(first, first + flights)])
    if kind == "hostile":
        by_fault = {name: [line for line in lines if line["fault"] == name] for name in HOSTILE}
        return table(HOSTILE_HEAD, [hostile_row(name, of) for name, of in by_fault.items() if of])
    joined = [line for line in lines if line["joined"]]
    words = [f"{len(lines)} flights, {len(joined)} joined"]
    for key in ("nodes_before_rms", "nodes_rms", "nodes_sigma_rms"):
        words.append(f"{key} {rms([line[key] for line in joined]):.5f} deg/h")
    worst = max((line["nodes_worst_sigmas"] for line in joined), default=0.0)
    words.append(f"worst node {worst:.2f} sigmas")
    words.append(f"CPU {np.median([line['cpu_s'] for line in lines]):.1f} s")
    for line in lines:
        if not line["joined"] or line["outcome"] != "accepted":
            why = ", ".join([*line["reasons"], *line.get("left_out", [])])
            words.append(f"seed {line['seed']}: {line['outcome']} ({why})")
    rows = [row(span, joined) for span in SPANS if joined]
    return table(HEAD, rows) + "\n" + "".join(f"- {word}\n" for word in words)


def row(span: str, lines: Sequence[Record]) -> list[str]:
    """Errors over sigma of the mean biases over a span."""
    error = np.array([line[f"{span}_error"] for line in lines])
    P = np.array([line[f"{span}_covariance"] for line in lines])
    z = error / np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(P), error) / 3.0
    axes = ", ".join(f"{v:.2f}" for v in np.sqrt(np.mean(z**2, axis=0)))
    each = ", ".join(f"{v:.5f}" for v in np.sqrt(np.mean(error**2, axis=0)))
    over = f"{rms(z):.3f} +- {np.sqrt(0.5 / z.size):.3f}"
    return [span, over, axes, f"{nees.mean():.3f}", each]


def hostile_row(name: str, of: Sequence[Record]) -> list[object]:
    """What became of the flights with one fault."""
    accepted = [line for line in of if line["outcome"] == "accepted"]
    worst = [line["nodes_worst_sigmas"] for line in accepted]
    wrong = sum(w > WITHIN_SIGMAS for w in worst)
    flown = sum(line["joined"] for line in accepted)
    return [name, len(of), len(accepted), flown, wrong, f"{max(worst, default=0.0):.1f}"]
