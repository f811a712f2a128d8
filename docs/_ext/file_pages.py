"""The reference of every file, from the models that check them: names, types, bounds and defaults
as the code has them.
"""

import dataclasses
import typing
from collections.abc import Sequence
from typing import Any

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from api_pages import PACKAGES, modules
from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from result_keys import documents

import trajectories.runs.schema as run_schema
from infield.table import file as table_file
from ins import twin_file
from ins.errors.reference import words_page
from recal.service.inputs import config
from trajectories.readers.rows import column_map
from trajectories.simulator import scenario
from trajectories.simulator.environments.kinds import Environment, EnvironmentKind
from trajectories.simulator.segments import SEGMENTS
from trajectories.simulator.thermal import ThermalHistory
from trajectories.simulator.truth_file import TruthSection
from trajectories.simulator.vehicle import EVENTS

HEAD = ["| key | type | needed or default |", "|---|---|---|"]
BOUNDS = {
    Ge: ("ge", ">="),
    Gt: ("gt", ">"),
    Le: ("le", "<="),
    Lt: ("lt", "<"),
    MinLen: ("min_length", "length >="),
    MaxLen: ("max_length", "length <="),
}


def file_pages() -> dict[str, str]:
    """Markdown by page name."""
    pages = {
        "run": _run(),
        "table": _table(),
        "twin": _twin(),
        "scenario": _scenario(),
        "column_map": _map(),
        "settings": _settings(),
        "effects": words_page(),
        "results": _results(),
    }
    return {"index": _index(pages), **pages}


def _index(pages: dict[str, str]) -> str:
    rules = (
        "UTF-8, float64; the unit is in the name of each column and key; times are `time_s`,"
        " seconds from the run's `start_utc`, strictly increasing; body axes are x forward, y"
        " right, z down; a missing value is NaN (CSV: empty)."
    )
    names = "\n".join(pages)
    made = "Made from the models that check them, when this site was built."
    return f"# Files\n\n{made}\n\n{rules}\n\n```{{toctree}}\n\n{names}\n```\n"


def _run() -> str:
    lines = [
        "# A run",
        "",
        "One power-on session, as a directory.",
        "",
        "## run.json",
        "",
        f"`schema`: `{run_schema.SCHEMA}`",
        "",
    ]
    lines += [*HEAD, *_model_rows(run_schema._RunKeys), "", "## Streams", ""]
    lines += [
        "Each is `.parquet`, `.csv` or `.csv.gz`; `imu` is required.",
        "",
        "| stream | columns | optional |",
        "|---|---|---|",
    ]
    lines.append(f"| imu | {_names(('time_s', *run_schema.INCREMENT_COLUMNS))} (increments) | |")
    lines.append(f"| imu | {_names(('time_s', *run_schema.RATE_COLUMNS))} (rates) | |")
    for stream, columns in run_schema.REQUIRED.items():
        lines.append(
            f"| {stream} | {_names(columns)} | {_names(run_schema.OPTIONAL.get(stream, ()))} |"
        )
    return "\n".join(
        [*lines, "", "`reference` is truth: it scores, no estimator ever reads it.", ""]
    )


def _table() -> str:
    lines = [
        "# A thermal bias table",
        "",
        f"`schema`: `{table_file.SCHEMA}`. {_first(table_file.table_sha256)}",
        "",
    ]
    lines += [*HEAD, *_model_rows(table_file._Table), "", "## As CSV", ""]
    columns = (
        f"Columns {_names(table_file.CSV_COLUMNS)}; a hermite table adds"
        f" `{table_file.SLOPE_COLUMN}`."
    )
    lines.append(f"{columns} The covariance is not in a CSV.")
    return "\n".join([*lines, ""])


