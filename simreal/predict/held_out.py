"""What a twin predicts of the update of a run that it was not fitted to, before and after the found
effects are in it.

The table and the noise predict the bias points of a session with their covariance; what is measured
less what is predicted is the update's own innovation (`infield.table.merge`). An effect of the
twin's is taken out of the log first, a noise goes into the twin's numbers: so the prediction is the
one that the update itself would make.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from infield.replay.drift_prediction import NM_H_PER_DEG_H
from infield.session.pipeline import update_calibration
from infield.session.results import SessionResult
from infield.table.thermal_table import ThermalTable
from infield.thermal.found_effects import with_effect_sigma, without_effects
from ins.records import Run, TwinModel
from ins.units import MILLIRADIAN
from simreal.declared.twin_effects import TwinEffect, parse_effects
from simreal.evidence.run_view import RunView, view_run
from simreal.inference.causes import Cause
from simreal.inference.diagnosis import Diagnosis, DiagnosisSettings, NotLookedAt, diagnose
from simreal.predict.carried import along, foretells, with_noise_of
from simreal.predict.measures import Deviation
from simreal.twin.write_back import effect_items

LEVEL_AXES = (0, 1)
# of the heading's prior variance that the update must take away before its heading error says
# something of the prediction; chosen: 0.19 of it is a sigma of 0.9, the bound of
# infield.reports.documents.session (UNSEEN_SIGMA)
HEADING_SEEN = 0.19
NO_UPDATE = "an update refuses the run"

Key = tuple[str, str]  # name and target of an effect


@dataclass(frozen=True)
class Predicted:
    """Measured less predicted of one run under one twin.

    drift: (2,) of the level gyros' mean bias [NM/h]; heading: (1,) of the alignment [mrad], None
    where the update does not show it; points: (m,) all bias points [deg/h].
    """

    drift: Deviation
    heading: Deviation | None
    points: Deviation


@dataclass(frozen=True)
class HeldOutRun:
    """Predictions of one run by twins fitted to others.

    fitted_to: run ids; found: the effects of that fit that can be predicted; own: those that belong
    to one run, or that no prediction can carry. alone, without: by effect, with that one only and
    with all others.
    """

    run_id: str
    fitted_to: tuple[str, ...]
    found: tuple[Key, ...]
    own: tuple[Key, ...]
    before: Predicted
    after: Predicted
    alone: dict[Key, Predicted]
    without: dict[Key, Predicted]


@dataclass(frozen=True)
class Simulator:
    """All predictions, and the runs that could not be predicted, with why."""

    runs: tuple[HeldOutRun, ...]
    unpredicted: tuple[NotLookedAt, ...]


@dataclass(frozen=True)
class GivenTwin:
    """The twin as given, its table, and the hash of the table that runs may have applied."""

    twin: TwinModel
    table: ThermalTable | None
    table_sha256: str


def predict_runs(
    runs: Sequence[Run],
    believed: GivenTwin,
    table: ThermalTable,
    settings: DiagnosisSettings,
    found: Diagnosis,
) -> Simulator:
    """Predicts each run from the others, or the runs held out from the rest.

    Parameters
    ----------
    runs : of one unit.
    believed : the twin that is fitted.
    table : that the updates begin with: the twin's, or that of an unknown unit.
    settings : of the diagnosis; its hold_out are the runs to predict, where there are any.
    found : the diagnosis of all runs, less those held out.
    """
    ids = [run.header.run_id for run in runs]
    names = tuple(settings.hold_out) or tuple(ids)
    done: list[HeldOutRun] = []
    undone: list[NotLookedAt] = []
    looked_at = {view.name for view in found.views}
    for run in runs:
        name = run.header.run_id
        if name not in names:
            continue
        settings.told(f"predicting {name}")
        others = [r for r in runs if r.header.run_id != name and r.header.run_id in looked_at]
        apart = name in settings.hold_out
        fit = found if apart else _fit(others, believed, settings)
        predicted = _predict(run, fit, believed, table, settings.hold_out)
        if isinstance(predicted, str):
            undone.append(NotLookedAt(name, predicted))
        else:
            done.append(predicted)
    return Simulator(tuple(done), tuple(undone))


def _fit(runs: Sequence[Run], believed: GivenTwin, settings: DiagnosisSettings) -> Diagnosis:
    quiet = replace(settings, hold_out=(), told=lambda words: None)
    return diagnose(runs, believed.twin, believed.table, quiet, table_sha256=believed.table_sha256)


def _predict(
    run: Run, fit: Diagnosis, believed: GivenTwin, table: ThermalTable, hold_out: Sequence[str]
) -> HeldOutRun | str:
    """The predictions of a run, or why there are none."""
    view = view_run(run, 0, believed.table, believed.twin, table_sha256=believed.table_sha256)
    if isinstance(view, str):
        return view
    fitted_to = tuple(v.name for v in fit.views if v.name not in hold_out)
    items, own = _items(fit, fitted_to)
    update = _Update(run, view, believed.twin, table, parse_effects(believed.twin))
    before = update.predicted([])
    if before is None:
        return NO_UPDATE
    every = [item for group in items.values() for item in group]
    after = update.predicted(every)
    if after is None:
        return NO_UPDATE
    alone, without = {}, {}
    for key, group in items.items():
        only = len(items) == 1
        alone[key] = (after if only else update.predicted(group)) or before
        others = [item for item in every if item not in group]
        without[key] = (before if only else update.predicted(others)) or after
    return HeldOutRun(
        run_id=run.header.run_id,
        fitted_to=fitted_to,
        found=tuple(items),
        own=own,
        before=before,
        after=after,
        alone=alone,
        without=without,
    )


def _items(
    fit: Diagnosis, run_ids: Sequence[str]
) -> tuple[dict[Key, list[TwinEffect]], tuple[Key, ...]]:
    """What was found and can be predicted elsewhere, by effect; then what cannot."""
    items: dict[Key, list[TwinEffect]] = {}
    own: list[Key] = []
    for cause in fit.causes:
        key = (cause.effect, cause.target)
        carried = _carried(cause, fit.twin, run_ids)
        if carried:
            items.setdefault(key, []).extend(carried)
        else:
            own.append(key)
    return items, tuple(dict.fromkeys(own))


def _carried(cause: Cause, twin: TwinModel, run_ids: Sequence[str]) -> list[TwinEffect]:
    listed = tuple(effect_items(cause, run_ids))
    return [item for item in parse_effects(replace(twin, effects=listed)) if foretells(item)]


@dataclass(frozen=True)
class _Update:
    """Updates of one run from the twin's table, with effects out of its log or not."""

    run: Run
    view: RunView
    twin: TwinModel
    table: ThermalTable
    listed: Sequence[TwinEffect]

    def predicted(self, items: Sequence[TwinEffect]) -> Predicted | None:
        """Measured less predicted with these effects beside those that the twin lists; None where
        the update says nothing of the run.
        """
        every = [*(item for item in self.listed if item.in_run(self.run.header.run_id)), *items]
        effects = [along(item, self.view.telemetry) for item in every if not item.is_noise]
        twin = replace(with_noise_of(self.twin, every), effects=(), table=None)
        twin = with_effect_sigma(twin, [effects])
        result = update_calibration([without_effects(self.run, effects)], self.table, twin)
        return _deviations(result.sessions[0], self.table) if result.sessions else None


