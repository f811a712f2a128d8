"""`python -m benchmarks.gap_trials SEED -o DIR` writes a trial: DIR/blind for a diagnosis,
DIR/truth.json.
"""

import argparse
import json
from pathlib import Path

from benchmarks.gap_trials.runs import PLANS
from benchmarks.gap_trials.trial import SOURCES, Trial, draw_noise_trial, draw_trial
from ins.twin_file import twin_to_dict
from trajectories.runs.directory import write_run


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_trials", description=__doc__)
    parser.add_argument("seed", type=int)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--plan", choices=sorted(PLANS), default="four")
    parser.add_argument("--effects", type=int, default=1, help="how many; 0 plants none")
    parser.add_argument("--effect", action="append", help="draw from this name (may be repeated)")
    parser.add_argument(
        "--size", type=float, action="append", help="factor on each effect's usual size"
    )
    parser.add_argument("--source", choices=sorted(SOURCES), default="trajectories")
    parser.add_argument("--no-gnss", action="store_true")
    parser.add_argument(
        "--noise-off",
        type=float,
        help="the declared white noise is off by this fraction; no effect",
    )
    arguments = parser.parse_args()
    if arguments.noise_off is not None:
        trial = draw_noise_trial(
            arguments.seed,
            plan=arguments.plan,
            off=arguments.noise_off,
            source=arguments.source,
            with_gnss=not arguments.no_gnss,
        )
    else:
        trial = draw_trial(
            arguments.seed,
            plan=arguments.plan,
            effects=arguments.effects,
            names=arguments.effect,
            source=arguments.source,
            with_gnss=not arguments.no_gnss,
        )
        if arguments.size is not None:
            trial = trial.with_sizes(arguments.size)
    write_trial(trial, arguments.output)


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


if __name__ == "__main__":
    main()
