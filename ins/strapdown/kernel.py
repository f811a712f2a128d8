"""The formulas of a strapdown step in the Earth frame, for `loop`. Import lazily: loads
numba.

Without numba, or with NUMBA_DISABLE_JIT=1, the same source runs as plain Python. Vectors are
tuples, matrices tuples of nine in row order; SI and radians, silent. No sine and no cosine of
position is taken, so no latitude is special.

State: q (body to ECEF, scalar first), v_eb_e, r_eb_e, and the vertical channel's acceleration
correction.

Decision: docs/decisions/0001-ecef-quaternion.md.
"""

from math import atan2, cos, sin, sqrt

import numpy as np

from ins.earth import EARTH_RATE_RAD_S as OMEGA
from ins.earth import (
    ECCENTRICITY_SQUARED,
    FLATTENING,
    GRAVITY_EQUATOR_M_S2,
    GRAVITY_RATIO_M,
    SEMI_MAJOR_AXIS_M,
    SEMI_MINOR_AXIS_M,
    SOMIGLIANA_K,
)
from ins.jit import jit

A, B, E2 = SEMI_MAJOR_AXIS_M, SEMI_MINOR_AXIS_M, ECCENTRICITY_SQUARED
EP2 = E2 / (1 - E2)  # second eccentricity squared
SLOPE_0, SLOPE_1 = -2 / A * (1 + FLATTENING + GRAVITY_RATIO_M), 4 / A * FLATTENING
POLE_RADIUS_M = 1e-3  # closer to the pole than this, longitude is defined as 0
SERIES_ANGLE_2 = 0.01  # below 0.1 rad a step the rotation uses power series
MAX_INTERVAL_RATIO = 2.5  # an interval 2.5 times the one before (a gap) tells nothing of the slope

# columns of an output row: latitude, longitude, height; v_n; C_nb in row order; then the sums over
# the epoch: C_nb dt, and displacement_n, displacement_b, dv_f_n, dtheta_b
V_N_AT, C_NB_AT, C_NB_DT_AT, SUMS, HISTORY_COLUMNS = 3, 6, 15, 24, 36

# State that a stream carries over: q, v, r, vertical correction; dtheta, dv, dt of the interval
# before; then the look-ahead: u, s, a, f, a and f of the last step, rows and time since the
# look-ahead began, rows it may have.
V, R, CORRECTION, BEFORE, DT_BEFORE, U, SEEN, A_USED, F_USED, A_LAST, F_LAST = np.array(
    # np.int64: one compilation for all, see strapdown_loop
    [4, 7, 10, 11, 17, 18, 21, 24, 27, 30, 33],
    dtype=np.int64,
)
COUNT, ELAPSED, LIMIT, STATE_SIZE = 36, 37, 38, 39
LOOK_ROWS, LOOK_AHEAD_S = 16, 0.16  # see strapdown_loop


# A part is compiled into its callers: a loop over tiles becomes vector instructions only where
# nothing in it is called.
kernel = jit()
part = jit(forceinline=True)
# Of those that only kernels call: no way in from Python, which is a quarter of what there is to
# compile.
inner = jit(no_cpython_wrapper=True)
inner_part = jit(forceinline=True, no_cpython_wrapper=True)


