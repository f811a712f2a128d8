"""`recal table export` and `recal table import`: tables to and from files, an autopilot's
parameters among them.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recal.cli.console import REFUSED_EXIT, Shown, login_name
from recal.cli.table.options import of_table
from recal.cli.terminal.help import ADVANCED, OUTPUT

if TYPE_CHECKING:
    from recal.service.table_files import CubicRequest, TableFile
    from recal.service.tables import Revision


class Form(StrEnum):
    """What `export --to` writes."""

    json = "json"
    csv = "csv"
    px4 = "px4"
    ardupilot = "ardupilot"


@of_table()
def export(
    shown: Shown,
    /,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="The file to write. Needed."),
    ] = None,
    *,
    store,
    serial,
    technology,
    mode,
    revision,
    to: Annotated[
        Form | None,
        typer.Option(rich_help_panel=OUTPUT, help="Format. Default: by the file's ending."),
    ] = None,
    imu,
    device_id: int | None = None,
    range_: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--range", help="Temperatures that the cubic is fitted to [degC]. Default: the table's."
        ),
    ] = None,
    fit_limit: float = 1.0,
    force: bool = False,
) -> None:
    """Write a table to a file: .json keeps everything, .csv node values and sigmas; PX4 and
    ArduPilot get a cubic.

    Example: recal table export -o table.json --serial SN-0042

    For an autopilot: recal table export --to px4 --device-id 3670026 -o unit.params,
    or recal table export --to ardupilot --imu 1 -o unit.parm

    Parameters
    ----------
    device_id
        PX4: the gyro's id, from CAL_GYROk_ID or its log. Needed for PX4.
    fit_limit : float in [0, ]
        Largest difference of cubic and table, in the table's sigma.
    force
        Write over what exists, and a cubic beyond the limit with its error told in it.
    """
    from ins.documents import plain
    from recal.service.results.overwrite import CSV_TABLE, PARAMETERS, need_free_file
    from recal.service.store import TableStore
    from recal.service.table_files import CubicRequest, write_table
    from recal.service.tables import find_revision, line_of

    form = _form(output, to)
    assert output is not None
    if form in (Form.json, Form.csv):
        for name, given in (("--imu", imu), ("--device-id", device_id), ("--range", range_)):
            if given is not None:
                raise typer.BadParameter("goes with --to px4 or --to ardupilot", param_hint=name)
    with TableStore.open(store) as opened:
        found = find_revision(opened, revision, serial, technology, mode)
    if form in (Form.json, Form.csv):
        need_free_file(output, CSV_TABLE if form == Form.csv else "recal.table/1", force=force)
    if form in (Form.px4, Form.ardupilot):
        need_free_file(output, PARAMETERS, force=force)
        request = CubicRequest(
            autopilot=form.value,
            number=_number(form, imu, device_id),
            device_id=device_id or 0,
            span_degC=range_,
            limit_sigmas=fit_limit,
            force=force,
        )
        _export_cubic(shown, found, output, request)
        return
    write_table(found, output, form.value)
    left_out = " (covariance is not in a CSV)" if form == Form.csv else ""
    shown.answer({"output": str(output), **plain(found)}, [f"{output}: {line_of(found)}{left_out}"])


@of_table(twin="FILE")
def import_(
    shown: Shown,
    table: Path,
    /,
    store,
    twin: Path | None = None,
    *,
    serial,
    technology,
    mode,
    note,
    from_: str | None = None,
    imu,
    sigma: float | None = None,
    override_technology: bool = False,
    one_person: Annotated[
        bool,
        typer.Option(
            "--one-person",
            rich_help_panel=ADVANCED,
            help="In this store one person may put an update forward and approve it.",
        ),
    ] = False,
    any_size: bool = False,
    any_clock,
) -> None:
    """Make a table from a file the active one; a unit's first is its factory table.

    Example: recal table import table.json --twin twin.json

    From an autopilot: recal table import tcal.parm --serial SN-0042-imu1 --technology mems

    Parameters
    ----------
    table
        A table, .json or .csv, or an autopilot's .params or .parm.
    twin
        Twin file to keep as the unit's record.
    from_ : {'px4', 'ardupilot'}
        Whose parameters to read, where a file has both.
    sigma : float in [0, ]
        1 sigma of an autopilot's cubic [deg/h].
    override_technology
        Import although the store knows the serial as another technology; this is noted.
    any_size
        Import biases and sigmas larger than 10 deg/h (rlg), 100 (fog), 20,000 (mems); this is
        noted.
    """
    from recal.service.table_files import TableFile, import_table
    from recal.service.tables import line_of

    given = TableFile(
        path=table,
        serial=serial,
        technology=technology,
        mode=mode,
        autopilot=from_,
        number=imu,
        sigma_deg_h=sigma,
        any_size=any_size,
    )
    _check_options(given)
    found, said = import_table(
        given,
        store,
        twin,
        note=note,
        override=override_technology,
        any_clock=any_clock,
        one_person=login_name() if one_person else None,
    )
    lines = [
        f"{found.unit}: {line_of(found)}{', twin record set' if twin else ''}",
        *(f"  note: {line}" for line in said),
    ]
    shown.answer(found, lines)


def _form(output: Path | None, to: Form | None) -> Form:
    """What to write, from --to or the ending, which must not contradict each other."""
    from recal.service.table_files import PARAMETER_ENDINGS

    endings = {
        Form.json: (".json",),
        Form.csv: (".csv",),
        **{Form(name): ends for name, ends in PARAMETER_ENDINGS.items()},
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
    from recal.service.table_files import MAX_DEVICE_ID, NUMBERS

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


def _export_cubic(shown: Shown, found: Revision, output: Path, request: CubicRequest) -> None:
    """Fit, judge, write; a cubic that is too stiff for the table is refused (exit code 4) unless
    forced.
    """
    from recal.service.table_files import export_cubic_table
    from recal.service.tables import line_of

    made = export_cubic_table(found, output, request)
    refused = made.refused
    lines = [f"{output}: {'refused' if refused else line_of(found)}"]
    word = "because" if refused else "although"
    lines += [f"  {word} the cubic is too stiff: {reason}" for reason in made.reasons]
    if refused:
        lines.append(
            "  a narrower --range, a larger --fit-limit, or --force would write it, with the"
            " error stated in the file"
        )
    else:
        lines += [f"  {line}" for line in made.lines()]
    shown.answer(made.document, lines)
    if refused:
        raise typer.Exit(REFUSED_EXIT)


def _check_options(given: TableFile) -> None:
    """typer.BadParameter for options that do not go with the file, or are missing for it."""
    if not given.is_cubic:
        for name, option in (("--imu", given.number), ("--sigma", given.sigma_deg_h)):
            if option is not None:
                raise typer.BadParameter("goes with an autopilot's parameter file", param_hint=name)
    if given.names_its_unit:
        return
    if given.serial is None or given.technology is None:
        form = "a parameter file" if given.is_cubic else "a CSV table"
        raise typer.BadParameter(f"{form} needs --serial and --technology", param_hint="TABLE")
