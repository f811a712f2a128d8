"""`recal plan`: which recordings would separate rival effects, and how large an effect must be to
be seen.
"""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recal.cli.console import JsonFlag, OutputPath, Quiet, Seed, Verbose, answer, result_text, say

if TYPE_CHECKING:
    from infield.table.thermal_table import ThermalTable
    from ins.records import Run, TwinModel
    from simreal.evidence.run_view import RunView
    from simreal.report.plan_records import PlanRecord

DEFAULT_LAT_DEG = 45.0


class Without(StrEnum):
    """What a recording cannot have."""

    gnss = "gnss"
    odometer = "odometer"
    taxi = "taxi"
    gradient = "gradient"


class Technology(StrEnum):
    rlg = "rlg"
    fog = "fog"
    mems = "mems"


def command(
    runs: Annotated[
        list[Path] | None, typer.Argument(help="Run directories at hand; none: plan from nothing.")
    ] = None,
    twin: Annotated[
        Path | None, typer.Option("--twin", help="Twin file: noise model of the unit.")
    ] = None,
    technology: Annotated[
        Technology, typer.Option(help="Defaults of this technology, without --twin or runs.")
    ] = Technology.rlg,
    separate: Annotated[
        list[str] | None,
        typer.Option("--separate", help="Two effects A,B (repeatable); A@gyro_y sets the channel."),
    ] = None,
    without: Annotated[
        list[Without] | None, typer.Option("--without", help="What there is not (repeatable).")
    ] = None,
    lat_deg: Annotated[
        float | None,
        typer.Option(min=-85, max=85, help="Latitude; default that of the runs, or 45."),
    ] = None,
    most: Annotated[int, typer.Option(min=1, max=12, help="At most so many new recordings.")] = 6,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: Seed = None,
) -> None:
    """Which recordings would separate rival effects, and from which size each effect is seen and
    told from its rival.

    Example: recal plan --twin twin.json --separate gyro_thermal_linear,gyro_warmup_transient
    """
    found = plan(
        runs or [],
        twin_path=twin,
        technology=technology,
        separate=separate or [],
        without=[w.value for w in without or []],
        lat_deg=lat_deg,
        most=most,
        output=output,
        seed=seed or 0,
        quiet=quiet,
    )
    from ins.verdicts import plain
    from simreal.report.plan_document import summary

    answer(plain(found), as_json=as_json, verbose=verbose)
    for line in summary(found):
        say(line, quiet=quiet)


def plan(
    run_paths: list[Path],
    *,
    twin_path: Path | None = None,
    technology: str = "rlg",
    separate: list[str] | None = None,
    without: list[str] | None = None,
    lat_deg: float | None = None,
    most: int = 6,
    output: Path | None = None,
    seed: int = 0,
    quiet: bool = True,
) -> "PlanRecord":
    """Writes plan.json and plan.html; returns the document."""
    from ins.records import Site
    from ins.units import DEG
    from ins.verdicts import plain
    from recal.service.output import output_directory, program_version, write_files
    from simreal.plan.pairs import CLASSICAL, read_pair
    from simreal.plan.study import PlanSettings, study
    from simreal.report.plan_document import plan_document
    from simreal.report.plan_page import plan_html
    from trajectories.runs.directory import read_run

    pairs = [read_pair(text) for text in separate or CLASSICAL]
    runs = [read_run(path) for path in run_paths]
    twin, table, sha256 = _unit(twin_path, runs, technology)
    if lat_deg is None:
        lat_deg = runs[0].header.site.lat_rad / DEG if runs else DEFAULT_LAT_DEG
    site = Site(
        lat_rad=lat_deg * DEG, lon_rad=0.0, height_m=runs[0].header.site.height_m if runs else 0.0
    )
    with _Progress(quiet) as told:
        found = study(
            pairs,
            twin,
            table,
            site,
            PlanSettings(seed=seed, without=tuple(without or ()), most=most),
            given=_views(runs, twin, table, sha256),
            progress=told,
        )
    document = plan_document(
        found, lat_deg=lat_deg, without=without or (), version=program_version()
    )
    directory = output_directory(output, "plan")
    write_files(
        {
            directory / "plan.json": result_text(plain(document)),
            directory / "plan.html": plan_html(document),
        }
    )
    return document


def _unit(
    twin_path: Path | None, runs: list["Run"], technology: str
) -> tuple["TwinModel", "ThermalTable | None", str]:
    """The twin with its table (read beside the twin file) and that table's hash."""
    from infield.table.file import read_table_dict, table_from_dict, table_sha256
    from ins.records import InputError
    from ins.twin_file import default_twin, read_twin, table_path

    if twin_path is None:
        return default_twin(runs[0].header.gyro_technology if runs else technology), None, ""
    twin = read_twin(twin_path)
    for run in runs:
        if (twin.imu_serial or run.header.imu_serial) != run.header.imu_serial:
            raise InputError(
                f"twin {twin_path}: imu_serial {twin.imu_serial}, run {run.header.run_id} is of"
                f" {run.header.imu_serial}"
            )
        if twin.gyro_technology != run.header.gyro_technology:
            raise InputError(
                f"twin {twin_path}: gyro_technology {twin.gyro_technology}, run {run.header.run_id}"
                f" is of {run.header.gyro_technology}"
            )
    path = table_path(twin, twin_path.parent)
    if path is None:
        return twin, None, ""
    data = read_table_dict(path)
    return twin, table_from_dict(data, name=str(path)), table_sha256(data)


def _views(
    runs: list["Run"], twin: "TwinModel", table: "ThermalTable | None", sha256: str
) -> list["RunView"]:
    from ins.records import InputError
    from simreal.evidence.run_view import view_run

    views = []
    for k, run in enumerate(runs):
        view = view_run(run, k, table, twin, table_sha256=sha256)
        if isinstance(view, str):
            raise InputError(f"run {run.header.run_id}: {view}")
        views.append(view)
    return views


class _Progress:
    """A line on a terminal that says what is being done; nothing when piped."""

    def __init__(self, quiet: bool) -> None:
        from rich.console import Console

        console = Console(stderr=True)
        self._status = console.status("planning") if console.is_terminal and not quiet else None

    def __enter__(self) -> "_Progress":
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()

    def __call__(self, what: str) -> None:
        if self._status is not None:
            self._status.update(what)