def _deviations(session: SessionResult, table: ThermalTable) -> Predicted | None:
    """Of a session with an estimate, also of one that contradicts model or table."""
    points, estimate = session.points, session.estimate
    if points is None or estimate is None:
        return None
    merged = session.merged or estimate.merged_into(table)
    e, S = merged.innovation_deg_h, merged.innovation_covariance
    if e.size != points.axis_index.size or not e.size:
        return None
    rows = _means(points.axis_index, points.duration_s)
    mean = NM_H_PER_DEG_H * rows
    heading = _heading(
        estimate.heading_error_rad, estimate.sigma_heading_before_rad, estimate.sigma_heading_rad
    )
    return Predicted(
        drift=Deviation(mean @ e, mean @ S @ mean.T), heading=heading, points=Deviation(e, S)
    )


def _means(axis_index: NDArray, duration_s: NDArray) -> NDArray:
    """Rows (2, m) that make the mean bias of each level gyro."""
    weights = np.stack([np.where(axis_index == axis, duration_s, 0.0) for axis in LEVEL_AXES])
    return np.asarray(weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-300))


def _heading(error_rad: float, before_rad: float, after_rad: float) -> Deviation | None:
    """The heading error that the update found; what it was to be is normal with the variance that
    the update took away.
    """
    variance = before_rad**2 - after_rad**2
    if not np.isfinite(error_rad + variance) or variance < HEADING_SEEN * before_rad**2:
        return None
    return Deviation(np.array([error_rad / MILLIRADIAN]), np.array([[variance / MILLIRADIAN**2]]))
