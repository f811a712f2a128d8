"""`recal thermal`: thermal coefficients from chamber runs, and a fitted model taken out of a
run.
"""

import typer

from recal.cli.console import Command
from recal.cli.thermal import apply as thermal_apply
from recal.cli.thermal import fog as thermal_fog
from recal.cli.thermal import rlg as thermal_rlg
from recal.cli.thermal.inputs import ManyRuns

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Fit thermal coefficients to chamber runs.",
)
app.command("rlg", cls=ManyRuns)(thermal_rlg.command)
app.command("fog", cls=ManyRuns)(thermal_fog.command)
app.command("apply", cls=Command)(thermal_apply.command)
