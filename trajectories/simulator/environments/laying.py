"""Lays environments over an ideal run: truth and both sensors from one motion.

The body turns by the rotation vector q(t) and is displaced by d(t), both in the axes of the
undisturbed body, functions with a derivative at every node of the scene. Then::

    C_nb' = C_nb exp(q)            omega' = exp(-q) (omega + rho) + J(q) q_dot
    r'    = r + C_nb d             f'     = exp(-q) (f + C_bn (dv_n/dt + 2 omega_ie x dv_n))

with dv_n the derivative of C_nb d, and rho the turn of the local level with the displacement. What
the sensors put out over a row is summed over its nodes; the parts that are differences of q and of
dv_n are exact.

Decision: docs/decisions/0058-environments-over-ideal-run.md.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from ins.attitude import dcm_from_rotation_vector, euler_from_dcm, wrap_pi
from ins.earth import omega_ie_n, radii_of_curvature
from trajectories.simulator.environments.cargo import loading, refuelling
from trajectories.simulator.environments.gear import AIRLINER, Forcing, Vibration
from trajectories.simulator.environments.kinds import Environment, EnvironmentKind
from trajectories.simulator.environments.machines import engines, gpu
from trajectories.simulator.environments.people import boarding, maintenance
from trajectories.simulator.environments.scene import Scene, scene_of
from trajectories.simulator.environments.ship import ship
from trajectories.simulator.environments.wind import calm, gusty
from trajectories.simulator.sensors import IdealSensors
from trajectories.simulator.vehicle import turn, turn_back

GRAVITY_GRADIENT = 3.086e-6  # of gravity with depth [1/s^2], free air
IMU_ABOVE_M = 2.0  # of the IMU above the ground where the lever arm to the wheels says less
CATALOGUE: dict[EnvironmentKind, Callable[[Scene, np.random.Generator], Forcing]] = {
    EnvironmentKind.CALM: calm,
    EnvironmentKind.GUSTY: gusty,
    EnvironmentKind.BOARDING: boarding,
    EnvironmentKind.REFUELLING: refuelling,
    EnvironmentKind.LOADING: loading,
    EnvironmentKind.ENGINES: engines,
    EnvironmentKind.GPU: gpu,
    EnvironmentKind.MAINTENANCE: maintenance,
    EnvironmentKind.SHIP: ship,
}


@dataclass(frozen=True, kw_only=True)
class Moves:
    """Motion at the nodes of a scene within the run, (nodes, 3) each, undisturbed body axes.

    q_rad, q_dot: rotation vector and its derivative; d_m, d_dot: displacement of the IMU.
    """

    scene: Scene
    q_rad: NDArray
    q_dot: NDArray
    d_m: NDArray
    d_dot: NDArray
    lines: tuple[tuple[float, Vibration], ...]


def lay_environments(
    ideal: IdealSensors, environments: Sequence[Environment], rng: np.random.Generator
) -> IdealSensors:
    """The ideal run (a whole one) with environments over it."""
    return lay_moves(ideal, draw_moves(ideal, environments, rng))


def draw_moves(
    ideal: IdealSensors, environments: Sequence[Environment], rng: np.random.Generator
) -> Moves:
    """One draw of the environments over an ideal run."""
    scene = scene_of(ideal)
    spectrum = np.zeros((scene.frequency_hz.size, 6), dtype=complex)
    response = AIRLINER.response(scene.frequency_hz)
    lines: list[tuple[float, Vibration]] = []
    for environment in environments:
        forcing = CATALOGUE[EnvironmentKind(environment.kind)](scene, rng)
        motion = rfft(forcing.loads, axis=0) * response + rfft(forcing.motions, axis=0)
        spectrum += environment.strength * motion
        lines += [(environment.strength, line) for line in forcing.lines]
    rate = 2j * np.pi * scene.frequency_hz[:, None] * spectrum
    count = scene.time_s.size
    value, change = (irfft(s, count, axis=0)[: scene.nodes] for s in (spectrum, rate))
    q, q_dot = value[:, 3:], change[:, 3:]
    arm = _arm(ideal)
    turned = dcm_from_rotation_vector(q)
    d = value[:, :3] + np.einsum("nij,j->ni", turned - np.eye(3), arm)
    swung = np.cross(_spin(q, q_dot), arm)
    d_dot = change[:, :3] + np.einsum("nij,nj->ni", turned, swung)
    return Moves(scene=scene, q_rad=q, q_dot=q_dot, d_m=d, d_dot=d_dot, lines=tuple(lines))


def lay_moves(ideal: IdealSensors, moves: Moves) -> IdealSensors:
    """The ideal run with these motions over it."""
    steps = moves.scene.steps
    shaken = _shaken(ideal, moves)
    # at the run's start, then at the end of each row
    C_nb = np.concatenate([ideal.C_nb[:1], ideal.C_nb])
    q, d = moves.q_rad[::steps], moves.d_m[::steps]
    d_n = turn(C_nb, d)
    dv_n = turn(C_nb, moves.d_dot[::steps] + shaken.velocity_m_s + np.cross(_turning(ideal), d))
    dlat, dlon = _shift(ideal, d_n)
    middle = 0.5 * (C_nb[1:] + C_nb[:-1])
    coriolis_n = np.cross(2 * omega_ie_n(ideal.lat_rad), np.diff(d_n, axis=0))
    gained_n = np.diff(dv_n, axis=0) + coriolis_n
    gained_n[:, 2] -= GRAVITY_GRADIENT * 0.5 * (d_n[1:, 2] + d_n[:-1, 2]) * ideal.dt_s
    gained = turn_back(middle, gained_n)
    level = turn_back(middle, np.diff(_level_turn(ideal, dlat, dlon), axis=0))
    dtheta, dv = _felt(moves, ideal.dtheta_rad + level, ideal.dv_m_s + gained)
    turned = ideal.C_nb @ dcm_from_rotation_vector(q[1:] + shaken.angle_rad[1:])
    euler = np.stack(euler_from_dcm(turned), axis=-1)
    return replace(
        ideal,
        dtheta_rad=dtheta + np.diff(shaken.angle_rad, axis=0),
        dv_m_s=dv - np.cross(shaken.mean_angle_rad, ideal.dv_m_s),
        lat_rad=ideal.lat_rad + dlat[1:],
        lon_rad=ideal.lon_rad + dlon[1:],
        height_m=ideal.height_m - d_n[1:, 2],
        v_n_m_s=ideal.v_n_m_s + dv_n[1:],
        euler_rad=ideal.euler_rad + wrap_pi(euler - ideal.euler_rad),
        C_nb=turned,
        swing_rad_s=_spin(q, moves.q_dot[::steps])[1:],
    )


def _felt(moves: Moves, dtheta: NDArray, dv: NDArray) -> tuple[NDArray, NDArray]:
    """Increments (n, 3) as the turned body has them, from those of the undisturbed axes.

    Simpson's rule over the nodes of a row (the trapezoid where there are none between its ends).
    """
    scene = moves.scene
    seen, force = np.zeros_like(dtheta), np.zeros_like(dv)
    curved = np.zeros_like(dtheta)
    for node, weight in enumerate(_weights(scene.steps)):
        rows = slice(node, node + (scene.rows - 1) * scene.steps + 1, scene.steps)
        q, q_dot = moves.q_rad[rows], moves.q_dot[rows]
        turn, turn_twice, _ = _series(q)
        seen += weight * _turned(dtheta, q, turn, turn_twice)
        force += weight * _turned(dv, q, turn, turn_twice)
        curved += weight * (_spin(q, q_dot) - q_dot)
    row_s = scene.steps * scene.dt_s
    linear = np.diff(moves.q_rad[:: scene.steps], axis=0)
    return seen + linear + row_s * curved, force


def _weights(steps: int) -> NDArray:
    """Of the nodes of a row, their sum 1."""
    if steps == 1:
        return np.array([0.5, 0.5])
    weights = np.ones(steps + 1)
    weights[1:-1:2] = 4.0
    weights[2:-1:2] = 2.0
    return weights / (3.0 * steps)


def _series(q: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3 of rotation vectors, (n, 1) each."""
    square = np.sum(q**2, axis=-1, keepdims=True)
    first = 1 - square / 6 * (1 - square / 20)
    second = 0.5 - square / 24 * (1 - square / 30)
    third = 1 / 6 - square / 120 * (1 - square / 42)
    return first, second, third


