"""`diagnose`: where simulator and logs disagree, which effect causes it, how the gap shrinks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

from infield.reports.documents.alignment import NoiseFit
from infield.table.file import json_text
from infield.table.thermal_table import ThermalTable
from ins.documents import to_json
from ins.records import InputError, Run, TwinModel
from recal.service.inputs.twin_table import TwinTable, twin_and_table
from recal.service.results.files import AnyPath, program_version
from recal.service.results.result import Result
from recal.service.twin.fit import noise_fit
from simreal.evidence.overlap import overlapping
from simreal.evidence.run_view import view_run
from simreal.inference import diagnosis as core
from simreal.inference.causes import Cause
from simreal.inference.diagnosis import Diagnosis, NotLookedAt
from simreal.plan.record_next import record_next, settling
from simreal.predict.document import PredictedUpdates
from simreal.predict.sessions import sessions_of
from simreal.report.diagnosis_curves import overlays
from simreal.report.diagnosis_document import (
    DiagnosisRequest,
    GapReport,
    diagnosis_document,
    refused_document,
    summary,
)
from simreal.report.diagnosis_page import diagnosis_html
from simreal.twin.fit.agreement import agreement
from simreal.twin.fit.streams import stream_at_rest
from simreal.twin.write_back import TABLE_NAME, twin_with_causes
from trajectories.runs import directory
from trajectories.runs.stream_files import HELD_ROWS

FEWEST_PREDICTED = 2  # 1 to predict, 1 to fit: tests/simreal/test_predict.py
DIAGNOSE_STEPS = core.DIAGNOSIS_STEPS + 2  # that `diagnose` tells of: reading and writing as well


@dataclass(frozen=True)
class FoundCause:
    """An effect that the logs show: its probability, and the share of the excess that goes with it
    on data it was not fitted to.
    """

    effect: str
    target: str
    probability: float
    shrink: float


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Diagnosed(Result[GapReport]):
    """The gap between simulator and logs; `files`: the twin with its causes, and its table."""

    FOLDER = "recal-diagnose"

    @property
    def gap_score(self) -> float:
        """Mean squared normalised residual over what the twin predicts; 1.0 is no gap."""
        score = self.record.gap.score
        return float("nan") if score is None else score

    @property
    def causes(self) -> tuple[FoundCause, ...]:
        """The effects found, the most probable first; shrink: NaN where no data judge it."""
        return tuple(_cause(c) for c in self.record.causes)

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Verdict, where the gap lies, its causes."""
        return summary(self.record)


def _cause(c: Cause) -> FoundCause:
    shrink = float("nan") if c.shrink is None else c.shrink.fraction
    return FoundCause(c.effect, c.target, c.probability, shrink)


def diagnose(
    runs: AnyPath | Sequence[AnyPath],
    twin: AnyPath,
    *,
    hold_out: Sequence[str] = (),
    alpha: float = 0.01,
    seed: int = 0,
    simulator: bool = False,
    told: Callable[[str], None] = lambda words: None,
) -> Diagnosed:
    """Where simulator and logs disagree, which effect causes it, how far the gap shrinks with it.

    Parameters
    ----------
    runs : path or several
        Run directories of one unit.
    twin : path
        Twin file: what the simulator believes; its table lies beside it.
    hold_out : sequence of str
        A run, by name or folder, that only judges how far the gap shrinks. May be repeated.
    alpha : float in [1e-4, 0.5]
        Share of diagnoses that may raise a false alarm.
    seed : int
        Of the random generator.
    simulator : bool
        Also predict the update of each run by a twin fitted to the others: drift, heading and NIS
        with what was found and without. Takes two updates more for each run; with --hold-out, only
        those runs are predicted.
    told : callable
        Told what is being done.

    Returns
    -------
    Diagnosed
        Verdict `no_gap`, `explained`, `partly_explained`, `unexplained` or `refused`; where the
        gap lies; causes with probability; `.write(folder)` also gives the twin with them.

    Raises
    ------
    InputError
        Where runs or twin cannot be read, or are of different units.

    Examples
    --------
    >>> import recal
    >>> recal.diagnose("nowhere", "nowhere.json")
    Traceback (most recent call last):
        ...
    ins.records.InputError: nowhere.json: no such file
    """
    paths = [Path(runs)] if isinstance(runs, str | PathLike) else [Path(run) for run in runs]
    if simulator and len(paths) < FEWEST_PREDICTED:
        raise InputError(
            f"--simulator: {len(paths)} run, needed {FEWEST_PREDICTED} or more: each is predicted"
            " by a fit to others"
        )
    believed, beside = twin_and_table(twin)
    told("reading the runs")
    rows = HELD_ROWS // len(paths)
    read = [
        overlapping(directory.read_run(path, held_rows=rows, dead_columns=True)) for path in paths
    ]
    loaded = [run for run, _ in read]
    notes = [note for _, left_out in read for note in left_out]
    _distinct(paths, loaded)
    held = [_run_id(name, paths, loaded) for name in hold_out]
    asked = DiagnosisRequest(
        version=program_version(),
        seed=seed,
        table_sha256=beside.sha256,
        hold_out=tuple(held),
        runs=tuple(map(str, paths)),
        notes=tuple(notes),
    )
    try:
        settings = core.DiagnosisSettings(alpha=alpha, seed=seed, hold_out=held, told=told)
        found = core.diagnose(
            loaded, believed, _table(beside, loaded, believed), settings, table_sha256=beside.sha256
        )
    except InputError:
        reasons = _unfit(loaded, believed, beside.table, beside.sha256)
        if reasons is None:
            raise
        record = refused_document(
            reasons, loaded, believed, version=program_version(), alpha=alpha, seed=seed
        )
        return _made(record, diagnosis_html(record), {})
    predicted = _predicted(loaded, beside, found, held, told) if simulator else None
    told("writing the report")
    return _results(found, loaded, beside, asked, predicted)


