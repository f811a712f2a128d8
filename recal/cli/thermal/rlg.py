"""`recal thermal rlg`: rate and gradient terms of a ring-laser unit from chamber or parked runs."""

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
    runs: Annotated[
        list[Path], typer.Argument(help="Run directories of one unit at rest, warmed and cooled.")
    ],
    check: Annotated[
        list[Path] | None, typer.Option("--check", help="Runs to test on, not fitted to.")
    ] = None,
    remounted: Annotated[
        bool, typer.Option("--remounted", help="The unit was moved between the runs.")
    ] = False,
    store: StoreUrl = DEFAULT_STORE,
    twin: Annotated[Path | None, typer.Option("--twin", help="Noise model of the unit.")] = None,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Ring-laser gyro: K1..K6 of b = K1 + K2 T + K3 T^2 + K4 dT/dt + K5 T dT/dt + K6 Tdiff from
    runs at rest.

    Example: recal thermal rlg chamber-1 chamber-2 --check chamber-3 -o rlg
    """
    document = rlg_gradients(
        runs, check or [], remounted=remounted, store_url=store, twin_path=twin, output=output
    )
    answer(document, as_json=as_json, verbose=verbose)
    for line in summary(document):
        say(line, quiet=quiet)
    finish(document)


def rlg_gradients(
    runs: list[Path],
    check: list[Path],
    *,
    remounted: bool,
    store_url: str,
    twin_path: Path | None,
    output: Path | None,
) -> dict[str, Any]:
    """Writes thermal_rlg.json and .html; returns the document."""
    from infield.reports.documents.rlg import rlg_document
    from infield.reports.rlg_page import render
    from infield.thermal.gradient_runs import gradient_run
    from infield.thermal.rlg.gradients import fit_gradients
    from infield.thermal.rlg.held_out import held_out_run
    from infield.thermal.rlg.model import model_from_document
    from ins.verdicts import plain
    from recal.cli.thermal.inputs import reduced_groups
    from recal.service.output import output_directory, program_version, write_files
    from trajectories.runs.directory import read_run

    groups, twin = reduced_groups((runs, check), "rlg", gradient_run, store_url, twin_path)
    study = fit_gradients(groups[0], twin, remounted=remounted)
    found = rlg_document(study, version=program_version())
    if study.axes and check:
        model = model_from_document(plain(found))
        checks = [held_out_run(read_run(path), model, study.axes, twin) for path in check]
        found = rlg_document(study, checks=checks, version=program_version())
    document = plain(found)
    directory = output_directory(output, "thermal")
    write_files(
        {
            directory / "thermal_rlg.json": result_text(document),
            directory / "thermal_rlg.html": render(found),
        }
    )
    return document


def summary(document: dict[str, Any]) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document['imu_serial']}: {document['verdict']}"]
    lines += [f"  because {reason}" for reason in document["reasons"]]
    lines += [f"  {note}" for note in document["notes"]]
    for axis, a in document["axes"].items():
        used = {
            name: t
            for name, t in a["terms"].items()
            if t["state"] == "used" and name not in ("K1", "K2", "K3")
        }
        said = ", ".join(
            f"{name} {t['value']:+.5f} +- {t['sigma']:.5f}" for name, t in used.items()
        )
        h = a["held_out"]
        lines.append(
            f"  gyro {axis}: {said or 'no rate or gradient term'}; held out {h['before_deg_h']:.4f}"
            f" -> {h['temperature_only_deg_h']:.4f} (temperature) -> {h['model_deg_h']:.4f} deg/h"
            f" RMS, noise {h['noise_deg_h']:.4f}"
        )
    for found in document["check"]:
        for axis, row in found["axes"].items():
            lines.append(
                f"  {found['run_id']} gyro {axis}: {row['before_deg_h']:.4f} ->"
                f" {row['temperature_only_deg_h']:.4f} (temperature) -> {row['after_deg_h']:.4f}"
                f" deg/h RMS (noise {row['noise_deg_h']:.4f}), {row['causal_after_deg_h']:.4f} in"
                " real-time order"
            )
    return lines