def _turned(vector: NDArray, q: NDArray, first: NDArray, second: NDArray) -> NDArray:
    """exp(-q) of a vector.  Source: Rodrigues; Groves (2013), eq. (2.28)."""
    once = np.cross(q, vector)
    return vector - first * once + second * np.cross(q, once)


def _spin(q: NDArray, q_dot: NDArray) -> NDArray:
    """Angular rate of exp(q) against the axes it turns from, in the turned ones.

    Source: Bortz (1971), inverted.
    """
    _, second, third = _series(q)
    once = np.cross(q, q_dot)
    return q_dot - second * once + third * np.cross(q, once)


def _arm(ideal: IdealSensors) -> NDArray:
    """From the point on the ground that the body turns about to the IMU, body axes."""
    arm = -np.asarray(ideal.truth.wheel_reference_m, dtype=float)
    return np.array([arm[0], arm[1], min(arm[2], -IMU_ABOVE_M)])


def _turning(ideal: IdealSensors) -> NDArray:
    """Rate of the undisturbed body against the Earth (n + 1, 3); exactly 0 at rest."""
    rate = ideal.dtheta_rad / ideal.dt_s - turn_back(ideal.C_nb, omega_ie_n(ideal.lat_rad))
    rate[ideal.at_rest] = 0.0
    return np.concatenate([rate[:1], rate])


