"""diagnosis.json of a diagnosis (its records: `diagnosis_records`), and the same in a few lines for
people. Computes nothing but units.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ins.records import Run, TwinModel
from ins.units import DEG_PER_HOUR, MICRO_G
from ins.verdicts import plain_number
from simreal.declared.generic import TABLE_AGED
from simreal.effects.base import GYROS, SLOW_NAME, Effect
from simreal.effects.catalogue import catalogue
from simreal.effects.words import words_of
from simreal.inference.addback import Shrink
from simreal.inference.causes import Cause, Rival, Value
from simreal.inference.diagnosis import Diagnosis, Place
from simreal.inference.excess import FLOOR, Excess
from simreal.inference.user_level import UserLevel
from simreal.inference.verdict import GapVerdict, KeptOut
from simreal.predict.document import simulator_lines
from simreal.report.diagnosis_records import (
    AnswerRecord,
    CauseRecord,
    CellRecord,
    ChannelRecord,
    DiagnosisRecord,
    DriftRecord,
    GapAfterRecord,
    GapRecord,
    GoneRecord,
    NotLookedAtRecord,
    NotTestableRecord,
    OpenRecord,
    ParameterRecord,
    PlaceRecord,
    RivalRecord,
    RmsRecord,
    RunRecord,
    ShrinkRecord,
    UnexplainedRecord,
    UserRecord,
)
from simreal.twin.write_back import effect_items, fitted_items, processes_of

NO_TABLE = "the twin has no table: the whole thermal bias counts as gap"
PARK_FIRST = "Park for 5 minutes or more after power-on, then repeat."
MOST_SAID = 4  # parameters of a cause in the lines for people
LEAST_P = 1e-300  # a p-value below has no digits to show: the smallest double is 2.2e-308


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What a diagnosis was asked with, beside the runs.

    table_sha256 : empty where the twin has no table. hold_out : run ids that only judge. notes : of
    the reader, beside those of the diagnosis.
    """

    version: str
    seed: int
    table_sha256: str = ""
    hold_out: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def diagnosis_document(
    diagnosis: Diagnosis,
    runs: Sequence[Run],
    asked: Asked,
    *,
    users: Sequence[UserLevel] = (),
    record_next: Sequence[str] = (),
    settled_by: Sequence[Sequence[str]] | None = None,
) -> DiagnosisRecord:
    """The document of a diagnosis of these runs; settled_by: of each cause, what tells it from
    others.
    """
    run_ids = [v.name for v in diagnosis.views]
    twin = diagnosis.twin
    table_note = () if asked.table_sha256 else (NO_TABLE,)
    whole, *channels = diagnosis.excesses
    return DiagnosisRecord(
        verdict=diagnosis.verdict,
        sentence=diagnosis.sentence,
        imu_serial=twin.imu_serial,
        gyro_technology=twin.gyro_technology,
        twin=twin.source,
        version=asked.version,
        gap=GapRecord(
            score=whole.score,
            floor=FLOOR,
            p_value=diagnosis.p_value,
            excess_sigma=whole.excess_sigma,
        ),
        where=tuple(_place(p) for p in diagnosis.where),
        causes=tuple(
            _cause(c, bars, run_ids, asked) for c, bars in zip(diagnosis.causes, diagnosis.bars)
        ),
        open=tuple(
            _open(c, c.kept_out, run_ids, sentences)
            for c, sentences in zip(diagnosis.causes, settled_by or [()] * len(diagnosis.causes))
            if c.kept_out is not None and c.kept_out.what_to_do
        ),
        unexplained=UnexplainedRecord(
            present=diagnosis.left_present,
            p_value=diagnosis.p_value_after,
            share=diagnosis.left_share,
            looks_like=diagnosis.looks_like,
        ),
        not_testable=tuple(
            NotTestableRecord(effect=name, needs=needs, target=target or None)
            for name, needs, target in diagnosis.not_testable
        ),
        gap_after=GapAfterRecord(
            score=whole.score_after,
            p_value=diagnosis.p_value_after,
            excess_sigma=whole.excess_sigma_after,
        ),
        shrink=_gone(whole),
        channels=tuple(_channel(excess) for excess in channels),
        user_level=tuple(_user(u) for u in users),
        record_next=tuple(record_next),
        cells=_cells(diagnosis),
        runs=tuple(_run(run, diagnosis, asked.hold_out) for run in runs),
        not_looked_at=_not_looked_at(diagnosis.unused),
        notes=(*asked.notes, *diagnosis.notes, *table_note),
        alpha=diagnosis.alpha,
        threshold_nats=diagnosis.threshold,
        replicates=diagnosis.replicates,
        seed=asked.seed,
        table_sha256=asked.table_sha256 or None,
    )


