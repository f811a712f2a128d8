"""Small runs for tests: a unit at rest, level, heading 0, latitude 30 deg (sine and cosine differ),
every stream.
"""

import json
from pathlib import Path

import numpy as np

from ins.earth import gravity_n, omega_ie_n
from ins.records import (
    GnssLog,
    ImuLog,
    OdometerLog,
    Phase,
    ReferenceLog,
    Run,
    RunHeader,
    Site,
    Survey,
    TemperatureLog,
)
from trajectories.runs.directory import write_run

SITE = Site(lat_rad=np.radians(30.0), lon_rad=np.radians(7.0), height_m=250.0)
W_B = omega_ie_n(SITE.lat_rad)  # level, heading 0: body axes are north-east-down
F_B = -gravity_n(SITE.lat_rad, SITE.height_m)


def header(**changes) -> RunHeader:
    keys = dict(
        run_id="R1",
        tail="N123AB",
        imu_serial="SN-0042",
        gyro_technology="rlg",
        start_utc="2026-03-01T05:00:00Z",
        site=SITE,
        wheel_reference_m=(1.0, 0.0, 2.5),
        gnss_lever_arm_m=(0.5, -0.25, -1.0),
        gyro_mode="dithered",
        survey=Survey(heading_rad=np.radians(12.3), sigma_heading_rad=np.radians(0.01)),
    )
    return RunHeader(**{**keys, **changes})


def imu_log(*, seconds: float = 40.0, rate_hz: float = 100.0, seed: int = 5) -> ImuLog:
    rng = np.random.default_rng(seed)
    n = round(seconds * rate_hz)
    dt = np.full(n, 1 / rate_hz)
    dtheta = W_B / rate_hz + 1e-8 * rng.standard_normal((n, 3))
    dv = F_B / rate_hz + 1e-6 * rng.standard_normal((n, 3))
    return ImuLog(time_s=np.arange(1, n + 1) / rate_hz, dt_s=dt, dtheta_rad=dtheta, dv_m_s=dv)


def full_run(**changes) -> Run:
    rng = np.random.default_rng(6)
    m = 40
    time_s = np.arange(m) * 1.0
    warm = 20.0 + 0.01 * time_s[:, None] + 0.01 * rng.standard_normal((m, 3))
    keys = dict(
        header=header(),
        imu=imu_log(),
        temperature=TemperatureLog(
            time_s=time_s, gyro_degC=warm, block_degC=warm[:, 0], gradient_degC=warm - 20.0
        ),
        gnss=GnssLog(
            time_s=time_s,
            lat_rad=SITE.lat_rad + 1e-8 * rng.standard_normal(m),
            lon_rad=np.full(m, SITE.lon_rad),
            height_m=250 + rng.standard_normal(m),
            v_n_m_s=0.03 * rng.standard_normal((m, 3)),
            sigma_velocity_m_s=np.full(m, 0.03),
        ),
        odometer=OdometerLog(time_s=time_s, speed_m_s=np.zeros(m)),
        phases=(
            Phase(phase="alignment", start_s=0, end_s=30),
            Phase(phase="parked", start_s=30, end_s=40),
        ),
    )
    return Run(**{**keys, **changes})


def reference_log() -> ReferenceLog:
    time_s = np.arange(5) * 10.0
    same = np.ones(5)
    return ReferenceLog(
        time_s=time_s,
        lat_rad=SITE.lat_rad * same,
        lon_rad=SITE.lon_rad * same,
        height_m=250.0 * same,
        v_n_m_s=np.zeros((5, 3)),
        roll_rad=0 * same,
        pitch_rad=0.01 * same,
        heading_rad=1.2 * same,
    )


def csv_run(path: Path, **changes) -> Path:
    """A full run as CSV, ready to be damaged."""
    write_run(path, full_run(**changes), reference=reference_log(), fmt="csv")
    return path


def lines(path: Path) -> list[list[str]]:
    return [line.split(",") for line in path.read_text().splitlines()]


def put_lines(path: Path, rows: list[list[str]]) -> None:
    path.write_text("".join(",".join(row) + "\n" for row in rows))


def set_cell(path: Path, *, row: int, column: str, value: str) -> None:
    """Change one value of a CSV; rows count from 1."""
    rows = lines(path)
    rows[row][rows[0].index(column)] = value
    put_lines(path, rows)


def scale_columns(path: Path, prefix: str, factor: float) -> None:
    rows = lines(path)
    for k, name in enumerate(rows[0]):
        if name.startswith(prefix):
            for row in rows[1:]:
                row[k] = repr(float(row[k]) * factor)
    put_lines(path, rows)


def edit_json(path: Path, change) -> None:
    data = json.loads((path / "run.json").read_text())
    change(data)
    (path / "run.json").write_text(json.dumps(data))
