"""What the vehicle does beyond its motion: sway, crab, side noise, yaw creep, people, gusts, a
tug's bump.

All are laid over an ideal run to second order in angle, with the truth moved alike. A velocity
dv_n moves the position, adds to the specific force and turns the local level by rho, which the
gyros see; a rotation of the body by the vector q (body axes) turns the specific force, and its
heading part turns the course of rolling::

    f'      = f + C_bn (d(dv_n)/dt + 2 omega_ie x dv_n)
    rho     = (cosL dlon, -dlat, -sinL dlon)
    dtheta' = exp(-q) dtheta + dq - q_before x q / 2

Left out: changes of gravity with the displacement, (displacement / R) x speed: 0.5 mm/s at 200 m/s
after 17 m of crab.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, schur

from ins.attitude import dcm_from_rotation_vector
from ins.earth import omega_ie_n, radii_of_curvature
from ins.records import InputError, VehicleNoise
from ins.units import ARCSEC, DEG, MILLIRADIAN
from trajectories.simulator.sensors import IdealSensors

ROLLING_M_S = (0.5, 1.5)  # side noise fades in between these speeds
SIDE_NOISE_TAU_S = 2.0
BOARDING_DAMPING = 0.4
# the rotation is second order in angle: the third is 1 deg^3 / 6, 0.2 arcsec
MAX_PUSH_TURN_DEG = 1.0
BUMP_PEAK = 0.75 * np.sqrt(3)  # makes the largest value of sin(2 pi u) sin(pi u) one


@dataclass(frozen=True, kw_only=True)
class Boarding:
    """A step of the body's attitude and height (people, fuel): rings in over about `settle_s`;
    stays.

    sink_mm: downward, in the velocity and the specific force; the truth's height, held to the
    wheels, leaves it out.
    """

    time_s: float
    roll_arcsec: float = 0.0
    pitch_arcsec: float = 0.0
    heading_arcsec: float = 0.0
    sink_mm: float = 0.0
    settle_s: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Gust:
    """A burst of sway with this RMS, fading in and out over a tenth of its duration."""

    time_s: float
    duration_s: float
    sway_m_s: float


@dataclass(frozen=True, kw_only=True)
class Bump:
    """A tug's bump on the gear: one to and fro, no lasting displacement; direction clockwise from
    body x.
    """

    time_s: float
    velocity_m_s: float
    duration_s: float = 0.5
    direction_deg: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Push:
    """A tug moves the parked vehicle along body x (negative: back) at this speed, and may turn it
    by a little.
    """

    time_s: float
    distance_m: float
    speed_m_s: float = 0.3
    ramp_s: float = 2.0
    turn_deg: float = 0.0

    def __post_init__(self) -> None:
        if not (self.speed_m_s > 0 and self.ramp_s > 0):
            raise InputError(f"speed_m_s {self.speed_m_s}, ramp_s {self.ramp_s}, needed above 0")
        if abs(self.turn_deg) > MAX_PUSH_TURN_DEG:
            raise InputError(
                f"push: turn_deg {self.turn_deg}, needed within +-{MAX_PUSH_TURN_DEG:g}: use a turn"
                " segment"
            )

    @property
    def duration_s(self) -> float:
        """Ramps of `ramp_s` up and down, steady between; a short way takes two ramps at a lower
        speed.
        """
        return max(abs(self.distance_m) / self.speed_m_s, self.ramp_s) + self.ramp_s


Event = Boarding | Gust | Bump | Push
EVENTS: dict[str, type] = {"boarding": Boarding, "gust": Gust, "bump": Bump, "push": Push}


@dataclass(frozen=True, kw_only=True)
class Disturbed:
    """The run with its disturbances: true increments and the truth at the end of each sample (see
    IdealSensors).
    """

    dtheta_rad: NDArray
    dv_m_s: NDArray
    lat_rad: NDArray
    lon_rad: NDArray
    v_n_m_s: NDArray
    C_nb: NDArray


def disturb(
    ideal: IdealSensors, vehicle: VehicleNoise, events: Sequence[Event], rng: np.random.Generator
) -> Disturbed:
    """Lays the vehicle's noise and the events over an ideal run."""
    dt = ideal.dt_s
    q_b = _body_rotation(ideal, vehicle, events, rng)
    side_n = _side_velocity_n(ideal, vehicle, events, rng)
    yaw = np.einsum("nj,nj->n", ideal.C_nb[:, 2], q_b)[:, None]
    # the course of rolling turns with the heading
    dv_n = side_n + yaw * np.cross([0.0, 0.0, 1.0], ideal.v_n_m_s)
    meridian, transverse = radii_of_curvature(ideal.lat_rad)
    cos_lat = np.cos(ideal.lat_rad)
    dlat = _running_integral(dv_n[:, 0] / (meridian + ideal.height_m), dt)
    dlon = _running_integral(dv_n[:, 1] / ((transverse + ideal.height_m) * cos_lat), dt)
    rho_n = np.stack([cos_lat * dlon, -dlat, -np.sin(ideal.lat_rad) * dlon], axis=-1)
    turned_b = q_b + turn_back(ideal.C_nb, rho_n)
    before = _shifted(turned_b)
    dtheta = _turned_by(0.5 * (turned_b + before), ideal.dtheta_rad)
    dtheta += turned_b - before - 0.5 * np.cross(before, turned_b)
    middle = 0.5 * (ideal.C_nb + np.concatenate([ideal.C_nb[:1], ideal.C_nb[:-1]]))
    coriolis_n = np.cross(2 * omega_ie_n(ideal.lat_rad), 0.5 * (dv_n + _shifted(dv_n)))
    dv_b = ideal.dv_m_s + turn_back(middle, dv_n - _shifted(dv_n) + coriolis_n * dt)
    return Disturbed(
        dtheta_rad=dtheta,
        dv_m_s=_turned_by(0.5 * (q_b + _shifted(q_b)), dv_b),
        lat_rad=ideal.lat_rad + dlat,
        lon_rad=ideal.lon_rad + dlon,
        v_n_m_s=ideal.v_n_m_s + dv_n,
        C_nb=ideal.C_nb @ dcm_from_rotation_vector(q_b),
    )


