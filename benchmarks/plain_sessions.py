"""Sessions written from the equations, for trials of wrong facts: no line of the simulator, of the
catalogue of effects or of the estimators is used, only the records that a log is held in.

A unit stands on an apron, then taxis with turns and stops. Truth is a path on the WGS-84 ellipsoid;
the sensors read (Groves (2013), eq. 5.44 and 5.53, NED)::

    omega_ib_b = C_bn (omega_ie_n + omega_en_n) + omega_nb_b
    f_ib_b     = C_bn (dv_n/dt + (2 omega_ie_n + omega_en_n) x v_n - g_n)

and an increment is their integral over the interval, by three Gauss points. Biases are curves over
temperature (the factory's and what has aged since), turn-on, flicker made by its spectrum, and a
random walk.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ins.records import GnssLog, ImuLog, Phase, Run, RunHeader, Site, TemperatureLog

RATE_HZ = 10.0
LON_RAD, HEIGHT_M = 0.1, 250.0
A_M, E2, OMEGA_RAD_S = 6378137.0, 6.69437999014e-3, 7.292115e-5  # WGS-84
GRAVITY_EQUATOR, SOMIGLIANA = 9.7803253359, 1.931852652e-3  # m/s^2
G_M_S2 = 9.80665
DEG_H = np.deg2rad(1.0) / 3600.0
SERIAL, CREATED = "SN-0042", "2026-01-01T00:00:00Z"
NODES_DEGC = np.arange(-30.0, 66.0, 5.0)
GAUSS = np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
GAUSS_WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0


@dataclass(frozen=True)
class Grade:
    """A class of gyros, 1 sigma each: white noise [deg/sqrt(h)], flicker [deg/h], walk
    [deg/h/sqrt(h)], turn-on [deg/h]; size of the factory curve and of the ageing [deg/h].
    """

    arw: float
    flicker: float
    walk: float
    turn_on: float
    curve: float
    aged: float


GRADES = {
    "rlg": Grade(0.002, 0.002, 0.002, 0.003, 0.03, 0.0072),
    "fog": Grade(0.01, 0.01, 0.01, 0.02, 0.1, 0.02),
}


@dataclass(frozen=True)
class Unit:
    """Bias curves (3) over temperature: the factory's, and the unit's today."""

    grade: Grade
    factory: Callable[[NDArray], NDArray]
    today: Callable[[NDArray], NDArray]

    def table(self, technology: str = "rlg") -> dict:
        """The factory's table, recal.table/1; its sigma is the size of the ageing."""
        values = self.factory(np.repeat(NODES_DEGC[:, None], 3, axis=1))
        axes = {
            axis: {
                "temperature_degC": NODES_DEGC.tolist(),
                "bias_deg_h": values[:, k].tolist(),
                "sigma_deg_h": [self.grade.aged] * NODES_DEGC.size,
            }
            for k, axis in enumerate("xyz")
        }
        return {
            "schema": "recal.table/1",
            "imu_serial": SERIAL,
            "gyro_technology": technology,
            "created_utc": CREATED,
            "interpolation": "linear",
            "axes": axes,
            "covariance": None,
            "provenance": {"parent_sha256": None, "runs": []},
        }


def made_unit(rng: np.random.Generator, grade: Grade) -> Unit:
    """Level, slope and wave of the factory; a shift and a wave of the ageing."""
    level, slope = grade.curve * rng.standard_normal((2, 3))
    wave = 0.4 * grade.curve * rng.standard_normal(3)
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    shift = grade.aged * np.sqrt(0.7) * rng.standard_normal(3)
    of_sine, of_cosine = grade.aged * np.sqrt(0.3) * rng.standard_normal((2, 3))

    def factory(degC: NDArray) -> NDArray:
        x = (degC - 20.0) / 30.0
        return np.asarray(level + slope * x + wave * np.sin(1.3 * x + phase))

    def today(degC: NDArray) -> NDArray:
        x = (degC - 20.0) / 30.0
        return np.asarray(factory(degC) + shift + of_sine * np.sin(x) + of_cosine * np.cos(x))

    return Unit(grade, factory, today)


@dataclass(frozen=True)
class Session:
    """A log, and the truth: the gyros' temperatures (n, 3) [degC] once a second."""

    run: Run
    gyro_degC: NDArray


@dataclass(frozen=True, kw_only=True)
class Outing:
    """Where, how warm, what follows the apron. lag_s: of what reads the lag, lag_deg_h_degC each
    gyro's bias per degC that its temperature of so long ago is above the one of now.
    """

    lat_deg: float
    heading_deg: float
    from_degC: float
    to_degC: float
    parked_s: float = 4200.0
    rounds: int = 3
    receiver: bool = False
    lag_s: float = 0.0
    lag_deg_h_degC: tuple[float, float, float] = (0.0, 0.0, 0.0)


