"""The main job on public logs: a table learnt from some power-ons, predicted on the others.

Each session is left out in turn. The table of the others, from nothing, predicts its mean zero
rates; what is predicted is compared with what its gyros read, over the sigma of both (table,
turn-on, attitude, Earth rate on an unknown heading, noise). No log is part of the project: they are
taken from clones or downloaded. The page is docs/real_evidence.md.
"""

import re
import struct
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from benchmarks.real_drives import Source
from benchmarks.study import Record, Work, table
from infield.session.parked.zero_rate import unknown_sigma_deg_h
from infield.session.pipeline import update_calibration
from infield.session.results import SessionResult
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable, default_table
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.errors.table import DEFAULT_SIGMA_deg_h
from ins.records import AXES, InputError, Run
from ins.twin_file import default_twin
from ins.units import DEG_PER_HOUR, HOUR
from ins.verdicts import sentences
from trajectories.readers.conversion import convert_log

COLUMNS = ("t", "gx", "gy", "gz", "ax", "ay", "az", "T")
MAP = {
    "time": {"column": "t", "unit": "s"},
    "gyro": {"columns": list(COLUMNS[1:4]), "unit": "deg/s"},
    "accel": {"columns": list(COLUMNS[4:7]), "unit": "g"},
    "temperature": {"columns": list(COLUMNS[7:]), "unit": "degC"},
}
ALIKE = (0.8, 1.25)  # of predictive error over sigma: issue 39
PSAS_HEAD, PSAS_ADIS = struct.Struct(">4sHIH"), struct.Struct(">12h")


def hdf5_rows(folder: Path) -> NDArray:
    """Rows of a session of sunsided/sensor-fusion: a MATLAB file of each sensor."""
    parts = []
    for name in ("gyroscope", "accelerometer", "temperature"):
        (path,) = folder.glob(f"*mpu6050_{name}.mat")
        with h5py.File(path) as file:
            (values,) = file.values()
            parts.append(np.asarray(values).T)
    gyro, accel, degC = parts
    return np.column_stack([gyro, accel[:, 1:], degC[:, 1]])[gyro[:, 0] > 0.0]


def psas_rows(folder: Path) -> NDArray:
    """Rows of a log of the Portland State Aerospace Society: messages of a name, a time [ns], a
    length; those of the ADIS16405 in counts.
    """
    (path,) = folder.iterdir()
    data, at, rows = path.read_bytes(), 0, []
    while at + PSAS_HEAD.size <= len(data):
        name, high, low, size = PSAS_HEAD.unpack_from(data, at)
        at += PSAS_HEAD.size
        if name == b"ADIS" and at + size <= len(data):
            rows.append(((high * 2**32 + low) * 1e-9, *PSAS_ADIS.unpack_from(data, at)))
        at += size
    t, counts = np.array(rows)[:, :1], np.array(rows)[:, 1:]
    return np.hstack(
        [t, 0.05 * counts[:, 1:4], 0.00333 * counts[:, 4:7], 25.0 + 0.14 * counts[:, 10:11]]
    )


@dataclass(frozen=True)
class Unit:
    """Power-ons of one unit: repository, commit, the paths of each session's files; read: rows of
    COLUMNS from the folder that holds them; accel_scale: -1 where a log has gravity in its place;
    axes: that bring z down where the unit stands as it usually does.
    """

    name: str
    repository: str
    commit: str
    sessions: tuple[tuple[str, ...], ...]
    read: Callable[[Path], NDArray]
    lat_deg: float
    accel_scale: float = 1.0
    axes: tuple[str, str, str] = AXES

    def runs(self, logs: Path, clones: Path | None) -> list[Run]:
        """Each session as `recal convert` makes it of a table."""
        return [
            self._run(number, paths, logs, clones) for number, paths in enumerate(self.sessions)
        ]

    def _run(self, number: int, paths: tuple[str, ...], logs: Path, clones: Path | None) -> Run:
        folder = logs / self.name.replace(" ", "-") / f"{number:02d}"
        for path in paths:
            Source(self.repository, self.commit, path, "").fetched(folder, clones)
        rows = self.read(folder)
        given = {
            "imu_serial": self.name,
            "gyro_technology": "mems",
            "start_utc": f"2020-01-{number + 1:02d}T00:00:00Z",
            "lat_deg": self.lat_deg,
            "any_attitude": True,
        }
        keys = MAP | {"accel": MAP["accel"] | {"scale": self.accel_scale}}
        keys["axes"] = dict(zip(AXES, self.axes))
        with tempfile.TemporaryDirectory() as made:
            text = Path(made) / f"session-{number}.csv"
            np.savetxt(text, rows, "%.10g", ",", header=",".join(COLUMNS), comments="")
            return convert_log(text, keys, given).run


