"""The options that several commands share, each declared once, by the name of its parameter."""

from inspect import Parameter
from pathlib import Path
from typing import Annotated, Any

import typer

from recal.cli.console import DEFAULT_STORE
from recal.cli.terminal.help import FOLDER

AT_THE_END = ("as_json", "quiet", "verbose", "seed")  # of every command
REVISIONS = "NUMBER|factory|previous|active"


def option(name: str, hint: Any, default: Any, *flags: str, **settings: Any) -> Parameter:
    """An option as a parameter of a command; its flag is its name unless others are given."""
    flags = flags or (f"--{name.replace('_', '-')}",)
    declared = Annotated[hint, typer.Option(*flags, **settings)]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=declared)


def by_name(*options: Parameter) -> dict[str, Parameter]:
    """Options by the name of their parameter."""
    return {found.name: found for found in options}


def folder_option(default: str) -> Parameter:
    """-o, with the folder that is written to without it."""
    said = f"The folder to write to, made if need be. Default: {default}."
    return option("output", Path | None, None, "-o", "--output", metavar="FOLDER", help=said)


SHARED = by_name(
    option(
        "as_json",
        bool,
        False,
        "--json",
        help="Print the result as one JSON document, not in words.",
    ),
    option("quiet", bool, False, "-q", "--quiet", help="Print nothing but errors."),
    option(
        "verbose",
        bool,
        False,
        "-v",
        "--verbose",
        help="Print the whole result on standard error, too.",
    ),
    option(
        "seed",
        int | None,
        None,
        hidden=True,
        help="Accepted; this command draws no random numbers.",
    ),
    option(
        "store",
        str,
        DEFAULT_STORE,
        metavar="URL",
        envvar="RECAL_STORE",
        help="The store of tables, as an SQLAlchemy URL. Default: RECAL_STORE, else the store of"
        f" your config.toml, else {DEFAULT_STORE}.",
    ),
    option(
        "twin",
        Path | None,
        None,
        metavar="FILE",
        help="Twin file with the noise model of the unit; an update takes the effects that it lists"
        " out of the log. Default: the unit's record in the store, else the defaults of its"
        " technology.",
    ),
    option(
        "thermal_model",
        Path | None,
        None,
        help="A fitted thermal_rlg.json or thermal_fog.json. What it says of temperature rates and"
        " gradients is taken out of the log first. Default: none.",
    ),
    option(
        "config",
        Path | None,
        None,
        help="Settings (TOML) with the sections session, flight and ageing. Default: none.",
    ),
    option(
        "priors",
        str,
        "approved",
        metavar="CHOICE",
        help="Where learnt ageing and turn-on come from: approved (those approved in the store),"
        " default (none), or a priors.json of recal fleet learn.",
    ),
    folder_option(FOLDER),
    option(
        "force",
        bool,
        False,
        help="Write over what exists. Default: only over an earlier output of this command.",
    ),
    option(
        "any_clock",
        bool,
        False,
        help="Write although this computer's clock is behind the unit's newest revision.",
    ),
    option(
        "new_unit",
        bool,
        False,
        help="A unit without a table in the store begins with the default of its technology.",
    ),
    option("new_store", bool, False, help="Make the store if it is not there yet."),
)
PROPOSER = option(
    "by",
    str | None,
    None,
    help="Who proposes. Default: the operator of your config.toml, else your login name.",
)
PROPOSAL = (
    option(
        "propose",
        bool,
        False,
        help="Keep the new table in the store for review; the active table stays.",
    ),
    PROPOSER,
    option("note", str, "", help="A note kept with the proposal."),
)
SEED_OPTION = option("seed", int | None, None, min=0, help="Seed of the random generator.")
