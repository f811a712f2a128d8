"""`twin check`: does the noise of a twin fit runs; and the same in one line for the other verbs."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from ins.records import InputError, Run
from recal.service.inputs.records import AnyRun, AnyTwin, runs_of, twin_fit_command, twin_of
from recal.service.inputs.twin_table import twin_table
from recal.service.results.files import program_version
from recal.service.results.result import Result
from simreal.report.twin_check_document import TwinCheck, summary, twin_check_document
from simreal.twin.fit.agreement import agreement
from simreal.twin.fit.streams import ParkedStream, stream_of


@dataclass(frozen=True, repr=False, eq=False)
class CheckedTwin(Result[TwinCheck]):
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
    streams: list[ParkedStream] = []
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
