"""Attitude of a hand-held MEMS unit against motion capture: BROAD (Laidig et al. 2021).

The places of the motion capture, five a second and declared good to 1 cm, stand for satellite
fixes; its attitude, which nothing else sees, is the reference. What is constant of the difference
is the reference's own and taken off: its mounting on the unit (three angles), the azimuth of its
frame and its clock. No log is part of the project. The page is docs/real_evidence.md.
"""

import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from benchmarks.real_drives import Source
from benchmarks.study import Record, Work, rms, table
from infield.aided.flight import Aiding
from infield.replay.free_inertial import TableChoice, replay
from ins.attitude import rotation_vector_from_dcm
from ins.earth import dcm_en as C_en_at
from ins.earth import ecef_from_geodetic, geodetic_from_ecef
from ins.filters.aided_filter import level_sigmas
from ins.filters.aided_records import AidedHistory
from ins.records import InputError, Run
from ins.twin_file import default_twin
from ins.units import DEG
from ins.verdicts import sentences
from trajectories.readers.conversion import convert_log

BROAD = "dlaidig/broad", "7e2f8189bb4a3ac91eae32c69b6bc87f08a6e2ad"
TRIALS = (
    "02_undisturbed_slow_rotation_B",
    "10_undisturbed_slow_translation_A",
    "11_undisturbed_slow_translation_B",
    "15_undisturbed_fast_translation_A",
    "16_undisturbed_fast_translation_B",
    "18_undisturbed_fast_translation_with_breaks_B",
)
SITE = {"lat_deg": 52.51, "lon_deg": 13.32, "height_m": 40.0}  # Berlin
FIX_HZ, SIGMA_M = 5.0, 0.01
COLUMNS = ("t", "gx", "gy", "gz", "ax", "ay", "az", "lat", "lon", "h", "sn", "se", "sd")
MAP = {
    "format": "csv",
    "time": {"column": "t", "unit": "s"},
    "gyro": {"columns": list(COLUMNS[1:4]), "unit": "rad/s"},
    "accel": {"columns": list(COLUMNS[4:7]), "unit": "m/s2"},
    "axes": {"x": "x", "y": "-y", "z": "-z"},
    "gnss": {
        "position": {
            "columns": list(COLUMNS[7:10]),
            "unit": "deg",
            "height_unit": "m",
            "sigma": list(COLUMNS[10:]),
        }
    },
}
UNIT = {"imu_serial": "BROAD", "gyro_technology": "mems", "start_utc": "2020-10-01T00:00:00Z"}
C_N_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
C_B_IMU = np.diag([1.0, -1.0, -1.0])
NEAR_S = 0.01  # of a row of the reference; it has holes of seconds
ROBUST_PASSES = 5  # chosen: of the five constants, misfits beyond two medians weighing less


class Trial:
    """A trial: rows of the unit, places and attitude of the motion capture."""

    def __init__(self, path: Path) -> None:
        with h5py.File(path) as file:
            read = {name: np.asarray(file[name]) for name in file}
            self.rate_hz = float(file.attrs["sampling_rate"])
        self.w, self.f = read["imu_gyr"], read["imu_acc"]
        self.place, self.q = read["opt_pos"], read["opt_quat"]
        self.time_s = np.arange(1, len(self.w) + 1) / self.rate_hz

    def run(self) -> Run:
        """As `recal convert` makes it of a table."""
        lat, lon = SITE["lat_deg"] * DEG, SITE["lon_deg"] * DEG
        r_e = ecef_from_geodetic(lat, lon, SITE["height_m"])
        lat_r, lon_r, height = geodetic_from_ecef(
            r_e + self.place @ C_N_ENU.T @ C_en_at(lat, lon).T
        )
        fixes = np.column_stack([lat_r / DEG, lon_r / DEG, height])
        fixes = np.hstack([fixes, np.full(fixes.shape, SIGMA_M)])
        rows = np.hstack([self.time_s[:, None], self.w, self.f])
        step = round(self.rate_hz / FIX_HZ)
        with tempfile.TemporaryDirectory() as made:
            text = Path(made) / "trial.csv"
            with text.open("w", encoding="utf-8") as file:
                file.write(",".join(COLUMNS) + "\n")
                for k, row in enumerate(rows):
                    fixed = k % step == 0 and np.isfinite(fixes[k]).all()
                    late = [f"{v:.11g}" for v in fixes[k]] if fixed else [""] * 6
                    file.write(",".join([*(f"{v:.9g}" for v in row), *late]) + "\n")
            return convert_log(text, MAP, UNIT).run

    def off(self, history: AidedHistory) -> tuple[NDArray, NDArray]:
        """Error (k, 3) about the unit's forward and right axis, level, and down, with its sigma
        [rad], the reference's own constants taken off.
        """
        seen = np.isfinite(self.q).all(axis=1)
        t, at = self.time_s[seen], history.time_s
        k = np.clip(np.searchsorted(t, at), 1, t.size - 1)
        k = k - (np.abs(t[k - 1] - at) < np.abs(t[k] - at))
        rows = np.abs(t[k] - at) < NEAR_S
        k, C_nb = k[rows], history.C_nb[rows]
        C_ref = C_N_ENU @ _dcm(self.q[seen][k]) @ C_B_IMU
        w_b = self.w[seen][k] @ C_B_IMU
        error = rotation_vector_from_dcm(np.swapaxes(C_ref, 1, 2) @ C_nb)
        error = error + (t[k] - at[rows])[:, None] * w_b
        sigma = level_sigmas(history.phi_covariance[rows], C_nb)
        left = _less_constants(error, w_b, C_ref)
        left_n = np.einsum("kij,kj->ki", C_ref, left)
        heading = np.arctan2(C_ref[:, 1, 0], C_ref[:, 0, 0])
        c, s = np.cos(heading), np.sin(heading)
        about = [c * left_n[:, 0] + s * left_n[:, 1], c * left_n[:, 1] - s * left_n[:, 0]]
        return np.column_stack([*about, left_n[:, 2]]), sigma


