"""`simulate`: a power-on session from a scenario and a twin, with its truth."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from infield.table.file import json_text, table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.documents import INLINE
from ins.records import Phase, ReferenceLog, Run, TableDocument, TwinModel
from recal.service.inputs.records import AnyTable, table_of
from recal.service.results.files import AnyPath, write_text
from recal.service.results.result import Result
from simreal.declared.declared_noise import without_excess
from simreal.declared.twin_effects import parse_effects
from simreal.twin.inject_truth import inject_simulated, telemetry_of_simulated
from trajectories.runs.directory import write_run
from trajectories.runs.schema import SimulationRecord
from trajectories.simulator.environments.kinds import Environment, environment_of
from trajectories.simulator.scenario import (
    Scenario,
    packaged_scenarios,
    read_scenario,
    scenario_truth,
    scenario_words,
    simulate_scenario,
)
from trajectories.simulator.session import SimulatedRun
from trajectories.simulator.truth_file import Departure, departure
from trajectories.simulator.unit_truth import UnitTruth

SIMULATE_STEPS = 2  # that `told` is told of
EFFECTS_STREAM = 1  # of the seed: what effects draw


@dataclass(frozen=True, kw_only=True)
class TruthDeparture:
    """A truth file, and how far at most the run departs from its rows."""

    file: str
    off: Departure = field(metadata=INLINE)


@dataclass(frozen=True, kw_only=True)
class SimulateReport:
    """What `recal simulate --json` prints; run: where it was written; twin, table: what was
    given.
    """

    schema: str = "recal.simulate/1"
    run: str | None
    run_id: str
    imu_serial: str
    seed: int
    duration_s: float
    rate_hz: float
    twin: str
    table: str | None
    environments: Sequence[Environment]
    phases: Sequence[Phase]
    truth: TruthDeparture | None


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Simulation(Result[SimulateReport]):
    """A simulated session and what only a simulator knows.

    Parameters
    ----------
    simulated : SimulatedRun
        The run, its reference, the true biases.
    unit : UnitTruth
        The aged unit.
    table_dict : Mapping
        Its factory table, as JSON holds it.
    twin : TwinModel
        The noise that was simulated.
    scenario : str
        The name or file of the scenario.
    """

    simulated: SimulatedRun
    unit: UnitTruth
    table_dict: TableDocument
    twin: TwinModel
    scenario: str = ""

    @property
    def run(self) -> Run:
        """What the recorder of the unit would hold."""
        return self.simulated.run

    @property
    def reference(self) -> ReferenceLog | None:
        """The true motion."""
        return self.simulated.reference

    @property
    def table(self) -> ThermalTable:
        """The factory table of the unit."""
        return table_from_dict(self.table_dict, name="table")

    def write(
        self, path: AnyPath | None, *, table: AnyPath | None = None, truth: AnyPath | None = None
    ) -> "Simulation":
        """Write the run with its reference as a run directory.

        Parameters
        ----------
        path : str or path, optional
            The run directory, made anew; None: only table and truth are written.
        table : str or path, optional
            Where to put the factory table (JSON).
        truth : str or path, optional
            Where to put the true biases [deg/h, micro-g] and temperatures [degC] at 1 Hz (CSV).

        Returns
        -------
        Simulation
            The same, its document naming the run directory.
        """
        made = SimulationRecord(scenario=self.scenario, seed=self.record.seed)
        if path is not None:
            write_run(Path(path), self.run, reference=self.reference, simulation=made)
        if table is not None:
            write_text(Path(table), json_text(self.table_dict))
        if truth is not None:
            write_text(Path(truth), truth_csv(self.simulated))
        return replace(self, record=replace(self.record, run=None if path is None else str(path)))

    def lines(self, *, verbose: bool = False) -> list[str]:
        """How long it is, and how far it departs from a given truth."""
        d = self.record
        lines = [f"{d.run or d.run_id}: {d.duration_s:.0f} s at {d.rate_hz:g} Hz, seed {d.seed}"]
        if d.truth is not None:
            off = d.truth.off
            within = (
                f"{off.position_m:.2g} m, {off.velocity_m_s:.2g} m/s, {off.attitude_deg:.2g} deg"
            )
            lines.append(f"  follows {d.truth.file} within {within}")
        return lines


def simulate(
    scenario: AnyPath = "cold_parked_taxi",
    *,
    seed: int | None = None,
    twin: AnyPath | None = None,
    table: AnyTable | None = None,
    rate_hz: float | None = None,
    environments: Sequence[str] | None = None,
    told: Callable[[str], None] = lambda words: None,
) -> Simulation:
    """Simulate one power-on session of an aged unit.

    Parameters
    ----------
    scenario : str or path
        The name of a packaged scenario, or a scenario file (TOML).
    seed : int, optional
        Of the random generator; else the scenario's.
    twin : path, optional
        Twin file, instead of the scenario's.
    table : ThermalTable or path, optional
        Factory table of the unit, instead of the scenario's or a drawn one.
    rate_hz : float, optional
        IMU rate [Hz], instead of the scenario's.
    environments : sequence of str, optional
        What the parked vehicle goes through, instead of the scenario's: `KIND` or `KIND:STRENGTH`
        (1 is the usual), such as `boarding` or `gusty:1.5`.
    told : callable
        Told what is being done, in SIMULATE_STEPS steps.

    Returns
    -------
    Simulation
        `.run`, `.reference` (the truth), `.table` (the factory table), `.twin`; `.write(path)`
        writes a run directory.

    Raises
    ------
    InputError
        Names the scenario's file and key.

    Examples
    --------
    >>> import recal
    >>> simulated = recal.simulate("parked_only", seed=7, rate_hz=10)
    >>> simulated.run.header.imu_serial, simulated.run.imu.rows
    ('SN-0042', 42000)
    """
    told("reading the scenario")
    source = scenario if isinstance(scenario, str) else Path(scenario)
    plan = read_scenario(source, twin_path=None if twin is None else Path(twin))
    if rate_hz is not None:
        plan = replace(plan, imu=replace(plan.imu, rate_hz=rate_hz))
    if environments is not None:
        plan = replace(plan, environments=tuple(environment_of(text) for text in environments))
    given = table if table is not None else plan.table_path
    factory = None if given is None else table_of(given)[1]
    told("simulating the motion and the sensors")
    simulated, unit = _session(plan, seed, factory)
    header, imu = simulated.run.header, simulated.run.imu
    document = SimulateReport(
        run=None,
        run_id=header.run_id,
        imu_serial=header.imu_serial,
        seed=plan.seed if seed is None else seed,
        duration_s=imu.end_s,
        rate_hz=imu.rate_hz,
        twin=plan.twin.source,
        table=str(given) if isinstance(given, str | Path) else None,
        environments=plan.environments,
        phases=simulated.run.phases,
        truth=_truth(plan),
    )
    return Simulation(
        document,
        simulated=simulated,
        unit=unit,
        table_dict=factory or unit.factory_table(),
        twin=plan.twin,
        scenario=Path(scenario).name,
    )


def scenarios() -> dict[str, str]:
    """The packaged scenarios by name, with what each is."""
    return {name: scenario_words(name) for name in packaged_scenarios()}


def _truth(plan: Scenario) -> TruthDeparture | None:
    """The truth file and how far the run departs from its rows; None where the scenario has
    none.
    """
    if plan.profile is None:
        return None
    off = departure(scenario_truth(plan), plan.profile)
    return TruthDeparture(file=plan.profile.source, off=off)


def _session(
    plan: Scenario, seed: int | None, factory: TableDocument | None
) -> tuple[SimulatedRun, UnitTruth]:
    """The session of a scenario, with the effects that its twin lists.

    They are drawn from a stream of their own: the rest of the run is the same with and without
    them.
    """
    if not plan.twin.effects:
        return simulate_scenario(plan, seed=seed, table=factory)
    seed = plan.seed if seed is None else seed
    run_id = plan.run.run_id or f"{plan.name}-{seed}"
    twin, effects = without_excess(plan.twin, parse_effects(plan.twin), run_id)
    simulated, unit = simulate_scenario(replace(plan, twin=twin), seed=seed, table=factory)
    table = table_from_dict(factory or unit.factory_table(), name="table")
    telemetry = telemetry_of_simulated(simulated, plan.thermal, table)
    rng = np.random.default_rng([seed, EFFECTS_STREAM])
    return inject_simulated(simulated, telemetry, effects, rng, vehicle=twin.vehicle), unit


def truth_csv(simulated: SimulatedRun) -> str:
    """The true total biases and gyro temperatures at 1 Hz."""
    columns = {"time_s": simulated.bias_time_s}
    for k, axis in enumerate("xyz"):
        columns[f"gyro_{axis}_bias_deg_h"] = simulated.gyro_bias_true_deg_h[:, k]
        columns[f"accel_{axis}_bias_ug"] = simulated.accel_bias_true_ug[:, k]
        columns[f"gyro_{axis}_degC"] = simulated.temperature_true_degC[:, k]
    rows = [",".join(map(repr, row)) for row in np.stack(list(columns.values()), axis=-1).tolist()]
    return "\n".join([",".join(columns), *rows]) + "\n"
