"""`twin fit`: the noise of a unit from its own parked logs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ins.documents import to_json
from ins.records import TwinModel
from ins.twin_file import default_twin, twin_to_dict
from recal.service.inputs.records import AnyRun, AnyTwin, runs_of
from recal.service.inputs.twin_table import TwinTable, twin_and_table
from recal.service.results.files import output_directory, program_version, write_files
from recal.service.results.paths import AnyPath
from recal.service.results.plots import figure_of
from recal.service.results.result import Result
from simreal.report.twin_document import (
    FitReport,
    fitted_twin,
    no_rest_document,
    summary,
    twin_fit_document,
)
from simreal.report.twin_page import allan_panels, twin_html
from simreal.twin.fit.fit import NoRest
from simreal.twin.fit.fit import fit_twin as fit_runs
from simreal.twin.fit.result import Parameter

if TYPE_CHECKING:
    from pandas import DataFrame
    from plotly.graph_objects import Figure

TWIN_NAME = "twin.json"
TWIN_FIT_STEPS = 2  # that `told` is told of beside the runs: the fit, the other sensors


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class FittedTwin(Result[FitReport]):
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
        return () if self.record.found is None else self.record.found.parameters

    def to_frame(self) -> "DataFrame":
        """The parameters as a pandas DataFrame, a row each."""
        from pandas import DataFrame

        return DataFrame([vars(p) for p in self.parameters])

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
        return summary(self.record)

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
    found = fit_runs(read, believed, beside.table, told)
    if isinstance(found, NoRest):
        serial = read[0].header.imu_serial
        return FittedTwin(no_rest_document(found, believed, serial, program_version()), twin=None)
    record = twin_fit_document(found, believed, program_version())
    twin = fitted_twin(found) if found.tells_any else None
    return FittedTwin(record, page=lambda: twin_html(record), twin=twin)
