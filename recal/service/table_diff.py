"""`table diff`: two tables of one unit, what differs, and what the difference is worth."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from infield.reports.documents.update import NM_H_PER_DEG_H, level_change
from infield.reports.drawing import BLACK, GREY, NEW, OLD, Line, Panel, drawn_temperatures
from infield.reports.page import render_page
from infield.reports.update_figures import BIAS_AXIS, TEMPERATURE_AXIS, table_curve
from infield.store.table_store import Revision
from infield.table.file import read_table_csv, read_table_dict, table_from_dict, table_sha256
from infield.table.thermal_table import ThermalTable
from ins.documents import UNWRITTEN, written_as
from ins.records import AXES, InputError, TableDocument
from ins.verdicts import differs
from recal.service.results.result import Result
from recal.service.tables import (
    AxisDifference,
    change_between,
    find_revision,
    line_of,
    need,
    open_tables,
)

ENDINGS = (".json", ".csv")  # of what is a file and no revision
NO_PARENT = "1970-01-01T00:00:00Z"  # a CSV holds no date
Unit = tuple[str | None, str | None, str | None]  # serial, technology, mode


@dataclass(frozen=True, kw_only=True)
class FileTable:
    """A table that was given as a file."""

    imu_serial: str
    gyro_technology: str
    gyro_mode: str
    file: str
    created_utc: str
    sha256: str
    parent_sha256: str | None
    table: ThermalTable = field(metadata=UNWRITTEN)


@dataclass(frozen=True, kw_only=True)
class Worth:
    """What the difference means to a free-inertial solution, over the temperatures that both
    tables hold: RMS length of the level gyros' difference, and of what is not known of it (1 sigma)
    [deg/h], and the drift of that [NM/h].

    sigma_of: the table that was made from the other, `before` or `after`, and so holds what that
    knew; else `both`, the two taken as independent.
    """

    temperature_degC: tuple[float, float]
    level_deg_h: float
    sigma_level_deg_h: float
    drift_nm_h: float
    sigma_drift_nm_h: float
    significant: bool
    sigma_of: str

    @property
    def text(self) -> str:
        """In one sentence."""
        low, high = self.temperature_degC
        said = (
            f"level gyros differ by {self.level_deg_h:.4f} +- {self.sigma_level_deg_h:.4f} deg/h"
            f" over {low:.0f} to {high:.0f} degC, a drift of {self.drift_nm_h:.2f} +-"
            f" {self.sigma_drift_nm_h:.2f} NM/h"
        )
        return said if self.significant else f"{said}: not different from zero"


@dataclass(frozen=True, kw_only=True)
class DiffDocument:
    """`recal.diff/1`; worth: None where the tables have no temperature in common."""

    schema: str = "recal.diff/1"
    from_: Revision | FileTable = field(metadata=written_as("from"))
    to: Revision | FileTable
    axes: Mapping[str, AxisDifference]
    worth: Worth | None


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class TableDifference(Result[DiffDocument]):
    """Two tables of one unit."""

    before: ThermalTable
    after: ThermalTable

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Both tables, what the difference is worth, and every node."""
        d = self.record
        lines = [
            unit_name(self.after),
            f"from {side_line(d.from_)}",
            f"to   {side_line(d.to)}",
            d.worth.text if d.worth else "no temperature in common: a drift cannot be compared",
            "",
            "axis  temperature     before      after     change  U(k=2) before    after",
            "             degC      deg/h      deg/h      deg/h          deg/h    deg/h",
        ]
        for axis, columns in d.axes.items():
            for T, old, new, change, s_old, s_new in zip(*vars(columns).values()):
                biases = f"{old:+10.5f} {new:+10.5f} {change:+10.5f}"
                bands = f"{2 * s_old:8.5f} {2 * s_new:8.5f}"
                lines.append(f"{axis:4}  {T:11.2f} {biases}       {bands}")
        return lines


def table_diff(
    before: str | Path, after: str | Path, store: str, unit: Unit = (None, None, None)
) -> TableDifference:
    """Two tables of one unit side by side.

    Parameters
    ----------
    before, after : str or path
        A table file (.json or .csv), or a revision of the store: a number, `factory`, `previous` or
        `active`.
    store : str
        SQLAlchemy URL; opened where a revision is named.
    unit : (str, str, str)
        Serial, technology and gyro mode where the store holds several units; a CSV is of the unit
        that the other table is of where these are None.

    Returns
    -------
    TableDifference
        Bias and sigma [deg/h] of both at the nodes of either, and the drift [NM/h] that the
        difference of the level gyros makes: 60 NM/h for each deg/h (physics.md 6.3).

    Raises
    ------
    InputError
        Where a file or revision is missing, or the tables are of different units.
    """
    names = str(before), str(after)
    found: dict[int, Revision | FileTable] = {}
    for k in sorted((0, 1), key=lambda k: names[k].endswith(".csv")):  # a CSV has no unit
        other = found.get(1 - k)
        wanted = unit if other is None else _filled(unit, other.table)
        if names[k].endswith(ENDINGS):
            found[k] = _file_table(Path(names[k]), wanted)
            continue
        with open_tables(store) as opened:
            found[k] = find_revision(opened, names[k], *wanted)
    old, new = found[0], found[1]
    units = [unit_name(side.table) for side in (old, new)]
    need(units[0] == units[1], f"{names[0]} is a table of {units[0]}, {names[1]} of {units[1]}")
    document = DiffDocument(
        from_=old,
        to=new,
        axes={axis: change_between(old, new, axis) for axis in AXES},
        worth=_worth(old, new, store),
    )
    return TableDifference(
        document, page=lambda: _page(document), before=old.table, after=new.table
    )


