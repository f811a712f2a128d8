"""A trial as files: what a diagnosis is given, and apart from it what was planted."""

import json
from pathlib import Path

from benchmarks.gap_trials.trial import Trial
from ins.twin_file import twin_to_dict
from trajectories.runs.directory import write_run


def write_trial(trial: Trial, folder: Path) -> None:
    """folder/blind: run-1 ..., twin.json, table.json; folder/truth.json: what was planted."""
    blind = folder / "blind"
    for number, run in enumerate(trial.runs, start=1):
        write_run(blind / f"run-{number}", run)
    for path, content in (
        (blind / "twin.json", twin_to_dict(trial.twin)),
        (blind / "table.json", trial.table),
        (folder / "truth.json", trial.truth_dict()),
    ):
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
