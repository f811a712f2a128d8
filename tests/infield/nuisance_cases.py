"""Sessions with a taxi under what wind, tyres, installation and stamps do, each with one thing that
nobody declared.

Runs of one power-on with half an hour of parking and nine minutes of taxi over three headings, each
of another unit. The bodies are moved and the streams shifted here, sample by sample, with no
formula of the estimator.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.gap_trials.seen import Seen, moved, run_of, streams_of
from infield.session.estimate import SessionEstimate
from infield.session.navigated import nuisances
from infield.session.one_run import take_run
from infield.session.points import mean_rows
from infield.session.results import SessionResult
from infield.session.settings import SessionSettings
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.records import AccelNoise, Run, Site, TwinModel
from ins.units import DEG, MILLIRADIAN
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Segment, Stop, Straight, Turn
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

ARM_M, WHEEL_M = (3.0, -2.0, -1.5), (-4.0, 1.5, 1.2)
PARKED_S = 1800.0
LEG = Straight(duration_s=120.0, speed_m_s=9.5)
# turns at two speeds, so that side slip is none of the wheel arm
TAXI: tuple[Segment, ...] = (
    Park(duration_s=PARKED_S),
    Turn(angle_deg=90.0),
    LEG,
    Stop(duration_s=60.0),
    Turn(angle_deg=90.0, speed_m_s=8.0, radius_m=40.0),
    LEG,
    Stop(duration_s=90.0),
    Turn(angle_deg=-90.0),
    LEG,
    Stop(duration_s=60.0),
)
TWIN = TwinModel(accel=AccelNoise(turn_on_ug=50.0))
PRIOR_DEG_H = 0.01
GUST_S, RELAXATION_S = 10.0, 0.3
EARTH_M = 6.37e6


@dataclass(frozen=True)
class Made:
    """A simulated run and the noise-free one under it."""

    run: Run
    ideal: IdealSensors


Case = Callable[[Made, np.random.Generator], Run]


def slipping(made: Made, kappa_rad: NDArray) -> Run:
    """The vehicle drifts along body y by kappa (n,) of its speed; the body keeps its heading."""
    ideal, zero = made.ideal, np.zeros((made.ideal.time_s.size, 3))
    seen = Seen(
        number=0,
        of=1,
        time_s=ideal.time_s,
        dt_s=ideal.dt_s,
        dtheta_rad=ideal.dtheta_rad,
        dv_m_s=ideal.dv_m_s,
        C_nb=ideal.C_nb,
        v_n_m_s=ideal.v_n_m_s,
        speed_m_s=ideal.speed_m_s,
        lat_rad=ideal.lat_rad,
        height_m=ideal.height_m,
        gyro_degC=zero,
        accel_degC=zero,
        gradient_degC=zero,
        block_degC=zero[:, 0],
        twin=TWIN,
        table={},
    )
    dv_n = ideal.C_nb[:, :, 1] * (kappa_rad * ideal.speed_m_s)[:, None]
    return run_of(made.run, moved(streams_of(made.run), seen, dv_n))


def heading_of(made: Made) -> NDArray:
    return np.asarray(made.ideal.euler_rad[:, 2])


def quiet(made: Made, rng: np.random.Generator) -> Run:
    return made.run


def cross_wind(made: Made, rng: np.random.Generator, *, mrad: float = 20.0) -> Run:
    """A steady wind from anywhere."""
    to = rng.uniform(0.0, 2.0 * np.pi)
    return slipping(made, mrad * MILLIRADIAN * np.sin(to - heading_of(made)))


def gusty_wind(made: Made, rng: np.random.Generator) -> Run:
    """The same with a fifth of it in gusts of ten seconds."""
    count = made.ideal.time_s.size
    keep = np.exp(-made.ideal.dt_s / GUST_S)
    gusts = lfilter([1.0], [1.0, -keep], np.sqrt(1 - keep**2) * rng.standard_normal(count))
    to = rng.uniform(0.0, 2.0 * np.pi)
    steady = 20.0 * MILLIRADIAN * np.sin(to - heading_of(made))
    return slipping(made, steady * (1.0 + 0.2 * gusts))


def wind_by_leg(made: Made, rng: np.random.Generator) -> Run:
    """A crab of its own on each leg, 20 mrad RMS, one going over into the next in the turn."""
    turned = np.cumsum(np.abs(np.diff(heading_of(made), prepend=heading_of(made)[0])))
    legs = turned / (90.0 * DEG)
    number = np.floor(legs + 1e-6).astype(int)
    crab = 20.0 * MILLIRADIAN * rng.standard_normal(number.max() + 2)
    over = np.clip(legs - number, 0.0, 1.0)
    return slipping(made, crab[number] + over * (crab[number + 1] - crab[number]))


def body_turned(made: Made, rng: np.random.Generator) -> Run:
    """The body turns against its track in place of the track against the body: cross wind as the
    pilot holds it, 20 mrad, from the first roll on. The turn itself is on the gyros.
    """
    ideal, imu = made.ideal, made.run.imu.whole()
    to = rng.uniform(0.0, 2.0 * np.pi)
    rolling = np.clip(ideal.speed_m_s / 3.0, 0.0, 1.0)
    smooth = rolling**2 * (3.0 - 2.0 * rolling)
    angle = 20.0 * MILLIRADIAN * np.sin(to - heading_of(made)) * smooth
    before = np.concatenate([[0.0], angle[:-1]])
    middle = 0.5 * (angle + before)
    dtheta, dv = np.array(imu.dtheta_rad), np.array(imu.dv_m_s)
    for rows in (dtheta, dv):  # what body axes show of a vector once they have turned about z
        x, y = rows[:, 0].copy(), rows[:, 1].copy()
        rows[:, 0] = np.cos(middle) * x + np.sin(middle) * y
        rows[:, 1] = np.cos(middle) * y - np.sin(middle) * x
    dtheta[:, 2] += angle - before
    return replace(made.run, imu=replace(imu, dtheta_rad=dtheta, dv_m_s=dv))


def side_slip(made: Made, rng: np.random.Generator) -> Run:
    """Tyres give way by 0.4 deg for each m/s^2, after a relaxation."""
    lateral = np.gradient(heading_of(made), made.ideal.dt_s) * made.ideal.speed_m_s
    keep = np.exp(-made.ideal.dt_s / RELAXATION_S)
    return slipping(made, -0.4 * DEG * lfilter([1.0 - keep], [1.0, -keep], lateral))


def late_gnss(made: Made, rng: np.random.Generator, *, late_s: float = 0.3) -> Run:
    """The stamps of the file, shifted."""
    assert made.run.gnss is not None
    return replace(made.run, gnss=replace(made.run.gnss, time_s=made.run.gnss.time_s + late_s))


def wandering_fixes(made: Made, rng: np.random.Generator) -> Run:
    """Positions and velocities with slow errors of 1.5 m over 200 s and 0.01 m/s over 40 s, for
    which the log declares the sigma of the whole.
    """
    log = made.run.gnss
    assert log is not None
    step_s = float(np.median(np.diff(log.time_s)))
    place = 1.5 * _wandering(log.time_s.size, step_s / 200.0, rng)
    velocity = np.zeros(log.v_n_m_s.shape)
    velocity[:, :2] = 0.01 * _wandering(log.time_s.size, step_s / 40.0, rng)
    count = np.ones(log.time_s.size)
    strayed = replace(
        log,
        lat_rad=log.lat_rad + place[:, 0] / EARTH_M,
        lon_rad=log.lon_rad + place[:, 1] / (EARTH_M * np.cos(log.lat_rad)),
        v_n_m_s=log.v_n_m_s + velocity,
        sigma_horizontal_m=count * np.hypot(TWIN.gnss.sigma_horizontal_m, 1.5),
        sigma_velocity_m_s=count * np.hypot(TWIN.gnss.sigma_velocity_m_s, 0.01),
    )
    return replace(made.run, gnss=strayed)


def _wandering(count: int, lengths: float, rng: np.random.Generator) -> NDArray:
    """Two processes (count, 2) of unit variance that forget 1/e in a length; lengths: of a step."""
    keep = np.exp(-lengths)
    news = np.sqrt(1.0 - keep**2) * rng.standard_normal((count, 2))
    news[0] = rng.standard_normal(2)
    return np.asarray(lfilter([1.0], [1.0, -keep], news, axis=0))


def wrong_arm(made: Made, rng: np.random.Generator, *, off_m: float = 1.0) -> Run:
    """The antenna is declared so far from where it is, in any level direction."""
    header = made.run.header
    off = off_m * _direction(rng)
    arm = np.asarray(header.gnss_lever_arm_m) + off
    return replace(made.run, header=replace(header, gnss_lever_arm_m=tuple(arm)))


def wrong_wheel_arm(made: Made, rng: np.random.Generator) -> Run:
    header = made.run.header
    arm = np.asarray(header.wheel_reference_m) + _direction(rng)
    return replace(made.run, header=replace(header, wheel_reference_m=tuple(arm)))


def wheel_scale(made: Made, rng: np.random.Generator) -> Run:
    return _speeds(made, lambda v: v * (1.0 + 0.02 * rng.choice([-1.0, 1.0])))


def late_wheels(made: Made, rng: np.random.Generator) -> Run:
    assert made.run.odometer is not None
    log = made.run.odometer
    return replace(made.run, odometer=replace(log, time_s=log.time_s + 0.1))


def everything(made: Made, rng: np.random.Generator) -> Run:
    """Cross wind, side slip, late fixes, wrong arms and wrong wheels at once."""
    run = made.run
    for case in (cross_wind, side_slip, late_gnss, wrong_arm, wrong_wheel_arm, wheel_scale):
        run = case(replace(made, run=run), rng)
    return run


def dead_wheel(made: Made, rng: np.random.Generator) -> Run:
    return _speeds(made, lambda v: 0.0 * v)


def reversed_wheel(made: Made, rng: np.random.Generator) -> Run:
    return _speeds(made, lambda v: -v)


def random_speeds(made: Made, rng: np.random.Generator) -> Run:
    """Speeds off by up to a fifth, another factor every five seconds."""
    return _speeds(
        made, lambda v: v * np.repeat(rng.uniform(0.8, 1.2, v.size // 50 + 1), 50)[: v.size]
    )


def spoofed_jump(made: Made, rng: np.random.Generator) -> Run:
    """From the first leg on, every fix is 30 m further north."""
    return _fixes_moved(made, lambda t: np.where(t > PARKED_S + 60.0, 30.0, 0.0))


def spoofed_drift(made: Made, rng: np.random.Generator) -> Run:
    """From the first roll on, positions are led away by half a metre a second."""
    return _fixes_moved(made, lambda t: 0.5 * np.maximum(t - PARKED_S, 0.0))


def noisy_fixes(made: Made, rng: np.random.Generator) -> Run:
    """Positions with six times the noise that they declare."""
    return _fixes_moved(made, lambda t: 3.0 * rng.standard_normal(t.size))


EXPLAINED: dict[str, Case] = {
    "quiet": quiet,
    "cross wind 20 mrad": cross_wind,
    "cross wind, body turned": body_turned,
    "cross wind with gusts": gusty_wind,
    "crab of its own each leg": wind_by_leg,
    "GNSS late by 0.3 s": late_gnss,
    "GNSS arm wrong by 1 m": wrong_arm,
    "fixes wander": wandering_fixes,
    "wheel scale wrong by 2 %": wheel_scale,
    "wheel arm wrong by 1 m": wrong_wheel_arm,
    "wheels late by 0.1 s": late_wheels,
    "side slip 0.4 deg by m/s2": side_slip,
    "six of them at once": everything,
}
WRONG: dict[str, Case] = {
    "dead wheel": dead_wheel,
    "reversed wheel": reversed_wheel,
    "random speeds": random_speeds,
    "fixes led away, jump": spoofed_jump,
    "fixes led away, drift": spoofed_drift,
    "fixes six times as noisy": noisy_fixes,
}
CASES = {**EXPLAINED, **WRONG}


@dataclass(frozen=True)
class Scored:
    """A session against the truth: errors of its mean biases over sigma as one sum of squares (3
    degrees of freedom), heading error over sigma.
    """

    result: SessionResult
    nees: float
    heading: float

    @property
    def estimate(self) -> SessionEstimate:
        assert self.result.estimate is not None
        return self.result.estimate

    @property
    def needed(self) -> tuple[str, ...]:
        rolling = self.estimate.rolling
        return rolling.names if rolling is not None else ()


def scored_session(case: Case, seed: int) -> Scored:
    """One session of a case, of a unit of its own; GNSS and odometer are logged."""
    ideal = ideal_taxi(25.0 + 40.0 * (seed % 9))
    simulated = _simulated(ideal, seed)
    run = case(Made(simulated.run, ideal), np.random.default_rng([seed, 5]))
    result = take_run(run, _no_table(), TWIN, SessionSettings(), False)
    return _scored(result, simulated)


@contextmanager
def as_declared() -> Iterator[None]:
    """Nothing is looked for beyond what is declared."""
    with mock.patch.object(nuisances, "ROUNDS", 0):
        yield


@lru_cache(maxsize=9)
def ideal_taxi(heading_deg: float) -> IdealSensors:
    site = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
    truth = build_truth(lay(TAXI), site, heading_rad=heading_deg * DEG, wheel_reference_m=WHEEL_M)
    return ideal_sensors(truth, 10.0)


def _simulated(ideal: IdealSensors, seed: int) -> SimulatedRun:
    """One seeded run; the unit's bias is drawn from the table's own prior (common 70 %, smooth 30
    %).
    """
    rng = np.random.default_rng([seed, 20261122])
    unit = aged_unit(
        rng,
        ageing_offset_deg_h=PRIOR_DEG_H * np.sqrt(0.7),
        ageing_shape_deg_h=PRIOR_DEG_H * np.sqrt(0.3),
        table=_table_of([-40.0, 80.0]),
    )
    plan = SessionPlan(with_gnss=True, with_odometer=True, gnss_lever_arm_m=ARM_M)
    return simulate_run(ideal, thermal_history("ambient"), unit, TWIN, rng=rng, plan=plan)


def _table_of(temperature_degC: list[float]) -> dict[str, object]:
    zeros = [0.0] * len(temperature_degC)
    sigma = [PRIOR_DEG_H] * len(temperature_degC)
    axis = {"temperature_degC": temperature_degC, "bias_deg_h": zeros, "sigma_deg_h": sigma}
    return {"axes": {name: axis for name in "xyz"}}


def _no_table() -> ThermalTable:
    facts = {
        "schema": "recal.table/1",
        "imu_serial": "SN-0042",
        "gyro_technology": "rlg",
        "created_utc": "2026-01-01T00:00:00Z",
        "interpolation": "linear",
        "covariance": None,
        "provenance": {"parent_sha256": None, "runs": []},
    }
    nodes = [float(T) for T in range(-20, 61, 10)]
    return table_from_dict({**facts, **_table_of(nodes)}, name="prior")


def _scored(result: SessionResult, simulated: SimulatedRun) -> Scored:
    """Errors against truth, bin by bin."""
    e = result.estimate
    assert e is not None
    edges = e.bins.edges_s
    truth = np.concatenate(
        [
            simulated.gyro_bias_true_deg_h[
                (simulated.bias_time_s > a) & (simulated.bias_time_s <= b)
            ].mean(axis=0)
            for a, b in pairwise(edges)
        ]
    )
    A = mean_rows(e)
    error = A @ (e.bins.table_deg_h + e.mean_deg_h - truth)
    covariance = A @ e.covariance @ A.T
    at = int(np.argmin(np.abs(simulated.reference.time_s - e.alignment.time_s)))
    off = e.alignment.heading_rad - simulated.reference.heading_rad[at]
    true_error = float(np.angle(np.exp(1j * off)))
    return Scored(
        result=result,
        nees=float(error @ np.linalg.solve(covariance, error)),
        heading=(e.heading_error_rad - true_error) / e.sigma_heading_rad,
    )


def _direction(rng: np.random.Generator) -> NDArray:
    """A level unit vector, (3,)."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _speeds(made: Made, change: Callable[[NDArray], NDArray]) -> Run:
    """The run with its wheel speeds changed while it rolls."""
    assert made.run.odometer is not None
    log = made.run.odometer
    speed = np.where(log.time_s > PARKED_S, change(log.speed_m_s), log.speed_m_s)
    return replace(made.run, odometer=replace(log, speed_m_s=speed))


def _fixes_moved(made: Made, north_m: Callable[[NDArray], NDArray]) -> Run:
    assert made.run.gnss is not None
    log = made.run.gnss
    lat = log.lat_rad + north_m(log.time_s) / EARTH_M
    return replace(made.run, gnss=replace(log, lat_rad=lat))
