"""Gyros and accelerometers that say nothing: no value in any row, or the same one in all.

What the others see is looked at all the same. In place of the dead sensor's reading stands what
gravity and Earth rate leave for it at rest, so that level and heading can be had; its own rows are
no evidence (`Seconds.dead`), and nothing is navigated with it.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.seconds import seconds_of
from ins.attitude import dcm_from_euler
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude, omega_ie_n
from ins.records import AXES, ImuLog, ImuSource, Run
from ins.strapdown.compensation import corrected

# of its size: a rate that varies by less was computed, not measured; doubles round by 1e-16, a
# converter of 24 bits by 6e-8
COMPUTED_SHARE = 1e-9
# part of the vertical that a gyro must see to be told by the vertical Earth rate; an axis 17 deg
# above the horizon
LEVELLED = 0.3
FIRST_S = 300.0  # of the log: the vehicle stands for 5 min, as a rule


def dead_columns(imu: ImuSource) -> NDArray:
    """Sensors (6,), gyros then accelerometers, without a value or without any change over the
    log.
    """
    log = seconds_of(imu)
    low = np.roll(np.fmin.reduce(log.low), 3)
    high = np.roll(np.fmax.reduce(log.high), 3)
    with np.errstate(invalid="ignore"):
        return np.asarray(
            ~np.isfinite(low)
            | (high - low <= COMPUTED_SHARE * np.maximum(np.abs(low), np.abs(high)))
        )


def with_dead_filled(run: Run, dead: NDArray) -> tuple[Run, NDArray, list[str]] | str:
    """The run with constants in place of dead sensors, these constants (6,), and notes; words where
    too few are left.
    """
    if not dead.any():
        return run, np.zeros(6), []
    names = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in AXES]
    listed = ", ".join(name for name, gone in zip(names, dead) if gone)
    heading = run.header.survey.heading_rad
    if dead[3:].sum() > 1 or dead[:3].sum() > (3 if heading is not None else 1):
        return (
            f"{listed}: no values that change; level needs two accelerometers, heading two gyros or"
            " a survey"
        )
    middle = _medians(run.imu)
    notes = [
        f"{listed}: no values that change, left out; what follows the parked stretch is not"
        " looked at"
    ]
    force = _force(middle[3:], dead[3:], run)
    rate, more = _rate(middle[:3], dead[:3], -force / np.linalg.norm(force), run)
    fill = np.concatenate([rate, force])

    def put(piece: ImuLog) -> ImuLog:
        values = np.where(
            dead, fill * piece.dt_s[:, None], np.hstack([piece.dtheta_rad, piece.dv_m_s])
        )
        return replace(piece, dtheta_rad=values[:, :3].copy(), dv_m_s=values[:, 3:].copy())

    return replace(run, imu=corrected(run.imu, put)), fill, notes + more


def _medians(imu: ImuSource) -> NDArray:
    """Medians (6,) of the rows of the first minutes [rad/s, m/s^2]."""
    first = imu.between(-np.inf, imu.start_s + FIRST_S)
    rate = np.hstack([first.dtheta_rad, first.dv_m_s]) / first.dt_s[:, None]
    seconds = max(round(imu.rate_hz), 1)
    whole = rate[: max(len(rate) // seconds, 1) * seconds]
    means = whole.reshape(-1, min(seconds, len(whole)), 6).mean(axis=1)
    return np.asarray(np.median(means, axis=0))


def _force(seen: NDArray, dead: NDArray, run: Run) -> NDArray:
    """Specific force at rest: a dead z has what is left of gravity, a dead x or y is taken as
    level.
    """
    force = np.where(dead, 0.0, seen)
    gravity = float(gravity_magnitude(run.header.site.lat_rad, run.header.site.height_m))
    if dead[2]:
        force[2] = -np.sqrt(max(gravity**2 - float(force @ force), (0.5 * gravity) ** 2))
    return force


def _rate(seen: NDArray, dead: NDArray, down: NDArray, run: Run) -> tuple[NDArray, list[str]]:
    """Earth rate at rest, from a surveyed heading, else the vertical part, else the size of the
    whole.
    """
    rate, lat = np.where(dead, 0.0, seen), run.header.site.lat_rad
    if not dead.any():
        return rate, []
    heading = run.header.survey.heading_rad
    if heading is not None:
        roll, pitch = np.arctan2(down[1], down[2]), np.arcsin(np.clip(-down[0], -1.0, 1.0))
        return np.where(dead, dcm_from_euler(roll, pitch, heading).T @ omega_ie_n(lat), seen), []
    k = int(np.argmax(dead))
    if abs(down[k]) > LEVELLED:
        rate[k] = (omega_ie_n(lat)[2] - rate @ down) / down[k]
        return rate, []
    rate[k] = np.sqrt(max(EARTH_RATE_RAD_S**2 - float(rate @ rate), 0.0))
    return rate, [
        f"gyro_{AXES[k]} dead: two headings fit, the one with a positive rate on it is assumed"
        " (a surveyed heading decides)"
    ]
