"""Ideal increments from a motion given in closed form, by way of the inertial frame: nothing of the
mechanization.

Every quantity is a second-order Taylor jet in time, so r_ib_i and C_ib are differentiated exactly:
no Coriolis term, no transport rate, no finite difference. f = C_bi (r'' - gravitation), omega from
C_ib' C_bi, and each interval is integrated by Gauss-Legendre quadrature. Gravitation is the normal
gravity of ins.earth plus the centrifugal part.
"""

from dataclasses import dataclass

import numpy as np

from ins import earth
from ins.records import ImuLog, NavState, Site

NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass
class Jet:
    """Value, first and second time derivative."""

    x: np.ndarray
    d: np.ndarray
    dd: np.ndarray

    def __add__(self, other):
        other = constant(other, self)
        return Jet(self.x + other.x, self.d + other.d, self.dd + other.dd)

    def __mul__(self, other):
        other = constant(other, self)
        return Jet(
            self.x * other.x,
            self.d * other.x + self.x * other.d,
            self.dd * other.x + 2 * self.d * other.d + self.x * other.dd,
        )

    def __neg__(self):
        return self * -1.0

    def __sub__(self, other):
        return self + constant(other, self) * -1.0

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other):
        return -self + other

    def of(self, f, f1, f2):
        """A function with its first and second derivative, at the value."""
        return Jet(f, f1 * self.d, f2 * self.d**2 + f1 * self.dd)


def constant(value, like):
    return (
        value
        if isinstance(value, Jet)
        else Jet(value + np.zeros_like(like.x), 0 * like.x, 0 * like.x)
    )


def clock(t):
    return Jet(np.asarray(t, dtype=float), np.ones_like(t), np.zeros_like(t))


def sine(j):
    return j.of(np.sin(j.x), np.cos(j.x), -np.sin(j.x))


def cosine(j):
    return j.of(np.cos(j.x), -np.sin(j.x), -np.cos(j.x))


def rsqrt(j):
    return j.of(j.x**-0.5, -0.5 * j.x**-1.5, 0.75 * j.x**-2.5)


def matmul(A, B):
    return [
        [sum((A[i][k] * B[k][j] for k in range(1, 3)), A[i][0] * B[0][j]) for j in range(3)]
        for i in range(3)
    ]


def about_z(angle):
    s, c = sine(angle), cosine(angle)
    return [[c, -s, 0 * s], [s, c, 0 * s], [0 * s, 0 * s, 1 + 0 * s]]


def about_y(angle):
    s, c = sine(angle), cosine(angle)
    return [[c, 0 * s, s], [0 * s, 1 + 0 * s, 0 * s], [-s, 0 * s, c]]


def about_x(angle):
    s, c = sine(angle), cosine(angle)
    return [[1 + 0 * s, 0 * s, 0 * s], [0 * s, c, -s], [0 * s, s, c]]


def attitude(roll, pitch, heading):
    """C_nb by three elementary rotations."""
    return matmul(about_z(heading), matmul(about_y(pitch), about_x(roll)))


def geodetic_motion(lat, lon, height, roll, pitch, heading):
    """ECEF position, C_eb and sin of latitude, height, up of a motion given by six jets."""
    sL, cL, sl, cl = sine(lat), cosine(lat), sine(lon), cosine(lon)
    N = earth.SEMI_MAJOR_AXIS_M * rsqrt(1 - earth.ECCENTRICITY_SQUARED * (sL * sL))
    r_e = [
        (N + height) * (cL * cl),
        (N + height) * (cL * sl),
        ((1 - earth.ECCENTRICITY_SQUARED) * N + height) * sL,
    ]
    C_en = [[-(sL * cl), -sl, -(cL * cl)], [-(sL * sl), cl, -(cL * sl)], [cL, 0 * sL, -sL]]
    up = np.stack([(cL * cl).x, (cL * sl).x, sL.x], axis=-1)
    return r_e, matmul(C_en, attitude(roll, pitch, heading)), lat.x, height.x, up


def stack(M):
    """Value and first and second derivative of a vector or matrix of jets, components last."""
    if isinstance(M[0], list):
        return [
            np.stack([np.stack([getattr(j, a) for j in row], -1) for row in M], -2)
            for a in ("x", "d", "dd")
        ]
    return [np.stack([getattr(j, a) for j in M], -1) for a in ("x", "d", "dd")]


def sensed(motion, t):
    """omega_ib_b and f_ib_b, each (n, 3), at the times t."""
    r_e, C_eb, lat, height, up = motion(clock(t))
    spin = about_z(earth.EARTH_RATE_RAD_S * clock(t))
    C_ib, C_ib_d, _ = stack(matmul(spin, C_eb))
    r_i, _, r_i_dd = stack(
        [sum((spin[i][k] * r_e[k] for k in range(1, 3)), spin[i][0] * r_e[0]) for i in range(3)]
    )
    C_ie = stack(spin)[0]
    centrifugal_i = earth.EARTH_RATE_RAD_S**2 * r_i * [1, 1, 0]
    gravity_i = -earth.gravity_magnitude(lat, height)[:, None] * np.einsum("nij,nj->ni", C_ie, up)
    f_i = r_i_dd - (gravity_i - centrifugal_i)
    W = np.einsum("nki,nkj->nij", C_ib, C_ib_d)  # C_bi C_ib' = skew(omega_ib_b)
    return np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], -1), np.einsum("nki,nk->ni", C_ib, f_i)


def ideal_imu(motion, edges_s):
    """Increments between consecutive edges (n + 1,) -> n rows."""
    dt = np.diff(edges_s)
    middle = 0.5 * (edges_s[1:] + edges_s[:-1])
    dtheta, dv = np.zeros((dt.size, 3)), np.zeros((dt.size, 3))
    for node, weight in zip(NODES, WEIGHTS):
        omega, f = sensed(motion, middle + 0.5 * node * dt)
        dtheta += 0.5 * weight * dt[:, None] * omega
        dv += 0.5 * weight * dt[:, None] * f
    return ImuLog(time_s=edges_s[1:], dt_s=dt, dtheta_rad=dtheta, dv_m_s=dv)


def true_state(motion, time_s):
    """The NavState at one time, through pymap3d for latitude and height."""
    r_e, C_eb, *_ = motion(clock(np.array([time_s])))
    r, v, _ = stack(r_e)
    lat, lon, height = (float(a[0]) for a in earth.geodetic_from_ecef(r))
    C_en = earth.dcm_en(lat, lon)
    site = Site(lat_rad=lat, lon_rad=lon, height_m=height)
    return NavState(
        time_s=time_s, site=site, v_n_m_s=C_en.T @ v[0], C_nb=C_en.T @ stack(C_eb)[0][0]
    )


def errors(history, motion, k=-1):
    """Position [m], velocity [m/s] and attitude [rad] error of row k, as vectors in ECEF."""
    t = np.array([history.time_s[k]])
    r_e, C_eb, *_ = motion(clock(t))
    r, v, _ = stack(r_e)
    C_en = earth.dcm_en(history.lat_rad[k], history.lon_rad[k])
    r_nav = earth.ecef_from_geodetic(history.lat_rad[k], history.lon_rad[k], history.height_m[k])
    D = C_en @ history.C_nb[k] @ stack(C_eb)[0][0].T
    phi = 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
    return r_nav - r[0], C_en @ history.v_n_m_s[k] - v[0], phi
