"""`replay.json`, schema recal.replay/1: what `infield.replay.free_inertial` found, in units of the
border.

    verdict, reasons, notes     "replayed", "refused" or "inconsistent"; notes hold for any verdict
    run_id, run_sha256, imu_serial, gyro_technology, store, noise_model, version
    vertical                    what the height was damped to
    alignment_span, parked_span {start_s, end_s}
    tables[]                    role ("active", "previous"), origin, revision, sha256, notes, and:
      alignment                 as alignment.json: attitude at the end of the alignment, sigmas,
      verdict, reasons parked                    a drift (below) against the parked position
      predicted                 sigma_nm_h and sigma_end_speed_m_s of that drift;
      level_gyro_sigma_deg_h (north gyro,
                                mean over the span), rule_of_thumb_nm_h = 60 NM/h per deg/h of it;
                                seen_over_sigma
      schuler                   period_min with sigma_period_min and amplitude_m_s of the parked
      velocity's swing, null with a
                                reason where it cannot be fitted; expected_period_min = 2 pi
                                sqrt(R/g)
      stops[]                   start_s, end_s, ground_speed_m_s, ground_speed_kt (median), max_m_s,
      realign, seen_by
                                ("gnss", "odometer"; "imu": neither covers it, it may be a steady
                                roll)
      realign                   any residual ground speed above 5 kt while standing
      realign_at                where that was: "parked", or seen_by of the stops
      gnss                      a drift against GNSS after the parked span, null where none is
      logged scoring_only              reference: a drift against it after the parked span;
      heading_error_mrad, in sigmas too
    difference                  active less previous: NM/h, heading, and what the tables' own
    difference predicts of the
                                heading and of the position at the end of the parked span; null
                                without two flights
    aided                       the solution with GNSS (infield.reports.documents.aided), null
    without GNSS or with --no-aided definitions                 of the measures, in words

A drift: hours, end_radial_error_nm (and _m), max_radial_error_nm, rate_nm_h, rms_rate_nm_h,
end_speed_m_s, max_speed_m_s, end_speed_kt, drift_class, limit_2t_2_nm, limit_3t_3_nm at the end.
The same input gives the same bytes: there is no time of issue.
"""

from typing import Any

import numpy as np

from alignment.document import alignment_document
from infield.replay.drift import CLASSES, REALIGN_M_S, Drift
from infield.replay.drift_prediction import NM_H_PER_DEG_H, level_shares
from infield.replay.free_inertial import ReplayResult, StopSpeed, TableReplay, heading_change
from infield.replay.schuler import fit_schuler
from infield.reports.documents.aided import aided_document
from ins.records import ReferenceLog, Run, TwinModel
from ins.twin_file import twin_to_dict
from ins.units import DEG, KNOT, MILLIRADIAN, NAUTICAL_MILE

DEFINITIONS = {
    "parked": (
        "free-inertial from the end of the alignment until the vehicle rolls, against the parked"
        " position"
    ),
    "rate_nm_h": "radial position error at the end of the span / hours since navigation began",
    "rms_rate_nm_h": (
        "RMS radial error over the span / RMS time since navigation began: "
        "the slope of the straight line through the start that has the error's own RMS"
    ),
    "drift_class": (
        "2T+2 where the radial error stays within 2 T + 2 NM at every time T [h] of the span, else"
        " 3T+3, else beyond 3T+3"
    ),
    "realign": f"residual ground speed above {REALIGN_M_S / KNOT:.0f} kt while the vehicle stands",
    "predicted": (
        "table covariance, and turn-on, flicker and random walks of the noise model, through the"
        " linear error model from a gyrocompass alignment on: one sigma of the parked rate_nm_h"
    ),
    "schuler": (
        "one period fitted to north and east velocity while parked, beside a straight line; sigma"
        " by what is left, in stretches; 84.4 min where nothing but tilt moves the velocity"
    ),
    "gnss": (
        "solution less GNSS after the parked span, time counted from the end of the alignment; the"
        " offset while parked (a site entered roughly) is taken out"
    ),
    "aided": (
        "the log compensated with the active table, navigated with its satellite fixes; NIS:"
        " squared innovation over what the filter expects, 1 where its sigmas are honest"
    ),
    "scoring_only": "the run's reference (truth): it scores, it never navigates",
}


def replay_document(
    result: ReplayResult,
    twin: TwinModel,
    *,
    store: str | None,
    version: str,
    notes: tuple[str, ...] = (),
    thermal_model: dict[str, Any] | None = None,
    reference: ReferenceLog | None = None,
) -> dict[str, Any]:
    """The document; `notes` are what the caller knows of the tables, and come first; thermal_model:
    as in update.json; reference: scores the aided solution.
    """
    header, tables = result.run.header, [_table(t, result) for t in result.tables]
    return {
        "schema": "recal.replay/1",
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "notes": [*notes, *result.notes],
        "run_id": header.run_id,
        "run_sha256": result.run.sha256,
        "imu_serial": header.imu_serial,
        "gyro_technology": header.gyro_technology,
        "start_utc": header.start_utc,
        "store": store,
        "version": version,
        "noise_model": {"source": twin.source, **twin_to_dict(twin)},
        "vertical": result.vertical,
        "alignment_span": _span(result.alignment_span),
        "parked_span": _parked_span(result),
        "tables": tables,
        "difference": _difference(result),
        "aided": aided_document(result.aided, reference),
        "definitions": dict(DEFINITIONS),
        **({} if thermal_model is None else {"thermal_model": thermal_model}),
    }


def _span(span: tuple[float, float] | None) -> dict[str, float] | None:
    return None if span is None else {"start_s": span[0], "end_s": span[1]}


