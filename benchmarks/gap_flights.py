"""Whole diagnoses of simulated flights with one effect of flight each, and of flights without any.

One flight: parked, taxi, a climb, turns both ways, a way of 20 km and more, a landing; GNSS, and a
mount that shakes in the air. Every effect is made row by row from the
truth, in another form than the catalogue's signature (no code of it is used), and brought to the
wanted size in sigmas of the whitened rows.
"""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.study import Record, Work, share
from benchmarks.study import table as markdown
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.earth import omega_ie_n
from ins.records import GnssLog, Run, Site, TwinModel
from ins.twin_file import default_twin
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, STANDARD_GRAVITY
from simreal.evidence.run_view import view_run
from simreal.evidence.whitened import Evidence
from simreal.inference.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from simreal.twin.inject import moved_by
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Descend,
    Landing,
    Park,
    Stop,
    TakeOff,
    Turn,
    TurnFlight,
)
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import UnitTruth, aged_unit

SITE = Site(lat_rad=45.0 * DEG, lon_rad=7.0 * DEG, height_m=250.0)
HEADINGS_DEG = (37.0,)
RATE_HZ = 10.0
FLIGHT = (
    Park(duration_s=600.0),
    Turn(angle_deg=90.0),
    Stop(duration_s=20.0),
    TakeOff(),
    Climb(height_m=1500.0, speed_m_s=90.0),
    TurnFlight(angle_deg=180.0),
    Cruise(duration_s=150.0),
    TurnFlight(angle_deg=-120.0),
    Cruise(duration_s=150.0),
    Descend(height_m=900.0),
    Landing(),
    Stop(duration_s=5.0),
    Park(duration_s=120.0),
)
# of the mount in the air: 0.1 to 0.3 g and 0.1 to 1 deg/s are usual for a hard mount
SHAKE_M_S2 = np.array([0.8, 1.0, 1.4])
SWING_DEG_S = np.array([0.6, 0.4, 0.5])
CLOSE = 0.03  # of the wanted size
SCALE, ANTENNA = "gyro_scale_factor", "gnss_lever_arm_or_latency"
WRONG_AND_SURE = 0.8  # probability from which a wrong name counts as sure


@dataclass(frozen=True)
class Flown:
    """A flight, its truth, and how its mount shook (rows, 3) [m/s^2, rad/s]."""

    run: Run
    ideal: IdealSensors
    shake: NDArray
    swing: NDArray


Layer = Callable[[Flown, float], Run]


@dataclass(frozen=True)
class Planted:
    """An effect of flight by its name in the catalogue: how it is laid over a run by its size, the
    size to begin with, and the neighbours that are stated beforehand.
    """

    effect: str
    target: str
    lay: Layer
    start: float
    neighbours: tuple[str, ...]


def twin() -> TwinModel:
    return default_twin("rlg")


@lru_cache(maxsize=1)
def unit() -> UnitTruth:
    """A unit that has not aged."""
    rng = np.random.default_rng(7)
    return aged_unit(rng, ageing_offset_deg_h=0.0, ageing_shape_deg_h=0.0)


@lru_cache(maxsize=1)
def table() -> ThermalTable:
    """The unit's own curve: what the twin believes is true."""
    return table_from_dict(unit().factory_table(np.arange(-20.0, 61.0, 2.0)), name="table")


@lru_cache(maxsize=2)
def _ideal(heading_deg: float) -> IdealSensors:
    truth = build_truth(
        lay(FLIGHT),
        SITE,
        heading_rad=heading_deg * DEG,
        roll_rad=0.01,
        pitch_rad=-0.02,
        wheel_reference_m=(-6.0, 0.3, 2.0),
    )
    return ideal_sensors(truth, RATE_HZ)


@lru_cache(maxsize=4)
def flights(seed: int) -> tuple[Flown, ...]:
    """The flights of a trial, without an effect."""
    return tuple(_flown(seed, k, heading) for k, heading in enumerate(HEADINGS_DEG))


