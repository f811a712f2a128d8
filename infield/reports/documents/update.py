"""The result of an update as the plain document of formats.md section 5 (`update.json`), with all a
report shows.

Everything is computed here; `infield.reports.update_page` only draws it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from alignment.gyrocompass import excluded_spans
from alignment.navigation_filter import LATERAL_TIME_S
from infield.reports.documents import parked as parked_document
from infield.reports.documents.session import (
    heading_error,
    logged_phases,
    phases_of,
    session_document,
)
from infield.reports.documents.update_records import (
    BudgetDocument,
    ChangeDocument,
    ConsistencyDocument,
    EffectsCompared,
    EffectsOutcome,
    MergeDocument,
    MethodDocument,
    PointDocument,
    PredictedEffect,
    UpdateDocument,
    VarianceShares,
)
from infield.session.budget import variance_budget
from infield.session.points import AxisObservability
from infield.session.results import SessionResult, UpdateResult
from infield.session.settings import misalignment_sigma_mrad
from infield.table.file import table_from_dict, table_sha256, table_to_dict
from infield.table.thermal_table import ThermalTable
from ins.documents import Null, made
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.kalman import nis_band
from ins.noise import FLICKER_FLOOR, random_walk_covariance
from ins.records import AXES, Span, TableDocument
from ins.twin_file import twin_to_dict
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, HOUR, MICRO_G, MILLIRADIAN
from ins.verdicts import Observability, Outcome

DECISION_RULE = (
    "A session is merged when the unit was at rest for at least 5 min, gyro temperatures were"
    " logged and moved or were live, the filter's NIS is not above its 99.9 % band, the session"
    " agrees with the stored table within 99.9 %, the run was not merged before, and at least one"
    " gyro's mean bias became better known by 10 % or more."
)
PARKED_RULE = (
    "A session of gyros that find no heading (MEMS) is merged when it holds a parked stretch of at"
    " least 60 s, judged by the raw seconds in sigmas of this unit, gyro temperatures were logged"
    " and moved or were live, the rates change along it as table and noise model allow (NIS not"
    " above its 99.9 % band), the session agrees with the stored table within 99.9 %, the run was"
    " not merged before, and at least one gyro's mean bias became better known by 10 % or more."
)

SCHEMA = "recal.update/1"
# mean radial drift of a level gyro bias: R u = 60 NM/h per deg/h (physics.md 6.3)
NM_H_PER_DEG_H = 60.0
METHOD = (
    "in-field recalibration after US 5,527,003: navigation-mode error filter, joint merge with full"
    " covariance"
)


def update_document(
    result: UpdateResult, *, version: str, table_before: TableDocument
) -> UpdateDocument:
    """update.json of an update that no store holds yet; table_before: the dict as stored, so that
    its hash is the stored one.
    """
    accepted = result.outcome is Outcome.ACCEPTED
    estimated = [s for s in result.sessions if s.estimate is not None]
    best = estimated[-1] if estimated else None
    without_heading = parked_document.parked_sessions(result)
    parked = len(without_heading) == len(estimated) and result.before.gyro_technology == "mems"
    after = table_to_dict(result.after) if result.merged_runs else table_before
    return made(
        UpdateDocument,
        result,
        schema=SCHEMA,
        verdict=Outcome.PROPOSED if accepted else result.outcome,
        heading_error=heading_error(best),
        observability=_observability(estimated),
        points=[point for s in estimated for point in _points(s)],
        excluded=[span for s in result.sessions for span in _excluded(s)],
        consistency=_consistency(estimated),
        table_before=table_before,
        table_after=after,
        uncertainty_budget=_budget(best, result) if best else [],
        variance_shares=_variance_shares(result),
        table_before_sha256=table_sha256(table_before),
        table_after_sha256=table_sha256(after),
        method=MethodDocument(
            name=parked_document.method(result) if parked else METHOD,
            program="recal",
            version=version,
        ),
        issued_utc=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        decision_rule=PARKED_RULE if parked else DECISION_RULE,
        noise_model={"source": result.twin.source, **twin_to_dict(result.twin)},
        assumptions=parked_document.assumptions(result) if parked else _assumptions(result),
        predicted_effect=None if parked else _predicted_effect(result),
        zero_rate_effect=(parked_document.effect(result) or Null.NULL) if parked else None,
        changes=_changes(result.before, result.after),
        sessions=[session_document(s) for s in result.sessions],
    )


def effects_compared(taken_out: UpdateResult, left_in: UpdateResult) -> EffectsCompared:
    """The same runs updated without the twin's effects in them, and as they were logged."""
    return EffectsCompared(taken_out=_effects_outcome(taken_out), left_in=_effects_outcome(left_in))


