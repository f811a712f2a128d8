"""`update`: recalibrate a unit's thermal table from its runs, from memory alone or with a store.

`update` gives a result and stores nothing. `update_in_store` is what `recal update` and a fleet do:
table and report together or neither.
"""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from os import PathLike
from pathlib import Path

from infield.learning.parameters import ageing_of
from infield.reports import update_page
from infield.reports.documents.update import effects_compared, update_document
from infield.reports.documents.update_records import RunDocument, UpdateDocument
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.points import AxisObservability
from infield.session.reasons import SessionReason
from infield.session.results import UpdateResult
from infield.session.settings import SessionSettings
from infield.store.database import require_folder, store_name
from infield.store.errors import StoreConflict, StoreRefused
from infield.store.rows import unit_of_table
from infield.store.table_store import MergedRun, Revision, TableStore
from infield.table.file import table_sha256
from infield.table.thermal_table import AgeingModel, ThermalTable
from ins.documents import to_json
from ins.records import InputError, Run, TwinModel
from ins.verdicts import Outcome, because, sentence, sentences
from recal.service.inputs.config import read_config
from recal.service.inputs.new_units import known_marks, refuse_store, require_unit
from recal.service.inputs.records import AnyRun, AnyTable, AnyTwin, runs_of
from recal.service.inputs.twin_table import without_found_effects
from recal.service.inputs.unit_inputs import (
    UnitInputs,
    given_unit,
    open_store,
    opened,
    unit_inputs,
    with_thermal_model,
)
from recal.service.priors.use import APPROVED, priors_in_use, settings_of, with_priors
from recal.service.results.files import AnyPath, output_directory, program_version, write_files
from recal.service.results.overwrite import keep_report
from recal.service.results.result import Result
from recal.service.results.update_summary import Points, summary
from recal.service.twin.fit import noise_fit, update_agreement

