"""`recal simulate`: a run from a scenario file and a twin."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.cli.console import JsonFlag, Quiet, Seed, Verbose, answer, say

if TYPE_CHECKING:
    from trajectories.simulator.scenario import Scenario
    from trajectories.simulator.session import SimulatedRun
    from trajectories.simulator.unit_truth import UnitTruth

EFFECTS_STREAM = 1  # of the seed: what effects draw


def command(
    scenario: Annotated[
        str, typer.Argument(help="A scenario file (TOML), or the name of a packaged one.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The run directory to write.")],
    twin: Annotated[
        Path | None, typer.Option("--twin", help="Twin file, instead of the scenario's.")
    ] = None,
    table: Annotated[
        Path | None, typer.Option("--table", help="Factory table of the unit (JSON).")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", help="CSV of the true biases, for scoring.")
    ] = None,
    table_out: Annotated[
        Path | None, typer.Option("--table-out", help="Where to put the unit's table.")
    ] = None,
    seed: Seed = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Simulate one power-on session from a scenario and write it as a run with its reference.

    Example: recal simulate cold_parked_taxi -o run --seed 7 --table-out table.json
    """
    result = simulate(
        scenario, output, twin=twin, table=table, truth=truth, table_out=table_out, seed=seed
    )
    answer(result, as_json=as_json, verbose=verbose)
    say(
        f"{output}: {result['duration_s']:.0f} s at {result['rate_hz']:g} Hz, seed"
        f" {result['seed']}",
        quiet=quiet,
    )
    if result["truth"] is not None:
        off = "{position_m:.2g} m, {velocity_m_s:.2g} m/s, {attitude_deg:.2g} deg".format(
            **result["truth"]
        )
        say(f"  follows {result['truth']['file']} within {off}", quiet=quiet)


def simulate(
    scenario: str,
    output: Path,
    *,
    twin: Path | None = None,
    table: Path | None = None,
    truth: Path | None = None,
    table_out: Path | None = None,
    seed: int | None = None,
) -> dict[str, Any]:
    """Writes the run and what else was asked for; returns the result `recal.simulate/1`."""
    from infield.table.file import json_text, read_table_dict
    from recal.service.output import write_text
    from trajectories.runs.directory import write_run
    from trajectories.simulator.scenario import read_scenario

    plan = read_scenario(scenario, twin_path=twin)
    table_path = table or plan.table_path
    factory = None if table_path is None else read_table_dict(table_path)
    simulated, unit = _session(plan, seed, factory)
    write_run(output, simulated.run, reference=simulated.reference)
    if table_out is not None:
        write_text(table_out, json_text(factory or unit.factory_table()))
    if truth is not None:
        write_text(truth, truth_csv(simulated))
    header, imu = simulated.run.header, simulated.run.imu
    return {
        "schema": "recal.simulate/1",
        "run": str(output),
        "run_id": header.run_id,
        "imu_serial": header.imu_serial,
        "seed": plan.seed if seed is None else seed,
        "duration_s": imu.end_s,
        "rate_hz": imu.rate_hz,
        "twin": plan.twin.source,
        "table": None if table_path is None else str(table_path),
        "phases": [vars(phase) for phase in simulated.run.phases],
        "truth": _truth(plan),
    }


def _truth(plan: "Scenario") -> dict[str, Any] | None:
    """The truth file and how far the run departs from its rows; None where the scenario has
    none.
    """
    from trajectories.simulator.scenario import scenario_truth
    from trajectories.simulator.truth_file import departure

    if plan.profile is None:
        return None
    return {"file": plan.profile.source, **vars(departure(scenario_truth(plan), plan.profile))}


def _session(
    plan: "Scenario", seed: int | None, factory: dict[str, Any] | None
) -> "tuple[SimulatedRun, UnitTruth]":
    """The session of a scenario, with the effects that its twin lists.

    They are drawn from a stream of their own: the rest of the run is the same with and without
    them.
    """
    from trajectories.simulator.scenario import simulate_scenario

    if not plan.twin.effects:
        return simulate_scenario(plan, seed=seed, table=factory)
    from dataclasses import replace

    import numpy as np

    from infield.table.file import table_from_dict
    from simreal.declared.declared_noise import without_excess
    from simreal.declared.twin_effects import parse_effects
    from simreal.twin.inject_truth import inject_simulated, telemetry_of_simulated

    seed = plan.seed if seed is None else seed
    run_id = plan.run.run_id or f"{plan.name}-{seed}"
    twin, effects = without_excess(plan.twin, parse_effects(plan.twin), run_id)
    simulated, unit = simulate_scenario(replace(plan, twin=twin), seed=seed, table=factory)
    table = table_from_dict(factory or unit.factory_table(), name="table")
    telemetry = telemetry_of_simulated(simulated, plan.thermal, table)
    rng = np.random.default_rng([seed, EFFECTS_STREAM])
    return inject_simulated(simulated, telemetry, effects, rng, vehicle=twin.vehicle), unit


def truth_csv(simulated: "SimulatedRun") -> str:
    """The true total biases and gyro temperatures at 1 Hz."""
    import numpy as np

    columns = {"time_s": simulated.bias_time_s}
    for k, axis in enumerate("xyz"):
        columns[f"gyro_{axis}_bias_deg_h"] = simulated.gyro_bias_true_deg_h[:, k]
        columns[f"accel_{axis}_bias_ug"] = simulated.accel_bias_true_ug[:, k]
        columns[f"gyro_{axis}_degC"] = simulated.temperature_true_degC[:, k]
    rows = [",".join(map(repr, row)) for row in np.stack(list(columns.values()), axis=-1).tolist()]
    return "\n".join([",".join(columns), *rows]) + "\n"