def _effects_outcome(result: UpdateResult) -> EffectsOutcome:
    estimated = [s for s in result.sessions if s.estimate is not None]
    merged = [s.merged for s in estimated if s.merged is not None]
    dof = sum(m.dof for m in merged)
    parked = result.before.gyro_technology == "mems"
    change = None if parked else _predicted_effect(result)
    accepted = result.outcome is Outcome.ACCEPTED
    return EffectsOutcome(
        verdict=Outcome.PROPOSED if accepted else result.outcome,
        heading_error=heading_error(estimated[-1] if estimated else None),
        nis_mean=_consistency(estimated).nis_mean,
        merge_nis=sum(m.nis for m in merged) / dof if dof else None,
        level_change_deg_h=None if change is None else change.level_change_deg_h,
        drift_removed_nm_h=None if change is None else change.drift_removed_nm_h,
    )


def _observability(sessions: list[SessionResult]) -> dict[str, AxisObservability]:
    """Per axis, the session that saw it best."""
    found: dict[str, AxisObservability] = {}
    refused = all(s.verdict.outcome is Outcome.REFUSED for s in sessions)
    for k, axis in enumerate(AXES):
        seen = [s.seen[k] for s in sessions if s.seen]
        if not seen:
            continue
        best = min(seen, key=lambda a: a.sigma_after_deg_h / a.sigma_before_deg_h)
        found[axis] = replace(best, axis=None)
        if refused:
            found[axis] = AxisObservability(
                sigma_before_deg_h=best.sigma_before_deg_h,
                sigma_after_deg_h=best.sigma_before_deg_h,
                verdict=Observability.NOT_OBSERVABLE,
                advice="the session was refused, see the reasons",
            )
    return found


def _points(session: SessionResult) -> list[PointDocument]:
    p, e = session.points, session.estimate
    if p is None or e is None:
        return []
    phases = phases_of(p, logged_phases(session, e))
    verdicts = {a.axis: a.verdict for a in session.seen}
    common = p.common_sigma_deg_h
    return [
        PointDocument(
            axis=AXES[axis],
            time_s=float(p.time_s[k]),
            temperature_degC=float(p.temperature_degC[k]),
            bias_deg_h=float(p.bias_deg_h[k]),
            sigma_deg_h=float(p.sigma_deg_h[k]),
            temperature_rate_degC_min=float(p.temperature_rate_degC_min[k]),
            start_s=float(p.time_s[k] - 0.5 * p.duration_s[k]),
            duration_s=float(p.duration_s[k]),
            gradient_degC=_number(p.gradient_degC, k),
            sigma_temperature_degC=_number(p.sigma_temperature_degC, k),
            sigma_temperature_rate_degC_min=_number(p.sigma_rate_degC_min, k),
            run_id=p.run_id,
            run_sha256=p.run_sha256,
            applied_table_sha256=p.applied_table_sha256,
            observability=verdicts.get(AXES[axis], Observability.NOT_OBSERVABLE),
            phase=phases[k],
            sigma_common_deg_h=float(common[axis]),
            sigma_own_deg_h=float(np.sqrt(max(p.covariance[k, k] - common[axis] ** 2, 0.0))),
        )
        for k, axis in enumerate(p.axis_index)
    ]


