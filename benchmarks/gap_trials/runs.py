"""The plan of a trial and its base runs, simulated by `trajectories` without any effect.

The unit's true thermal bias is exactly the twin's table: straight between the same nodes.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.fft import next_fast_len

from benchmarks.gap_trials.seen import Seen
from ins.records import AXES, InputError, Run, Site, TwinModel
from ins.twin_file import default_twin
from ins.units import DEG
from trajectories.simulator.motions import SimulatedMotion, lay
from trajectories.simulator.segments import Park, Segment, Stop, Straight, Turn
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import ThermalHistory, thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

SERIAL = "SN-0042"
RATE_HZ = 10.0
PARKED_S, ALIGNMENT_S = 3600.0, 600.0
SITE_DEG = (45.0, 7.0, 250.0)  # latitude, longitude, height [m]
HEADING_SPREAD_DEG = 30.0
VARIANTS = 3  # ideal runs kept for each start: headings and taxis
NODES_DEGC = np.arange(-40.0, 91.0, 5.0)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Thermal starts, one a run, their nominal headings, how long the vehicle parks, whether it
    taxis then, and whether it hears satellites.
    """

    starts: tuple[str, ...]
    headings_deg: tuple[float, ...]
    taxi: bool
    parked_s: float = PARKED_S
    with_gnss: bool = True


PLANS = {
    "four": Plan(
        starts=("cold", "ambient", "hot", "cooling"),
        headings_deg=(0.0, 90.0, 180.0, 270.0),
        taxi=True,
    ),
    "four_parked": Plan(
        starts=("cold", "ambient", "hot", "cooling"),
        headings_deg=(0.0, 90.0, 180.0, 270.0),
        taxi=False,
    ),
    "one_cold": Plan(starts=("cold",), headings_deg=(0.0,), taxi=False),
}


@dataclass(frozen=True)
class Base:
    """A run without effect, and its truth."""

    run: Run
    seen: Seen


def plan_named(name: str) -> Plan:
    if name not in PLANS:
        raise InputError(f"trial plan {name!r}, needed one of {', '.join(PLANS)}")
    return PLANS[name]


def draw_table(rng: np.random.Generator) -> dict[str, Any]:
    """A unit's thermal table (recal.table/1): level, slope of a few 0.001 deg/h/degC, bend and
    wave.
    """
    x = (NODES_DEGC - 20.0) / 40.0
    axes: dict[str, Any] = {}
    for axis in AXES:
        level, slope, bend = rng.standard_normal(3) * [0.03, 0.12, 0.03]
        wave = 0.01 * np.sin(np.pi * x + rng.uniform(0, 2 * np.pi))
        bias = level + slope * x + bend * x**2 + wave
        axes[axis] = {
            "temperature_degC": NODES_DEGC.tolist(),
            "bias_deg_h": bias.tolist(),
            "sigma_deg_h": [0.001] * NODES_DEGC.size,
        }
    return {
        "schema": "recal.table/1",
        "imu_serial": SERIAL,
        "gyro_technology": "rlg",
        "created_utc": "2026-01-01T00:00:00Z",
        "interpolation": "linear",
        "axes": axes,
        "covariance": None,
        "provenance": {"parent_sha256": None, "runs": []},
    }


def rlg_twin() -> TwinModel:
    """The twin of formats.md for a ring laser unit, its table beside it."""
    return replace(default_twin("rlg"), imu_serial=SERIAL, table="table.json")


def taxi_segments(rng: np.random.Generator) -> list[Segment]:
    """Eight to ten minutes: left and right turns at 4 to 8 m/s, legs at 7 to 12 m/s, brakings,
    three stops of 60 s and more.
    """
    side = 1.0 if rng.random() < 0.5 else -1.0
    segments: list[Segment] = []
    for leg, sense in enumerate((side, -side, side, -side, side)):
        speed = float(rng.uniform(4.0, 8.0))
        segments.append(
            Turn(
                angle_deg=sense * float(rng.uniform(50, 110)),
                radius_m=speed * float(rng.uniform(5, 9)),
                speed_m_s=speed,
            )
        )
        pace = float(rng.uniform(0.5, 0.9))
        segments.append(
            Straight(
                duration_s=float(rng.uniform(28, 50)),
                speed_m_s=float(rng.uniform(7, 12)),
                acceleration_m_s2=pace,
            )
        )
        if leg % 2 == 0:
            segments.append(
                Stop(
                    duration_s=float(rng.uniform(60, 80)),
                    deceleration_m_s2=float(rng.uniform(0.5, 1.2)),
                )
            )
    return segments


