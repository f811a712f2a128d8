"""`recal look`, `recal convert`, `recal check`: logs of other programs, and runs."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from recal.cli.console import Shown, say
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


@reads_log()
def look(shown: Shown, log: Path, /, output, *, force, **given) -> None:
    """Say what a log of any known format holds, how its sensors behave, and what it can be used
    for, each use with the next command. Of a table that it does not know it writes a column map to
    begin with. Exit code 0, 3 where something is wrong, 4 where it is fit for nothing.

    Example: recal look flight.bin -o flight-look

    Parameters
    ----------
    log
        A flight log of any known format, or a run directory.
    """
    from recal.service.look import look as service
    from recal.service.results.files import output_directory

    folder = output_directory(output, "look")
    shown.folder(folder, "recal.look/1", "look.html", force=force)
    said = of_log(**given)
    with shown.progress("reading", service.LOOK_STEPS) as told:
        try:
            looked = service.look(log, **said, told=told)
        except service.UnknownLog as unknown:
            service.write_starter(
                log, folder / f"{log.name.split('.')[0]}.toml", unknown, force=force
            )
            raise
        report = looked.write(folder) / "look.html"
    shown.end(looked, report)


@reads_log()
def convert(
    shown: Shown,
    log: Path,
    /,
    output: Annotated[Path, typer.Option("-o", "--output", help="The run directory to write.")],
    split: bool = False,
    live: float = 1.0,
    to: str | None = None,
    *,
    force,
    **given,
) -> None:
    """Convert a flight log of a known format, or by a column map, to a run; list all that was
    dropped or repaired.

    Example: recal convert flight.bin -o runs/flight-imu3 --imu 3

    Parameters
    ----------
    log
        A flight log.
    split
        Write a run for each stretch between gaps of over 1 s: run-1, run-2, ... in the folder -o.
    live : float in [0.1, 10000]
        With --to: so many times as fast as it was recorded.
    to
        Then send the run as MAVLink, to udp:HOST:PORT or to who connects to tcp:HOST:PORT: a
        recorded flight to try recal watch on. Default: it is only written.
    """
    from recal.service import convert as service
    from recal.service.results.overwrite import need_free_run

    if split and to is not None:
        raise typer.BadParameter("--split makes several runs, --to sends one: needed one of both")
    folders = sorted(output.glob("run-*")) if split else [output]
    for folder in folders:
        need_free_run(
            folder, lambda run: service.made_of(run, log), f"made of {log.name}", force=force
        )
    make = service.split if split else service.convert
    steps = None if split else service.CONVERT_STEPS
    said = of_log(**given)
    with shown.progress("converting", steps, compiles=False) as told:
        converted = make(log, output, **said, told=told)
    if to is not None:
        from recal.service.watch.feed import feed

        feed(output, to, speed=live, told=shown.say)
    shown.answer(converted.document, converted.lines())


@made_from("recal.service.check", "check")
def check(shown: Shown, run, /, serial) -> None:
    """Read a run, and say what it holds, what is wrong and where. Exit code 0, or 3 where something
    is wrong.

    Example: recal check flights/2026-03-01 --json
    """
    from recal.service import check as service

    with shown.progress("reading the run", service.CHECK_STEPS, compiles=False) as told:
        found = service.check(run, serial=serial, told=told)
    if shown.quiet and not shown.as_json:
        for line in service.error_lines(found.record):
            say(line)
    shown.end(found)
