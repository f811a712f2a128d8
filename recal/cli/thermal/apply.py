"""`recal thermal apply`: a fitted thermal model taken out of a run's gyro output."""

from pathlib import Path
from typing import Annotated, Any

import typer

from recal.cli.console import JsonFlag, NoSeed, Quiet, Verbose, answer, say


def command(
    model: Annotated[
        Path, typer.Argument(help="A thermal_rlg.json or thermal_fog.json that was fitted.")
    ],
    run: Annotated[Path, typer.Argument(help="Run directory, raw gyro output.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The compensated run to write.")],
    part: Annotated[
        str,
        typer.Option(
            "--part", help="all, or rates: leave in what a settled unit has, for a thermal table."
        ),
    ] = "all",
    batch: Annotated[
        bool, typer.Option("--batch", help="Smoothed temperatures instead of real-time order.")
    ] = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Take a fitted model out of a run's gyro output, each row from temperatures up to its own
    time.

    Example: recal thermal apply rlg/thermal_rlg.json run-1 -o run-1-compensated
    """
    result = apply_model(model, run, output, part=part, batch=batch)
    answer(result, as_json=as_json, verbose=verbose)
    say(
        f"{output}: {result['run_id']}, {result['share_inside']:.0%} of it inside the fitted"
        " temperatures",
        quiet=quiet,
    )


def apply_model(
    model_path: Path, run_path: Path, output: Path, *, part: str, batch: bool
) -> dict[str, Any]:
    """Writes the compensated run; returns `recal.thermal_apply/1`."""
    from dataclasses import replace

    from infield.thermal.stored_model import check_usable, read_thermal_model, removed_from
    from ins.records import InputError
    from trajectories.runs.directory import read_run, write_run

    if part not in ("all", "rates"):
        raise InputError(f"--part: got {part!r}, needed all or rates")
    stored = read_thermal_model(model_path)
    run = read_run(run_path)
    check_usable(run, stored)
    left = removed_from(run, stored, part=part, batch=batch)
    left = replace(
        left, header=replace(left.header, run_id=f"{run.header.run_id}-compensated"), sha256=""
    )
    write_run(output, left)
    assert run.temperature is not None
    return {
        "schema": "recal.thermal_apply/1",
        "run": str(output),
        "run_id": left.header.run_id,
        "model": str(model_path),
        "model_sha256": stored.sha256,
        "part": part,
        "order": "batch" if batch else "real time",
        "axes": list(stored.model.axes),
        "share_inside": float(stored.model.inside(run.temperature.gyro_degC).all(axis=1).mean()),
    }
