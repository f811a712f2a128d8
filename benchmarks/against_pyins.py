"""Outages of public logs beside pyins (`pip install pyins`): the same log, fixes, start, antenna
and noise, its feedback filter.

Logs as in `benchmarks.real_drives`; the outages are at the same shares of the time that has fixes.
pyins is given what aided replay found
of the log beside what was declared: where and at which attitude it starts and how sure that is, the
noise, the lever arm, the delay of the fixes. Its states are position, velocity,
attitude, biases, scale factors and misalignments. Scored: level RMS in each outage, against the
fixes that were left out.
"""

import warnings
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.real_drives import Source, converted, fly, sources, stretches
from benchmarks.study import Work, table
from infield.aided.flight import AidedResult
from ins.attitude import dcm_from_euler, euler_from_dcm
from ins.earth import displacement_ned, geodetic_from_ecef
from ins.filters.aided_records import Fixes
from ins.filters.states import AIDED_ACCEL, AIDED_GYRO, AIDED_POS, AIDED_THETA, AIDED_VEL
from ins.records import ImuLog, InputError, Run

Spans = tuple[tuple[float, float], ...]


def increments(imu: ImuLog) -> pd.DataFrame:
    """As pyins takes them."""
    from pyins import util

    columns = np.column_stack([imu.dt_s, imu.dtheta_rad, imu.dv_m_s])
    names = ["dt", *util.THETA_COLS, *util.DV_COLS]
    return pd.DataFrame(columns, index=np.round(imu.time_s, 6), columns=names)


def measurements(fixes: Fixes, lever_arm_m: NDArray, after_s: float) -> list:
    """Positions and velocities after the start, each kind with one sigma, as pyins has it."""
    from pyins import measurements, util

    found = []
    for kind, values, sigma, names in (
        (measurements.Position, fixes.r_e_m, fixes.sigma_position_m, util.LLA_COLS),
        (measurements.NedVelocity, fixes.v_n_m_s, fixes.sigma_velocity_m_s, util.VEL_COLS),
    ):
        rows = np.isfinite(values).all(axis=1) & (fixes.time_s > after_s)
        columns = values[rows]
        if kind is measurements.Position:
            lat, lon, height = geodetic_from_ecef(columns)
            columns = np.column_stack([np.degrees(lat), np.degrees(lon), height])
        table = pd.DataFrame(columns, index=np.round(fixes.time_s[rows], 6), columns=names)
        table = table[~table.index.duplicated()]
        found.append(kind(table, float(np.median(sigma[rows])), lever_arm_m))
    return found


def theirs(run: Run, found: AidedResult) -> pd.DataFrame:
    """The trajectory of pyins."""
    from pyins import filters, inertial_sensor, util

    assert found.found is not None and found.antenna is not None and found.given is not None
    start, antenna, noise = found.found.start, found.antenna.antenna, found.given.noise
    sigma = np.sqrt(np.diag(start.covariance))
    at, state = np.zeros(9), start.state
    at[:3] = np.degrees(state.site.lat_rad), np.degrees(state.site.lon_rad), state.site.height_m
    at[3:6], at[6:] = state.v_n_m_s, np.degrees(euler_from_dcm(state.C_nb))
    fixes = found.given.fixes.earlier(antenna.delay_s)
    log = run.imu.between(state.time_s + 1e-6, run.imu.end_s)
    misaligned = np.full((3, 3), noise.misalignment_rad)
    np.fill_diagonal(misaligned, noise.gyro_scale)
    gyro = inertial_sensor.EstimationModel(
        bias_sd=sigma[AIDED_GYRO],
        noise=noise.arw,
        bias_walk=noise.gyro_walk,
        scale_misal_sd=misaligned,
    )
    accel = inertial_sensor.EstimationModel(
        bias_sd=sigma[AIDED_ACCEL],
        noise=noise.vrw,
        bias_walk=noise.accel_walk,
        scale_misal_sd=noise.accel_scale * np.eye(3),
    )
    return filters.run_feedback_filter(
        pd.Series(at, index=util.TRAJECTORY_COLS, name=round(state.time_s, 6)),
        float(sigma[AIDED_POS].max()),
        float(sigma[AIDED_VEL].max()),
        float(np.degrees(sigma[AIDED_THETA][:2].max())),
        float(np.degrees(sigma[AIDED_THETA][2])),
        increments(log),
        gyro,
        accel,
        measurements=measurements(fixes, antenna.lever_arm_m, state.time_s),
    ).trajectory


