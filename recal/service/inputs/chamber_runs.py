"""What the chamber fits read: several runs of one unit, one in memory at a time, and its noise."""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from infield.store.table_store import TableStore, UnknownUnit
from ins.records import InputError, Run, TwinModel
from ins.twin_file import default_twin
from recal.service.inputs.records import AnyRun, AnyTwin, read_one, twin_of
from recal.service.inputs.twin_table import twin_of_unit
from recal.service.inputs.unit_inputs import opened

T = TypeVar("T")


def runs_of_one_unit(given: Sequence[AnyRun], technology: str) -> Iterator[Run]:
    """One run in memory at a time; InputError for one given twice, of another unit or another
    technology.
    """
    seen: dict[str, str] = {}
    serial = ""
    for item in given:
        run = read_one(item)
        path = run.header.run_id if isinstance(item, Run) else str(item)
        if run.sha256 in seen:
            raise InputError(f"{path}: the same run as {seen[run.sha256]}, needed another one")
        if run.header.removed_model is not None:
            raise InputError(
                f"{path}: run.json: removed_thermal_model is set, needed raw gyro output"
            )
        if run.header.gyro_technology != technology:
            raise InputError(
                f"{path}: run.json: gyro_technology {run.header.gyro_technology!r}, needed"
                f" {technology!r}"
            )
        if serial and run.header.imu_serial != serial:
            raise InputError(
                f"{path}: run.json: imu_serial {run.header.imu_serial!r}, needed {serial!r} (first"
                " run)"
            )
        seen[run.sha256] = path
        serial = run.header.imu_serial
        yield run


def reduced_groups(
    groups: Sequence[Sequence[AnyRun]],
    technology: str,
    reduce: Callable[[Run, TwinModel], T],
    store: TableStore | str | None,
    twin: AnyTwin | None,
    told: Callable[[str], None] = lambda words: None,
) -> tuple[list[list[T]], TwinModel]:
    """Each run reduced, by group, and the unit's noise model; told: of each run as it is begun."""
    model: TwinModel | None = None
    found: list[T] = []
    for run in runs_of_one_unit([run for group in groups for run in group], technology):
        told(f"reducing {run.header.run_id}")
        model = model or noise_model(run, store, twin)
        found.append(reduce(run, model))
    if model is None:
        raise InputError("runs: none was given, needed at least one")
    rest = iter(found)
    return [[next(rest) for _ in group] for group in groups], model


def noise_model(run: Run, store: TableStore | str | None, given: AnyTwin | None) -> TwinModel:
    """The noise model that is given, else from the store, else the defaults of the technology."""
    header = run.header
    if given is not None:
        return twin_of_unit(twin_of(given), run)
    return _stored_twin(run, opened(store)) or default_twin(header.gyro_technology)


def _stored_twin(run: Run, store: TableStore | None) -> TwinModel | None:
    header = run.header
    if store is None:
        return None
    try:
        return store.twin(header.imu_serial, header.gyro_technology, header.gyro_mode)
    except UnknownUnit:
        return None
