"""Which runs' parked vehicles were moved by people, wind or loads: their turns are no effect of a
sensor (`simreal.evidence.vehicle_motion`).

A vehicle rocks on its gear: what it turns back in a second shows in the quick rows far more than in
the slow ones, which no noise of a gyro does, and the vertical accelerometer heaves with it. Or it
tilts: what the specific force shows is what the gyros read.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ins.estimation.choice import SURE_NATS
from simreal.evidence.vehicle_motion import CHI2_MEDIAN, level_axes
from simreal.evidence.whitened import SENSORS, RunEvidence
from simreal.inference.attribute import Attribution, Attributor, columns_of
from simreal.inference.scoring import fit

# of the expected squares within ten seconds, and over those of the ten-second means: a calm
# vehicle's are within 1.1, a ground cart's 12 (docs/environments.md)
ROCKS, QUICKER = 1.5, 1.3
SHIP = 100.0  # of the squares of slow rows: a swell is as slow as they are (10 s)
LOUD_SIGMA = 5.0  # of a sum of squares: 1e-6 of quiet ones lie beyond
NAMED_FIRST = 2  # effects that may explain a tilt; what people do takes 3 or more


def rocking(runs: Sequence[RunEvidence]) -> frozenset[str]:
    """Names of the runs whose vehicles rock."""
    return frozenset(run.view.name for run in runs if _rocks(run))


def _rocks(run: RunEvidence) -> bool:
    if level_axes(run.view.C_nb) is None or not run.parked.steady.any():
        return False
    z = run.z[: run.parked.rows].reshape(SENSORS, -1)
    slow = np.maximum(np.median(z**2, axis=1) / CHI2_MEDIAN, 1.0)
    dof = run.scatter.dof[:SENSORS, 1:].sum(axis=2)
    ratio = np.sum(run.scatter.ratio * run.scatter.dof, axis=2)[:SENSORS, 1:]
    quick = (ratio / np.maximum(dof, 1.0)).max(axis=1)
    rocks = (quick > ROCKS) & ((quick > QUICKER * slow) | (slow > SHIP))
    up = 3 + int(np.argmax(np.abs(run.view.C_nb[2])))
    # a machine that shakes it heaves less: 1.36 of a ground cart that makes 12 of gyro y
    heaves = rocks[up] or quick[up] > QUICKER * slow[up]
    return bool(rocks[:3].any() and heaves)


def tilting(
    found: Attribution | Attributor, turned_back: Callable[[RunEvidence], RunEvidence]
) -> frozenset[str]:
    """Names of the runs whose vehicles turn beyond what was found of them: what is loud in their
    level accelerometers, for the twin, is far likelier once the turns that the gyros read are taken
    out than with what was found. A found noise makes nothing loud, and is judged by its likelihood.
    """
    columns = columns_of(s for s in found.slots if s.hypothesis.target == "vehicle")
    every = found.columns
    beta, _ = fit(found.bank, every)
    left = found.evidence.z - found.bank.signature(columns, beta[np.isin(every, columns)])
    plain, out = found.plain_evidence, set()
    for r, run in enumerate(found.evidence.runs):
        level = level_axes(run.view.C_nb)
        finds_north = run.view.telemetry.heading_known
        if level is None or not finds_north or not run.parked.steady.all():
            continue
        channels = 3 + np.flatnonzero(level)
        rows = channels.size * run.parked.bins
        loud = _square(run, plain.z[plain.rows_of(r)], channels)
        if loud < rows + LOUD_SIGMA * np.sqrt(2.0 * rows):
            continue
        square = _square(run, left[found.evidence.rows_of(r)], channels)
        other = turned_back(run)
        if not other.parked.steady.any():
            gain = 0.5 * (square - _square(other, other.z, channels))
            gain += run.parked.log_sigma(channels) - other.parked.log_sigma(channels)
            if gain > SURE_NATS:
                out.add(run.view.name)
    return frozenset(out)


def _square(run: RunEvidence, z: NDArray, channels: NDArray) -> float:
    return float(np.sum(z[: run.parked.rows].reshape(SENSORS, -1)[channels] ** 2))