def _predicted(
    runs: list[Run],
    beside: TwinTable,
    found: Diagnosis,
    held: Sequence[str],
    told: Callable[[str], None],
) -> PredictedUpdates:
    """What the twin predicts of updates of runs that it was not fitted to."""
    from simreal.predict.document import simulator_record
    from simreal.predict.held_out import predict_runs

    table = _table(beside, runs, found.twin)
    return simulator_record(predict_runs(runs, found, table, held, told))


def _table(beside: TwinTable, runs: Sequence[Run], twin: TwinModel) -> ThermalTable:
    """The twin's; without one zero, as uncertain as a raw unit's biases are: what such a table
    leaves open is no effect that a unit must have beyond its bias and its thermal curve.
    """
    # with the store and the updates' estimators behind them: half a second of CPU
    from recal.service.inputs.unit_inputs import table_of_unknown_unit

    return beside.table or table_of_unknown_unit(runs[0], twin)


def _results(
    found: Diagnosis,
    runs: list[Run],
    beside: TwinTable,
    asked: DiagnosisRequest,
    predicted: PredictedUpdates | None,
) -> Diagnosed:
    """The diagnosis, and all files by name."""
    drift, users = sessions_of(found)
    settled_by = settling(found, beside.table)
    record = replace(
        diagnosis_document(found, runs, asked, settled_by=settled_by),
        user_level=users,
        expected_drift=drift,
        record_next=tuple(record_next(found, settled_by)),
        noise_fit=_noise_fit(found, beside, asked),
        simulator=predicted,
    )
    with_table = beside.data is not None
    names = [v.name for v in found.views]
    twin = twin_with_causes(found.twin, found.causes, names, with_table=with_table)
    files = {"twin.json": to_json(twin)}
    if beside.data is not None:
        files[TABLE_NAME] = json_text(beside.data) + "\n"
    return _made(record, diagnosis_html(record, overlays(found)), files)


def _noise_fit(found: Diagnosis, beside: TwinTable, asked: DiagnosisRequest) -> NoiseFit | None:
    """Whether the twin's noise fits the parked stretches."""
    streams = [
        stream_at_rest(v.run, found.twin, beside.table, rest=(v.start_s, v.end_s))
        for v in found.views
    ]
    at_rest = [stream for stream in streams if stream is not None]
    return noise_fit(agreement(at_rest, found.twin) if at_rest else None, asked.runs)


def _made(record: GapReport, page: str, files: dict[str, str]) -> Diagnosed:
    return Diagnosed(record, page=lambda: page, files=files)


def _distinct(paths: list[Path], runs: list[Run]) -> None:
    """InputError where two runs go by one id: events and held-out runs are told by it."""
    seen: dict[str, Path] = {}
    for path, run in zip(paths, runs):
        if run.header.run_id in seen:
            raise InputError(
                f"{path}: run_id {run.header.run_id} is that of {seen[run.header.run_id]} too,"
                " needed one each: recal convert LOG --run-id NAME gives it, or run_id in run.json"
            )
        seen[run.header.run_id] = path


def _run_id(name: str, paths: list[Path], runs: list[Run]) -> str:
    """The id of a run to hold out, given by id or directory."""
    for path, run in zip(paths, runs):
        if name == run.header.run_id or Path(name).resolve() == path.resolve():
            return str(run.header.run_id)
    raise InputError(
        f"--hold-out {name}: not among the runs {', '.join(r.header.run_id for r in runs)}"
    )


def _unfit(
    runs: list[Run], twin: TwinModel, table: ThermalTable | None, sha256: str
) -> list[NotLookedAt] | None:
    """Why no run can be looked at, by run id; None where one can, or is of another unit: then the
    input is bad.
    """
    reasons = []
    for k, run in enumerate(runs):
        header = run.header
        if (twin.imu_serial or header.imu_serial, twin.gyro_technology) != (
            header.imu_serial,
            header.gyro_technology,
        ):
            return None
        view = view_run(run, k, table, twin, table_sha256=sha256)
        if not isinstance(view, str):
            return None
        reasons.append(NotLookedAt(header.run_id, view))
    return reasons
