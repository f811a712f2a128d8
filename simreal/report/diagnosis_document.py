"""diagnosis.json (`recal.diagnosis/1`, formats.md section 5) of a diagnosis, and the same in a few
lines for people.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from infield.reports.documents.alignment import NoiseFit
from ins.documents import OMIT_NONE, MadeOf, made
from ins.errors.base import SLOW_NAME
from ins.errors.catalogue import catalogue, words_of
from ins.errors.table import TABLE_AGED
from ins.records import EffectDocument, Run, TwinModel
from ins.verdicts import plain_number
from simreal.inference.addback import Gone
from simreal.inference.causes import Cause, CauseParameter
from simreal.inference.diagnosis import (
    Diagnosis,
    GapSize,
    GapSizeAfter,
    NotLookedAt,
    NotTestable,
    Unexplained,
)
from simreal.inference.excess import Excess
from simreal.inference.locate import GapCell
from simreal.inference.places import Place
from simreal.inference.verdict import GapVerdict, KeptOut
from simreal.predict.document import PredictedUpdates, simulator_lines
from simreal.predict.sessions import SessionDrift, UserLevel
from simreal.report.diagnosis_words import (
    Found,
    drift_words,
    gathered,
    percent,
    shrink_words,
    verdict_sentence,
)
from simreal.twin.write_back import effect_items, fitted_items

of = MadeOf[Diagnosis]()
NO_TABLE = "the twin has no table: biases and thermal curves of the gyros count as its error"
PARK_FIRST = "Park for 5 minutes or more after power-on, then repeat."
MOST_SAID = 4  # parameters of a cause in the lines for people
LEAST_P = 1e-300  # a p-value below has no digits to show: the smallest double is 2.2e-308


SCHEMA = "recal.diagnosis/1"


@dataclass(frozen=True)
class OpenCause:
    """A cause that the twin leaves out: why, what would settle it, and the items of the twin for
    who takes it out all the same.
    """

    effect: str
    target: str
    why: KeptOut
    settled_by: tuple[str, ...]
    twin_effects: tuple[EffectDocument, ...]


@dataclass(frozen=True, kw_only=True)
class DiagnosedRun:
    """A run that was given; what follows `used` only of one that could be looked at."""

    run_id: str
    sha256: str
    start_utc: str | None = field(default=None, metadata=OMIT_NONE)
    used: bool
    parked_s: tuple[float, float] | None = field(default=None, metadata=OMIT_NONE)
    moves: bool | None = field(default=None, metadata=OMIT_NONE)
    held_out: bool | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class GapReport:
    """The document of a diagnosis: a field is a key."""

    schema: str = SCHEMA
    verdict: GapVerdict = of(lambda found: found.verdict)
    sentence: str
    reasons: tuple[str, ...] = ()
    imu_serial: str = of(lambda found: found.twin.imu_serial)
    gyro_technology: str = of(lambda found: found.twin.gyro_technology)
    twin: str = of(lambda found: found.twin.source)
    version: str
    gap: GapSize = of(lambda found: found.gap)
    where: tuple[Place, ...] = of(lambda found: found.where, default=())
    causes: tuple[Cause, ...] = ()
    open: tuple[OpenCause, ...] = ()
    unexplained: Unexplained = of(lambda found: found.unexplained)
    not_testable: tuple[NotTestable, ...] = of(lambda found: found.not_testable)
    gap_after: GapSizeAfter = of(lambda found: found.gap_after)
    shrink: Gone | None = of(lambda found: found.shrink, OMIT_NONE, default=None)
    channels: tuple[Excess, ...] = of(lambda found: found.channels, default=())
    user_level: tuple[UserLevel, ...] = ()
    expected_drift: SessionDrift | None = field(default=None, metadata=OMIT_NONE)
    record_next: tuple[str, ...] = ()
    cells: tuple[GapCell, ...] = of(lambda found: found.cells, default=())
    runs: tuple[DiagnosedRun, ...]
    not_looked_at: tuple[NotLookedAt, ...] = of(lambda found: found.not_looked_at)
    notes: tuple[str, ...] = ()
    noise_fit: NoiseFit | None = field(default=None, metadata=OMIT_NONE)
    simulator: PredictedUpdates | None = field(default=None, metadata=OMIT_NONE)
    alpha: float = of(lambda found: found.alpha)
    threshold_nats: float | None = of(lambda found: found.threshold)
    replicates: int = of(lambda found: found.replicates)
    seed: int
    table_sha256: str | None


@dataclass(frozen=True, kw_only=True)
class DiagnosisRequest:
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
    asked: DiagnosisRequest,
    *,
    settled_by: Sequence[Sequence[str]] | None = None,
) -> GapReport:
    """The document of a diagnosis of these runs; settled_by: of each cause, what tells it from
    others.
    """
    run_ids = [v.name for v in diagnosis.views]
    table_note = () if asked.table_sha256 else (NO_TABLE,)
    sentences = settled_by or [()] * len(diagnosis.causes)
    return made(
        GapReport,
        diagnosis,
        sentence=verdict_sentence(diagnosis, with_table=bool(asked.table_sha256)),
        version=asked.version,
        causes=tuple(_mended(c, run_ids, asked) for c in diagnosis.causes),
        open=tuple(
            _open(c, c.kept_out, run_ids, said)
            for c, said in zip(diagnosis.causes, sentences)
            if c.kept_out is not None and c.kept_out.what_to_do
        ),
        runs=tuple(_run(run, diagnosis, asked.hold_out) for run in runs),
        notes=(*asked.notes, *diagnosis.notes, *table_note),
        seed=asked.seed,
        table_sha256=asked.table_sha256 or None,
    )


def refused_document(
    reasons: Sequence[NotLookedAt],
    runs: Sequence[Run],
    twin: TwinModel,
    *,
    version: str,
    alpha: float,
    seed: int,
) -> GapReport:
    """The document where no run can be looked at: no gap stated and none denied."""
    said = tuple(f"run {one.run_id}: {one.why}" for one in reasons)
    names = sorted({e.name for e in catalogue()})
    return GapReport(
        verdict=GapVerdict.REFUSED,
        sentence=f"No run can be looked at: {'; '.join(said)}.",
        reasons=said,
        imu_serial=twin.imu_serial,
        gyro_technology=twin.gyro_technology,
        twin=twin.source,
        version=version,
        gap=GapSize(),
        unexplained=Unexplained(),
        not_testable=tuple(NotTestable(name, "a parked stretch") for name in names),
        gap_after=GapSizeAfter(),
        record_next=(PARK_FIRST,),
        runs=tuple(DiagnosedRun(run_id=r.header.run_id, sha256=r.sha256, used=False) for r in runs),
        not_looked_at=tuple(reasons),
        alpha=alpha,
        threshold_nats=None,
        replicates=0,
        seed=seed,
        table_sha256=None,
    )


def summary(document: GapReport) -> list[str]:
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
    for found in gathered(document.causes):
        lines += _cause_lines(found, has_table=bool(document.table_sha256))
    if document.expected_drift is not None:
        lines.append(f"  {drift_words(document.expected_drift)}")
    if document.simulator is not None:
        lines += simulator_lines(document.simulator)
    lines += [f"  run {r.run_id} not looked at: {r.why}" for r in document.not_looked_at]
    lines += [f"  {note}" for note in document.notes]
    if document.noise_fit is not None and not document.noise_fit.fits:
        lines.append(f"  note: {document.noise_fit.text}")
    lines += [f"  record next: {text}" for text in document.record_next]
    return lines


def _open(c: Cause, why: KeptOut, run_ids: Sequence[str], sentences: Sequence[str]) -> OpenCause:
    words = words_of(c.effect) if why is KeptOut.IMPLAUSIBLE else None
    more = () if words is None else (words.remedy,)
    settled_by = (why.what_to_do, *more, *sentences)
    return OpenCause(c.effect, c.target, why, settled_by, tuple(fitted_items(c, run_ids)))


def _mended(c: Cause, run_ids: Sequence[str], asked: DiagnosisRequest) -> Cause:
    """The cause with what mends it: its items of the twin, and the command for an aged table."""
    runs = " ".join(shlex.quote(run) for run in asked.runs) or "RUN..."
    advice = f"recal update {runs}" if c.effect == TABLE_AGED else None
    return replace(c, twin_effects=tuple(effect_items(c, run_ids)), advice=advice)


def _run(run: Run, diagnosis: Diagnosis, hold_out: Sequence[str]) -> DiagnosedRun:
    header = run.header
    view = next((v for v in diagnosis.views if v.name == header.run_id), None)
    given = DiagnosedRun(
        run_id=header.run_id, sha256=run.sha256, start_utc=header.start_utc, used=view is not None
    )
    if view is None:
        return given
    return replace(
        given,
        parked_s=(view.start_s, view.end_s),
        moves=view.history is not None,
        held_out=header.run_id in hold_out,
    )


def p_text(value: float | None) -> str:
    """A p-value in two digits."""
    if value is None:
        return "n/a"
    return f"{value:.2g}" if value > LEAST_P else "under 1e-300"


def _excess_line(document: GapReport) -> str:
    """How far what was found takes the excess down."""
    gap, after, shrink = document.gap, document.gap_after, document.shrink
    assert gap.excess_sigma is not None and after.excess_sigma is not None and shrink is not None
    low, high = shrink.interval_95
    return (
        f"  excess over the floor {gap.excess_sigma:.1f} -> {after.excess_sigma:.1f} sigma:"
        f" {100 * shrink.fraction:.0f} % gone ({100 * low:.0f} to {100 * high:.0f} %)"
    )


def _cause_lines(found: Found, *, has_table: bool) -> list[str]:
    cause, others = found.first, found.causes[1:]
    at = f", run {', '.join(c.run_id or '' for c in found.causes)}" if cause.run_id else ""
    lines = [
        f"  {cause.effect} on {cause.target}{at}: probability {cause.probability:.2f},"
        f" {' and '.join(f'{c.size:.0f}' for c in found.causes)} sigma"
    ]
    said = [] if others else list(cause.parameters.items())[:MOST_SAID]
    lines += [f"    {name} {_parameter_text(p)}" for name, p in said]
    if cause.confounded_with:
        lines.append(f"    {_confusion(cause)}: {', '.join(cause.confounded_with)}")
    if cause.shrink is not None and not others:
        lines.append(
            f"    shrinks the gap by {percent(cause.shrink.fraction)}"
            f" ({shrink_words(cause.shrink)})"
        )
    if cause.kept_out is not None:
        lines.append(f"    not in twin.json: {cause.kept_out.template}")
    if cause.advice is not None:
        lines.append(f"    {'renew the table' if has_table else 'make a table'}: {cause.advice}")
    return lines


def _parameter_text(p: CauseParameter) -> str:
    sigma = "" if p.sigma is None else f" +- {plain_number(p.sigma, '.2g')}"
    text = f"{plain_number(p.value, '.4g')}{sigma} {p.unit}"
    if p.unusual:
        return f"{text} (implausibly large)"
    return f"{text} (less than declared)" if p.below_declared else text


def _confusion(cause: Cause) -> str:
    """How its confounded names stand to a cause."""
    if cause.effect == SLOW_NAME:
        return "as a process"
    return "nearly the same" if cause.resolved else "may also be"
