"""Errors of the odometer, the wheels, the arms, GNSS and the thermometers."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_trials import processes
from benchmarks.gap_trials.effect import Effects, Parameters, log_uniform, signed
from benchmarks.gap_trials.seen import Seen, Streams, moved, shifted_fixes
from ins.records import InputError, OdometerLog
from ins.units import DEG

ODOMETER, VEHICLE, GNSS = ("odometer",), ("vehicle",), ("gnss",)
SLIP_RELAXATION_S = 0.3  # a tyre takes its slip angle over a length of about 3 m


EFFECTS = Effects()


def _boresight(rng: np.random.Generator, _: tuple[Seen, ...]) -> Parameters:
    return {"yaw_deg": signed(rng, 0.4), "pitch_deg": signed(rng, 0.13)}


def _arm(rng: np.random.Generator, _: tuple[Seen, ...]) -> Parameters:
    return {
        "arm_m": [
            signed(rng, float(rng.uniform(0.5, 2.0))),
            signed(rng, float(rng.uniform(0.0, 0.8))),
            0.0,
        ]
    }


def _gnss(rng: np.random.Generator, seen: tuple[Seen, ...]) -> Parameters:
    if rng.random() < 0.5:
        return {"kind": "arm", **_arm(rng, seen)}
    return {"kind": "latency", "late_s": log_uniform(rng, 0.03, 0.2)}


def _thermometer(rng: np.random.Generator, _: tuple[Seen, ...]) -> Parameters:
    if rng.random() < 0.7:
        return {
            "kind": "late",
            "tau_s": log_uniform(rng, 60, 600),
            "offset_degC": float(rng.normal(0.0, 0.5)),
        }
    return {"kind": "steps", "lsb_degC": float(rng.uniform(0.5, 2.0))}


WHEELS, FIXES = frozenset({"taxi", "odometer"}), frozenset({"taxi", "gnss"})


@EFFECTS.plants(
    "odometer_scale", ODOMETER, lambda rng, _: {"scale": signed(rng, 0.004)}, needs=WHEELS
)
def odometer_scale(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """The radius is off; it grows with speed squared (5 % of the error at 10 m/s) and as the tyres
    warm (5 %).
    """
    log, rows = _odometer(streams, seen)
    warming = 1 - np.exp(-np.maximum(log.time_s - seen.taxi_s, 0.0) / 300.0)
    radius = size * p["scale"] * (1 + 0.05 * (seen.speed_m_s[rows] / 10.0) ** 2 + 0.05 * warming)
    return _more_speed(streams, log, radius * seen.speed_m_s[rows])


@EFFECTS.plants(
    "odometer_time_offset",
    ODOMETER,
    lambda rng, _: {"late_s": signed(rng, 0.06)},
    needs=WHEELS,
    linear=False,
)
def odometer_time_offset(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """The speed is that of a time before (or, negative, after) its stamp."""
    log, _ = _odometer(streams, seen)
    then = np.interp(log.time_s - size * p["late_s"], seen.time_s, seen.speed_m_s)
    return _more_speed(streams, log, then - np.interp(log.time_s, seen.time_s, seen.speed_m_s))


@EFFECTS.plants(
    "odometer_quantization",
    ODOMETER,
    lambda rng, _: {"pulse_m": float(rng.uniform(0.01, 0.05))},
    needs=WHEELS,
    linear=False,
)
def odometer_quantization(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """Whole pulses of the wheel are counted over each interval."""
    log, _ = _odometer(streams, seen)
    if not size > 0:
        return streams
    dt = float(np.median(np.diff(log.time_s)))
    counted = processes.rounded_sum(log.speed_m_s * dt, size * p["pulse_m"]) / dt
    return replace(streams, odometer=replace(log, speed_m_s=counted))


@EFFECTS.plants("wheel_slip", ODOMETER, lambda rng, _: {"slip_s2_m": 0.015}, needs=WHEELS)
def wheel_slip(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The wheel turns slower under braking, faster under thrust (a fifth less), in proportion to
    the force.
    """
    log, rows = _odometer(streams, seen)
    pull = seen.acceleration_m_s2[rows]
    slip = size * p["slip_s2_m"] * np.where(pull > 0, 0.8, 1.0) * pull
    return _more_speed(streams, log, slip * seen.speed_m_s[rows])


