"""`recal thermal fog`: temperature and rate coefficients of a fibre-optic unit from chamber
ramps.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from recal.cli.console import (
    DEFAULT_STORE,
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


def command(
    fast: Annotated[
        list[Path],
        typer.Option("--fast", help="Runs with the fast ramp, up and down (one or several)."),
    ],
    slow: Annotated[
        list[Path] | None,
        typer.Option("--slow", help="Runs with the slow ramp; none: up/down pair."),
    ] = None,
    check: Annotated[
        list[Path] | None, typer.Option("--check", help="Runs to test on, not fitted to.")
    ] = None,
    allowed_deg_h: Annotated[
        float | None,
        typer.Option(
            "--allowed-deg-h", help="Gradient term a slow ramp may have; default: bias instability."
        ),
    ] = None,
    word_bits: Annotated[
        int, typer.Option("--word-bits", min=8, max=32, help="Of the exported fixed-point tables.")
    ] = 16,
    remounted: Annotated[
        bool, typer.Option("--remounted", help="The unit was moved between the runs.")
    ] = False,
    one_sided: Annotated[
        bool, typer.Option("--one-sided", help="Accept ramps of one direction at two rates.")
    ] = False,
    store: StoreUrl = DEFAULT_STORE,
    twin: Annotated[Path | None, typer.Option("--twin", help="Noise model of the unit.")] = None,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Fibre-optic gyro: K_T and K_delta of b = K_T(T) + K_delta(T) dT/dt from temperature ramps of
    the resting unit.

    Example: recal thermal fog --fast chamber-fast --slow chamber-slow --check chamber-other -o fog
    """
    document = fog_ramps(
        fast,
        slow or [],
        check or [],
        allowed_deg_h=allowed_deg_h,
        word_bits=word_bits,
        remounted=remounted,
        one_sided=one_sided,
        store_url=store,
        twin_path=twin,
        output=output,
    )
    answer(document, as_json=as_json, verbose=verbose)
    for line in summary(document):
        say(line, quiet=quiet)
    finish(document)


def fog_ramps(
    fast: list[Path],
    slow: list[Path],
    check: list[Path],
    *,
    allowed_deg_h: float | None,
    word_bits: int,
    remounted: bool,
    one_sided: bool,
    store_url: str,
    twin_path: Path | None,
    output: Path | None,
) -> dict[str, Any]:
    """Writes thermal_fog.json and .html, and where it was fitted thermal_fog.h and .csv; returns
    the document.
    """
    from infield.reports.documents.fog import fit_models, fixed_tables, fog_document, worst_rounding
    from infield.reports.fog_page import render
    from infield.thermal.fog.fixed_point import to_c_header, to_csv
    from infield.thermal.fog.model import held_out
    from infield.thermal.fog.ramps import separate
    from infield.thermal.ramp_runs import ramp_run
    from ins.records import InputError
    from ins.verdicts import plain
    from recal.cli.thermal.inputs import reduced_groups
    from recal.service.output import output_directory, program_version, write_files
    from trajectories.runs.directory import read_run

    if allowed_deg_h is not None and not 0 < allowed_deg_h < float("inf"):
        raise InputError(f"--allowed-deg-h: got {allowed_deg_h:g}, needed more than 0")
    groups, model_of_noise = reduced_groups(
        (fast, slow, check), "fog", ramp_run, store_url, twin_path
    )
    study = separate(groups[0], groups[1], model_of_noise, remounted=remounted, one_sided=one_sided)
    pairs, model = fit_models(study)
    checks = (
        []
        if not study.axes
        else [held_out(read_run(p), run, model, model_of_noise) for p, run in zip(check, groups[2])]
    )
    found = fog_document(
        study,
        pairs,
        model,
        checks=checks,
        allowed_deg_h=allowed_deg_h or model_of_noise.gyro.bias_instability_deg_h or 0.001,
        word_bits=word_bits,
        version=program_version(),
    )
    document = plain(found)
    directory = output_directory(output, "thermal")
    texts = {
        directory / "thermal_fog.json": result_text(document),
        directory / "thermal_fog.html": render(found),
    }
    if study.axes:
        tables = fixed_tables(model, word_bits)
        worst = worst_rounding(model, tables, max(run.rate for run in study.fast))
        texts[directory / "thermal_fog.h"] = to_c_header(
            tables, worst, serial=document["imu_serial"]
        )
        texts[directory / "thermal_fog.csv"] = to_csv(tables)
    write_files(texts)
    return document


def summary(document: dict[str, Any]) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document['imu_serial']}: {document['verdict']}"]
    lines += [f"  because {reason}" for reason in document["reasons"]]
    lines += [f"  {note}" for note in document["notes"]]
    for axis, a in document["axes"].items():
        K, s = a["K_delta_deg_h_per_degC_min"], a["sigma_K_delta_deg_h_per_degC_min"]
        middle = len(K) // 2
        lines.append(
            f"  gyro {axis}: K_delta {K[0]:+.4f} .. {K[middle]:+.4f} .. {K[-1]:+.4f} +-"
            f" {s[middle]:.4f} deg/h per degC/min over {a['temperature_degC'][0]:g} .."
            f" {a['temperature_degC'][-1]:g} degC; K_T spans"
            f" {max(a['K_T_deg_h']) - min(a['K_T_deg_h']):.4f} deg/h; slow ramps up to"
            f" {a['slow_rate']['largest_degC_min']:.4f} degC/min"
        )
        if a["document"] is not None and a["document"]["gain"] is not None:
            lines.append(
                f"    the document's subtraction reads K_delta times {a['document']['gain']:.3f}"
            )
    for found in document["check"]:
        for axis, row in found["axes"].items():
            lines.append(
                f"  {found['run_id']} gyro {axis}: {row['before_deg_h']:.4f} ->"
                f" {row['after_deg_h']:.4f} deg/h RMS (noise {row['noise_deg_h']:.4f}),"
                f" {row['causal_after_deg_h']:.4f} in real-time order"
            )
    return lines
