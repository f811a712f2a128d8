"""`recal twin`: the noise model of a unit, fitted to its own logs."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Command, Shown
from recal.cli.parameters.verbs import made_from
from recal.cli.terminal.help import METHOD

app = typer.Typer(
    add_completion=False,
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


@app.command("fit", cls=Command)
@made_from("recal.service.twin.fit", "fit_twin")
def fit(shown: Shown, runs, /, start, output, force) -> None:
    """Fit the noise of a unit to its parked time, each number with its sigma; what the runs cannot
    tell is named, with the recording that would.

    Example: recal twin fit run-1 run-2 run-3 --start twin.json -o fitted/twin.json
    """
    from recal.service.results.overwrite import need_free_report
    from recal.service.twin.fit import TWIN_FIT_STEPS, fit_twin, twin_path

    twin = twin_path(output)
    others = (twin.name, f"{twin.stem}.html")
    need_free_report(twin.parent, f"{twin.stem}_fit.json", "recal.twin_fit/1", others, force=force)
    with shown.progress("fitting", len(runs) + TWIN_FIT_STEPS) as told:
        fitted = fit_twin(runs, start, told=told)
        written = fitted.write(output)
    shown.end(fitted, written.with_suffix(".html") if fitted.page else None)


@app.command("check", cls=Command)
@made_from("recal.service.twin.fit", "check_twin")
def check(shown: Shown, runs, /, twin: Path, output, force) -> None:
    """Say channel by channel and band by band whether the noise of a twin fits these runs. Exit
    code 0 where it fits, 5 where not, 4 where the runs hold too little rest.

    Example: recal twin check run-4 --twin twin.json

    Parameters
    ----------
    runs
        Run directories of one unit.
    twin
        Twin file whose noise is judged.
    """
    from recal.service.results.files import output_directory, write_text
    from recal.service.results.overwrite import need_free_report
    from recal.service.twin.fit import check_twin

    if output is not None:
        need_free_report(output, "twin_check.json", "recal.twin_check/1", force=force)
    checked = check_twin(runs, twin)
    if output is not None:
        write_text(output_directory(output, "twin") / "twin_check.json", checked.to_json())
    shown.end(checked)


@app.command("import", cls=Command)
@made_from("recal.service.twin.exchange", "import_twin")
def import_(
    shown: Shown,
    source: Path,
    /,
    form: Annotated[
        Source, typer.Option("--from", rich_help_panel=METHOD, help="Whose file it is.")
    ],
    technology,
    serial,
    output,
    force,
) -> None:
    """Make a twin from a noise model of Kalibr, imu_utils or a data sheet.

    Example: recal twin import imu.yaml --from kalibr --serial SN-7 -o twin.json

    Parameters
    ----------
    source
        Noise file: key: number, one a line.
    """
    from recal.service.results.overwrite import need_free_file
    from recal.service.twin.exchange import import_twin, twin_document
    from recal.service.twin.fit import twin_path, write_twin

    written_to = twin_path(output)
    need_free_file(written_to, "recal.twin/1", force=force)
    # a fitted twin is more than an import can bring back
    need_free_file(written_to.with_name(f"{written_to.stem}_fit.json"), None, force=force)
    twin = import_twin(source, form, technology=technology, serial=serial)
    written = write_twin(twin, output)
    shown.answer(twin_document(twin), [f"{written}: {technology} twin with the noise of {source}"])


@app.command("export", cls=Command)
@made_from("recal.service.twin.exchange", "export_twin")
def export(
    shown: Shown,
    twin: Path,
    /,
    form: Annotated[Target, typer.Option("--to", rich_help_panel=METHOD, help="In whose form.")],
    rate_hz,
    output,
    force,
) -> None:
    """Write a twin as Kalibr's imu.yaml, or as the arguments of pyins (JSON); on standard output
    without -o.

    Example: recal twin export twin.json --to kalibr -o imu.yaml

    Parameters
    ----------
    twin
        Twin file.
    """
    from recal.service.results.files import write_text
    from recal.service.results.overwrite import need_free_file
    from recal.service.twin.exchange import export_twin

    if output is not None:
        need_free_file(output, None, force=force)
    text = export_twin(twin, form, rate_hz=rate_hz)
    lines = text.splitlines() if output is None else [f"{output}: {form} of {twin}"]
    if output is not None:
        write_text(output, text)
    shown.answer({"form": form, "text": text}, lines)
