"""`replay.json`, schema recal.replay/1: what `infield.replay.free_inertial` found, in units of the
border::

    verdict, reasons, notes     "replayed", "refused" or "inconsistent"; notes hold for any verdict
    run_id, run_sha256, imu_serial, gyro_technology, store, noise_model, version
    vertical                    what the height was damped to
    alignment_span, parked_span {start_s, end_s}
    tables[]                    role ("active", "previous"), origin, revision, sha256, notes, and:
      alignment                 as alignment.json: attitude at the end of the alignment, sigmas,
                                verdict, reasons
      parked                    a drift (below) against the parked position
      predicted                 sigma_nm_h and sigma_end_speed_m_s of that drift;
                                level_gyro_sigma_deg_h (north gyro, mean over the span),
                                rule_of_thumb_nm_h = 60 NM/h per deg/h of it; seen_over_sigma
      schuler                   period_min with sigma_period_min and amplitude_m_s of the parked
                                velocity's swing, null with a reason where it cannot be fitted;
                                expected_period_min = 2 pi sqrt(R/g)
      stops[]                   start_s, end_s, ground_speed_m_s, ground_speed_kt (median),
                                max_m_s, realign, seen_by ("gnss", "odometer"; "imu": neither
                                covers it, it may be a steady roll)
      realign                   any residual ground speed above 5 kt while standing
      realign_at                where that was: "parked", or seen_by of the stops
      gnss                      a drift against GNSS after the parked span, null where none is
                                logged
      scoring_only              reference: a drift against it after the parked span;
                                heading_error_mrad, in sigmas too
    difference                  active less previous: NM/h, heading, and what the tables' own
                                difference predicts of the heading and of the position at the end
                                of the parked span; null without two flights
    aided                       the solution with GNSS (infield.reports.documents.aided), null
                                without GNSS or with --no-aided
    definitions                 of the measures, in words

A drift: hours, end_radial_error_nm (and _m), max_radial_error_nm, rate_nm_h, rms_rate_nm_h,
end_speed_m_s, max_speed_m_s, end_speed_kt, drift_class, limit_2t_2_nm, limit_3t_3_nm at the end.
The same input gives the same bytes: there is no time of issue.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from alignment.motion.kinds import Witness
from alignment.reasons import AlignmentVerdict
from infield.replay.drift import DRIFT_CLASSES, REALIGN_M_S, Drift
from infield.replay.drift_prediction import NM_H_PER_DEG_H, level_shares
from infield.replay.free_inertial import ReplayResult, TableReplay, heading_change
from infield.replay.reasons import ReplayVerdict
from infield.replay.schuler import fit_schuler
from infield.replay.stops import StopSpeed
from infield.reports.documents.aided import AidedDocument, TimeSpanDocument, aided_document
from infield.reports.documents.alignment import FilterDocument, LevelDocument, alignment_document
from infield.reports.documents.spans import SpanDocument
from infield.reports.documents.thermal import ThermalUseDocument
from ins.documents import OMIT_NONE, UNWRITTEN
from ins.records import ReferenceLog, Run, TwinModel
from ins.twin_file import TwinDocument, twin_to_dict
from ins.units import DEG, KNOT, MILLIRADIAN, NAUTICAL_MILE
from ins.verdicts import Reason, because, codes, differs, sentence, sentences

SCHEMA = "recal.replay/1"
PARKED = "parked"  # beside the witnesses of stops, where the ground speed was above 5 kt
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
    "difference": (
        "active less previous; sigma_rate_nm_h: by what the tables do not know, as noise and"
        " turn-on are in both; significant: beyond two of it"
    ),
    "scoring_only": "the run's reference (truth): it scores, it never navigates",
}


@dataclass(frozen=True, kw_only=True)
class DriftDocument:
    """A drift, in nautical miles, knots and SI."""

    hours: float
    end_radial_error_m: float
    end_radial_error_nm: float
    max_radial_error_nm: float
    rate_nm_h: float
    rms_rate_nm_h: float
    end_speed_m_s: float
    max_speed_m_s: float
    end_speed_kt: float
    drift_class: str
    limit_2t_2_nm: float
    limit_3t_3_nm: float


@dataclass(frozen=True, kw_only=True)
class PredictedDocument:
    """What table and noise model say of the parked drift."""

    sigma_nm_h: float
    sigma_end_speed_m_s: float
    seen_over_sigma: float
    level_gyro_sigma_deg_h: float
    rule_of_thumb_nm_h: float


@dataclass(frozen=True, kw_only=True)
class SchulerDocument:
    """The period of the parked swing; NaN (null in the file) with a reason where not fitted."""

    period_min: float
    sigma_period_min: float
    amplitude_m_s: float
    expected_period_min: float
    reason: str
    reason_code: str | None


@dataclass(frozen=True, kw_only=True)
class StopDocument:
    """Computed ground speed while the vehicle stands."""

    start_s: float
    end_s: float
    ground_speed_m_s: float
    ground_speed_kt: float
    max_m_s: float
    realign: bool
    seen_by: Witness


@dataclass(frozen=True, kw_only=True)
class ScoringDocument:
    """Against the run's reference, which never navigates."""

    source: str
    reference: DriftDocument | None
    heading_error_mrad: float
    heading_error_sigmas: float


