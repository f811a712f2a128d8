"""Thermometers, receiver and wheels of a parked run: noise, resolution, and how long an error
lasts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.kinds import ROLLING
from ins.earth import radii_of_curvature
from ins.robust import robust_sigma
from simreal.twin.fit.streams import ParkedStream

# of the steps between readings that a resolution must explain: 1 in 1,000 may be a glitch
GRID_SHARE = 0.999
GRID_OFF = 0.02  # of a step: readings are rounded to 1e-9, noise lies within it in 4 %
GRID_NEAR = 20.0  # steps that are looked at: an error of 0.001 of a step adds up to GRID_OFF
SECOND_DIFFERENCE = 6.0  # variance of a second difference of white readings
FEWEST_SEEN = 30  # readings: a sigma to 13 %
SHORTEST_FIX_S = 300.0  # of rest, for a receiver whose errors last 1 to 2 min
CORRELATED = np.exp(-1.0)


@dataclass(frozen=True)
class Sample:
    """A sigma with the readings behind it."""

    sigma: float
    count: float


@dataclass(frozen=True)
class Thermometers:
    """noise [degC] without rounding, and resolution [degC], 0 where readings lie on no grid."""

    noise: Sample
    resolution: float


def thermometers(streams: list[ParkedStream]) -> Thermometers | None:
    """What all gyro thermometers of the runs show."""
    columns = [
        column[np.isfinite(column)]
        for stream in streams
        if stream.run.temperature is not None
        for column in stream.run.temperature.gyro_degC.T
    ]
    columns = [column for column in columns if column.size > FEWEST_SEEN]
    if not columns:
        return None
    step = resolution(columns)
    seconds = np.concatenate([np.diff(column, n=2) for column in columns])
    total = float(np.mean(seconds**2)) / SECOND_DIFFERENCE
    own = max(total - step**2 / 12.0, 0.0)
    count = seconds.size * 18.0 / 35.0  # second differences overlap: (sum r)^2 / sum r^2
    return Thermometers(Sample(float(np.sqrt(own)), count), step)


def resolution(columns: list[NDArray]) -> float:
    """The step that all readings are whole multiples of, apart; 0 where there is none."""
    found = np.unique(np.round(np.concatenate(columns), 9))
    steps = np.diff(found)
    steps = steps[steps > 1e-6]
    if steps.size < 2:
        return 0.0
    step = float(np.median(steps[steps < 1.5 * steps.min()]))
    ratio = steps[steps < GRID_NEAR * step] / step
    whole = np.abs(ratio - np.round(ratio)) < GRID_OFF
    return step if whole.mean() > GRID_SHARE else 0.0


def receiver(streams: list[ParkedStream]) -> dict[str, Sample]:
    """Sigmas of position and velocity while parked, by key of the twin; velocities about zero,
    positions about their mean, so that what lasts longer than the rest is not in them.
    """
    position: list[NDArray] = []
    height: list[NDArray] = []
    velocity: list[NDArray] = []
    for stream in streams:
        gnss = stream.run.gnss
        if gnss is None or stream.still_s < SHORTEST_FIX_S:
            continue
        at = _at_rest(stream, gnss.time_s)
        if at.sum() < FEWEST_SEEN:
            continue
        lat, lon = gnss.lat_rad[at], gnss.lon_rad[at]
        meridian, transverse = radii_of_curvature(lat)
        north = (lat - lat.mean()) * meridian
        east = (lon - lon.mean()) * transverse * np.cos(lat)
        position += [north, east]
        height.append(gnss.height_m[at] - gnss.height_m[at].mean())
        velocity += [column for column in gnss.v_n_m_s[at].T if np.isfinite(column).all()]
    named = {
        "gnss.sigma_horizontal_m": position,
        "gnss.sigma_vertical_m": height,
        "gnss.sigma_velocity_m_s": velocity,
    }
    return {name: _sample(columns) for name, columns in named.items() if columns}


def wheels(streams: list[ParkedStream]) -> Sample | None:
    """Noise of the wheels' speed: parked where they read anything, else from what neighbouring
    readings differ by while they roll (an upper limit where the vehicle jerks).
    """
    parked: list[NDArray] = []
    rolling: list[NDArray] = []
    for stream in streams:
        log = stream.run.odometer
        if log is None:
            continue
        parked.append(log.speed_m_s[_at_rest(stream, log.time_s)])
        if stream.motion is not None:
            kind = stream.motion.at(log.time_s).kind
            rolls = (kind == ROLLING) & (np.abs(log.speed_m_s) > 1.0)
            rolling.append(np.diff(log.speed_m_s[rolls], n=2))
    still = np.concatenate(parked) if parked else np.zeros(0)
    still = still[np.isfinite(still)]
    if still.size > FEWEST_SEEN and np.any(still != 0.0):
        return Sample(float(np.sqrt(np.mean(still**2))), float(still.size))
    moving = np.concatenate(rolling) if rolling else np.zeros(0)
    moving = moving[np.isfinite(moving)]
    if moving.size <= FEWEST_SEEN:
        return None
    return Sample(robust_sigma(moving) / np.sqrt(SECOND_DIFFERENCE), moving.size / 3.0)


def _at_rest(stream: ParkedStream, time_s: NDArray) -> NDArray:
    """Times (k,) that lie in still seconds."""
    at = np.searchsorted(stream.seconds.end_s, time_s - 1e-6)
    inside = at < stream.still.size
    return np.asarray(inside & stream.still[np.minimum(at, stream.still.size - 1)])


def _sample(columns: list[NDArray]) -> Sample:
    square = float(np.mean(np.concatenate(columns) ** 2))
    lags = min(len(c) for c in columns) // 4
    r = np.mean([_correlation(c, lags) for c in columns], axis=0)
    below = np.flatnonzero(r < CORRELATED)
    lasting = int(below[0]) if below.size else lags
    independent = sum(len(c) for c in columns) / (1.0 + 2.0 * float(np.sum(r[1:lasting])))
    return Sample(float(np.sqrt(square)), independent)


def _correlation(column: NDArray, lags: int) -> NDArray:
    n = len(column)
    spectrum = np.abs(np.fft.rfft(column, 2 * n)) ** 2
    r = np.fft.irfft(spectrum)[: max(lags, 2)]
    return np.asarray(r / max(float(r[0]), 1e-300))