def _gone(excess: Excess) -> GoneRecord:
    return GoneRecord(fraction=excess.fraction, interval_95=excess.interval_95)


def _channel(excess: Excess) -> ChannelRecord:
    return ChannelRecord(
        channel=excess.channel,
        rows=excess.rows,
        score=excess.score,
        score_after=excess.score_after,
        excess_sigma=excess.excess_sigma,
        excess_sigma_after=excess.excess_sigma_after,
        shrink=_gone(excess),
    )


def refused_document(
    reasons: Sequence[tuple[str, str]],
    runs: Sequence[Run],
    twin: TwinModel,
    *,
    version: str,
    alpha: float,
    seed: int,
) -> DiagnosisRecord:
    """The document where no run can be looked at: reasons by run id, no gap stated and none
    denied.
    """
    said = tuple(f"run {name}: {why}" for name, why in reasons)
    names = sorted({e.name for e in catalogue()})
    return DiagnosisRecord(
        verdict=GapVerdict.REFUSED,
        sentence=f"No run can be looked at: {'; '.join(said)}.",
        reasons=said,
        imu_serial=twin.imu_serial,
        gyro_technology=twin.gyro_technology,
        twin=twin.source,
        version=version,
        gap=GapRecord(score=None, floor=None, p_value=None),
        unexplained=UnexplainedRecord(present=None, p_value=None, share=None),
        not_testable=tuple(NotTestableRecord(effect=n, needs="a parked stretch") for n in names),
        gap_after=GapAfterRecord(score=None, p_value=None),
        record_next=(PARK_FIRST,),
        runs=tuple(RunRecord(run_id=r.header.run_id, sha256=r.sha256, used=False) for r in runs),
        not_looked_at=_not_looked_at(reasons),
        alpha=alpha,
        threshold_nats=None,
        replicates=0,
        seed=seed,
        table_sha256=None,
    )


def summary(document: DiagnosisRecord) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document.imu_serial or document.gyro_technology}: {document.sentence}"]
    if document.verdict is GapVerdict.REFUSED:
        return lines
    gap, after = document.gap, document.gap_after
    lines.append(
        f"  gap score {gap.score:.2f} (floor {gap.floor:.2f}, p {p_text(gap.p_value)}),"
        f" with what was found {after.score:.2f} (p {p_text(after.p_value)})"
    )
    if document.causes and document.shrink is not None:
        lines.append(_excess_line(document))
    for cause in document.causes:
        lines += _cause_lines(cause)
    lines += [f"  navigation, run {u.run_id}: {_user_line(u)}" for u in document.user_level]
    if document.simulator is not None:
        lines += simulator_lines(document.simulator)
    lines += [f"  run {r.run_id} not looked at: {r.why}" for r in document.not_looked_at]
    lines += [f"  {note}" for note in document.notes]
    if document.noise_fit is not None and not document.noise_fit.fits:
        lines.append(f"  note: {document.noise_fit.text}")
    lines += [f"  record next: {text}" for text in document.record_next]
    return lines


def _not_looked_at(reasons: Sequence[tuple[str, str]]) -> tuple[NotLookedAtRecord, ...]:
    return tuple(NotLookedAtRecord(run_id=name, why=why) for name, why in reasons)


def _place(p: Place) -> PlaceRecord:
    return PlaceRecord(
        channel=p.channel,
        phase=p.phase,
        temperature_degC=p.temperature_degC,
        frequency_hz=p.frequency_hz,
        time_s=p.time_s,
        share=p.share,
    )


def _open(c: Cause, why: KeptOut, run_ids: Sequence[str], sentences: Sequence[str]) -> OpenRecord:
    words = words_of(c.effect) if why is KeptOut.IMPLAUSIBLE else None
    more = () if words is None else (words.remedy,)
    return OpenRecord(
        effect=c.effect,
        target=c.target,
        why=why,
        settled_by=(why.what_to_do, *more, *sentences),
        twin_effects=tuple(fitted_items(c, run_ids)),
    )