@dataclass(frozen=True, kw_only=True)
class FlownAlignment:
    """The alignment that a flight began with; angles not found are NaN."""

    verdict: AlignmentVerdict
    reasons: Sequence[str]
    time_s: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    sigma_roll_deg: float
    sigma_pitch_deg: float
    sigma_heading_deg: float
    latitude_found_deg: float
    sigma_latitude_deg: float
    duration_s: float
    excluded: Sequence[SpanDocument]
    consistency: FilterDocument
    reason_codes: Sequence[str | None]
    used_percent: float
    motion_level: LevelDocument | None


@dataclass(frozen=True, kw_only=True)
class FlownTableDocument:
    """One table's flight."""

    role: str
    origin: str
    revision: int | None
    sha256: str | None
    applied: bool
    notes: Sequence[str]
    note_codes: Sequence[str | None]
    alignment: FlownAlignment
    parked: DriftDocument | None
    predicted: PredictedDocument | None
    schuler: SchulerDocument | None
    stops: Sequence[StopDocument]
    realign: bool
    realign_at: Sequence[str]
    gnss: DriftDocument | None
    scoring_only: ScoringDocument | None


@dataclass(frozen=True, kw_only=True)
class ReplayChangeDocument:
    """A measure with both tables."""

    previous: float
    active: float
    change: float


@dataclass(frozen=True, kw_only=True)
class ReplaySeenDocument:
    """A difference as flown, and as the tables' own difference says."""

    seen: float
    expected: float


@dataclass(frozen=True, kw_only=True)
class DifferenceDocument:
    """Active less previous. sigma_rate_nm_h: of the change of rate_nm_h by what the tables do not
    know; significant: whether the change is beyond two of it.
    """

    heading_deg: float
    heading_mrad: float
    heading_expected_mrad: float
    rate_nm_h: ReplayChangeDocument | None = None
    sigma_rate_nm_h: float | None = None
    significant: bool | None = None
    rms_rate_nm_h: ReplayChangeDocument | None = None
    parked_end_displacement_m: Mapping[str, ReplaySeenDocument] | None = None


@dataclass(frozen=True, kw_only=True)
class ReplayDocument:
    """replay.json; `result`: what its page is drawn from."""

    schema: str = SCHEMA
    verdict: ReplayVerdict
    reasons: Sequence[str]
    reason_codes: Sequence[str | None]
    notes: Sequence[str]
    note_codes: Sequence[str | None]
    run_id: str
    run_sha256: str
    imu_serial: str
    gyro_technology: str
    start_utc: str
    store: str | None
    version: str
    noise_model: TwinDocument
    vertical: str
    alignment_span: TimeSpanDocument | None
    parked_span: TimeSpanDocument | None
    tables: Sequence[FlownTableDocument]
    difference: DifferenceDocument | None
    aided: AidedDocument | None
    definitions: Mapping[str, str]
    thermal_model: ThermalUseDocument | None = field(default=None, metadata=OMIT_NONE)
    noise_source: str | None = field(default=None, metadata=OMIT_NONE)
    result: ReplayResult = field(repr=False, compare=False, metadata=UNWRITTEN)


