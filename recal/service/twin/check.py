"""`twin check`: does the noise of a twin fit runs; and the same in one line for the other verbs."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from alignment.motion.stillness import Motion
from infield.session.log import find_rest
from infield.session.results import UpdateResult
from infield.table.thermal_table import ThermalTable
from ins.records import InputError, Run, TwinModel
from recal.service.inputs.records import AnyRun, AnyTwin, runs_of, twin_of
from recal.service.inputs.twin_table import twin_table
from recal.service.inputs.unit_inputs import twin_fit_command
from recal.service.results.files import program_version
from recal.service.results.result import Result
from simreal.report.twin_check_document import agreement_line, summary, twin_check_document
from simreal.report.twin_records import TwinCheckRecord
from simreal.twin.fit.agreement import agreement
from simreal.twin.fit.streams import Stream, stream_at_rest, stream_of


@dataclass(frozen=True, repr=False, eq=False)
class CheckedTwin(Result[TwinCheckRecord]):
    """Whether a twin's noise fits runs: verdict `ok`, `inconsistent`, or `refused` where the runs
    hold too little rest.
    """

    def lines(self, *, verbose: bool = False) -> list[str]:
        """The headline, and every band that does not fit."""
        return summary(self.record, verbose=verbose)


def check_twin(runs: AnyRun | Sequence[AnyRun], twin: AnyTwin) -> CheckedTwin:
    """Does the noise that a twin declares fit what runs show at rest?

    Parameters
    ----------
    runs : Run or path, or several
        Power-on sessions of one unit.
    twin : TwinModel or path
        With the table beside its file taken out.

    Returns
    -------
    CheckedTwin
        Per channel and band the size of the noise over the declared one, with p-values; the verdict
        is over all of them together.

    Raises
    ------
    InputError
        Where an input cannot be read, or twin and runs are of different units.
    """
    read = runs_of(runs)
    record = twin_of(twin)
    table = twin_table(Path(twin), record).table if isinstance(twin, str | PathLike) else None
    streams: list[Stream] = []
    for run in read:
        header = run.header
        for key in ("imu_serial", "gyro_technology"):
            declared, own = getattr(record, key), getattr(header, key)
            if declared and declared != own:
                raise InputError(
                    f"{record.source}: {key} {declared}, run {header.run_id} has {own}"
                )
        stream = stream_of(run, record, table)
        if stream is not None:
            streams.append(stream)
    given = [runs] if isinstance(runs, Run | str | PathLike) else list(runs)
    document = twin_check_document(
        agreement(streams, record),
        record,
        [run.header.run_id for run in read],
        command=twin_fit_command(given),
        version=program_version(),
    )
    return CheckedTwin(document)


def update_agreement(result: UpdateResult, runs: Sequence[AnyRun]) -> str | None:
    """In one line whether the noise model fits the runs of an update, at the rest that its sessions
    found; None where they hold too little.
    """
    streams = []
    for session in result.sessions:
        estimate = session.estimate
        if estimate is None:
            continue
        stream = stream_at_rest(session.run, result.twin, result.before, motion=estimate.motion)
        if stream is not None:
            streams.append(stream)
    return _line(streams, result.twin, runs)


def rest_agreement(
    run: Run,
    twin: TwinModel,
    table: ThermalTable | None,
    runs: Sequence[AnyRun],
    *,
    motion: Motion | None = None,
) -> str | None:
    """The same for one run at its first rest, or at the rest of a motion."""
    rest = find_rest(run) if motion is None else None
    stream = stream_at_rest(run, twin, table, motion=motion, rest=rest)
    return _line([] if stream is None else [stream], twin, runs)


def _line(streams: Sequence[Stream], twin: TwinModel, runs: Sequence[AnyRun]) -> str | None:
    found = agreement(streams, twin) if streams else None
    return None if found is None else agreement_line(found, twin_fit_command(runs))
