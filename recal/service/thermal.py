"""`fit_fog`, `fit_rlg`: thermal coefficients from chamber runs; `take_out`: a fitted model out of a
run.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from infield.reports import fog_page, rlg_page
from infield.reports.documents.fog import (
    FogDocument,
    fit_models,
    fixed_tables,
    fog_document,
    worst_rounding,
)
from infield.reports.documents.rlg import RlgDocument, TermState, rlg_document
from infield.store.table_store import TableStore, UnknownUnit
from infield.thermal.fog.fixed_point import to_c_header, to_csv
from infield.thermal.fog.model import held_out
from infield.thermal.fog.ramps import separate
from infield.thermal.ramp_runs import gradient_run, ramp_run
from infield.thermal.rlg.gradients import fit_gradients, held_out_run
from infield.thermal.rlg.model import model_from_document
from infield.thermal.stored_model import check_usable, read_thermal_model, removed_from
from ins.documents import plain
from ins.records import InputError, Run, TwinModel
from ins.twin_file import default_twin
from recal.service.inputs.records import AnyRun, AnyTwin, read_one, twin_of
from recal.service.inputs.twin_table import twin_of_unit
from recal.service.inputs.unit_inputs import opened
from recal.service.results.files import AnyPath, program_version
from recal.service.results.result import Result
from trajectories.runs.directory import write_run

NEEDED_INSTABILITY_DEG_H = 0.001  # what a gradient term may be where the twin states no instability
PARTS = ("all", "rates")
SETTLED_TERMS = ("K1", "K2", "K3")  # of a unit whose temperature stands still
THERMAL_STEPS = 2  # that `told` is told of beside the runs: the fit, and what follows it
TAKE_OUT_STEPS = 3  # that `told` is told of: reading, taking out, writing
T = TypeVar("T")


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class ThermalFit(Result[FogDocument | RlgDocument]):
    """Fitted thermal coefficients of one unit."""

    FOLDER = "recal-thermal"

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Verdict, coefficients per gyro, what is left on the runs to test on."""
        found = self.record
        return _fog_summary(found) if isinstance(found, FogDocument) else _rlg_summary(found)


@dataclass(frozen=True, kw_only=True)
class FogRequest:
    """How ramps are taken apart.

    Parameters
    ----------
    allowed_deg_h : float, optional
        Largest gradient term of a slow ramp [deg/h]. Default: the twin's bias instability.
    word_bits : int in [8, 32]
        Bits of a word of the exported whole-number tables.
    remounted : bool
        The unit was taken off and mounted again between the runs.
    one_sided : bool
        Accept ramps of one direction, at two rates.
    """

    allowed_deg_h: float | None = None
    word_bits: int = 16
    remounted: bool = False
    one_sided: bool = False


