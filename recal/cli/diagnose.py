"""`recal diagnose`: where simulator and logs disagree, which effect causes it, how far the gap
shrinks with it.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.cli.console import (
    JsonFlag,
    OutputPath,
    Quiet,
    Seed,
    Verbose,
    answer,
    finish,
    result_text,
    say,
)

if TYPE_CHECKING:
    from infield.table.thermal_table import ThermalTable
    from ins.records import Run, TwinModel
    from simreal.inference.diagnosis import Diagnosis
    from simreal.report.diagnosis_document import Asked
    from simreal.report.diagnosis_records import DiagnosisRecord


def command(
    runs: Annotated[list[Path], typer.Argument(help="Run directories of one unit.")],
    twin: Annotated[
        Path,
        typer.Option(
            "--twin", help="Twin file: what the simulator believes; its table lies beside it."
        ),
    ],
    hold_out: Annotated[
        list[str] | None,
        typer.Option(
            "--hold-out", help="Run (id or directory) that only judges the shrink (repeatable)."
        ),
    ] = None,
    alpha: Annotated[
        float, typer.Option(min=1e-4, max=0.5, help="False alarms per diagnosis.")
    ] = 0.01,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: Seed = None,
) -> None:
    """The gap between simulator and logs: where it lies, which effect causes it, how far it shrinks
    with the effect.

    Example: recal diagnose run-1 run-2 run-3 --twin twin.json -o diagnosis
    """
    from ins.verdicts import plain
    from recal.cli.progress import Progress
    from simreal.report.diagnosis_document import summary

    with Progress("diagnosing", quiet=quiet) as told:
        found = diagnose(
            runs,
            twin_path=twin,
            hold_out=hold_out or [],
            alpha=alpha,
            output=output,
            seed=seed or 0,
            told=told,
        )
    document = plain(found)
    answer(document, as_json=as_json, verbose=verbose)
    for line in summary(found):
        say(line, quiet=quiet)
    finish(document)


def diagnose(
    run_paths: list[Path],
    *,
    twin_path: Path,
    hold_out: Sequence[str] = (),
    alpha: float = 0.01,
    output: Path | None = None,
    seed: int = 0,
    told: Callable[[str], None] = lambda _: None,
) -> "DiagnosisRecord":
    """Writes diagnosis.json, diagnosis.html and twin.json (with its table); returns the
    document.
    """
    from ins.records import InputError
    from ins.twin_file import read_twin
    from ins.verdicts import plain
    from recal.service.output import output_directory, program_version, write_files
    from simreal.evidence.overlap import overlapping
    from simreal.inference import diagnosis as core
    from simreal.report.diagnosis_document import Asked, refused_document
    from simreal.report.diagnosis_page import diagnosis_html
    from trajectories.runs.directory import read_run
    from trajectories.runs.stream_files import HELD_ROWS

    twin = read_twin(twin_path)
    table_dict, table, sha256 = _table(twin_path, twin)
    told("reading the runs")
    rows = HELD_ROWS // len(run_paths)
    read = [overlapping(read_run(path, held_rows=rows, dead_columns=True)) for path in run_paths]
    loaded, left_out = [run for run, _ in read], [note for _, notes in read for note in notes]
    _distinct(run_paths, loaded)
    held = [_run_id(name, run_paths, loaded) for name in hold_out]
    directory = output_directory(output, "diagnose")
    told("comparing with the twin")
    try:
        settings = core.DiagnosisSettings(alpha=alpha, seed=seed, hold_out=held)
        found = core.diagnose(loaded, twin, table, settings, table_sha256=sha256)
    except InputError:
        reasons = _unfit(loaded, twin, table, sha256)
        if reasons is None:
            raise
        document = refused_document(
            reasons, loaded, twin, version=program_version(), alpha=alpha, seed=seed
        )
        write_files(
            {
                directory / "diagnosis.json": result_text(plain(document)),
                directory / "diagnosis.html": diagnosis_html(document),
            }
        )
        return document
    told("writing the report")
    asked = Asked(
        version=program_version(),
        seed=seed,
        table_sha256=sha256,
        hold_out=tuple(held),
        notes=tuple(left_out),
    )
    document, texts = _results(found, loaded, table, table_dict, asked)
    write_files({directory / name: text for name, text in texts.items()})
    return document


def _results(
    found: "Diagnosis",
    runs: list["Run"],
    table: "ThermalTable | None",
    table_dict: dict[str, Any] | None,
    asked: "Asked",
) -> tuple["DiagnosisRecord", dict[str, str]]:
    """The document, and all files by name."""
    from infield.table.file import json_text
    from ins.verdicts import plain
    from simreal.inference.user_level import user_level
    from simreal.plan.record_next import record_next
    from simreal.report.diagnosis_curves import fitted_trace, known_trace, overlays
    from simreal.report.diagnosis_document import diagnosis_document
    from simreal.report.diagnosis_page import diagnosis_html
    from simreal.twin.write_back import TABLE_NAME, twin_with_causes

    users = [
        user_level(v, fitted_trace(found, k), table, found.twin, known=known_trace(found, k))
        for k, v in enumerate(found.views)
    ]
    document = diagnosis_document(
        found,
        runs,
        asked,
        users=[u for u in users if u is not None],
        record_next=record_next(found, table),
    )
    twin = twin_with_causes(
        found.twin, found.causes, [v.name for v in found.views], with_table=table_dict is not None
    )
    texts = {
        "diagnosis.json": result_text(plain(document)),
        "diagnosis.html": diagnosis_html(document, overlays(found)),
        "twin.json": result_text(twin),
    }
    if table_dict is not None:
        texts[TABLE_NAME] = json_text(table_dict) + "\n"
    return document, texts


def _table(
    twin_path: Path, twin: "TwinModel"
) -> tuple[dict[str, Any] | None, "ThermalTable | None", str]:
    """The twin's table as written, as record, and its hash; its path is relative to the twin file's
    folder.
    """
    from infield.table.file import read_table_dict, table_from_dict, table_sha256
    from ins.records import InputError
    from ins.twin_file import table_path

    path = table_path(twin, twin_path.parent)
    if path is None:
        return None, None, ""
    data = read_table_dict(path)
    table = table_from_dict(data, name=str(path))
    if twin.imu_serial and table.imu_serial != twin.imu_serial:
        raise InputError(
            f"{path}: imu_serial {table.imu_serial}, the twin {twin_path} is of {twin.imu_serial}"
        )
    return data, table, table_sha256(data)


def _distinct(paths: list[Path], runs: list["Run"]) -> None:
    """InputError where two runs go by one id: events and held-out runs are told by it."""
    from ins.records import InputError

    seen: dict[str, Path] = {}
    for path, run in zip(paths, runs):
        if run.header.run_id in seen:
            raise InputError(
                f"{path}: run_id {run.header.run_id} is that of {seen[run.header.run_id]} too,"
                " needed one each"
            )
        seen[run.header.run_id] = path


def _run_id(name: str, paths: list[Path], runs: list["Run"]) -> str:
    """The id of a run to hold out, given by id or directory."""
    from ins.records import InputError

    for path, run in zip(paths, runs):
        if name == run.header.run_id or Path(name).resolve() == path.resolve():
            return str(run.header.run_id)
    raise InputError(
        f"--hold-out {name}: not among the runs {', '.join(r.header.run_id for r in runs)}"
    )


def _unfit(
    runs: list["Run"], twin: "TwinModel", table: "ThermalTable | None", sha256: str
) -> list[tuple[str, str]] | None:
    """Why no run can be looked at, by run id; None where one can, or is of another unit: then the
    input is bad.
    """
    from simreal.evidence.run_view import view_run

    reasons = []
    for k, run in enumerate(runs):
        header = run.header
        if (twin.imu_serial or header.imu_serial, twin.gyro_technology) != (
            header.imu_serial,
            header.gyro_technology,
        ):
            return None
        view = view_run(run, k, table, twin, table_sha256=sha256)
        if not isinstance(view, str):
            return None
        reasons.append((header.run_id, view))
    return reasons
