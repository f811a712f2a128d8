"""What `recal thermal rlg` and `fog` read: several runs of one unit, and its noise model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recal.cli.console import Command

if TYPE_CHECKING:
    from ins.records import Run, TwinModel


class ManyRuns(Command):
    """`--fast A B --slow C` means `--fast A --fast B --slow C`."""

    MANY = ("--fast", "--slow", "--check")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Each further word after one of MANY belongs to it."""
        spread: list[str] = []
        option, filled = "", False
        for word in args:
            if word.startswith("-"):
                option, filled = word if word in self.MANY else "", False
            elif option and filled:
                spread.append(option)
            else:
                filled = bool(option)
            spread.append(word)
        return super().parse_args(ctx, spread)


def runs_of_one_unit(paths: Sequence[Path], technology: str) -> Iterator[Run]:
    """One run in memory at a time; InputError for one given twice, of another unit or another
    technology.
    """
    from ins.records import InputError
    from trajectories.runs.directory import read_run

    seen: dict[str, str] = {}
    serial = ""
    for path in paths:
        run = read_run(path)
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
        seen[run.sha256], serial = str(path), run.header.imu_serial
        yield run


def reduced_groups(
    groups: Sequence[Sequence[Path]],
    technology: str,
    reduce: Callable[[Run, TwinModel], Any],
    store_url: str,
    twin_path: Path | None,
) -> tuple[list[list[Any]], TwinModel]:
    """Each run reduced, by group, and the unit's noise model."""
    twin: TwinModel | None = None
    found: list[Any] = []
    for run in runs_of_one_unit([path for group in groups for path in group], technology):
        twin = twin or noise_model(run, store_url, twin_path)
        found.append(reduce(run, twin))
    assert twin is not None  # the first group is required
    rest = iter(found)
    return [[next(rest) for _ in group] for group in groups], twin


def noise_model(run: Run, store_url: str, twin_path: Path | None) -> TwinModel:
    """The noise model from --twin, else from the store, else the defaults of the technology."""
    from ins.records import InputError
    from ins.twin_file import default_twin, read_twin

    header = run.header
    if twin_path is not None:
        twin = read_twin(twin_path)
        if twin.gyro_technology != header.gyro_technology or twin.imu_serial not in (
            "",
            header.imu_serial,
        ):
            raise InputError(
                f"{twin_path}: is of {twin.gyro_technology} unit {twin.imu_serial or '(any)'}, run"
                f" {header.run_id} of {header.gyro_technology} unit {header.imu_serial}"
            )
        return twin
    return _stored_twin(run, store_url) or default_twin(header.gyro_technology)


def _stored_twin(run: Run, store_url: str) -> TwinModel | None:
    from infield.store.table_store import TableStore, UnknownUnit, store_exists

    header = run.header
    if not store_exists(store_url):
        return None
    try:
        with TableStore.open(store_url, create=False) as opened:
            return opened.twin(header.imu_serial, header.gyro_technology, header.gyro_mode)
    except UnknownUnit:
        return None
