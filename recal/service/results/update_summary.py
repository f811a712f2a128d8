"""What an update document says: per axis, bias points, and the lines for people."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from infield.reports.documents.parked import effect_words, stretch_words
from infield.reports.documents.session_records import EstimatedDocument
from infield.reports.documents.update import table_uncertainty
from infield.reports.documents.update_records import (
    EffectsCompared,
    PointDocument,
    UpdateDocument,
    ZeroRateEffect,
    update_of,
)
from infield.session.hysteresis import ACTIONS
from infield.session.points import AxisObservability
from infield.session.reasons import ThermalAction
from infield.table.file import export_command
from ins.json_file import JsonObject
from ins.verdicts import OBSERVED_BELOW, Observability, Outcome

if TYPE_CHECKING:
    from pandas import DataFrame

MOST_FAULTS = 3  # of the thermometers of a run; the document has all
# what is said of heating and cooling without -v
SHOWN_ACTIONS = (*ACTIONS.values(), ThermalAction.SPLIT_OR_WRONG_SESSION)


@dataclass(frozen=True)
class Points:
    """Bias points of all runs."""

    rows: tuple[PointDocument, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[PointDocument]:
        return iter(self.rows)

    def of(self, axis: str) -> tuple[PointDocument, ...]:
        """Those of one gyro, "x", "y" or "z"."""
        return tuple(point for point in self.rows if point.axis == axis)

    def to_frame(self) -> "DataFrame":
        """The points as a pandas DataFrame, a row each, units in the column names."""
        from pandas import DataFrame

        columns = [f.name for f in fields(PointDocument)]
        return DataFrame([vars(point) for point in self.rows], columns=columns)

    def __repr__(self) -> str:
        return f"{len(self.rows)} bias points; .to_frame() shows them"


def stored_summary(document: JsonObject) -> list[str]:
    """A stored update.json in a few lines for people."""
    return summary(update_of(document))


def summary(document: UpdateDocument, *, verbose: bool = False) -> list[str]:
    """The result in a few lines for people."""
    kept = f", kept for review as proposal {document.proposal}" if document.proposal else ""
    begun, *rests_on = document.new_unit or [""]
    lines = [f"{document.imu_serial}: {document.verdict}{kept}{begun and f', {begun}'}"]
    lines += [f"  note: {note}" for note in rests_on]
    lines += [f"  because {reason}" for reason in document.reasons]
    if document.conflicts:
        tries = len(document.conflicts) + 1
        lines.append(f"  estimated {tries} times, as other writers were faster")
    lines += [f"  {document.remembered}"] if document.remembered else []
    lines += [f"  note: {document.noise_note}"] if document.noise_note else []
    if document.noise_fit is not None and not document.noise_fit.fits:
        lines.append(f"  note: {document.noise_fit.text}")
    lines += [f"  {document.priors.text}"] if document.priors else []
    shown = [term for term in document.hysteresis if verbose or term.action in SHOWN_ACTIONS]
    lines += [f"  {term.text}" for term in shown]
    lines += [f"  {line}" for line in document.thermal_model.text] if document.thermal_model else []
    lines += [f"  {found.text}" for found in document.found_effects or ()]
    if document.effects_compared is not None:
        lines.append(f"  {_compared(document.effects_compared)}")
    lines += _axis_lines(document, verbose=verbose)
    heading = document.heading_error
    if heading.value_mrad is not None:
        lines.append(
            f"  heading error of the alignment {heading.value_mrad:+.2f} +-"
            f" {heading.sigma_mrad:.2f} mrad, from {heading.source}"
        )
    return [*lines, *_effects(document)]


def _compared(both: EffectsCompared) -> str:
    """The update with the effects left in, in a line."""
    nis = [o.merge_nis for o in (both.left_in, both.taken_out)]
    said = f"with the effects left in: {both.left_in.verdict}"
    if nis[0] is None or nis[1] is None:
        return said
    return f"{said}, NIS of the sessions against the table {nis[0]:.2f} (taken out {nis[1]:.2f})"


def _axis_lines(document: UpdateDocument, *, verbose: bool) -> list[str]:
    """Gyro by gyro both sigmas by their names: that of a run's mean bias, and U(k=2) of the
    table.
    """
    known = table_uncertainty(document) if document.table_before else {}
    lines = []
    for axis, seen in document.observability.items():
        line = (
            f"  gyro {axis}: {seen.verdict}; mean bias of the run, 1 sigma"
            f" {deg_h_text(seen.sigma_before_deg_h)} -> {deg_h_text(seen.sigma_after_deg_h)} deg/h"
        )
        if table := known.get(axis):
            line += (
                f"; table, U(k=2) {deg_h_text(table.U_before_k2_deg_h)} ->"
                f" {deg_h_text(table.U_after_k2_deg_h)} deg/h over {table.low_degC:.0f} to"
                f" {table.high_degC:.0f} degC"
            )
        unsaid = verbose or _not_by_its_sigma(seen)
        lines.append(line + (f"; {seen.advice}" if seen.advice and unsaid else ""))
    return lines


def _not_by_its_sigma(seen: AxisObservability) -> bool:
    """Whether a gyro taught nothing although its sigma fell by more than half: its thermometer
    failed, and the numbers of its line do not say so.
    """
    fell = seen.sigma_after_deg_h < OBSERVED_BELOW * seen.sigma_before_deg_h
    return fell and seen.verdict is Observability.NOT_OBSERVABLE


def deg_h_text(value: float) -> str:
    """Four decimals below 1 deg/h, four digits above."""
    return f"{value:.4f}" if abs(value) < 1.0 else f"{value:.4g}"


def _effects(document: UpdateDocument) -> list[str]:
    """What the change of the table means."""
    lines = []
    if isinstance(document.zero_rate_effect, ZeroRateEffect):
        lines.append(f"  {effect_words(document.zero_rate_effect)}")
    refused = document.verdict == Outcome.REFUSED  # its reasons say it
    for session in document.sessions:
        if isinstance(session, EstimatedDocument) and session.temperature and not refused:
            faults = session.temperature.faults[:MOST_FAULTS]
            lines += [f"  {session.run_id} {fault}" for fault in faults]
        if isinstance(session, EstimatedDocument) and session.taxi:
            lines += [f"  {session.run_id} {found.text}" for found in session.taxi.needed]
        if isinstance(session, EstimatedDocument) and session.own_errors:
            lines += [f"  {session.run_id} {own.text}" for own in session.own_errors]
        if isinstance(session, EstimatedDocument) and session.zero_rate:
            lines += [f"  {session.run_id} {line}" for line in stretch_words(session.zero_rate)]
    effect = document.predicted_effect
    if effect:
        not_shown = "" if effect.significant else ": not different from zero"
        lines.append(
            f"  level gyros change by {effect.level_change_deg_h:.4f} deg/h, about"
            f" {effect.drift_removed_nm_h:.2f} +- {effect.drift_left_sigma_nm_h:.2f}"
            f" NM/h{not_shown}"
        )
    if document.verdict == Outcome.COMMITTED:
        export = export_command(document.store, document.imu_serial)
        lines.append(f"  counts once the unit has loaded it: {export}")
    return lines
