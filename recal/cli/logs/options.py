"""Options of the commands that read a log of another program, and the one record they make."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
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
        help="Column map (TOML) of a table: its columns, units, axes and rate. Default: none, the"
        " format is known by its content.",
    ),
]
GnssFile = Annotated[
    Path | None,
    typer.Option(
        "--gnss",
        metavar="FILE",
        rich_help_panel=INPUT,
        help="Satellite fixes that are in a file of their own. Default: those in the log.",
    ),
]
WhichImu = Annotated[
    int | None,
    typer.Option(
        "--imu",
        min=1,
        rich_help_panel=INPUT,
        help="Which IMU of a log that has several. Default: the first.",
    ),
]
LogFormat = Annotated[
    str | None, typer.Option("--format", help="Format of the log. Default: known by its content.")
]
OfSerial = Annotated[
    str | None, typer.Option("--serial", help="Serial number of the unit. Default: the log's.")
]
OfTechnology = Annotated[
    str | None,
    typer.Option(
        "--technology",
        metavar="rlg|fog|mems",
        help="Technology of the unit's gyros. Default: the log's.",
    ),
]


def degrees(text: str) -> float:
    """A number of degrees with the digits that were typed."""
    from recal.service.inputs.listings import Written

    try:
        return Written(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is no number of degrees, such as 47.781") from None


Latitude = Annotated[
    float | None,
    typer.Option(
        "--lat-deg",
        parser=degrees,
        metavar="LATITUDE",
        help="Latitude where the run starts [deg], with the digits that you know: 47.781 is taken"
        " to 0.001 deg, 48 to 0.5. Default: the log's.",
    ),
]
LatitudeSigma = Annotated[
    float | None,
    typer.Option(
        "--sigma-lat-deg",
        help="How well that latitude is known, 1 sigma [deg]. Default: half a unit of its last"
        " digit, at least 0.001.",
    ),
]
Longitude = Annotated[
    float | None,
    typer.Option("--lon-deg", help="Longitude where the run starts [deg]. Default: the log's."),
]
Height = Annotated[
    float | None,
    typer.Option(
        "--height-m",
        help="Height above the ellipsoid where the run starts [m]. Default: the log's.",
    ),
]
From = Annotated[
    float | None,
    typer.Option(
        "--from-s", help="Where to begin, by the log's own clock [s]. Default: its start."
    ),
]
To = Annotated[
    float | None,
    typer.Option("--to-s", help="Where to end, by the log's own clock [s]. Default: its end."),
]

AcceptedScale = Annotated[
    float | None,
    typer.Option(
        "--accepted-accelerometer-scale",
        metavar="SHARE",
        help="Accept accelerometers of a mems unit whose scales are off by up to this share, such"
        " as 0.2 where 8 m/s2 is read at rest: it becomes their sigma. Default: none is"
        " accepted.",
    ),
]
AcceptedConstant = Annotated[
    bool | None,
    typer.Option(
        "--accepted-constant-temperature",
        help="Accept thermometers that never change as a constant temperature.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class LogGiven:
    """What the command line says of a log: files beside it, keys of run.json, options of its
    reader.
    """

    map_file: Path | None
    gnss: Path | None
    header: Mapping[str, str | float | None]
    options: Mapping[str, str | float | None]


OPTION_TYPES = {
    "map_file": MapFile,
    "gnss": GnssFile,
    "imu": WhichImu,
    "log_format": LogFormat,
    "serial": OfSerial,
    "technology": OfTechnology,
    "lat_deg": Latitude,
    "sigma_lat_deg": LatitudeSigma,
    "lon_deg": Longitude,
    "height_m": Height,
    "from_s": From,
    "to_s": To,
    "accepted_scale": AcceptedScale,
    "accepted_constant": AcceptedConstant,
}


def with_log_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command that takes `given: LogGiven`, with the options of a log in its place."""

    @wraps(command)
    def joined(**words: Path | str | float | bool | None) -> None:
        of_log = {name: words.pop(name) for name in OPTION_TYPES}
        command(given=_given(of_log), **words)

    own = inspect.signature(command).parameters
    keyword = inspect.Parameter.KEYWORD_ONLY
    found = []
    for name, parameter in own.items():
        if name != "given":
            found.append(parameter.replace(kind=keyword))
            continue
        for option, kind in OPTION_TYPES.items():
            found.append(inspect.Parameter(option, keyword, default=None, annotation=kind))
    joined.__annotations__ = {p.name: p.annotation for p in found} | {"return": None}
    vars(joined)["__signature__"] = inspect.Signature(found)
    return joined


HEADER_KEYS = {  # of run.json, by option
    "serial": "imu_serial",
    "technology": "gyro_technology",
    "lat_deg": "lat_deg",
    "sigma_lat_deg": "sigma_lat_deg",
    "lon_deg": "lon_deg",
    "height_m": "height_m",
    "accepted_scale": "accepted_accelerometer_scale",
    "accepted_constant": "accepted_constant_temperature",
}
READER_KEYS = {"imu": "imu", "log_format": "format", "from_s": "from_s", "to_s": "to_s"}


def _given(words: Mapping[str, Path | str | float | None]) -> LogGiven:
    files = {name: value for name, value in words.items() if isinstance(value, Path)}
    others = {name: value for name, value in words.items() if not isinstance(value, Path)}
    return LogGiven(
        map_file=files.get("map_file"),
        gnss=files.get("gnss"),
        header={key: others[name] for name, key in HEADER_KEYS.items()},
        options={key: others[name] for name, key in READER_KEYS.items()},
    )
