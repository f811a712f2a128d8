"""`recal update`: recalibrate a unit's thermal table from its runs."""

import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from recal.cli.console import (
    DEFAULT_STORE,
    AnyClock,
    JsonFlag,
    NoSeed,
    OutputPath,
    Quiet,
    StoreUrl,
    ThermalModelPath,
    Verbose,
    answer,
    finish,
    login_name,
    result_text,
    say,
)

# a document's files: update.json, and update.html where wanted
Files = Callable[[dict[str, Any]], dict[Path, str]]


def command(
    runs: Annotated[list[Path], typer.Argument(help="Run directories of one unit.")],
    store: StoreUrl = DEFAULT_STORE,
    commit: Annotated[
        bool, typer.Option("--commit", help="Store the new table; without it, only propose.")
    ] = False,
    propose: Annotated[
        bool,
        typer.Option(
            "--propose", help="Keep the new table in the store for review; the active one stays."
        ),
    ] = False,
    by: Annotated[
        str | None, typer.Option("--by", help="Who proposes; default: your login name.")
    ] = None,
    note: Annotated[
        str, typer.Option("--note", help="With --propose: kept with the proposal.")
    ] = "",
    accept_step: Annotated[
        bool,
        typer.Option(
            "--accept-step", help="Follow a step of the unit that several sessions agree on."
        ),
    ] = False,
    retry: Annotated[
        int,
        typer.Option(
            "--retry",
            min=0,
            max=99,
            metavar="[N]",
            help="With --commit: where another writer was faster, "
            "estimate again from the table that is active then, at most N times (3).",
        ),
    ] = 0,
    any_clock: AnyClock = False,
    twin: Annotated[Path | None, typer.Option("--twin", help="Noise model of the unit.")] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="Settings (TOML), sections session and ageing.")
    ] = None,
    thermal_model: ThermalModelPath = None,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Recalibrate: tilt rates -> bias points -> heading -> merged table, with a report.

    Example: recal update run-1 run-2 --store sqlite:///recal.db --commit
    For review instead (recal serve, recal table approve): recal update run-1 run-2 --propose
    """
    if commit and propose:
        raise typer.BadParameter(
            "--commit stores the table at once, --propose keeps it for review: give one of them"
        )
    if retry and not commit:
        raise typer.BadParameter("nothing is stored without --commit", param_hint="--retry")
    signed = (login_name() if by is None else by, note) if propose else None
    document = update(
        runs,
        store_url=store,
        commit=commit,
        propose=signed,
        accept_step=accept_step,
        twin=twin,
        config=config,
        thermal_model=thermal_model,
        output=output,
        quiet=quiet,
        retries=retry,
        any_clock=any_clock,
    )
    answer(document, as_json=as_json, verbose=verbose)
    for line in summary(document, verbose=verbose):
        say(line, quiet=quiet)
    finish(document)


def update(
    runs: list[Path],
    *,
    store_url: str,
    commit: bool,
    propose: tuple[str, str] | None = None,
    accept_step: bool = False,
    twin: Path | None = None,
    config: Path | None = None,
    thermal_model: Path | None = None,
    output: Path | None = None,
    quiet: bool = True,
    html: bool = True,
    retries: int = 0,
    any_clock: bool = False,
) -> dict[str, Any]:
    """Read, estimate, judge, merge, report, commit or (propose: who, note) keep for review; returns
    the update document.

    Where another writer commits while this estimates, it is estimated again from the runs and the
    table that is active then, at most `retries` times; then it is refused. Without `html` only
    update.json is written.
    """
    from infield.store.database import require_folder
    from infield.store.table_store import StoreConflict
    from recal.service.config import read_config
    from recal.service.output import output_directory
    from trajectories.runs.directory import read_run
    from trajectories.runs.stream_files import HELD_ROWS

    require_folder(store_url)
    settings, ageing = read_config(config)
    loaded = [read_run(path, held_rows=HELD_ROWS // len(runs)) for path in runs]
    files = partial(_files, output_directory(output, "update"), html=html)
    lost: list[str] = []
    while True:
        try:
            return _update_once(
                loaded,
                settings,
                ageing,
                files,
                store_url=store_url,
                commit=commit,
                propose=propose,
                accept_step=accept_step,
                twin=twin,
                thermal_model=thermal_model,
                lost=lost,
                last=len(lost) >= retries,
                any_clock=any_clock,
            )
        except StoreConflict as conflict:
            lost.append(str(conflict))
            say(
                f"another writer was faster ({conflict}): estimating again, {len(lost)} of"
                f" {retries}",
                quiet=quiet,
            )


def _update_once(
    loaded: list[Any],
    settings: Any,
    ageing: Any,
    files: Files,
    *,
    store_url: str,
    commit: bool,
    propose: tuple[str, str] | None,
    accept_step: bool,
    twin: Path | None,
    thermal_model: Path | None,
    lost: list[str],
    last: bool,
    any_clock: bool,
) -> dict[str, Any]:
    """One estimate against the table that is active now; a commit that another writer beat raises
    unless it is the last.
    """
    from infield.session.pipeline import update_calibration
    from infield.table.file import table_sha256
    from ins.verdicts import Outcome
    from recal.service.output import program_version, write_files
    from recal.service.unit_inputs import open_store, unit_inputs, with_thermal_model

    database = open_store(store_url)
    unit, loaded, use = with_thermal_model(
        unit_inputs(loaded[0], database, twin), loaded, thermal_model
    )
    serial = unit.table.imu_serial
    result = update_calibration(
        loaded,
        unit.table,
        unit.twin,
        parent_sha256=table_sha256(unit.table_dict),
        settings=settings,
        ageing=ageing,
        already_merged=(
            (lambda sha256: database.has_run(sha256, serial)) if database else lambda sha256: False
        ),
        applied_table=(lambda sha256: database.by_sha256(sha256).table) if database else None,
        remembered=database.contradictions(*_key(unit)) if database and unit.revision else (),
        accept_step=accept_step,
    )
    facts: dict[str, Any] = {
        "version": program_version(),
        "table_before": unit.table_dict,
        "thermal_model": use(result.after),
        "lost": lost,
    }
    if commit and result.outcome is Outcome.ACCEPTED:
        return _commit(result, unit, store_url, files, facts, last=last, any_clock=any_clock)
    if propose and result.outcome is Outcome.ACCEPTED:
        return _propose(result, unit, store_url, files, facts, propose)
    document = _document(
        result, committed=False, store=database.name if database else None, **facts
    )
    if (
        (commit or propose)
        and result.outcome is Outcome.INCONSISTENT
        and unit.revision
        and result.evidence
    ):
        document["remembered"] = _remember(result, unit, store_url)
    write_files(files(document))
    return document


def _document(result: Any, *, lost: list[str], **facts: Any) -> dict[str, Any]:
    """The update document, and the conflicts with other writers on the way to it."""
    from infield.reports.documents.update import update_document

    return {**update_document(result, **facts), **({"conflicts": list(lost)} if lost else {})}


def _key(unit: Any) -> tuple[str, str, str]:
    return unit.table.imu_serial, unit.table.gyro_technology, unit.table.gyro_mode


def _remember(result: Any, unit: Any, store_url: str) -> str:
    """Keep what the contradicting sessions said, the table untouched; where the store cannot be
    written, say so.
    """
    from infield.store.table_store import StoreConflict
    from ins.records import InputError
    from recal.service.unit_inputs import open_store

    try:
        database = open_store(store_url, create=True)
        assert database is not None
        count = database.remember_contradictions(*_key(unit), result.evidence)
    except (InputError, StoreConflict) as error:
        return f"not remembered for the next update: {error}"
    return (
        f"{count} contradicting session{'s' if count != 1 else ''} remembered; the table is as"
        " it was"
    )


def _commit(
    result: Any,
    unit: Any,
    store_url: str,
    files: Files,
    facts: dict[str, Any],
    *,
    last: bool,
    any_clock: bool,
) -> dict[str, Any]:
    """Report and table together or neither: the report is staged, the store commits, the report
    takes its place.

    Where another writer (and this try is the `last`) or an earlier merge stands in the way:
    refused, with the reason. Where the store cannot be written the report stays, as a proposal that
    says so, and InputError is raised.
    """
    from infield.reports.words.sentences import sentence
    from infield.session.reasons import SessionReason
    from infield.store.database import store_name
    from infield.store.errors import StoreConflict, StoreRefused
    from infield.store.table_store import MergedRun
    from ins.records import InputError
    from ins.verdicts import because
    from recal.service.output import write_files
    from recal.service.unit_inputs import open_store

    facts, made = {**facts, "store": store_name(store_url)}, []
    try:
        database = open_store(store_url, create=True, any_clock=any_clock)
        assert database is not None
        document = _document(result, committed=True, **facts)
        merged = [
            MergedRun(run_id=run.header.run_id, sha256=run.sha256) for run in result.merged_runs
        ]
        numbered = _numbered(document, unit, (unit.revision or 1) + 1)
        write_files(
            files(numbered),
            commit=lambda: made.append(
                database.commit_update(
                    document["table_before_sha256"],
                    result.after,
                    merged,
                    result_text(document),
                    first_table=None if unit.revision else unit.table_dict,
                )
            ),
        )
        # somebody rolled back to the same table meanwhile
        if made[0].number != numbered["revision"]:
            numbered = _numbered(document, unit, made[0].number)
            write_files(files(numbered))
        return numbered
    except StoreRefused as error:
        if isinstance(error, StoreConflict) and not last:
            raise
        document = {
            **_document(result, committed=False, **facts),
            "verdict": "refused",
            "reasons": [str(error)],
            "reason_codes": [str(error.code)],
        }
        write_files(files(document))
        return document
    except InputError as error:
        if made:
            say(f"committed as revision {made[0].number}, but {error}")
            return _numbered(document, unit, made[0].number)
        not_committed = because(SessionReason.NOT_COMMITTED, fault=str(error))
        document = {
            **_document(result, committed=False, **facts),
            "reasons": [sentence(not_committed)],
            "reason_codes": [str(not_committed.code)],
        }
        write_files(files(document))
        raise


def _propose(
    result: Any,
    unit: Any,
    store_url: str,
    files: Files,
    facts: dict[str, Any],
    signed: tuple[str, str],
) -> dict[str, Any]:
    """Keep the update in the store for review, then write the report with its number; refused where
    a commit would be.
    """
    from infield.store.errors import StoreRefused
    from infield.store.table_store import MergedRun
    from recal.service.output import write_files
    from recal.service.unit_inputs import open_store

    database = open_store(store_url, create=True)
    assert database is not None
    document = _document(result, committed=False, store=database.name, **facts)
    merged = [MergedRun(run_id=run.header.run_id, sha256=run.sha256) for run in result.merged_runs]
    try:
        kept = database.propose(
            document["table_before_sha256"],
            result.after,
            merged,
            result_text(document),
            first_table=None if unit.revision else unit.table_dict,
            by=signed[0],
            note=signed[1],
        )
        document["proposal"] = kept.number
    except StoreRefused as error:
        document |= {
            "verdict": "refused",
            "reasons": [str(error)],
            "reason_codes": [str(error.code)],
        }
    write_files(files(document))
    return document


def _numbered(document: dict[str, Any], unit: Any, revision: int) -> dict[str, Any]:
    """The document as committed under this number, and how to take it back."""
    serial, technology, mode = (shlex.quote(name) for name in _key(unit))
    # a server's password comes from the environment
    store = shlex.quote(document["store"].replace(":***@", "@"))
    back = f"recal table rollback --store {store} --serial {serial} --technology {technology}"
    return {
        **document,
        "revision": revision,
        "rollback_command": f"{back} --mode {mode} --to {revision - 1}",
    }


def _files(directory: Path, document: dict[str, Any], *, html: bool) -> dict[Path, str]:
    from infield.reports.update_page import update_html

    page = {directory / "update.html": update_html(document)} if html else {}
    return {directory / "update.json": result_text(document), **page}


def summary(document: dict[str, Any], *, verbose: bool = False) -> list[str]:
    """The result in a few lines for people."""
    from infield.session.hysteresis import ACTED_ON
    from infield.session.reasons import ThermalAction

    kept = (
        f", kept for review as proposal {document['proposal']}" if document.get("proposal") else ""
    )
    lines = [f"{document['imu_serial']}: {document['verdict']}{kept}"]
    lines += [f"  because {reason}" for reason in document["reasons"]]
    if conflicts := len(document.get("conflicts", ())):
        lines.append(f"  estimated {conflicts + 1} times, as other writers were faster")
    lines += [f"  {document['remembered']}"] if document.get("remembered") else []
    shown = (*ACTED_ON, ThermalAction.SPLIT_OR_WRONG_SESSION)
    lines += [
        f"  {term['text']}" for term in document["hysteresis"] if verbose or term["action"] in shown
    ]
    lines += [f"  {line}" for line in document.get("thermal_model", {}).get("text", [])]
    for axis, seen in document["observability"].items():
        lines.append(
            f"  gyro {axis}: sigma {seen['sigma_before_deg_h']:.4f} ->"
            f" {seen['sigma_after_deg_h']:.4f} deg/h, {seen['verdict']}"
            + (f"; {seen['advice']}" if seen["advice"] and verbose else "")
        )
    heading = document["heading_error"]
    if heading["value_mrad"] is not None:
        lines.append(
            f"  heading error of the alignment {heading['value_mrad']:+.2f} +-"
            f" {heading['sigma_mrad']:.2f} mrad, from {heading['source']}"
        )
    if document.get("zero_rate_effect"):
        from infield.reports.documents.parked import effect_words

        lines.append(f"  {effect_words(document['zero_rate_effect'])}")
    for session in document["sessions"]:
        if session.get("zero_rate"):
            from infield.reports.documents.parked import stretch_words

            lines += [
                f"  {session['run_id']} {line}" for line in stretch_words(session["zero_rate"])
            ]
    effect = document["predicted_effect"]
    if effect:
        change, drift = effect["level_change_deg_h"], effect["drift_removed_nm_h"]
        lines.append(f"  level gyros change by {change:.4f} deg/h, about {drift:.2f} NM/h")
    return lines
