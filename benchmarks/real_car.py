"""Aided replay of a car and of a walker that others recorded, with satellite fixes good to a
centimetre as truth where they are left out.

    python -m benchmarks.real_car LOGS [--clones FOLDER]

The inertial unit (100 Hz, a MEMS chip on the roof of a car; the same on a pole) and RTKLIB's
solution of a u-blox receiver are downloaded from github.com/rtklibexplorer/GNSS_IMU (BSD 3-Clause;
recorded by Tim Everett) into the folder LOGS; nothing of them is part of the project. Rows of the
unit are stamped by a counter of its own and the times at which a computer read its port (the .tag
file of RTKLIB's str2str: the first time, then ticks [ms] and bytes). Prints Markdown tables; the
page made of them is docs/real_drives.md.
"""

import argparse
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_drives import Source
from infield.aided.flight import AidedResult, Aiding, Vehicle
from infield.replay.free_inertial import TableChoice, replay
from infield.reports.words.sentences import sentences
from ins.records import GnssLog, Run
from ins.twin_file import default_twin
from trajectories.readers.conversion import convert_log
from trajectories.readers.rows.gps_time import GPS_EPOCH_UNIX_S

REPOSITORY, COMMIT = "rtklibexplorer/GNSS_IMU", "8235ee6c5f349db529bf43ad556a3769b346b5a1"
EARTH_RADIUS_M = 6_378_137.0
STEP_S = 0.025  # in which speeds are summed beside positions
LAGS_S = np.arange(-0.4, 0.4, 0.005)


@dataclass(frozen=True)
class Recording:
    """A unit and a receiver that went together. axes: of the unit's, which are those of the body;
    starts_s: of the outages, by their length.
    """

    name: str
    vehicle: str
    imu: str
    fixes: str
    axes: tuple[str, str, str]
    antenna_m: tuple[float, float, float]
    starts_s: dict[float, tuple[float, ...]]
    modes: tuple[str, ...]


RECORDINGS = (
    Recording(
        name="drive_0708",
        vehicle="car",
        imu="data/drive_0708/imu_1934.csv",
        fixes="data/drive_0708/gnss_1934_sf.pos",
        axes=("-x", "y", "-z"),
        antenna_m=(0.0, -0.05, 0.0),
        starts_s={30.0: (100.0, 190.0, 280.0, 370.0, 460.0), 60.0: (110.0, 260.0, 410.0)},
        modes=("other", "find", "car"),
    ),
    Recording(
        name="walk_0827",
        vehicle="walker",
        imu="data/walk_0827/imu_1730.csv",
        fixes="data/walk_0827/gnss_1730_sf.pos",
        axes=("-y", "-x", "-z"),
        antenna_m=(0.0, -0.05, 0.0),
        starts_s={15.0: (75.0, 105.0)},
        modes=("other", "find"),
    ),
)


def fetched(path: str, given: argparse.Namespace) -> Path:
    found: Path = Source(REPOSITORY, COMMIT, path, "").fetched(given.logs, given.clones)
    return found


def stamped(imu: Path, tag: Path) -> NDArray:
    """Rows (n, 7) of the unit: GPS time [s], specific force [g], rates [deg/s]. The counter is
    stretched to the first and last time at which its port was read.
    """
    data = tag.read_bytes()
    seconds, part = struct.unpack_from("<Id", data, 64)
    ticks = np.frombuffer(data[76:], dtype="<u4").reshape(-1, 2)[:, 0]
    rows = np.genfromtxt(imu, delimiter=",", skip_header=1, skip_footer=1)
    counted = rows[:, 6] - rows[0, 6]
    first_s = seconds + part - GPS_EPOCH_UNIX_S
    time_s = first_s + counted * (float(ticks[-1]) / 1e3 / counted[-1])
    return np.column_stack([time_s, rows[:, :6]])


