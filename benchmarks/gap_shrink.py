"""The true shrink of a found cause: what its re-simulation takes off the planted effect on the same
held-out rows.

    S_true = 1 - |s - d|^2 / |s|^2

s: whitened rows of the runs with the planted effect less those without it (and less what the other
causes explain); d: the cause as fitted on the rows not held. Folds, fit and subspace are those of
`simreal.inference.addback`, given s on the held rows in place of the data: there N = 2 d's - |d|^2
and D + m = |s|^2.
"""

import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simreal.inference import addback
from simreal.inference.attribute import Attribution, Slot
from simreal.inference.causes import Cause
from simreal.inference.diagnosis import Diagnosis
from simreal.inference.scoring import fit
from simreal.inference.verdict import Judging

HELD_IN_TURNS = (Judging.BY_RUN, Judging.HALF_MINUTES)
NOTHING = 1e-9


def true_shrink(found: Diagnosis, s: NDArray) -> list[float | None]:
    """One value for each cause, in their order; None for noise and where nothing of the plant is on
    the held rows.
    """
    slots = found.attribution.slots
    free = list(range(len(slots)))
    out: list[float | None] = []
    for cause in found.causes:
        k = next(k for k in free if _is_of(found, slots[k], cause))
        free.remove(k)
        out.append(
            None if slots[k].extra is not None else _of_slot(found.attribution, slots[k], cause, s)
        )
    return out


def _is_of(found: Diagnosis, slot: Slot, cause: Cause) -> bool:
    h = slot.hypothesis
    run_id = None if h.run is None else found.views[h.run].name
    return (h.name, h.target, run_id) == (cause.effect, cause.target, cause.run_id)


def _of_slot(attribution: Attribution, slot: Slot, cause: Cause, s: NDArray) -> float | None:
    evidence = attribution.evidence
    if cause.shrink is None or cause.shrink.how not in HELD_IN_TURNS:
        return _in_sample(attribution, slot, s)
    by_run = cause.shrink.how is Judging.BY_RUN
    masks = (
        [addback._run_mask(evidence, k) for k in range(len(evidence.runs))]
        if by_run
        else [addback._block_mask(evidence, odd) for odd in (False, True)]
    )
    touched = addback._touched(attribution, slot)
    gone, total = 0.0, 0.0
    for held in masks:
        N, D, _, _, m, *_ = addback._fold(
            with_truth(attribution, held, s), slot, held, touched, by_run=by_run
        )
        gone, total = gone + N, total + D + m
    return gone / total if total > NOTHING else None


def _in_sample(attribution: Attribution, slot: Slot, s: NDArray) -> float | None:
    """Of an event that half of the data do not fix: the fit to all rows, on all rows of its
    channels.
    """
    columns, rows = attribution.columns, addback._touched(attribution, slot)
    A = addback._dense(attribution.bank, columns, attribution.evidence.size)
    beta, _ = fit(attribution.bank, columns)
    mine = np.isin(columns, slot.columns)
    d, target = (A[:, mine] @ beta[mine])[rows], (s - A[:, ~mine] @ beta[~mine])[rows]
    total = float(target @ target)
    return 1.0 - float(np.sum((target - d) ** 2)) / total if total > NOTHING else None


def with_truth(attribution: Attribution, held: NDArray, s: NDArray) -> Attribution:
    """The attribution with the planted rows in place of the data where they are held."""
    evidence = copy.copy(attribution.evidence)
    evidence.z = evidence.z.copy()
    evidence.z[held] = s[held]
    return replace(attribution, evidence=evidence)
