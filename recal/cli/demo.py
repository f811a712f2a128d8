"""`recal demo`: the main job on an embedded default."""

from pathlib import Path
from typing import Annotated, Any

import typer

from recal.cli.console import (
    JsonFlag,
    OutputPath,
    Quiet,
    Seed,
    Verbose,
    answer,
    finish,
    result_text,
    say,
)

SESSIONS = ("cold_parked_taxi", "ambient_parked_taxi", "hot_parked_taxi")
STARTS_UTC = ("2026-03-01T05:00:00Z", "2026-04-12T06:30:00Z", "2026-06-20T11:00:00Z")
HEADINGS_DEG = (0.0, 120.0, 250.0)
DEFAULT_SEED = 42


def command(
    output: OutputPath = None,
    seed: Seed = DEFAULT_SEED,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    rate_hz: Annotated[
        float, typer.Option("--rate-hz", help="IMU rate of the simulated runs.")
    ] = 50.0,
    verbose: Verbose = False,
) -> None:
    """Simulate three sessions of one aged unit, recalibrate its table from them, and report.

    Example: recal demo -o recal-demo
    """
    from rich.console import Console

    console = Console(stderr=True)
    with (
        console.status("simulating three sessions", spinner="dots")
        if console.is_terminal and not quiet
        else _Silent()
    ):
        result = demo(
            output, seed=seed if seed is not None else DEFAULT_SEED, rate_hz=rate_hz, quiet=quiet
        )
    answer(result, as_json=as_json, verbose=verbose)
    for line in _summary(result):
        say(line, quiet=quiet)
    finish(result)


class _Silent:
    def __enter__(self) -> None:
        return None

    def __exit__(self, *exc_info: object) -> None:
        return None


def demo(output: Path | None, *, seed: int, rate_hz: float, quiet: bool = True) -> dict[str, Any]:
    """Three simulated sessions (cold, ambient, hot start), one update over them, and the error
    before and after.
    """
    from infield.store.table_store import TableStore
    from recal.cli.update import summary, update
    from recal.service.output import output_directory, write_text

    directory = output_directory(output, "demo")
    runs, unit, table = _simulate(directory, seed, rate_hz)
    url = f"sqlite:///{directory / 'recal.db'}"
    (directory / "recal.db").unlink(missing_ok=True)
    with TableStore.open(url, create=True) as store:
        store.import_table(table, note="factory table of the demo unit")
    document = update(runs, store_url=url, commit=True, output=directory)
    for line in summary(document):
        say(line, quiet=quiet)
    errors = _errors(unit, document)
    result = {
        "schema": "recal.demo/1",
        "seed": seed,
        "runs": [str(r) for r in runs],
        "store": url,
        "verdict": document["verdict"],
        "report": str(directory / "update.html"),
        "table_error_deg_h": errors,
    }
    write_text(directory / "demo.json", result_text(result))
    return result


def _simulate(directory: Path, seed: int, rate_hz: float) -> tuple[list[Path], Any, dict[str, Any]]:
    """One aged unit, three power-ons; returns the run directories, the true unit and its factory
    table.
    """
    from dataclasses import replace

    from trajectories.runs.directory import write_run
    from trajectories.simulator.scenario import read_scenario, simulate_scenario

    unit: Any = None
    runs = []
    for k, (name, start_utc, heading_deg) in enumerate(zip(SESSIONS, STARTS_UTC, HEADINGS_DEG)):
        plan = read_scenario(name)
        plan = replace(
            plan,
            imu=replace(plan.imu, rate_hz=rate_hz),
            unit=replace(plan.unit, ageing_seed=seed),
            run=replace(plan.run, start_utc=start_utc),
            attitude=replace(plan.attitude, heading_deg=heading_deg),
        )
        simulated, unit = simulate_scenario(plan, seed=seed + k)
        path = directory / f"run-{k + 1}-{name}"
        write_run(path, simulated.run, reference=simulated.reference)
        runs.append(path)
    return runs, unit, unit.factory_table()


def _errors(unit: Any, document: dict[str, Any]) -> dict[str, Any]:
    """RMS error of the table against the true unit at the temperatures visited, level gyros."""
    import numpy as np

    from infield.table.file import table_from_dict

    found = {}
    visited = [p["temperature_degC"] for p in document["points"]]
    T = np.linspace(min(visited), max(visited), 50)
    for name in ("table_before", "table_after"):
        table = table_from_dict(document[name], name=name)
        error = np.concatenate([table.bias_deg_h(a, T) - unit.bias_deg_h(a, T) for a in ("x", "y")])
        found[name] = float(np.sqrt(np.mean(error**2)))
    return found


def _summary(result: dict[str, Any]) -> list[str]:
    error = result["table_error_deg_h"]
    return [
        (
            f"level gyros against the simulated truth: {error['table_before']:.4f} ->"
            f" {error['table_after']:.4f} deg/h RMS"
        ),
        f"report: {result['report']}",
    ]