def replay_document(
    result: ReplayResult,
    twin: TwinModel,
    *,
    store: str | None,
    version: str,
    notes: tuple[Reason | str, ...] = (),
    thermal_model: ThermalUseDocument | None = None,
    reference: ReferenceLog | None = None,
) -> ReplayDocument:
    """The document; `notes` are what the caller knows of the tables, and come first; thermal_model:
    as in update.json; reference: scores the aided solution.
    """
    header = result.run.header
    all_notes = [*notes, *result.notes]
    return ReplayDocument(
        verdict=result.verdict,
        reasons=sentences(result.reasons),
        reason_codes=codes(result.reasons),
        notes=sentences(all_notes),
        note_codes=codes(all_notes),
        run_id=header.run_id,
        run_sha256=result.run.sha256,
        imu_serial=header.imu_serial,
        gyro_technology=header.gyro_technology,
        start_utc=header.start_utc,
        store=store,
        version=version,
        noise_model={"source": twin.source, **twin_to_dict(twin)},
        vertical=sentence(because(result.vertical)),
        alignment_span=_span(result.alignment_span),
        parked_span=_parked_span(result),
        tables=[_table(t, result) for t in result.tables],
        difference=_difference(result),
        aided=aided_document(result.aided, reference),
        definitions=DEFINITIONS,
        thermal_model=thermal_model,
        result=result,
    )


def _span(span: tuple[float, float] | None) -> TimeSpanDocument | None:
    return None if span is None else TimeSpanDocument(start_s=span[0], end_s=span[1])


def _parked_span(result: ReplayResult) -> TimeSpanDocument | None:
    if result.parked_until_s is None:
        return None
    starts = [t.alignment.time_s for t in result.tables if t.history is not None]
    return _span((min(starts), result.parked_until_s))


def _table(t: TableReplay, result: ReplayResult) -> FlownTableDocument:
    fast: set[str] = {s.seen_by.value for s in t.stops if s.realign}
    if t.parked is not None and t.parked.speed_m_s[-1] > REALIGN_M_S:
        fast.add(PARKED)
    return FlownTableDocument(
        role=t.choice.role,
        origin=t.choice.origin,
        revision=t.choice.revision,
        sha256=t.choice.sha256,
        applied=t.choice.table is not None,
        notes=sentences(t.notes),
        note_codes=codes(t.notes),
        alignment=_alignment(t, result.run),
        parked=_drift(t.parked),
        predicted=_predicted(t),
        schuler=_schuler(t, result.run),
        stops=[_stop(s) for s in t.stops],
        realign=bool(fast),
        realign_at=sorted(fast),
        gnss=_drift(t.gnss),
        scoring_only=_scoring(t),
    )


def _alignment(t: TableReplay, run: Run) -> FlownAlignment:
    """alignment.json less what stands above it; why it was not flown comes first."""
    document = replace(alignment_document(t.alignment, run), reasons=sentences(t.reasons))
    return FlownAlignment(**{f.name: getattr(document, f.name) for f in fields(FlownAlignment)})


def _drift(d: Drift | None) -> DriftDocument | None:
    if d is None:
        return None
    (_, slope2, offset2), (_, slope3, offset3) = DRIFT_CLASSES
    return DriftDocument(
        hours=d.hours,
        end_radial_error_m=float(d.radial_m[-1]),
        end_radial_error_nm=float(d.radial_m[-1]) / NAUTICAL_MILE,
        max_radial_error_nm=float(d.radial_m.max()) / NAUTICAL_MILE,
        rate_nm_h=d.rate_nm_h,
        rms_rate_nm_h=d.rms_rate_nm_h,
        end_speed_m_s=float(d.speed_m_s[-1]),
        max_speed_m_s=float(d.speed_m_s.max()),
        end_speed_kt=float(d.speed_m_s[-1]) / KNOT,
        drift_class=d.drift_class,
        limit_2t_2_nm=slope2 * d.hours + offset2,
        limit_3t_3_nm=slope3 * d.hours + offset3,
    )


def _predicted(t: TableReplay) -> PredictedDocument | None:
    if t.predicted is None or t.parked is None or t.bins is None or t.alignment.C_nb is None:
        return None
    start_s = t.alignment.time_s
    span = (start_s, start_s + t.parked.time_s[-1])
    north = level_shares(t.bins.edges_s, t.alignment.C_nb, span)[0]
    sigma = float(np.sqrt(north @ t.bins.prior @ north))
    return PredictedDocument(
        sigma_nm_h=t.predicted.sigma_nm_h,
        sigma_end_speed_m_s=float(t.predicted.sigma_speed_m_s[-1]),
        seen_over_sigma=t.parked.rate_nm_h / t.predicted.sigma_nm_h,
        level_gyro_sigma_deg_h=sigma,
        rule_of_thumb_nm_h=NM_H_PER_DEG_H * sigma,
    )


