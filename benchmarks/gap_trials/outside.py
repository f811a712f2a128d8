"""The second source of trials: ideal increments by pyins, noise and temperatures by formulas of our
own.

Shares with `trajectories` only the records and the run's hash; the noise is that of formats.md
section 3.
"""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_trials import processes, runs
from benchmarks.gap_trials.runs import Base, Plan
from benchmarks.gap_trials.seen import Seen, Streams, moved, run_of, tilted
from ins.records import (
    GnssLog,
    ImuLog,
    InputError,
    OdometerLog,
    Phase,
    Run,
    RunHeader,
    Site,
    TemperatureLog,
    TwinModel,
)
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MILLIRADIAN

DT_S = 0.1
SMOOTHING_S = 4.0  # Hann window over speed and rate of turn
BRAKING_S = 14.0  # from the fastest leg
THERMAL_DEGC = {  # ambient, start, rise of the block by its own heat
    "cold": (-6.0, -6.0, 38.0),
    "ambient": (19.0, 19.0, 24.0),
    "hot": (37.0, 42.0, 9.0),
    "cooling": (4.0, 47.0, 20.0),
}
SIDE_TAU_S, ROLLING_M_S = 2.0, 1.0


def base_runs(
    seed: int,
    plan: Plan,
    *,
    table: dict[str, Any],
    twin: TwinModel,
    unit_twin: TwinModel | None = None,
) -> tuple[Base, ...]:
    """As `runs.base_runs`, by pyins. InputError with what to install where it is missing."""
    bases = []
    for number, (start, heading_deg) in enumerate(zip(plan.starts, plan.headings_deg)):
        rng = np.random.default_rng([seed, 5, number])
        seen, lon_rad = _seen(rng, start, heading_deg, plan, number=number, twin=twin, table=table)
        run = _run(rng, seen, lon_rad, unit_twin or twin, seed=seed, with_gnss=plan.with_gnss)
        bases.append(Base(run, seen))
    return tuple(bases)


def _seen(
    rng: np.random.Generator,
    start: str,
    heading_deg: float,
    plan: Plan,
    *,
    number: int,
    twin: TwinModel,
    table: dict[str, Any],
) -> tuple[Seen, NDArray]:
    path = ideal_path(heading_deg, int(rng.integers(runs.VARIANTS)), plan.parked_s, plan.taxi)
    warm = temperatures(rng, start, path.time_s)
    truth = {key: value for key, value in vars(path).items() if key != "lon_rad"}
    return (
        Seen(
            number=number, of=len(plan.starts), dt_s=DT_S, twin=twin, table=table, **truth, **warm
        ),
        path.lon_rad,
    )


@lru_cache(maxsize=32)
def ideal_path(heading_deg: float, variant: int, parked_s: float, taxi: bool) -> SimpleNamespace:
    """Truth at the ends of the rows and ideal increments, under the names of `Seen`, and the
    longitude.
    """
    try:
        from pyins import sim, transform
    except ImportError:
        raise InputError(
            "source pyins: not installed, needed `pip install python-ins` (in the dev extra)"
        ) from None
    rng = np.random.default_rng([int(heading_deg), variant, 6])
    speed, turn_rate = taxi_profile(rng, parked_s, taxi)
    time_s = DT_S * np.arange(speed.size)
    heading = (
        heading_deg * DEG
        + rng.uniform(-1, 1) * runs.HEADING_SPREAD_DEG * DEG
        + DT_S * np.cumsum(turn_rate)
    )
    level = 0.5 * rng.standard_normal(2)
    rph = np.stack(
        [np.full(speed.size, level[0]), np.full(speed.size, level[1]), heading / DEG], axis=-1
    )
    v_n = speed[:, None] * np.stack(
        [np.cos(heading), np.sin(heading), np.zeros(speed.size)], axis=-1
    )
    trajectory, imu = sim.generate_imu(time_s, runs.SITE_DEG, rph, v_n, sensor_type="increment")
    values = imu.to_numpy()[1:]
    return SimpleNamespace(
        time_s=time_s[1:],
        dtheta_rad=values[:, :3],
        dv_m_s=values[:, 3:],
        C_nb=transform.mat_from_rph(rph[1:]),
        v_n_m_s=v_n[1:],
        speed_m_s=speed[1:],
        lat_rad=trajectory["lat"].to_numpy()[1:] * DEG,
        lon_rad=trajectory["lon"].to_numpy()[1:] * DEG,
        height_m=trajectory["alt"].to_numpy()[1:],
    )


