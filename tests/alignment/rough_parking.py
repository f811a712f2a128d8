"""A parked vehicle with people on board, doors and gusts, made with pyins: truth for the alignment
that shares no line with the project's simulator or estimators.

People walk about and board: tilt steps of 0.05 to 0.3 deg, each taking a second or two, every
half minute. Doors slam: a ring of 0.02 deg at 3 Hz that dies within a second. Gusts: the vehicle
sways by millimetres to centimetres, a resonance at 0.3 to 0.6 Hz whose strength comes and goes
over a minute, and follows the wind's mean within seconds; it yaws about its gear likewise. The
unit is 1.5 m above the point about which the vehicle tilts.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyins import sim
from scipy.signal import lfilter

from ins.records import ImuLog, Site
from ins.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G

MADE_HZ = 50.0  # rows of the truth, five of which make a row of the log
ROWS = 5
ARM_M = 1.5
BOARDING_DEG = (0.05, 0.3)
DOOR_DEG, DOOR_HZ, DOOR_TIME_S = 0.02, 3.0, 0.4


@dataclass(frozen=True, kw_only=True)
class Rough:
    """How rough: seconds between people's moves and between doors (inf: none), sway [m] and yaw
    [deg] of the gusts.
    """

    people_s: float = 30.0
    doors_s: float = 60.0
    sway_m: float = 0.01
    yaw_deg: float = 0.005


QUIET = Rough(people_s=np.inf, doors_s=np.inf, sway_m=0.0005, yaw_deg=0.0)
ABOARD = Rough()


@dataclass(frozen=True, kw_only=True)
class Unit:
    """A ring-laser unit: white noises, and one sigma of its constant biases."""

    arw_deg_sqrt_h: float = 0.002
    vrw_ug_sqrt_hz: float = 10.0
    gyro_deg_h: float = 0.01
    accel_ug: float = 25.0


@dataclass(frozen=True, kw_only=True)
class Parked:
    """A log at 10 Hz and its truth: angles [rad] at each of its rows, gyro bias [rad/s]."""

    imu: ImuLog
    site: Site
    roll_rad: NDArray
    pitch_rad: NDArray
    heading_rad: NDArray
    bias_rad_s: NDArray


def parked(
    rng: np.random.Generator,
    seconds: float,
    rough: Rough = ABOARD,
    unit: Unit | None = None,
    *,
    lat_deg: float = 45.0,
    heading_deg: float | None = None,
) -> Parked:
    """One seeded log that begins at 0 s."""
    unit = unit or Unit()
    n = round(seconds * MADE_HZ) + 1
    t = np.arange(n) / MADE_HZ
    roll, pitch, yaw = _angles_deg(rng, t, rough)
    heading = rng.uniform(0.0, 360.0) if heading_deg is None else heading_deg
    sway = np.column_stack([_gusts(rng, n, rough.sway_m) for _ in range(2)])
    sway += ARM_M * DEG * np.column_stack([-pitch, roll])
    turn = np.array([[np.cos(a := heading * DEG), np.sin(a)], [-np.sin(a), np.cos(a)]])
    north, east = (sway @ turn).T
    lla = np.column_stack(
        [
            lat_deg + north / 6.37e6 / DEG,
            7.0 + east / (6.38e6 * np.cos(lat_deg * DEG)) / DEG,
            np.full(n, 250.0),
        ]
    )
    rph = np.column_stack([roll + rng.normal(0, 0.5), pitch + rng.normal(0, 0.5), heading + yaw])
    made: pd.DataFrame = sim.generate_imu(t, lla, rph, sensor_type="increment")[1]
    sums = made.to_numpy()[1:].reshape(-1, ROWS, 6).sum(axis=1)
    dt = ROWS / MADE_HZ
    bias = rng.normal(0.0, unit.gyro_deg_h, 3) * DEG_PER_HOUR
    gyro = sums[:, :3] + bias * dt
    gyro += unit.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR * np.sqrt(dt) * rng.normal(size=gyro.shape)
    accel = sums[:, 3:] + rng.normal(0.0, unit.accel_ug, 3) * MICRO_G * dt
    accel += unit.vrw_ug_sqrt_hz * MICRO_G * np.sqrt(dt) * rng.normal(size=gyro.shape)
    rows = slice(ROWS, None, ROWS)
    imu = ImuLog(time_s=t[rows], dt_s=np.full(len(sums), dt), dtheta_rad=gyro, dv_m_s=accel)
    return Parked(
        imu=imu,
        site=Site(lat_rad=lat_deg * DEG, lon_rad=7.0 * DEG, height_m=250.0),
        roll_rad=rph[rows, 0] * DEG,
        pitch_rad=rph[rows, 1] * DEG,
        heading_rad=rph[rows, 2] * DEG,
        bias_rad_s=bias,
    )


def _angles_deg(rng: np.random.Generator, t: NDArray, rough: Rough) -> NDArray:
    """Roll, pitch and yaw (3, n) of the vehicle about its place."""
    angles = np.zeros((3, len(t)))
    for start in _times(rng, t[-1], rough.people_s):
        size = rng.uniform(*BOARDING_DEG)
        way = 0.5 * (1.0 + np.tanh((t - start) / rng.uniform(0.4, 1.0)))
        angles += (size * rng.choice([-1.0, 1.0], 3) * [0.5, 1.0, 0.03])[:, None] * way
    for start in _times(rng, t[-1], rough.doors_s):
        since = np.maximum(t - start, 0.0)
        ring = since / DOOR_TIME_S * np.exp(1.0 - since / DOOR_TIME_S)
        angles[0] += DOOR_DEG * ring * np.sin(2 * np.pi * DOOR_HZ * since)
    angles[2] += _gusts(rng, len(t), rough.yaw_deg)
    return angles


def _times(rng: np.random.Generator, end_s: float, mean_s: float) -> NDArray:
    count = rng.poisson(end_s / mean_s)
    return rng.uniform(0.0, end_s, count)


def _gusts(rng: np.random.Generator, n: int, rms: float) -> NDArray:
    """A resonance whose strength varies over a minute, and a share of a third that follows the
    wind within 4 s.
    """
    lead = round(60.0 * MADE_HZ)
    w = 2 * np.pi * rng.uniform(0.3, 0.6) / MADE_HZ
    damping = np.exp(-0.08 * w)
    a = [1.0, -2.0 * damping * np.cos(w), damping**2]
    ring = lfilter([1.0, 1.0], a, rng.normal(size=n + lead))
    pole = np.exp(-1.0 / (4.0 * MADE_HZ))
    slow = lfilter([1.0], [1.0, -pole], rng.normal(size=n + lead))
    slow = lfilter([1.0], [1.0, -np.exp(-1.0 / MADE_HZ)], slow)
    wane = lfilter([1.0], [1.0, -np.exp(-1.0 / (60.0 * MADE_HZ))], rng.normal(size=n + lead))
    strength = np.exp(0.4 * wane / wane.std())
    both = strength * (ring / ring.std()) + slow / slow.std() / 3.0
    return rms * both[lead:]