def _sunsided(number: int, names: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    sensors = ("accelerometer", "gyroscope", "temperature")
    return tuple(
        tuple(f"data/set-{number}/{name}/mpu6050_{sensor}.mat" for sensor in sensors)
        for name in names
    )


LEFT_UP = ("x", "-y", "-z")
SUNSIDED = "sunsided/sensor-fusion", "f16045a9d1d4f9037a183f436fe3c098a38ad99d"
UNITS = (
    Unit(
        "MPU-6050 set 1",
        *SUNSIDED,
        _sunsided(
            1, ("unmoved-x-pointing-forward", "unmoved-x-pointing-up", "unmoved-z-pointing-left")
        ),
        hdf5_rows,
        52.5,
        axes=LEFT_UP,
    ),
    Unit(
        "MPU-6050 set 2",
        *SUNSIDED,
        _sunsided(
            2,
            (
                "unmoved-with-x-pointing-forward-10min",
                "unmoved-with-x-pointing-forward",
                "unmoved-with-z-pointing-front-and-x-up",
                "unmoved-with-z-pointing-front-and-y-down",
            ),
        ),
        hdf5_rows,
        52.5,
        -1.0,
        LEFT_UP,
    ),
    Unit(
        "ADIS16405 of a rocket",
        "psas/Launch-11",
        "b6eaeca7ba7fa39ae7dc76b0edbf2bb62ccad4f0",
        (
            ("droptest/2014-05-09-baseline-0/logfile-000",),
            ("droptest/2014-05-13-baseline-1/logfile-000",),
        ),
        psas_rows,
        45.5,
    ),
)
SWEEP = Source(
    "yandld/nav_matlab",
    "b29be05bda01c98b2a9b40d0992d4a59d5d3608b",
    "example/temperature_calibration/test.log",
    "",
)


def table_of(runs: list[Run]) -> ThermalTable:
    """What an update makes of runs of a unit that nobody knows."""
    twin, first = default_twin("mems"), runs[0]
    temperature = None if first.temperature is None else gyro_temperature(first.temperature)
    usual = DEFAULT_SIGMA_deg_h["mems"]
    sigma = unknown_sigma_deg_h(first, twin, temperature, usual)
    blank = default_table(
        imu_serial=first.header.imu_serial,
        gyro_technology="mems",
        created_utc="2019-01-01T00:00:00Z",
        sigma_deg_h=sigma,
    )
    return update_calibration(runs, blank, twin, settings=SessionSettings()).after


def predicted(left_out: Run, table_deg_h: ThermalTable) -> tuple[NDArray, NDArray, NDArray]:
    """Of a session's mean rates (3,): what the table leaves, its sigma, and the rates themselves
    [deg/h]. InputError where the session was not estimated.
    """
    (taken,) = update_calibration([left_out], table_deg_h, default_twin("mems")).sessions
    return innovation(taken)


def innovation(taken: SessionResult) -> tuple[NDArray, NDArray, NDArray]:
    e = taken.estimate
    if e is None or e.parked is None:
        raise InputError("; ".join(sentences(taken.verdict.reasons)))
    p = e.parked
    seconds = np.where(np.isfinite(p.rate_deg_h).all(axis=1), p.used_s, 0.0)
    weight = seconds / seconds.sum()
    rows = np.kron(weight, np.eye(3))
    left = weight @ np.nan_to_num(p.rate_deg_h)
    variance = np.diag(rows @ e.bins.prior @ rows.T) + p.of_mean(p.earth.covariance)
    variance = variance + p.walk_deg_sqrt_h**2 / (seconds.sum() / HOUR)
    return left, np.sqrt(variance), left + rows @ e.bins.table_deg_h


def of_unit(name: str, logs: str, clones: str) -> Record:
    """Every session of a unit, predicted by the others."""
    unit = next(u for u in UNITS if u.name == name)
    try:
        runs = unit.runs(Path(logs), Path(clones) if clones else None)
    except (OSError, InputError) as error:
        return {"name": name, "why": f"not here: {error}"}
    sessions, refused = [], []
    for k, run in enumerate(runs):
        try:
            left, sigma, rate = predicted(run, table_of([*runs[:k], *runs[k + 1 :]]))
            sessions.append([left.tolist(), sigma.tolist(), rate.tolist()])
        except InputError as error:
            refused.append(str(error))
    degC = [np.nanmean(run.temperature.gyro_degC) for run in runs if run.temperature]
    return {"name": name, "sessions": sessions, "refused": refused, "degC": [min(degC), max(degC)]}


def of_sweep(logs: str, clones: str) -> Record:
    """A chamber's means by temperature: every other one predicts those between."""
    try:
        path = SWEEP.fetched(Path(logs), Path(clones) if clones else None)
    except OSError as error:
        return {"name": "HiPNUC sweep", "why": f"not here: {error}"}
    lines = re.findall(r"BIN_DATA:([^\n]*)", path.read_text("utf-8", errors="replace"))
    bins = np.array([[float(x) for x in line.split(",")[:10]] for line in lines])
    bins = bins[bins[:, 2] > 1000]  # rows in a bin
    degC, rate = bins[:, 1], bins[:, 7:10] / DEG_PER_HOUR
    odd = np.arange(degC.size) % 2 == 1
    sigma = float(np.abs(rate).max())
    blank = default_table(
        imu_serial="H",
        gyro_technology="mems",
        created_utc="2019-01-01T00:00:00Z",
        sigma_deg_h=sigma,
    )
    gyro, sessions = default_twin("mems").gyro, []
    walk = gyro.arw_deg_sqrt_h**2 / (bins[:, 2] / 200.0 / HOUR)
    noise = np.diag(walk + gyro.bias_instability_deg_h**2)
    noise += gyro.turn_on_deg_h**2  # one power-on: the same of all its bins
    for axis in range(3):
        H = blank.basis(axis, degC)
        S = H @ blank.covariance @ H.T + noise
        gain = np.linalg.solve(S[np.ix_(odd, odd)], S[np.ix_(odd, ~odd)]).T
        left = rate[~odd, axis] - gain @ rate[odd, axis]
        P = S[np.ix_(~odd, ~odd)] - gain @ S[np.ix_(odd, ~odd)]
        sessions.append([left.tolist(), np.sqrt(np.diag(P)).tolist(), rate[~odd, axis].tolist()])
    return {
        "name": "HiPNUC sweep, by bins",
        "sessions": sessions,
        "refused": [],
        "degC": [float(degC.min()), float(degC.max())],
    }


HEAD = (
    "unit",
    "sessions predicted",
    "degC",
    "no table, RMS deg/h",
    "with table, RMS deg/h",
    "predicted sigma, RMS deg/h",
    "error over sigma, RMS",
    "of x, y, z",
)


def cells(r: Record) -> list[str]:
    """A row of the table."""
    if "why" in r or not r["sessions"]:
        why = r.get("why") or "refused: " + "; ".join(dict.fromkeys(r["refused"]))
        return [r["name"], why, *[""] * 6]
    left, sigma, rate = (np.array([s[k] for s in r["sessions"]]) for k in range(3))
    ratio = left / sigma
    sizes = [f"{np.sqrt(np.mean(v**2)):.3g}" for v in (rate, left, sigma)]
    by_axis = np.sqrt(np.mean(ratio**2, axis=0)) if ratio.shape[1] == len(AXES) else ()
    return [
        r["name"],
        f"{len(r['sessions'])}" + (f" ({len(r['refused'])} refused)" if r["refused"] else ""),
        f"{r['degC'][0]:.1f} to {r['degC'][1]:.1f}",
        *sizes,
        f"{np.sqrt(np.mean(ratio**2)):.2f}",
        ", ".join(f"{v:.2f}" for v in by_axis),
    ]


def run(work: Work, *, logs: Path, clones: str = "") -> str:
    """logs: folder of the logs; what is missing there is taken from clones named OWNER+NAME/repo in
    the folder `clones`, else downloaded.
    """
    found = work.each(of_unit, [(unit.name, str(logs), clones) for unit in UNITS])
    found += work.each(of_sweep, [(str(logs), clones)])
    return table(HEAD, [cells(row) for row in found])