def _dcm(q: NDArray) -> NDArray:
    """Direction cosines (k, 3, 3) of quaternions (k, 4), the scalar first."""
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _less_constants(error: NDArray, w_b: NDArray, C_ref: NDArray) -> NDArray:
    """What mounting, clock and azimuth of the reference leave."""
    A = np.zeros((len(error), 3, 5))
    A[:, :, :3] = np.eye(3)
    A[:, :, 3], A[:, :, 4] = w_b, C_ref[:, 2, :]
    weight, left = np.ones(len(error)), error
    for _ in range(ROBUST_PASSES):
        found = np.linalg.lstsq(
            (A * weight[:, None, None]).reshape(-1, 5),
            (error * weight[:, None]).ravel(),
            rcond=1e-9,
        )[0]
        left = error - A @ found
        size = np.linalg.norm(left, axis=1)
        weight = 1.0 / np.maximum(1.0, size / (2.0 * np.median(size)))
    return left


def of_trial(name: str, logs: str, clones: str) -> Record:
    """Filter and smoother of a trial against its reference."""
    source = Source(*BROAD, f"data_hdf5/{name}.hdf5", "")
    try:
        trial = Trial(source.fetched(Path(logs), Path(clones) if clones else None))
    except OSError as error:
        return {"name": name, "why": f"not here: {error}"}
    begun_s = time.process_time()
    run = trial.run()
    blank = [TableChoice(role="active", table=None, origin="none")]
    try:
        found = replay(run, blank, default_twin("mems"), aided=Aiding(smooth=True)).aided
    except InputError as error:
        return {"name": name, "why": str(error)}
    if found is None or found.history is None or found.smoothed is None:
        why = "no fixes" if found is None else "; ".join(sentences(found.reasons))
        return {"name": name, "why": why}
    record: Record = {"name": name, "seconds": float(run.imu.end_s)}
    for kind, history in (("filter", found.history), ("smoother", found.smoothed)):
        off, sigma = trial.off(history)
        over = off / sigma
        record[kind] = [[rms(off[:, k]) / DEG, rms(over[:, k])] for k in range(3)]
    record["cpu_s_per_h"] = (time.process_time() - begun_s) / run.imu.end_s * 3600.0
    return record


HEAD = (
    "trial",
    "s",
    "filter: roll, pitch, heading off, deg RMS (over sigma)",
    "smoother: the same",
    "CPU s per hour",
)


def cells(r: Record) -> list[str]:
    """A row of the table."""
    if "why" in r:
        return [r["name"], r["why"], "", "", ""]
    shown = [
        ", ".join(f"{off:.2f} ({ratio:.1f})" for off, ratio in r[kind])
        for kind in ("filter", "smoother")
    ]
    return [r["name"], f"{r['seconds']:.0f}", *shown, f"{r['cpu_s_per_h']:.0f}"]


def run(work: Work, *, logs: Path, clones: str = "") -> str:
    """logs: folder of the logs; what is missing there is taken from clones named OWNER+NAME/repo in
    the folder `clones`, else downloaded.
    """
    found = work.each(of_trial, [(name, str(logs), clones) for name in TRIALS])
    return table(HEAD, [cells(row) for row in found])
