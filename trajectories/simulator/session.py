"""One simulated session: ideal sensors + vehicle + temperatures + the unit's true bias + noise -> a
run and its truth.

Everything stays in memory; `trajectories.runs.directory.write_run` puts it on disk. The same rng
state gives the same run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ins.attitude import euler_from_dcm
from ins.earth import dcm_en, ecef_from_geodetic, geodetic_from_ecef
from ins.records import (
    GnssLog,
    ImuLog,
    InputError,
    OdometerLog,
    ReferenceLog,
    Run,
    RunHeader,
    Survey,
    TemperatureLog,
    TwinModel,
)
from ins.units import HOUR
from trajectories.runs.directory import run_sha256
from trajectories.simulator import imperfections
from trajectories.simulator.chamber import ChamberProfile
from trajectories.simulator.environments.kinds import Environment
from trajectories.simulator.environments.laying import lay_environments
from trajectories.simulator.sensors import IdealSensors
from trajectories.simulator.thermal import ThermalHistory
from trajectories.simulator.truth import rate_from_euler
from trajectories.simulator.unit_truth import UnitTruth
from trajectories.simulator.vehicle import Disturbed, Event, disturb

# Rates of the streams of a simulated run, those of ordinary loggers.
REFERENCE_HZ = 10.0
TEMPERATURE_HZ = 1.0
GNSS_HZ = 1.0
ODOMETER_HZ = 10.0


@dataclass(frozen=True, kw_only=True, repr=False)
class SimulatedRun:
    """A run, and what only the simulator knows.

    gyro_bias_true_deg_h, accel_bias_true_ug (n, 3): total bias (thermal, turn-on, flicker, random
    walk) at bias_time_s (n,), 1 Hz; temperature_true_degC (n, 3): of the gyros; the temperature
    stream has the same times.
    """

    run: Run
    reference: ReferenceLog
    bias_time_s: NDArray
    gyro_bias_true_deg_h: NDArray
    accel_bias_true_ug: NDArray
    temperature_true_degC: NDArray

    def __repr__(self) -> str:
        truth = (
            f"  truth: {self.reference!r}; bias and temperature at {self.bias_time_s.size} times"
        )
        return f"Simulated {self.run!r}\n{truth}"


@dataclass(frozen=True, kw_only=True)
class SessionPlan:
    """What a session records beside the imu, what happens to the vehicle, and what run.json says.

    events, environments: what moves the parked vehicle; gnss_lever_arm_m: from the IMU to the
    antenna, body axes.
    """

    with_gnss: bool = False
    with_odometer: bool = False
    with_phases: bool = True
    events: Sequence[Event] = ()
    environments: Sequence[Environment] = ()
    gnss_lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    run_id: str = "simulated"
    tail: str = "SIM"
    start_utc: str = "2026-03-01T05:00:00Z"
    survey: Survey | None = None


def simulate_run(
    ideal: IdealSensors,
    thermal: ThermalHistory | ChamberProfile,
    unit: UnitTruth,
    twin: TwinModel,
    *,
    rng: np.random.Generator,
    plan: SessionPlan | None = None,
) -> SimulatedRun:
    """One power-on session of a unit in a vehicle, over an ideal run made once for many seeds.

    Raises InputError where the twin lists effects (they are injected by `simreal`).
    """
    if twin.effects:
        raise InputError(
            f"twin: effect {twin.effects[0].get('effect')!r} is not among what simulate_run can"
            " make"
        )
    plan = plan or SessionPlan()
    if plan.environments:  # from a stream of their own: all else is the same with and without
        ideal = lay_environments(ideal, plan.environments, rng.spawn(1)[0])
    moved = disturb(ideal, twin.vehicle, plan.events, rng)
    slow_s, gyro_bias, accel_bias = _biases(ideal, thermal, unit, twin, rng)
    temperature, temperature_true = _temperatures(ideal, thermal, twin, rng)
    header = RunHeader(
        run_id=plan.run_id,
        tail=plan.tail,
        imu_serial=unit.imu_serial,
        gyro_technology=unit.gyro_technology,
        start_utc=plan.start_utc,
        site=ideal.truth.site,
        wheel_reference_m=ideal.truth.wheel_reference_m,
        gnss_lever_arm_m=plan.gnss_lever_arm_m,
        survey=plan.survey or Survey(),
    )
    run = Run(
        header=header,
        imu=_imu(ideal, moved, slow_s, gyro_bias, accel_bias, twin, rng),
        temperature=temperature,
        gnss=_gnss(ideal, moved, plan.gnss_lever_arm_m, twin, rng) if plan.with_gnss else None,
        odometer=_odometer(ideal, twin, rng) if plan.with_odometer else None,
        phases=ideal.truth.motion.phases if plan.with_phases else (),
    )
    second = slice(
        0, len(temperature_true) * int(imperfections.SLOW_RATE_HZ), int(imperfections.SLOW_RATE_HZ)
    )
    return SimulatedRun(
        run=replace(run, sha256=run_sha256(run)),
        reference=reference_of(ideal, moved),
        bias_time_s=slow_s[second],
        gyro_bias_true_deg_h=gyro_bias[second],
        accel_bias_true_ug=accel_bias[second],
        temperature_true_degC=temperature_true,
    )


def _biases(
    ideal: IdealSensors,
    thermal: ThermalHistory | ChamberProfile,
    unit: UnitTruth,
    twin: TwinModel,
    rng: np.random.Generator,
) -> tuple[NDArray, NDArray, NDArray]:
    """Times (m,), gyro bias [deg/h] and accelerometer bias [micro-g] (m, 3) from power-on to the
    end of the run.
    """
    rate_hz = imperfections.SLOW_RATE_HZ
    m = int(np.ceil(ideal.time_s[-1] * rate_hz - 1e-6)) + 1
    slow_s = np.arange(m) / rate_hz
    felt = thermal.at(slow_s)
    gyro = unit.bias_history_deg_h(felt.gyro_degC, 1 / rate_hz, felt.gradient_degC)
    gyro += imperfections.gyro_session_bias(rng, twin.gyro, m, rate_hz=rate_hz)
    return slow_s, gyro, imperfections.accel_session_bias(rng, twin.accel, m, rate_hz=rate_hz)


def _imu(
    ideal: IdealSensors,
    moved: Disturbed,
    slow_s: NDArray,
    gyro_bias: NDArray,
    accel_bias: NDArray,
    twin: TwinModel,
    rng: np.random.Generator,
) -> ImuLog:
    dt = ideal.dt_s
    middle_s = ideal.time_s - 0.5 * dt
    gyro = np.stack([np.interp(middle_s, slow_s, bias) for bias in gyro_bias.T], axis=-1)
    accel = np.stack([np.interp(middle_s, slow_s, bias) for bias in accel_bias.T], axis=-1)
    gyro_B, accel_B = twin.gyro.bias_instability_deg_h, twin.accel.bias_instability_ug
    # from a stream of its own: all else is the same with and without
    if imperfections.is_quick(gyro_B, twin.gyro.arw_deg_sqrt_h * HOUR**0.5):
        gyro += _quick(ideal, gyro_B, rng.spawn(1)[0])
    if imperfections.is_quick(accel_B, twin.accel.vrw_ug_sqrt_hz):
        accel += _quick(ideal, accel_B, rng.spawn(1)[0])
    return ImuLog(
        time_s=ideal.time_s,
        dt_s=np.full(ideal.time_s.size, dt),
        dtheta_rad=imperfections.gyro_output(rng, moved.dtheta_rad, gyro, twin.gyro, dt_s=dt),
        dv_m_s=imperfections.accel_output(rng, moved.dv_m_s, accel, twin.accel, dt_s=dt),
    )


def _quick(ideal: IdealSensors, instability: float, rng: np.random.Generator) -> NDArray:
    """Flicker of three axes (n, 3) beyond the slow rate."""
    n = ideal.time_s.size
    axes = [
        imperfections.quick_flicker(rng, n, instability=instability, rate_hz=ideal.rate_hz)
        for _ in range(3)
    ]
    return np.stack(axes, axis=-1)


def _temperatures(
    ideal: IdealSensors,
    thermal: ThermalHistory | ChamberProfile,
    twin: TwinModel,
    rng: np.random.Generator,
) -> tuple[TemperatureLog, NDArray]:
    time_s = np.arange(np.floor(ideal.time_s[-1] * TEMPERATURE_HZ) + 1) / TEMPERATURE_HZ
    true = thermal.at(time_s)
    read = {
        f.name: imperfections.thermometer(rng, getattr(true, f.name), twin.temperature)
        for f in fields(true)
    }
    log = TemperatureLog(
        time_s=time_s,
        gyro_degC=read["gyro_degC"],
        accel_degC=read["accel_degC"],
        gradient_degC=read["gradient_degC"],
        block_degC=read["block_degC"],
        ambient_degC=read["ambient_degC"],
    )
    return log, true.gyro_degC


def _every(ideal: IdealSensors, rate_hz: float) -> NDArray:
    """Rows of the IMU samples nearest to multiples of 1 / rate_hz, so that truth is at hand without
    interpolation.
    """
    rows = (
        np.round(
            np.arange(1, int(ideal.time_s[-1] * rate_hz + 1e-6) + 1) / rate_hz * ideal.rate_hz
        ).astype(int)
        - 1
    )
    return np.unique(np.clip(rows, 0, ideal.time_s.size - 1))


def _gnss(
    ideal: IdealSensors,
    moved: Disturbed,
    lever_b_m: tuple[float, float, float],
    twin: TwinModel,
    rng: np.random.Generator,
) -> GnssLog:
    """Fixes of the antenna: r_imu + C_eb lever, v_imu + C_nb (omega_nb_b x lever)."""
    rows = _every(ideal, GNSS_HZ)
    lever = np.asarray(lever_b_m, dtype=float)
    lat, lon = moved.lat_rad[rows], moved.lon_rad[rows]
    arm_e = np.einsum("nij,njk,k->ni", dcm_en(lat, lon), moved.C_nb[rows], lever)
    antenna = geodetic_from_ecef(ecef_from_geodetic(lat, lon, ideal.height_m[rows]) + arm_e)
    point = ideal.truth.kinematics(ideal.time_s[rows])
    spin_b = rate_from_euler(point.euler_rad, point.euler_rate_rad_s)
    if ideal.swing_rad_s is not None:
        spin_b = spin_b + ideal.swing_rad_s[rows]
    v_n = moved.v_n_m_s[rows] + np.einsum("nij,nj->ni", moved.C_nb[rows], np.cross(spin_b, lever))
    true = GnssLog(
        time_s=ideal.time_s[rows],
        lat_rad=antenna[0],
        lon_rad=antenna[1],
        height_m=antenna[2],
        v_n_m_s=v_n,
    )
    return imperfections.gnss_output(rng, true, twin.gnss)


def _odometer(ideal: IdealSensors, twin: TwinModel, rng: np.random.Generator) -> OdometerLog:
    """Speed of the wheel reference point along body x, which is pitched on its wheels; in the air
    the wheels stand.
    """
    rows = _every(ideal, ODOMETER_HZ)
    along_x = ideal.speed_m_s * np.cos(ideal.euler_rad[:, 1]) * ideal.on_wheels
    true = OdometerLog(time_s=ideal.time_s[rows], speed_m_s=along_x[rows])
    return imperfections.odometer_output(rng, true, twin.odometer)


def reference_of(ideal: IdealSensors, moved: Disturbed) -> ReferenceLog:
    """The truth, disturbances included, at up to 10 Hz."""
    rows = _every(ideal, min(REFERENCE_HZ, ideal.rate_hz))
    roll, pitch, heading = euler_from_dcm(moved.C_nb[rows])
    return ReferenceLog(
        time_s=ideal.time_s[rows],
        lat_rad=moved.lat_rad[rows],
        lon_rad=moved.lon_rad[rows],
        height_m=ideal.height_m[rows],
        v_n_m_s=moved.v_n_m_s[rows],
        roll_rad=roll,
        pitch_rad=pitch,
        heading_rad=heading,
    )
