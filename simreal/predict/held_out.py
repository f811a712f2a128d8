"""What a twin predicts of the update of a run that it was not fitted to, before and after the found
effects are in it.

The table and the noise predict the bias points of a session with their covariance; what is measured
less what is predicted is the update's own innovation (`infield.table.merge`). An effect of the
twin's is taken out of the log first, a noise goes into the twin's numbers: so the prediction is the
one that the update itself would make.

Which effects there are is what all runs said, as in the shrink (`simreal.inference.addback`): three
runs of four often cannot tell a linear function of temperature from its rate. How large they are is
fitted to the other runs alone. Runs held out took no part in either.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from infield.replay.drift_prediction import NM_H_PER_DEG_H
from infield.session.pipeline import update_calibration
from infield.session.results import SessionResult
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermal.found_effects import FoundEffect, with_effect_sigma, without_effects
from ins.errors.table import TABLE_AGED
from ins.records import Run, TwinModel
from ins.units import MILLIRADIAN
from simreal.declared.twin_effects import TwinEffect, parse_effects
from simreal.evidence.run_view import RunView
from simreal.inference.addback import HeldOut
from simreal.inference.attribute import Slot
from simreal.inference.causes import Cause
from simreal.inference.diagnosis import Diagnosis, NotLookedAt
from simreal.inference.verdict import KeptOut
from simreal.predict.carried import along, foretells, with_noise_of
from simreal.predict.measures import Deviation
from simreal.predict.traces import fitted, fitted_without, unit_traces
from simreal.twin.write_back import fitted_items

LEVEL_AXES = (0, 1)
# of the heading's prior variance that the update must take away before its heading error says
# something of the prediction; chosen: 0.19 of it is a sigma of 0.9, the bound of
# infield.reports.documents.session (UNSEEN_SIGMA)
HEADING_SEEN = 0.19
NO_UPDATE = "an update refuses the run"
UPDATED = SessionSettings(claim_chain=False)  # a side path that no figure here needs
NOT_BORNE = (KeptOut.NOT_SHOWN, KeptOut.MADE_WORSE, KeptOut.OF_MOTION)

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
class _Carried:
    """What was found and holds in other runs: by effect its slots, or the noise that it is."""

    slots: dict[Key, list[Slot]]
    noise: dict[Key, list[TwinEffect]]
    own: tuple[Key, ...]

    @property
    def keys(self) -> tuple[Key, ...]:
        return tuple(dict.fromkeys((*self.slots, *self.noise)))


def predict_runs(
    runs: Sequence[Run],
    found: Diagnosis,
    table: ThermalTable,
    hold_out: Sequence[str] = (),
    told: Callable[[str], None] = lambda words: None,
) -> Simulator:
    """Predicts each run from the others, or the runs held out from the rest.

    Parameters
    ----------
    runs : of one unit.
    found : their diagnosis.
    table : that the updates begin with: the twin's, or that of an unknown unit.
    hold_out : run ids that took no part in the attribution; only those are predicted.
    told : told what is being done.
    """
    views = {view.name: k for k, view in enumerate(found.views)}
    why = {one.run_id: one.why for one in found.not_looked_at}
    carried = _carried(found)
    done: list[HeldOutRun] = []
    undone: list[NotLookedAt] = []
    for run in runs:
        name = run.header.run_id
        if hold_out and name not in hold_out:
            continue
        told(f"predicting {name}")
        number = views.get(name)
        if number is None:
            undone.append(NotLookedAt(name, why[name]))
            continue
        predicted = _predict(run, number, found, carried, table, hold_out)
        if predicted is None:
            undone.append(NotLookedAt(name, NO_UPDATE))
        else:
            done.append(predicted)
    return Simulator(tuple(done), tuple(undone))


def _predict(
    run: Run,
    number: int,
    found: Diagnosis,
    carried: _Carried,
    table: ThermalTable,
    hold_out: Sequence[str],
) -> HeldOutRun | None:
    """The predictions of a run; None where an update says nothing of it."""
    view, twin = found.views[number], found.twin
    effects = _fitted_effects(found, number, carried, apart=bool(hold_out))
    update = _Update(run, view, twin, table, parse_effects(twin))
    keys = frozenset(carried.keys)
    done: dict[frozenset[Key], Predicted | None] = {}

    def with_effects(chosen: frozenset[Key]) -> Predicted | None:
        if chosen not in done:
            added = [effects[key] for key in chosen if key in effects]
            noise = [item for key in chosen for item in carried.noise.get(key, ())]
            done[chosen] = update.predicted(added, noise)
        return done[chosen]

    before, after = with_effects(frozenset()), with_effects(keys)
    if before is None or after is None:
        return None
    names = [v.name for v in found.views if v.name not in hold_out]
    return HeldOutRun(
        run_id=view.name,
        fitted_to=tuple(name for name in names if name != view.name),
        found=carried.keys,
        own=carried.own,
        before=before,
        after=after,
        alone={key: with_effects(frozenset({key})) or before for key in keys},
        without={key: with_effects(keys - {key}) or after for key in keys},
    )


def _carried(found: Diagnosis) -> _Carried:
    """What was found and can be predicted elsewhere, by effect; then what cannot."""
    carried = _Carried({}, {}, ())
    own: list[Key] = []
    for cause, number in zip(found.causes, found.order):
        key, slot = (cause.effect, cause.target), found.attribution.slots[number]
        if cause.kept_out in NOT_BORNE:
            own.append(key)
        elif slot.group is None:
            carried.noise.setdefault(key, []).extend(_noise_of(cause, found))
        elif cause.effect == TABLE_AGED or HeldOut.judges(slot):
            carried.slots.setdefault(key, []).append(slot)
        else:
            own.append(key)
    own += [key for key, items in carried.noise.items() if not items]
    noise = {key: items for key, items in carried.noise.items() if items}
    return replace(carried, noise=noise, own=tuple(dict.fromkeys(own)))


def _noise_of(cause: Cause, found: Diagnosis) -> list[TwinEffect]:
    listed = tuple(fitted_items(cause, [view.name for view in found.views]))
    return [item for item in parse_effects(replace(found.twin, effects=listed)) if foretells(item)]


def _fitted_effects(
    found: Diagnosis, run: int, carried: _Carried, *, apart: bool
) -> dict[Key, FoundEffect]:
    """What each effect adds to a run by the fit to the others; apart: the run took no part."""
    attribution = found.attribution
    beta, covariance = fitted(attribution) if apart else fitted_without(attribution, run)
    traces = unit_traces(found, run)
    time_s = found.views[run].telemetry.time_s
    out = {}
    for key, slots in carried.slots.items():
        columns = np.concatenate([slot.columns for slot in slots])
        at = np.flatnonzero(np.isin(attribution.columns, columns))
        gyro = _stacked([traces[k].gyro_rad_s for k in at], time_s.size)
        accel = _stacked([traces[k].accel_m_s2 for k in at], time_s.size)
        C = covariance[np.ix_(at, at)]
        out[key] = FoundEffect(
            effect=key[0],
            target=key[1],
            time_s=time_s,
            gyro_rad_s=gyro @ beta[at],
            accel_m_s2=accel @ beta[at],
            gyro_sigma_rad_s=np.sqrt(np.maximum(np.einsum("nip,pq,niq->ni", gyro, C, gyro), 0.0)),
        )
    return out


def _stacked(series: Sequence[NDArray | None], n: int) -> NDArray:
    """Columns (n, 3, p), zeros where there is nothing."""
    return np.stack([np.zeros((n, 3)) if one is None else one for one in series], axis=-1)


@dataclass(frozen=True)
class _Update:
    """Updates of one run from the twin's table, with effects out of its log or not."""

    run: Run
    view: RunView
    twin: TwinModel
    table: ThermalTable
    listed: Sequence[TwinEffect]

    def predicted(
        self, added: Sequence[FoundEffect], noise: Sequence[TwinEffect]
    ) -> Predicted | None:
        """Measured less predicted with these effects beside those that the twin lists; None where
        the update says nothing of the run.
        """
        listed = [item for item in self.listed if item.in_run(self.run.header.run_id)]
        known = [along(item, self.view.telemetry) for item in listed if not item.is_noise]
        effects = [*known, *added]
        twin = replace(with_noise_of(self.twin, [*listed, *noise]), effects=(), table=None)
        twin = with_effect_sigma(twin, [effects])
        run = without_effects(self.run, effects)
        result = update_calibration([run], self.table, twin, settings=UPDATED)
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
