"""The options of `recal table`."""

from __future__ import annotations

from typing import Annotated

import typer

SerialOption = Annotated[
    str | None, typer.Option("--serial", help="IMU serial; needed where the store holds several.")
]
TechnologyOption = Annotated[str | None, typer.Option("--technology", help="rlg, fog or mems.")]
ModeOption = Annotated[
    str | None, typer.Option("--mode", help="Gyro mode, where the unit has several.")
]
NoteOption = Annotated[str, typer.Option("--note", help="Kept with the revision.")]
RevisionOption = Annotated[
    str, typer.Option("--revision", help="A number, factory, previous or active.")
]
