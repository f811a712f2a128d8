"""The patent's own path (claim 1 of US 5,527,003, step by step) beside the filter, on the same
sessions: heading error and bias of the east gyro, against the truth.

Sessions of an aged ring-laser unit: 70 min parked, then the realistic taxi, at several places and
headings; the truth is the simulator's heading at the end of the alignment and its gyro biases.

    python -m benchmarks.claim_chain_limits [SESSIONS]
"""

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.recalibration_unit import OFFSET_DEG_H, SERIAL, SHAPE_DEG_H, TWINS, taxi
from infield.session.pipeline import update_calibration
from infield.session.results import SessionResult
from infield.table.file import table_from_dict
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import STARTS, thermal_history
from trajectories.simulator.unit_truth import aged_unit

SESSIONS = 40
LATITUDES_DEG = (-45.0, 30.0, 45.0, 60.0)
HEADINGS_DEG = (0.0, 60.0, 135.0, 240.0)


@dataclass(frozen=True)
class Compared:
    """Errors of one session: heading [mrad] and its sigma, by chain and by filter; of the east
    gyro's mean bias [deg/h] and its sigma, by both.
    """

    chain_mrad: tuple[float, float]
    filter_mrad: tuple[float, float]
    chain_deg_h: tuple[float, float]
    filter_deg_h: tuple[float, float]


def session(seed: int) -> Compared | None:
    """None where a session was refused, or the chain saw no heading."""
    rng = np.random.default_rng([seed, 95])
    unit = aged_unit(
        rng, ageing_offset_deg_h=OFFSET_DEG_H, ageing_shape_deg_h=SHAPE_DEG_H, imu_serial=SERIAL
    )
    table = table_from_dict(unit.factory_table(), name="factory")
    lat, heading = float(rng.choice(LATITUDES_DEG)), float(rng.choice(HEADINGS_DEG))
    simulated = simulate_run(
        taxi(lat, heading),
        thermal_history(str(rng.choice(list(STARTS))), rng=rng),
        unit,
        TWINS["default"],
        rng=rng,
        plan=SessionPlan(run_id=str(seed)),
    )
    (found,) = update_calibration([simulated.run], table, TWINS["default"]).sessions
    if found.chain is None or found.estimate is None or not np.isfinite(found.chain.psi_rad):
        return None
    return _compared(found, simulated)


def _compared(found: SessionResult, simulated: SimulatedRun) -> Compared:
    e, chain = found.estimate, found.chain
    assert e is not None and chain is not None
    reference = simulated.reference
    true = np.interp(e.alignment.time_s, reference.time_s, np.unwrap(reference.heading_rad))
    psi = (e.alignment.heading_rad - true + np.pi) % (2 * np.pi) - np.pi
    H = e.alignment.heading_rad
    east = np.array([np.sin(H), np.cos(H), 0.0])
    t = np.array([p.time_s for p in chain.points])
    total = _at(simulated, t) @ east
    left = np.array([p.east_deg_h for p in chain.points]) + _table_at(found, t) @ east
    sigma = np.sqrt(
        np.mean([p.sigma_deg_h**2 for p in chain.points]) / len(chain.points)
        + (_coupling(found) * chain.sigma_psi_rad) ** 2
    )
    bins = e.bins
    weights = np.kron(bins.duration_s / bins.duration_s.sum(), east)
    mean = (bins.table_deg_h + e.mean_deg_h) @ weights
    t_s = simulated.bias_time_s
    inside = (t_s >= bins.start_s[0]) & (t_s < bins.end_s[-1])
    of_bins = float(np.mean(simulated.gyro_bias_true_deg_h[inside] @ east))
    return Compared(
        (1e3 * (chain.psi_rad - psi), 1e3 * chain.sigma_psi_rad),
        (1e3 * (e.heading_error_rad - psi), 1e3 * e.sigma_heading_rad),
        (float(np.mean(left - total)), float(sigma)),
        (float(mean - of_bins), float(np.sqrt(weights @ e.covariance @ weights))),
    )


def _at(simulated: SimulatedRun, time_s: NDArray) -> NDArray:
    """True biases (n, 3) [deg/h]."""
    columns = simulated.gyro_bias_true_deg_h.T
    return np.stack([np.interp(time_s, simulated.bias_time_s, c) for c in columns], axis=1)


def _table_at(found: SessionResult, time_s: NDArray) -> NDArray:
    """The stored table (n, 3) [deg/h] at the session's temperatures."""
    e = found.estimate
    assert e is not None
    values = e.bins.table_deg_h.reshape(-1, 3)
    return np.stack([np.interp(time_s, e.bins.centre_s, c) for c in values.T], axis=1)


def _coupling(found: SessionResult) -> float:
    """Earth rate to the north [deg/h]."""
    return 15.041 * float(np.cos(found.run.header.site.lat_rad))


def rows(found: list[Compared]) -> list[str]:
    """RMS error, RMS sigma and squared error over variance, chain and filter."""
    lines = []
    for what, name, unit in (
        ("heading error", "mrad", "mrad"),
        ("east gyro, mean of the session", "deg_h", "deg/h"),
    ):
        for who in ("chain", "filter"):
            error, sigma = np.array([getattr(one, f"{who}_{name}") for one in found]).T
            nees = error**2 / sigma**2
            lines.append(
                f"| {what} [{unit}], {who} | {_rms(error):.4f} | {_rms(sigma):.4f} |"
                f" {nees.mean():.2f} | {np.sqrt(nees.max()):.1f} |"
            )
    return lines


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main(sessions: int = SESSIONS) -> None:
    """Measure and print."""
    found = [one for seed in range(sessions) if (one := session(seed)) is not None]
    head = "| | RMS error | RMS sigma | squared error over variance | worst, in sigmas |"
    text = "\n".join([head, "|---|---|---|---|---|", *rows(found)])
    sys.stdout.write(f"{len(found)} of {sessions} sessions.\n\n{text}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else SESSIONS)