UPDATE_STEPS = 3  # that `step` is told of
Files = Callable[[UpdateDocument], dict[Path, str]]  # its JSON, and HTML where wanted


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Update(Result[UpdateDocument]):
    """A judged update of one unit's table.

    Parameters
    ----------
    estimate : UpdateResult
        What the estimator found, session by session.
    unit : UnitInputs
        Table and noise model that it began with.
    """

    estimate: UpdateResult
    unit: UnitInputs

    @property
    def table_before(self) -> ThermalTable:
        """The table that the update began with."""
        return self.estimate.before

    @property
    def table(self) -> ThermalTable:
        """The recalibrated table; the one before where nothing was merged."""
        return self.estimate.after

    @property
    def axes(self) -> Mapping[str, AxisObservability]:
        """Per gyro: sigma of the session's mean bias before and after [deg/h], and its verdict."""
        return self.record.observability

    @property
    def points(self) -> Points:
        """The bias points; `.to_frame()` gives a pandas DataFrame."""
        return Points(tuple(self.record.points))

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Verdict, reasons, per axis sigma before and after, heading error, effect."""
        return summary(self.record, verbose=verbose)

    def plot(self):
        """Bias against temperature per gyro: table before, table after, points.

        Returns
        -------
        plotly.graph_objects.Figure
            A notebook shows it; `.write_html(path)` writes it.
        """
        from recal.service.results.plots import figure_of, update_panels

        return figure_of(update_panels(self.table_before, self.table, self.points))


def update(
    runs: AnyRun | Sequence[AnyRun],
    table: AnyTable | None = None,
    twin: AnyTwin | None = None,
    *,
    store: TableStore | str | None = None,
    config: AnyPath | None = None,
    thermal_model: AnyPath | None = None,
    accept_step: bool = False,
) -> Update:
    """Recalibrate one unit's thermal table from its runs; stores nothing.

    Parameters
    ----------
    runs : Run or path, or several
        Power-on sessions of one unit, taken in the order of their start.
    table : ThermalTable or path, optional
        The table to begin with, bias [deg/h] against temperature [degC] per axis; else the
        store's, else bias 0 with the sigma of the technology.
    twin : TwinModel or path, optional
        Noise model; else the store's, else the defaults of the technology.
    store : str or TableStore, optional
        Looked in for the table, the noise model, approved priors of the technology, and the runs
        that the table holds already; give it where the result is to be committed to a store that
        knows the unit.
    config : path, optional
        Settings (TOML), sections session, flight and ageing.
    thermal_model : path, optional
        A fitted thermal_rlg.json or thermal_fog.json, taken out of the log first.
    accept_step : bool
        Follow a step of the unit that several sessions agree on.

    Returns
    -------
    Update
        Verdict `proposed`, `refused` or `inconsistent` with reasons; table before and after; bias
        points [deg/h]; per axis sigma before and after. A refusal is a result.

    Raises
    ------
    InputError
        Where an input cannot be read, or the inputs are of different units.

    Examples
    --------
    >>> import recal
    >>> simulated = recal.simulate("parked_only", seed=7, rate_hz=10)
    >>> result = recal.update(simulated.run, simulated.table, simulated.twin)
    >>> result.verdict, sorted(result.axes)
    ('proposed', ['x', 'y', 'z'])

    Notes
    -----
    Source: US 5,527,003; what is estimated and judged: physics.md, section 6.
    """
    settings, ageing = read_config(None if config is None else Path(config))
    read = runs_of(runs)
    database = opened(store)
    given = given_unit(read[0], table, twin, database)
    model = None if thermal_model is None else Path(thermal_model)
    job = _Job(
        settings=settings,
        ageing=ageing,
        accept_step=accept_step,
        thermal_model=model,
        given=[runs] if isinstance(runs, Run | str | PathLike) else runs,
    )
    return _made(*_estimate(read, given, database, job))


@dataclass(frozen=True, kw_only=True)
class UpdateRequest:
    """An update with a store.

    Parameters
    ----------
    runs : sequence of Run or path
        Run directories of one unit.
    store_url : str
        SQLAlchemy URL of the store.
    commit : bool
        Store the new table. Default: only report it.
    propose : (str, str), optional
        Who proposes and their note: the new table is kept for review, the active one stays.
    store_named : bool
        The user named the store, and is told where it is not there.
    new_store, new_unit : bool
        A store that is not there is made, a unit that the store does not hold begins with the
        default of its technology; else either is refused.
    accept_step : bool
        Follow a step of the unit's bias that several sessions agree on.
    priors : str
        `approved` (those of the store), `default`, or a file that `recal fleet learn` wrote.
    html : bool
        Whether to write update.html.
    retry : int in [0, 99]
        How often to estimate again where another writer was faster.
    keep_earlier : bool
        Whether a report of other runs that lies in the folder is kept, as update-1, update-2, ...
    told, step : callable
        Told of what happens on the way; told as each of the UPDATE_STEPS begins.
    """

    runs: Sequence[AnyRun]
    store_url: str
    commit: bool = False
    propose: tuple[str, str] | None = None
    store_named: bool = False
    new_store: bool = False
    new_unit: bool = False
    accept_step: bool = False
    twin: AnyTwin | None = None
    config: Path | None = None
    priors: str = APPROVED
    thermal_model: Path | None = None
    output: Path | None = None
    html: bool = True
    retry: int = 0
    any_clock: bool = False
    keep_earlier: bool = False
    told: Callable[[str], None] = field(default=lambda line: None)
    step: Callable[[str], None] = field(default=lambda words: None)


def update_in_store(request: UpdateRequest) -> Update:
    """Read, estimate, judge, merge, report, commit or keep for review.

    Where another writer commits while this estimates, it is estimated again from the runs and the
    table that is active then, at most `retry` times; then it is refused.
    """
    require_folder(request.store_url)
    settings, ageing = read_config(request.config)
    job = _Job(
        settings=settings,
        ageing=ageing,
        accept_step=request.accept_step,
        thermal_model=request.thermal_model,
        priors=request.priors,
        given=request.runs,
    )
    request.step(f"reading {_counted(request.runs)}")
    loaded = runs_of(list(request.runs))
    kept_by = [run.sha256 for run in loaded] if request.keep_earlier else None
    folder = output_directory(request.output, "update")
    files = partial(_files, folder, html=request.html, runs=kept_by)
    lost: list[str] = []
    while True:
        try:
            return _Try(request, job, files, tuple(lost)).run(loaded)
        except StoreConflict as conflict:
            if len(lost) == request.retry:
                raise
            lost.append(str(conflict))
            request.told(
                f"another writer was faster ({conflict}): estimating again, {len(lost)} of"
                f" {request.retry}"
            )


def _counted(runs: Sequence[AnyRun]) -> str:
    return f"{len(runs)} run{'s' * (len(runs) != 1)}"


@dataclass(frozen=True, kw_only=True)
class _Job:
    """How to estimate; given: the runs as they were named."""

    settings: SessionSettings
    ageing: AgeingModel
    accept_step: bool
    thermal_model: Path | None
    given: Sequence[AnyRun]
    priors: str = APPROVED


def _estimate(
    runs: list[Run], unit: UnitInputs, database: TableStore | None, job: _Job
) -> tuple[UpdateResult, UnitInputs, UpdateDocument]:
    """One estimate against the unit's table as given, and what is said of it."""
    priors = priors_in_use(job.priors, database, unit)
    if priors is not None:
        unit = with_priors(unit, priors)
        job = replace(job, settings=settings_of(priors, job.settings))
        if job.ageing == AgeingModel():
            job = replace(job, ageing=ageing_of(priors.parameters))
    unit, runs, use = with_thermal_model(unit, runs, job.thermal_model)
    less, twin, effects = without_found_effects(runs, unit.twin, unit.table)

    def updated(given: list[Run], believed: TwinModel) -> UpdateResult:
        return update_calibration(
            given,
            unit.table,
            believed,
            history=_history(unit, database),
            settings=job.settings,
            ageing=job.ageing,
            accept_step=job.accept_step,
        )

    result = updated(less, twin)
    compared = None if effects is None else effects_compared(result, updated(runs, unit.twin))
    unit = replace(unit, twin=twin)
    document = replace(
        _document(result, unit, job.given),
        store=database.name if database else None,
        thermal_model=use(result.after),
        noise_fit=noise_fit(update_agreement(result), job.given),
        priors=priors,
        found_effects=effects,
        effects_compared=compared,
    )
    return result, unit, document


