"""A simulated session with effects: its telemetry from the truth, and the truth (reference, biases)
that follows them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import ThermalTable
from ins.attitude import (
    dcm_from_euler,
    dcm_from_rotation_vector,
    euler_from_dcm,
    rotation_vector_from_dcm,
    wrap_pi,
)
from ins.earth import gravity_magnitude, gravity_n, omega_en_n, omega_ie_n
from ins.errors.base import ACCELS, GYROS
from ins.errors.platform import ROTATIONS
from ins.errors.telemetry import AIRBORNE, PARKED, ROLLING, Telemetry, Trace, total
from ins.records import AIRBORNE_PHASES, Phase, ReferenceLog, VehicleNoise
from ins.strapdown.increments import rows_before
from ins.units import DEG_PER_HOUR, MICRO_G
from simreal.declared.twin_effects import TwinEffect, twin_traces
from simreal.twin.added_noise import at, swayed
from simreal.twin.inject import Injected, in_body, injected, moved_by
from trajectories.simulator.chamber import ChamberProfile
from trajectories.simulator.session import SimulatedRun
from trajectories.simulator.thermal import ThermalHistory

MOVES_M_S = 0.05  # sway stays below: 2.5 sigmas of the 0.02 m/s of R1
# above where it was parked; chosen: gear and sway move it by centimetres, 0.1 m at most
FLIES_ABOVE_M = 1.0
PICARD = 12  # passes; error (Earth rate x run length)^12 / 12!
OF_MOTION = (  # errors that are no bias: they go with rate or force
    "gyro_scale_factor",
    "gyro_scale_asymmetry",
    "gyro_scale_thermal",
    "gyro_misalignment",
    "gyro_lock_in",
    "accel_scale_factor",
    "accel_misalignment",
    "imu_size_effect",
    "axis_or_unit_error",
)


def telemetry_of_simulated(
    simulated: SimulatedRun,
    thermal: ThermalHistory | ChamberProfile,
    table: ThermalTable | None,
    *,
    run_index: int = 0,
) -> Telemetry:
    """The telemetry of a simulated session, from its reference stream (an interval is one of its
    steps).

    thermal: that the session was made with. table: the twin's; None: effects of the compensation
    have nothing to go by.
    """
    truth, site = simulated.reference, simulated.run.header.site
    dt = np.diff(truth.time_s, prepend=truth.time_s[0] - (truth.time_s[1] - truth.time_s[0]))
    t = truth.time_s - 0.5 * dt
    C_end, v_end = dcm_from_euler(truth.roll_rad, truth.pitch_rad, truth.heading_rad), truth.v_n_m_s
    turn_b = rotation_vector_from_dcm(np.swapaxes(rows_before(C_end), 1, 2) @ C_end) / dt[:, None]
    C_nb = rows_before(C_end) @ dcm_from_rotation_vector(0.5 * dt[:, None] * turn_b)
    v_n = 0.5 * (v_end + rows_before(v_end))
    ie_n, en_n = omega_ie_n(truth.lat_rad), omega_en_n(truth.lat_rad, truth.height_m, v_n)
    change_n = (v_end - rows_before(v_end)) / dt[:, None] + np.cross(2 * ie_n + en_n, v_n)
    kind = _kinds(simulated.run.phases, truth, v_n)
    v_n = np.where((kind == PARKED)[:, None], 0.0, v_n)
    heading_change = wrap_pi(truth.heading_rad - rows_before(truth.heading_rad)) / dt
    return Telemetry(
        run_index=run_index,
        time_s=t,
        dt_s=float(np.median(dt)),
        rate_rad_s=turn_b + in_body(C_nb, ie_n + en_n),
        force_m_s2=in_body(C_nb, change_n - gravity_n(truth.lat_rad, truth.height_m)),
        C_nb=C_nb,
        v_n_m_s=v_n,
        speed_m_s=np.einsum("ni,ni->n", C_nb[:, :, 0], v_n),
        turn_rad_s=np.where(kind == PARKED, 0.0, heading_change),
        kind=kind,
        lat_rad=site.lat_rad,
        height_m=site.height_m,
        has_gnss=simulated.run.gnss is not None,
        has_odometer=simulated.run.odometer is not None,
        # the true motion is smooth within a second
        vibration_m2_s4=np.zeros((t.size, 3)),
        swing_rad2_s2=np.zeros((t.size, 3)),
        at_range=np.zeros((t.size, 6)),  # and within every range
        above_m=truth.height_m - site.height_m,
        **_thermal(thermal, table, t),
    )


def inject_simulated(
    simulated: SimulatedRun,
    telemetry: Telemetry,
    effects: Sequence[TwinEffect],
    rng: np.random.Generator,
    *,
    vehicle: VehicleNoise | None = None,
) -> SimulatedRun:
    """A simulated session with effects added; rotations and ways of the vehicle are in the
    reference, drifts in the biases.
    """
    result = injected(simulated.run, telemetry, effects, rng, vehicle=vehicle)
    run_id, draws = simulated.run.header.run_id, result.draws
    biases = [
        e
        for e in effects
        if e.effect.name not in OF_MOTION
        and (e.target in (*GYROS, *ACCELS, "temperature") or e.effect.name == "engine_start")
    ]
    drift, t = twin_traces(biases, telemetry, run_id), simulated.bias_time_s
    gyro, accel = (
        at(t, draws.slow_s, slow) for slow in (draws.slow_gyro_rad_s, draws.slow_accel_m_s2)
    )
    if drift.gyro_rad_s is not None:
        gyro += at(t, telemetry.time_s, drift.gyro_rad_s)
    if drift.accel_m_s2 is not None:
        accel += at(t, telemetry.time_s, drift.accel_m_s2)
    return replace(
        simulated,
        run=result.run,
        reference=_reference(simulated.reference, telemetry, effects, result),
        gyro_bias_true_deg_h=simulated.gyro_bias_true_deg_h + gyro / DEG_PER_HOUR,
        accel_bias_true_ug=simulated.accel_bias_true_ug + accel / MICRO_G,
    )


def rotation(telemetry: Telemetry, effects: Sequence[TwinEffect], C_nb: NDArray) -> NDArray:
    """Small rotation (n, 3) of the body, body axes, by effects that turn it (ROTATIONS), at
    the intervals' ends [rad].

    C_nb (n, 3, 3): attitude there, without the effects.

    A rotation about body z that takes the way along with it (it has a GNSS part) is the sum of its
    own gyro's trace; others are solved for together.
    """
    moves = [e for e in effects if e.effect.name in ROTATIONS and not e.is_noise]
    units = [
        unit.scaled(c)
        for e in moves
        for unit, c in zip(e.effect.traces(telemetry, e.target, e.shape), e.coefficients)
    ]
    about_z = total(unit for unit in units if unit.gnss_velocity_m_s is not None)
    turned = in_body(
        C_nb, _tilted_n(telemetry, total(unit for unit in units if unit.gnss_velocity_m_s is None))
    )
    if about_z.gyro_rad_s is not None:
        turned[:, 2] += np.cumsum(about_z.gyro_rad_s[:, 2]) * telemetry.dt_s
    return turned


def _tilted_n(telemetry: Telemetry, trace: Trace) -> NDArray:
    """Rotation (n, 3), NED, that a trace stands for.

    Gyros feel q' - q x w: in navigation axes q_n' = C_nb gyro - w_ie x q_n, solved by repeated
    integration. Where it begins other than at 0 (a sag that depends on temperature) the level
    accelerometers show it, at first -q x f.
    """
    if trace.gyro_rad_s is None:
        return np.zeros((telemetry.n, 3))
    start = np.zeros(3)
    if trace.accel_m_s2 is not None and telemetry.kind[0] == PARKED:
        g = float(gravity_magnitude(telemetry.lat_rad, telemetry.height_m))
        level = telemetry.C_nb[0].T @ [0.0, 0.0, -g]
        start[:2] = trace.accel_m_s2[0, 1] / level[2], -trace.accel_m_s2[0, 0] / level[2]
    felt = np.einsum("nij,nj->ni", telemetry.C_nb, trace.gyro_rad_s) * telemetry.dt_s
    felt[0] *= 0.5  # from the middle of the first interval on
    start_n, earth = telemetry.C_nb[0] @ start, omega_ie_n(telemetry.lat_rad) * telemetry.dt_s
    q_n = start_n + np.cumsum(felt, axis=0)
    for _ in range(PICARD):
        mean = 0.5 * (q_n + np.concatenate([start_n[None], q_n[:-1]]))
        q_n = start_n + np.cumsum(felt - np.cross(earth, mean), axis=0)
    return q_n


def _reference(
    truth: ReferenceLog, telemetry: Telemetry, effects: Sequence[TwinEffect], result: Injected
) -> ReferenceLog:
    run_id = result.run.header.run_id
    C_nb = dcm_from_euler(truth.roll_rad, truth.pitch_rad, truth.heading_rad)
    turned = rotation(telemetry, [e for e in effects if e.in_run(run_id)], C_nb)
    if result.draws.tilt_rad.any():
        turned[:, :2] += at(truth.time_s, result.draws.time_s, result.draws.tilt_rad)
    roll, pitch, heading = euler_from_dcm(C_nb @ dcm_from_rotation_vector(turned))
    real = twin_traces([e for e in effects if e.target != "gnss"], telemetry, run_id)
    way, velocity = result.side.way_n_m.copy(), result.side.v_n_m_s.copy()
    if real.gnss_position_m is not None:
        way += real.gnss_position_m
    if real.gnss_velocity_m_s is not None:
        velocity += real.gnss_velocity_m_s
    way, velocity = (
        at(truth.time_s, telemetry.time_s, way),
        at(truth.time_s, telemetry.time_s, velocity),
    )
    sway_way, sway = swayed(result.draws, truth.time_s)
    way, velocity = way + sway_way, velocity + sway
    lat, lon, height = moved_by(truth.lat_rad, truth.lon_rad, truth.height_m, way)
    return ReferenceLog(
        time_s=truth.time_s,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        v_n_m_s=truth.v_n_m_s + velocity,
        roll_rad=roll,
        pitch_rad=pitch,
        heading_rad=heading,
    )


def _kinds(phases: Sequence[Phase], truth: ReferenceLog, v_n: NDArray) -> NDArray:
    """PARKED, ROLLING or AIRBORNE of each step, by the truth and, in the air, the phases where
    there are any.
    """
    high = np.abs(truth.height_m - truth.height_m[0]) > FLIES_ABOVE_M
    if phases:
        spans = [
            (truth.time_s > p.start_s) & (truth.time_s <= p.end_s)
            for p in phases
            if p.phase in AIRBORNE_PHASES
        ]
        high &= np.any(spans, axis=0) if spans else False
    moving = np.hypot(v_n[:, 0], v_n[:, 1]) > MOVES_M_S
    return np.select([high, moving], [AIRBORNE, ROLLING], PARKED)


def _thermal(
    thermal: ThermalHistory | ChamberProfile, table: ThermalTable | None, t: NDArray
) -> dict[str, Any]:
    true = thermal.at(t)
    rate = 60.0 * (thermal.at(t + 0.5).gyro_degC - thermal.at(t - 0.5).gyro_degC)
    out = {**vars(true), "temperature_degC": true.gyro_degC, "temperature_rate_degC_min": rate}
    del out["gyro_degC"]
    if table is not None:
        out["table_deg_h"] = table.settled_deg_h(true.gyro_degC)
    return out