def fit_fog(
    fast: Sequence[AnyRun],
    slow: Sequence[AnyRun] = (),
    check: Sequence[AnyRun] = (),
    *,
    twin: AnyTwin | None = None,
    store: TableStore | str | None = None,
    request: FogRequest | None = None,
    told: Callable[[str], None] = lambda words: None,
) -> ThermalFit:
    """Fibre-optic gyro: K_T and K_delta of b = K_T(T) + K_delta(T) dT/dt from temperature ramps.

    Parameters
    ----------
    fast, slow : sequences of Run or path
        Runs with the fast ramp, up and down, and with the slow one; no slow one: up/down pair.
    check : sequence of Run or path
        Runs to test on, not fitted to.
    twin : TwinModel or path, optional
        Noise model; else the store's, else the defaults of the technology.
    store : str or TableStore, optional
        Looked in for the noise model.
    request : FogRequest, optional
        How the ramps are taken apart.
    told : callable
        Told what is being done: a step for each run, and THERMAL_STEPS more.

    Returns
    -------
    ThermalFit
        K_T [deg/h] and K_delta [deg/h per degC/min] over temperature, per gyro, with sigma.

    Raises
    ------
    InputError
        Where a run cannot be read or is of another unit or technology.

    Examples
    --------
    >>> import recal
    >>> recal.fit_fog(["nowhere"])
    Traceback (most recent call last):
        ...
    ins.records.InputError: nowhere: no such run directory
    """
    asked = request or FogRequest()
    if asked.allowed_deg_h is not None and not 0 < asked.allowed_deg_h < float("inf"):
        raise InputError(f"--allowed-deg-h: got {asked.allowed_deg_h:g}, needed more than 0")
    groups, noise = reduced_groups((fast, slow, check), "fog", ramp_run, store, twin, told)
    told("fitting the ramps")
    study = separate(
        groups[0], groups[1], noise, remounted=asked.remounted, one_sided=asked.one_sided
    )
    pairs, model = fit_models(study)
    told("testing on the runs that were held out" if check else "writing the report")
    tested = zip(check, groups[2]) if study.axes else ()
    checks = [held_out(read_one(given), run, model) for given, run in tested]
    found = fog_document(
        study,
        pairs,
        model,
        checks=checks,
        allowed_deg_h=asked.allowed_deg_h
        or noise.gyro.bias_instability_deg_h
        or NEEDED_INSTABILITY_DEG_H,
        word_bits=asked.word_bits,
        version=program_version(),
    )
    files = {}
    if study.axes:
        tables = fixed_tables(model, asked.word_bits)
        worst = worst_rounding(model, tables, max(run.rate for run in study.fast))
        header = to_c_header(tables, worst, serial=found.imu_serial)
        files = {"thermal_fog.h": header, "thermal_fog.csv": to_csv(tables)}
    return ThermalFit(found, page=lambda: fog_page.render(found), files=files)


def fit_rlg(
    runs: Sequence[AnyRun],
    check: Sequence[AnyRun] = (),
    *,
    twin: AnyTwin | None = None,
    store: TableStore | str | None = None,
    remounted: bool = False,
    told: Callable[[str], None] = lambda words: None,
) -> ThermalFit:
    """Ring-laser gyro: K1..K6 of b = K1 + K2 T + K3 T^2 + K4 dT/dt + K5 T dT/dt + K6 Tdiff.

    Parameters
    ----------
    runs : sequence of Run or path
        Run directories of one unit at rest, warmed and cooled.
    check : sequence of Run or path
        Runs that only test the model.
    twin : TwinModel or path, optional
        Noise model; else the store's, else the defaults of the technology.
    store : str or TableStore, optional
        Looked in for the noise model.
    remounted : bool
        The unit was taken off and mounted again between the runs.
    told : callable
        Told what is being done: a step for each run, and THERMAL_STEPS more.

    Returns
    -------
    ThermalFit
        Coefficients per gyro (deg/h, degC, min), with sigma.

    Raises
    ------
    InputError
        Where a run cannot be read or is of another unit or technology.

    Examples
    --------
    >>> import recal
    >>> recal.fit_rlg(["nowhere"])
    Traceback (most recent call last):
        ...
    ins.records.InputError: nowhere: no such run directory
    """
    groups, noise = reduced_groups((runs, check), "rlg", gradient_run, store, twin, told)
    told("fitting the gradients")
    study = fit_gradients(groups[0], noise, remounted=remounted)
    told("testing on the runs that were held out" if check else "writing the report")
    found = rlg_document(study, version=program_version())
    if study.axes and check:
        model = model_from_document(plain(found))
        checks = [held_out_run(read_one(run), model, study.axes, noise) for run in check]
        found = rlg_document(study, checks=checks, version=program_version())
    return ThermalFit(found, page=lambda: rlg_page.render(found))


