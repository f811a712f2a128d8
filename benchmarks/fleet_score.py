"""What `recal fleet update --commit` made of a fleet of benchmarks/fleet_runs.py, against the
truth.

    python benchmarks/fleet_score.py FLEET OUT STORE_URL

OUT holds fleet.json. RMS error of the level gyros before (factory table) and after, at the
temperatures of each unit's merged runs (1 degC steps), over all units with one; what became of each
kind of run; mean squared error over sigma^2.
"""

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.store.table_store import TableStore

LEVEL = ("x", "y")


def visited(unit: dict[str, Any], merged: set[str], grid: NDArray) -> NDArray:
    """Grid temperatures that a merged run of the unit passed."""
    spans = [
        run["visited_degC"] for run in unit["runs"] if run["path"] in merged and run["visited_degC"]
    ]
    inside = [(grid >= low) & (grid <= high) for low, high in spans]
    return np.any(inside, axis=0) if inside else np.zeros(grid.size, bool)


def errors(
    store: TableStore, serial: str, unit: dict[str, Any], seen: NDArray, grid: NDArray
) -> tuple[NDArray, ...]:
    """Errors of the factory and the active table [deg/h], and the latter's over its sigma; level
    gyros, (2 n,).
    """
    history = store.history(serial)
    before, after, T = history[0].table, history[-1].table, grid[seen]
    found: list[list[NDArray]] = [[], [], []]
    for k, axis in enumerate(LEVEL):
        true = np.array(unit["bias_deg_h"][axis])[seen]
        error = after.bias_deg_h(k, T) - true
        for values, one in zip(
            found, (before.bias_deg_h(k, T) - true, error, error / after.sigma_deg_h(k, T))
        ):
            values.append(one)
    return tuple(np.concatenate(values) for values in found)


def main(fleet: Path, out: Path, store_url: str) -> None:
    truth, document = (
        json.loads((fleet / "truth.json").read_text()),
        json.loads((out / "fleet.json").read_text()),
    )
    grid = np.array(truth["grid_degC"])
    outcome = {
        str(Path(run["path"]).relative_to(fleet.resolve())): run["outcome"]
        for run in document["runs"]
    }
    merged = {path for path, name in outcome.items() if name == "committed"}
    kinds: Counter[tuple[str, str]] = Counter()
    gathered: dict[bool, list[tuple[NDArray, ...]]] = {False: [], True: []}
    worse = 0
    with TableStore.open(store_url) as store:
        for serial, unit in truth["units"].items():
            for run in unit["runs"]:
                if run["path"] in outcome:
                    kinds[
                        run["kind"] + (", after a step" if run["stepped"] else ""),
                        outcome[run["path"]],
                    ] += 1
            seen = visited(unit, merged, grid)
            if seen.any():
                found = errors(store, serial, unit, seen, grid)
                gathered[unit["steps"]].append(found)
                worse += bool(np.mean(found[1] ** 2) > np.mean(found[0] ** 2))
    for steps, name in (
        (False, "units that age"),
        (True, "units that also step (truth: before the step)"),
    ):
        if gathered[steps]:
            before, after, ratio = (np.concatenate(column) for column in zip(*gathered[steps]))
            rms = [float(np.sqrt(np.mean(e**2))) for e in (before, after)]
            print(
                f"{len(gathered[steps])} {name}: level gyros {rms[0]:.4f} -> {rms[1]:.4f} deg/h RMS"
                f" at visited temperatures, mean squared error / sigma^2 {np.mean(ratio**2):.2f}"
            )
    print(f"{worse} units worse than before")
    for (kind, name), count in sorted(kinds.items()):
        print(f"{kind:32} {name:14} {count}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
