"""KITTI and EuRoC folders, written file by file from their descriptions."""

import os

import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.readers.known_motion import (
    GIVEN,
    HEADING_DEG,
    HEIGHT_M,
    LAT_DEG,
    LON_DEG,
    PITCH_DEG,
    ROLL_DEG,
    Output,
    check_parked,
    parked,
)
from trajectories.readers.conversion import convert_log

FLU = np.array([1.0, -1.0, -1.0])
UP_RIGHT_FORWARD = [2, 1, 0], np.array([-1.0, 1.0, 1.0])  # of forward, right, down
OUT = parked(seconds=10.0)
START_NS = 1_772_341_200_000_000_000  # 2026-03-01T05:00:00Z
YAML = """#Default imu sensor yaml file
sensor_type: imu
comment: VI-Sensor IMU (ADIS16448)
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0,
         0.0, 1.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 200
"""
HEAD = "#timestamp [ns]," + ",".join(
    [f"w_RS_S_{a} [rad s^-1]" for a in "xyz"] + [f"a_RS_S_{a} [m s^-2]" for a in "xyz"]
)
KNOWN = {"imu_serial": "SN-1", "gyro_technology": "mems"}


def euroc(folder, output: Output = OUT, *, yaml=YAML):
    """x up, y right, z forward, as the VI-Sensor lies; else forward, left, up."""
    (folder / "mav0" / "imu0").mkdir(parents=True)
    dt = output.time_s[1] - output.time_s[0]
    order, sign = UP_RIGHT_FORWARD if yaml else ([0, 1, 2], FLU)
    values = np.hstack([output.dtheta[:, order] * sign, output.dv[:, order] * sign]) / dt
    stamps = START_NS + np.round(output.time_s * 1e9).astype(np.int64)
    rows = [f"{t}," + ",".join(f"{v:.12g}" for v in row) for t, row in zip(stamps, values)]
    file = folder / "mav0" / "imu0" / "data.csv"
    file.write_text("\r\n".join([HEAD, *rows, ""]))
    if yaml:
        file.with_name("sensor.yaml").write_text(yaml)
    return file


@pytest.mark.parametrize("place", ["", "mav0", "mav0/imu0", "mav0/imu0/data.csv"])
def test_euroc(tmp_path, place):
    euroc(tmp_path / "MH_01")
    given = {k: v for k, v in GIVEN.items() if k not in ("start_utc", "gyro_technology")}
    made = convert_log(tmp_path / "MH_01" / place, {}, given)
    check_parked(made.run, OUT)
    assert made.record.format == "euroc" and made.run.header.gyro_technology == "mems"
    assert made.run.header.start_utc == "2026-03-01T05:00:00.000Z"
    assert "axes of the sensor taken as x up, y right, z forward" in str(made.record.notes)


def moments(output: Output = OUT):
    """Rows of 30 numbers; the solution stands still, left side up, front up, heading 40 deg."""
    dt = output.time_s[1] - output.time_s[0]
    w, f = output.dtheta / dt * FLU, output.dv / dt * FLU
    angles = np.radians([ROLL_DEG, -PITCH_DEG, 90.0 - HEADING_DEG])
    n = output.rows
    left = np.tile([LAT_DEG, LON_DEG, HEIGHT_M, *angles, 1.0, 2.0, 2.2, 0.0, 0.5], (n, 1))
    return np.hstack([left, f, f, w, w, np.tile([0.1, 0.02, 4, 9, 4, 4, 6], (n, 1))])


def kitti(folder, output: Output = OUT):
    data = folder / "oxts" / "data"
    data.mkdir(parents=True)
    for k, row in enumerate(moments(output)):
        (data / f"{k:010d}.txt").write_text(" ".join(f"{v:.14g}" for v in row))
    first = np.datetime64("2011-09-26T23:59:55", "ns")
    stamps = first + np.round(output.time_s * 1e9).astype("timedelta64[ns]")
    (folder / "oxts" / "timestamps.txt").write_text(
        "".join(f"{str(t).replace('T', ' ')}\n" for t in stamps)
    )
    return folder


def check_truth(made):
    truth = made.reference
    angles = np.degrees([truth.roll_rad[0], truth.pitch_rad[0], truth.heading_rad[0]])
    np.testing.assert_allclose(angles, [ROLL_DEG, PITCH_DEG, HEADING_DEG])
    np.testing.assert_allclose(truth.v_n_m_s[0], [1.0, 2.0, -0.5])


@pytest.mark.parametrize("place", ["", "oxts"])
def test_kitti(tmp_path, place):
    """Over midnight; nothing of the solution is a fix."""
    path = kitti(tmp_path / "2011_09_26_drive_0001_extract") / place
    made = convert_log(path, {}, KNOWN)
    check_parked(made.run, OUT)
    assert made.record.format == "kitti" and made.run.gnss is None
    assert made.run.header.start_utc == "2011-09-26T23:59:55.000Z"
    assert made.run.header.site.height_m == pytest.approx(HEIGHT_M)
    check_truth(made)
    notes = " ".join(made.record.notes)
    assert "heights are above mean sea level" in notes and "no time zone: taken as UTC" in notes


def test_links_and_pipes_of_a_folder_are_not_read(tmp_path):
    path = kitti(tmp_path / "drive")
    outside = tmp_path / "outside.txt"
    moment = path / "oxts" / "data" / f"{5:010d}.txt"
    outside.write_text(moment.read_text())
    moment.unlink()
    moment.symlink_to(outside)
    pipe = path / "oxts" / "data" / f"{6:010d}.txt"
    pipe.unlink()
    os.mkfifo(pipe)
    notes = convert_log(path, {}, KNOWN).record.notes
    assert any("data rows 6-7 missing or damaged" in note for note in notes)
    file = euroc(tmp_path / "MH_01")
    file.rename(tmp_path / "moved.csv")
    file.symlink_to(tmp_path / "moved.csv")
    with pytest.raises(InputError, match="a folder without a bag"):
        convert_log(tmp_path / "MH_01", {}, GIVEN | KNOWN)


def tracking(path):
    """A text of the tracking benchmark: rows at 10 Hz without a time."""
    np.savetxt(path, moments(parked(dt=0.1, seconds=24.0)), fmt="%.14g")
    return path


def test_rows_of_the_tracking_benchmark(tmp_path):
    made = convert_log(tracking(tmp_path / "0000.txt"), {}, GIVEN | KNOWN)
    check_parked(made.run, parked(dt=0.1, seconds=24.0))
    check_truth(made)
    assert made.record.format == "kitti"
