"""`recal table` with all its commands, those on proposals among them."""

from recal.cli.table.app import app
from recal.cli.table.proposals import app as proposals

app.add_typer(proposals)
