"""`twin check`: does the noise of a twin fit runs; and the same in one line for the other verbs."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike

from ins.records import Run
from recal.service.inputs.records import AnyRun, AnyTwin, runs_of, twin_fit_command
from recal.service.inputs.twin_table import twin_and_table
from recal.service.results.files import program_version
from recal.service.results.result import Result
from simreal.report.twin_check_document import TwinCheck, summary, twin_check_document
from simreal.twin.fit.agreement import agreement
from simreal.twin.fit.streams import stream_of


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
    record, beside = twin_and_table(twin, read)
    streams = [s for run in read if (s := stream_of(run, record, beside.table)) is not None]
    given = [runs] if isinstance(runs, Run | str | PathLike) else list(runs)
    document = twin_check_document(
        agreement(streams, record),
        record,
        [run.header.run_id for run in read],
        command=twin_fit_command(given),
        version=program_version(),
    )
    return CheckedTwin(document)