@dataclass(frozen=True, kw_only=True)
class TakenOutReport:
    """What `recal thermal apply --json` prints; run: where it was written; share_inside: of the
    rows, inside the fitted temperatures.
    """

    schema: str = "recal.thermal_apply/1"
    run: str
    run_id: str
    model: str
    model_sha256: str
    part: str
    order: str
    axes: Sequence[str]
    share_inside: float


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class TakenOut(Result[TakenOutReport]):
    """A run without what a thermal model says of its gyros.

    Parameters
    ----------
    run : Run
        The compensated run.
    """

    run: Run

    def lines(self, *, verbose: bool = False) -> list[str]:
        """How much of the run the model knows."""
        d = self.record
        return [f"{d.run}: {d.run_id}, {d.share_inside:.0%} of it inside the fitted temperatures"]


def take_out(
    model: AnyPath,
    run: AnyRun,
    output: AnyPath,
    *,
    part: str = "all",
    batch: bool = False,
    told: Callable[[str], None] = lambda words: None,
) -> TakenOut:
    """Take a fitted thermal model out of a run's gyro output, and write the run.

    Parameters
    ----------
    model : str or path
        A thermal_rlg.json or thermal_fog.json that was fitted.
    run : Run or path
        A run directory with raw gyro output.
    output : str or path
        The compensated run to write.
    part : str
        What to take out: all, or only rates, which leaves what a settled unit has to a thermal
        table.
    batch : bool
        Use smoothed temperatures. Default: only those up to each row's time.
    told : callable
        Told what is being done, in TAKE_OUT_STEPS steps.
    """
    if part not in PARTS:
        raise InputError(f"--part: got {part!r}, needed all or rates")
    told("reading the run")
    stored = read_thermal_model(Path(model))
    read = read_one(run)
    check_usable(read, stored)
    told("taking the model out")
    left = removed_from(read, stored, part=part, batch=batch)
    header = replace(left.header, run_id=f"{read.header.run_id}-compensated")
    left = replace(left, header=header, sha256="")
    told("writing the run")
    write_run(Path(output), left)
    assert read.temperature is not None
    document = TakenOutReport(
        run=str(output),
        run_id=left.header.run_id,
        model=str(model),
        model_sha256=stored.sha256,
        part=part,
        order="batch" if batch else "real time",
        axes=list(stored.model.axes),
        share_inside=float(stored.model.inside(read.temperature.gyro_degC).all(axis=1).mean()),
    )
    return TakenOut(document, run=left)


def _fog_summary(document: FogDocument) -> list[str]:
    """The result in a few lines for people."""
    lines = _head(document)
    for axis, a in document.axes.items():
        K, s = a.K_delta_deg_h_per_degC_min, a.sigma_K_delta_deg_h_per_degC_min
        middle = len(K) // 2
        lines.append(
            f"  gyro {axis}: K_delta {K[0]:+.4f} .. {K[middle]:+.4f} .. {K[-1]:+.4f} +-"
            f" {s[middle]:.4f} deg/h per degC/min over {a.temperature_degC[0]:g} .."
            f" {a.temperature_degC[-1]:g} degC; K_T spans"
            f" {max(a.K_T_deg_h) - min(a.K_T_deg_h):.4f} deg/h; slow ramps up to"
            f" {a.slow_rate.largest_degC_min:.4f} degC/min"
        )
        if a.document is not None and a.document.gain is not None:
            lines.append(
                f"    the document's subtraction reads K_delta times {a.document.gain:.3f}"
            )
    for found in document.check:
        for axis, row in found.axes.items():
            lines.append(
                f"  {found.run.run_id} gyro {axis}: {row.before_deg_h:.4f} ->"
                f" {row.after_deg_h:.4f} deg/h RMS (noise {row.noise_deg_h:.4f}),"
                f" {row.causal_after_deg_h:.4f} in real-time order"
            )
    return lines


