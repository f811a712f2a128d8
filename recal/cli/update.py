"""`recal update`: recalibrate a unit's thermal table from its runs."""

from pathlib import Path

import typer

from recal.cli.console import DEFAULT_STORE, Shown, login_name
from recal.cli.parameters.verbs import made_from


@made_from("recal.service.update", "UpdateRequest", retry="[N]")
def command(
    shown: Shown,
    runs,
    /,
    store,
    commit,
    propose: bool = False,
    by: str | None = None,
    note: str = "",
    *,
    new_unit,
    new_store,
    accept_step,
    retry,
    any_clock,
    twin,
    config,
    priors,
    thermal_model,
    output,
    force,
) -> None:
    """Measure the gyro biases in runs of a unit, merge them into its stored table, and report.

    Example: recal update run-1 run-2 --store sqlite:///recal.db --commit

    With --propose the new table waits for a second person, who decides in recal serve or by recal
    table approve.

    Parameters
    ----------
    propose
        Keep the new table in the store for review; the active table stays.
    by
        Who proposes. Default: the operator of your config.toml, else your login name.
    note
        A note kept with the proposal.
    retry
        With --commit: where another writer was faster, estimate again from the table that is
        active then, at most N times. Default: 0; 3 where N is left out.
    """
    if commit and propose:
        raise typer.BadParameter(
            "--commit stores the table at once, --propose keeps it for review: give one of them"
        )
    if retry and not commit:
        raise typer.BadParameter("nothing is stored without --commit", param_hint="--retry")
    signed = (login_name() if by is None else by, note) if propose else None
    from recal.service.results.files import output_directory
    from recal.service.results.overwrite import need_free_report
    from recal.service.update import UPDATE_STEPS, UpdateRequest, update_in_store

    folder = output or Path("recal-update")
    need_free_report(folder, "update.json", "recal.update/1", ("update.html",), force=force)
    with shown.progress("reading", UPDATE_STEPS) as step:
        request = UpdateRequest(
            runs=runs,
            store_url=store,
            store_named=store != DEFAULT_STORE,
            commit=commit,
            propose=signed,
            new_unit=new_unit,
            new_store=new_store,
            accept_step=accept_step,
            twin=twin,
            config=config,
            priors=priors,
            thermal_model=thermal_model,
            output=output,
            retry=retry,
            any_clock=any_clock,
            keep_earlier=not force,
            told=shown.say,
            step=step,
        )
        result = update_in_store(request)
    shown.end(result, output_directory(output, "update") / "update.html")