def _cause(
    c: Cause, bars: Sequence[tuple[str, str, float]], run_ids: Sequence[str], asked: Asked
) -> CauseRecord:
    runs = " ".join(shlex.quote(run) for run in asked.runs) or "RUN..."
    return CauseRecord(
        effect=c.effect,
        target=c.target,
        probability=min(c.probability, 1.0),
        confounded_with=_confounded(c),
        parameters=_parameters(c),
        shrink=None if c.shrink is None else _shrink(c.shrink),
        id=c.id,
        named=c.named,
        resolved=c.resolved,
        repeats=c.class_,
        run_id=c.run_id,
        size=c.size,
        rivals=tuple(_rival(r) for r in c.rivals),
        posterior=tuple(
            AnswerRecord(effect=name, target=target, probability=p) for name, target, p in bars
        ),
        rms={channel: _rms(channel, v) for channel, v in c.rms.items()},
        nodes=tuple(c.nodes),
        values=tuple(c.values),
        twin_effects=tuple(effect_items(c, run_ids)),
        kept_out=c.kept_out,
        advice=f"recal update {runs}" if c.effect == TABLE_AGED else None,
    )


def _shrink(s: Shrink) -> ShrinkRecord:
    return ShrinkRecord(
        fraction=s.fraction,
        interval_95=s.interval_95,
        held_out=s.held_out,
        how=s.how,
        size=s.size,
        too_small=s.too_small,
    )


def _confounded(c: Cause) -> tuple[str, ...]:
    """Names of the rivals; of a slow variation the processes first."""
    rivals = [r.effect for r in c.rivals if r.effect != c.effect]
    return tuple(dict.fromkeys([*processes_of(c), *rivals]))


def _rival(r: Rival) -> RivalRecord:
    cosine = r.cosine if np.isfinite(r.cosine) else None
    return RivalRecord(effect=r.effect, target=r.target, probability=r.probability, cosine=cosine)


def _rms(channel: str, value: float) -> RmsRecord:
    if channel in GYROS:
        return RmsRecord(value=value / DEG_PER_HOUR, unit="deg/h")
    return RmsRecord(value=value / MICRO_G, unit="ug")


def _parameters(c: Cause) -> dict[str, ParameterRecord]:
    effect = next((e for e in catalogue() if e.id == c.id), None)
    shapes = () if effect is None else [p.name for p in effect.shape]
    return {
        name: _parameter(
            p,
            bound_sigma=_bound_sigma(effect, name),
            below_declared=c.class_ == "S" and p.value < 0 and name not in shapes,
        )
        for name, p in c.parameters.items()
    }


def _parameter(p: Value, *, bound_sigma: float | None, below_declared: bool) -> ParameterRecord:
    """bound_sigma: taken where the fit gives none."""
    fitted = bool(np.isfinite(p.sigma))
    bounded = "bounds" if bound_sigma is not None else None
    return ParameterRecord(
        value=p.value,
        sigma=p.sigma if fitted else bound_sigma,
        unit=p.unit,
        usual=p.usual,
        unusual=p.unusual,
        sigma_from="fit" if fitted else bounded,
        below_declared=below_declared,
    )


def _bound_sigma(effect: Effect | None, name: str) -> float | None:
    """Of a shape parameter that the fit does not narrow: the sigma of anything between its bounds;
    None: no bounds.
    """
    shapes = () if effect is None else effect.shape
    for shape in shapes:
        if shape.name == name:
            return float((shape.high - shape.low) / np.sqrt(12.0))
    return None


def _user(u: UserLevel) -> UserRecord:
    as_it_is, without = (
        DriftRecord(rate_nm_h=rate, speed_m_s=speed)
        for rate, speed in zip(u.rate_nm_h, u.speed_m_s)
    )
    return UserRecord(
        run_id=u.run_id,
        align_s=u.align_s,
        navigated_s=u.navigated_s,
        heading_change_arcmin=u.heading_change_arcmin,
        as_it_is=as_it_is,
        without=without,
    )


