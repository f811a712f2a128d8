"""What lists of runs are read with: strict models, small texts, the head of a run."""

from pathlib import Path

from ins.json_file import (
    JsonObject,
    StrictModel,
    Written,
    parse,
    read_csv_rows,
    read_json_object,
    read_small_text,
    read_toml,
)
from ins.records import InputError, RunHeader
from trajectories.runs.schema import header_from_json

__all__ = [
    "JsonObject",
    "StrictModel",
    "Written",
    "parse",
    "read_csv_rows",
    "read_header",
    "read_json_object",
    "read_small_text",
    "read_toml",
]


def read_header(run: Path) -> RunHeader:
    """The run.json of a run directory; InputError with the first thing that is wrong with it."""
    name = run / "run.json"
    header, errors, _ = header_from_json(
        read_json_object(name, number=Written), name=f"{run}/run.json"
    )
    if header is None:
        raise InputError(errors[0])
    return header
