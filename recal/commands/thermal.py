"""`recal thermal`: thermal coefficients from chamber runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.console import (
    DEFAULT_STORE,
    Command,
    JsonFlag,
    NoSeed,
    OutputPath,
    Quiet,
    StoreUrl,
    Verbose,
    answer,
    finish,
    result_text,
    say,
)

if TYPE_CHECKING:
    from infield.ramp_runs import RampRun
    from ins.records import Run, TwinModel

app = typer.Typer(no_args_is_help=True, help="Thermal coefficients from chamber runs.")


class ManyRuns(Command):
    """`--fast A B --slow C` means `--fast A --fast B --slow C`."""

    MANY = ("--fast", "--slow", "--check")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Each further word after one of MANY belongs to it."""
        spread: list[str] = []
        option, filled = "", False
        for word in args:
            if word.startswith("-"):
                option, filled = word if word in self.MANY else "", False
            elif option and filled:
                spread.append(option)
            else:
                filled = bool(option)
            spread.append(word)
        return super().parse_args(ctx, spread)


@app.command("fog", cls=ManyRuns)
def fog(
    fast: Annotated[list[Path], typer.Option("--fast", help="Runs with the fast ramp, up and down (one or several).")],
    slow: Annotated[list[Path] | None, typer.Option("--slow", help="Runs with the slow ramp; none: up/down pair.")] = None,
    check: Annotated[list[Path] | None, typer.Option("--check", help="Runs to test on, not fitted to.")] = None,
    allowed_deg_h: Annotated[
        float | None, typer.Option("--allowed-deg-h", help="Gradient term a slow ramp may have; default: bias instability.")
    ] = None,
    word_bits: Annotated[int, typer.Option("--word-bits", min=8, max=32, help="Of the exported fixed-point tables.")] = 16,
    remounted: Annotated[bool, typer.Option("--remounted", help="The unit was moved between the runs.")] = False,
    one_sided: Annotated[bool, typer.Option("--one-sided", help="Accept ramps of one direction at two rates.")] = False,
    store: StoreUrl = DEFAULT_STORE,
    twin: Annotated[Path | None, typer.Option("--twin", help="Noise model of the unit.")] = None,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Fibre-optic gyro: K_T and K_delta of b = K_T(T) + K_delta(T) dT/dt from temperature ramps of the resting unit.

    Example: recal thermal fog --fast chamber-fast --slow chamber-slow --check chamber-other -o fog
    """
    document = fog_ramps(
        fast, slow or [], check or [], allowed_deg_h=allowed_deg_h, word_bits=word_bits, remounted=remounted,
        one_sided=one_sided, store_url=store, twin_path=twin, output=output,
    )  # fmt: skip
    answer(document, as_json=as_json, verbose=verbose)
    for line in summary(document):
        say(line, quiet=quiet)
    finish(document)


@app.command("apply", cls=Command)
def apply(
    model: Annotated[Path, typer.Argument(help="A thermal_fog.json that was fitted.")],
    run: Annotated[Path, typer.Argument(help="Run directory, raw gyro output.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The compensated run to write.")],
    batch: Annotated[bool, typer.Option("--batch", help="Smoothed temperatures instead of real-time order.")] = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Take a fitted fibre-optic model out of a run's gyro output, each row from temperatures up to its own time.

    Example: recal thermal apply fog/thermal_fog.json run-1 -o run-1-compensated
    """
    result = apply_model(model, run, output, batch=batch)
    answer(result, as_json=as_json, verbose=verbose)
    say(f"{output}: {result['run_id']}, {result['share_inside']:.0%} of it inside the fitted temperatures", quiet=quiet)


def apply_model(model_path: Path, run_path: Path, output: Path, *, batch: bool) -> dict[str, Any]:
    """Writes the compensated run; returns `recal.thermal_apply/1`."""
    from dataclasses import replace

    from infield.fog_model import compensate_batch, compensate_causal, model_from_document
    from infield.thermometer import gyro_temperature
    from ins.json_file import read_json_object
    from ins.records import InputError
    from trajectories.run import read_run, write_run

    document = read_json_object(model_path)
    model = model_from_document(document, name=str(model_path))
    run = read_run(run_path)
    header, serial = run.header, document.get("imu_serial")
    if header.imu_serial != serial:
        raise InputError(f"{run_path}: run.json: imu_serial {header.imu_serial!r}, needed {serial!r} as in {model_path}")
    if run.temperature is None:
        raise InputError(f"{run_path}: no gyro temperature in the run, needed to compensate it")
    imu, log = run.imu.whole(), run.temperature
    left = compensate_batch(imu, model, gyro_temperature(log)) if batch else compensate_causal(imu, model, log)
    name = f"{header.run_id}-compensated"
    write_run(output, replace(run, imu=left, header=replace(header, run_id=name), sha256=""))
    return {
        "schema": "recal.thermal_apply/1", "run": str(output), "run_id": name, "model": str(model_path),
        "order": "batch" if batch else "real time", "axes": list(model.K_T),
        "share_inside": float(model.inside(run.temperature.gyro_degC).all(axis=1).mean()),
    }  # fmt: skip


def fog_ramps(
    fast: list[Path], slow: list[Path], check: list[Path], *, allowed_deg_h: float | None, word_bits: int, remounted: bool,
    one_sided: bool, store_url: str, twin_path: Path | None, output: Path | None,
) -> dict[str, Any]:  # fmt: skip
    """Writes thermal_fog.json and .html, and where it was fitted thermal_fog.h and .csv; returns the document."""
    from infield.fixed_point import to_c_header, to_csv
    from infield.fog_document import fit_models, fixed_tables, fog_document, worst_rounding
    from infield.fog_model import held_out
    from infield.fog_ramps import separate
    from infield.fog_report import fog_html
    from ins.records import InputError
    from recal.output import output_directory, program_version, write_files
    from trajectories.run import read_run

    if allowed_deg_h is not None and not 0 < allowed_deg_h < float("inf"):
        raise InputError(f"--allowed-deg-h: got {allowed_deg_h:g}, needed more than 0")
    groups, model_of_noise = _read(fast, slow, check, store_url, twin_path)
    study = separate(groups[0], groups[1], model_of_noise, remounted=remounted, one_sided=one_sided)
    pairs, model = fit_models(study)
    checks = [] if not study.axes else [held_out(read_run(p), run, model, model_of_noise) for p, run in zip(check, groups[2])]
    document = fog_document(
        study, pairs, model, checks=checks, allowed_deg_h=allowed_deg_h or model_of_noise.gyro.bias_instability_deg_h or 0.001,
        word_bits=word_bits, version=program_version(),
    )  # fmt: skip
    directory = output_directory(output, "thermal")
    texts = {
        directory / "thermal_fog.json": result_text(document), directory / "thermal_fog.html": fog_html(document, checks)
    }  # fmt: skip
    if study.axes:
        tables = fixed_tables(model, word_bits)
        worst = worst_rounding(model, tables, max(run.rate for run in study.fast))
        texts[directory / "thermal_fog.h"] = to_c_header(tables, worst, serial=document["imu_serial"])
        texts[directory / "thermal_fog.csv"] = to_csv(tables)
    write_files(texts)
    return document


def _read(
    fast: list[Path], slow: list[Path], check: list[Path], store_url: str, twin_path: Path | None
) -> tuple[list[list[RampRun]], TwinModel]:
    """Block means of the runs by role, one run in memory at a time, and the unit's noise model."""
    from infield.ramp_runs import ramp_run
    from ins.records import InputError
    from trajectories.run import read_run

    groups: list[list[RampRun]] = []
    twin: TwinModel | None = None
    seen: dict[str, str] = {}
    serial = ""
    for paths in (fast, slow, check):
        groups.append([])
        for path in paths:
            run = read_run(path)
            if run.sha256 in seen:
                raise InputError(f"{path}: the same run as {seen[run.sha256]}, needed another one")
            if run.header.gyro_technology != "fog":
                raise InputError(f"{path}: run.json: gyro_technology {run.header.gyro_technology!r}, needed 'fog'")
            if serial and run.header.imu_serial != serial:
                raise InputError(f"{path}: run.json: imu_serial {run.header.imu_serial!r}, needed {serial!r} (first run)")
            seen[run.sha256], serial = str(path), run.header.imu_serial
            twin = twin or _twin(run, store_url, twin_path)
            groups[-1].append(ramp_run(run, twin))
    assert twin is not None  # --fast is required
    return groups, twin


def _twin(run: Run, store_url: str, twin_path: Path | None) -> TwinModel:
    """The noise model from --twin, else from the store, else the defaults of the technology."""
    from ins.records import InputError
    from ins.twin_file import default_twin, read_twin

    header = run.header
    if twin_path is not None:
        twin = read_twin(twin_path)
        if twin.gyro_technology != header.gyro_technology or twin.imu_serial not in ("", header.imu_serial):
            raise InputError(
                f"{twin_path}: is of {twin.gyro_technology} unit {twin.imu_serial or '(any)'}, run {header.run_id} of "
                f"{header.gyro_technology} unit {header.imu_serial}"
            )
        return twin
    return _stored_twin(run, store_url) or default_twin(header.gyro_technology)


def _stored_twin(run: Run, store_url: str) -> TwinModel | None:
    from infield.store import TableStore, UnknownUnit, store_exists

    header = run.header
    if not store_exists(store_url):
        return None
    try:
        with TableStore.open(store_url, create=False) as opened:
            return opened.twin(header.imu_serial, header.gyro_technology, header.gyro_mode)
    except UnknownUnit:
        return None


def summary(document: dict[str, Any]) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document['imu_serial']}: {document['verdict']}"]
    lines += [f"  because {reason}" for reason in document["reasons"]]
    lines += [f"  {note}" for note in document["notes"]]
    for axis, a in document["axes"].items():
        K, s = a["K_delta_deg_h_per_degC_min"], a["sigma_K_delta_deg_h_per_degC_min"]
        middle = len(K) // 2
        lines.append(
            f"  gyro {axis}: K_delta {K[0]:+.4f} .. {K[middle]:+.4f} .. {K[-1]:+.4f} +- {s[middle]:.4f} deg/h per degC/min "
            f"over {a['temperature_degC'][0]:g} .. {a['temperature_degC'][-1]:g} degC; K_T spans "
            f"{max(a['K_T_deg_h']) - min(a['K_T_deg_h']):.4f} deg/h; slow ramps up to "
            f"{a['slow_rate']['largest_degC_min']:.4f} degC/min"
        )
        if a["document"] is not None and a["document"]["gain"] is not None:
            lines.append(f"    the document's subtraction reads K_delta times {a['document']['gain']:.3f}")
    for found in document["check"]:
        for axis, row in found["axes"].items():
            lines.append(
                f"  {found['run_id']} gyro {axis}: {row['before_deg_h']:.4f} -> {row['after_deg_h']:.4f} deg/h RMS "
                f"(noise {row['noise_deg_h']:.4f}), {row['causal_after_deg_h']:.4f} in real-time order"
            )
    return lines