def _flown(seed: int, number: int, heading_deg: float) -> Flown:
    ideal = _ideal(heading_deg)
    plan = SessionPlan(
        run_id=f"flight-{number + 1}", with_gnss=True, gnss_lever_arm_m=(1.5, -0.4, -1.8)
    )
    rng = np.random.default_rng([seed, number, 18])
    session = simulate_run(
        ideal, thermal_history("ambient"), unit(), twin(), rng=rng, plan=plan
    ).run
    air = 1.0 - ideal.on_wheels
    climbing = np.gradient(ideal.height_m, ideal.dt_s) > 1.0
    # engines at full power shake the mount most; the airframe rocks it most in quick cruise
    power, rocking = air * np.where(climbing, 1.0, 0.45), air * np.where(climbing, 0.5, 1.0)
    shake = _of_no_mean(power[:, None] * SHAKE_M_S2, rng)
    swing = _of_no_mean(rocking[:, None] * SWING_DEG_S * DEG, rng)
    # what swings sees force and turn from another side: the angle in the middle of each row
    angle = (np.cumsum(swing, axis=0) - 0.5 * swing) * ideal.dt_s
    force, turn = ideal.dv_m_s * RATE_HZ, ideal.dtheta_rad * RATE_HZ
    gyro = swing + np.cross(turn + 0.5 * swing, angle)
    run = _added(session, gyro=gyro, accel=shake + np.cross(force, angle))
    return Flown(run, ideal, shake, swing)


def _of_no_mean(sigma: NDArray, rng: np.random.Generator) -> NDArray:
    """Shaking that leaves neither speed nor way behind over each second: what shakes at 50 Hz with
    1 m/s^2 moves by 3 mm/s and 10 micrometres.
    """
    n = int(RATE_HZ)
    whole = sigma.shape[0] // n * n
    drawn = rng.standard_normal(sigma.shape)
    drawn[whole:] = 0.0
    seconds = drawn[:whole].reshape(-1, n, 3)
    smooth = np.stack([np.ones(n), np.arange(n) - 0.5 * (n - 1)], axis=1)
    smooth /= np.linalg.norm(smooth, axis=0)
    seconds = seconds - np.einsum("ik,jk,sjc->sic", smooth, smooth, seconds)
    # a second in which it begins or ends has one sigma as well
    level = sigma[:whole].reshape(-1, n, 3).min(axis=1, keepdims=True)
    drawn[:whole] = (level * seconds).reshape(-1, 3)
    return drawn


def _added(run: Run, *, gyro: NDArray | None = None, accel: NDArray | None = None) -> Run:
    """The run whose sensors read so much more, (rows, 3) [rad/s, m/s^2]."""
    imu = run.imu.whole()
    dtheta, dv = imu.dtheta_rad, imu.dv_m_s
    if gyro is not None:
        dtheta = dtheta + gyro * imu.dt_s[:, None]
    if accel is not None:
        dv = dv + accel * imu.dt_s[:, None]
    return replace(run, imu=replace(imu, dtheta_rad=dtheta, dv_m_s=dv))


def _alone(values: NDArray, axis: int) -> NDArray:
    out = np.zeros((values.size, 3))
    out[:, axis] = values
    return out


def _fixes(run: Run, way_n_m: NDArray, velocity_n: NDArray) -> Run:
    """The run whose receiver is off by so much at its fixes (n, 3)."""
    gnss = run.gnss
    assert gnss is not None
    lat, lon, height = moved_by(gnss.lat_rad, gnss.lon_rad, gnss.height_m, way_n_m)
    moved = replace(
        gnss, lat_rad=lat, lon_rad=lon, height_m=height, v_n_m_s=gnss.v_n_m_s + velocity_n
    )
    return replace(run, gnss=moved)


def _rate(f: Flown) -> NDArray:
    return f.ideal.dtheta_rad * RATE_HZ


def _force(f: Flown) -> NDArray:
    return f.ideal.dv_m_s * RATE_HZ


def _turning(f: Flown) -> NDArray:
    """Rate against the Earth (rows, 3)."""
    earth_b = np.einsum("nij,i->nj", f.ideal.C_nb, omega_ie_n(SITE.lat_rad))
    return _rate(f) - earth_b


def accel_rectifies(f: Flown, size: float) -> Run:
    """K2 a^2 of each row."""
    return _added(f.run, accel=_alone(size * f.shake[:, 0] ** 2, 0))


def gyro_rectifies(f: Flown, size: float) -> Run:
    power = np.sum(f.shake**2, axis=1)
    return _added(f.run, gyro=_alone(size * DEG_PER_HOUR * power, 1))


def gyro_cones(f: Flown, size: float) -> Run:
    """A share of the cone that the rows go round: the sizes of the two swings, multiplied."""
    cone = np.abs(f.swing[:, 0]) * np.abs(f.swing[:, 1])
    return _added(f.run, gyro=_alone(size * cone, 2))