def _parked_span(result: ReplayResult) -> dict[str, float] | None:
    starts = [t.alignment.time_s for t in result.tables if t.history is not None]
    return None if result.parked_until_s is None else _span((min(starts), result.parked_until_s))


def _table(t: TableReplay, result: ReplayResult) -> dict[str, Any]:
    fast = {s.seen_by for s in t.stops if s.realign}
    if t.parked is not None and t.parked.speed_m_s[-1] > REALIGN_M_S:
        fast.add("parked")
    return {
        "role": t.choice.role,
        "origin": t.choice.origin,
        "revision": t.choice.revision,
        "sha256": t.choice.sha256,
        "applied": t.choice.table is not None,
        "notes": list(t.notes),
        "alignment": _alignment(t, result.run),
        "parked": _drift(t.parked),
        "predicted": _predicted(t),
        "schuler": _schuler(t, result.run),
        "stops": [_stop(s) for s in t.stops],
        "realign": bool(fast),
        "realign_at": sorted(fast),
        "gnss": _drift(t.gnss),
        "scoring_only": _scoring(t),
    }


def _alignment(t: TableReplay, run: Run) -> dict[str, Any]:
    document = alignment_document(t.alignment, run)
    return {
        k: v for k, v in document.items() if k not in ("schema", "run_id", "imu_serial", "phases")
    }


def _drift(d: Drift | None) -> dict[str, Any] | None:
    if d is None:
        return None
    (_, slope2, offset2), (_, slope3, offset3) = CLASSES
    return {
        "hours": d.hours,
        "end_radial_error_m": float(d.radial_m[-1]),
        "end_radial_error_nm": float(d.radial_m[-1]) / NAUTICAL_MILE,
        "max_radial_error_nm": float(d.radial_m.max()) / NAUTICAL_MILE,
        "rate_nm_h": d.rate_nm_h,
        "rms_rate_nm_h": d.rms_rate_nm_h,
        "end_speed_m_s": float(d.speed_m_s[-1]),
        "max_speed_m_s": float(d.speed_m_s.max()),
        "end_speed_kt": float(d.speed_m_s[-1]) / KNOT,
        "drift_class": d.drift_class,
        "limit_2t_2_nm": slope2 * d.hours + offset2,
        "limit_3t_3_nm": slope3 * d.hours + offset3,
    }


def _predicted(t: TableReplay) -> dict[str, Any] | None:
    if t.predicted is None or t.parked is None or t.bins is None or t.alignment.C_nb is None:
        return None
    start_s = t.alignment.time_s
    north = level_shares(
        t.bins.edges_s, t.alignment.C_nb, (start_s, start_s + t.parked.time_s[-1])
    )[0]
    sigma = float(np.sqrt(north @ t.bins.prior @ north))
    return {
        "sigma_nm_h": t.predicted.sigma_nm_h,
        "sigma_end_speed_m_s": float(t.predicted.sigma_speed_m_s[-1]),
        "seen_over_sigma": t.parked.rate_nm_h / t.predicted.sigma_nm_h,
        "level_gyro_sigma_deg_h": sigma,
        "rule_of_thumb_nm_h": NM_H_PER_DEG_H * sigma,
    }


def _schuler(t: TableReplay, run: Run) -> dict[str, Any] | None:
    """Null without a flight; period null and the reason where it could not be fitted."""
    if t.history is None:
        return None
    fit = fit_schuler(t.parked, run.header.site)
    return {
        "period_min": fit.period_s / 60.0,
        "sigma_period_min": fit.sigma_s / 60.0,
        "amplitude_m_s": fit.amplitude_m_s,
        "expected_period_min": fit.expected_s / 60.0,
        "reason": fit.reason,
    }


def _stop(s: StopSpeed) -> dict[str, Any]:
    return {
        "start_s": s.start_s,
        "end_s": s.end_s,
        "ground_speed_m_s": s.median_m_s,
        "ground_speed_kt": s.median_m_s / KNOT,
        "max_m_s": s.max_m_s,
        "realign": s.realign,
        "seen_by": s.seen_by,
    }


def _scoring(t: TableReplay) -> dict[str, Any] | None:
    if np.isnan(t.heading_error_rad):
        return None
    return {
        "source": "reference",
        "reference": _drift(t.reference),
        "heading_error_mrad": t.heading_error_rad / MILLIRADIAN,
        "heading_error_sigmas": t.heading_error_rad / t.alignment.sigma_heading_rad,
    }


def _difference(result: ReplayResult) -> dict[str, Any] | None:
    """What changed from the previous to the active table, and what their difference says should
    have.
    """
    new, old, turned = result.of("active"), result.of("previous"), heading_change(result)
    if new is None or old is None or turned is None:
        return None
    out: dict[str, Any] = {
        "heading_deg": turned[0] / DEG,
        "heading_mrad": turned[0] / MILLIRADIAN,
        "heading_expected_mrad": turned[1] / MILLIRADIAN,
        "rate_nm_h": None,
        "rms_rate_nm_h": None,
        "parked_end_displacement_m": None,
    }
    if new.parked is None or old.parked is None:
        return out
    for key in ("rate_nm_h", "rms_rate_nm_h"):
        before, after = getattr(old.parked, key), getattr(new.parked, key)
        out[key] = {"previous": before, "active": after, "change": after - before}
    if new.predicted is not None and new.bins is not None and old.bins is not None:
        expected = -new.predicted.response_m_per_deg_h @ (
            new.bins.table_deg_h - old.bins.table_deg_h
        )
        seen = new.parked.position_m[-1] - old.parked.position_m[-1]
        out["parked_end_displacement_m"] = {
            axis: {"seen": float(seen[k]), "expected": float(expected[k])}
            for k, axis in enumerate(("north", "east"))
        }
    return out
