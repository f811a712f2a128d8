"""The options of `recal table`."""

from __future__ import annotations

from typing import Annotated

import typer

SerialOption = Annotated[
    str | None,
    typer.Option(
        "--serial", help="Serial number of the unit. Needed where the store holds several."
    ),
]
TechnologyOption = Annotated[
    str | None,
    typer.Option(
        "--technology",
        metavar="rlg|fog|mems",
        help="Technology of the unit's gyros. Needed where neither store nor file tells it.",
    ),
]
ModeOption = Annotated[
    str | None,
    typer.Option("--mode", help="Gyro mode of the unit. Needed where the unit has several."),
]
NoteOption = Annotated[str, typer.Option("--note", help="A note kept with the revision.")]
RevisionOption = Annotated[
    str,
    typer.Option(
        "--revision", metavar="NUMBER|factory|previous|active", help="Which revision of the table."
    ),
]
ByOption = Annotated[
    str | None,
    typer.Option(
        "--by", help="Who decides. Default: the operator of your config.toml, else your login name."
    ),
]
