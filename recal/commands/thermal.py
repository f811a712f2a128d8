"""`recal thermal`: thermal coefficients from chamber runs, and a fitted model taken out of a run."""

import typer

from recal.commands import thermal_apply, thermal_fog, thermal_rlg
from recal.commands.thermal_inputs import ManyRuns
from recal.console import Command

app = typer.Typer(no_args_is_help=True, help="Thermal coefficients from chamber runs.")
app.command("rlg", cls=ManyRuns)(thermal_rlg.command)
app.command("fog", cls=ManyRuns)(thermal_fog.command)
app.command("apply", cls=Command)(thermal_apply.command)
