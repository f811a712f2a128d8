"""`recal align`: attitude and heading with sigma from the parked part of a run."""

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
    run: Annotated[Path, typer.Argument(help="Run directory.")],
    store: StoreUrl = DEFAULT_STORE,
    twin: Annotated[Path | None, typer.Option("--twin", help="Noise model of the unit.")] = None,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Level, gyrocompass and find the phases; heading with an honest sigma.

    Example: recal align run-1 --json
    """
    document = align(run, store_url=store, twin=twin, output=output)
    answer(document, as_json=as_json, verbose=verbose)
    for line in _summary(document):
        say(line, quiet=quiet)
    finish(document)


def align(
    run_path: Path, *, store_url: str, twin: Path | None = None, output: Path | None = None
) -> dict[str, Any]:
    """Align one run and write alignment.json; returns its document."""
    from dataclasses import replace

    import numpy as np

    from alignment.gyrocompass import align as align_log
    from alignment.reasons import AlignmentReason, AlignmentVerdict
    from infield.reports.documents.alignment import alignment_document
    from infield.session.log import compensated_imu
    from infield.session.parked.zero_rate import mean_zero_rate
    from infield.session.settings import SessionSettings
    from infield.thermometer.gyro_temperature import gyro_temperature
    from ins.verdicts import because, plain
    from recal.service.output import output_directory, write_text
    from recal.service.unit_inputs import open_store, unit_inputs
    from trajectories.runs.directory import read_run

    run = read_run(run_path)
    unit = unit_inputs(run, open_store(store_url), twin)
    sigma, temperature = None, None
    if unit.known and run.temperature is not None:
        temperature = gyro_temperature(run.temperature)
        T = temperature.temperature_degC[0]
        sigma = np.array([unit.table.sigma_deg_h(k, T[k])[0] for k in range(3)])
        sigma = np.hypot(sigma, unit.twin.gyro.turn_on_deg_h)
    imu = compensated_imu(run, unit.table, temperature, unit.twin)
    result = align_log(imu, run.header.site, unit.twin, bias_sigma_deg_h=sigma, phases=run.phases)
    if not unit.known:
        no_table = because(
            AlignmentReason.NO_TABLE,
            imu_serial=run.header.imu_serial,
            sigma_deg_h=float(np.max(unit.table.sigma_deg_h(0, np.zeros(1)))),
        )
        result = replace(result, reasons=(*result.reasons, no_table))
    document = alignment_document(result, run)
    if result.verdict is AlignmentVerdict.LEVEL_ONLY and run.header.gyro_technology == "mems":
        document["zero_rate"] = plain(mean_zero_rate(run, unit.twin, SessionSettings()))
    write_text(output_directory(output, "align") / "alignment.json", result_text(document))
    return document


def _summary(document: dict[str, Any]) -> list[str]:
    from alignment.reasons import AlignmentVerdict

    lines = [f"{document['run_id']}: {document['verdict']}"]
    word = "note:" if document["verdict"] == AlignmentVerdict.ALIGNED else "because"
    lines += [f"  {word} {reason}" for reason in document["reasons"]]
    for name in ("roll", "pitch", "heading"):
        value, sigma = document[f"{name}_deg"], document[f"sigma_{name}_deg"]
        if value is not None and value == value:
            lines.append(f"  {name:8s}{value:10.4f} +- {sigma:.4f} deg")
    if document.get("zero_rate"):
        seen = document["zero_rate"]
        lines += [
            f"  gyro {axis} zero rate {found['bias_deg_h']:+.1f} +- {found['sigma_deg_h']:.1f}"
            " deg/h, less vertical Earth"
            f" rate{'' if seen['heading_known'] else ', heading unknown'} ({seen['start_s']:.0f} to"
            f" {seen['end_s']:.0f} s)"
            for axis, found in seen["gyro"].items()
        ]
    for phase in document["phases"]:
        lines.append(f"  {phase['phase']:20s}{phase['start_s']:9.1f} to {phase['end_s']:9.1f} s")
    return lines