def _history(unit: UnitInputs, database: TableStore | None) -> UnitHistory:
    """What the store, where there is one, has on record of a unit."""
    parent, now = table_sha256(unit.table_dict), datetime.now(UTC)
    if database is None:
        return UnitHistory(parent_sha256=parent, now=now)
    serial = unit.table.imu_serial
    return UnitHistory(
        parent_sha256=parent,
        already_merged=lambda sha256: database.has_run(sha256, serial),
        applied_table=lambda sha256: database.by_sha256(sha256).table,
        remembered=database.contradictions(*_key(unit)) if unit.revision else (),
        marks=known_marks(database, unit_of_table(unit.table)) if unit.revision else (),
        now=now,
    )


def _document(result: UpdateResult, unit: UnitInputs, given: Sequence[AnyRun]) -> UpdateDocument:
    """The update document, and what its noise model rests on."""
    note = unit.noise_note(given)
    new = unit.new_unit_notes([session.run for session in result.sessions])
    document = update_document(result, version=program_version(), table_before=unit.table_dict)
    return replace(
        document,
        new_unit=sentences(new) or None,
        assumptions=[*sentences(new), *document.assumptions],
        noise_source=unit.noise_source,
        noise_note=None if note is None else sentence(note),
    )


def _made(result: UpdateResult, unit: UnitInputs, document: UpdateDocument) -> Update:
    return Update(
        document, page=lambda: update_page.update_html(document), estimate=result, unit=unit
    )


