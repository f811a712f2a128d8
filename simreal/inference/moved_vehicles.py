"""Which runs' parked vehicles were moved by people, wind or loads: their turns are no effect of a
sensor (`simreal.evidence.vehicle_motion`).

A vehicle rocks on its gear: what it turns back in a second shows in the quick rows far more than in
the slow ones, which no noise of a gyro does, and the vertical accelerometer heaves with it. Or it
tilts: what a level gyro reads, the specific force shows to have been a turn.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.errors.telemetry import total
from simreal.evidence.parked import PARKED_MEAN_S
from simreal.evidence.vehicle_motion import CHI2_MEDIAN, level_axes
from simreal.evidence.whitened import SENSORS, RunEvidence
from simreal.inference.attribute import Attribution, Attributor, columns_of
from simreal.inference.scoring import fit

# of the expected squares within ten seconds, and over those of the ten-second means: a calm
# vehicle's are within 1.1, a ground cart's 12 (docs/environments.md)
ROCKS, QUICKER = 1.5, 1.3
SHIP = 100.0  # of the squares of slow rows: a swell is as slow as they are
SHOWN_SIGMA = 5.0  # of a correlation that is none: 3e-7 lie beyond
NAMED_FIRST = 2  # effects that may explain a tilt; what people do takes more


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
    return bool(rocks[:3].any() and rocks[up])


def tilting(found: Attribution | Attributor) -> frozenset[str]:
    """Names of the runs that show turns of the vehicle beyond those that were found."""
    columns = found.columns
    beta, _ = fit(found.bank, columns)
    turns = np.isin(columns, columns_of(s for s in found.slots if s.hypothesis.target == "vehicle"))
    out = set()
    for r, run in enumerate(found.evidence.runs):
        level = level_axes(run.view.C_nb)
        if level is None or not run.parked.steady.all():
            continue
        left = run.parked.residual(run.view)
        traces = [
            (found.bank.traces_of(int(c), r), float(b)) for c, b in zip(columns[turns], beta[turns])
        ]
        explained = total([t.scaled(b) for t, b in traces if t is not None])
        left = left - run.parked.of_traces([explained])[:, :, 0]
        if any(_shown(run, left, int(axis)) for axis in np.flatnonzero(level)):
            out.add(run.view.name)
    return frozenset(out)


def _shown(run: RunEvidence, left: NDArray, axis: int) -> bool:
    """Whether the specific force shows a gyro's reading to be a turn."""
    of_turn = np.cross(run.parked.expected[3:], np.eye(3)[axis])
    feels = int(np.argmax(np.abs(of_turn)))
    force = left[3 + feels] / of_turn[feels]
    by_force = (force[2:] - force[:-2]) / (2.0 * PARKED_MEAN_S)
    by_gyro = 0.25 * (left[axis, :-2] + 2.0 * left[axis, 1:-1] + left[axis, 2:])
    by_force, by_gyro = by_force - by_force.mean(), by_gyro - by_gyro.mean()
    size = float(np.linalg.norm(by_force) * np.linalg.norm(by_gyro))
    # neighbours share a reading
    return bool(by_force @ by_gyro > SHOWN_SIGMA * size / np.sqrt(0.5 * by_force.size))
