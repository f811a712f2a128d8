"""`recal table import` and `export`: tables from and to files, autopilot parameters too."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

from infield.store.table_store import Revision, TableStore, require_same_unit
from infield.table.autopilot_params import MAX_DEVICE_ID as MAX_DEVICE_ID
from infield.table.autopilot_params import MAX_PARAMETER_BYTES, read_cubic
from infield.table.autopilot_params import NUMBERS as NUMBERS
from infield.table.autopilot_params import PARAMETER_ENDINGS as PARAMETER_ENDINGS
from infield.table.autopilot_table import (
    CubicDocument,
    CubicExport,
    ParameterFile,
    export_cubic,
    table_of_cubic,
)
from infield.table.file import (
    csv_text,
    implausible_size,
    json_text,
    read_table_csv,
    read_table_dict,
    table_to_dict,
)
from ins.documents import INLINE
from ins.records import GYRO_TECHNOLOGIES, InputError, TableDocument
from ins.twin_file import read_twin
from ins.user_input import read_bounded
from recal.service.results.files import output_directory, write_text
from recal.service.results.result import Result
from recal.service.tables import need, other_technology


@dataclass(frozen=True, kw_only=True)
class TableFile:
    """A table in a file, and what was said of it. autopilot, number: whose parameters, where a file
    has several; sigma_deg_h: of an autopilot's cubic; any_size: it is taken although it is larger
    than its technology makes it.
    """

    path: Path
    serial: str | None = None
    technology: str | None = None
    mode: str | None = None
    autopilot: str | None = None
    number: int | None = None
    sigma_deg_h: float | None = None
    any_size: bool = False

    @property
    def is_cubic(self) -> bool:
        """Whether it holds an autopilot's parameters."""
        endings = {end for ends in PARAMETER_ENDINGS.values() for end in ends}
        return self.autopilot is not None or self.path.suffix in endings

    @property
    def names_its_unit(self) -> bool:
        """Whether serial and technology are in the file."""
        return self.path.suffix != ".csv" and not self.is_cubic


@dataclass(frozen=True, kw_only=True)
class CubicRequest:
    """A cubic for an autopilot: whose, under which number, over which temperatures [degC], how far
    off the table [its sigma], and whether it is written although it is further off.
    """

    autopilot: str
    number: int
    device_id: int = 0
    span_degC: tuple[float, float] | None = None
    limit_sigmas: float = 1.0
    force: bool = False


class ExportVerdict(StrEnum):
    """Whether a cubic was written."""

    EXPORTED = "exported"
    REFUSED = "refused"


@dataclass(frozen=True, kw_only=True)
class ExportReport:
    """What `recal table export --json` prints of a cubic; output: None where it was refused."""

    schema: str = "recal.export/1"
    verdict: ExportVerdict
    reasons: Sequence[str]
    output: str | None
    revision: Revision = field(metadata=INLINE)
    cubic: CubicDocument = field(metadata=INLINE)


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Exported(Result[ExportReport]):
    """A cubic that was written, or refused as too stiff.

    Parameters
    ----------
    cubic : CubicExport
        The fit.
    refused : bool
        Whether it is too stiff for the table and was not written.
    """

    cubic: CubicExport
    refused: bool = False

    def lines(self, *, verbose: bool = False) -> list[str]:
        """How well it fits, per gyro."""
        return list(self.cubic.fit_lines())


def write_table(found: Revision, output: Path, form: str) -> None:
    """A stored table as JSON, or as CSV where `form` is "csv"."""
    text = csv_text(found.table) if form == "csv" else json_text(found.table_dict) + "\n"
    _write(output, text)


def export_cubic_table(found: Revision, output: Path, request: CubicRequest) -> Exported:
    """Fit, judge, write; a cubic that is too stiff for the table is refused unless forced."""
    made = export_cubic(
        found.table,
        request.autopilot,
        number=request.number,
        device_id=request.device_id,
        span_degC=request.span_degC,
        limit_sigmas=request.limit_sigmas,
    )
    refused = bool(made.too_stiff) and not request.force
    if not refused:
        _write(output, made.text(unit=str(found.unit), revision=found.number, sha256=found.sha256))
    document = ExportReport(
        verdict=ExportVerdict.REFUSED if refused else ExportVerdict.EXPORTED,
        reasons=made.too_stiff,
        output=None if refused else str(output),
        revision=found,
        cubic=made.fit_document(),
    )
    return Exported(document, cubic=made, refused=refused)


def import_table(
    given: TableFile,
    url: str,
    twin: Path | None,
    *,
    note: str = "",
    override: bool = False,
    any_clock: bool = False,
    one_person: str | None = None,
) -> tuple[Revision, list[str]]:
    """The table of a file becomes the active one; what was assumed for it. override: although the
    store knows the serial as another technology; one_person: as of `TableStore.import_table`.
    """
    data, said = _read(given)
    if (wild := implausible_size(data)) is not None:
        what = f"{given.path}: {wild}: another unit? (--any-size imports it all the same)"
        need(given.any_size, what)
        said = [*said, f"size taken as it is: {wild}"]
    record = None if twin is None else read_twin(twin)
    require_same_unit(data, record)
    note = "; ".join(filter(None, (note, *said)))
    with TableStore.open(url, create=True, any_clock=any_clock) as opened:
        if (conflict := other_technology(opened, data)) is not None:
            need(
                override,
                f"{given.path}: {conflict} (--override-technology imports it all the same)",
            )
            note = "; ".join(filter(None, (note, f"technology overridden: {conflict}")))
        return opened.import_table(data, twin=record, note=note, one_person=one_person), said


def _write(output: Path, text: str) -> None:
    output_directory(output.parent, "")
    write_text(output, text)


def _read(given: TableFile) -> tuple[TableDocument, list[str]]:
    """The table of a file, and notes on what was assumed for it."""
    path = given.path
    if given.names_its_unit:
        data = read_table_dict(path)
        for name, key, wanted in (
            ("--serial", "imu_serial", given.serial),
            ("--technology", "gyro_technology", given.technology),
            ("--mode", "gyro_mode", given.mode),
        ):
            in_file = str(data.get(key, ""))
            need(
                wanted in (None, in_file),
                f"{path}: {key} {in_file!r}, needed {wanted!r} as {name} says",
            )
        return data, []
    if given.serial is None or given.technology is None:
        raise InputError(f"{path}: serial and technology are not in it, needed both")
    unit = {
        "imu_serial": given.serial,
        "gyro_technology": given.technology,
        "gyro_mode": given.mode or "",
        "created_utc": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
    }
    if not given.is_cubic:
        return read_table_csv(path, **unit), []
    return _read_cubic(given, unit)


def _read_cubic(given: TableFile, unit: dict[str, str]) -> tuple[TableDocument, list[str]]:
    path = given.path
    need(
        given.technology in GYRO_TECHNOLOGIES,
        f"--technology {given.technology!r}, needed one of {', '.join(GYRO_TECHNOLOGIES)}",
    )
    found = read_cubic(path, autopilot=given.autopilot, number=given.number)
    made, notes = table_of_cubic(
        found,
        **unit,
        sigma_deg_h=given.sigma_deg_h,
        file=ParameterFile(
            path.name, hashlib.sha256(read_bounded(path, MAX_PARAMETER_BYTES)).hexdigest()
        ),
    )
    which = (
        f"{found.autopilot} IMU {found.number}, {found.low_degC:.1f} to {found.high_degC:.1f} degC"
    )
    return table_to_dict(made), [f"{path.name}: {which}", *notes]
