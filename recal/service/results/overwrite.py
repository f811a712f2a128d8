"""What a command may write over: its own earlier output, known by its schema. Anything else that is
there already stays, unless the user says --force.
"""

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from ins.records import InputError
from ins.user_input import open_regular, read_bounded
from recal.service.results.files import schema_name

MAX_PEEKED_BYTES = 200_000_000  # a result of a fleet has some 10 MB
MARKED_BYTES = 1000  # where a file says what it is
CSV_TABLE = "axis,temperature_degC,bias_deg_h,sigma_deg_h"
PARAMETERS = "from recal's table of"
TRUTH = "time_s,gyro_x_bias_deg_h"


@dataclass(frozen=True)
class Peeked:
    """What a JSON file says of its making; empty where it says nothing.

    source, source_sha256: of the log that a run was converted from; runs: hashes of those that a
    report names.
    """

    schema: str = ""
    simulated: bool = False
    compensated: bool = False
    source: str = ""
    source_sha256: str = ""
    runs: frozenset[str] = frozenset()


Own = Callable[[Peeked], bool]


def need_free_report(
    folder: Path, schema: str, others: Sequence[str] = (), *, name: str = "", force: bool = False
) -> None:
    """A folder may take a command's files: its `name` is of `schema`, or none of them is there, and
    it holds no run, of whose files results would be foreign ones.

    Parameters
    ----------
    folder : Path
        Where the command writes; need not exist.
    schema : str
        What the JSON document of the command says of itself.
    others : sequence of str
        What else the command writes there.
    name : str
        Of that document, where it is not that of its schema.
    force : bool
        Whether the user allows what exists to be written over.

    Raises
    ------
    InputError
        Names the first file in the way.
    """
    if force:
        return
    name = name or f"{schema_name(schema)}.json"
    document = folder / name
    if (folder / "run.json").exists():
        raise InputError(
            f"{folder}: holds a run, and results would lie between its files; name another folder"
            " (-o), or give --force"
        )
    if document.exists():
        if peeked(document).schema != schema:
            raise _refusal(document, f"no {schema} of an earlier call")
        return
    for other in others:
        if (folder / other).exists():
            raise _refusal(folder / other, f"no {name} of an earlier call lies beside it")


def keep_report(folder: Path, runs: Collection[str]) -> None:
    """A report of other runs that lies in a folder goes aside, before an update of runs with these
    hashes writes there: update.json and update.html become the next free update-1, update-2, ...

    Parameters
    ----------
    folder : Path
        Where the update writes.
    runs : collection of str
        SHA-256 of its runs.
    """
    document = folder / "update.json"
    if not document.exists() or peeked(document).runs == frozenset(runs):
        return
    number = next(k for k in count(1) if not any(folder.glob(f"update-{k}.*")))
    for written in (document, folder / "update.html"):
        if written.exists():
            written.rename(folder / f"update-{number}{written.suffix}")


def need_free_run(path: Path, own: Own, what: str, *, force: bool = False) -> None:
    """A run directory may be written: nothing is there, or a run that `own` knows by its run.json.

    InputError names the folder, with `what` the run would have to be.
    """
    if force or not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return
    header = path / "run.json"
    if not header.exists():
        return  # no run at all: the writer refuses it, also with --force
    if not own(peeked(header)):
        raise _refusal(path, f"it holds a recording, not {what}")


def need_free_file(path: Path, mark: str | None, *, force: bool = False) -> None:
    """A file may be written: nothing is there, or one that begins with `mark` or has it as schema.

    mark None: the file could be the user's own, so that nothing tells it from an earlier output.
    """
    if force or not path.exists():
        return
    if mark is None:
        raise _refusal(path, "it may be yours")
    if mark not in _head(path) and peeked(path).schema != mark:
        raise _refusal(path, f"no {mark!r} in it")


def is_simulated(found: Peeked) -> bool:
    """Whether a run.json says that the simulator made the run."""
    return found.simulated


def is_compensated(found: Peeked) -> bool:
    """Whether a run.json says that `recal thermal apply` made the run."""
    return found.compensated


def peeked(path: Path) -> Peeked:
    """What a JSON file says of its making."""
    try:
        data = json.loads(read_bounded(path, MAX_PEEKED_BYTES))
    except (OSError, ValueError, RecursionError):
        return Peeked()
    if not isinstance(data, dict):
        return Peeked()
    record = data.get("conversion")
    log = record if isinstance(record, dict) else {}
    named = data.get("runs")
    runs = [run for run in named if isinstance(run, dict)] if isinstance(named, list) else []
    return Peeked(
        schema=str(data.get("schema", "")),
        simulated=bool(data.get("simulation")),
        compensated=bool(data.get("removed_thermal_model") or data.get("gyro_level_removed")),
        source=str(log.get("source", "")),
        source_sha256=str(log.get("source_sha256", "")),
        runs=frozenset(str(run.get("sha256", "")) for run in runs),
    )


def _head(path: Path) -> str:
    try:
        with open_regular(path) as file:
            return file.read(MARKED_BYTES).decode("utf-8", "replace")
    except (OSError, ValueError):
        return ""


def _refusal(path: Path, why: str) -> InputError:
    return InputError(
        f"{path}: exists ({why}) and is not written over; name another place, or give --force"
    )


def need_other_file(written: Path, given: Path) -> None:
    """A file that the command reads is not one that it writes; InputError where it is."""
    if written.exists() and given.exists() and written.samefile(given):
        raise _refusal(written, "it is what this command reads")