def _pressure_hpa(f: Flown) -> NDArray:
    """Summed up layer by layer: dp = -rho g dh, T falling by 6.5 degC a km."""
    heights = np.arange(0.0, 6000.0, 5.0)
    p = [1013.25]
    for h in heights[:-1]:
        p.append(p[-1] * (1.0 - STANDARD_GRAVITY * 5.0 / (287.05 * (288.15 - 0.0065 * (h + 2.5)))))
    return np.asarray(np.interp(f.ideal.height_m, heights, p))


def gyro_feels_pressure(f: Flown, size: float) -> Run:
    """Nothing at 950 hPa, where the unit was calibrated."""
    return _added(f.run, gyro=_alone(size * DEG_PER_HOUR * (_pressure_hpa(f) - 950.0), 0))


def accel_feels_pressure(f: Flown, size: float) -> Run:
    return _added(f.run, accel=_alone(size * 1e-6 * (_pressure_hpa(f) - 950.0), 1))


def _one_sense_stretched(values: NDArray, size: float) -> NDArray:
    read = np.where(values > 0.0, values * (1.0 + size * 1e-6), values * (1.0 - size * 1e-6))
    return np.asarray(read - values)


def accel_stretches(f: Flown, size: float) -> Run:
    return _added(f.run, accel=_alone(_one_sense_stretched(_force(f)[:, 0], size), 0))


def gyro_stretches(f: Flown, size: float) -> Run:
    return _added(f.run, gyro=_alone(_one_sense_stretched(_rate(f)[:, 2], size), 2))


def gyro_scales(f: Flown, size: float) -> Run:
    return _added(f.run, gyro=_alone(size * 1e-6 * _rate(f)[:, 2], 2))


def gyro_leans(f: Flown, size: float) -> Run:
    """The input axis of gyro x leans towards z, by a rotation."""
    lean = size * ARCSEC
    w = _rate(f)
    return _added(f.run, gyro=_alone(np.cos(lean) * w[:, 0] + np.sin(lean) * w[:, 2] - w[:, 0], 0))


def gyro_feels_force(f: Flown, size: float) -> Run:
    """Of gyro x with the force along z."""
    return _added(f.run, gyro=_alone(size * DEG_PER_HOUR * _force(f)[:, 2] / STANDARD_GRAVITY, 0))


def lever_of_accel(f: Flown, size: float) -> Run:
    """The sensor of x sits aside by r along y: its own velocity, differenced."""
    r = np.array([0.0, size * 0.01, 0.0])
    w = _turning(f)
    velocity = np.cross(w, r)
    force = np.gradient(velocity, f.ideal.dt_s, axis=0) + np.cross(w, velocity)
    return _added(f.run, accel=_alone(force[:, 0], 0))


def _late(f: Flown, late_s: NDArray) -> Run:
    """Fixes of where the antenna was so much earlier."""
    gnss = f.run.gnss
    assert gnss is not None
    t, v = f.ideal.time_s, f.ideal.v_n_m_s
    way = np.cumsum(v, axis=0) * f.ideal.dt_s

    def change(series: NDArray) -> NDArray:
        columns = [
            np.interp(gnss.time_s - late_s, t, c) - np.interp(gnss.time_s, t, c) for c in series.T
        ]
        return np.stack(columns, axis=1)

    return _fixes(f.run, change(way), change(v))


def _gnss(f: Flown) -> GnssLog:
    assert f.run.gnss is not None
    return f.run.gnss


def fixes_late(f: Flown, size: float) -> Run:
    return _late(f, np.full(_gnss(f).time_s.size, size * 1e-3))


def clock_runs_away(f: Flown, size: float) -> Run:
    return _late(f, size * 1e-6 * _gnss(f).time_s)


def fixes_circle(f: Flown, size: float) -> Run:
    """A reflection that goes round in 800 s, in the first flight only: a turning pointer."""
    if f.run.header.run_id != "flight-1":
        return f.run
    w = 2.0 * np.pi / 800.0
    pointer = size * np.exp(1j * (w * _gnss(f).time_s + 0.7))
    way = np.stack([pointer.real, pointer.imag, np.zeros(pointer.size)], axis=1)
    speed = np.stack([-w * pointer.imag, w * pointer.real, np.zeros(pointer.size)], axis=1)
    return _fixes(f.run, way, speed)