def unit_name(table: ThermalTable) -> str:
    """Serial, technology and mode."""
    mode = f", {table.gyro_mode}" if table.gyro_mode else ""
    return f"{table.imu_serial} ({table.gyro_technology}{mode})"


def side_line(side: Revision | FileTable) -> str:
    """A table in one line."""
    if isinstance(side, Revision):
        return line_of(side)
    return f"{side.file}  {side.created_utc}  {side.sha256[:12]}"


def _filled(unit: Unit, table: ThermalTable) -> Unit:
    """What was said of the unit, completed by the other table."""
    known = table.imu_serial, table.gyro_technology, table.gyro_mode
    serial, technology, mode = (a if a is not None else b for a, b in zip(unit, known))
    return serial, technology, mode


def _file_table(path: Path, unit: Unit) -> FileTable:
    serial, technology, mode = unit
    if path.suffix == ".csv":
        if serial is None or technology is None:
            raise InputError(f"{path}: serial and technology are not in it, needed both")
        data: TableDocument = read_table_csv(
            path,
            imu_serial=serial,
            gyro_technology=technology,
            gyro_mode=mode or "",
            created_utc=NO_PARENT,
        )
    else:
        data = read_table_dict(path)
    table = table_from_dict(data, name=str(path))
    return FileTable(
        imu_serial=table.imu_serial,
        gyro_technology=table.gyro_technology,
        gyro_mode=table.gyro_mode,
        file=str(path),
        created_utc="" if path.suffix == ".csv" else table.created_utc,
        sha256=table_sha256(data),
        parent_sha256=data.get("provenance", {}).get("parent_sha256"),
        table=table,
    )


def _worth(old: Revision | FileTable, new: Revision | FileTable, store: str) -> Worth | None:
    """The level gyros' difference over the temperatures that both tables hold."""
    spans: list[NDArray] = []
    for k in (0, 1):
        nodes = [side.table.temperature_degC[k] for side in (old, new)]
        low, high = max(n[0] for n in nodes), min(n[-1] for n in nodes)
        if high <= low:
            return None
        spans.append(drawn_temperatures(np.array([low, high])))
    both = spans[0], spans[1]
    change = level_change(old.table, new.table, both)
    left = change.left_deg_h
    before_left = level_change(new.table, old.table, both).left_deg_h
    if _descends(new, old, store):
        of = "after"
    elif _descends(old, new, store):
        of, left = "before", before_left
    else:
        of, left = "both", float(np.hypot(left, before_left))
    return Worth(
        temperature_degC=(float(min(T[0] for T in spans)), float(max(T[-1] for T in spans))),
        level_deg_h=change.level_deg_h,
        sigma_level_deg_h=left,
        drift_nm_h=change.drift_removed_nm_h,
        sigma_drift_nm_h=NM_H_PER_DEG_H * left,
        significant=differs(change.level_deg_h, left),
        sigma_of=of,
    )


def _descends(young: Revision | FileTable, old: Revision | FileTable, store: str) -> bool:
    """Whether a table was made from another one, by updates alone."""
    if young.sha256 == old.sha256 or not isinstance(young, Revision):
        return old.sha256 in (young.sha256, young.parent_sha256)
    unit = young.unit.imu_serial, young.unit.gyro_technology, young.unit.gyro_mode
    with open_tables(store) as opened:
        history = opened.history(*unit)
    for revision in reversed(history[: young.number]):
        if revision.sha256 == old.sha256:
            return True
        if revision.kind != "update":
            return False
    return False


def diff_panels(before: ThermalTable, after: ThermalTable, of: str) -> tuple[list[Panel], ...]:
    """Bias of both tables against temperature, a panel a gyro, and the change with twice its sigma,
    which is `of` the tables that Worth names.
    """
    sources = {"before": [before], "after": [after]}.get(of, [before, after])
    biases, changes = [], []
    for k, axis in enumerate(AXES):
        nodes = np.union1d(before.temperature_degC[k], after.temperature_degC[k])
        T = drawn_temperatures(nodes)
        pairs = ((before, "before", OLD), (after, "after", NEW))
        curves = [
            table_curve(name, T, table.bias_deg_h(k, T), table.sigma_deg_h(k, T), colour=colour)
            for table, name, colour in pairs
        ]
        biases.append(
            Panel(
                items=[*curves],
                title=f"Gyro {axis}",
                x_label=TEMPERATURE_AXIS,
                y_label=BIAS_AXIS,
                label=f"Bias of gyro {axis} against temperature, before and after",
                group="tables",
            )
        )
        change = curves[1].y - curves[0].y
        band = 2.0 * np.sqrt(sum(table.sigma_deg_h(k, T) ** 2 for table in sources))
        zero = Line(T[[0, -1]], np.zeros(2), GREY, width=0.8)
        changes.append(
            Panel(
                items=[
                    zero,
                    Line(T, change, BLACK, "change", low=change - band, high=change + band),
                ],
                title=f"Gyro {axis}: after less before",
                x_label=TEMPERATURE_AXIS,
                y_label="change [deg/h]",
                group="tables",
            )
        )
    return biases, changes


def _page(document: DiffDocument) -> str:
    of = "both" if document.worth is None else document.worth.sigma_of
    biases, changes = diff_panels(document.from_.table, document.to.table, of)
    return render_page(
        "table_diff.html.j2",
        d=document,
        unit=unit_name(document.to.table),
        sides=[("before", side_line(document.from_)), ("after", side_line(document.to))],
        biases=biases,
        changes=changes,
        sigmas=[s for c in document.axes.values() for s in c.sigma_after_deg_h.tolist()],
    )