def _twin() -> str:
    lines = [
        "# A twin",
        "",
        "What the simulator believes about one installation.",
        "",
        f"`schema`: `{twin_file.SCHEMA}`",
        "",
    ]
    nominal, mems = twin_file.default_twin("rlg"), twin_file.default_twin("mems")
    lines += ["| key | default (rlg, fog) | default (mems) |", "|---|---|---|"]
    lines += [
        f"| `{k}` | {getattr(nominal, k) or ''} | |"
        for k in ("imu_serial", "gyro_technology", "table")
    ]
    for section in twin_file.TWIN_SECTIONS:
        a, b = getattr(nominal, section), getattr(mems, section)
        for f in dataclasses.fields(a):
            lines.append(
                f"| `{section}.{f.name}` | {_value(getattr(a, f.name))} |"
                f" {_value(getattr(b, f.name))} |"
            )
    lines += [
        "",
        "Each item of `effects` (the names: [effects](effects.md)):",
        "",
        *HEAD,
        *_model_rows(twin_file._Effect),
    ]
    return "\n".join([*lines, ""])


def _scenario() -> str:
    lines = [
        "# A scenario",
        "",
        (
            f"What `recal simulate` takes (TOML). `schema`: `{scenario.SCENARIO_SCHEMA}`. An"
            " unknown key is an error."
        ),
        "",
    ]
    lines += [
        "Packaged: " + _names(scenario.packaged_scenarios()) + ".",
        "",
        "## Top level",
        "",
        *HEAD,
        *_record_rows(scenario._Head),
    ]
    for name, section in scenario.SECTIONS.items():
        lines += ["", f"## [{name}]", "", *_doc(section), *HEAD, *_record_rows(section)]
    lines += [
        "",
        "## [thermal]",
        "",
        *_doc(ThermalHistory),
        "`start`: " + _names([*scenario.STARTS, "chamber"]) + "; any field replaces its value.",
        "",
    ]
    lines += [*HEAD, *_record_rows(ThermalHistory)]
    lines += [
        "",
        "## [truth]",
        "",
        *_doc(TruthSection),
        "Instead of `[site]`, `[attitude]` and `[[motion]]`.",
        "",
    ]
    lines += [*HEAD, *_record_rows(TruthSection)]
    lines += ["", "## [environment] or [[environment]]", "", *_doc(Environment)]
    lines += ["`kind`: " + _names([kind.value for kind in EnvironmentKind]) + ".", ""]
    lines += [*HEAD, *_record_rows(Environment)]
    for title, kinds, key in (
        ("[[motion]]", SEGMENTS, "segment"),
        ("[[disturbance]]", EVENTS, "event"),
    ):
        lines += ["", f"## {title}", ""]
        for name, kind in kinds.items():
            lines += [f'### {key} = "{name}"', "", *_doc(kind), *HEAD, *_record_rows(kind), ""]
    return "\n".join([*lines, ""])


def _map() -> str:
    units = {
        "time": column_map.TIME_UNITS,
        "gyro, rates": column_map.GYRO_RATES,
        "gyro, increments": column_map.GYRO_INCREMENTS,
        "accel, rates": column_map.ACCEL_RATES,
        "accel, increments": column_map.ACCEL_INCREMENTS,
        "temperature": column_map.CELSIUS,
    }
    lines = [
        "# A column map",
        "",
        "What the columns of a foreign log mean (TOML), for `recal convert --map`.",
        "",
    ]
    lines += [*HEAD, *_model_rows(column_map.ColumnMap), "", "| units of | |", "|---|---|"]
    return "\n".join(
        [*lines, *(f"| {name} | {_names(known)} |" for name, known in units.items()), ""]
    )


def _settings() -> str:
    lines = [
        "# Settings of an update",
        "",
        "What `recal update --config` takes (TOML); what is not given keeps its default.",
        "",
    ]
    for name, kind in config.CONFIG_SECTIONS.items():
        rows = _record_rows(kind, config.setting_names(kind))
        lines += [f"## [{name}]", "", *_doc(kind), *HEAD, *rows, ""]
    return "\n".join(lines)