def taxi_profile(rng: np.random.Generator, parked_s: float, taxi: bool) -> tuple[NDArray, NDArray]:
    """Speed [m/s] and rate of turn [rad/s] at 10 Hz from power-on: parked, then legs, turns both
    ways and stops.
    """
    pieces = [(parked_s, 0.0, 0.0)]  # duration [s], speed, rate
    side = rng.choice([-1.0, 1.0])
    for leg in range(5 if taxi else 0):
        rate = side * rng.uniform(0.1, 0.22)
        side = -side
        turning = rng.uniform(50, 110) * DEG / abs(rate)
        slow, fast = rng.uniform(4, 8), rng.uniform(7, 12)
        pieces += [(8.0, slow, 0.0), (turning, slow, rate), (rng.uniform(30, 55), fast, 0.0)]
        if leg % 2 == 0:
            pieces += [(SMOOTHING_S + BRAKING_S + rng.uniform(61, 80), 0.0, 0.0)]
    speed = np.concatenate([np.full(int(d / DT_S), v) for d, v, _ in pieces])
    rate = np.concatenate([np.full(int(d / DT_S), r) for d, _, r in pieces])
    return np.concatenate([[0.0], np.maximum(_hann(_limited(speed, 0.09)), 0.0)]), np.concatenate(
        [[0.0], _hann(rate)]
    )


def _limited(speed: NDArray, step: float) -> NDArray:
    """The speed reached with at most `step` m/s a row (0.9 m/s^2)."""
    out, now = np.empty(speed.size), 0.0
    for k, wanted in enumerate(speed.tolist()):
        now += min(max(wanted - now, -step), step)
        out[k] = now
    return out


def _hann(values: NDArray) -> NDArray:
    """Smoothed by a Hann window; later by half of it, so that rest stays rest."""
    window = np.hanning(int(SMOOTHING_S / DT_S) + 2)
    smooth = np.convolve(values, window / window.sum())[: values.size]
    return np.where(np.abs(smooth) < 1e-9, 0.0, smooth)


def temperatures(rng: np.random.Generator, start: str, time_s: NDArray) -> dict[str, NDArray]:
    """True temperatures at the middles of the rows: a block that warms by its own heat and leaks to
    a drifting ambient.
    """
    ambient, cold, heat = np.array(THERMAL_DEGC[start]) + 3.0 * rng.standard_normal(3) * [
        1.0,
        1.0,
        0.7,
    ]
    t = time_s - 0.5 * DT_S
    tau = 1500.0 * rng.uniform(0.75, 1.3)
    outside = ambient + 2.0 * (t / 3600.0) * rng.standard_normal()
    block = (
        outside
        + (cold - ambient) * np.exp(-t / tau)
        + heat * -np.expm1(-((t / (0.9 * tau)) ** 1.1))
    )
    gyro = np.stack(
        [
            processes.lagged(block, tau_s=late, dt_s=DT_S) + own * np.tanh(t / 700.0)
            for late, own in zip((390.0, 510.0, 340.0), (1.2, 2.1, 1.0))
        ],
        axis=-1,
    )
    accel = np.stack(
        [processes.lagged(gyro.mean(axis=1), tau_s=late, dt_s=DT_S) for late in (60.0, 90.0, 75.0)],
        axis=-1,
    )
    return {
        "gyro_degC": gyro,
        "accel_degC": accel,
        "block_degC": block,
        "gradient_degC": (block[:, None] - gyro) * [0.28, -0.22, 0.2],
    }