def sway_velocity(
    rng: np.random.Generator,
    n: int,
    *,
    rms_m_s: float,
    frequency_hz: float,
    damping: float,
    rate_hz: float,
) -> NDArray:
    """Velocity (n,) of a damped oscillator under white force, in its steady state; exact at the
    samples.

    x'' + 2 z w x' + w^2 x = white; the steady covariance of (w x, x') is rms^2 diag(1, 1). The
    two states are run one after the other in the basis of Schur, which critical damping has, too
    (there the two eigenmodes are one).
    """
    if rms_m_s == 0:
        return np.zeros(n)
    w = 2 * np.pi * frequency_hz
    Phi = expm(np.array([[0.0, w], [-w, -2 * damping * w]]) / rate_hz)
    start = rms_m_s * rng.standard_normal(2)
    step = rms_m_s * np.linalg.cholesky(np.eye(2) - Phi @ Phi.T)
    drive = rng.standard_normal((n, 2)) @ step.T
    drive[0] = start
    T, basis = schur(Phi, output="complex")
    drive = drive @ basis.conj()
    second = recursion(T[1, 1], drive[:, 1])
    first = recursion(T[0, 0], drive[:, 0] + T[0, 1] * np.concatenate([[0.0], second[:-1]]))
    return np.real(basis[1, 0] * first + basis[1, 1] * second)


def gauss_markov(
    rng: np.random.Generator, n: int, *, rms: float, tau_s: float, rate_hz: float
) -> NDArray:
    """First-order Gauss-Markov samples (n,), steady from the start."""
    keep = np.exp(-1 / (tau_s * rate_hz))
    drive = rms * np.sqrt(1 - keep**2) * rng.standard_normal(n)
    drive[0] = rms * rng.standard_normal()
    return recursion(keep, drive)


def recursion(keep: complex, drive: NDArray) -> NDArray:
    """y[k] = keep y[k - 1] + drive[k], real or complex: `scipy.signal.lfilter` to the last bit,
    without the half second of CPU that scipy.signal takes to load.
    """
    from trajectories.recursion_kernel import add_kept

    real, imaginary = drive.real.copy(), np.zeros(drive.size)
    if not np.iscomplexobj(drive):
        add_kept(real, imaginary, float(np.real(keep)), 0.0)
        return real
    imaginary += drive.imag
    add_kept(real, imaginary, float(np.real(keep)), float(np.imag(keep)))
    return real + 1j * imaginary


def _body_rotation(
    ideal: IdealSensors, vehicle: VehicleNoise, events: Sequence[Event], rng: np.random.Generator
) -> NDArray:
    """Rotation vector of the body against its undisturbed attitude, body axes (n, 3)."""
    q_b = np.zeros((ideal.time_s.size, 3))
    # only while parked
    step = vehicle.yaw_creep_arcsec_sqrt_h * ARCSEC / 60.0 * np.sqrt(ideal.dt_s)
    q_b[:, 2] = np.cumsum(step * ideal.at_rest * rng.standard_normal(ideal.time_s.size))
    for event in events:
        if isinstance(event, Boarding):
            size = ARCSEC * np.array([event.roll_arcsec, event.pitch_arcsec, event.heading_arcsec])
            q_b += size * _ringing_step(ideal.time_s - event.time_s, event.settle_s)[:, None]
        elif isinstance(event, Push):
            q_b[:, 2] += (
                event.turn_deg * DEG * smooth_step((ideal.time_s - event.time_s) / event.duration_s)
            )
    return q_b


