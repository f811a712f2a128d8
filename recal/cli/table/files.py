"""`recal table export` and `recal table import`: tables to and from files, an autopilot's
parameters among them.
"""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.cli.console import (
    DEFAULT_STORE,
    REFUSED,
    AnyClock,
    JsonFlag,
    NoSeed,
    OutputPath,
    Quiet,
    StoreUrl,
    Verbose,
    answer,
    say,
)
from recal.cli.table.stored_tables import (
    ModeOption,
    NoteOption,
    RevisionOption,
    SerialOption,
    TechnologyOption,
    about,
    find_revision,
    line_of,
    need,
    open_tables,
    other_technology,
)

if TYPE_CHECKING:
    from infield.store.table_store import Revision
    from infield.table.autopilot_table import CubicExport


class Form(StrEnum):
    """What `export --to` writes."""

    json = "json"
    csv = "csv"
    px4 = "px4"
    ardupilot = "ardupilot"


class Autopilot(StrEnum):
    px4 = "px4"
    ardupilot = "ardupilot"


ImuOption = Annotated[
    int | None, typer.Option("--imu", min=0, help="The number in an autopilot's parameter names.")
]


def export(
    output: OutputPath = None,
    store: StoreUrl = DEFAULT_STORE,
    serial: SerialOption = None,
    technology: TechnologyOption = None,
    mode: ModeOption = None,
    revision: RevisionOption = "active",
    to: Annotated[Form | None, typer.Option("--to", help="Default: by the file's ending.")] = None,
    imu: ImuOption = None,
    device_id: Annotated[
        int | None, typer.Option("--device-id", help="PX4: of the gyro, CAL_GYROk_ID or its log.")
    ] = None,
    range_: Annotated[
        tuple[float, float] | None, typer.Option("--range", help="For the cubic [degC].")
    ] = None,
    fit_limit: Annotated[
        float, typer.Option("--fit-limit", min=0.0, help="Cubic less table, in the table's sigma.")
    ] = 1.0,
    force: Annotated[
        bool, typer.Option("--force", help="Write a cubic beyond the limit, its error told in it.")
    ] = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """A table to a file: .json keeps everything, .csv node values and sigmas; PX4 and ArduPilot get
    a cubic.

    Example: recal table export -o table.json --serial SN-0042

    For an autopilot: recal table export --to px4 --device-id 3670026 -o unit.params,
    or recal table export --to ardupilot --imu 1 -o unit.parm
    """
    form = _form(output, to)
    assert output is not None
    if form in (Form.json, Form.csv):
        for name, given in (("--imu", imu), ("--device-id", device_id), ("--range", range_)):
            if given is not None:
                raise typer.BadParameter("goes with --to px4 or --to ardupilot", param_hint=name)
    with open_tables(store) as opened:
        found = find_revision(opened, revision, serial, technology, mode)
    if form in (Form.px4, Form.ardupilot):
        number = _number(form, imu, device_id)
        _export_cubic(
            found,
            output,
            form,
            number,
            device_id or 0,
            range_,
            fit_limit,
            force,
            as_json,
            quiet,
            verbose,
        )
        return
    _write(output, _text(found, form))
    answer({"output": str(output), **about(found)}, as_json=as_json, verbose=verbose)
    say(
        f"{output}: {line_of(found)}{' (covariance is not in a CSV)' if form == Form.csv else ''}",
        quiet=quiet,
    )


def import_(
    table: Annotated[
        Path, typer.Argument(help="A table, .json or .csv, or an autopilot's .params or .parm.")
    ],
    store: StoreUrl = DEFAULT_STORE,
    twin: Annotated[
        Path | None, typer.Option("--twin", help="Sets the unit's twin record.")
    ] = None,
    serial: SerialOption = None,
    technology: TechnologyOption = None,
    mode: ModeOption = None,
    note: NoteOption = "",
    from_: Annotated[
        Autopilot | None, typer.Option("--from", help="Whose parameters, where a file has both.")
    ] = None,
    imu: ImuOption = None,
    sigma: Annotated[
        float | None, typer.Option("--sigma", min=0.0, help="Of an autopilot's cubic [deg/h].")
    ] = None,
    override_technology: Annotated[
        bool,
        typer.Option(
            "--override-technology", help="Although the store knows the serial as another; noted."
        ),
    ] = False,
    any_clock: AnyClock = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """A table from a file becomes the active one; a unit's first is its factory table.

    Example: recal table import table.json --twin twin.json

    From an autopilot: recal table import tcal.parm --serial SN-0042-imu1 --technology mems
    """
    from infield.store.table_store import StoreConflict, TableStore, require_same_unit
    from ins.records import InputError
    from ins.twin_file import read_twin

    data, said = _read(table, serial, technology, mode, from_, imu, sigma)
    record = None if twin is None else read_twin(twin)
    require_same_unit(data, record)
    note = "; ".join(filter(None, (note, *said)))
    try:
        with TableStore.open(store, create=True, any_clock=any_clock) as opened:
            if (conflict := other_technology(opened, data)) is not None:
                need(
                    override_technology,
                    f"{table}: {conflict} (--override-technology imports it all the same)",
                )
                note = "; ".join(filter(None, (note, f"technology overridden: {conflict}")))
            found = opened.import_table(data, twin=record, note=note)
    except StoreConflict as error:
        raise InputError(str(error)) from None
    answer(about(found), as_json=as_json, verbose=verbose)
    say(f"{found.unit}: {line_of(found)}{', twin record set' if twin else ''}", quiet=quiet)
    for line in said:
        say(f"  note: {line}", quiet=quiet)


def _form(output: Path | None, to: Form | None) -> Form:
    """What to write, from --to or the ending, which must not contradict each other."""
    from infield.table.autopilot_params import ENDINGS

    endings = {
        Form.json: (".json",),
        Form.csv: (".csv",),
        **{Form(name): ends for name, ends in ENDINGS.items()},
    }
    if to is None:
        to = next(
            (
                f
                for f in (Form.json, Form.csv)
                if output is not None and output.suffix in endings[f]
            ),
            None,
        )
        if to is None:
            raise typer.BadParameter(
                "needed: a file that ends in .json or .csv, or --to px4 or ardupilot",
                param_hint="-o",
            )
    if output is None or output.suffix not in endings[to]:
        raise typer.BadParameter(
            f"needed: a file that ends in {' or '.join(endings[to])}", param_hint="-o"
        )
    return to


def _number(form: Form, imu: int | None, device_id: int | None) -> int:
    """The number in the parameter names; PX4 finds a calibration by its sensor's id, so that is
    needed.
    """
    from infield.table.autopilot_params import MAX_DEVICE_ID, NUMBERS

    allowed = NUMBERS[form]
    if imu is not None and imu not in allowed:
        raise typer.BadParameter(
            f"got {imu}, needed {allowed[0]} to {allowed[-1]} as {form} counts", param_hint="--imu"
        )
    if form == Form.px4 and (device_id is None or not 0 < device_id <= MAX_DEVICE_ID):
        where = "CAL_GYROk_ID of the autopilot, or device_id of sensor_gyro in its log"
        raise typer.BadParameter(
            f"px4 needs the gyro's id, 1 to {MAX_DEVICE_ID}: {where}", param_hint="--device-id"
        )
    if form == Form.ardupilot and device_id is not None:
        raise typer.BadParameter(
            "ArduPilot has none: parameters go by --imu", param_hint="--device-id"
        )
    return allowed[0] if imu is None else imu


def _text(found: Revision, form: Form) -> str:
    from infield.table.file import csv_text, json_text

    return csv_text(found.table) if form == Form.csv else json_text(found.table_dict) + "\n"


def _write(output: Path, text: str) -> None:
    from recal.service.output import output_directory, write_text

    output_directory(output.parent, "")
    write_text(output, text)


def _export_cubic(
    found: Revision,
    output: Path,
    form: Form,
    number: int,
    device_id: int,
    span: tuple[float, float] | None,
    limit: float,
    force: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Fit, judge, write; a cubic that is too stiff for the table is refused (exit code 4) unless
    forced.
    """
    from infield.table.autopilot_table import export_cubic

    made: CubicExport = export_cubic(
        found.table,
        form.value,
        number=number,
        device_id=device_id,
        span_degC=span,
        limit_sigmas=limit,
    )
    refused = bool(made.too_stiff) and not force
    if not refused:
        _write(output, made.text(unit=str(found.unit), revision=found.number, sha256=found.sha256))
    result = {
        "schema": "recal.export/1",
        "verdict": "refused" if refused else "exported",
        "reasons": list(made.too_stiff),
        "output": None if refused else str(output),
        **about(found),
        **made.fit_document(),
    }
    answer(result, as_json=as_json, verbose=verbose)
    say(f"{output}: {'refused' if refused else line_of(found)}", quiet=quiet)
    for reason in made.too_stiff:
        say(
            f"  {'because' if refused else 'although'} the cubic is too stiff: {reason}",
            quiet=quiet,
        )
    if refused:
        say(
            "  a narrower --range, a larger --fit-limit, or --force would write it, the error told"
            " in the file",
            quiet=quiet,
        )
        raise typer.Exit(REFUSED)
    for line in made.fit_lines():
        say(f"  {line}", quiet=quiet)


def _read(
    path: Path,
    serial: str | None,
    technology: str | None,
    mode: str | None,
    from_: Autopilot | None,
    imu: int | None,
    sigma: float | None,
) -> tuple[dict[str, Any], list[str]]:
    """The table of a file as a dict, and notes on what was assumed for it."""
    from infield.table.autopilot_params import ENDINGS
    from infield.table.file import read_table_csv, read_table_dict

    cubic = from_ is not None or path.suffix in (end for ends in ENDINGS.values() for end in ends)
    if not cubic:
        for name, option in (("--imu", imu), ("--sigma", sigma)):
            if option is not None:
                raise typer.BadParameter("goes with an autopilot's parameter file", param_hint=name)
    if path.suffix != ".csv" and not cubic:
        data = read_table_dict(path)
        for name, key, given in (
            ("--serial", "imu_serial", serial),
            ("--technology", "gyro_technology", technology),
            ("--mode", "gyro_mode", mode),
        ):
            in_file = data.get(key, "")
            need(
                given in (None, in_file),
                f"{path}: {key} {in_file!r}, needed {given!r} as {name} says",
            )
        return data, []
    if serial is None or technology is None:
        form = "a parameter file" if cubic else "a CSV table"
        raise typer.BadParameter(f"{form} needs --serial and --technology", param_hint="TABLE")
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    if not cubic:
        return (
            read_table_csv(
                path,
                imu_serial=serial,
                gyro_technology=technology,
                gyro_mode=mode or "",
                created_utc=now,
            ),
            [],
        )
    return _read_cubic(path, serial, technology, mode, from_, imu, sigma, now)


def _read_cubic(
    path: Path,
    serial: str,
    technology: str,
    mode: str | None,
    from_: Autopilot | None,
    imu: int | None,
    sigma: float | None,
    now: str,
) -> tuple[dict[str, Any], list[str]]:
    from infield.table.autopilot_params import read_cubic
    from infield.table.autopilot_table import table_of_cubic
    from infield.table.file import table_to_dict
    from ins.records import GYRO_TECHNOLOGIES

    need(
        technology in GYRO_TECHNOLOGIES,
        f"--technology {technology!r}, needed one of {', '.join(GYRO_TECHNOLOGIES)}",
    )
    found = read_cubic(path, autopilot=from_.value if from_ else None, number=imu)
    made, notes = table_of_cubic(
        found,
        imu_serial=serial,
        gyro_technology=technology,
        gyro_mode=mode or "",
        created_utc=now,
        sigma_deg_h=sigma,
        file=path.name,
        file_sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
    )
    which = (
        f"{found.autopilot} IMU {found.number}, {found.low_degC:.1f} to {found.high_degC:.1f} degC"
    )
    return table_to_dict(made), [f"{path.name}: {which}", *notes]