def _schuler(t: TableReplay, run: Run) -> SchulerDocument | None:
    """None without a flight."""
    if t.history is None:
        return None
    fit = fit_schuler(t.parked, run.header.site)
    return SchulerDocument(
        period_min=fit.period_s / 60.0,
        sigma_period_min=fit.sigma_s / 60.0,
        amplitude_m_s=fit.amplitude_m_s,
        expected_period_min=fit.expected_s / 60.0,
        reason="" if fit.reason is None else sentence(fit.reason),
        reason_code=None if fit.reason is None else fit.reason.code.value,
    )


def _stop(s: StopSpeed) -> StopDocument:
    return StopDocument(
        start_s=s.start_s,
        end_s=s.end_s,
        ground_speed_m_s=s.median_m_s,
        ground_speed_kt=s.median_m_s / KNOT,
        max_m_s=s.max_m_s,
        realign=s.realign,
        seen_by=s.seen_by,
    )


def _scoring(t: TableReplay) -> ScoringDocument | None:
    if np.isnan(t.heading_error_rad):
        return None
    return ScoringDocument(
        source="reference",
        reference=_drift(t.reference),
        heading_error_mrad=t.heading_error_rad / MILLIRADIAN,
        heading_error_sigmas=t.heading_error_rad / t.alignment.sigma_heading_rad,
    )


def _difference(result: ReplayResult) -> DifferenceDocument | None:
    """What changed from the previous to the active table, and what their difference says should
    have.
    """
    new, old, turned = result.of("active"), result.of("previous"), heading_change(result)
    if new is None or old is None or turned is None:
        return None
    rates: dict[str, ReplayChangeDocument | None] = {"rate_nm_h": None, "rms_rate_nm_h": None}
    if new.parked is not None and old.parked is not None:
        rates = {name: _change(old.parked, new.parked, name) for name in rates}
    rate, sigma = rates["rate_nm_h"], _sigma_of_change(old, new)
    return DifferenceDocument(
        sigma_rate_nm_h=sigma,
        significant=None if rate is None or sigma is None else differs(rate.change, sigma),
        heading_deg=turned[0] / DEG,
        heading_mrad=turned[0] / MILLIRADIAN,
        heading_expected_mrad=turned[1] / MILLIRADIAN,
        parked_end_displacement_m=_displacement(old, new),
        **rates,
    )


def _sigma_of_change(old: TableReplay, new: TableReplay) -> float | None:
    """What chance makes of the change of drift from one table to the other [NM/h].

    Both fly the same log, so its noise and its turn-on bias are in both. Where one table was
    updated to the other, the error of the one with more data is a part of the other's (the
    posterior of Bayes): the variances subtract. Otherwise they add, which is too large where the
    tables share data.
    """
    if new.predicted is None or old.predicted is None:
        return None
    before, after = old.predicted.sigma_nm_h**2, new.predicted.sigma_nm_h**2
    parents = [
        (t.choice.table.provenance.get("parent_sha256"), other.choice.sha256)
        for t, other in ((new, old), (old, new))
        if t.choice.table is not None
    ]
    nested = any(parent is not None and parent == sha256 for parent, sha256 in parents)
    return float(np.sqrt(abs(before - after) if nested else before + after))


def _change(old: Drift, new: Drift, name: str) -> ReplayChangeDocument:
    before, after = getattr(old, name), getattr(new, name)
    return ReplayChangeDocument(previous=before, active=after, change=after - before)


def _displacement(old: TableReplay, new: TableReplay) -> Mapping[str, ReplaySeenDocument] | None:
    """How far apart the two parked spans end, north and east."""
    if old.parked is None or new.parked is None:
        return None
    if new.predicted is None or new.bins is None or old.bins is None:
        return None
    changed_deg_h = new.bins.table_deg_h - old.bins.table_deg_h
    expected = -new.predicted.response_m_per_deg_h @ changed_deg_h
    seen = new.parked.position_m[-1] - old.parked.position_m[-1]
    return {
        axis: ReplaySeenDocument(seen=float(seen[k]), expected=float(expected[k]))
        for k, axis in enumerate(("north", "east"))
    }
