"""What lists of runs are read with: strict models, small texts, the head of a run."""

from pathlib import Path

from ins.json_file import JsonObject as JsonObject
from ins.json_file import StrictModel as StrictModel
from ins.json_file import Written as Written
from ins.json_file import parse as parse
from ins.json_file import read_csv_rows as read_csv_rows
from ins.json_file import read_json_object as read_json_object
from ins.json_file import read_small_text as read_small_text
from ins.json_file import read_toml as read_toml
from ins.records import InputError, RunHeader
from trajectories.runs.limits import unpack_limit as unpack_limit
from trajectories.runs.schema import header_from_json


def read_header(run: Path) -> RunHeader:
    """The run.json of a run directory; InputError with the first thing that is wrong with it."""
    name = run / "run.json"
    header, errors, _ = header_from_json(
        read_json_object(name, number=Written), name=f"{run}/run.json"
    )
    if header is None:
        raise InputError(errors[0])
    return header
