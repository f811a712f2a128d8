"""`recal twin`: the noise model of a unit, fitted to its own logs."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import (
    Command,
    Force,
    JsonFlag,
    NoSeed,
    OutputPath,
    Quiet,
    Verbose,
    answer,
    finish,
)

app = typer.Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Fit the noise model of a unit to its own logs, and check it.",
)


class Source(StrEnum):
    """Whose noise file it is."""

    kalibr = "kalibr"
    imu_utils = "imu_utils"
    datasheet = "datasheet"


class Target(StrEnum):
    """Whose form a twin is written in."""

    kalibr = "kalibr"
    pyins = "pyins"


class OfTechnology(StrEnum):
    """What gyros a unit has."""

    rlg = "rlg"
    fog = "fog"
    mems = "mems"


@app.callback()
def twin() -> None:
    """Fit the noise model of a unit to its own logs, and check it."""


@app.command("fit", cls=Command)
def fit(
    runs: Annotated[list[Path], typer.Argument(help="Run directories of one unit, parked.")],
    start: Annotated[
        Path | None,
        typer.Option(
            "--start",
            help="Twin to begin with. Its numbers are kept where the runs tell nothing. Default:"
            " that of the technology.",
        ),
    ] = None,
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Fit the noise of a unit to its parked time, each number with its sigma; what the runs cannot
    tell is named, with the recording that would.

    Example: recal twin fit run-1 run-2 run-3 --start twin.json -o fitted/twin.json
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.results.overwrite import need_free_report
    from recal.service.twin.fit import TWIN_FIT_STEPS, fit_twin, twin_path

    twin = twin_path(output)
    others = (twin.name, f"{twin.stem}.html")
    need_free_report(twin.parent, f"{twin.stem}_fit.json", "recal.twin_fit/1", others, force=force)
    with Progress("fitting", quiet=quiet, steps=len(runs) + TWIN_FIT_STEPS) as told:
        fitted = fit_twin(runs, start, told=told)
        written = fitted.write(output)
    answer(
        fitted.document,
        fitted.lines(verbose=verbose),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=written.with_suffix(".html") if fitted.page else None,
    )
    finish(fitted.verdict)


@app.command("check", cls=Command)
def check(
    runs: Annotated[list[Path], typer.Argument(help="Run directories of one unit.")],
    twin: Annotated[Path, typer.Option("--twin", help="Twin file whose noise is judged.")],
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Say channel by channel and band by band whether the noise of a twin fits these runs. Exit
    code 0 where it fits, 5 where not, 4 where the runs hold too little rest.

    Example: recal twin check run-4 --twin twin.json
    """
    from recal.service.results.files import output_directory, write_text
    from recal.service.results.overwrite import need_free_report
    from recal.service.twin.check import check_twin

    if output is not None:
        need_free_report(output, "twin_check.json", "recal.twin_check/1", force=force)
    checked = check_twin(runs, twin)
    if output is not None:
        write_text(output_directory(output, "twin") / "twin_check.json", checked.to_json())
    answer(
        checked.document,
        checked.lines(verbose=verbose),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
    )
    finish(checked.verdict)


@app.command("import", cls=Command)
def import_(
    source: Annotated[Path, typer.Argument(help="Noise file: key: number, one a line.")],
    form: Annotated[Source, typer.Option("--from", help="Whose file it is.")],
    technology: Annotated[
        OfTechnology, typer.Option(help="Its defaults fill what the file lacks.")
    ] = OfTechnology.mems,
    serial: Annotated[str, typer.Option("--serial", help="imu_serial of the unit.")] = "",
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Make a twin from a noise model of Kalibr, imu_utils or a data sheet.

    Example: recal twin import imu.yaml --from kalibr --serial SN-7 -o twin.json
    """
    from recal.service.results.overwrite import need_free_file
    from recal.service.twin.exchange import import_twin, twin_document
    from recal.service.twin.fit import twin_path, write_twin

    written_to = twin_path(output)
    need_free_file(written_to, "recal.twin/1", force=force)
    # a fitted twin is more than an import can bring back
    need_free_file(written_to.with_name(f"{written_to.stem}_fit.json"), None, force=force)
    twin = import_twin(source, form.value, technology=technology.value, serial=serial)
    written = write_twin(twin, output)
    answer(
        twin_document(twin),
        [f"{written}: {technology.value} twin with the noise of {source}"],
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
    )


@app.command("export", cls=Command)
def export(
    twin: Annotated[Path, typer.Argument(help="Twin file.")],
    form: Annotated[Target, typer.Option("--to", help="In whose form.")],
    rate_hz: Annotated[
        float,
        typer.Option("--rate-hz", min=10, max=2000, help="update_rate that Kalibr is told [Hz]."),
    ] = 100.0,
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Write a twin as Kalibr's imu.yaml, or as the arguments of pyins (JSON); on standard output
    without -o.

    Example: recal twin export twin.json --to kalibr -o imu.yaml
    """
    from recal.service.results.files import write_text
    from recal.service.results.overwrite import need_free_file
    from recal.service.twin.exchange import export_twin

    if output is not None:
        need_free_file(output, None, force=force)
    text = export_twin(twin, form.value, rate_hz=rate_hz)
    lines = text.splitlines() if output is None else [f"{output}: {form.value} of {twin}"]
    if output is not None:
        write_text(output, text)
    answer({"form": form.value, "text": text}, lines, as_json=as_json, quiet=quiet, verbose=verbose)
