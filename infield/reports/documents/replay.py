"""`replay.json`, schema recal.replay/1: what `infield.replay.free_inertial` found.

The same input gives the same bytes: there is no time of issue.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from infield.replay.drift import REALIGN_M_S, Drift
from infield.replay.drift_prediction import NM_H_PER_DEG_H, level_shares
from infield.replay.free_inertial import ReplayResult, TableReplay, heading_change
from infield.replay.reasons import ReplayVerdict
from infield.replay.schuler import SchulerFit, fit_schuler
from infield.replay.stops import StopSpeed
from infield.reports.documents.aided import AidedDocument, TimeSpanDocument, aided_document
from infield.reports.documents.alignment import AlignmentDocument, flown_alignment
from infield.reports.documents.thermal import ThermalUseDocument
from ins.documents import OMIT_NONE, UNWRITTEN, MadeOf, made
from ins.records import ReferenceLog, TwinModel
from ins.twin_file import TwinDocument, twin_to_dict
from ins.units import DEG, KNOT, MILLIRADIAN
from ins.verdicts import Reason, because, codes, differs, sentence, sentences

SCHEMA = "recal.replay/1"
of = MadeOf[ReplayResult]()
of_table = MadeOf[TableReplay]()
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
class PredictedDocument:
    """What table and noise model say of the parked drift."""

    sigma_nm_h: float
    sigma_end_speed_m_s: float
    seen_over_sigma: float
    level_gyro_sigma_deg_h: float
    rule_of_thumb_nm_h: float


@dataclass(frozen=True, kw_only=True)
class ScoringDocument:
    """Against the run's reference, which never navigates."""

    source: str = "reference"
    reference: Drift | None = of_table(lambda t: t.reference)
    heading_error_mrad: float = of_table(lambda t: t.heading_error_rad / MILLIRADIAN)
    heading_error_sigmas: float = of_table(
        lambda t: t.heading_error_rad / t.alignment.sigma_heading_rad
    )


@dataclass(frozen=True, kw_only=True)
class FlownTableDocument:
    """One table's flight."""

    role: str = of_table(lambda t: t.choice.role)
    origin: str = of_table(lambda t: t.choice.origin)
    revision: int | None = of_table(lambda t: t.choice.revision)
    sha256: str | None = of_table(lambda t: t.choice.sha256)
    applied: bool = of_table(lambda t: t.choice.table is not None)
    notes: Sequence[str] = of_table(lambda t: sentences(t.notes))
    note_codes: Sequence[str | None] = of_table(lambda t: codes(t.notes))
    alignment: AlignmentDocument
    parked: Drift | None = of_table(lambda t: t.parked)
    predicted: PredictedDocument | None = of_table(lambda t: _predicted(t))
    schuler: SchulerFit | None
    stops: Sequence[StopSpeed] = of_table(lambda t: t.stops)
    realign: bool = of_table(lambda t: bool(_fast(t)))
    realign_at: Sequence[str] = of_table(lambda t: _fast(t))
    gnss: Drift | None = of_table(lambda t: t.gnss)
    scoring_only: ScoringDocument | None = of_table(
        lambda t: None if np.isnan(t.heading_error_rad) else made(ScoringDocument, t)
    )


@dataclass(frozen=True, kw_only=True)
class ReplayChangeDocument:
    """A measure with both tables."""

    previous: float
    active: float
    change: float


@dataclass(frozen=True, kw_only=True)
class ReplayFlownDocument:
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
    parked_end_displacement_m: Mapping[str, ReplayFlownDocument] | None = None


@dataclass(frozen=True, kw_only=True)
class ReplayDocument:
    """replay.json; `result`: what its page is drawn from."""

    schema: str = SCHEMA
    verdict: ReplayVerdict = of(lambda result: result.verdict)
    reasons: Sequence[str] = of(lambda result: sentences(result.reasons))
    reason_codes: Sequence[str | None] = of(lambda result: codes(result.reasons))
    notes: Sequence[str]
    note_codes: Sequence[str | None]
    run_id: str = of(lambda result: result.run.header.run_id)
    run_sha256: str = of(lambda result: result.run.sha256)
    imu_serial: str = of(lambda result: result.run.header.imu_serial)
    gyro_technology: str = of(lambda result: result.run.header.gyro_technology)
    start_utc: str = of(lambda result: result.run.header.start_utc)
    store: str | None
    version: str
    noise_model: TwinDocument
    vertical: str = of(lambda result: sentence(because(result.vertical)))
    alignment_span: TimeSpanDocument | None = of(lambda result: _span(result.alignment_span))
    parked_span: TimeSpanDocument | None = of(lambda result: _parked_span(result))
    tables: Sequence[FlownTableDocument] = of(lambda r: [_table(t, r) for t in r.tables])
    difference: DifferenceDocument | None = of(lambda result: _difference(result))
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
    all_notes = [*notes, *result.notes]
    return made(
        ReplayDocument,
        result,
        notes=sentences(all_notes),
        note_codes=codes(all_notes),
        store=store,
        version=version,
        noise_model={"source": twin.source, **twin_to_dict(twin)},
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
    return made(
        FlownTableDocument,
        t,
        alignment=flown_alignment(t.alignment, t.reasons),
        schuler=None if t.history is None else fit_schuler(t.parked, result.run.header.site),
    )


def _fast(t: TableReplay) -> list[str]:
    """Where the ground speed of the solution asks for a new alignment."""
    fast: set[str] = {s.seen_by.value for s in t.stops if s.realign}
    if t.parked is not None and t.parked.speed_m_s[-1] > REALIGN_M_S:
        fast.add(PARKED)
    return sorted(fast)


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
    """What chance makes of the change of drift from one table to the other [NM/h]."""
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


def _displacement(old: TableReplay, new: TableReplay) -> Mapping[str, ReplayFlownDocument] | None:
    """How far apart the two parked spans end, north and east."""
    if old.parked is None or new.parked is None:
        return None
    if new.predicted is None or new.bins is None or old.bins is None:
        return None
    changed_deg_h = new.bins.table_deg_h - old.bins.table_deg_h
    expected = -new.predicted.response_m_per_deg_h @ changed_deg_h
    seen = new.parked.position_m[-1] - old.parked.position_m[-1]
    return {
        axis: ReplayFlownDocument(seen=float(seen[k]), expected=float(expected[k]))
        for k, axis in enumerate(("north", "east"))
    }
