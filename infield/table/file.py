"""Thermal tables as files: `recal.table/1` JSON and CSV (formats.md, section 2), and their content
hash.

Floats are written as Python's shortest repr, so what is read back has the same bits.
"""

import csv
import hashlib
import io
import json
import re
import shlex
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal, TypedDict, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from infield.table.thermal_table import ThermalTable, prior_covariance
from ins.json_file import (
    JsonObject,
    StrictModel,
    complaints,
    read_csv_rows,
    read_json_object,
    without_schema,
)
from ins.records import AXES, AxisDocument, InputError, TableDocument

SCHEMA = "recal.table/1"
CSV_COLUMNS = ("axis", "temperature_degC", "bias_deg_h", "sigma_deg_h")
SLOPE_COLUMN = "slope_deg_h_degC"  # a fifth CSV column, hermite tables only
PLAUSIBLE_NODES_degC = (-100.0, 200.0)  # beyond: kelvin, or another unit; 20 degC are 293 K
# relative: sigma_deg_h may be the root of the covariance's diagonal rounded to two digits after
# the leading one (0.5 %), not another number
SIGMA_AGREES = 0.02


# of a bias or its sigma [deg/h], beyond what the technology makes: a table in another unit
PLAUSIBLE_DEG_H = {"rlg": 10.0, "fog": 100.0, "mems": 20_000.0}


class _Axis(StrictModel):
    temperature_degC: list[float]
    bias_deg_h: list[float]
    sigma_deg_h: list[float]
    slope_deg_h_degC: list[float] | None = None


class _Axes(StrictModel):
    x: _Axis
    y: _Axis
    z: _Axis


class _Table(StrictModel):
    imu_serial: str = Field(min_length=1)
    gyro_technology: Literal["rlg", "fog", "mems"]
    gyro_mode: str = ""
    created_utc: str
    interpolation: Literal["linear", "hermite"]
    axes: _Axes
    covariance: list[list[float]] | None = None
    provenance: dict[str, Any] = Field(default_factory=dict)


def table_sha256(table: TableDocument) -> str:
    """SHA-256 of a table's content: canonical JSON, every number as float (formats.md, section
    2).
    """
    return hashlib.sha256(canonical_json(table).encode()).hexdigest()


def canonical_json(table: TableDocument) -> str:
    """The one text of a table that is hashed and stored."""
    return json.dumps(_floats(table), sort_keys=True, separators=(",", ":"))


def table_from_dict(data: TableDocument, *, name: str) -> ThermalTable:
    """The table in a plain dict; `name` (its file) begins each error line.  InputError names the
    key.
    """
    body = without_schema(cast(JsonObject, data), SCHEMA, name=name)
    try:
        model = _Table.model_validate(body)
    except ValidationError as error:
        lines = complaints(error, _Table, name=name)
        raise InputError(
            next((line for line in lines if "unknown key" in line), lines[0])
        ) from None
    try:
        return _table(model)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def implausible_size(table: TableDocument) -> str | None:
    """What is larger in a checked table than its technology makes it: key, value, what was needed.
    None where nothing is.
    """
    technology = table["gyro_technology"]
    limit = PLAUSIBLE_DEG_H[technology]
    for axis, nodes in table["axes"].items():
        for key in ("bias_deg_h", "sigma_deg_h"):
            largest = max(nodes[key], key=abs)
            if abs(largest) > limit:
                return (
                    f"axes.{axis}.{key}: got {largest:g}, needed within {limit:g} for {technology}"
                )
    return None


def table_to_dict(table: ThermalTable) -> TableDocument:
    """The plain dict of formats.md section 2, the covariance in full, sigma being the root of its
    diagonal.
    """
    sigma = np.sqrt(np.maximum(np.diag(table.covariance), 0.0))
    axes: dict[str, AxisDocument] = {}
    for axis, nodes in zip(AXES, table.temperature_degC):
        values = table.values_of(axis)
        axes[axis] = {
            "temperature_degC": nodes.tolist(),
            "bias_deg_h": table.parameters[values].tolist(),
            "sigma_deg_h": sigma[values].tolist(),
        }
        if table.interpolation == "hermite":
            axes[axis]["slope_deg_h_degC"] = table.parameters[table.slopes_of(axis)].tolist()
    return {
        "schema": SCHEMA,
        "imu_serial": table.imu_serial,
        "gyro_technology": table.gyro_technology,
        **_mode(table.gyro_mode),
        "created_utc": table.created_utc,
        "interpolation": table.interpolation,
        "axes": axes,
        "covariance": table.covariance.tolist(),
        "provenance": {"parent_sha256": None, "runs": [], **table.provenance},
    }


