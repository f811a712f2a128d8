"""`align`: attitude and heading with sigma from the parked part of a run."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.gyrocompass import ReadLog
from alignment.gyrocompass import align as align_log
from alignment.motion.speeds import steady_roll
from alignment.reasons import AlignmentReason, AlignmentVerdict
from infield.reports.documents.alignment import AlignmentDocument, alignment_document
from infield.session.log import compensated_imu, compensated_seconds, with_applied_table_undone
from infield.session.parked.zero_rate import ZeroRates, mean_zero_rate
from infield.session.settings import SessionSettings
from infield.store.table_store import TableStore
from infield.table.file import table_sha256
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.documents import Null
from ins.records import InputError, Phase, Run
from ins.verdicts import Reason, because, sentence
from recal.service.inputs.records import AnyRun, AnyTable, AnyTwin, runs_of
from recal.service.inputs.unit_inputs import UnitInputs, given_unit, opened, raw_bias_sigma_deg_h
from recal.service.results.result import Result
from recal.service.twin.fit import fit_at_rest

ALIGN_STEPS = 3  # that `told` is told of


@dataclass(frozen=True, repr=False, eq=False)
class Aligned(Result[AlignmentDocument]):
    """Attitude at the end of the parked time; angles in degrees, NaN where not found.

    Parameters
    ----------
    phases : tuple of Phase
        The phases given or found, in s from the run's start.
    """

    phases: tuple[Phase, ...] = ()

    @property
    def roll_deg(self) -> float:
        return self.record.roll_deg

    @property
    def pitch_deg(self) -> float:
        return self.record.pitch_deg

    @property
    def heading_deg(self) -> float:
        """In [0, 360)."""
        return self.record.heading_deg

    @property
    def sigma_heading_deg(self) -> float:
        """One standard deviation."""
        return self.record.sigma_heading_deg

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Verdict, angles with one sigma, phases."""
        return summary(self.record)


def align(
    run: AnyRun,
    table: AnyTable | None = None,
    twin: AnyTwin | None = None,
    *,
    store: Any = None,
    told: Callable[[str], None] = lambda words: None,
) -> Aligned:
    """Level, gyrocompass and find the phases of one run.

    Parameters
    ----------
    run : Run or path
        One power-on session.
    table : ThermalTable or path, optional
        Gyro bias [deg/h] against temperature; else the store's, else bias 0 with the raw bias of
        the technology as sigma.
    twin : TwinModel or path, optional
        Noise model; else the store's, else the defaults of the technology.
    store : str or TableStore, optional
        SQLAlchemy URL, or a store that is open.
    told : callable
        Told what is being done, in ALIGN_STEPS steps.

    Returns
    -------
    Aligned
        Roll, pitch and heading [deg] with one sigma, phases, verdict `aligned`, `level_only` or
        `refused`, with reasons.

    Raises
    ------
    InputError
        Where run, table or twin cannot be read, or are of different units.

    Examples
    --------
    >>> import recal
    >>> simulated = recal.simulate("parked_only", seed=7, rate_hz=10)
    >>> aligned = recal.align(simulated.run, simulated.table, simulated.twin)
    >>> aligned.verdict, aligned.sigma_heading_deg < 0.2
    ('aligned', True)
    """
    told("reading the run")
    (read,) = runs_of(run)
    unit = given_unit(read, table, twin, store)
    if unit.known:  # what the unit had subtracted is added back before a table is taken out
        read = with_applied_table_undone(read, _lookup(unit, opened(store)))
    sigma, temperature = None, None
    if unit.known and read.temperature is not None:
        temperature = gyro_temperature(read.temperature)
        T = temperature.temperature_degC[0]
        sigma = np.array([unit.table.sigma_deg_h(k, T[k])[0] for k in range(3)])
        sigma = np.hypot(sigma, unit.twin.gyro.turn_on_deg_h)
    if not unit.known and read.header.applied_table_sha256 is not None:
        # the unit took its table out itself: what is left of it is as of any unit with one
        sigma = np.array([unit.table.sigma_deg_h(k, np.zeros(1))[0] for k in range(3)])
    told("levelling and gyrocompassing")
    imu = compensated_imu(read, unit.table, temperature, unit.twin)
    result = align_log(
        imu,
        read.header.site,
        unit.twin,
        bias_sigma_deg_h=sigma,
        phases=read.phases,
        read=ReadLog(seconds=compensated_seconds(read, unit.table, temperature, unit.twin)),
    )
    rolls = steady_roll(read) if result.verdict is AlignmentVerdict.REFUSED else None
    if rolls is not None:
        result = replace(result, reasons=(*result.reasons, rolls))
    if not unit.known:
        result = replace(result, reasons=(*result.reasons, _no_table(unit, read, sigma)))
    told("comparing the noise with its model")
    note = unit.noise_note([run])
    document = replace(
        alignment_document(result, read),
        noise_source=unit.noise_source,
        noise_note=None if note is None else sentence(note),
        noise_fit=fit_at_rest(read, unit.twin, unit.table, [run]),
    )
    if result.verdict is AlignmentVerdict.LEVEL_ONLY and read.header.gyro_technology == "mems":
        seen = mean_zero_rate(read, unit.twin, SessionSettings())
        document = replace(document, zero_rate=seen or Null.NULL)
    return Aligned(document, phases=tuple(document.phases or ()))