def whole_motion(taxi: list[Segment], parked_s: float) -> SimulatedMotion:
    """Parking and taxi; a last stop is drawn out to a run length whose Fourier transform is quick
    (a few seconds).
    """
    segments = [Park(duration_s=parked_s), *taxi]
    alignment_s = min(ALIGNMENT_S, parked_s)
    motion = lay(segments, alignment_s=alignment_s)
    last = segments[-1]
    if not isinstance(last, Stop):
        return motion
    rows = int(np.ceil(motion.end_s * RATE_HZ)) + 2
    wanted_s = (next_fast_len(rows) - 1) / RATE_HZ + 0.05
    longer = replace(last, duration_s=last.duration_s + wanted_s - motion.end_s)
    return lay([*segments[:-1], longer], alignment_s=alignment_s)


@lru_cache(maxsize=32)
def ideal_run(heading_deg: float, variant: int, parked_s: float, taxi: bool) -> IdealSensors:
    """Ideal sensors of one start heading; each variant has its own heading offset, tilt and
    taxi.
    """
    rng = np.random.default_rng([int(heading_deg), variant, 4])
    lat, lon, height = SITE_DEG
    motion = whole_motion(taxi_segments(rng) if taxi else [], parked_s)
    truth = build_truth(
        motion,
        Site(lat_rad=lat * DEG, lon_rad=lon * DEG, height_m=height),
        heading_rad=(heading_deg + float(rng.uniform(-HEADING_SPREAD_DEG, HEADING_SPREAD_DEG)))
        * DEG,
        roll_rad=0.5 * DEG * float(rng.standard_normal()),
        pitch_rad=0.5 * DEG * float(rng.standard_normal()),
    )
    return ideal_sensors(truth, RATE_HZ)


def base_runs(
    seed: int,
    plan: Plan,
    *,
    table: dict[str, Any],
    twin: TwinModel,
    unit_twin: TwinModel | None = None,
) -> tuple[Base, ...]:
    """The runs of a plan without effect. unit_twin: the noise that the unit really has (None: as
    declared).
    """
    unit = aged_unit(
        np.random.default_rng(0),
        imu_serial=SERIAL,
        ageing_offset_deg_h=0.0,
        ageing_shape_deg_h=0.0,
        table=table,
    )
    bases = []
    for number, (start, heading_deg) in enumerate(zip(plan.starts, plan.headings_deg)):
        rng = np.random.default_rng([seed, 1, number])
        variant = int(rng.integers(VARIANTS))
        thermal = thermal_history(start, rng=rng)
        ideal = ideal_run(heading_deg, variant, plan.parked_s, plan.taxi)
        simulated = simulate_run(
            ideal,
            thermal,
            unit,
            unit_twin or twin,
            rng=rng,
            plan=SessionPlan(
                with_gnss=plan.with_gnss,
                with_odometer=True,
                run_id=f"trial-{seed:05d}-{number + 1}",
                tail="TRIAL",
                start_utc=f"2026-03-{number + 1:02d}T05:00:00Z",
            ),
        )
        seen = seen_of(ideal, thermal, number=number, of=len(plan.starts), twin=twin, table=table)
        bases.append(Base(simulated.run, seen))
    return tuple(bases)


def seen_of(
    ideal: IdealSensors,
    thermal: ThermalHistory,
    *,
    number: int,
    of: int,
    twin: TwinModel,
    table: dict[str, Any],
) -> Seen:
    warm = thermal.at(ideal.time_s - 0.5 * ideal.dt_s)
    return Seen(
        number=number,
        of=of,
        time_s=ideal.time_s,
        dt_s=ideal.dt_s,
        dtheta_rad=ideal.dtheta_rad,
        dv_m_s=ideal.dv_m_s,
        C_nb=ideal.C_nb,
        v_n_m_s=ideal.v_n_m_s,
        speed_m_s=ideal.speed_m_s,
        lat_rad=ideal.lat_rad,
        height_m=ideal.height_m,
        gyro_degC=warm.gyro_degC,
        accel_degC=warm.accel_degC,
        gradient_degC=warm.gradient_degC,
        block_degC=warm.block_degC,
        twin=twin,
        table=table,
    )
