"""A stored thermal model (`recal thermal rlg|fog`) before the table: its rate and gradient terms
leave the log.

The table stays the bias of the settled unit::

    raw log - (rates + gradients) -> update, replay with the table
    residual table = table - settled part of the model

Taking out the settled part as well and learning a table of the residual is the same sum in another
order; kept apart like this a table means the same with a model and without one, and a store needs
no second kind of table (US 5,527,003 on top of it).
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import TemperatureModel, ThermalTable
from infield.thermal.compensation import BiasSeries, batch_series, causal_series, less
from infield.thermal.fog import model as fog
from infield.thermal.found_effects import with_wider_turn_on
from infield.thermal.ramp_runs import gradient_lines
from infield.thermal.reasons import ThermalNote
from infield.thermal.rlg import model as rlg
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.json_file import read_json_object
from ins.records import AXES, InputError, RemovedModel, Run, TwinModel
from ins.verdicts import Reason, because

READERS: dict[str, Callable[..., TemperatureModel]] = {
    fog.SCHEMA: fog.model_from_document,
    rlg.SCHEMA: rlg.model_from_document,
}


@dataclass(frozen=True)
class StoredModel:
    """A fitted model and where it comes from; sha256: over the content of its document."""

    model: TemperatureModel
    sha256: str
    schema: str
    imu_serial: str
    gyro_technology: str
    name: str


@dataclass(frozen=True)
class Removed:
    """What a model's rate and gradient terms were along a run, by gyro: RMS, and RMS of what is not
    known of them.
    """

    run_id: str
    rms_deg_h: Mapping[str, float]
    sigma_deg_h: Mapping[str, float]
    share_inside: float
    taken_out_before: bool


def read_thermal_model(path: Path) -> StoredModel:
    """The model in a thermal_rlg.json or thermal_fog.json; InputError names what is wrong."""
    document = read_json_object(path)
    reader = READERS.get(str(document.get("schema")))
    if reader is None:
        raise InputError(
            f"{path}: schema: got {str(document.get('schema'))[:60]!r}, needed one of"
            f" {', '.join(READERS)}"
        )
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    return StoredModel(
        model=reader(document, name=str(path)),
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        schema=str(document["schema"]),
        imu_serial=str(document.get("imu_serial")),
        gyro_technology=str(document.get("gyro_technology")),
        name=str(path),
    )


def check_usable(run: Run, stored: StoredModel) -> None:
    """InputError where the model is of another unit, or the run lacks what it needs or has lost a
    model already.
    """
    header = run.header
    if header.imu_serial != stored.imu_serial:
        raise InputError(
            f"run {header.run_id}: imu_serial {header.imu_serial!r}, needed {stored.imu_serial!r}"
            f" as in {stored.name}"
        )
    if header.gyro_technology != stored.gyro_technology:
        raise InputError(
            f"run {header.run_id}: gyro_technology {header.gyro_technology!r}, needed"
            f" {stored.gyro_technology!r} as in {stored.name}"
        )
    if run.temperature is None:
        raise InputError(f"run {header.run_id}: no gyro temperature, needed to use {stored.name}")
    if header.removed_model is not None:
        raise InputError(
            f"run {header.run_id}: thermal model {header.removed_model.sha256[:12]} was taken out"
            " of it, needed the raw run"
        )
    logged: list[str] = []
    gradient = run.temperature.gradient_degC
    if gradient is not None:
        logged = [axis for axis, column in zip(AXES, gradient.T) if np.isfinite(column).any()]
    lacking = [f"gradient_{axis}_degC" for axis in stored.model.lines if axis not in logged]
    if lacking:
        raise InputError(
            f"run {header.run_id}: temperature: no {' '.join(lacking)}, needed by the terms of"
            f" {stored.name}"
        )


def removed_from(run: Run, stored: StoredModel, *, part: str, batch: bool) -> Run:
    """The run less a part of the model, said in its header."""
    log = run.temperature
    assert log is not None  # check_usable
    if part == "all" and run.header.applied_table_sha256 is not None:
        raise InputError(
            f"run {run.header.run_id}: applied_table_sha256 is set, needed raw gyro output, or the"
            " part rates"
        )
    if batch:
        series = batch_series(stored.model, log, gyro_temperature(log), part=part)
    else:
        series = causal_series(stored.model, log, part=part)
    header = replace(
        run.header,
        removed_model=RemovedModel(sha256=stored.sha256, part=part, run_sha256=run.sha256),
    )
    return replace(run, imu=less(run.imu, series), header=header)


def without_rates(run: Run, stored: StoredModel | None) -> tuple[Run, Removed | None]:
    """The run as update and replay take it: its rate and gradient terms out, its settled bias in,
    known by its raw hash.

    A run of `recal thermal apply` is taken as it is where the rates are out, and gets its settled
    bias back where all is.
    """
    gone = run.header.removed_model
    if gone is None:
        if stored is None:
            return run, None
        check_usable(run, stored)
        return removed_from(run, stored, part="rates", batch=True), removal(run, stored)
    if stored is not None and stored.sha256 != gone.sha256:
        raise InputError(
            f"run {run.header.run_id}: thermal model {gone.sha256[:12]} was taken out of it,"
            f" {stored.name} is another"
        )
    known = replace(run, sha256=gone.run_sha256)
    if gone.part == "rates":
        return known, None if stored is None else removal(run, stored, before=True)
    if stored is None:
        raise InputError(
            f"run {run.header.run_id}: thermal model {gone.sha256[:12]} was taken out of it as a"
            " whole, needed that model (--thermal-model) to put its settled part back, or `recal"
            " thermal apply --part rates`"
        )
    settled = _settled(stored.model, run)
    back = less(run.imu, lambda time_s: -settled(time_s))
    header = replace(run.header, removed_model=replace(gone, part="rates"))
    return replace(known, imu=back, header=header), removal(run, stored, before=True)


def _settled(model: TemperatureModel, run: Run) -> BiasSeries:
    """The settled part over time, from the readings as `thermal apply` takes them."""
    log = run.temperature
    assert log is not None  # a run that was compensated has one
    whole, rates = (causal_series(model, log, part=part) for part in ("all", "rates"))
    return lambda time_s: whole(time_s) - rates(time_s)


def removal(run: Run, stored: StoredModel, *, before: bool = False) -> Removed:
    """How large the rate and gradient terms are along a run, and how well they are known; before:
    they had left it already.
    """
    log = run.temperature
    assert log is not None  # check_usable
    temperature = gyro_temperature(log)
    nodes, T, rate = temperature.time_s, temperature.temperature_degC, temperature.rate_degC_min
    # a line that was dropped has a sigma that goes with that of the rate
    lines = gradient_lines(log).at(nodes)
    parts = (
        stored.model.rates_deg_h(T, rate, lines),
        stored.model.rates_sigma_deg_h(T, rate, lines),
    )
    rms, sigma = (np.sqrt(np.mean(part**2, axis=0)).tolist() for part in parts)
    share = float(
        stored.model.inside(T)[:, [AXES.index(axis) for axis in stored.model.axes]]
        .all(axis=1)
        .mean()
    )
    return Removed(
        run_id=run.header.run_id,
        rms_deg_h=dict(zip(AXES, rms)),
        sigma_deg_h=dict(zip(AXES, sigma)),
        share_inside=share,
        taken_out_before=before,
    )


def prepared(runs: Sequence[Run], stored: StoredModel | None) -> tuple[list[Run], list[Removed]]:
    """All runs of an update or a replay as `without_rates` gives them, and what left them."""
    found = [without_rates(run, stored) for run in runs]
    return [run for run, _ in found], [gone for _, gone in found if gone is not None]


def with_model_sigma(twin: TwinModel, removed: Sequence[Removed]) -> TwinModel:
    """The twin with what is not known of the removed terms in its turn-on: one constant more of
    each session.
    """
    if not removed:
        return twin
    extra = max(max(found.sigma_deg_h.values()) for found in removed)
    return with_wider_turn_on(twin, extra, "the thermal model")


def seeded_table(table: ThermalTable, stored: StoredModel) -> ThermalTable:
    """The table of a unit without one: the model's settled part at its nodes instead of 0, its
    sigma as it was.
    """
    parameters = table.parameters.copy()
    for axis, curves in stored.model.curves.items():
        T = table.temperature_degC[AXES.index(axis)]
        parameters[table.values_of(axis)] += curves.settled_deg_h(T)
    return table.replaced(parameters=parameters)


def taken_out(stored: StoredModel, removed: Sequence[Removed]) -> tuple[Reason, ...]:
    """What left the runs, one note a run."""
    return tuple(
        because(
            ThermalNote.TAKEN_OUT,
            run_id=found.run_id,
            model=stored.name,
            before=found.taken_out_before,
            rms_deg_h={axis: found.rms_deg_h[axis] for axis in stored.model.axes},
            worst_deg_h=max(found.sigma_deg_h[axis] for axis in stored.model.axes),
            share_inside=found.share_inside,
        )
        for found in removed
    )


def residual_table(stored: StoredModel, table: ThermalTable) -> dict[str, tuple[NDArray, NDArray]]:
    """Nodes, and the table there less the model's settled part, of each gyro with a model."""
    found = {}
    for axis, curves in stored.model.curves.items():
        T = table.temperature_degC[AXES.index(axis)]
        found[axis] = T, table.curves[axis].settled_deg_h(T) - curves.settled_deg_h(T)
    return found
