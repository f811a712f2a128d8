"""The aided replay of a real ArduPilot log against the autopilot's own attitude (ATT messages).

    python benchmarks/aided_real_logs.py LOG.mat|LOG.bin

ATT is an estimate too (a complementary filter on the same sensors, heading by magnetometer):
agreement within degrees is what it can show, not more.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from infield.aided.flight import AidedResult, nis_of, rejected_rows
from infield.replay.free_inertial import TableChoice, replay
from infield.reports.words.sentences import sentences
from ins.attitude import dcm_from_euler, rotation_vector_from_dcm
from ins.filters.aided_filter import level_sigmas
from ins.twin_file import default_twin
from ins.units import DEG
from trajectories.readers.containers import dataflash
from trajectories.readers.conversion import convert_log
from trajectories.readers.formats import ardupilot_mat

FLYING_M_S = 5.0


@dataclass(frozen=True)
class Against:
    """Aided less ATT while flying: median and RMS of the rotation about north, east, down [deg];
    median sigmas [deg].
    """

    median_deg: NDArray
    rms_deg: NDArray
    sigma_deg: NDArray
    seconds: int


def logged_attitude(path: Path) -> tuple[NDArray, NDArray]:
    """Times in the log's own clock [s] and roll, pitch, yaw (n, 3) [rad] of its ATT messages."""
    read = dataflash.read_tables if dataflash.is_dataflash(path) else ardupilot_mat.read_tables
    table = read(path, {"ATT"})[0]["ATT"]
    name, factor = ("TimeUS", 1e-6) if "TimeUS" in table else ("TimeMS", 1e-3)
    angles = np.column_stack([np.asarray(table[k], dtype=float) for k in ("Roll", "Pitch", "Yaw")])
    return np.asarray(table[name], dtype=float) * factor, angles * DEG


def fly(path: Path) -> tuple[AidedResult | None, float]:
    """The aided solution of a log, and the log's time at the run's zero [s]."""
    made = convert_log(path, {}, {})
    table = [TableChoice(role="active", table=None, origin="none")]
    result = replay(made.run, table, default_twin(made.run.header.gyro_technology))
    return result.aided, float(made.record.time_shift_s)


def against_att(result: AidedResult, time_s: NDArray, euler_rad: NDArray) -> Against:
    """What the two attitudes differ by; time_s on the run's clock."""
    history = result.history
    assert history is not None
    k = np.clip(np.searchsorted(time_s, history.time_s), 0, time_s.size - 1)
    off = (
        rotation_vector_from_dcm(history.C_nb @ np.swapaxes(dcm_from_euler(*euler_rad[k].T), 1, 2))
        / DEG
    )
    flying = np.linalg.norm(history.v_n_m_s[:, :2], axis=1) > FLYING_M_S
    sigma = level_sigmas(history.phi_covariance, history.C_nb) / DEG
    return Against(
        median_deg=np.median(np.abs(off[flying]), axis=0),
        rms_deg=np.sqrt(np.mean(off[flying] ** 2, axis=0)),
        sigma_deg=np.median(sigma[flying], axis=0),
        seconds=int(flying.sum()),
    )


def main(path: Path) -> None:
    """Prints verdict, noise, NIS, and the comparison."""
    result, shift_s = fly(path)
    if result is None or result.history is None:
        print("no aided solution:", *(sentences(result.reasons) if result else ("no GNSS",)))
        return
    time_s, euler = logged_attitude(path)
    found = against_att(result, time_s - shift_s, euler)
    print(result.verdict, *sentences((*result.reasons, *result.notes)), sep="\n  ")
    used = [round(nis_of(result.history, k)[0], 2) for k in (0, 1)]
    print("declared NIS", np.round(result.declared_nis, 2), "used NIS", used)
    print(
        "rejected",
        [rejected_rows(result.history, k).size for k in (0, 1)],
        "of",
        len(result.history.fix_time_s),
    )
    print(f"against ATT over {found.seconds} s of flight, about north, east, down [deg]:")
    for name, value in (
        ("median", found.median_deg),
        ("RMS", found.rms_deg),
        ("median sigma", found.sigma_deg),
    ):
        print(f"  {name:14s}", np.round(value, 2))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