def _lookup(unit: UnitInputs, database: TableStore | None) -> Callable[[str], ThermalTable]:
    """The table of a hash: the one in use, else one of the store; else InputError."""

    def found(sha256: str) -> ThermalTable:
        if sha256 == table_sha256(unit.table_dict):
            return unit.table
        if database is None:
            raise InputError(
                f"run.json: applied_table_sha256 {sha256[:12]}: no such table is given"
            )
        return database.by_sha256(sha256).table

    return found


def _no_table(unit: UnitInputs, run: Run, sigma_deg_h: NDArray | None) -> Reason:
    """What the heading rests on where the unit has no table: the sigma that the alignment took."""
    taken = raw_bias_sigma_deg_h(run, unit.twin) if sigma_deg_h is None else np.max(sigma_deg_h)
    return because(
        AlignmentReason.NO_TABLE,
        imu_serial=run.header.imu_serial,
        technology=run.header.gyro_technology,
        sigma_deg_h=float(taken),
    )


def summary(document: AlignmentDocument) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document.run_id}: {document.verdict}"]
    word = "note:" if document.verdict == AlignmentVerdict.ALIGNED else "because"
    lines += [f"  {word} {reason}" for reason in document.reasons]
    lines += [f"  note: {document.noise_note}"] if document.noise_note else []
    if document.noise_fit is not None and not document.noise_fit.fits:
        lines.append(f"  note: {document.noise_fit.text}")
    for name, value, sigma in (
        ("roll", document.roll_deg, document.sigma_roll_deg),
        ("pitch", document.pitch_deg, document.sigma_pitch_deg),
        ("heading", document.heading_deg, document.sigma_heading_deg),
    ):
        if np.isfinite(value):
            lines.append(f"  {name:8s}{value:10.4f} +- {sigma:.4f} deg")
    level = document.motion_level
    if level is not None:
        lines.append(
            f"  used {document.used_percent:.0f} % of the parked seconds; the vehicle moves by"
            f" {level.place_mm:.2g} mm RMS (at most {level.largest_place_mm:.2g}) and yaws by"
            f" {level.yaw_arcsec:.2g} arcsec (at most {level.largest_yaw_arcsec:.2g}): sigma"
            f" {level.sigma_cost:.2f} times that of a still one"
        )
    seen = document.zero_rate
    if isinstance(seen, ZeroRates):
        lines += [
            f"  gyro {axis} zero rate {found.bias_deg_h:+.1f} +- {found.sigma_deg_h:.1f}"
            " deg/h, less vertical Earth"
            f" rate{'' if seen.heading_known else ', heading unknown'} ({seen.start_s:.0f} to"
            f" {seen.end_s:.0f} s)"
            for axis, found in seen.gyro.items()
        ]
    for phase in document.phases or ():
        lines.append(f"  {phase.phase:20s}{phase.start_s:9.1f} to {phase.end_s:9.1f} s")
    return lines