def plumb_line_turns(f: Flown, size: float) -> Run:
    """Gravity turned about east, by an angle that grows with the way from the site."""
    ideal = f.ideal
    north_m = (ideal.lat_rad - ideal.lat_rad[0]) * 6.37e6
    east_m = (ideal.lon_rad - ideal.lon_rad[0]) * 6.39e6 * np.cos(SITE.lat_rad)
    angle = size * ARCSEC * np.hypot(north_m, east_m) / 1e5
    lean_n = STANDARD_GRAVITY * np.stack(
        [np.sin(angle), np.zeros(angle.size), 1.0 - np.cos(angle)], axis=1
    )
    return _added(f.run, accel=np.einsum("nij,ni->nj", ideal.C_nb, lean_n))


# an implant of size 1 has its range so much below the largest value; chosen: a tenth of that, a
# manoeuvre of one in ten beyond it; what is lost goes with the square of the depth
DEPTH = 0.1
DEEPEST = 81.0  # nine tenths of the largest value


def gyro_clips(f: Flown, size: float) -> Run:
    """A converter that ends below the largest rate of the flight about z."""
    return _clipped(f.run, gyro=True, axis=2, size=size)


def accel_clips(f: Flown, size: float) -> Run:
    """The same for the accelerometer along z: turns press on it, and it shakes."""
    return _clipped(f.run, gyro=False, axis=2, size=size)


def _clipped(run: Run, *, gyro: bool, axis: int, size: float) -> Run:
    imu = run.imu.whole()
    name = "dtheta_rad" if gyro else "dv_m_s"
    values = getattr(imu, name).copy()
    rate = values[:, axis] / imu.dt_s
    limit = (1.0 - DEPTH * np.sqrt(min(size, DEEPEST))) * float(np.abs(rate).max())
    values[:, axis] = np.clip(rate, -limit, limit) * imu.dt_s
    return replace(run, imu=replace(imu, **{name: values}))


PLANTED = (
    Planted("gyro_saturation", "gyro_z", gyro_clips, 0.001, ("gyro_scale_asymmetry", SCALE)),
    Planted(
        "accel_saturation",
        "accel_z",
        accel_clips,
        0.05,
        ("accel_scale_asymmetry", "accel_scale_factor"),
    ),
    Planted(
        "accel_vibration_rectification",
        "accel_x",
        accel_rectifies,
        1e-4,
        ("accel_pressure_sensitivity", "accel_g2_sensitivity"),
    ),
    Planted(
        "gyro_vibration_rectification",
        "gyro_y",
        gyro_rectifies,
        0.05,
        ("gyro_pressure_sensitivity", "gyro_g2_sensitivity", "coning_residual"),
    ),
    Planted(
        "coning_residual",
        "gyro_z",
        gyro_cones,
        0.1,
        ("gyro_vibration_rectification", "gyro_g2_sensitivity"),
    ),
    Planted(
        "gyro_pressure_sensitivity",
        "gyro_x",
        gyro_feels_pressure,
        1e-3,
        ("gyro_vibration_rectification",),
    ),
    Planted(
        "accel_pressure_sensitivity",
        "accel_y",
        accel_feels_pressure,
        10.0,
        ("accel_vibration_rectification",),
    ),
    Planted(
        "accel_scale_asymmetry",
        "accel_x",
        accel_stretches,
        200.0,
        ("accel_scale_factor", "accel_g2_sensitivity"),
    ),
    Planted("gyro_scale_asymmetry", "gyro_z", gyro_stretches, 20.0, (SCALE,)),
    Planted(SCALE, "gyro_z", gyro_scales, 20.0, ("gyro_scale_asymmetry", "clock_rate")),
    Planted("gyro_misalignment", "gyro_x", gyro_leans, 10.0, ("gyro_magnetic_sensitivity",)),
    Planted("gyro_g_sensitivity", "gyro_x", gyro_feels_force, 0.05, ("gyro_g2_sensitivity",)),
    Planted(
        "imu_size_effect",
        "accel_x",
        lever_of_accel,
        10.0,
        (ANTENNA, "gyro_accel_skew", "accel_misalignment"),
    ),
    Planted(ANTENNA, "gnss", fixes_late, 5.0, ("gnss_clock_drift",)),
    Planted("gnss_clock_drift", "gnss", clock_runs_away, 10.0, (ANTENNA,)),
    Planted("gnss_slow_error", "gnss", fixes_circle, 1.0, (ANTENNA,)),
    Planted(
        "vertical_deflection_gradient", "site", plumb_line_turns, 20.0, ("vertical_deflection",)
    ),
)