def level_rms_m(found: AidedResult, trajectory: pd.DataFrame, span: tuple[float, float]) -> float:
    """Of a trajectory, at the antenna, against the fixes of an outage."""
    assert found.every is not None and found.antenna is not None
    antenna, fixes = found.antenna.antenna, found.every
    rows = (fixes.time_s >= span[0]) & (fixes.time_s <= span[1])
    rows &= np.isfinite(fixes.r_e_m[:, 0])
    t = np.asarray(trajectory.index, dtype=float)
    when = fixes.time_s[rows] - antenna.delay_s
    lat, lon = (np.interp(when, t, trajectory[name]) for name in ("lat", "lon"))
    near = trajectory.iloc[np.clip(np.searchsorted(t, when), 0, t.size - 1)]
    C_nb = dcm_from_euler(*np.radians(near[["roll", "pitch", "heading"]].to_numpy().T))
    seen = geodetic_from_ecef(fixes.r_e_m[rows])
    off = displacement_ned(
        np.radians(lat), np.radians(lon), lat0_rad=seen[0], lon0_rad=seen[1], height0_m=seen[2]
    )
    level = np.asarray(off)[:, :2] + (C_nb @ antenna.lever_arm_m)[:, :2]
    return float(np.sqrt(np.mean(np.sum(level**2, axis=1))))


def compared(source: Source, path: Path) -> list[list[str]]:
    """A line of the table for each outage of a log."""
    try:
        run = converted(path).run
    except InputError:
        return []
    if run.gnss is None:
        return []
    first_s = max(run.imu.start_s, float(run.gnss.time_s[0]))
    last_s = min(run.imu.end_s, float(run.gnss.time_s[-1]))
    t = run.gnss.time_s
    left_out = tuple(
        (a, b) for a, b in stretches(first_s, last_s) if np.any((t > a) & (t < b))
    )  # some receivers stop of themselves
    found = fly(run, left_out) if left_out else None
    if found is None or found.history is None or found.found is None:
        return []
    try:
        trajectory = theirs(run, found)
    except (ValueError, np.linalg.LinAlgError) as error:
        return [[f"`{source.path}`", "", "", "", f"pyins: {error}", ""]]
    lines = []
    for score, late in zip(found.outage_scores, found.smoothed_scores, strict=True):
        other = level_rms_m(found, trajectory, (score.start_s, score.end_s))
        lines.append(
            [
                f"`{source.path}`",
                f"{score.end_s - score.start_s:.0f} s",
                found.verdict,
                f"{score.rms_level_m:.1f} ({score.error_over_sigma:.2f})",
                f"{other:.1f}",
                f"{late.rms_level_m:.1f}",
            ]
        )
    return lines


def beside(name: str, logs: str, clones: str) -> list[list[str]]:
    """A row of the table for each outage of a log, by its path."""
    warnings.filterwarnings("ignore")
    source = next(s for s in sources() if s.path == name)
    return compared(source, source.fetched(Path(logs), Path(clones) if clones else None))


def run(work: Work, *, logs: Path, clones: str = "") -> str:
    """logs, clones: as of `real_drives`."""
    found = work.each(beside, [(source.path, str(logs), clones) for source in sources()])
    head = ("log", "outage", "verdict", "recal, level RMS, m (error/sigma)", "pyins")
    return table((*head, "recal, smoothed"), [row for rows in found for row in rows])