def _run(
    rng: np.random.Generator,
    seen: Seen,
    lon_rad: NDArray,
    twin: TwinModel,
    *,
    seed: int,
    with_gnss: bool,
) -> Run:
    lat, lon, height = runs.SITE_DEG
    header = RunHeader(
        run_id=f"trial-{seed:05d}-{seen.number + 1}",
        tail="TRIAL",
        imu_serial=runs.SERIAL,
        gyro_technology="rlg",
        start_utc=f"2026-03-{seen.number + 1:02d}T05:00:00Z",
        site=Site(lat_rad=lat * DEG, lon_rad=lon * DEG, height_m=height),
    )
    imu = ImuLog(
        time_s=seen.time_s,
        dt_s=np.full(seen.rows, DT_S),
        dtheta_rad=seen.dtheta_rad,
        dv_m_s=seen.dv_m_s,
    )
    ideal = Streams(
        header=header,
        dtheta_rad=seen.dtheta_rad,
        dv_m_s=seen.dv_m_s,
        temperature=_thermometers(rng, seen, twin),
        gnss=_fixes(seen, lon_rad) if with_gnss else None,
        odometer=None,
        dt_s=DT_S,
    )
    streams = _sensors(rng, _vehicle(rng, ideal, seen, twin), seen, twin)
    speed = seen.speed_m_s * (
        1 + 1e-6 * twin.odometer.scale_ppm
    ) + twin.odometer.noise_m_s * rng.standard_normal(seen.rows)
    odometer = OdometerLog(time_s=seen.time_s, speed_m_s=speed)
    gnss = _noisy_fixes(rng, streams.gnss, twin) if streams.gnss else None
    return run_of(
        Run(header=header, imu=imu, phases=_phases(seen)),
        replace(streams, odometer=odometer, gnss=gnss),
    )


def _vehicle(rng: np.random.Generator, streams: Streams, seen: Seen, twin: TwinModel) -> Streams:
    """Yaw creep while parked, sway, side velocity and crab while rolling."""
    v, n = twin.vehicle, seen.rows
    parked = np.abs(seen.speed_m_s) < 1e-9
    yaw = np.cumsum(
        parked * v.yaw_creep_arcsec_sqrt_h * ARCSEC / 60.0 * np.sqrt(DT_S) * rng.standard_normal(n)
    )
    streams = tilted(streams, seen, np.outer(yaw, [0.0, 0.0, 1.0]))
    dv_n = yaw[:, None] * np.cross([0.0, 0.0, 1.0], seen.v_n_m_s)
    for axis in range(2):
        dv_n[:, axis] += processes.oscillator_velocity(
            rng, n, rms=v.sway_m_s, frequency_hz=v.sway_hz, damping=v.sway_damping, dt_s=DT_S
        )
    rolling = 1 / (1 + np.exp(-np.clip((seen.speed_m_s - ROLLING_M_S) / 0.1, -60, 60)))
    side = processes.gauss_markov(rng, n, rms=v.lateral_noise_m_s, tau_s=SIDE_TAU_S, dt_s=DT_S)
    lateral = rolling * side - seen.speed_m_s * np.tan(v.crab_mrad * MILLIRADIAN)
    return moved(streams, seen, dv_n + lateral[:, None] * seen.C_nb[:, :, 1])


