"""Largest resident memory and time of the commands that read a run, on flights of 1 h and of 10 h
at 200 Hz.

    python benchmarks/streaming_memory.py [--csv] [HOURS ...]

Each flight is made in pieces from truth: cold start, 30 min parked, the realistic taxi, take-off,
cruise with turns, landing; GNSS at 1 Hz, odometer at 10 Hz. Each command runs in a process of its
own; its ru_maxrss is the figure.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from infield.table.file import json_text
from ins.columns import INCREMENT_COLUMNS
from ins.records import ImuLog
from trajectories.runs.directory import write_run
from trajectories.simulator import imperfections
from trajectories.simulator.scenario import (
    Scenario,
    scenario_from_dict,
    scenario_ideal,
    simulate_scenario,
)
from trajectories.simulator.sensors import ideal_sensors

RATE_HZ = 200.0
PIECE_S = 300.0
SLOW_HZ = 20.0  # rate at which the streams beside the imu are made
LIMIT_MB = 1000.0
TAXI = [
    {"segment": "turn", "angle_deg": 90},
    {"segment": "taxi", "duration_s": 120, "speed_m_s": 9.5},
    {"segment": "stop", "duration_s": 60},
    {"segment": "turn", "angle_deg": 90},
    {"segment": "taxi", "duration_s": 120, "speed_m_s": 9.5},
    {"segment": "stop", "duration_s": 60},
    {"segment": "turn", "angle_deg": -90},
]


class Use(NamedTuple):
    """What a command took."""

    wall_s: float
    cpu_s: float
    peak_mb: float


# A process begins with the resident memory of the one that starts it, which counts in its
# ru_maxrss: start from a small one.
LAUNCH = """
import os, subprocess, sys, time
start = time.perf_counter()
child = subprocess.Popen(sys.argv[1:], stdout=sys.stderr)
_, status, usage = os.wait4(child.pid, 0)
print(time.perf_counter() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0)
sys.exit(os.waitstatus_to_exitcode(status) != 0)
"""


def recal(*arguments: str, folder: Path) -> Use:
    """Run one command; SystemExit unless it ends well."""
    command = [sys.executable, "-c", LAUNCH, sys.executable, "-m", "recal", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"recal {' '.join(arguments)} failed:\n{done.stderr}")
    return Use(*map(float, done.stdout.split()))


def flight(hours: float) -> Scenario:
    """The scenario of a flight that lasts about `hours` from power-on to the ramp."""
    cruise_s = 3600.0 * hours - 3440.0  # what park, taxi, climb, descent and landing leave
    legs = max(round(cruise_s / 3600.0), 1)
    cruise = [
        {"segment": "cruise", "duration_s": cruise_s / legs},
        {"segment": "turn_flight", "angle_deg": 20, "bank_deg": 15},
    ] * legs
    return scenario_from_dict(
        {
            "schema": "recal.scenario/1",
            "seed": 1,
            "alignment_s": 600,
            "site": {"lat_deg": 45.0, "lon_deg": 7.0, "height_m": 250.0},
            "attitude": {"heading_deg": 0.0},
            "imu": {"rate_hz": SLOW_HZ},
            "unit": {"imu_serial": "SN-0042", "gyro_technology": "rlg", "ageing_seed": 1},
            "thermal": {"start": "cold"},
            "streams": {"gnss": True, "odometer": True},
            "twin": {
                "gyro_technology": "rlg",
                "vehicle": {
                    "sway_m_s": 0.0,
                    "lateral_noise_m_s": 0.0,
                    "yaw_creep_arcsec_sqrt_h": 0.0,
                },
            },
            "motion": [
                {"segment": "park", "duration_s": 1800},
                *TAXI,
                {"segment": "take_off", "lift_off_speed_m_s": 75},
                {"segment": "climb", "height_m": 3000, "rate_m_s": 10, "speed_m_s": 180},
                *cruise,
                {"segment": "descend", "height_m": 600, "rate_m_s": 10, "speed_m_s": 90},
                {"segment": "landing", "touchdown_speed_m_s": 65},
                {"segment": "taxi", "duration_s": 30, "speed_m_s": 9.5},
                {"segment": "stop", "duration_s": 5},
                {"segment": "park", "duration_s": 120},
            ],
        },
        name=f"flight of {hours:g} h",
    )


def make_run(folder: Path, hours: float, *, fmt: str = "parquet", phases: bool = True) -> Path:
    """Write `folder`/run (imu at 200 Hz, in pieces) and `folder`/table.json; returns the run."""
    scenario = flight(hours)
    simulated, unit = simulate_scenario(scenario)
    run = simulated.run if phases else replace(simulated.run, phases=())
    write_run(folder / "run", run, reference=simulated.reference)
    (folder / "run" / "imu.parquet").unlink()
    (folder / "table.json").write_text(json_text(unit.factory_table()), encoding="utf-8")
    truth, twin, rng = scenario_ideal(scenario).truth, scenario.twin, np.random.default_rng(2)

    def pieces() -> Iterator[ImuLog]:
        size = round(PIECE_S * RATE_HZ)
        for first in range(0, int(truth.motion.end_s * RATE_HZ), size):
            ideal = ideal_sensors(truth, RATE_HZ, samples=slice(first, first + size))
            gyro, accel = (
                np.stack(
                    [np.interp(ideal.time_s, simulated.bias_time_s, b) for b in bias.T], axis=1
                )
                for bias in (simulated.gyro_bias_true_deg_h, simulated.accel_bias_true_ug)
            )
            yield ImuLog(
                time_s=ideal.time_s,
                dt_s=np.full(ideal.time_s.size, ideal.dt_s),
                dtheta_rad=imperfections.gyro_output(
                    rng, ideal.dtheta_rad, gyro, twin.gyro, dt_s=ideal.dt_s
                ),
                dv_m_s=imperfections.accel_output(
                    rng, ideal.dv_m_s, accel, twin.accel, dt_s=ideal.dt_s
                ),
            )

    write_imu(folder / "run" / f"imu.{fmt}", pieces())
    return folder / "run"


def write_imu(path: Path, pieces: Iterator[ImuLog]) -> None:
    """The imu stream piece by piece."""
    import pyarrow as pa
    import pyarrow.csv as arrow_csv
    import pyarrow.parquet as pq

    names = ("time_s", *INCREMENT_COLUMNS)
    schema = pa.schema([(name, pa.float64()) for name in names])
    kind = {"compression": "zstd", "use_dictionary": False, "use_byte_stream_split": list(names)}
    text = arrow_csv.WriteOptions(quoting_style="none", quoting_header="none")
    csv = path.name.endswith(".csv")
    with (
        arrow_csv.CSVWriter(path, schema, write_options=text)
        if csv
        else pq.ParquetWriter(path, schema, **kind)
    ) as file:
        for log in pieces:
            file.write_table(
                pa.table([log.time_s, *log.dtheta_rad.T, *log.dv_m_s.T], schema=schema)
            )


def measure(folder: Path) -> dict[str, Use]:
    """Check, align, replay and update of `folder`/run against the table beside it."""
    recal("table", "import", "table.json", folder=folder)
    return {
        command: recal(command, "run", folder=folder)
        for command in ("check", "align", "replay", "update")
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("hours", nargs="*", type=float, default=[1.0, 10.0])
    parser.add_argument("--csv", action="store_true", help="imu.csv in the place of imu.parquet")
    parser.add_argument(
        "--no-phases", action="store_true", help="a log that does not say where it takes off"
    )
    given = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; 200 Hz; limit {LIMIT_MB:.0f} MB")
    print(f"{'flight':>8s} {'command':>8s} {'wall s':>8s} {'CPU s':>8s} {'peak MB':>8s}")
    for hours in given.hours:
        with tempfile.TemporaryDirectory() as name:
            make_run(
                Path(name), hours, fmt="csv" if given.csv else "parquet", phases=not given.no_phases
            )
            for command, use in measure(Path(name)).items():
                print(
                    f"{hours:6g} h {command:>8s} {use.wall_s:8.1f} {use.cpu_s:8.1f}"
                    f" {use.peak_mb:8.0f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