@dataclass(frozen=True)
class _Try:
    """One estimate against the table that is active now, and what becomes of it."""

    request: UpdateRequest
    job: _Job
    files: Files
    lost: tuple[str, ...]

    def run(self, runs: list[Run]) -> Update:
        """Raises StoreConflict where another writer beat the commit and tries are left."""
        request = self.request
        database = open_store(request.store_url)
        unit = unit_inputs(runs[0], database, request.twin)
        if request.commit or request.propose:
            key = unit_of_table(unit.table)
            try:
                if database is None and not request.new_store:
                    refuse_store(request.store_url, key)
                if not request.new_unit:
                    require_unit(database, key)
            except StoreRefused as error:
                return self._not_begun(runs, unit, error)
        if database is None and request.store_named and not request.new_store:
            name, serial = store_name(request.store_url), unit.table.imu_serial
            request.told(f"no store at {name}: the update knows no table of {serial}")
        request.step(f"estimating from {_counted(runs)}")
        result, unit, document = _estimate(runs, unit, database, self.job)
        request.step("drawing the report")
        document = replace(document, conflicts=self.lost or None)
        if request.commit and result.outcome is Outcome.ACCEPTED:
            return _made(result, unit, self._commit(result, unit, document))
        if request.propose and result.outcome is Outcome.ACCEPTED:
            return _made(result, unit, self._propose(result, unit, document, request.propose))
        stores = request.commit or request.propose
        if stores and result.outcome is Outcome.INCONSISTENT and unit.revision and result.evidence:
            document = replace(document, remembered=self._remember(result, unit))
        write_files(self.files(document))
        return _made(result, unit, document)

    def _not_begun(self, runs: list[Run], unit: UnitInputs, error: StoreRefused) -> Update:
        """An update that is refused before anything is estimated, with its report."""
        job, table = self.job, unit.table
        nothing = UpdateResult(
            Outcome.REFUSED, (), table, table, (), unit.twin, job.settings, job.ageing
        )
        document = replace(
            _turned_down(_document(nothing, unit, job.given), error),
            store=store_name(self.request.store_url),
            runs=[RunDocument(run_id=run.header.run_id, sha256=run.sha256) for run in runs],
        )
        write_files(self.files(document))
        return _made(nothing, unit, document)

    def _remember(self, result: UpdateResult, unit: UnitInputs) -> str:
        """Keep what the contradicting sessions said, the table untouched; where the store cannot be
        written, say so.
        """
        try:
            database = open_store(self.request.store_url, create=True)
            assert database is not None
            count = database.remember_contradictions(*_key(unit), result.evidence)
        except (InputError, StoreConflict) as error:
            return f"not remembered for the next update: {error}"
        return (
            f"{count} contradicting session{'s' if count != 1 else ''} remembered; the table is as"
            " it was"
        )

    def _commit(
        self, result: UpdateResult, unit: UnitInputs, document: UpdateDocument
    ) -> UpdateDocument:
        """Report and table together or neither: the report is staged, the store commits, the report
        takes its place.

        Where another writer (and no try is left) or an earlier merge stands in the way: refused,
        with the reason. Where the store cannot be written the report stays, as a proposal that says
        so, and InputError is raised.
        """
        url = self.request.store_url
        proposed, made = replace(document, store=store_name(url)), list[Revision]()
        committed = replace(proposed, verdict=Outcome.COMMITTED)
        try:
            database = open_store(url, create=True, any_clock=self.request.any_clock)
            assert database is not None
            numbered = _numbered(committed, unit, (unit.revision or 1) + 1)
            write_files(
                self.files(numbered),
                commit=lambda: made.append(commit_update(database, result, unit, committed)),
            )
            # somebody rolled back to the same table meanwhile
            if made[0].number != numbered.revision:
                numbered = _numbered(committed, unit, made[0].number)
                write_files(self.files(numbered))
            return numbered
        except StoreRefused as error:
            if isinstance(error, StoreConflict) and len(self.lost) < self.request.retry:
                raise
            document = _turned_down(proposed, error)
            write_files(self.files(document))
            return document
        except InputError as error:
            if made:
                self.request.told(f"committed as revision {made[0].number}, but {error}")
                return _numbered(committed, unit, made[0].number)
            why = because(SessionReason.NOT_COMMITTED, fault=str(error))
            said = replace(proposed, reasons=[sentence(why)], reason_codes=[str(why.code)])
            write_files(self.files(said))
            raise

    def _propose(
        self,
        result: UpdateResult,
        unit: UnitInputs,
        document: UpdateDocument,
        signed: tuple[str, str],
    ) -> UpdateDocument:
        """Keep the update in the store for review, then write the report with its number; refused
        where a commit would be.
        """
        database = open_store(self.request.store_url, create=True)
        assert database is not None
        document = replace(document, store=database.name)
        try:
            kept = database.propose(
                table_sha256(unit.table_dict),
                result.after,
                merged_runs(result),
                to_json(document),
                first_table=None if unit.revision else unit.table_dict,
                by=signed[0],
                note=signed[1],
            )
            document = replace(document, proposal=kept.number)
        except StoreRefused as error:
            document = _turned_down(document, error)
        write_files(self.files(document))
        return document


def _turned_down(document: UpdateDocument, error: StoreRefused) -> UpdateDocument:
    """The document of an update that the store does not take, and why."""
    return replace(
        document, verdict=Outcome.REFUSED, reasons=[str(error)], reason_codes=[str(error.code)]
    )


def commit_update(
    database: TableStore,
    result: UpdateResult,
    unit: UnitInputs,
    document: UpdateDocument,
    note: str = "",
) -> Revision:
    """The merged table becomes the active one; a unit that the store does not hold begins with its
    table before.
    """
    return database.commit_update(
        table_sha256(unit.table_dict),
        result.after,
        merged_runs(result),
        to_json(document),
        first_table=None if unit.revision else unit.table_dict,
        note=note,
    )


def merged_runs(result: UpdateResult) -> list[MergedRun]:
    """The runs whose data are in the new table."""
    return [MergedRun(run_id=run.header.run_id, sha256=run.sha256) for run in result.merged_runs]


def _key(unit: UnitInputs) -> tuple[str, str, str]:
    return unit.table.imu_serial, unit.table.gyro_technology, unit.table.gyro_mode


def _numbered(document: UpdateDocument, unit: UnitInputs, revision: int) -> UpdateDocument:
    """The document as committed under this number, and how to take it back."""
    serial, technology, mode = (shlex.quote(name) for name in _key(unit))
    # a server's password comes from the environment
    store = shlex.quote((document.store or "").replace(":***@", "@"))
    back = (
        f"recal table rollback --store {store} --serial {serial} --technology {technology}"
        f" --mode {mode} --to {revision - 1} --by NAME --reason WHY"
    )
    return replace(document, revision=revision, rollback_command=back)


def _files(
    directory: Path, document: UpdateDocument, *, html: bool, runs: Sequence[str] | None
) -> dict[Path, str]:
    """What the folder gets; runs: before it a report of other runs than these goes aside."""
    if runs is not None:
        keep_report(directory, runs)
    page = {directory / "update.html": update_page.update_html(document)} if html else {}
    return {directory / "update.json": to_json(document), **page}
