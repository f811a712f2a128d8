"""Runs, tables and twins as records: given, or read from the path that is given."""

import shlex
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from infield.table.file import read_table_dict, table_from_dict, table_to_dict
from infield.table.thermal_table import ThermalTable
from ins.records import InputError, Run, TableDocument, TwinModel
from ins.twin_file import read_twin as read_twin_file
from recal.service.results.files import AnyPath
from trajectories.runs import directory
from trajectories.runs.stream_files import HELD_ROWS

AnyRun = Run | AnyPath
AnyTable = ThermalTable | TableDocument | AnyPath
AnyTwin = TwinModel | AnyPath


def read_table(path: AnyPath) -> ThermalTable:
    """A thermal bias table from its JSON file.

    Parameters
    ----------
    path : str or path
        A file of schema `recal.table/1`.

    Returns
    -------
    ThermalTable
        Gyro bias [deg/h] against temperature [degC] per axis, what the gyro reads above the truth,
        with its covariance.

    Raises
    ------
    InputError
        Names the file and the key.

    Examples
    --------
    >>> import recal
    >>> recal.read_table("nowhere.json")
    Traceback (most recent call last):
        ...
    ins.records.InputError: nowhere.json: no such file
    """
    return table_from_dict(read_table_dict(Path(path)), name=str(path))


def read_twin(path: AnyPath) -> TwinModel:
    """A twin: the noise model of one installation, from its JSON file.

    Parameters
    ----------
    path : str or path
        A file of schema `recal.twin/1`.

    Returns
    -------
    TwinModel
        Noise terms in the units of their names (deg/sqrt(h), deg/h, micro-g ...).

    Raises
    ------
    InputError
        Names the file and the key.

    Examples
    --------
    >>> import recal
    >>> recal.read_twin("nowhere.json")
    Traceback (most recent call last):
        ...
    ins.records.InputError: nowhere.json: no such file
    """
    return read_twin_file(Path(path))


def runs_of(runs: AnyRun | Sequence[AnyRun]) -> list[Run]:
    """One run or several, each a record or a path, as records; long ones stay in their files."""
    given = [runs] if isinstance(runs, Run | str | PathLike) else list(runs)
    if not given:
        raise InputError("runs: none was given, needed at least one")
    rows = HELD_ROWS // len(given)
    return [
        run if isinstance(run, Run) else directory.read_run(Path(run), held_rows=rows)
        for run in given
    ]


def read_one(run: AnyRun) -> Run:
    """A run, a record or a path, as record."""
    return run if isinstance(run, Run) else directory.read_run(Path(run))


def table_of(table: AnyTable) -> tuple[ThermalTable, TableDocument]:
    """A table as record and as its JSON holds it, whose hash is the table's."""
    if isinstance(table, ThermalTable):
        return table, table_to_dict(table)
    if isinstance(table, str | PathLike):
        data = read_table_dict(Path(table))
        return table_from_dict(data, name=str(table)), data
    return table_from_dict(table, name="table"), table


def twin_of(twin: AnyTwin) -> TwinModel:
    """A twin as record."""
    return twin if isinstance(twin, TwinModel) else read_twin(twin)


def twin_fit_command(runs: Sequence[AnyRun]) -> str:
    """The command that measures the noise of a unit from its runs, as a reader may copy it."""
    named = [shlex.quote(str(run)) for run in runs if not isinstance(run, Run)]
    return f"recal twin fit {' '.join(named) or 'RUN...'} -o twin.json"
