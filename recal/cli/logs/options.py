"""What the commands that read a log of another program are told of it, and its options."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import typer

from recal.cli.parameters.shared import option
from recal.cli.parameters.verbs import Made, made_from


def degrees(text: str) -> float:
    """A number of degrees with the digits that were typed."""
    from recal.service.inputs.listings import Written

    try:
        return Written(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is no number of degrees, such as 47.781") from None


LATITUDE = option(
    "lat_deg",
    float | None,
    None,
    parser=degrees,
    metavar="LATITUDE",
    help="Latitude where the run starts [deg], with the digits that you know: 47.781 is taken to"
    " 0.001 deg, 48 to 0.5. Default: the log's.",
)


def of_log(
    map_: Path | None = None,
    gnss: Path | None = None,
    imu: int | None = None,
    format_: str | None = None,
    serial: str | None = None,
    technology: str | None = None,
    lat_deg: float | None = None,
    sigma_lat_deg: float | None = None,
    lon_deg: float | None = None,
    height_m: float | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    tail: str | None = None,
    start_utc: str | None = None,
    run_id: str | None = None,
    accepted_accelerometer_scale: float | None = None,
    accepted_constant_temperature: bool | None = None,
    any_attitude: bool | None = None,
) -> dict[str, Any]:
    """What the command line says of a log, as the verbs take it: files beside it, keys of run.json,
    options of its reader.

    Parameters
    ----------
    map_
        Column map (TOML) of a table: its columns, units, axes and rate. Default: none, the format
        is known by its content.
    gnss
        Satellite fixes that are in a file of their own. Default: those in the log.
    imu : int in [1, ]
        Which IMU of a log that has several. Default: the first.
    format_
        Format of the log. Default: known by its content.
    serial
        Serial number of the unit. Default: the log's.
    technology
        Technology of the unit's gyros. Default: the log's.
    lat_deg
        Latitude where the run starts [deg], declared by LATITUDE.
    sigma_lat_deg
        How well that latitude is known, 1 sigma [deg]. Default: half a unit of its last digit, at
        least 0.001.
    lon_deg
        Longitude where the run starts [deg]. Default: the log's.
    height_m
        Height above the ellipsoid where the run starts [m]. Default: the log's.
    from_s
        Where to begin, by the log's own clock [s]. Default: its start.
    to_s
        Where to end, by the log's own clock [s]. Default: its end.
    tail
        Tail number of the aircraft.
    start_utc
        When the run starts, such as 2026-03-01T05:00:00Z. Default: the log's.
    run_id
        Name of the run. Default: the name of the log.
    accepted_accelerometer_scale
        Accept accelerometers of a mems unit whose scales are off by up to this share, such as 0.2
        where 8 m/s2 is read at rest: it becomes their sigma. Default: none is accepted.
    accepted_constant_temperature
        Accept thermometers that never change as a constant temperature.
    any_attitude
        The unit may stand in any attitude, also upside down.
    """
    header = {
        "imu_serial": serial,
        "gyro_technology": technology,
        "lat_deg": lat_deg,
        "sigma_lat_deg": sigma_lat_deg,
        "lon_deg": lon_deg,
        "height_m": height_m,
        "tail": tail,
        "start_utc": start_utc,
        "run_id": run_id,
        "accepted_accelerometer_scale": accepted_accelerometer_scale,
        "accepted_constant_temperature": accepted_constant_temperature,
        "any_attitude": any_attitude,
    }
    options = {"imu": imu, "format": format_, "from_s": from_s, "to_s": to_s}
    return {"map_file": map_, "gnss": gnss, "header": header, "options": options}


reads_log: Callable[..., Callable[..., Made]] = partial(
    made_from,
    __name__,
    of_log.__name__,
    LATITUDE,
    map_="FILE",
    gnss="FILE",
    technology="rlg|fog|mems",
    accepted_accelerometer_scale="SHARE",
)
