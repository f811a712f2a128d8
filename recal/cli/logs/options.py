"""Options of the commands that read a log of another program."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.terminal.help import INPUT

MapFile = Annotated[
    Path | None,
    typer.Option(
        "--map",
        metavar="FILE",
        rich_help_panel=INPUT,
        help="Column map (TOML) of a table: its columns, units, axes and rate.",
    ),
]
GnssFile = Annotated[
    Path | None,
    typer.Option(
        "--gnss",
        metavar="FILE",
        rich_help_panel=INPUT,
        help="Satellite fixes that are in a file of their own.",
    ),
]
WhichImu = Annotated[
    int | None,
    typer.Option(
        "--imu", min=1, rich_help_panel=INPUT, help="Which IMU of a log that has several."
    ),
]
LogFormat = Annotated[
    str | None, typer.Option("--format", help="Format of the log. Default: known by its content.")
]
OfSerial = Annotated[str | None, typer.Option("--serial", help="Serial number of the unit.")]
OfTechnology = Annotated[
    str | None,
    typer.Option("--technology", metavar="rlg|fog|mems", help="Technology of the unit's gyros."),
]
Latitude = Annotated[
    float | None,
    typer.Option("--lat-deg", help="Latitude where the run starts [deg]. Default: the log's."),
]
Longitude = Annotated[float | None, typer.Option("--lon-deg", help="Its longitude [deg].")]
Height = Annotated[
    float | None, typer.Option("--height-m", help="Its height above the ellipsoid [m].")
]
From = Annotated[
    float | None, typer.Option("--from-s", help="Where to begin, by the log's own clock [s].")
]
To = Annotated[
    float | None, typer.Option("--to-s", help="Where to end, by the log's own clock [s].")
]
