"""Every rest of the recorded logs of ../shared/data, aligned, and what an update makes of each log.

Nobody has a table of these units: each is aligned and updated as an unknown one. Beside them five
quiet minutes of a simulated ring-laser unit at 34 deg latitude, without its table. A log that the
folder does not hold is left out, and the page says so.
"""

from collections.abc import Iterator

import numpy as np

import recal
from alignment.motion.inertial import quiet_stretches
from alignment.motion.seconds import seconds_of
from benchmarks.study import Work, table
from infield.session.pipeline import update_calibration
from ins.records import Site
from ins.twin_file import default_twin
from ins.units import DEG
from ins.verdicts import sentences
from tests.cut import cut_run
from tests.frozen.motion_runs import DATA, RECORDED, Case
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
HEAD = ("log", "rest, s", "verdict", "heading, deg", "roll, deg", "pitch, deg", "seconds used")
QUIET = ("unit", "verdict", "heading error, deg", "sigma, deg", "error over sigma")


def rest_rows(name: str, case: Case) -> Iterator[tuple[list[str], str]]:
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
        yield cells, why


def _with_sigma(value: float | None, sigma: float | None) -> str:
    if value is None or sigma is None or not np.isfinite(value):
        return "-"
    return f"{value:.3f} +- {sigma:.3f}"


def _used(percent: float | None, duration_s: float) -> str:
    """Of a unit that is not navigated no share is told: it uses the end of its rest."""
    return f"{0.01 * percent * duration_s:.0f}" if percent else "-"


def update_row(name: str, case: Case) -> list[str]:
    """What an update makes of a log."""
    result = update_calibration([case.run], case.table, case.twin)
    reasons = [r for session in result.sessions for r in session.verdict.reasons]
    return [name, result.outcome.value, "; ".join(dict.fromkeys(sentences(reasons)))]


def quiet_row(seed: int) -> list[str]:
    """Five quiet minutes of a unit without its table."""
    site = Site(lat_rad=LAT_DEG * DEG, lon_rad=7 * DEG, height_m=250.0)
    motion = lay([Park(duration_s=SECONDS)], alignment_s=SECONDS)
    ideal = ideal_sensors(build_truth(motion, site, heading_rad=HEADING_DEG * DEG), 50.0)
    twin, rng = default_twin("rlg"), np.random.default_rng([seed, 34])
    unit = aged_unit(rng, gyro_technology="rlg")
    plan = SessionPlan(with_phases=False)
    made = simulate_run(ideal, thermal_history("ambient"), unit, twin, rng=rng, plan=plan)
    aligned = recal.align(made.run, None, twin)
    error = (aligned.heading_deg - HEADING_DEG + 180.0) % 360.0 - 180.0
    sigma = aligned.sigma_heading_deg
    told = [f"{error:+.3f}", f"{sigma:.3f}", f"{error / sigma:+.2f}"]
    return [f"{seed + 1}", str(aligned.verdict), *told]


def of_log(name: str) -> dict[str, list]:
    """Rests of a recorded log, why there is no heading, and its update."""
    case = next(named for named in RECORDED if named.name == name).make()
    rows = list(rest_rows(name, case))
    whys = [why for _, why in rows if why]
    return {"rests": [row for row, _ in rows], "whys": whys, "update": update_row(name, case)}


def run(work: Work) -> str:
    here = [named.name for named in RECORDED if (DATA / named.needs).exists()]
    logs = work.each(of_log, [(name,) for name in here])
    missing = [named.name for named in RECORDED if named.name not in here]
    parts = [
        table((*HEAD, "beside"), [row for log in logs for row in log["rests"]]),
        "Why no heading, or nothing at all:\n",
        "".join(f"{why}\n" for log in logs for why in log["whys"]),
        f"Not here: {', '.join(missing)}.\n" if missing else "",
        "## What an update makes of them\n",
        table(("log", "outcome", "why"), [log["update"] for log in logs]),
        "## Five quiet minutes at 34 deg, no table\n",
        "A ring-laser unit that stands still, its table unknown: bias 0 with the raw bias of its",
        "technology as sigma.\n",
        table(QUIET, work.each(quiet_row, [(seed,) for seed in range(UNITS)])),
    ]
    return "\n".join(parts)