def evidence_of(runs: Sequence[Run]) -> Evidence:
    """The whitened rows of the runs, as the diagnosis sees them."""
    views = [view_run(run, k, table(), twin()) for k, run in enumerate(runs)]
    return Evidence([v for v in views if not isinstance(v, str)], twin())


def diagnosed(runs: Sequence[Run]) -> tuple[Diagnosis, float]:
    """The whole diagnosis of flights, and what it took [CPU s]."""
    start = time.process_time()
    found = diagnose(runs, twin(), table(), DiagnosisSettings())
    return found, time.process_time() - start


def at_size(planted: Planted, bases: Sequence[Flown], wanted: float) -> tuple[list[Run], float]:
    """The runs with an effect at the wanted size, and the size reached."""
    runs = [f.run for f in bases]
    without, size, reached = evidence_of(runs), planted.start, 0.0
    for _ in range(6):
        runs = [planted.lay(f, size) for f in bases]
        evidence = evidence_of(runs)
        if evidence.size != without.size:
            size *= 0.5
            continue
        reached = float(np.linalg.norm(evidence.z - without.z))
        if abs(reached / wanted - 1.0) < CLOSE:
            break
        size *= wanted / reached
    return runs, reached


def trial(name: str, seed: int, wanted: float) -> Record:
    """One effect at one size in the flights of a seed, diagnosed.

    outcome: right: the effect leads on its target and no other cause stands beside it; neighbour: a
    stated one leads, or the effect is in the set; none: nothing was found or nothing named.
    """
    planted = next(p for p in PLANTED if p.effect == name)
    runs, reached = at_size(planted, flights(seed), wanted)
    found, cpu_s = diagnosed(runs)
    named = [c for c in found.causes if c.named]
    leads = {(c.effect, c.target) for c in named}
    right = (planted.effect, planted.target)
    near = {(name, planted.target) for name in (planted.effect, *planted.neighbours)}
    in_sets = {(r.effect, r.target) for c in found.causes for r in c.rivals}
    sure = any(c.probability > WRONG_AND_SURE for c in named if (c.effect, c.target) not in near)
    if not named:
        outcome = "none"
    elif leads == {right}:
        outcome = "right"
    elif (leads & near or right in in_sets) and not sure:
        outcome = "neighbour"
    else:
        outcome = "wrong"
    return {
        "effect": planted.effect,
        "wanted": wanted,
        "reached": round(reached, 2),
        "outcome": outcome,
        "sure": sure,
        "said": [f"{c.effect} on {c.target} {c.probability:.2f}" for c in found.causes],
        "cpu_s": round(cpu_s, 1),
    }


def null(seed: int) -> Record:
    """The diagnosis of flights without an effect."""
    found, cpu_s = diagnosed([f.run for f in flights(seed)])
    return {"verdict": found.verdict, "p_value": found.gap.p_value, "cpu_s": round(cpu_s, 1)}


def run(
    work: Work,
    *,
    seeds: int = 2,
    first: int = 0,
    sizes: tuple[float, ...] = (8.0, 12.0),
    effects: tuple[str, ...] = tuple(p.effect for p in PLANTED),
    nulls: int = 0,
) -> str:
    """nulls: flights without an effect, from seed 100 on."""
    drawn = range(first, first + seeds)
    records = work.each(trial, [(e, seed, s) for seed in drawn for e in effects for s in sizes])
    rows = []
    for effect in effects:
        own = [r for r in records if r["effect"] == effect]
        by_size = [", ".join(r["outcome"] for r in own if r["wanted"] == s) for s in sizes]
        rows.append([effect, *by_size, "; ".join(dict.fromkeys(s for r in own for s in r["said"]))])
    outcomes = Counter(r["outcome"] for r in records)
    counts = [f"{word} {share(n, len(records))}" for word, n in outcomes.items()]
    quiet = work.each(null, [(seed,) for seed in range(100, 100 + nulls)])
    alarms = sum(r["verdict"] != "no_gap" for r in quiet)
    head = ("planted", *(f"at {s:g} sigma" for s in sizes), "what was named")
    told = f"{'; '.join(counts)}; wrong and sure {sum(r['sure'] for r in records)}.\n"
    without = f"Flights without an effect: {share(alarms, nulls)} alarms.\n" if nulls else ""
    return "\n".join([markdown(head, rows), told, without])