def drawn_outing(rng: np.random.Generator, **chosen: object) -> Outing:
    """Anywhere between 60 S and 65 N, any heading, a warm-up by 10 to 35 degC or a cooling."""
    start = float(rng.uniform(-10.0, 25.0))
    step = float(rng.choice([1.0, 1.0, 1.0, -0.5]) * rng.uniform(10.0, 35.0))
    outing = Outing(
        lat_deg=float(rng.choice([-1.0, 1.0, 1.0]) * rng.uniform(5.0, 62.0)),
        heading_deg=float(rng.uniform(0.0, 360.0)),
        from_degC=start,
        to_degC=start + step,
    )
    return replace(outing, **chosen)  # type: ignore[arg-type]


def session(rng: np.random.Generator, unit: Unit, outing: Outing, *, technology="rlg") -> Session:
    """One log of a unit."""
    legs = _legs(rng, outing.rounds)
    seconds = int(outing.parked_s + sum(leg[0] for leg in legs))
    n = int(seconds * RATE_HZ)
    dt = 1.0 / RATE_HZ
    nodes = (np.arange(n)[:, None] + GAUSS) * dt
    speed, heading = _motion(nodes.ravel(), outing, legs)
    rates, forces, _ = _sensed(nodes.ravel(), speed, heading, outing)
    dtheta = dt * np.einsum("nkc,k->nc", rates.reshape(n, 3, 3), GAUSS_WEIGHT)
    dv = dt * np.einsum("nkc,k->nc", forces.reshape(n, 3, 3), GAUSS_WEIGHT)
    time_s = np.arange(1, n + 1) * dt
    gyro_degC = _temperatures(np.arange(seconds + 1.0), outing)
    bias = unit.today(gyro_degC) + _wandering(rng, seconds + 1, unit.grade)
    bias += outing.lag_deg_h_degC * (_lagged(gyro_degC, outing.lag_s) - gyro_degC)
    at_rows = [np.interp(time_s - 0.5 * dt, np.arange(seconds + 1.0), b) for b in bias.T]
    dtheta += DEG_H * dt * np.stack(at_rows, axis=1)
    white = np.deg2rad(unit.grade.arw) / 60.0 * np.sqrt(dt)
    dtheta += white * rng.standard_normal(dtheta.shape)
    dtheta[:, 2] += _yaw_creep(rng, n, dt)
    rolling = np.minimum(_motion(time_s, outing, legs)[0][0], 1.0)
    swaying = _swaying(rng, rolling)
    dv[:, :2] += np.diff(swaying, axis=0, prepend=swaying[:1])
    dv[:, :2] += dtheta[:, 2:] * swaying[:, ::-1] * [-1.0, 1.0]  # omega x v
    dv += _accelerometers(rng, n, dt)
    header = RunHeader(
        run_id="plain",
        tail="T",
        imu_serial=SERIAL,
        gyro_technology=technology,
        start_utc="2026-03-01T05:00:00Z",
        site=Site(lat_rad=np.deg2rad(outing.lat_deg), lon_rad=LON_RAD, height_m=HEIGHT_M),
    )
    run = Run(
        header=header,
        imu=ImuLog(time_s=time_s, dt_s=np.full(n, dt), dtheta_rad=dtheta, dv_m_s=dv),
        temperature=_thermometers(rng, gyro_degC),
        gnss=_fixes(rng, outing, legs, swaying) if outing.receiver else None,
        phases=_phases(outing, seconds),
        sha256=f"{rng.integers(2**62):064x}",
    )
    return Session(run, gyro_degC)


def _phases(outing: Outing, seconds: int) -> tuple[Phase, ...]:
    spans = [("alignment", 0.0, 600.0), ("parked", 600.0, outing.parked_s)]
    if outing.rounds:
        spans.append(("taxi", outing.parked_s, float(seconds)))
    return tuple(Phase(phase=name, start_s=a, end_s=b) for name, a, b in spans)


Leg = tuple[float, float, float, float]  # seconds, speed at its start and end, turn [rad]


def _legs(rng: np.random.Generator, rounds: int) -> list[Leg]:
    """A taxi: off, straight, turns to either side and a stop of a minute, so often."""
    legs: list[Leg] = []
    for _ in range(rounds):
        v = float(rng.uniform(5.0, 10.0))
        turn = float(rng.choice([-1.0, 1.0]) * np.deg2rad(rng.uniform(50.0, 120.0)))
        legs += [(12.0, 0.0, v, 0.0), (20.0, v, v, turn), (40.0, v, v, 0.0)]
        legs += [(15.0, v, v, -0.6 * turn), (10.0, v, 0.0, 0.0), (60.0, 0.0, 0.0, 0.0)]
    return legs