def _rlg_summary(document: RlgDocument) -> list[str]:
    """The result in a few lines for people."""
    lines = _head(document)
    for axis, a in document.axes.items():
        used = {name: t for name, t in a.terms.items() if t.state == TermState.USED}
        said = ", ".join(
            f"{name} {t.value:+.5f} +- {t.sigma:.5f}"
            for name, t in used.items()
            if name not in SETTLED_TERMS
        )
        h = a.held_out
        lines.append(
            f"  gyro {axis}: {said or 'no rate or gradient term'}; held out {h.before_deg_h:.4f}"
            f" -> {h.temperature_only_deg_h:.4f} (temperature) -> {h.model_deg_h:.4f} deg/h"
            f" RMS, noise {h.noise_deg_h:.4f}"
        )
    for found in document.check:
        for axis, row in found.axes.items():
            lines.append(
                f"  {found.run.blocks.run_id} gyro {axis}: {row.before_deg_h:.4f} ->"
                f" {row.temperature_only_deg_h:.4f} (temperature) -> {row.after_deg_h:.4f}"
                f" deg/h RMS (noise {row.noise_deg_h:.4f}), {row.causal_after_deg_h:.4f} in"
                " real-time order"
            )
    return lines


def _head(document: FogDocument | RlgDocument) -> list[str]:
    """Verdict, reasons, notes."""
    return [
        f"{document.imu_serial}: {document.verdict}",
        *(f"  because {reason}" for reason in document.reasons),
        *(f"  {note}" for note in document.notes),
    ]


def runs_of_one_unit(given: Sequence[AnyRun], technology: str) -> Iterator[Run]:
    """One run in memory at a time; InputError for one given twice, of another unit or another
    technology.
    """
    seen: dict[str, str] = {}
    serial = ""
    for item in given:
        run = read_one(item)
        path = run.header.run_id if isinstance(item, Run) else str(item)
        if run.sha256 in seen:
            raise InputError(f"{path}: the same run as {seen[run.sha256]}, needed another one")
        if run.header.removed_model is not None:
            raise InputError(
                f"{path}: run.json: removed_thermal_model is set, needed raw gyro output"
            )
        if run.header.gyro_technology != technology:
            raise InputError(
                f"{path}: run.json: gyro_technology {run.header.gyro_technology!r}, needed"
                f" {technology!r}"
            )
        if serial and run.header.imu_serial != serial:
            raise InputError(
                f"{path}: run.json: imu_serial {run.header.imu_serial!r}, needed {serial!r} (first"
                " run)"
            )
        seen[run.sha256] = path
        serial = run.header.imu_serial
        yield run


def reduced_groups(
    groups: Sequence[Sequence[AnyRun]],
    technology: str,
    reduce: Callable[[Run, TwinModel], T],
    store: TableStore | str | None,
    twin: AnyTwin | None,
    told: Callable[[str], None] = lambda words: None,
) -> tuple[list[list[T]], TwinModel]:
    """Each run reduced, by group, and the unit's noise model; told: of each run as it is begun."""
    model: TwinModel | None = None
    found: list[T] = []
    for run in runs_of_one_unit([run for group in groups for run in group], technology):
        told(f"reducing {run.header.run_id}")
        model = model or noise_model(run, store, twin)
        found.append(reduce(run, model))
    if model is None:
        raise InputError("runs: none was given, needed at least one")
    rest = iter(found)
    return [[next(rest) for _ in group] for group in groups], model


def noise_model(run: Run, store: TableStore | str | None, given: AnyTwin | None) -> TwinModel:
    """The noise model that is given, else from the store, else the defaults of the technology."""
    header = run.header
    if given is not None:
        return twin_of_unit(twin_of(given), run)
    return _stored_twin(run, opened(store)) or default_twin(header.gyro_technology)


def _stored_twin(run: Run, store: TableStore | None) -> TwinModel | None:
    header = run.header
    if store is None:
        return None
    try:
        return store.twin(header.imu_serial, header.gyro_technology, header.gyro_mode)
    except UnknownUnit:
        return None