def converted(recording: Recording, given: argparse.Namespace) -> Run:
    """The run, as `recal convert --map MAP --gnss FIXES` makes it of rows with GPS time."""
    rows = stamped(fetched(recording.imu, given), fetched(f"{recording.imu}.tag", given))
    path = given.logs / f"{recording.name}.csv"
    np.savetxt(path, rows, delimiter=",", header="t,ax,ay,az,gx,gy,gz", comments="", fmt="%.6f")
    options = {
        "time": {"column": "t", "epoch": "gps"},
        "gyro": {"columns": ["gx", "gy", "gz"], "unit": "deg/s"},
        "accel": {"columns": ["ax", "ay", "az"], "unit": "g"},
        "axes": dict(zip("xyz", recording.axes)),
        "gnss": {"file": str(fetched(recording.fixes, given).absolute())},
    }
    header = {
        "imu_serial": recording.name,
        "gyro_technology": "mems",
        "lever_arms_m": {"gnss": list(recording.antenna_m)},
    }
    return convert_log(path, options, header).run


def velocity_lag(fixes: GnssLog) -> tuple[float, float]:
    """By how much the receiver's velocities are older than its positions [s], and how well the sums
    of velocities then agree with steps of position [m]: of the fixes alone.
    """
    north = (fixes.lat_rad - fixes.lat_rad[0]) * EARTH_RADIUS_M
    east = (fixes.lon_rad - fixes.lon_rad[0]) * EARTH_RADIUS_M * np.cos(fixes.lat_rad[0])
    steps = np.diff(np.column_stack([north, east]), axis=0)
    fine = np.arange(fixes.time_s[0], fixes.time_s[-1], STEP_S)
    found = []
    for lag in LAGS_S:
        way = []
        for axis in (0, 1):
            v = np.interp(fine, fixes.time_s - lag, fixes.v_n_m_s[:, axis])
            gone = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * STEP_S)])
            way.append(np.interp(fixes.time_s, fine, gone))
        off = steps - np.diff(np.column_stack(way), axis=0)
        found.append(float(np.sqrt(np.mean(off[10:-10] ** 2))))
    best = int(np.argmin(found))
    return float(LAGS_S[best]), found[best]


def fly(run: Run, mode: str, starts_s: tuple[float, ...], length_s: float) -> AidedResult:
    asked = Aiding(
        left_out=tuple((start, start + length_s) for start in starts_s),
        smooth=bool(starts_s),
        vehicle=Vehicle(mode),
    )
    choice = [TableChoice(role="active", table=None, origin="none")]
    found = replay(run, choice, default_twin("mems"), aided=asked).aided
    assert found is not None
    return found


def told(recording: Recording, run: Run) -> list[str]:
    """Lines of Markdown on a recording."""
    plain = fly(run, recording.modes[0], (), 0.0)
    assert run.gnss is not None
    lag, left = velocity_lag(run.gnss)
    lines = [
        f"`{recording.name}`: {run.imu.end_s:.0f} s, {plain.verdict}:"
        f" {'; '.join(sentences(plain.notes))}",
        "velocities against steps of position, from the fixes alone:"
        f" {1e3 * lag:.0f} ms, {left:.4f} m RMS",
    ]
    for length_s, starts_s in recording.starts_s.items():
        for mode in recording.modes:
            found = fly(run, mode, starts_s, length_s)
            if mode == Vehicle.FIND:
                lines.append("find: " + next(iter(sentences(found.notes)), ""))
            for was, now in zip(found.outage_scores, found.smoothed_scores, strict=True):
                lines.append(
                    f"| `{recording.name}` | {mode} | {was.start_s:.0f}, {length_s:.0f} s |"
                    f" {was.end_level_m:.1f}, {was.sigma_end_level_m:.1f}"
                    f" ({was.error_over_sigma:.2f}) | {was.rms_level_m:.1f} |"
                    f" {now.rms_level_m:.2f} ({now.error_over_sigma:.2f}) |"
                )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", type=Path)
    parser.add_argument("--clones", type=Path)
    given = parser.parse_args()
    given.logs.mkdir(parents=True, exist_ok=True)
    for recording in RECORDINGS:
        for line in told(recording, converted(recording, given)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
