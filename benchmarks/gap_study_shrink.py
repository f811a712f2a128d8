"""The true shrink of a found cause: what its re-simulation takes off the planted effect on the same held-out rows.

    S_true = 1 - |s - d|^2 / |s|^2

s: whitened rows of the runs with the planted effect less those without it (and less what the other causes explain); d: the
cause as the diagnosis fitted it on the rows not held. Folds, rows and subspace are those of `simreal.addback`.
"""

import numpy as np
from numpy.typing import NDArray

from simreal.addback import _dense, _low_band, _minute_mask, _run_mask, _touched
from simreal.attribute import Attribution, Slot
from simreal.causes import Cause
from simreal.diagnosis import Diagnosis


def true_shrink(found: Diagnosis, s: NDArray) -> list[float | None]:
    """One value for each cause, in their order; None for noise and where nothing of the plant is on the held rows."""
    slots = found.attribution.slots
    free = list(range(len(slots)))
    out: list[float | None] = []
    for cause in found.causes:
        k = next(k for k in free if _is_of(found, slots[k], cause))
        free.remove(k)
        out.append(None if slots[k].extra is not None else _of_slot(found.attribution, slots[k], cause, s))
    return out


def _is_of(found: Diagnosis, slot: Slot, cause: Cause) -> bool:
    h = slot.hypothesis
    run_id = None if h.run is None else found.views[h.run].name
    return (h.name, h.target, run_id) == (cause.effect, cause.target, cause.run_id)


def _of_slot(attribution: Attribution, slot: Slot, cause: Cause, s: NDArray) -> float | None:
    evidence = attribution.evidence
    by_run = cause.shrink is not None and cause.shrink.how == "leave one run out"
    masks = [_run_mask(evidence, k) for k in range(len(evidence.runs))] if by_run else [
        _minute_mask(evidence, odd) for odd in (False, True)
    ]  # fmt: skip
    touched = _touched(attribution, slot)
    parts = [_fold(attribution, slot, s, mask, touched, by_run=by_run) for mask in masks]
    left, total = sum(p[0] for p in parts), sum(p[1] for p in parts)
    return float(1.0 - left / total) if total > 1e-9 else None


def _fold(
    attribution: Attribution, slot: Slot, s: NDArray, held: NDArray, touched: NDArray, *, by_run: bool
) -> tuple[float, float]:
    """|s - d|^2 and |s|^2 on one held-out part."""
    evidence, columns = attribution.evidence, attribution.columns
    A = _dense(attribution.bank, columns, evidence.size)
    beta = _fitted(A, evidence.z, ~held)
    mine = np.isin(columns, slot.columns)
    target, d = s - A[:, ~mine] @ beta[~mine], A[:, mine] @ beta[mine]
    where = held & touched
    if by_run:
        project = _low_band(evidence, where)
        target, d = project(target), project(d)
    else:
        target, d = target[where], d[where]
    return float(np.sum((target - d) ** 2)), float(target @ target)


def _fitted(A: NDArray, z: NDArray, train: NDArray) -> NDArray:
    """Least squares on the training rows; a column that they do not show stays at zero."""
    shown = np.sum(A[train] ** 2, axis=0) > 1e-9 * np.maximum(np.sum(A**2, axis=0), 1e-300)
    scale = shown / np.sqrt(np.maximum(np.sum(A[train] ** 2, axis=0), 1e-300))
    return scale * np.linalg.lstsq(A[train] * scale, z[train], rcond=1e-6)[0]