def _shift(ideal: IdealSensors, d_n: NDArray) -> tuple[NDArray, NDArray]:
    """Latitude and longitude that a displacement (n + 1, 3) adds [rad]."""
    lat = np.concatenate([ideal.lat_rad[:1], ideal.lat_rad])
    height = np.concatenate([ideal.height_m[:1], ideal.height_m])
    meridian, transverse = radii_of_curvature(lat)
    return d_n[:, 0] / (meridian + height), d_n[:, 1] / ((transverse + height) * np.cos(lat))


def _level_turn(ideal: IdealSensors, dlat: NDArray, dlon: NDArray) -> NDArray:
    """Turn of the local level (n + 1, 3) over a change of latitude and longitude, NED."""
    lat = np.concatenate([ideal.lat_rad[:1], ideal.lat_rad])
    return np.stack([np.cos(lat) * dlon, -dlat, -np.sin(lat) * dlon], axis=-1)


@dataclass(frozen=True, kw_only=True)
class _Shaken:
    """What lines add: angle [rad] and velocity [m/s] at the run's start and at each row's end,
    (n + 1, 3), and the mean angle over each row (n, 3), undisturbed body axes.
    """

    angle_rad: NDArray
    velocity_m_s: NDArray
    mean_angle_rad: NDArray


def _shaken(ideal: IdealSensors, moves: Moves) -> _Shaken:
    """All lines, in closed form: their periods may be shorter than a row."""
    rows = moves.scene.rows
    angle, velocity = np.zeros((rows + 1, 3)), np.zeros((rows + 1, 3))
    mean = np.zeros((rows, 3))
    time_s = np.arange(rows + 1) * ideal.dt_s
    for strength, line in moves.lines:
        omega = 2 * np.pi * line.frequency_hz
        cosine = np.cos(omega * time_s + line.phase_rad)
        sine = np.sin(omega * time_s + line.phase_rad)
        envelope = line.envelope[: moves.scene.nodes : moves.scene.steps]
        size = strength * np.sqrt(2) * envelope / omega
        angle += (size * cosine)[:, None] * line.rate_rad_s
        velocity += (size * sine)[:, None] * line.acceleration_m_s2
        middle = 0.5 * (size[1:] + size[:-1]) / (omega * ideal.dt_s)
        mean += (middle * np.diff(sine))[:, None] * line.rate_rad_s
    return _Shaken(angle_rad=angle, velocity_m_s=velocity, mean_angle_rad=mean)
