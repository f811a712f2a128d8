"""`demo`: the main job on an embedded default."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from infield.store.table_store import TableStore
from infield.table.thermal_table import ThermalTable
from ins.twin_file import default_twin
from ins.verdicts import Outcome
from recal.service.results.files import output_directory, write_text
from recal.service.results.overwrite import need_free_report
from recal.service.results.result import Result
from recal.service.update import Update, UpdateRequest, update_in_store
from trajectories.runs.directory import write_run
from trajectories.runs.schema import SimulationRecord
from trajectories.simulator.environments.kinds import Environment
from trajectories.simulator.scenario import read_scenario, simulate_scenario
from trajectories.simulator.unit_truth import UnitTruth

SESSIONS = ("cold_parked_taxi", "ambient_parked_taxi", "hot_parked_taxi")
STARTS_UTC = ("2026-03-01T05:00:00Z", "2026-04-12T06:30:00Z", "2026-06-20T11:00:00Z")
HEADINGS_DEG = (0.0, 120.0, 250.0)
# People board during the first session, half as many or a heavier aircraft.
ENVIRONMENTS = ((Environment(kind="boarding", strength=0.5),), (), ())
SCORED_TEMPERATURES = 50
DEMO_FILES = ("recal.db", "update.json", "update.html", "run-1-cold_parked_taxi")


@dataclass(frozen=True, kw_only=True)
class TableErrors:
    """RMS error of both tables against the true unit, level gyros [deg/h]."""

    table_before: float
    table_after: float


@dataclass(frozen=True, kw_only=True)
class DemoReport:
    """What `--json` prints and demo.json holds."""

    schema: str = "recal.demo/1"
    seed: int
    runs: Sequence[str]
    store: str
    verdict: Outcome | str
    report: str
    table_error_deg_h: TableErrors


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Demonstrated(Result[DemoReport]):
    """An update of a simulated unit, and its error before and after.

    Parameters
    ----------
    update : Update
        The update over three sessions.
    """

    update: Update

    def lines(self, *, verbose: bool = False) -> list[str]:
        """The update, and the errors of both tables against the simulated truth."""
        error = self.record.table_error_deg_h
        return [
            *self.update.lines(verbose=verbose),
            (
                f"level gyros against the simulated truth: {error.table_before:.4f} ->"
                f" {error.table_after:.4f} deg/h RMS"
            ),
        ]


def demo(
    output: Path | None,
    *,
    seed: int,
    rate_hz: float,
    force: bool = False,
    told: Callable[[str], None] = lambda words: None,
) -> Demonstrated:
    """Three simulated sessions (cold, ambient, hot start), one update over them, and the error
    before and after.

    Parameters
    ----------
    output : path, optional
        The folder to write to; else recal-demo.
    seed : int
        Seed of the random generator.
    rate_hz : float
        IMU rate of the simulated runs [Hz].
    force : bool
        Write over what exists.
    told : callable
        Told what is being done.
    """
    need_free_report(output or Path("recal-demo"), DemoReport.schema, DEMO_FILES, force=force)
    directory = output_directory(output, "demo")
    runs, unit = _simulate(directory, seed, rate_hz, told)
    url = _store_url(directory)
    (directory / "recal.db").unlink(missing_ok=True)
    with TableStore.open(url, create=True) as store:
        store.import_table(
            unit.factory_table(),
            twin=replace(default_twin(unit.gyro_technology), imu_serial=unit.imu_serial),
            note="factory table of the demo unit, and the noise that it is simulated with",
        )
    told("recalibrating from three sessions")
    result = update_in_store(UpdateRequest(runs=runs, store_url=url, commit=True, output=directory))
    document = _document(seed, runs, directory, unit, result)
    shown = Demonstrated(document, page=result.page, update=result)
    write_text(directory / "demo.json", shown.to_json())
    return shown


def _store_url(directory: Path) -> str:
    return f"sqlite:///{directory / 'recal.db'}"


def _document(
    seed: int, runs: list[Path], directory: Path, unit: UnitTruth, result: Update
) -> DemoReport:
    return DemoReport(
        seed=seed,
        runs=[str(run) for run in runs],
        store=_store_url(directory),
        verdict=result.record.verdict,
        report=str(directory / "update.html"),
        table_error_deg_h=TableErrors(
            table_before=_error(unit, result.table_before, result),
            table_after=_error(unit, result.table, result),
        ),
    )


def _simulate(
    directory: Path, seed: int, rate_hz: float, told: Callable[[str], None]
) -> tuple[list[Path], UnitTruth]:
    """One aged unit, three power-ons; returns the run directories and the true unit."""
    units, runs = [], []
    sessions = zip(SESSIONS, STARTS_UTC, HEADINGS_DEG, ENVIRONMENTS)
    for k, (name, start_utc, heading_deg, environments) in enumerate(sessions):
        told(f"simulating {name}")
        plan = read_scenario(name)
        plan = replace(
            plan,
            imu=replace(plan.imu, rate_hz=rate_hz),
            unit=replace(plan.unit, ageing_seed=seed),
            run=replace(plan.run, start_utc=start_utc),
            attitude=replace(plan.attitude, heading_deg=heading_deg),
            environments=environments,
        )
        simulated, unit = simulate_scenario(plan, seed=seed + k)
        units.append(unit)
        path = directory / f"run-{k + 1}-{name}"
        made = SimulationRecord(scenario=name, seed=seed + k)
        write_run(path, simulated.run, reference=simulated.reference, simulation=made)
        runs.append(path)
    return runs, units[-1]


def _error(unit: UnitTruth, table: ThermalTable, result: Update) -> float:
    """RMS error of a table against the true unit at the temperatures visited, level gyros
    [deg/h].
    """
    visited = [point.temperature_degC for point in result.points]
    T = np.linspace(min(visited), max(visited), SCORED_TEMPERATURES)
    error = [table.bias_deg_h(axis, T) - unit.bias_deg_h(axis, T) for axis in ("x", "y")]
    return float(np.sqrt(np.mean(np.concatenate(error) ** 2)))
