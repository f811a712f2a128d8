"""Simulated flights for the aided filter, with the errors of a solution against their truth in the
filter's own terms.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ins.attitude import dcm_from_euler, rotation_vector_from_dcm
from ins.earth import dcm_en, ecef_from_geodetic
from ins.filters.aided_records import AidedHistory
from ins.records import ReferenceLog, Site, TwinModel
from ins.twin_file import default_twin
from ins.units import DEG, DEG_PER_HOUR, MICRO_G
from tests.scenarios.study import table_to_zero
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Park,
    Segment,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
LEVER_M = (2.0, -0.5, -1.0)
FLIGHT: tuple[Segment, ...] = (
    Straight(duration_s=30.0),
    Turn(angle_deg=90.0),
    TakeOff(lift_off_speed_m_s=40.0),
    Climb(height_m=300.0, rate_m_s=5.0, speed_m_s=60.0),
    TurnFlight(angle_deg=120.0),
    Cruise(duration_s=60.0),
    TurnFlight(angle_deg=-200.0),
    Cruise(duration_s=120.0),
)


@lru_cache(maxsize=8)
def ideal(
    park_s: float = 60.0,
    segments: tuple[Segment, ...] = FLIGHT,
    heading_deg: float = 130.0,
    rate_hz: float = 10.0,
) -> IdealSensors:
    """A noise-free flight of eight minutes, made once."""
    return ideal_sensors(
        build_truth(lay([Park(duration_s=park_s), *segments]), SITE, heading_rad=heading_deg * DEG),
        rate_hz,
    )


def twin_of(technology: str, *, flicker: bool = True) -> TwinModel:
    """The technology's defaults; without flicker the sensors are what the filter takes them for."""
    twin = default_twin(technology)
    if flicker:
        return twin
    gyro = replace(twin.gyro, bias_instability_deg_h=0.0)
    accel = replace(twin.accel, bias_instability_ug=0.0)
    return replace(twin, gyro=gyro, accel=accel)


# of scales and misalignments, as the filter takes them: gyros [-], [rad], accelerometers [-]
SCALE_SIGMAS = {"rlg": (5e-6, 1e-5, 1e-4), "mems": (5e-3, 5e-3, 5e-3)}


def drawn_scales(technology: str, seed: int) -> np.ndarray:
    """Scale errors of the gyros, their misalignments, scale errors of the accelerometers (12,)."""
    sigma = np.repeat(SCALE_SIGMAS[technology], (3, 6, 3))
    return np.asarray(sigma * np.random.default_rng([seed, 21]).standard_normal(12))


def flown(
    base: IdealSensors, twin: TwinModel, seed: int, technology: str | None = None
) -> SimulatedRun:
    """A unit without a thermal bias in this flight, GNSS at 1 Hz; with scales and misalignments
    where a technology is given.
    """
    if technology is not None:
        scales = drawn_scales(technology, seed)
        gyro = replace(
            twin.gyro,
            scale_factor_ppm=tuple(1e6 * scales[:3]),
            misalignment_mrad=tuple(1e3 * scales[3:9]),
        )
        made = flown(base, replace(twin, gyro=gyro), seed)
        imu = made.run.imu
        pushed = replace(imu, dv_m_s=imu.dv_m_s * (1.0 + scales[9:]))
        header = replace(made.run.header, gyro_technology=technology)
        return replace(made, run=replace(made.run, imu=pushed, header=header))
    unit = aged_unit(
        np.random.default_rng(5),
        ageing_offset_deg_h=0.0,
        ageing_shape_deg_h=0.0,
        table=table_to_zero(),
    )
    return simulate_run(
        base,
        thermal_history("ambient"),
        unit,
        twin,
        rng=np.random.default_rng([seed, 3]),
        plan=SessionPlan(with_gnss=True, gnss_lever_arm_m=LEVER_M, with_phases=False),
    )


def errors(made: SimulatedRun, history: AidedHistory) -> np.ndarray:
    """Errors (k, 15) of a solution, order and signs of `ins.filters.states`."""
    motion = motion_errors(made.reference, history)
    gyro, accel = (
        np.stack([np.interp(history.time_s, made.bias_time_s, axis) for axis in bias.T], axis=1)
        for bias in (made.gyro_bias_true_deg_h, made.accel_bias_true_ug)
    )
    left = gyro * DEG_PER_HOUR - history.gyro_bias_rad_s, accel * MICRO_G - history.accel_bias_m_s2
    return np.hstack([motion, *left])


def motion_errors(reference: ReferenceLog, history: AidedHistory) -> np.ndarray:
    """Position, velocity and attitude errors (k, 9) in Earth axes, resolved north, east, down."""
    k = np.minimum(
        np.searchsorted(reference.time_s, history.time_s - 1e-6), reference.time_s.size - 1
    )
    lat, lon = reference.lat_rad[k], reference.lon_rad[k]
    C_en, C_en_true = dcm_en(history.lat_rad, history.lon_rad), dcm_en(lat, lon)
    r = ecef_from_geodetic(history.lat_rad, history.lon_rad, history.height_m)
    r = r - ecef_from_geodetic(lat, lon, reference.height_m[k])
    v = np.einsum("kij,kj->ki", C_en, history.v_n_m_s) - np.einsum(
        "kij,kj->ki", C_en_true, reference.v_n_m_s[k]
    )
    C_eb = C_en_true @ dcm_from_euler(
        reference.roll_rad[k], reference.pitch_rad[k], reference.heading_rad[k]
    )
    theta = rotation_vector_from_dcm(C_en @ history.C_nb @ np.swapaxes(C_eb, 1, 2))
    return np.hstack([np.einsum("kji,kj->ki", C_en, e) for e in (r, v, theta)])


def normalised(made: SimulatedRun, history: AidedHistory, first: int) -> np.ndarray:
    """Mean squared error over variance of position, velocity, attitude (3,) from row `first` on."""
    ratio = errors(made, history)[first:] ** 2 / history.variance[first:]
    return np.asarray(ratio[:, :9].reshape(-1, 3, 3).mean(axis=(0, 2)))


def gauss_markov(
    time_s: np.ndarray, rng: np.random.Generator, sigma: float, fades_s: float
) -> np.ndarray:
    """Three first-order Gauss-Markov errors (n, 3) at these times."""
    e = sigma * rng.standard_normal((time_s.size, 3))
    for k, fade in enumerate(np.exp(-np.diff(time_s) / fades_s)):
        e[k + 1] = fade * e[k] + np.sqrt(1.0 - fade**2) * e[k + 1]
    return e


def late_velocities(
    made: SimulatedRun, time_s: np.ndarray, v_n_m_s: np.ndarray, seconds: float
) -> np.ndarray:
    """The velocities of a flight's fixes, noise and all, moved to so much earlier."""
    ref = made.reference
    C_nb = dcm_from_euler(ref.roll_rad, ref.pitch_rad, ref.heading_rad)
    antenna = ref.v_n_m_s + np.gradient(C_nb @ np.array(LEVER_M), ref.time_s, axis=0)
    was, late = (
        np.stack([np.interp(t, ref.time_s, v) for v in antenna.T], axis=1)
        for t in (time_s, time_s - seconds)
    )
    return np.asarray(v_n_m_s - was + late)


def nees(made: SimulatedRun, history: AidedHistory) -> np.ndarray:
    """Normalised error squared over fifteen states at each row (k,)."""
    e = errors(made, history)
    return np.asarray(np.einsum("ki,kij,kj->k", e, np.linalg.inv(history.covariance), e) / 15.0)