@inner_part
def cross(a, b):
    """Cross product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner_part
def add(a, b, k):
    """The sum a + k b."""
    return a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]


@inner_part
def square(a):
    """Squared length."""
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]


@inner_part
def rotate(C, a):
    """The product C a."""
    return (
        C[0] * a[0] + C[1] * a[1] + C[2] * a[2],
        C[3] * a[0] + C[4] * a[1] + C[5] * a[2],
        C[6] * a[0] + C[7] * a[1] + C[8] * a[2],
    )


@inner_part
def row(table, k):
    """Row k of a table (n, 3)."""
    return table[k, 0], table[k, 1], table[k, 2]


@part
def dcm(q):
    """C from a unit quaternion, scalar first. Source: Groves (2013), section 2.2.3."""
    w, x, y, z = q
    return (
        w * w + x * x - y * y - z * z,
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        w * w - x * x + y * y - z * z,
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        w * w - x * x - y * y + z * z,
    )


@part
def local_frame(r):
    """sin and cos of latitude and of longitude, and height, by square roots alone. Source: Bowring
    (1985).
    """
    p = sqrt(r[0] * r[0] + r[1] * r[1])
    R = sqrt(p * p + r[2] * r[2])
    s, c = B * r[2] * (R + EP2 * B), A * p * R  # tan beta = (b z / a p)(1 + e'^2 b / R)
    k = 1 / sqrt(s * s + c * c)
    s, c = s * k, c * k
    # tan L = (z + e'^2 b sin^3)/(p - e^2 a cos^3)
    s, c = r[2] + EP2 * B * s * s * s, p - E2 * A * c * c * c
    k = 1 / sqrt(s * s + c * c)
    s, c = s * k, c * k
    height = p * c + r[2] * s - A * sqrt(1 - E2 * s * s)
    if p < POLE_RADIUS_M:
        return s, c, 0.0, 1.0, height
    return s, c, r[1] / p, r[0] / p, height


@part
def normal(r):
    """The upward unit normal of the ellipsoid at r, ECEF, and height: local_frame without the
    longitude, for any r.
    """
    p2 = r[0] * r[0] + r[1] * r[1]
    R = sqrt(p2 + r[2] * r[2])
    s, c = B * r[2] * (R + EP2 * B), A * R  # c p in local_frame
    k = 1 / sqrt(s * s + c * c * p2)
    s, c = s * k, c * k
    s, c = r[2] + EP2 * B * s * s * s, 1 - E2 * A * c * c * c * p2
    k = 1 / sqrt(s * s + c * c * p2)
    s, c = s * k, c * k
    return (r[0] * c, r[1] * c, s), p2 * c + r[2] * s - A * sqrt(1 - E2 * s * s)


@part
def dcm_ne_at(r, up):
    """C_ne where the normal is known."""
    p2 = r[0] * r[0] + r[1] * r[1]
    # a factor: vector instructions have no branch
    beside = 1.0 if p2 >= POLE_RADIUS_M * POLE_RADIUS_M else 0.0
    k = beside / sqrt(p2 + (1.0 - beside))
    sl, cl = r[1] * k, r[0] * k + (1.0 - beside)
    sL, cL = up[2], up[0] * cl + up[1] * sl
    return -sL * cl, -sL * sl, cL, -sl, cl, 0.0, -up[0], -up[1], -up[2]


@part
def dcm_ne(frame):
    """C_ne: ECEF components into NED."""
    sL, cL, sl, cl, _ = frame
    return -sL * cl, -sL * sl, cL, -sl, cl, 0.0, -cL * cl, -cL * sl, -sL


@part
def gravity(sin_lat, height):
    """ins.earth.gravity_magnitude, from the sine of latitude."""
    sin2 = sin_lat * sin_lat
    surface = GRAVITY_EQUATOR_M_S2 * (1 + SOMIGLIANA_K * sin2) / sqrt(1 - E2 * sin2)
    return surface * (1 + (SLOPE_0 + SLOPE_1 * sin2) * height + 3 / (A * A) * height * height)


@inner_part
def angle(a2, small):
    """(1 - cos a)/a^2 and (a - sin a)/a^3."""
    if small or a2 < SERIES_ANGLE_2:
        return 0.5 - a2 * (1 / 24) * (1 - a2 * (1 / 30)), 1 / 6 - a2 * (1 / 120) * (
            1 - a2 * (1 / 42)
        )
    a = sqrt(a2)
    half = sin(a / 2) / a  # a product: numba compiles x**2 as a loop over the bits of 2
    return 2 * (half * half), (a - sin(a)) / (a2 * a)


@part
def interval_weights(dt, dt_before):
    """What an interval and the one before make of the slope: dt/dt_before, and the weights of
    coning and of slope.
    """
    ratio = dt / dt_before
    if dt > MAX_INTERVAL_RATIO * dt_before:
        return ratio, 0.0, 0.0
    return ratio, dt * ratio / (6 * (dt + dt_before)), 2 * dt / (dt + dt_before)


@part
def compensate(theta, dv, theta_before, dv_before, weights, small):
    """Rotation vector, velocity increment in the body frame of the interval's start, and its
    scrolling part [m/s].

    The same formulas as ins.strapdown.increments, where the derivation is. Scrolling, times dt, is
    what the trapezoid of the velocity misses: -(slope dt^2 + theta x dv) / 12. weights: of the
    intervals. small: known to turn less than 0.1 rad.
    """
    ratio, weight, slope_weight = weights
    k1, k2 = angle(square(theta), small)
    slope = add((0.0, 0.0, 0.0), add(dv, dv_before, -ratio), slope_weight)
    rotation = add(theta, cross(theta_before, theta), weight)
    turn = cross(theta, dv)
    sculling = add(cross(theta_before, dv), cross(dv_before, theta), 1.0)
    dv_start = add(add(add(dv, turn, k1), cross(theta, turn), k2), sculling, weight)
    return rotation, dv_start, add(add((0.0, 0.0, 0.0), slope, -1 / 12), turn, -1 / 12)


@inner_part
def half_angle(h2, small):
    """cos h and sin(h)/h."""
    if small or h2 < SERIES_ANGLE_2 / 4:
        cosine = 1 - h2 * 0.5 * (1 - h2 * (1 / 12) * (1 - h2 * (1 / 30) * (1 - h2 * (1 / 56))))
        return cosine, 1 - h2 * (1 / 6) * (1 - h2 * (1 / 20) * (1 - h2 * (1 / 42)))
    h = sqrt(h2)
    return cos(h), sin(h) / h


@part
def rotation_quaternion(rotation, small):
    """Quaternion of a rotation vector. small: known to be less than 0.1 rad."""
    w, k = half_angle(0.25 * square(rotation), small)
    k = 0.5 * k
    return w, k * rotation[0], k * rotation[1], k * rotation[2]


@part
def turn_attitude(q, turned, earth_angle):
    """q after the body turned by the quaternion `turned` (body axes) and the Earth by
    `earth_angle`.
    """
    a, b, c, d = q
    w, x, y, z = turned
    a, b, c, d = (
        (a * w - b * x) - (c * y + d * z),
        (a * x + b * w) + (c * z - d * y),
        (a * y - b * z) + (c * w + d * x),
        (a * z + b * y) - (c * x - d * w),
    )
    e = -0.5 * earth_angle
    w, e = (
        1 - e * e * 0.5 * (1 - e * e * (1 / 12)),
        e * (1 - e * e * (1 / 6) * (1 - e * e * (1 / 20))),
    )
    return w * a - e * d, w * b - e * c, w * c + e * b, w * d + e * a


@part
def unit(q):
    """q brought back to unit length: a Newton step of 1/norm."""
    a, b, c, d = q
    k = 1.5 - 0.5 * (a * a + b * b + c * c + d * d)
    return a * k, b * k, c * k, d * k


@inner_part
def force_increment(C, dv_start, earth_angle):
    """Force increment in the mean ECEF axes of the step."""
    dv_e = rotate(C, dv_start)
    return dv_e[0] + 0.5 * earth_angle * dv_e[1], dv_e[1] - 0.5 * earth_angle * dv_e[0], dv_e[2]


@inner_part
def step_velocity(v, dv_e, g_dt_e, earth_angle):
    """v_eb_e after the step: Coriolis at the step's middle.

    v' = f + g - 2 omega_ie x v.  Source: Groves (2013), section 5.3.
    """
    gained = add(dv_e, g_dt_e, 1.0)
    half = (
        v[0] + 0.5 * gained[0] + earth_angle * v[1],
        v[1] + 0.5 * gained[1] - earth_angle * v[0],
    )
    return (
        v[0] + gained[0] + 2 * earth_angle * half[1],
        v[1] + gained[1] - 2 * earth_angle * half[0],
        v[2] + gained[2],
    )


@inner_part
def pull(middle, height_ref, T, gains):
    """At a place: up, height less height_ref, and the velocity increment of gravity and of the
    damping to that height.
    """
    up, height = normal(middle)
    error = height - height_ref
    return up, error, add((0.0, 0.0, 0.0), up, -T * (gravity(up[2], height) + gains[1] * error))


@inner_part
def translate(v, r, correction, dv_e, scroll_e, up, error, pull_e, T, gains):
    """One step of velocity and position: v, r, vertical correction, displacement."""
    v_new = add(step_velocity(v, dv_e, pull_e, OMEGA * T), up, -T * correction)
    dr = add(add(add((0.0, 0.0, 0.0), v, 0.5 * T), v_new, 0.5 * T), scroll_e, T)
    return (
        v_new,
        add(add(r, dr, 1.0), up, -T * gains[0] * error),
        correction + T * gains[2] * error,
        dr,
    )


@inner_part
def look_ahead(u, s, a, f, dv_e, T):
    """Velocity and place for the next look-up of gravity: a is what but the force acts, f what but
    velocity moves.
    """
    u_new = add(add(u, dv_e, 1.0), a, T)
    return u_new, add(add(add(s, u, 0.5 * T), u_new, 0.5 * T), f, T)


@inner_part
def drift_of(v, v_new, dv_e, up, error, T, gains):
    """a and f of look_ahead as they were in a step."""
    k = 1 / T
    a = (
        (v_new[0] - v[0] - dv_e[0]) * k,
        (v_new[1] - v[1] - dv_e[1]) * k,
        (v_new[2] - v[2] - dv_e[2]) * k,
    )
    return a, add((0.0, 0.0, 0.0), up, -gains[0] * error)


@inner_part
def record(out, j, C, v, r):
    """Write latitude, longitude, height, velocity and attitude to row j, in the NED frame at r."""
    frame = local_frame(r)
    C_ne = dcm_ne(frame)
    v_n = rotate(C_ne, v)
    out[j, 0], out[j, 1], out[j, 2] = atan2(frame[0], frame[1]), atan2(frame[2], frame[3]), frame[4]
    for i in range(3):
        out[j, V_N_AT + i] = v_n[i]
        out[j, C_NB_AT + i], out[j, C_NB_AT + 3 + i], out[j, C_NB_AT + 6 + i] = rotate(
            C_ne, (C[i], C[3 + i], C[6 + i])
        )
