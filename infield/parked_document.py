"""What `update.json` says of sessions without a heading (zero-rate biases of a parked unit): budget, assumptions, effect."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.merge import random_walk_covariance
from infield.pipeline import SessionResult, UpdateResult
from ins.earth import EARTH_RATE_RAD_S
from ins.records import AXES
from ins.units import DEG_PER_HOUR, HOUR

METHOD = "zero-rate bias of a parked unit against temperature, no heading needed: levelled Earth rate removed, joint merge"


def parked_sessions(result: UpdateResult) -> list[SessionResult]:
    """The sessions that were estimated without a heading."""
    return [s for s in result.sessions if s.estimate is not None and s.estimate.parked is not None]


def budget(session: SessionResult, result: UpdateResult) -> list[dict[str, Any]]:
    """Terms of the session's mean bias, each alone, one sigma."""
    assert session.estimate is not None and session.estimate.parked is not None
    p, gyro = session.estimate.parked, result.twin.gyro
    seconds = float(p.used_s.sum())
    walk = gyro.rate_random_walk_deg_h_sqrt_h**2 / HOUR * random_walk_covariance(np.zeros(1), np.array([seconds]))
    heading = p.heading_deg_h * np.sqrt(np.maximum(1.0 - p.down_b**2, 0.0))
    rest = np.sqrt(np.maximum(np.diag(p.earth_covariance) - heading**2, 0.0))
    rows = []
    for k, axis in enumerate(AXES):
        terms = {
            "angle random walk": p.walk_deg_sqrt_h[k] / np.sqrt(seconds / HOUR),
            "Earth rate on an unknown heading": heading[k],
            "Earth rate: level, scale factor": rest[k],
            "turn-on, this session against the mean": gyro.turn_on_deg_h,
            "bias instability": 0.664 * gyro.bias_instability_deg_h,
            "rate random walk": float(np.sqrt(walk[0, 0])),
        }
        rows += [{"axis": axis, "term": term, "sigma_deg_h": float(s)} for term, s in terms.items() if s > 0]
    return rows


def assumptions(result: UpdateResult) -> list[str]:
    """What a reader must believe for these numbers to hold."""
    twin, found = result.twin, [s.estimate.parked for s in parked_sessions(result) if s.estimate is not None]
    north = max((p.heading_deg_h for p in found if p is not None), default=0.0)
    heading = (
        f"no heading is known: the level part of Earth rate is one common error of all points of a session, {north:.1f} deg/h "
        "(1 sigma) on a level axis; headings of different sessions are taken as unrelated, so a unit that always parks the "
        "same way keeps that part in its table (a surveyed heading in run.json takes it out)"
    ) if north else "the surveyed heading takes the level part of Earth rate out"  # fmt: skip
    if not found:
        heading = "the heading of the parked unit need not be known; what it leaves of Earth rate is one error of a session"
    noisiest = max((p.noise_scale for p in found if p is not None), default=0.0)
    said = f", the log's own where larger (at most {noisiest:.2g} times the model)" if found else ""
    return [
        heading,
        f"level by gravity, accelerometers within {twin.accel.turn_on_ug:g} ug (1 sigma); vertical Earth rate is removed",
        "the unit stands: a turn at one steady rate all along would be taken for a bias",
        f"noise of the unit from {twin.source}{said}",
        f"each power-on departs from the table by {twin.gyro.turn_on_deg_h:g} deg/h (1 sigma, turn-on)",
        f"ageing of the table {result.ageing.common_deg_h_sqrt_year:g} deg/h common and "
        f"{result.ageing.shape_deg_h_sqrt_year:g} deg/h shape per square root of a year",
    ]


def effect(result: UpdateResult) -> dict[str, Any] | None:
    """The change of the table over the temperatures of the last merged session, its level and its shape apart."""
    merged = [s for s in parked_sessions(result) if s.merged is not None]
    if not merged or not result.merged_runs or merged[-1].estimate is None:
        return None
    T = merged[-1].estimate.bins.temperature_degC
    change: list[NDArray] = []
    level_left: list[float] = []
    shape_left: list[float] = []
    for k in range(3):
        change.append(result.after.bias_deg_h(k, T[:, k]) - result.before.bias_deg_h(k, T[:, k]))
        rows = result.after.basis(k, T[:, k])
        P = rows @ result.after.covariance @ rows.T
        level_left.append(float(P.mean()))
        shape_left.append(float(np.mean(np.diag(P)) - P.mean()))
    of_gyro = np.stack(change)
    shape = of_gyro - of_gyro.mean(axis=1, keepdims=True)
    return {
        "level_change_deg_h": float(np.sqrt(np.mean(of_gyro.mean(axis=1) ** 2))),
        "shape_change_deg_h": float(np.sqrt(np.mean(shape**2))),
        "level_left_sigma_deg_h": float(np.sqrt(np.mean(level_left))),
        "shape_left_sigma_deg_h": float(np.sqrt(max(float(np.mean(shape_left)), 0.0))),
        "turn_on_deg_h": result.twin.gyro.turn_on_deg_h,
        "earth_rate_deg_h": EARTH_RATE_RAD_S / DEG_PER_HOUR,
        "temperature_degC": [float(T.min()), float(T.max())],
    }


def effect_words(found: dict[str, Any]) -> str:
    """One line of it for people."""
    low, high = found["temperature_degC"]
    return (
        f"over {low:.0f} to {high:.0f} degC the table's level moves by {found['level_change_deg_h']:.3g} deg/h (left: "
        f"{found['level_left_sigma_deg_h']:.3g}), its shape by {found['shape_change_deg_h']:.3g} deg/h (left: "
        f"{found['shape_left_sigma_deg_h']:.3g}), RMS over the gyros; each start adds its turn-on of {found['turn_on_deg_h']:g}"
    )