def _sensors(rng: np.random.Generator, streams: Streams, seen: Seen, twin: TwinModel) -> Streams:
    """Thermal bias (the table), turn-on, flicker, random walks and white noise of six sensors."""
    n, g, a = seen.rows, twin.gyro, twin.accel
    root_dt = np.sqrt(DT_S)
    for k, axis in enumerate("xyz"):
        curve = seen.table["axes"][axis]
        bias = np.interp(seen.gyro_degC[:, k], curve["temperature_degC"], curve["bias_deg_h"])
        bias += g.turn_on_deg_h * rng.standard_normal()
        bias += processes.flicker(rng, n, instability=g.bias_instability_deg_h, dt_s=DT_S)
        bias += processes.random_walk(
            rng, n, density=g.rate_random_walk_deg_h_sqrt_h / 60.0, dt_s=DT_S
        )
        white = g.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR / DEG_PER_HOUR / root_dt
        streams = streams.gyro(f"gyro_{axis}", bias + white * rng.standard_normal(n))
        force = (
            a.bias_ug[k]
            + a.turn_on_ug * rng.standard_normal()
            + processes.flicker(rng, n, instability=a.bias_instability_ug, dt_s=DT_S)
        )
        force = force + processes.random_walk(
            rng, n, density=a.rate_random_walk_ug_sqrt_h / 60.0, dt_s=DT_S
        )
        streams = streams.accel(
            f"accel_{axis}", force + a.vrw_ug_sqrt_hz / root_dt * rng.standard_normal(n)
        )
    return streams


def _thermometers(rng: np.random.Generator, seen: Seen, twin: TwinModel) -> TemperatureLog:
    """1 Hz readings: noise, then rounding."""
    time_s = np.arange(np.floor(seen.time_s[-1]) + 1)
    noise = twin.temperature

    def read(true: NDArray) -> NDArray:
        columns = np.atleast_2d(true.T)
        now = np.stack(
            [np.interp(time_s, seen.time_s - 0.5 * DT_S, column) for column in columns], axis=-1
        )
        now += noise.noise_degC * rng.standard_normal(now.shape)
        now = (
            np.round(now / noise.resolution_degC) * noise.resolution_degC
            if noise.resolution_degC
            else now
        )
        return now if true.ndim == 2 else now[:, 0]

    return TemperatureLog(
        time_s=time_s,
        gyro_degC=read(seen.gyro_degC),
        accel_degC=read(seen.accel_degC),
        block_degC=read(seen.block_degC),
        gradient_degC=read(seen.gradient_degC),
    )


def _fixes(seen: Seen, lon_rad: NDArray) -> GnssLog:
    """1 Hz, without noise."""
    rows = np.arange(9, seen.rows, 10)
    return GnssLog(
        time_s=seen.time_s[rows],
        lat_rad=seen.lat_rad[rows],
        lon_rad=lon_rad[rows],
        height_m=seen.height_m[rows],
        v_n_m_s=seen.v_n_m_s[rows],
    )


def _noisy_fixes(rng: np.random.Generator, log: GnssLog, twin: TwinModel) -> GnssLog:
    n, sigma = log.time_s.size, twin.gnss
    radius = 6.378e6  # within 1 % of the radii of curvature: of a noise
    return replace(
        log,
        lat_rad=log.lat_rad + sigma.sigma_horizontal_m / radius * rng.standard_normal(n),
        lon_rad=log.lon_rad
        + sigma.sigma_horizontal_m / radius / np.cos(log.lat_rad) * rng.standard_normal(n),
        height_m=log.height_m + sigma.sigma_vertical_m * rng.standard_normal(n),
        v_n_m_s=log.v_n_m_s + sigma.sigma_velocity_m_s * rng.standard_normal((n, 3)),
        sigma_horizontal_m=np.full(n, sigma.sigma_horizontal_m),
        sigma_vertical_m=np.full(n, sigma.sigma_vertical_m),
        sigma_velocity_m_s=np.full(n, sigma.sigma_velocity_m_s),
    )


def _phases(seen: Seen) -> tuple[Phase, ...]:
    parked_s = np.floor(seen.taxi_s)
    cut_s = min(runs.ALIGNMENT_S, parked_s / 2)
    spans = [
        ("alignment", 0.0, cut_s),
        ("extended_alignment", cut_s, parked_s),
        ("taxi", parked_s, float(seen.time_s[-1])),
    ]
    return tuple(Phase(phase=name, start_s=a, end_s=b) for name, a, b in spans if b - a > 1.0)
