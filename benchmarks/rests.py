"""Every rest of the recorded logs of ../shared/data, aligned, and what an update makes of each log.

    python -m benchmarks.rests --page docs/rests.md

Nobody has a table of these units: each is aligned and updated as an unknown one. Beside them five
quiet minutes of a simulated ring-laser unit at 34 deg latitude, without its table. A log that the
folder does not hold is left out, and the page says so.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import recal
from alignment.motion.inertial import quiet_stretches
from alignment.motion.seconds import seconds_of
from benchmarks.motion_runs import DATA, RECORDED, Case
from infield.reports.words.sentences import sentences
from infield.session.pipeline import update_calibration
from ins.records import Site
from ins.twin_file import default_twin
from ins.units import DEG
from tests.cut import cut_run
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

LEAST_S = 20.0  # of a rest that has a row
LAT_DEG, HEADING_DEG, SECONDS, UNITS = 34.0, 90.6, 300.0, 6
# What is known of a rest from elsewhere: no log comes with a surveyed heading.
BESIDE = {
    "LN-100": "mean rates alone: 277.8",
    "Calgary": "mean rates alone: 341.9; declared bias 0.1 deg/h, 0.6 deg of heading",
    "plane": "autopilot: roll 0.71, pitch 4.54",
}
HEAD = """# Every rest of the recorded logs

Written by `python -m benchmarks.rests --page docs/rests.md`; figures as measured. The logs are
those used throughout ([log formats](log_formats.md)). Nobody has a table of their units: the bias
is taken as 0 with the raw bias of the technology, or with the excess of the rates over Earth rate
where that is more, as sigma. None comes with a surveyed heading; "beside" says what else is known.

| log | rest, s | verdict | heading, deg | roll, deg | pitch, deg | seconds used | beside |
|---|---|---|---|---|---|---|---|"""
REFUSED = """
Why no heading, or nothing at all:
"""
UPDATES = """
## What an update makes of them

| log | outcome | why |
|---|---|---|"""
QUIET = """
## Five quiet minutes at 34 deg, no table

A ring-laser unit that stands still, its table unknown: bias 0 with the raw bias of its technology
as sigma.

| unit | verdict | heading error, deg | sigma, deg | error over sigma |
|---|---|---|---|---|"""


def rest_rows(name: str, case: Case) -> Iterator[tuple[str, str]]:
    """A row for each rest of a log, and why there is no heading."""
    stretches = [s for s in quiet_stretches(seconds_of(case.run.imu)) if s[1] - s[0] >= LEAST_S]
    for start_s, end_s in stretches or [(case.run.imu.start_s, case.run.imu.end_s)]:
        found = recal.align(cut_run(case.run, start_s, end_s), None, case.twin).document
        cells = [
            name,
            f"{start_s:.0f} to {end_s:.0f}",
            str(found["verdict"]),
            _with_sigma(found["heading_deg"], found["sigma_heading_deg"]),
            _with_sigma(found["roll_deg"], found["sigma_roll_deg"]),
            _with_sigma(found["pitch_deg"], found["sigma_pitch_deg"]),
            _used(found["used_percent"], found["duration_s"]),
            BESIDE.get(name, ""),
        ]
        why = f"* {name}: {found['reasons'][0]}." if found["verdict"] != "aligned" else ""
        yield f"| {' | '.join(cells)} |", why


def _with_sigma(value: float | None, sigma: float | None) -> str:
    if value is None or sigma is None or not np.isfinite(value):
        return "-"
    return f"{value:.3f} +- {sigma:.3f}"


def _used(percent: float | None, duration_s: float) -> str:
    """Of a unit that is not navigated no share is told: it uses the end of its rest."""
    return f"{0.01 * percent * duration_s:.0f}" if percent else "-"


def update_row(name: str, case: Case) -> str:
    """What an update makes of a log."""
    result = update_calibration([case.run], case.table, case.twin)
    reasons = [r for session in result.sessions for r in session.verdict.reasons]
    return f"| {name} | {result.outcome.value} | {'; '.join(dict.fromkeys(sentences(reasons)))} |"


def quiet_rows() -> Iterator[str]:
    """Five quiet minutes of units without their table."""
    site = Site(lat_rad=LAT_DEG * DEG, lon_rad=7 * DEG, height_m=250.0)
    motion = lay([Park(duration_s=SECONDS)], alignment_s=SECONDS)
    ideal = ideal_sensors(build_truth(motion, site, heading_rad=HEADING_DEG * DEG), 50.0)
    twin = default_twin("rlg")
    for seed in range(UNITS):
        rng = np.random.default_rng([seed, 34])
        unit = aged_unit(rng, gyro_technology="rlg")
        plan = SessionPlan(with_phases=False)
        made = simulate_run(ideal, thermal_history("ambient"), unit, twin, rng=rng, plan=plan)
        aligned = recal.align(made.run, None, twin)
        error = (aligned.heading_deg - HEADING_DEG + 180.0) % 360.0 - 180.0
        sigma = aligned.sigma_heading_deg
        yield (
            f"| {seed + 1} | {aligned.verdict} | {error:+.3f} | {sigma:.3f} |"
            f" {error / sigma:+.2f} |"
        )


def page(data: Path) -> Iterator[str]:
    """The page, line by line."""
    here = [named for named in RECORDED if (data / named.needs).exists()]
    cases = [(named.name, named.make()) for named in here]
    rows = [row for name, case in cases for row in rest_rows(name, case)]
    yield HEAD
    yield from (row for row, _ in rows)
    yield REFUSED
    yield from (why for _, why in rows if why)
    missing = [named.name for named in RECORDED if named not in here]
    if missing:
        yield f"\nNot here: {', '.join(missing)}."
    yield UPDATES
    for name, case in cases:
        yield update_row(name, case)
    yield QUIET
    yield from quiet_rows()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--page", type=Path, help="file to write; else printed")
    options = parser.parse_args()
    text = "\n".join(page(DATA)) + "\n"
    if options.page:
        options.page.write_text(text, "utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
