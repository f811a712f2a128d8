"""The command line: registers one module a command (recal/cli)."""

import importlib

import typer

from recal.cli.console import Command

app = typer.Typer(
    name="recal",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Strapdown inertial navigation that recalibrates its gyros in the field.",
)

COMMANDS = (
    "demo",
    "simulate",
    "convert",
    "check",
    "align",
    "replay",
    "update",
    "misalignment",
    "plan",
    "diagnose",
    "serve",
)
for _name in COMMANDS:
    app.command(_name, cls=Command)(importlib.import_module(f"recal.cli.{_name}").command)
_table = importlib.import_module("recal.cli.table.app").app
# its commands stand among those of table
_table.add_typer(importlib.import_module("recal.cli.table.proposals").app)
app.add_typer(_table, name="table")
app.add_typer(importlib.import_module("recal.cli.thermal.app").app, name="thermal")
app.add_typer(importlib.import_module("recal.cli.fleet").app, name="fleet")
