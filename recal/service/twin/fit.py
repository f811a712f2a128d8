"""`twin fit` and `twin check`: the noise of a unit from its own parked logs, and whether a noise
model fits them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from infield.reports.documents.alignment import NoiseFit
from infield.session.log import find_rest
from infield.table.thermal_table import ThermalTable
from ins.documents import to_json
from ins.records import Run, TwinModel
from ins.twin_file import default_twin, twin_to_dict
from recal.service.inputs.records import AnyRun, AnyTwin, runs_of, twin_fit_command
from recal.service.inputs.twin_table import TwinTable, twin_and_table
from recal.service.results.files import AnyPath, output_directory, program_version, write_files
from recal.service.results.plots import figure_of
from recal.service.results.result import Result
from simreal.report.twin_check_document import TwinCheck, agreement_line, twin_check_document
from simreal.report.twin_check_document import summary as check_summary
from simreal.report.twin_page import allan_panels, twin_html
from simreal.twin.fit.agreement import Agreement, agreement
from simreal.twin.fit.fit import fit_twin as fit_runs
from simreal.twin.fit.result import Parameter, TwinFit, fitted_twin
from simreal.twin.fit.streams import stream_at_rest, stream_of

if TYPE_CHECKING:
    from pandas import DataFrame
    from plotly.graph_objects import Figure

    from infield.session.results import UpdateResult  # the estimators of updates behind it

TWIN_NAME = "twin.json"
TWIN_FIT_STEPS = 2  # that `told` is told of beside the runs: the fit, the other sensors


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class FittedTwin(Result[TwinFit]):
    """A twin fitted to runs.

    Parameters
    ----------
    twin : TwinModel or None
        The fitted twin with its `fit`; None where the runs tell none of its numbers.
    """

    twin: TwinModel | None

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter with value, sigma, 95 % interval, and whether the runs tell it."""
        return self.record.parameters

    def to_frame(self) -> "DataFrame":
        """The parameters as a pandas DataFrame, a row each."""
        from pandas import DataFrame

        rows = [{**vars(p), "identified": p.identified} for p in self.parameters]
        return DataFrame(rows)

    def plot(self) -> "Figure":
        """Allan deviation of each channel, of the data and of the fitted model with its band.

        Returns
        -------
        plotly.graph_objects.Figure
            A notebook shows it; `.write_html(path)` writes it.
        """
        return figure_of(allan_panels(self.record))

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Each parameter with its sigma, or why it cannot be told."""
        d, of = self.record, len(self.record.parameters)
        known, runs = sum(p.identified for p in d.parameters), len(d.runs)
        because = [f"  because {why}" for why in d.reasons]
        if not d.parameters:
            return [f"{d.twin.imu_serial}: {d.verdict}", *because]
        lines = [
            f"{d.twin.imu_serial}: {d.verdict} from {runs} run{'s' if runs > 1 else ''},"
            f" {d.parked_s / 3600.0:.2g} h at rest: {known} of {of} parameters estimated",
            *because,
        ]
        for p in d.parameters:
            lacks = f"; {p.lacks}" if p.lacks else ""
            tail = "" if p.identified else f" (not observable in these runs{lacks})"
            lines.append(f"  {p.words:28s}{p.size_words}{tail}")
        return [*lines, *(f"  note: {note}" for note in d.notes)]

    def write(self, output: AnyPath | None = None) -> Path:
        """Write twin.json, twin_fit.json and twin.html to a directory (else `recal-twin`), or,
        where the path ends in .json, the twin there and the others beside it; returns the twin's
        path.
        """
        twin = twin_path(output)
        files = {twin.with_name(f"{twin.stem}_fit.json"): self.to_json()}
        if self.page is not None:
            files[twin.with_suffix(".html")] = self.page()
        if self.twin is not None:
            files[twin] = to_json(twin_to_dict(self.twin))
        write_files(files)
        return twin


def twin_path(output: AnyPath | None) -> Path:
    """Where a twin is to be written; its folder is made."""
    path = None if output is None else Path(output)
    if path is not None and path.suffix == ".json":
        output_directory(path.parent, "twin")
        return path
    return output_directory(path, "twin") / TWIN_NAME


def write_twin(twin: TwinModel, output: AnyPath | None) -> Path:
    """Write a twin alone; returns its path."""
    path = twin_path(output)
    write_files({path: to_json(twin_to_dict(twin))})
    return path


def fit_twin(
    runs: AnyRun | Sequence[AnyRun],
    start: AnyTwin | None = None,
    *,
    told: Callable[[str], None] = lambda words: None,
) -> FittedTwin:
    """The noise of a unit from what its sensors do at rest.

    Parameters
    ----------
    runs : Run or path, or several
        Run directories of one unit, parked.
    start : TwinModel or path, optional
        Twin to begin with. Its numbers are kept where the runs tell nothing. Default: that of the
        technology.
    told : callable
        Told what is being done: a step for each run, and TWIN_FIT_STEPS more.

    Returns
    -------
    FittedTwin
        Verdict `fitted`, or `refused` where no run rests, or what rests tells none of the numbers;
        `.twin`; `.parameters` with sigmas; what cannot be told, and the recording that would tell
        it.

    Raises
    ------
    InputError
        Where an input cannot be read, or the runs are of different units.

    Examples
    --------
    >>> import recal
    >>> simulated = recal.simulate("parked_only", seed=7, rate_hz=10)
    >>> fitted = recal.fit_twin(simulated.run)
    >>> fitted.verdict, abs(fitted.twin.gyro.arw_deg_sqrt_h / 0.002 - 1) < 0.02
    ('fitted', True)
    """
    read = runs_of(runs)
    believed, beside = (
        (default_twin(read[0].header.gyro_technology), TwinTable())
        if start is None
        else twin_and_table(start, read)
    )
    found = replace(fit_runs(read, believed, beside.table, told), version=program_version())
    if not found.parameters:
        return FittedTwin(found, twin=None)
    twin = fitted_twin(found) if found.tells_any else None
    return FittedTwin(found, page=lambda: twin_html(found), twin=twin)


@dataclass(frozen=True, repr=False, eq=False)
class CheckedTwin(Result[TwinCheck]):
    """Whether a twin's noise fits runs: verdict `ok`, `inconsistent`, or `refused` where the runs
    hold too little rest.
    """

    def lines(self, *, verbose: bool = False) -> list[str]:
        """The headline, and every band that does not fit."""
        return check_summary(self.record, verbose=verbose)


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


def update_agreement(result: "UpdateResult") -> Agreement | None:
    """The noise model against the rest that the sessions of an update found; None where that is too
    little.
    """
    streams = []
    for session in result.sessions:
        if session.estimate is None:
            continue
        motion = session.estimate.motion
        stream = stream_at_rest(
            session.run, result.twin, result.before, motion=motion, temperature=session.temperature
        )
        if stream is not None:
            streams.append(stream)
    return agreement(streams, result.twin) if streams else None


def fit_at_rest(
    run: Run, twin: TwinModel, table: ThermalTable | None, given: Sequence[AnyRun]
) -> NoiseFit | None:
    """The noise model against the first rest of a run."""
    rest = find_rest(run)
    stream = None if rest is None else stream_at_rest(run, twin, table, rest=rest)
    return noise_fit(None if stream is None else agreement([stream], twin), given)


def noise_fit(found: Agreement | None, given: Sequence[AnyRun]) -> NoiseFit | None:
    """What a document says of an agreement; given: the runs, for the command."""
    if found is None:
        return None
    text = agreement_line(found, twin_fit_command(given))
    return NoiseFit(fits=found.fits, p_value=found.p_value, text=text)