@EFFECTS.plants("odometer_boresight", VEHICLE, _boresight, needs=WHEELS, confounded=("side_slip",))
def odometer_boresight(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """The unit sits askew: the vehicle rolls off its x axis, to the side (yaw) and, a third as
    much, up or down.
    """
    dv_b = np.outer(
        seen.speed_m_s, size * np.array([0.0, p["yaw_deg"] * DEG, p["pitch_deg"] * DEG])
    )
    return moved(streams, seen, _turned(seen, dv_b))


@EFFECTS.plants("lever_arm", VEHICLE, _arm, needs=WHEELS)
def lever_arm(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The point that does not slip lies at arm_m from the IMU, not at it: the IMU swings round it
    by -w x arm.
    """
    return moved(
        streams, seen, _turned(seen, -np.cross(seen.omega_at_ends, size * np.array(p["arm_m"])))
    )


@EFFECTS.plants(
    "side_slip",
    VEHICLE,
    lambda rng, _: {"deg_s2_m": 0.4, "wind_rad": float(rng.uniform(0, 2 * np.pi))},
    needs=WHEELS,
)
def side_slip(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """Slip angle in proportion to the lateral force, after the tyre's relaxation, with a sixth of
    it by a cross wind.

    Turning right, tyres let the vehicle drift left: lateral velocity -V c a_lat.
    """
    lateral = processes.lagged(
        seen.speed_m_s * seen.omega_at_ends[:, 2], tau_s=SLIP_RELAXATION_S, dt_s=seen.dt_s
    )
    wind = np.sin(p["wind_rad"] - seen.heading_rad) / 6.0
    slip = size * p["deg_s2_m"] * DEG * (lateral + wind)
    return moved(streams, seen, _turned(seen, np.outer(-seen.speed_m_s * slip, [0.0, 1.0, 0.0])))


@EFFECTS.plants("gnss_lever_arm_or_latency", GNSS, _gnss, needs=FIXES, linear=False)
def gnss_arm_or_latency(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """The antenna sits elsewhere than entered, or the fix is older than its stamp."""
    if streams.gnss is None:
        raise InputError("gnss_lever_arm_or_latency: the run has no gnss")
    if p["kind"] == "arm":
        arm = size * np.array(p["arm_m"])
        path = np.einsum("nij,j->ni", seen.C_nb, arm)
        swing = _turned(seen, np.cross(seen.omega_at_ends, arm))
        return replace(streams, gnss=shifted_fixes(streams, seen, path, swing))
    late = size * p["late_s"]
    v = seen.v_n_m_s
    before = np.stack(
        [np.interp(seen.time_s - late, seen.time_s, v[:, k]) for k in range(3)], axis=-1
    )
    path = -late * 0.5 * (v + before)
    return replace(streams, gnss=shifted_fixes(streams, seen, path, before - v))


@EFFECTS.plants(
    "temperature_sensor_error",
    ("temperature",),
    _thermometer,
    linear=False,
    confounded=("gyro_thermal_lag", "gyro_thermal_rate"),
    accepted=("gyro_x", "gyro_y", "gyro_z"),
)
def thermometer(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The logged gyro temperatures are late and off, or in coarse steps; what the gyros feel
    stays.
    """
    log = streams.temperature
    dt = float(np.median(np.diff(log.time_s)))
    if p["kind"] == "late":
        # the noise is not late
        true = np.stack([np.interp(log.time_s, seen.time_s, T) for T in seen.gyro_degC.T], axis=-1)
        late = np.stack([processes.lagged(T, tau_s=p["tau_s"], dt_s=dt) for T in true.T], axis=-1)
        read = log.gyro_degC + size * (late - true) + size * p["offset_degC"]
    else:
        read = (
            p["lsb_degC"] * size * np.round(log.gyro_degC / (p["lsb_degC"] * size))
            if size > 0
            else log.gyro_degC
        )
    return replace(streams, temperature=replace(log, gyro_degC=read))


def _turned(seen: Seen, vector_b: NDArray) -> NDArray:
    return np.einsum("nij,nj->ni", seen.C_nb, vector_b)


def _odometer(streams: Streams, seen: Seen) -> tuple[OdometerLog, NDArray]:
    if streams.odometer is None:
        raise InputError("an effect on the odometer: the run has none")
    return streams.odometer, seen.nearest(streams.odometer.time_s)


def _more_speed(streams: Streams, log: OdometerLog, speed_m_s: NDArray) -> Streams:
    return replace(streams, odometer=replace(log, speed_m_s=log.speed_m_s + speed_m_s))
