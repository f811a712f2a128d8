"""Ideal inertial sensors from truth, in inertial and Earth-fixed axes: no mechanization, no
navigation-frame formula.

Specific force: f_e = r''_e + 2 Omega x r'_e - g_e with plumb-line gravity (attraction and
centrifugal), turned to body. Angular rate: from the rotation vectors of C_ib within each sample, by
collocation at the quadrature nodes.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_euler, dcm_from_rotation_vector, rotation_vector_from_dcm
from ins.earth import EARTH_RATE_RAD_S, dcm_en, geodetic_from_ecef, gravity_n
from ins.records import InputError
from trajectories.simulator.truth import Kinematics, Truth

_GAUSS = np.polynomial.legendre.leggauss(3)
# On [0, 1]; exact for polynomials of degree 5.
NODES = (_GAUSS[0] + 1) / 2
WEIGHTS = _GAUSS[1] / 2
ROUNDING_S = 1e-9  # a sample that ends this much after a rest still lies within it
CHUNK_SAMPLES = 20_000  # samples worked on at once, bounds memory
OMEGA_IE_E = np.array([0.0, 0.0, EARTH_RATE_RAD_S])


@dataclass(frozen=True, kw_only=True)
class IdealSensors:
    """What a perfect unit would put out, and the truth at the end of each sample; made once, used
    for many seeds.

    dtheta_rad, dv_m_s (n, 3) over the 1/rate_hz that ends at time_s; lat_rad, lon_rad, height_m
    (n,), v_n_m_s, euler_rad (roll, pitch, heading; heading not wrapped) (n, 3), C_nb (n, 3, 3): of
    the IMU, without disturbances. speed_m_s: of P along body x; on_wheels: 1 on the ground, 0 in
    the air; at_rest: the sample lies wholly at rest. swing_rad_s (n, 3): rate that an environment
    adds to the body's, at the ends, body axes; None where there is none.
    """

    truth: Truth
    rate_hz: float
    time_s: NDArray
    dtheta_rad: NDArray
    dv_m_s: NDArray
    lat_rad: NDArray
    lon_rad: NDArray
    height_m: NDArray
    v_n_m_s: NDArray
    euler_rad: NDArray
    C_nb: NDArray
    speed_m_s: NDArray
    on_wheels: NDArray
    at_rest: NDArray
    swing_rad_s: NDArray | None = None

    @property
    def dt_s(self) -> float:
        return 1.0 / self.rate_hz


def ideal_sensors(truth: Truth, rate_hz: float, *, samples: slice = slice(None)) -> IdealSensors:
    """Increments over each sample of the whole run and the truth at their ends; samples at rest are
    worked out once.

    samples: of the whole run's, those wanted (step 1); the same bits as in the whole run.
    Raises InputError where the rate is outside 10 Hz to 2 kHz or the run shorter than two samples.
    """
    if not 10.0 <= rate_hz <= 2000.0:
        raise InputError(f"imu rate {rate_hz:g} Hz, needed 10 Hz to 2 kHz")
    n = int(np.floor(truth.motion.end_s * rate_hz + 1e-9))
    if n < 2:
        raise InputError(
            f"motion lasts {truth.motion.end_s:g} s, needed at least two samples at {rate_hz:g} Hz"
        )
    dt = 1.0 / rate_hz
    wanted = np.arange(n)[samples]
    n, time_s, starts = wanted.size, (wanted + 1) / rate_hz, wanted / rate_hz
    out = {name: np.empty((n, *shape)) for name, shape in _SHAPES.items()}
    at_rest = np.zeros(n, dtype=bool)
    for start_s, end_s, stretch in zip(truth.breaks_s[:-1], truth.breaks_s[1:], truth.stretches):
        first, last = np.searchsorted(starts, [start_s - ROUNDING_S, end_s - dt + ROUNDING_S])
        if stretch.spline is None and last > first:
            at_rest[first:last] = True
            _put(out, slice(first, last), _sample(truth, np.array([start_s]), dt))
    moving = np.flatnonzero(~at_rest)
    for first in range(0, moving.size, CHUNK_SAMPLES):
        rows = moving[first : first + CHUNK_SAMPLES]
        _put(out, rows, _sample(truth, starts[rows], dt))
    motion = truth.motion
    return IdealSensors(
        truth=truth,
        rate_hz=rate_hz,
        time_s=time_s,
        at_rest=at_rest,
        speed_m_s=motion.speed_m_s(time_s),
        on_wheels=1.0 - motion.airborne(time_s),
        **out,
    )


_SHAPES: dict[str, tuple[int, ...]] = {
    "dtheta_rad": (3,),
    "dv_m_s": (3,),
    "lat_rad": (),
    "lon_rad": (),
    "height_m": (),
    "v_n_m_s": (3,),
    "euler_rad": (3,),
    "C_nb": (3, 3),
}


def _put(out: dict[str, NDArray], rows: Any, values: dict[str, NDArray]) -> None:
    for name, value in values.items():
        out[name][rows] = value


def _sample(truth: Truth, starts: NDArray, dt: float) -> dict[str, NDArray]:
    """Increments over dt from each start, and the truth at its end."""
    points = [truth.kinematics(starts + dt * tau) for tau in (0.0, *NODES, 1.0)]
    frames = [_frames(point) for point in points]
    C_b0i = np.swapaxes(_C_ib(points[0], frames[0]), -1, -2)
    turned = np.stack(
        [rotation_vector_from_dcm(C_b0i @ _C_ib(p, f)) for p, f in zip(points[1:], frames[1:])],
        axis=1,
    )
    force_b = np.stack(
        [_specific_force_b(p, f) for p, f in zip(points[1:-1], frames[1:-1])], axis=1
    )
    end, last = points[-1], frames[-1]
    return {
        "dtheta_rad": np.einsum("k,nki->ni", WEIGHTS, _body_rate(turned)),
        "dv_m_s": dt * np.einsum("k,nki->ni", WEIGHTS, force_b),
        "lat_rad": last.lat_rad,
        "lon_rad": last.lon_rad,
        "height_m": last.height_m,
        "v_n_m_s": np.einsum("nji,nj->ni", last.C_en, end.v_e),
        "euler_rad": end.euler_rad,
        "C_nb": last.C_nb,
    }


class _Frames(NamedTuple):
    lat_rad: NDArray
    lon_rad: NDArray
    height_m: NDArray
    C_en: NDArray
    C_nb: NDArray


def _frames(point: Kinematics) -> _Frames:
    lat, lon, height = geodetic_from_ecef(point.r_e)
    return _Frames(lat, lon, height, dcm_en(lat, lon), dcm_from_euler(*point.euler_rad.T))


def _C_ib(point: Kinematics, frames: _Frames) -> NDArray:
    """Body to inertial axes; these coincide with the Earth-fixed ones at time 0."""
    C_ie = dcm_from_rotation_vector(point.time_s[:, None] * OMEGA_IE_E)
    return C_ie @ frames.C_en @ frames.C_nb


def _specific_force_b(point: Kinematics, frames: _Frames) -> NDArray:
    """f_b = C_be (r''_e + 2 Omega x r'_e - g_e) [m/s^2], (n, 3).  Source: Groves (2013), eq.
    (5.35), solved for f.
    """
    g_e = np.einsum("nij,nj->ni", frames.C_en, gravity_n(frames.lat_rad, frames.height_m))
    f_e = point.a_e + np.cross(2 * OMEGA_IE_E, point.v_e) - g_e
    return np.einsum("nji,nj->ni", frames.C_en @ frames.C_nb, f_e)


def _body_rate(turned_rad: NDArray) -> NDArray:
    """Body rate times the sample time at the quadrature nodes, (n, 3, 3).

    `turned_rad` (n, 4, 3): rotation vector since the sample's start at NODES and 1. It is taken as
    the quartic through these points and 0; omega = p' - (1 - cos p)/p^2 p x p' + (p - sin p)/p^3 p
    x (p x p'), factors as series. Source: Bortz (1971), inverted (right Jacobian of SO(3)).
    """
    phi = turned_rad[:, :-1]
    phi_dot = np.einsum("kj,nji->nki", DERIVATIVE, turned_rad)
    square = np.sum(phi**2, axis=-1, keepdims=True)
    once = np.cross(phi, phi_dot)
    return phi_dot - (1 / 2 - square / 24) * once + (1 / 6 - square / 120) * np.cross(phi, once)


def _derivative_matrix() -> NDArray:
    """Derivative at NODES of the quartic through 0 at 0 and values at NODES and 1: (3, 4)."""
    points = np.append(NODES, 1.0)
    powers = np.arange(1, 5)
    return (powers * NODES[:, None] ** (powers - 1)) @ np.linalg.inv(points[:, None] ** powers)


DERIVATIVE = _derivative_matrix()
