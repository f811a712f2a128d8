"""`recal update`: recalibrate a unit's thermal table from its runs."""

from pathlib import Path
from typing import Annotated, Any

import typer

from recal.console import (
    DEFAULT_STORE,
    DONE,
    INCONSISTENT,
    REFUSED,
    JsonFlag,
    NoSeed,
    OutputPath,
    Quiet,
    StoreUrl,
    Verbose,
    emit_json,
    result_text,
    say,
)

EXIT = {"committed": DONE, "proposed": DONE, "refused": REFUSED, "inconsistent": INCONSISTENT}


def command(
    runs: Annotated[list[Path], typer.Argument(help="Run directories of one unit.")],
    store: StoreUrl = DEFAULT_STORE,
    commit: Annotated[bool, typer.Option("--commit", help="Store the new table; without it, only propose.")] = False,
    twin: Annotated[Path | None, typer.Option("--twin", help="Noise model of the unit.")] = None,
    config: Annotated[Path | None, typer.Option("--config", help="Settings (TOML), sections session and ageing.")] = None,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Recalibrate: tilt rates -> bias points -> heading -> merged table, with a report.

    Example: recal update run-1 run-2 --store sqlite:///recal.db --commit
    """
    document = update(runs, store_url=store, commit=commit, twin=twin, config=config, output=output, quiet=quiet)
    if as_json:
        emit_json(document)
    for line in summary(document, verbose=verbose):
        say(line, quiet=quiet)
    raise typer.Exit(EXIT[document["verdict"]])


def update(
    runs: list[Path], *, store_url: str, commit: bool, twin: Path | None = None, config: Path | None = None,
    output: Path | None = None, quiet: bool = True,
) -> dict[str, Any]:  # fmt: skip
    """Read, estimate, judge, merge, report, commit; returns the update document."""
    from infield.document import update_document
    from infield.pipeline import update_calibration
    from infield.report import update_html
    from infield.table_file import table_sha256
    from recal.config import read_config
    from recal.output import output_directory, program_version, write_text
    from recal.unit_inputs import open_store, unit_inputs
    from trajectories.run import read_run

    settings, ageing = read_config(config)
    loaded = [read_run(path) for path in runs]
    database = open_store(store_url)
    unit = unit_inputs(loaded[0], database, twin)
    serial = unit.table.imu_serial
    result = update_calibration(
        loaded, unit.table, unit.twin, parent_sha256=table_sha256(unit.table_dict), settings=settings, ageing=ageing,
        already_merged=(lambda sha256: database.has_run(sha256, serial)) if database else lambda sha256: False,
        applied_table=(lambda sha256: database.by_sha256(sha256).table) if database else None,
    )  # fmt: skip
    name = database.name if database else None
    facts: dict[str, Any] = {"store": name, "version": program_version(), "table_before": unit.table_dict}
    document = update_document(result, committed=False, **facts)
    if commit and result.outcome == "accepted":
        document = _commit(result, unit, store_url, facts)
    directory = output_directory(output, "update")
    write_text(directory / "update.json", result_text(document))
    write_text(directory / "update.html", update_html(document))
    return document


def _commit(result: Any, unit: Any, store_url: str, facts: dict[str, Any]) -> dict[str, Any]:
    """Commit in one transaction; where another writer or an earlier merge stands in the way: refused, with the reason."""
    from infield.document import update_document
    from infield.store import MergedRun, RunAlreadyMerged, StoreConflict
    from recal.unit_inputs import open_store

    database = open_store(store_url, create=True)
    assert database is not None
    facts = {**facts, "store": database.name}
    document = update_document(result, committed=True, **facts)
    merged = [MergedRun(run_id=run.header.run_id, sha256=run.sha256) for run in result.merged_runs]
    try:
        revision = database.commit_update(
            document["table_before_sha256"], result.after, merged, result_text(document),
            first_table=None if unit.known else unit.table_dict,
        )  # fmt: skip
    except (StoreConflict, RunAlreadyMerged) as error:
        return {**update_document(result, committed=False, **facts), "verdict": "refused", "reasons": [str(error)]}
    header = f"recal table rollback --store '{database.name}' --serial {result.after.imu_serial}"
    return {**document, "revision": revision.number, "rollback_command": f"{header} --to {revision.number - 1}"}


def summary(document: dict[str, Any], *, verbose: bool = False) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document['imu_serial']}: {document['verdict']}"]
    lines += [f"  because {reason}" for reason in document["reasons"]]
    for axis, seen in document["observability"].items():
        lines.append(
            f"  gyro {axis}: sigma {seen['sigma_before_deg_h']:.4f} -> {seen['sigma_after_deg_h']:.4f} deg/h, {seen['verdict']}"
            + (f"; {seen['advice']}" if seen["advice"] and verbose else "")
        )
    heading = document["heading_error"]
    if heading["value_mrad"] is not None:
        lines.append(
            f"  heading error of the alignment {heading['value_mrad']:+.2f} +- {heading['sigma_mrad']:.2f} mrad, "
            f"from {heading['source']}"
        )
    effect = document["predicted_effect"]
    if effect:
        change, drift = effect["level_change_deg_h"], effect["drift_removed_nm_h"]
        lines.append(f"  level gyros change by {change:.4f} deg/h, about {drift:.2f} NM/h")
    return lines