def _number(values: NDArray | None, k: int) -> float | None:
    return None if values is None or not np.isfinite(values[k]) else float(values[k])


def _excluded(session: SessionResult) -> list[Span]:
    """What was left out of one run: repaired, without a thermometer, moved."""
    spans: list[Span] = list(session.run.faults)
    if session.temperature is not None:
        spans += session.temperature.left_out()
    if session.estimate is not None and session.estimate.parked is not None:
        spans += [*session.estimate.motion.excluded(), *session.estimate.parked.left_out]
    elif session.estimate is not None:
        spans += excluded_spans(session.estimate.navigated)
    return [span.in_words(session.run.header.run_id) for span in spans]


def _consistency(sessions: list[SessionResult]) -> ConsistencyDocument:
    estimates = [s.estimate for s in sessions if s.estimate]
    dof = sum(e.dof for e in estimates)
    total = sum(e.nis_mean * e.dof for e in estimates)
    return ConsistencyDocument(
        nis_mean=total / dof if dof else None,
        dof=dof,
        band_95=nis_band(dof, 0.95) if dof else None,
        band_999=nis_band(dof, 0.999) if dof else None,
        merge=[
            made(MergeDocument, s.merged, run_id=s.run.header.run_id) for s in sessions if s.merged
        ],
    )


def _budget(session: SessionResult, result: UpdateResult) -> list[BudgetDocument]:
    """Terms of the session's mean bias, each alone, one sigma."""
    parked = session.estimate is not None and session.estimate.parked is not None
    terms = parked_document.budget_terms if parked else _budget_terms
    return [
        BudgetDocument(axis=axis, term=term, sigma_deg_h=float(sigma))
        for axis, of_axis in zip(AXES, terms(session, result))
        for term, sigma in of_axis.items()
        if sigma > 0
    ]


def _variance_shares(result: UpdateResult) -> list[VarianceShares]:
    """Per gyro: of the mean over the temperatures visited, then of every node."""
    budget = variance_budget(result)
    if budget is None:
        return []
    table = budget.table
    visited = [
        s.estimate.bins for s in result.sessions if s.merged is not None and s.estimate is not None
    ]
    found: list[VarianceShares] = []
    for k, axis in enumerate(AXES):
        T = np.concatenate([bins.temperature_degC[bins.tied[:, k], k] for bins in visited])
        places = [(float(t), table.basis(k, t)[0]) for t in table.temperature_degC[k]]
        mean = [(None, table.basis(k, T).mean(axis=0))] if T.size else []
        for temperature_degC, row in [*mean, *places]:
            found.append(
                VarianceShares(
                    axis=axis,
                    temperature_degC=temperature_degC,
                    sigma_deg_h=float(np.sqrt(row @ table.covariance @ row)),
                    shares={s.value: share for s, share in budget.shares(row).items()},
                )
            )
    return found


