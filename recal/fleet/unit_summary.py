"""A unit in numbers once its runs are through: how far its table moved, where it was seen, how well
it is known; its pages.

Everything comes from the update documents that the runs left in their folders (formats.md, section
5).
"""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.verdicts import Outcome
from recal.fleet.records import (
    MERGED,
    RunOutcome,
    TableDrift,
    TemperatureBand,
    UnitReport,
    UnitTask,
)
from recal.service.inputs.listings import read_json_object
from recal.service.inputs.records import ThermalTable, table_of
from recal.service.results.files import write_text
from recal.service.results.pages import (
    UpdateDocument,
    estimated_of,
    level_change,
    sentence,
    update_html,
    update_of,
)

LEVEL = ("x", "y")
# pages of a unit: the last of each kind of outcome, of every run, none
DRAWN = {"last": 1, "all": None, "none": 0}


def summarise_unit(task: UnitTask) -> UnitReport:
    """What the fleet report says of a unit (keys of `units` in fleet.json that come from its
    runs).
    """
    seen = [(o, document) for o in task.outcomes if (document := _document(o)) is not None]
    merged = [document for o, document in _one_a_folder(seen) if o.outcome in MERGED]
    contrary = [document for o, document in seen if o.outcome == Outcome.INCONSISTENT]
    disagreement = contrary[-1].disagreement if contrary else None
    steps = disagreement.steps if disagreement else ()
    return UnitReport(
        of=task.identity,
        drift=_drift(merged),
        coverage=_coverage(
            [document for o, document in _one_a_folder(seen)],
            {o.sha256 for o in task.outcomes if o.outcome in MERGED},
        ),
        steps=steps,
        step_words=[sentence(step.reason) for step in steps],
        pages=_draw(task, seen),
    )


def _document(outcome: RunOutcome) -> UpdateDocument | None:
    """The run's update.json; None where it has none (bad input), or it was lost."""
    path = Path(outcome.folder) / "update.json"
    try:
        return update_of(read_json_object(path)) if outcome.folder and path.exists() else None
    except InputError:
        return None


def _one_a_folder(
    seen: Sequence[tuple[RunOutcome, UpdateDocument]],
) -> list[tuple[RunOutcome, UpdateDocument]]:
    """A joint update tells of several runs in one document."""
    best = sorted(seen, key=lambda pair: pair[0].outcome not in MERGED)
    first = {outcome.folder: (outcome, document) for outcome, document in reversed(best)}
    return sorted(first.values(), key=lambda pair: pair[0].folder)


def _drift(merged: Sequence[UpdateDocument]) -> TableDrift | None:
    """The level gyros' change from the first merge's old table to the last one's new, at the
    temperatures of the points.

    None without a merge, and for MEMS: gyros that find no heading do not navigate free-inertially.
    """
    if not merged or merged[-1].table_after["gyro_technology"] == "mems":
        return None
    before = table_of(merged[0].table_before)[0]
    after = table_of(merged[-1].table_after)[0]
    T = _visited(merged)
    change = level_change(before, after, T)
    expected = [_gained(before, after, k, t) for k, t in enumerate(T)]
    moved = [after.bias_deg_h(k, t) - before.bias_deg_h(k, t) for k, t in enumerate(T)]
    z = np.sqrt(np.mean(np.concatenate([m**2 / e for m, e in zip(moved, expected)])))
    return TableDrift(
        level_change_deg_h=change.level_deg_h,
        nm_h=change.drift_removed_nm_h,
        sigma_nm_h=change.drift_left_nm_h,
        surprise_sigmas=float(z),
        sigma_before_deg_h=_rms([before.sigma_deg_h(k, t) for k, t in enumerate(T)]),
        sigma_after_deg_h=_rms([after.sigma_deg_h(k, t) for k, t in enumerate(T)]),
        largest_deg_h=float(max((abs(m).max() for m in moved), default=0.0)),
        temperature_degC=(float(min(t.min() for t in T)), float(max(t.max() for t in T))),
        table_before_sha256=merged[0].table_before_sha256,
        table_after_sha256=merged[-1].table_after_sha256,
        since_utc=before.created_utc,
        until_utc=after.created_utc,
    )


def _visited(documents: Sequence[UpdateDocument]) -> tuple[NDArray, NDArray]:
    """Temperatures of the points of gyros x and y (n,), those of merged runs."""
    T: dict[str, list[float]] = {axis: [] for axis in LEVEL}
    for document in documents:
        accepted = {s.sha256 for s in document.sessions if s.outcome == Outcome.ACCEPTED}
        for point in document.points:
            if point.axis in LEVEL and point.run_sha256 in accepted:
                T[point.axis].append(point.temperature_degC)
    return np.array(T["x"]), np.array(T["y"])


def _gained(before: ThermalTable, after: ThermalTable, axis: int, T: NDArray) -> NDArray:
    """Variance (n,) of the change to expect if the old sigma was right: what the merges took from
    it [(deg/h)^2].
    """
    old, new = before.sigma_deg_h(axis, T) ** 2, after.sigma_deg_h(axis, T) ** 2
    return np.maximum(old - new, 0.01 * old)


def _rms(sigmas: Sequence[NDArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(sigmas) ** 2)))


def _coverage(documents: Sequence[UpdateDocument], merged: set[str]) -> list[TemperatureBand]:
    """Seconds of the merged runs in each 5 degC band, the mean over the gyros."""
    seconds: dict[float, float] = defaultdict(float)
    for document in documents:
        for session in estimated_of(document):
            for band in session.coverage if session.sha256 in merged else ():
                seconds[band.low_degC] += band.seconds / 3.0
    return [
        TemperatureBand(low_degC=low, high_degC=low + 5.0, seconds=round(seconds[low], 1))
        for low in sorted(seconds)
    ]


def _draw(task: UnitTask, seen: Sequence[tuple[RunOutcome, UpdateDocument]]) -> list[str]:
    """Draws update.html where it is wanted and not there yet; the folders that have one, the newest
    last.
    """
    wanted: dict[str, UpdateDocument] = {}
    for kind in dict.fromkeys(outcome.outcome for outcome, _ in seen):
        of_kind = [(o.folder, document) for o, document in seen if o.outcome == kind]
        count = DRAWN[task.pages]
        wanted.update(of_kind[-count:] if count else of_kind if count is None else [])
    for folder, document in wanted.items():
        page = Path(folder) / "update.html"
        if (
            not page.exists()
            or page.stat().st_mtime < (Path(folder) / "update.json").stat().st_mtime
        ):
            write_text(page, update_html(document))
    return sorted(
        str(path.parent)
        for folder in {o.folder for o, _ in seen}
        if (path := Path(folder) / "update.html").exists()
    )
