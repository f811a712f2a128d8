"""What an effect sees of a run (the truth) and what it changes (the raw streams), with the moves
that several share.

Signs and frames as in CONVENTIONS.md. Rotations and displacements are first order: for 200 arcsec
and 1 m/s the second order is below 5 micro-g.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ins.earth import omega_en_n, omega_ie_n, radii_of_curvature
from ins.records import (
    AXES,
    GnssLog,
    ImuLog,
    OdometerLog,
    Run,
    RunHeader,
    TemperatureLog,
    TwinModel,
)
from ins.units import DEG_PER_HOUR, MICRO_G
from trajectories.runs.directory import run_sha256


@dataclass(frozen=True, kw_only=True)
class Seen:
    """The truth of one run at its n IMU rows (ends of the intervals; temperatures at their
    middles).

    number, of: which of how many runs. dtheta_rad, dv_m_s: ideal increments; temperatures: true
    ones, (n, 3) at the gyros and accelerometers, gradient at the gyros, block (n,); taxi_s: when it
    starts to roll (the run's end if never).
    """

    number: int
    of: int
    time_s: NDArray
    dt_s: float
    dtheta_rad: NDArray
    dv_m_s: NDArray
    C_nb: NDArray
    v_n_m_s: NDArray
    speed_m_s: NDArray
    lat_rad: NDArray
    height_m: NDArray
    gyro_degC: NDArray
    accel_degC: NDArray
    gradient_degC: NDArray
    block_degC: NDArray
    twin: TwinModel
    table: dict[str, Any]

    @property
    def rows(self) -> int:
        return int(self.time_s.size)

    @cached_property
    def taxi_s(self) -> float:
        moving = np.flatnonzero(np.abs(self.speed_m_s) > 1e-6)
        return float(self.time_s[moving[0]] if moving.size else self.time_s[-1])

    @cached_property
    def omega_nb_b(self) -> NDArray:
        """Rate of turn against the local level (n, 3) [rad/s], mean over each row."""
        earth_n = omega_ie_n(self.lat_rad) + omega_en_n(self.lat_rad, self.height_m, self.v_n_m_s)
        return self.dtheta_rad / self.dt_s - turned_back(self.C_nb, earth_n)

    @cached_property
    def omega_at_ends(self) -> NDArray:
        """The same at the ends of the rows."""
        w = self.omega_nb_b
        return 0.5 * (w + np.concatenate([w[1:], w[-1:]]))

    @cached_property
    def heading_rad(self) -> NDArray:
        return np.arctan2(self.C_nb[:, 1, 0], self.C_nb[:, 0, 0])

    @cached_property
    def acceleration_m_s2(self) -> NDArray:
        """Along the track, (n,)."""
        return np.gradient(self.speed_m_s, self.dt_s)

    def nearest(self, time_s: NDArray) -> NDArray:
        """Rows that end nearest to the times of another stream."""
        return np.clip(np.round(time_s / self.dt_s).astype(int) - 1, 0, self.rows - 1)

    def rng(self, seed: int) -> np.random.Generator:
        """The random numbers of an effect in this run."""
        return np.random.default_rng([seed, self.number])


@dataclass(frozen=True, kw_only=True)
class Streams:
    """The raw streams of one run while effects are laid over them."""

    header: RunHeader
    dtheta_rad: NDArray
    dv_m_s: NDArray
    temperature: TemperatureLog
    gnss: GnssLog | None
    odometer: OdometerLog | None
    dt_s: float

    def gyro(self, target: str, rate_deg_h: NDArray | float) -> "Streams":
        """A gyro reads this much more, (n,) [deg/h]."""
        return self.turning(target, np.asarray(rate_deg_h) * DEG_PER_HOUR)

    def turning(self, target: str, rate_rad_s: NDArray) -> "Streams":
        """A gyro reads this much more, (n,) [rad/s]."""
        return replace(self, dtheta_rad=_with(self.dtheta_rad, target, rate_rad_s * self.dt_s))

    def accel(self, target: str, force_ug: NDArray | float) -> "Streams":
        """An accelerometer reads this much more, (n,) [micro-g]."""
        return self.pushed(target, np.asarray(force_ug) * MICRO_G)

    def pushed(self, target: str, force_m_s2: NDArray) -> "Streams":
        """An accelerometer reads this much more, (n,) [m/s^2]."""
        return replace(self, dv_m_s=_with(self.dv_m_s, target, force_m_s2 * self.dt_s))


def _with(rows: NDArray, target: str, more: NDArray) -> NDArray:
    """Rows (n, 3) with `more` added to the axis of the target."""
    out = np.array(rows)
    out[:, axis_of(target)] += more
    return out


def streams_of(run: Run) -> Streams:
    imu = run.imu.whole()
    if run.temperature is None:
        raise ValueError("a trial's run has temperatures")
    return Streams(
        header=run.header,
        dtheta_rad=imu.dtheta_rad,
        dv_m_s=imu.dv_m_s,
        temperature=run.temperature,
        gnss=run.gnss,
        odometer=run.odometer,
        dt_s=float(imu.dt_s[0]),
    )


def run_of(run: Run, streams: Streams) -> Run:
    """The run with these streams, hashed anew."""
    imu = run.imu.whole()
    changed = ImuLog(
        time_s=imu.time_s, dt_s=imu.dt_s, dtheta_rad=streams.dtheta_rad, dv_m_s=streams.dv_m_s
    )
    out = replace(
        run,
        header=streams.header,
        imu=changed,
        temperature=streams.temperature,
        gnss=streams.gnss,
        odometer=streams.odometer,
    )
    return replace(out, sha256=run_sha256(out))


def axis_of(target: str) -> int:
    """0, 1, 2 of gyro_x ... accel_z."""
    return AXES.index(target[-1])


def turned_back(C_nb: NDArray, vector_n: NDArray) -> NDArray:
    """C_bn v_n, (n, 3)."""
    return np.einsum("nji,nj->ni", C_nb, vector_n)


def tilted(streams: Streams, seen: Seen, q_b: NDArray) -> Streams:
    """The body turns by the small rotation vector q_b (n, 3) at the ends of the rows; 0 before the
    first.

    exp(-q) to first order: the gyros see dq - q x dtheta, the accelerometers -q x dv.
    """
    before = np.concatenate([np.zeros((1, 3)), q_b[:-1]])
    mean = 0.5 * (q_b + before)
    return replace(
        streams,
        dtheta_rad=streams.dtheta_rad + (q_b - before) - np.cross(mean, seen.dtheta_rad),
        dv_m_s=streams.dv_m_s - np.cross(mean, seen.dv_m_s),
    )


def moved(streams: Streams, seen: Seen, dv_n: NDArray) -> Streams:
    """The vehicle moves by dv_n (n, 3) more than the base run says; 0 before the first row.

    The accelerometers see the change of velocity and Coriolis, the gyros the transport rate, GNSS
    the velocity and position; the odometer, along body x at the wheels, is left to the caller.
    """
    before = np.concatenate([np.zeros((1, 3)), dv_n[:-1]])
    path_n = np.cumsum(0.5 * (dv_n + before), axis=0) * seen.dt_s
    C_middle = 0.5 * (seen.C_nb + np.concatenate([seen.C_nb[:1], seen.C_nb[:-1]]))
    coriolis_n = np.cross(2 * omega_ie_n(seen.lat_rad), 0.5 * (dv_n + before))
    rolled_n = omega_en_n(seen.lat_rad, seen.height_m, 0.5 * (dv_n + before)) * seen.dt_s
    return replace(
        streams,
        dv_m_s=streams.dv_m_s + turned_back(C_middle, dv_n - before + coriolis_n * seen.dt_s),
        dtheta_rad=streams.dtheta_rad + turned_back(C_middle, rolled_n),
        gnss=shifted_fixes(streams, seen, path_n, dv_n),
    )


def shifted_fixes(streams: Streams, seen: Seen, path_n: NDArray, dv_n: NDArray) -> GnssLog | None:
    """The fixes moved by path_n [m] and dv_n [m/s], (n, 3) at the IMU rows."""
    log = streams.gnss
    if log is None:
        return None
    rows = seen.nearest(log.time_s)
    meridian, transverse = radii_of_curvature(log.lat_rad)
    return replace(
        log,
        lat_rad=log.lat_rad + path_n[rows, 0] / (meridian + log.height_m),
        lon_rad=log.lon_rad + path_n[rows, 1] / ((transverse + log.height_m) * np.cos(log.lat_rad)),
        height_m=log.height_m - path_n[rows, 2],
        v_n_m_s=log.v_n_m_s + dv_n[rows],
    )


def arm_force(seen: Seen, arm_b_m: NDArray) -> NDArray:
    """Velocity increments (n, 3) that a point at arm_b_m from the IMU feels beyond it: w' x r + w x
    (w x r).
    """
    w = seen.omega_nb_b
    swung = np.diff(np.cross(seen.omega_at_ends, arm_b_m), axis=0, prepend=np.zeros((1, 3)))
    return swung + np.cross(w, np.cross(w, arm_b_m)) * seen.dt_s