def _budget_terms(session: SessionResult, result: UpdateResult) -> list[Mapping[str, float]]:
    """Of a navigated session on x, y and z, by closed form (physics.md 6.4 and its head)."""
    e, twin = session.estimate, result.twin
    assert e is not None
    seconds = float(e.bins.edges_s[-1] - e.bins.edges_s[0])
    lat, heading = session.run.header.site.lat_rad, e.alignment.heading_rad
    east = {"x": abs(np.sin(heading)), "y": abs(np.cos(heading)), "z": 0.0}
    g = float(gravity_magnitude(lat, session.run.header.site.height_m))
    tilt = twin.accel.turn_on_ug * MICRO_G / g
    omega = EARTH_RATE_RAD_S / DEG_PER_HOUR
    walk = (
        twin.gyro.rate_random_walk_deg_h_sqrt_h**2
        / HOUR
        * random_walk_covariance(np.zeros(1), np.array([seconds]))
    )
    creep = twin.vehicle.yaw_creep_arcsec_sqrt_h * ARCSEC / DEG / np.sqrt(seconds / HOUR)
    misalignment = misalignment_sigma_mrad(twin, result.settings)
    found: list[Mapping[str, float]] = []
    for axis in AXES:
        level = axis != "z"
        of_tilt = abs(np.sin(lat)) if level else np.cos(lat)
        found.append(
            {
                "angle random walk": twin.gyro.arw_deg_sqrt_h / np.sqrt(seconds / HOUR),
                "accelerometer bias (tilt)": omega * tilt * of_tilt,
                "heading (east part)": omega * np.cos(lat) * e.sigma_heading_rad * east[axis],
                "yaw creep of the airframe": 0.0 if level else creep,
                "misalignment": omega * misalignment[AXES.index(axis)] * MILLIRADIAN,
                "turn-on, this session against the mean": twin.gyro.turn_on_deg_h,
                "bias instability": FLICKER_FLOOR * twin.gyro.bias_instability_deg_h,
                "rate random walk": float(np.sqrt(walk[0, 0])),
            }
        )
    return found


def _assumptions(result: UpdateResult) -> list[str]:
    s, twin = result.settings, result.twin
    misaligned = ", ".join(f"{sigma:.3g}" for sigma in misalignment_sigma_mrad(twin, s))
    hold = (
        f"the parked airframe keeps its heading up to {twin.vehicle.yaw_creep_arcsec_sqrt_h:g}"
        " arcsec/sqrt(h)"
    )
    return [
        (
            hold
            if s.hold_heading
            else "no parked-attitude constraint: the vertical gyro rests on its prior"
        ),
        (
            f"crab within {s.sigma_crab_mrad:g} mrad, wheel lever arm within"
            f" {s.sigma_lever_arm_m:g} m, wheel scale within {100 * s.sigma_odometer_scale:g} %"
            " (1 sigma), all estimated"
        ),
        (
            "wind, side slip, the antenna's arm, delays of receiver and wheels as declared, unless"
            " the data ask for more: then estimated"
        ),
        (
            f"lateral motion while rolling {twin.vehicle.lateral_noise_m_s:g} m/s RMS over"
            f" {LATERAL_TIME_S:g} s"
        ),
        f"gyro misalignment within {misaligned} mrad for x, y, z (1 sigma)",
        f"noise of the unit from {twin.source}",
        *_undetected(result),
        (
            f"ageing of the table {result.ageing.common_deg_h_sqrt_year:g} deg/h common and "
            f"{result.ageing.shape_deg_h_sqrt_year:g} deg/h shape per square root of a year"
        ),
    ]


def _undetected(result: UpdateResult) -> list[str]:
    """What is taken as declared because these runs would not show that it is wrong."""
    lines = [
        f"gyro technology {result.after.gyro_technology} as declared: but for their noise,"
        " ring-laser and fibre-optic gyros read alike in these runs"
    ]
    merged = [s.run for s in result.sessions if s.verdict.accepted]
    directed = [run.gnss is not None or run.header.survey.heading_rad is not None for run in merged]
    if not any(directed):
        lines.append(
            "order and signs of the gyros as declared: without a receiver or a surveyed heading, a"
            " turned or swapped level gyro may read like another heading"
        )
    return lines