def _cells(diagnosis: Diagnosis) -> tuple[CellRecord, ...]:
    before, after = diagnosis.cells, diagnosis.cells_after
    located, located_after = before.located, after.located
    return tuple(
        CellRecord(
            channel=cell.channel,
            moving=cell.moving,
            frequency_hz=_band(cell.frequency_hz),
            dof=float(before.dof[k]),
            rho=float(before.rho[k]),
            nats=float(before.nats[k]),
            located=bool(located[k]),
            rho_after=float(after.rho[k]),
            nats_after=float(after.nats[k]),
            located_after=bool(located_after[k]),
        )
        for k, cell in enumerate(before.cells)
    )


def _band(frequency_hz: tuple[float, float]) -> tuple[float | None, ...]:
    low, high = frequency_hz
    return low, high if np.isfinite(high) else None


def _run(run: Run, diagnosis: Diagnosis, hold_out: Sequence[str]) -> RunRecord:
    header = run.header
    view = next((v for v in diagnosis.views if v.name == header.run_id), None)
    if view is None:
        return RunRecord(
            run_id=header.run_id, sha256=run.sha256, start_utc=header.start_utc, used=False
        )
    return RunRecord(
        run_id=header.run_id,
        sha256=run.sha256,
        start_utc=header.start_utc,
        used=True,
        parked_s=(view.start_s, view.end_s),
        moves=view.history is not None,
        held_out=header.run_id in hold_out,
    )


def p_text(value: float | None) -> str:
    """A p-value in two digits."""
    if value is None:
        return "n/a"
    return f"{value:.2g}" if value > LEAST_P else "under 1e-300"


def _excess_line(document: DiagnosisRecord) -> str:
    """How far what was found takes the excess down."""
    gap, after, shrink = document.gap, document.gap_after, document.shrink
    assert gap.excess_sigma is not None and after.excess_sigma is not None and shrink is not None
    low, high = shrink.interval_95
    return (
        f"  excess over the floor {gap.excess_sigma:.1f} -> {after.excess_sigma:.1f} sigma:"
        f" {100 * shrink.fraction:.0f} % gone ({100 * low:.0f} to {100 * high:.0f} %)"
    )


def _cause_lines(cause: CauseRecord) -> list[str]:
    at = f", run {cause.run_id}" if cause.run_id else ""
    lines = [
        f"  {cause.effect} on {cause.target}{at}: probability {cause.probability:.2f},"
        f" {cause.size:.0f} sigma"
    ]
    said = list(cause.parameters.items())[:MOST_SAID]
    lines += [f"    {name} {_parameter_text(p)}" for name, p in said]
    if cause.confounded_with:
        lines.append(f"    {_confusion(cause)}: {', '.join(cause.confounded_with)}")
    if cause.shrink is not None:
        lines.append(f"    {_shrink_text(cause.shrink)}")
    if cause.kept_out is not None:
        lines.append(f"    not in twin.json: {cause.kept_out.template}")
    if cause.advice is not None:
        lines.append(f"    renew the table: {cause.advice}")
    return lines


def _parameter_text(p: ParameterRecord) -> str:
    sigma = "" if p.sigma is None else f" +- {plain_number(p.sigma, '.2g')}"
    text = f"{plain_number(p.value, '.4g')}{sigma} {p.unit}"
    if p.unusual:
        return f"{text} (implausibly large)"
    return f"{text} (less than declared)" if p.below_declared else text


def _confusion(cause: CauseRecord) -> str:
    """How its confounded names stand to a cause."""
    if cause.effect == SLOW_NAME:
        return "as a process"
    return "nearly the same" if cause.resolved else "may also be"


def _shrink_text(s: ShrinkRecord) -> str:
    low, high = s.interval_95
    small = "; too small there to quantify" if s.too_small else ""
    return (
        f"shrinks the gap by {100 * s.fraction:.0f} % ({100 * low:.0f} to"
        f" {100 * high:.0f} %), {s.how}{small}"
    )


def _user_line(u: UserRecord) -> str:
    a, b = u.as_it_is, u.without
    return (
        f"{a.rate_nm_h:.2f} -> {b.rate_nm_h:.2f} NM/h, {a.speed_m_s:.2f} ->"
        f" {b.speed_m_s:.2f} m/s after {u.navigated_s / 60:.0f} min, alignment"
        f" {u.heading_change_arcmin:+.2f} arcmin"
    )