def _motion(t: NDArray, outing: Outing, legs: list[Leg]) -> tuple[NDArray, NDArray]:
    """Speed and its change, heading and its rate, each (m,), stacked in pairs; smooth in a leg."""
    speed, change = np.zeros_like(t), np.zeros_like(t)
    heading, rate = np.full_like(t, np.deg2rad(outing.heading_deg)), np.zeros_like(t)
    begins = outing.parked_s
    for seconds, v0, v1, turn in legs:
        u = np.clip((t - begins) / seconds, 0.0, 1.0)
        inside = (t > begins) & (t <= begins + seconds)
        rise = u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi)  # no jump of rate or acceleration
        slope = (1.0 - np.cos(2.0 * np.pi * u)) / seconds
        speed = np.where(t > begins, v0 + (v1 - v0) * rise, speed)
        change = np.where(inside, (v1 - v0) * slope, change)
        heading += turn * rise
        rate += np.where(inside, turn * slope, 0.0)
        begins += seconds
    return np.stack([speed, change]), np.stack([heading, rate])


def _sensed(
    t: NDArray, speed: NDArray, heading: NDArray, outing: Outing
) -> tuple[NDArray, NDArray, NDArray]:
    """Rates and specific forces (m, 3), latitudes and longitudes (m, 2)."""
    (v, dv), (psi, dpsi) = speed, heading
    step = np.diff(t, prepend=0.0)
    v_n = np.stack([v * np.cos(psi), v * np.sin(psi), np.zeros_like(v)], axis=1)
    middle = 0.5 * (v_n + np.vstack([v_n[:1], v_n[:-1]]))
    way = np.cumsum(middle * step[:, None], axis=0)
    lat0 = np.deg2rad(outing.lat_deg)
    w = np.sqrt(1.0 - E2 * np.sin(lat0) ** 2)
    R_N, R_E = A_M * (1.0 - E2) / w**3 + HEIGHT_M, A_M / w + HEIGHT_M
    lat = lat0 + way[:, 0] / R_N
    lon = LON_RAD + np.cumsum(middle[:, 1] * step / (R_E * np.cos(lat)))
    a_n = np.stack(
        [dv * np.cos(psi) - v * dpsi * np.sin(psi), dv * np.sin(psi) + v * dpsi * np.cos(psi)], 1
    )
    a_n = np.hstack([a_n, np.zeros((len(t), 1))])
    zero = np.zeros_like(lat)
    earth = OMEGA_RAD_S * np.stack([np.cos(lat), zero, -np.sin(lat)], axis=1)
    transport = np.stack(
        [v_n[:, 1] / R_E, -v_n[:, 0] / R_N, -v_n[:, 1] * np.tan(lat) / R_E], axis=1
    )
    up = GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * np.sin(lat) ** 2)
    up = up / np.sqrt(1.0 - E2 * np.sin(lat) ** 2) * (1.0 - 2.0 * HEIGHT_M / A_M * 1.0034)
    force = a_n + np.cross(2.0 * earth + transport, v_n) - np.stack([zero, zero, up], axis=1)
    rate = _turned(earth + transport, psi)
    rate[:, 2] += dpsi
    return rate, _turned(force, psi), np.column_stack([lat, lon])


def _turned(v_n: NDArray, psi: NDArray) -> NDArray:
    """From north-east-down into the axes of a level vehicle on a heading."""
    c, s = np.cos(psi), np.sin(psi)
    return np.stack([c * v_n[:, 0] + s * v_n[:, 1], c * v_n[:, 1] - s * v_n[:, 0], v_n[:, 2]], 1)


def _temperatures(t: NDArray, outing: Outing) -> NDArray:
    """Two lags in a row, each gyro with its own second one and its own heat."""
    tau = np.array([500.0, 650.0, 400.0])
    block = 1700.0
    x = t[:, None]
    rise = 1.0 - (block * np.exp(-x / block) - tau * np.exp(-x / tau)) / (block - tau)
    own = np.array([1.2, 2.0, 0.7]) * (1.0 - np.exp(-x / tau))
    return np.asarray(outing.from_degC + (outing.to_degC - outing.from_degC) * rise + own)


def _lagged(degC: NDArray, lag_s: float) -> NDArray:
    """What a first-order lag makes of temperatures once a second."""
    if not lag_s:
        return degC
    keep = np.exp(-1.0 / lag_s)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], degC - degC[0], axis=0) + degC[0])