def _predicted_effect(result: UpdateResult) -> PredictedEffect | None:
    """What the change means at the temperatures visited, the new table taken as the better one."""
    session = next(
        (s for s in reversed(result.sessions) if s.merged is not None and s.estimate is not None),
        None,
    )
    if session is None or session.estimate is None or not result.merged_runs:
        return None
    T = session.estimate.bins.temperature_degC
    change = level_change(result.before, result.after, (T[:, 0], T[:, 1]))
    coupling = EARTH_RATE_RAD_S * np.cos(session.run.header.site.lat_rad) / DEG_PER_HOUR
    return PredictedEffect(
        level_change_deg_h=change.level_deg_h,
        drift_removed_nm_h=change.drift_removed_nm_h,
        drift_left_sigma_nm_h=change.drift_left_nm_h,
        heading_removed_mrad=change.level_deg_h / np.sqrt(2.0) / coupling / MILLIRADIAN,
        heading_left_sigma_mrad=change.left_deg_h / np.sqrt(2.0) / coupling / MILLIRADIAN,
        temperature_degC=(float(T[:, :2].min()), float(T[:, :2].max())),
    )


@dataclass(frozen=True, kw_only=True)
class LevelChange:
    """RMS length of the level gyros' change (x, y) between two tables, and of what the new one
    leaves unknown [deg/h].
    """

    level_deg_h: float
    left_deg_h: float

    @property
    def drift_removed_nm_h(self) -> float:
        return NM_H_PER_DEG_H * self.level_deg_h

    @property
    def drift_left_nm_h(self) -> float:
        """One sigma."""
        return NM_H_PER_DEG_H * self.left_deg_h


def level_change(
    before: ThermalTable, after: ThermalTable, temperature_degC: tuple[NDArray, NDArray]
) -> LevelChange:
    """The change at temperatures of gyros x and y, (n,) and (m,)."""
    change = [
        after.bias_deg_h(k, T) - before.bias_deg_h(k, T) for k, T in enumerate(temperature_degC)
    ]
    sigma = [after.sigma_deg_h(k, T) for k, T in enumerate(temperature_degC)]
    level, left = (float(np.sqrt(sum(np.mean(v**2) for v in values))) for values in (change, sigma))
    return LevelChange(level_deg_h=level, left_deg_h=left)


def _changes(before: ThermalTable, after: ThermalTable) -> list[ChangeDocument]:
    """Every node of the new table beside the old table at its temperature."""
    rows = []
    for k, axis in enumerate(AXES):
        T = after.temperature_degC[k]
        old, new = before.bias_deg_h(k, T), after.bias_deg_h(k, T)
        old_sigma, new_sigma = before.sigma_deg_h(k, T), after.sigma_deg_h(k, T)
        for j, node_degC in enumerate(T):
            rows.append(
                ChangeDocument(
                    axis=axis,
                    temperature_degC=float(node_degC),
                    before_deg_h=float(old[j]),
                    U_before_k2_deg_h=2 * float(old_sigma[j]),
                    after_deg_h=float(new[j]),
                    U_after_k2_deg_h=2 * float(new_sigma[j]),
                    change_deg_h=float(new[j] - old[j]),
                )
            )
    return rows


COVERAGE = 2.0  # U(k=2)


@dataclass(frozen=True, kw_only=True)
class TableUncertainty:
    """U(k=2) [deg/h] of one gyro's table, RMS over the temperatures of the bias points [degC]."""

    U_before_k2_deg_h: float
    U_after_k2_deg_h: float
    low_degC: float
    high_degC: float


def table_uncertainty(document: UpdateDocument) -> dict[str, TableUncertainty]:
    """Gyro by gyro, for those with bias points."""
    before = table_from_dict(document.table_before, name="table_before")
    after = table_from_dict(document.table_after or document.table_before, name="table_after")
    found = {}
    for axis in document.observability:
        T = np.array([p.temperature_degC for p in document.points if p.axis == axis])
        if T.size == 0:
            continue
        found[axis] = TableUncertainty(
            U_before_k2_deg_h=_rms(COVERAGE * before.sigma_deg_h(axis, T)),
            U_after_k2_deg_h=_rms(COVERAGE * after.sigma_deg_h(axis, T)),
            low_degC=float(T.min()),
            high_degC=float(T.max()),
        )
    return found


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
