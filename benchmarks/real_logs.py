"""The real logs of ../shared/data as runs, and where in them the unit rests: what a gap diagnosis
can be tried on.

    python -m benchmarks.real_logs -o /tmp/real-logs [--data ../shared/data]

writes the runs (the parked time of the ArduPilot plane also as two halves on one clock, so that
what is found in one can be checked on the other) and prints a Markdown table of the stretches at
rest: how far the gyros move there.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ins.json_file import read_toml
from ins.records import Run
from ins.robust import runs_of_true
from ins.units import DEG_PER_HOUR
from tests.cut import cut_run
from trajectories.readers.conversion import convert_log
from trajectories.runs.directory import write_run

ROOT = Path(__file__).parents[1]
PLANE, COPTER = "apm_fixedwing_TestLog2.mat", "ardupilot_log171.bin"
PARKED_HALVES_S = {"apm-first": (0.0, 87.0), "apm-second": (87.0, 175.0)}
# Scatter within a second and rate of a unit that nobody touches: MEMS white noise is 0.006 rad/s
# and 0.06 m/s^2 here.
STILL_GYRO_RAD_S, STILL_ACCEL_M_S2, STILL_RATE_RAD_S = 0.012, 0.15, 0.01
SHORTEST_REST_S = 10.0
ENDS_S = 10.0  # of a rest, whose means the table shows


def convert_all(data: Path, output: Path) -> dict[str, Run]:
    """The runs by the name of their directory, written there."""
    ln100 = read_toml(ROOT / "examples" / "maps" / "x_LN100_up.toml")
    jobs = [("ln100", "x_LN100_up.ins", ln100), ("apm", PLANE, {})]
    # a gap of 2 s follows
    jobs += [(f"copter-imu{k}", COPTER, {"imu": k, "to_s": 73.0}) for k in (1, 2, 3)]
    runs: dict[str, Run] = {}
    for name, log, options in jobs:
        made = convert_log(data / log, options, {})
        runs[name] = made.run
        write_run(output / name, made.run, conversion=made.record)
    for name, (start_s, end_s) in PARKED_HALVES_S.items():
        runs[name] = cut_run(runs["apm"], start_s, end_s)
        write_run(output / name, runs[name])
    return runs


def at_rest(run: Run) -> list[tuple[float, float]]:
    """Start and end [s] of the stretches in which every second is still, SHORTEST_REST_S or
    longer.
    """
    imu = run.imu.whole()
    second = np.floor(imu.time_s - imu.time_s[0] + 1e-9)
    starts = np.flatnonzero(np.diff(second, prepend=-1.0))
    count = np.diff(np.append(starts, second.size))[:, None]
    quiet = np.ones(starts.size, dtype=bool)
    for increments, scatter in ((imu.dtheta_rad, STILL_GYRO_RAD_S), (imu.dv_m_s, STILL_ACCEL_M_S2)):
        rate = increments / imu.dt_s[:, None]
        mean = np.add.reduceat(rate, starts) / count
        variance = (
            np.add.reduceat((rate - np.repeat(mean, count[:, 0], axis=0)) ** 2, starts) / count
        )
        quiet &= (variance < scatter**2).all(axis=1)
        if increments is imu.dtheta_rad:
            quiet &= (np.abs(mean) < STILL_RATE_RAD_S).all(axis=1)
    begins, ends = imu.time_s[starts], np.append(imu.time_s[starts[1:]], imu.time_s[-1])
    spans = ((float(begins[a]), float(ends[b - 1])) for a, b in runs_of_true(quiet))
    return [span for span in spans if span[1] - span[0] >= SHORTEST_REST_S]


def mean_rate_deg_h(run: Run, start_s: float, end_s: float) -> np.ndarray:
    """Mean angular rate over a stretch, shape (3,)."""
    part = run.imu.between(start_s, end_s)
    return np.asarray(part.dtheta_rad.sum(axis=0) / part.dt_s.sum() / DEG_PER_HOUR)


def table_lines(runs: dict[str, Run]) -> Iterator[str]:
    """Markdown: each rest with the temperature and the mean rates of its first and last seconds."""
    yield (
        "| run | at rest [s] | temperature [degC] | gyro x y z, first 10 s [deg/h] | last 10 s"
        " [deg/h] |"
    )
    yield "|---|---|---|---|---|"
    for name, run in runs.items():
        for start_s, end_s in at_rest(run):
            ends = ((start_s, start_s + ENDS_S), (end_s - ENDS_S, end_s))
            first, last = (
                " ".join(f"{v:.1f}" for v in mean_rate_deg_h(run, a, b)) for a, b in ends
            )
            T = run.temperature
            span = (
                "-"
                if T is None
                else " to ".join(
                    f"{np.interp(s, T.time_s, T.gyro_degC[:, 0]):.2f}" for s in (start_s, end_s)
                )
            )
            yield f"| {name} | {start_s:.1f} to {end_s:.1f} | {span} | {first} | {last} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="directory for the runs")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    arguments = parser.parse_args()
    for line in table_lines(convert_all(arguments.data, arguments.output)):
        print(line)


if __name__ == "__main__":
    main()
