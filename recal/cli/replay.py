"""`recal replay`: navigate a log with the stored table and with the one before it."""

import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recal.cli.console import (
    DEFAULT_STORE,
    Force,
    JsonFlag,
    NoSeed,
    OutputPath,
    Quiet,
    StoreUrl,
    ThermalModelPath,
    TwinPath,
    Verbose,
    answer,
    finish,
)
from recal.cli.terminal.help import OUTPUT

if TYPE_CHECKING:
    from recal.service.replay import Aided

REPLAY_STEPS = 5  # reading, two tables, satellite fixes, the report


class Vehicle(StrEnum):
    """What carries the unit."""

    CAR = "car"
    FIND = "find"
    OTHER = "other"


def command(
    run: Annotated[Path, typer.Argument(help="A run directory.")],
    store: StoreUrl = DEFAULT_STORE,
    twin: TwinPath = None,
    thermal_model: ThermalModelPath = None,
    aided: Annotated[
        bool,
        typer.Option(
            "--aided/--no-aided",
            help="Also navigate with the satellite fixes of the run, where it has any.",
        ),
    ] = True,
    outage: Annotated[
        list[str] | None,
        typer.Option(
            "--outage",
            metavar="START:LENGTH",
            help="Leave the fixes of a stretch out of the aided solution, and score it with them"
            " [s]. May be repeated. Default: none.",
        ),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth",
            help="Also write the aided solution that all fixes make, those to come included.",
        ),
    ] = False,
    vehicle: Annotated[
        Vehicle,
        typer.Option(
            "--vehicle",
            help="car: also held by its wheels (it goes where it points, at the odometer's speed);"
            " find: where the log shows a car.",
        ),
    ] = Vehicle.OTHER,
    kml: Annotated[
        bool,
        typer.Option("--kml", rich_help_panel=OUTPUT, help="Also write track.kml for a globe."),
    ] = False,
    csv: Annotated[
        bool,
        typer.Option(
            "--csv", rich_help_panel=OUTPUT, help="Also write the navigation files as CSV."
        ),
    ] = False,
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Fly the log again with the stored table and with the one before it: drift in NM/h, old and
    new.

    Example: recal replay run-2 --store sqlite:///recal.db -o replay
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.replay import replay
    from recal.service.results.overwrite import need_free_report

    folder = output or Path("recal-replay")
    navigation = ("navigation.parquet", "navigation_aided.parquet", "navigation_smoothed.parquet")
    others = ("replay.html", *navigation, "track.kml")
    need_free_report(folder, "replay.json", "recal.replay/1", others, force=force)
    with Progress("replaying", quiet=quiet, steps=REPLAY_STEPS) as told:
        flown = replay(
            run,
            twin=twin,
            store=store,
            thermal_model=thermal_model,
            aided=_asked(outage or [], aided=aided, smooth=smooth, vehicle=vehicle),
            told=told,
        )
        told("drawing the report")
        written = flown.write(output, kml=kml, csv=csv)
    answer(
        flown.document,
        flown.lines(),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=written / "replay.html",
    )
    finish(flown.verdict)


def _asked(outages: list[str], *, aided: bool, smooth: bool, vehicle: Vehicle) -> "bool | Aided":
    """What is asked of the aided flight; else whether there is one."""
    from ins.records import InputError
    from recal.service.replay import Aided

    options = {
        "--outage": bool(outages),
        "--smooth": smooth,
        "--vehicle": vehicle is not Vehicle.OTHER,
    }
    given = [name for name, asked in options.items() if asked]
    if not given:
        return aided
    if not aided:
        raise InputError(f"{given[0]}: needed the aided flight, which --no-aided switches off")
    return Aided(outages=[_stretch(words) for words in outages], smooth=smooth, vehicle=vehicle)


def _stretch(words: str) -> tuple[float, float]:
    """Start and length of a stretch written START:LENGTH [s]."""
    from ins.records import InputError

    start, _, length = words.partition(":")
    try:
        found = float(start), float(length)
    except ValueError:
        found = (math.nan, math.nan)
    if not (math.isfinite(found[0]) and 0.0 < found[1] < math.inf):
        raise InputError(f"--outage {words!r}: needed START:LENGTH in seconds, such as 300:60")
    return found
