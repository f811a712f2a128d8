"""A run of a flight of some hours at 200 Hz, made in pieces from truth.

Cold start, 30 min parked, the realistic taxi, take-off, cruise with turns, landing; GNSS at 1 Hz,
odometer at 10 Hz.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

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
TAXI = [
    {"segment": "turn", "angle_deg": 90},
    {"segment": "taxi", "duration_s": 120, "speed_m_s": 9.5},
    {"segment": "stop", "duration_s": 60},
    {"segment": "turn", "angle_deg": 90},
    {"segment": "taxi", "duration_s": 120, "speed_m_s": 9.5},
    {"segment": "stop", "duration_s": 60},
    {"segment": "turn", "angle_deg": -90},
]


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