def _wandering(rng: np.random.Generator, n: int, grade: Grade) -> NDArray:
    """Turn-on, random walk and flicker (n, 3) [deg/h], once a second. Flicker of a longer period
    than the log is part of the turn-on.
    """
    walk = grade.walk / 60.0 * np.cumsum(rng.standard_normal((n, 3)), axis=0)
    f = np.fft.rfftfreq(n, 1.0)
    f[0] = np.inf
    # two-sided density B^2 / (2 pi f); white noise of variance 1 at 1 Hz has density 1
    shape = np.sqrt(grade.flicker**2 / (2.0 * np.pi * f))
    white = np.fft.rfft(rng.standard_normal((n, 3)), axis=0)
    flicker = np.fft.irfft(white * shape[:, None], n, axis=0)
    return np.asarray(grade.turn_on * rng.standard_normal(3) + walk + flicker)


def _yaw_creep(rng: np.random.Generator, n: int, dt: float) -> NDArray:
    """Tyres and ground let the vehicle turn by 3 arcsec/sqrt(h)."""
    return np.asarray(np.deg2rad(3.0 / 3600.0) / 60.0 * np.sqrt(dt) * rng.standard_normal(n))


def _swaying(rng: np.random.Generator, rolling: NDArray) -> NDArray:
    """Velocities (n, 2) forward and right beyond the path [m/s]: 1 mm/s at 0.28 Hz on the gear,
    and 2 cm/s of side motion as far as the vehicle rolls (0 to 1).
    """
    n, dt = rolling.size, 1.0 / RATE_HZ
    angle = 2.0 * np.pi * 0.28 * dt
    r = np.exp(-0.2 * angle)
    drive = rng.standard_normal((n, 2))
    sway = lfilter([1.0], [1.0, -2.0 * r * np.cos(angle), r * r], drive, axis=0)
    sway *= 0.001 / sway.std()
    side = lfilter([1.0], [1.0, -np.exp(-dt / 0.3)], rng.standard_normal(n))
    sway[:, 1] += 0.02 / side.std() * side * rolling
    return np.asarray(sway)


def _accelerometers(rng: np.random.Generator, n: int, dt: float) -> NDArray:
    """Turn-on of 30 micro-g, a walk of 2 micro-g/sqrt(h), white noise of 10 micro-g/sqrt(Hz)."""
    ug = 1e-6 * G_M_S2
    walk = 2.0 * ug / 60.0 * np.sqrt(dt) * np.cumsum(rng.standard_normal((n, 3)), axis=0)
    white = 10.0 * ug * np.sqrt(dt) * rng.standard_normal((n, 3))
    return np.asarray(dt * (30.0 * ug * rng.standard_normal(3) + walk) + white)


def _thermometers(rng: np.random.Generator, gyro_degC: NDArray) -> TemperatureLog:
    """Once a second, 0.01 degC of noise and of resolution."""

    def read(degC: NDArray) -> NDArray:
        return np.asarray(np.round(degC + 0.01 * rng.standard_normal(degC.shape), 2))

    accel = np.repeat(gyro_degC.mean(axis=1)[:, None], 3, axis=1)
    return TemperatureLog(
        time_s=np.arange(float(len(gyro_degC))),
        gyro_degC=read(gyro_degC),
        accel_degC=read(accel),
        block_degC=read(accel[:, 0] + 1.0),
    )


def _fixes(rng: np.random.Generator, outing: Outing, legs: list[Leg], swaying: NDArray) -> GnssLog:
    """Once a second: 0.5 m, 0.75 m up, 0.03 m/s."""
    t = np.arange(1, len(swaying) + 1) / RATE_HZ
    speed, heading = _motion(t, outing, legs)
    _, _, place = _sensed(t, speed, heading, outing)
    every = slice(int(RATE_HZ) - 1, None, int(RATE_HZ))
    lat, lon = place[every].T
    m = lat.size
    lat0 = np.deg2rad(outing.lat_deg)
    w = np.sqrt(1.0 - E2 * np.sin(lat0) ** 2)
    R_N, R_E = A_M * (1.0 - E2) / w**3 + HEIGHT_M, A_M / w + HEIGHT_M
    v, psi = speed[0][every], heading[0][every]
    ahead, right = swaying[every].T
    v_n = np.zeros((m, 3))
    v_n[:, 0] = (v + ahead) * np.cos(psi) - right * np.sin(psi)
    v_n[:, 1] = (v + ahead) * np.sin(psi) + right * np.cos(psi)
    return GnssLog(
        time_s=t[every],
        lat_rad=lat + 0.5 * rng.standard_normal(m) / R_N,
        lon_rad=lon + 0.5 * rng.standard_normal(m) / (R_E * np.cos(lat0)),
        height_m=HEIGHT_M + 0.75 * rng.standard_normal(m),
        v_n_m_s=v_n + 0.03 * rng.standard_normal((m, 3)),
    )