class _Mode(TypedDict, total=False):
    gyro_mode: str


def _mode(gyro_mode: str) -> _Mode:
    """The key of the mode, where there is one."""
    return {"gyro_mode": gyro_mode} if gyro_mode else {}


def checked_table(data: JsonObject, *, name: str) -> TableDocument:
    """The table document that a plain object is, as written. InputError names the key."""
    document = cast(TableDocument, data)
    table_from_dict(document, name=name)
    return document


def read_table_dict(path: Path) -> TableDocument:
    """The document of a JSON table file, checked, as written: hash this one. InputError names file
    and key.
    """
    return checked_table(read_json_object(Path(path)), name=str(path))


def json_text(table: TableDocument) -> str:
    """A table's JSON for people and files: lists of numbers on one line."""
    text = json.dumps(_floats(table), indent=1)
    return re.sub(
        r"\[\n[\s\d.eE+,\-]*\]",
        lambda m: " ".join(m[0].split()).replace("[ ", "[").replace(" ]", "]"),
        text,
    )


def csv_text(table: ThermalTable) -> str:
    """The CSV form: node values and sigmas (and slopes, where hermite); covariances are not in
    it.
    """
    hermite, out = table.interpolation == "hermite", io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow([*CSV_COLUMNS, SLOPE_COLUMN] if hermite else CSV_COLUMNS)
    for axis, of_axis in table_to_dict(table)["axes"].items():
        columns = [of_axis["temperature_degC"], of_axis["bias_deg_h"], of_axis["sigma_deg_h"]]
        columns += [of_axis["slope_deg_h_degC"]] if hermite else []
        rows.writerows([axis, *map(repr, row)] for row in zip(*columns))
    return out.getvalue()


def read_table_csv(
    path: Path, *, imu_serial: str, gyro_technology: str, created_utc: str, gyro_mode: str = ""
) -> TableDocument:
    """The document (covariance null) of a CSV table. InputError names file, line and column."""
    path = Path(path)
    rows = read_csv_rows(path)
    header = [h.strip() for h in rows[0][1]] if rows else []
    columns = (*CSV_COLUMNS, SLOPE_COLUMN) if SLOPE_COLUMN in header else CSV_COLUMNS
    if sorted(header) != sorted(columns):
        raise InputError(
            f"{path}: line 1: columns {','.join(header)[:120]!r}, needed {','.join(CSV_COLUMNS)!r}"
        )
    axes: dict[str, dict[str, list[float]]] = {axis: {c: [] for c in columns[1:]} for axis in AXES}
    for number, row in rows[1:]:
        _add_row(
            axes,
            dict(zip(header, row)),
            width=len(row),
            needed=columns,
            where=f"{path}: line {number}",
        )
    document: TableDocument = {
        "schema": SCHEMA,
        "imu_serial": imu_serial,
        "gyro_technology": gyro_technology,
        **_mode(gyro_mode),
        "created_utc": created_utc,
        "interpolation": "hermite" if SLOPE_COLUMN in columns else "linear",
        "axes": cast(dict[str, AxisDocument], axes),
        "covariance": None,
        "provenance": {"parent_sha256": None, "runs": []},
    }
    table_from_dict(document, name=str(path))
    return document


def export_command(store: str | None, imu_serial: str) -> str:
    """What writes the table in use to a file, quoted for the shell;
    a server's password comes from the environment.
    """
    named = f" --store {shlex.quote(store.replace(':***@', '@'))}" if store else ""
    return f"recal table export{named} --serial {shlex.quote(imu_serial)} -o table.json"


def utc(text: str, *, name: str) -> datetime:
    """A time in ISO 8601, UTC (`Z`, `+00:00` or nothing); InputError names the key."""
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(
            f"{name}: got {text[:60]!r}, needed ISO 8601 UTC like 2026-03-01T05:00:00Z"
        ) from None
    if when.utcoffset() not in (None, timedelta(0)):
        raise InputError(f"{name}: got {text[:60]!r}, needed UTC")
    return when.replace(tzinfo=UTC)