def _results() -> str:
    lines = [
        "# Results",
        "",
        (
            "Keys of each result, as its record or the function that makes it has them (`--json`"
            " prints the same). In brackets stands the unit of a number, or what the key holds; 1"
            " is a ratio, a probability or a normalised sum. After # stands what a part is."
        ),
        "",
    ]
    for found in documents(
        {name: path for package in PACKAGES for name, path in _sources(package).items()}
    ):
        lines += [
            f"## {found.schema}",
            "",
            f"Made by `{found.function}`.",
            "",
            f"```text\n{found.tree}\n```",
            "",
        ]
    return "\n".join(lines)


def _sources(package: str) -> dict[str, Any]:
    """Modules of a package, those of commands too."""
    from api_pages import ROOT

    commands = sorted((ROOT / package / "cli").glob("*.py")) if package == "recal" else []
    return modules(package) | {f"recal.cli.{p.stem}": p for p in commands}


def _model_rows(model: type[BaseModel], prefix: str = "") -> list[str]:
    """One row a key, nested models after their key, dotted."""
    rows = []
    for name, field in model.model_fields.items():
        inner = _model_in(field.annotation)
        default = "needed" if field.is_required() else _default_of(field, nested=inner is not None)
        rows.append(
            f"| `{prefix}{name}` | {_type(field.annotation)}{_bounds(field.metadata)} | {default} |"
        )
        if inner is not None:
            rows += _model_rows(inner, f"{prefix}{name}.")
    return rows


def _model_in(hint: Any) -> type[BaseModel] | None:
    candidates = [hint, *typing.get_args(hint)]
    return next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None)


def _default_of(field: Any, *, nested: bool) -> str:
    if field.default_factory is not None:
        value = field.default_factory()
        return _value(value) if value else ""
    return "" if field.default is PydanticUndefined or nested else _value(field.default)


def _record_rows(kind: type, names: Sequence[str] | None = None) -> list[str]:
    """A line for each field of a record, or for those of these names."""
    hints = typing.get_type_hints(kind)
    return [
        f"| `{f.name}` | {_type(hints[f.name])} | {_record_default(f)} |"
        for f in dataclasses.fields(kind)
        if names is None or f.name in names
    ]


def _record_default(f: Any) -> str:
    if f.default is not dataclasses.MISSING:
        return _value(f.default)
    return _value(f.default_factory()) if f.default_factory is not dataclasses.MISSING else "needed"


def _type(hint: Any) -> str:
    """A type in words of the file's format."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return _type(args[0]) + _bounds(args[1:])
    if origin is typing.Literal:
        return " or ".join(f"`{a}`" for a in args)
    if origin in (list, tuple):
        many = f"{len(args)} of " if origin is tuple and Ellipsis not in args else "list of "
        return many + _type(args[0])
    if origin is dict or hint is dict:
        return "keys"
    if args:
        return " or ".join(_type(a) for a in args)
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return "keys"
    return {
        str: "text",
        float: "number",
        int: "whole number",
        bool: "true or false",
        type(None): "null",
    }.get(hint, "any")


def _bounds(metadata: Any) -> str:
    found = [
        f"{BOUNDS[type(m)][1]} {getattr(m, BOUNDS[type(m)][0]):g}"
        for m in metadata
        if type(m) in BOUNDS
    ]
    return f" ({', '.join(found)})" if found else ""


def _value(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, BaseModel) or dataclasses.is_dataclass(value):
        return ""
    return f"{value:g}" if isinstance(value, float) else f"`{value}`" if value != "" else '`""`'


def _names(names: Any) -> str:
    return " ".join(f"`{n}`" for n in names)


def _doc(kind: type) -> list[str]:
    """The record's own docstring, as text; not the one that dataclass writes."""
    doc = kind.__doc__ or ""
    return (
        []
        if not doc or doc.startswith(f"{kind.__name__}(")
        else ["```text", "\n".join(line.strip() for line in doc.strip().splitlines()), "```", ""]
    )


def _first(function: Any) -> str:
    return (function.__doc__ or "").split("\n")[0]