def _ringing_step(since_s: NDArray, settle_s: float) -> NDArray:
    """Unit step of a damped oscillator that has all but settled (5 %) after settle_s; at rest
    before 0.
    """
    t = np.maximum(since_s, 0.0)
    decay = 3.0 / settle_s
    ring = decay * np.sqrt(1 - BOARDING_DAMPING**2) / BOARDING_DAMPING
    return 1 - np.exp(-decay * t) * (np.cos(ring * t) + decay / ring * np.sin(ring * t))


def _side_velocity_n(
    ideal: IdealSensors, vehicle: VehicleNoise, events: Sequence[Event], rng: np.random.Generator
) -> NDArray:
    """Velocity laid over the motion (n, 3), NED: sway and gusts (north, east), crab and side noise
    (body y), bumps and pushes, sinking."""
    n, t, rate = ideal.time_s.size, ideal.time_s, ideal.rate_hz
    oscillator = {"frequency_hz": vehicle.sway_hz, "damping": vehicle.sway_damping, "rate_hz": rate}
    dv_n = np.zeros((n, 3))
    dv_b = np.zeros((n, 3))
    for axis in range(2):
        dv_n[:, axis] = sway_velocity(rng, n, rms_m_s=vehicle.sway_m_s, **oscillator)
    low, high = ROLLING_M_S
    rolling = smooth_step((ideal.speed_m_s - low) / (high - low))
    side = gauss_markov(rng, n, rms=vehicle.lateral_noise_m_s, tau_s=SIDE_NOISE_TAU_S, rate_hz=rate)
    dv_b[:, 1] = rolling * side - ideal.speed_m_s * np.tan(vehicle.crab_mrad * MILLIRADIAN)
    for event in events:
        if isinstance(event, Gust):
            u = (t - event.time_s) / event.duration_s
            envelope = smooth_step(10 * u) * smooth_step(10 * (1 - u))
            for axis in range(2):
                dv_n[:, axis] += envelope * sway_velocity(
                    rng, n, rms_m_s=event.sway_m_s, **oscillator
                )
        elif isinstance(event, Bump):
            u = np.clip((t - event.time_s) / event.duration_s, 0.0, 1.0)
            to_and_fro = event.velocity_m_s * BUMP_PEAK * np.sin(2 * np.pi * u) * np.sin(np.pi * u)
            dv_b[:, 0] += np.cos(event.direction_deg * DEG) * to_and_fro
            dv_b[:, 1] += np.sin(event.direction_deg * DEG) * to_and_fro
        elif isinstance(event, Push):
            since, steady = t - event.time_s, event.distance_m / (event.duration_s - event.ramp_s)
            stopping = smooth_step((since - event.duration_s + event.ramp_s) / event.ramp_s)
            dv_b[:, 0] += steady * (smooth_step(since / event.ramp_s) - stopping)
        elif isinstance(event, Boarding) and event.sink_mm:
            sunk_m = 1e-3 * event.sink_mm * _ringing_step(t - event.time_s, event.settle_s)
            dv_n[:, 2] += np.diff(sunk_m, prepend=0.0) * rate
    return ideal.on_wheels[:, None] * (dv_n + turn(ideal.C_nb, dv_b))


def smooth_step(u: NDArray) -> NDArray:
    u = np.clip(u, 0.0, 1.0)
    return u * u * u * (10 - 15 * u + 6 * u * u)


def _turned_by(q_b: NDArray, vector: NDArray) -> NDArray:
    """A vector as the body sees it that has turned by q: exp(-q) to second order."""
    once = np.cross(q_b, vector)
    return vector - once + 0.5 * np.cross(q_b, once)


def turn(C: NDArray, vector: NDArray) -> NDArray:
    return np.einsum("nij,nj->ni", C, vector)


def turn_back(C: NDArray, vector: NDArray) -> NDArray:
    return np.einsum("nji,nj->ni", C, vector)


def _shifted(values: NDArray) -> NDArray:
    """Values one sample before; 0 before the first."""
    return np.concatenate([np.zeros_like(values[:1]), values[:-1]])


def _running_integral(values: NDArray, dt: float) -> NDArray:
    """Trapezoid integral from the run's start, where the values are 0."""
    return dt * np.cumsum(0.5 * (values + _shifted(values)), axis=0)
