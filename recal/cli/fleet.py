"""`recal fleet`: many runs of many units in one call."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recal.cli.console import Command, Shown, finish, login_name
from recal.cli.parameters.shared import PROPOSER, SEED_OPTION, folder_option
from recal.cli.parameters.verbs import made_from

if TYPE_CHECKING:
    from recal.fleet.records import FleetReport

NOTES_SHOWN = 3  # kinds of notes on the terminal; all are in fleet.json
# written to without -o
LEARN_FOLDER, FORECAST_FOLDER = "recal-fleet-learn", "recal-fleet-forecast"

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Recalibrate many units at once, and forecast their drift.",
)


@app.callback()
def fleet() -> None:
    """Recalibrate many units at once, and forecast their drift."""


@app.command("update", cls=Command)
@made_from(
    "recal.fleet.records",
    "FleetRequest",
    PROPOSER,
    asks="joint known_only new_unit new_store cluster config pages note",
    cluster="URL",
)
def update(
    shown: Shown,
    source,
    /,
    store,
    commit: Annotated[
        bool,
        typer.Option(
            "--commit/--propose",
            help="Merge into the tables, or keep proposals in the store for review.",
        ),
    ] = False,
    dry_run: bool = False,
    *,
    workers: int | None = None,
    by,
    output,
    **asked,
) -> None:
    """Recalibrate every unit from its runs in time order, units side by side; stopped, the same
    call goes on.

    Example: recal fleet update /data/runs --store sqlite:///recal.db --workers 2 --commit

    On a cluster: recal fleet update runs.csv --store postgresql://host/recal --cluster
    tcp://host:8786 --commit

    Parameters
    ----------
    dry_run
        Store nothing, no proposals either.
    workers : int in [1, ]
        Processes on this machine. Default: one a core.
    """
    if dry_run and commit:
        raise typer.BadParameter(
            "--commit stores tables, --dry-run stores nothing: give one of them"
        )
    if asked["known_only"] and asked["new_unit"]:
        raise typer.BadParameter(
            "--known-only refuses new units, --new-unit takes them: give one of them"
        )
    if asked["cluster"] and workers is not None:
        raise typer.BadParameter(
            "--workers are processes here, --cluster has workers of its own: give one of them"
        )
    from recal.fleet.update import FleetRequest, Watcher, update_fleet
    from recal.service.inputs.config import read_config

    read_config(asked["config"])
    request = FleetRequest(
        source=source,
        store_url=store,
        output=output or Path("recal-fleet"),
        mode="commit" if commit else "dry" if dry_run else "propose",
        workers=workers or cores(),
        by=login_name() if by is None else by,
        **asked,
    )
    with shown.progress("reading run.json", 0, compiles=False) as bar:
        watcher = Watcher(begins=bar.count, told=lambda run: bar(run.imu_serial or "runs"))
        try:
            document = update_fleet(request, watcher)
        except KeyboardInterrupt:
            done = max(bar.begun - 1, 0)
            shown.say(f"stopped after {done} of {bar.steps} runs; the same command goes on")
            raise
    lines = summary(document, verbose=shown.verbose)
    shown.answer(document, lines, request.output / "fleet.html")
    finish(document.verdict)


@app.command(cls=Command)
@made_from("recal.service.priors.learn", "LearnRequest", folder_option(LEARN_FOLDER), SEED_OPTION)
def learn(
    shown: Shown,
    /,
    store,
    *,
    technology,
    serial,
    dry_run: bool = False,
    by: str | None = None,
    note: str = "",
    output,
    force,
    seed=0,
) -> None:
    """Learn turn-on, flicker, ageing and outliers of a fleet's units from the sessions that its
    store keeps.

    Example: recal fleet learn --store sqlite:///recal.db

    They are kept for approval (recal fleet approve); recal update goes by approved ones.

    Parameters
    ----------
    dry_run
        Store nothing, only write the report.
    by
        Who learns. Default: the operator of your config.toml, else your login name.
    note
        A note kept with the priors.
    """
    from recal.service.priors.learn import LEARN_STEPS, LearnRequest, learn_priors

    folder = shown.folder(
        output, "recal.priors/1", "priors.html", default=LEARN_FOLDER, force=force
    )
    keep = None if dry_run else (login_name() if by is None else by, note)
    request = LearnRequest(
        store_url=store, technology=technology, serial=serial, keep=keep, output=output, seed=seed
    )
    with shown.progress("learning", LEARN_STEPS, compiles=False) as told:
        result = learn_priors(request, told)
    shown.end(result, folder / "priors.html")


@app.command(cls=Command)
@made_from("recal.service.priors.forecast", "ForecastRequest", folder_option(FORECAST_FOLDER))
def forecast(
    shown: Shown,
    /,
    store,
    *,
    limit: Annotated[float, typer.Option(min=0.01, help="The limit of the drift in NM/h.")] = 0.8,
    technology,
    priors,
    output,
    force,
) -> None:
    """Say when the free-inertial drift of each unit will pass a limit, the most urgent first, and
    which session would put that off.

    Example: recal fleet forecast --store sqlite:///recal.db --limit 0.8
    """
    from recal.service.priors.forecast import ForecastRequest, forecast_steps
    from recal.service.priors.forecast import forecast as forecast_units

    page = "forecast.html"
    folder = shown.folder(output, "recal.forecast/1", page, default=FORECAST_FOLDER, force=force)
    request = ForecastRequest(
        store_url=store, limit_nm_h=limit, technology=technology, priors=priors, output=output
    )
    with shown.progress("forecasting", forecast_steps(request), compiles=False) as told:
        result = forecast_units(request, told)
    shown.end(result, folder / "forecast.html")


@app.command("priors", cls=Command)
@made_from()
def priors_list(shown: Shown, /, store) -> None:
    """List the learnt priors of a store, their state and who decided, oldest first.

    Example: recal fleet priors --store sqlite:///recal.db
    """
    from recal.service.priors.records import listed_priors

    listed = listed_priors(store)
    shown.answer(listed.document, listed.lines())


@app.command(cls=Command)
@made_from("recal.service.priors.records", "decide")
def approve(shown: Shown, number, /, by, reason, *, technology="rlg", store) -> None:
    """Put learnt priors to use; older ones may be approved again.

    Example: recal fleet approve 1 --by "K. Reviewer" --reason "240 sessions, innovation 1.00"
    """
    _decide(shown, store, (technology, number, "approved"), (by, reason))


@app.command(cls=Command)
@made_from("recal.service.priors.records", "decide")
def reject(shown: Shown, number, /, by, reason, *, technology="rlg", store) -> None:
    """Reject learnt priors, for good.

    Example: recal fleet reject 2 --by "K. Reviewer" --reason "one aircraft was in the hangar"
    """
    _decide(shown, store, (technology, number, "rejected"), (by, reason))


def _decide(shown: Shown, store: str, about: tuple[str, int, str], signed: tuple[str, str]) -> None:
    from recal.service.priors.records import decide

    decided = decide(store, *about, by=signed[0], reason=signed[1])
    shown.answer(decided.document, decided.lines())


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def summary(document: "FleetReport", *, verbose: bool = False) -> list[str]:
    """The result in a few lines for people."""
    # a refused run may be of a unit that has no result, a broken one of none
    units = len({run.imu_serial for run in document.runs if run.imu_serial})
    lines = [f"{document.verdict}: {counted(sum(document.counts.values()), 'run')}"]
    lines[0] += f" of {counted(units, 'unit')}" if units else ""
    lines += [f"  {reason}" for reason in document.reasons]
    ranked = [(u.imu_serial, u.drift) for u in document.units if u.drift]
    for serial, drift in ranked[: None if verbose else 5]:
        lines.append(f"  {serial}: drift {drift.nm_h:.2f} +- {drift.sigma_nm_h:.2f} NM/h removed")
    stepped = [u.imu_serial for u in document.units if u.step_words]
    lines += [f"  disagree with their table: {', '.join(stepped[:10])}"] if stepped else []
    lines += [f"  {noted.count} noted: {noted.note}" for noted in document.noted[:NOTES_SHOWN]]
    groups = document.left_out
    for group in groups[: None if verbose else 8]:
        lines.append(f"  {group.count} {group.outcome}: {group.example.reason[:200]}")
    lines += (
        [f"  and {len(groups) - 8} more reasons in fleet.json"]
        if len(groups) > 8 and not verbose
        else []
    )
    return lines


def counted(number: int, noun: str) -> str:
    """`1 run`, `3 runs`."""
    return f"{number} {noun}{'s' * (number != 1)}"