def _table(model: _Table) -> ThermalTable:
    utc(model.created_utc, name="created_utc")
    hermite = model.interpolation == "hermite"
    axes = [getattr(model.axes, axis) for axis in AXES]
    for axis, columns in zip(AXES, axes):
        _check_axis(axis, columns, hermite=hermite)
    x, y, z = (np.array(a.temperature_degC) for a in axes)
    sx, sy, sz = (np.array(a.sigma_deg_h) for a in axes)
    slopes = [a.slope_deg_h_degC for a in axes] if hermite else []
    beta = np.concatenate([np.array(v) for v in [a.bias_deg_h for a in axes] + slopes])
    if model.covariance is None:
        P = prior_covariance((x, y, z), (sx, sy, sz), hermite=hermite)
    else:
        P = _given_covariance(model.covariance, beta.size, np.concatenate((sx, sy, sz)))
    return ThermalTable(
        imu_serial=model.imu_serial,
        gyro_technology=model.gyro_technology,
        gyro_mode=model.gyro_mode,
        created_utc=model.created_utc,
        interpolation=model.interpolation,
        temperature_degC=(x, y, z),
        parameters=beta,
        covariance=P,
        provenance=model.provenance,
    )


def _check_axis(axis: str, columns: _Axis, *, hermite: bool) -> None:
    key, T = f"axes.{axis}", columns.temperature_degC
    if hermite != (columns.slope_deg_h_degC is not None):
        raise InputError(
            f"{key}.{SLOPE_COLUMN}: {'missing' if hermite else 'given'}, needed with hermite only"
        )
    for name, values in columns:
        if values is not None and len(values) != len(T):
            raise InputError(
                f"{key}.{name}: {len(values)} values, needed {len(T)} as in temperature_degC"
            )
    if len(T) < 2:
        raise InputError(f"{key}.temperature_degC: {len(T)} values, needed at least 2")
    if min(T) < PLAUSIBLE_NODES_degC[0] or max(T) > PLAUSIBLE_NODES_degC[1]:
        raise InputError(
            f"{key}.temperature_degC: {min(T):g} to {max(T):g}, needed -100 to 200 degC: wrong"
            " unit?"
        )
    for k, step in enumerate(np.diff(T), start=1):
        if step <= 0:
            raise InputError(
                f"{key}.temperature_degC[{k}]: {T[k]!r} after {T[k - 1]!r}, needed strictly"
                " increasing"
            )
    if min(columns.sigma_deg_h) < 0:
        raise InputError(
            f"{key}.sigma_deg_h: got {min(columns.sigma_deg_h)!r}, needed none below 0"
        )


def _given_covariance(rows: list[list[float]], n: int, sigma: NDArray) -> NDArray:
    if len(rows) != n or any(len(row) != n for row in rows):
        widths = sorted({len(row) for row in rows})
        raise InputError(
            f"covariance: {len(rows)} rows of {widths}, needed {n} by {n} for the nodes given"
        )
    P = np.array(rows)
    diagonal = np.sqrt(np.maximum(np.diag(P)[: sigma.size], 0.0))
    wrong = np.flatnonzero(np.abs(diagonal - sigma) > SIGMA_AGREES * np.maximum(diagonal, sigma))
    if wrong.size:
        k = int(wrong[0])
        raise InputError(
            f"covariance[{k}][{k}]: sigma {diagonal[k]:.6g}, but sigma_deg_h says {sigma[k]:.6g}"
            " deg/h"
        )
    return P


def _add_row(
    axes: dict[str, dict[str, list[float]]],
    cells: dict[str, str],
    *,
    width: int,
    needed: tuple[str, ...],
    where: str,
) -> None:
    if width != len(needed):
        raise InputError(f"{where}: {width} cells, needed {len(needed)}")
    axis = cells["axis"].strip()
    if axis not in AXES:
        raise InputError(f"{where}: axis {axis[:20]!r}, needed x, y or z")
    for column in needed[1:]:
        try:
            value = float(cells[column])
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise InputError(
                f"{where}: {column}: got {cells[column][:40]!r}, needed a finite number"
            )
        axes[axis][column].append(value)


def _floats(value: Any) -> Any:
    """The same tree with every int a float; bools, text and null as they are."""
    if isinstance(value, Mapping):
        return {k: _floats(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_floats(v) for v in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value
