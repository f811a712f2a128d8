"""The strapdown loop: one step after another in the Earth frame. Import lazily: this module loads numba.

Without numba, or with NUMBA_DISABLE_JIT=1, the same source runs as plain Python. Vectors are tuples, matrices tuples
of nine in row order; SI and radians, silent. The loop takes no sine and no cosine of position, so no latitude is special.

State: q (body to ECEF, scalar first), v_eb_e, r_eb_e, and the vertical channel's acceleration correction.
"""

from math import atan2, cos, sin, sqrt

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

# columns of an output row: latitude, longitude, height; v_n; C_nb in row order; then the sums over the epoch: C_nb dt,
# and displacement_n, displacement_b, dv_f_n, dtheta_b
V_N, C_NB, C_NB_DT, SUMS, COLUMNS = 3, 6, 15, 24, 36
CORRECTION, BEFORE, STATE_SIZE = 10, 11, 18  # of the state that a stream carries over: see integrate


# no test of each division: none here can be by zero. A part is compiled into its callers: a loop over tiles becomes
# vector instructions only where nothing in it is called.
kernel = jit(error_model="numpy")
part = jit(error_model="numpy", forceinline=True)


@part
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part
def add(a, b, k):
    """a + k b"""
    return a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]


@part
def square(a):
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]


@part
def rotate(C, a):
    return (
        C[0] * a[0] + C[1] * a[1] + C[2] * a[2],
        C[3] * a[0] + C[4] * a[1] + C[5] * a[2],
        C[6] * a[0] + C[7] * a[1] + C[8] * a[2],
    )


@part
def row(table, k):
    return table[k, 0], table[k, 1], table[k, 2]


@part
def dcm(q):
    """C from a unit quaternion, scalar first. Source: Groves (2013), section 2.2.3."""
    w, x, y, z = q
    return (
        w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z,
    )  # fmt: skip


@part
def local_frame(r):
    """sin and cos of latitude and of longitude, and height, by square roots alone. Source: Bowring (1985)."""
    p = sqrt(r[0] * r[0] + r[1] * r[1])
    R = sqrt(p * p + r[2] * r[2])
    s, c = B * r[2] * (R + EP2 * B), A * p * R  # tan beta = (b z / a p)(1 + e'^2 b / R)
    k = 1 / sqrt(s * s + c * c)
    s, c = s * k, c * k
    s, c = r[2] + EP2 * B * s * s * s, p - E2 * A * c * c * c  # tan L = (z + e'^2 b sin^3)/(p - e^2 a cos^3)
    k = 1 / sqrt(s * s + c * c)
    s, c = s * k, c * k
    height = p * c + r[2] * s - A * sqrt(1 - E2 * s * s)
    if p < POLE_RADIUS_M:
        return s, c, 0.0, 1.0, height
    return s, c, r[1] / p, r[0] / p, height


@part
def normal(r):
    """The upward unit normal of the ellipsoid at r, ECEF, and height: local_frame without the longitude, for any r."""
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
    p = sqrt(r[0] * r[0] + r[1] * r[1])
    k = 1 / max(p, POLE_RADIUS_M)
    sl, cl = (r[1] * k, r[0] * k) if p >= POLE_RADIUS_M else (0.0, 1.0)
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


@part
def angle(a2, small):
    """(1 - cos a)/a^2 and (a - sin a)/a^3."""
    if small or a2 < SERIES_ANGLE_2:
        return 0.5 - a2 / 24 * (1 - a2 / 30), 1 / 6 - a2 / 120 * (1 - a2 / 42)
    a = sqrt(a2)
    return 2 * (sin(a / 2) / a) ** 2, (a - sin(a)) / (a2 * a)


@part
def compensate(theta, dv, theta_before, dv_before, dt, dt_before, small):
    """Rotation vector, velocity increment in the body frame of the interval's start, and its scrolling part [m/s].

    The same formulas as ins.increments, where the derivation is. Scrolling, times dt, is what the trapezoid of the
    velocity misses: -(slope dt^2 + theta x dv) / 12. small: known to turn less than 0.1 rad.
    """
    k1, k2 = angle(square(theta), small)
    ratio = dt / dt_before
    weight = dt * ratio / (6 * (dt + dt_before)) if dt <= MAX_INTERVAL_RATIO * dt_before else 0.0
    slope = add((0.0, 0.0, 0.0), add(dv, dv_before, -ratio), 12 * weight / ratio)
    rotation = add(theta, cross(theta_before, theta), weight)
    turn = cross(theta, dv)
    sculling = add(cross(theta_before, dv), cross(dv_before, theta), 1.0)
    dv_start = add(add(add(dv, turn, k1), cross(theta, turn), k2), sculling, weight)
    return rotation, dv_start, add(add((0.0, 0.0, 0.0), slope, -1 / 12), turn, -1 / 12)


@part
def half_angle(h2, small):
    """cos h and sin(h)/h."""
    if small or h2 < SERIES_ANGLE_2 / 4:
        return 1 - h2 / 2 * (1 - h2 / 12 * (1 - h2 / 30 * (1 - h2 / 56))), 1 - h2 / 6 * (1 - h2 / 20 * (1 - h2 / 42))
    h = sqrt(h2)
    return cos(h), sin(h) / h


@part
def turn_attitude(q, rotation, earth_angle, small):
    """q after the body turned by `rotation` (body axes) and the Earth by `earth_angle`; unit length kept.
    """
    w, k = half_angle(0.25 * square(rotation), small)
    k = 0.5 * k
    x, y, z = k * rotation[0], k * rotation[1], k * rotation[2]
    a, b, c, d = q
    a, b, c, d = (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
    e = -0.5 * earth_angle
    w, e = 1 - e * e / 2 * (1 - e * e / 12), e * (1 - e * e / 6 * (1 - e * e / 20))
    a, b, c, d = w * a - e * d, w * b - e * c, w * c + e * b, w * d + e * a
    k = 1.5 - 0.5 * (a * a + b * b + c * c + d * d)  # Newton step of 1/norm
    return a * k, b * k, c * k, d * k


@part
def step_velocity(v, dv_e, g_dt_e, earth_angle):
    """Force increment in the mean ECEF axes of the step, and v_eb_e after it: Coriolis at the step's middle.

    v' = f + g - 2 omega_ie x v.  Source: Groves (2013), section 5.3.
    """
    dv_e = (dv_e[0] + 0.5 * earth_angle * dv_e[1], dv_e[1] - 0.5 * earth_angle * dv_e[0], dv_e[2])
    gained = add(dv_e, g_dt_e, 1.0)
    half = (
        v[0] + 0.5 * gained[0] + earth_angle * v[1],
        v[1] + 0.5 * gained[1] - earth_angle * v[0],
    )
    return dv_e, (
        v[0] + gained[0] + 2 * earth_angle * half[1],
        v[1] + gained[1] - 2 * earth_angle * half[0],
        v[2] + gained[2],
    )


@part
def accumulate(out, j, dt, C_ne, C, C_new, v, v_new, dr, dv_e, theta):
    """Add one step to the sums of row j."""
    dr_n, dv_n = rotate(C_ne, dr), rotate(C_ne, dv_e)
    for i in range(3):
        v_b = C[i] * v[0] + C[3 + i] * v[1] + C[6 + i] * v[2]
        v_b += C_new[i] * v_new[0] + C_new[3 + i] * v_new[1] + C_new[6 + i] * v_new[2]
        column = rotate(C_ne, (C[i] + C_new[i], C[3 + i] + C_new[3 + i], C[6 + i] + C_new[6 + i]))
        out[j, C_NB_DT + i] += 0.5 * dt * column[0]
        out[j, C_NB_DT + 3 + i] += 0.5 * dt * column[1]
        out[j, C_NB_DT + 6 + i] += 0.5 * dt * column[2]
        out[j, SUMS + i] += dr_n[i]
        out[j, SUMS + 3 + i] += 0.5 * dt * v_b
        out[j, SUMS + 6 + i] += dv_n[i]
        out[j, SUMS + 9 + i] += theta[i]


@part
def record(out, j, C, v, r):
    """Write latitude, longitude, height, velocity and attitude to row j, in the NED frame at r."""
    frame = local_frame(r)
    C_ne = dcm_ne(frame)
    v_n = rotate(C_ne, v)
    out[j, 0], out[j, 1], out[j, 2] = atan2(frame[0], frame[1]), atan2(frame[2], frame[3]), frame[4]
    for i in range(3):
        out[j, V_N + i] = v_n[i]
        out[j, C_NB + i], out[j, C_NB + 3 + i], out[j, C_NB + 6 + i] = rotate(C_ne, (C[i], C[3 + i], C[6 + i]))


@part
def translate(C, dv_start, scroll, v, r, correction, T, height_ref, gains):
    """One step of velocity and position: v, r, vertical correction, displacement, force increment, mid-step up."""
    up, height = normal(add(r, v, 0.5 * T))
    error = height - height_ref
    dv_e, v_new = step_velocity(
        v, rotate(C, dv_start), add((0.0, 0.0, 0.0), up, -T * gravity(up[2], height)), OMEGA * T
    )
    v_new = add(v_new, up, -T * (gains[1] * error + correction))
    dr = add(add(add((0.0, 0.0, 0.0), v, 0.5 * T), v_new, 0.5 * T), rotate(C, scroll), T)
    r_new = add(add(r, dr, 1.0), up, -T * gains[0] * error)
    return v_new, r_new, correction + T * gains[2] * error, dr, dv_e, up


@kernel
def integrate(dt, dtheta, dv, height_ref, gains, ends, state, out):
    """Use up all rows; output row j ends before row ends[j], and what follows the last end adds to the row after it.

    state (18,): q, v, r, the vertical correction, and dtheta, dv, dt of the interval before the first row; changed in
    place, so that a stream cut anywhere gives the same bits. out (ends.size + 1, COLUMNS), its sums set by the caller:
    zero, or in row 0 those of the part before. gains: k1, k2, k3 of the vertical loop, all zero when free;
    height_ref: the height it is damped to, one a row.
    """
    q, v, r = (state[0], state[1], state[2], state[3]), (state[4], state[5], state[6]), (state[7], state[8], state[9])
    correction, theta_before, dv_before = state[10], (state[11], state[12], state[13]), (state[14], state[15], state[16])
    dt_before, C, first = state[17], dcm(q), 0
    for j in range(ends.size + 1):
        last = ends[j] if j < ends.size else dt.size
        for k in range(first, last):
            T, theta, dv_b = dt[k], row(dtheta, k), row(dv, k)
            rotation, dv_start, scroll = compensate(theta, dv_b, theta_before, dv_before, T, dt_before, False)
            middle = add(r, v, 0.5 * T)
            v_new, r, correction, dr, dv_e, up = translate(
                C, dv_start, scroll, v, r, correction, T, height_ref[k], gains
            )
            q = turn_attitude(q, rotation, OMEGA * T, False)
            C_new = dcm(q)
            accumulate(out, j, T, dcm_ne_at(middle, up), C, C_new, v, v_new, dr, dv_e, theta)
            v, C, theta_before, dv_before, dt_before = v_new, C_new, theta, dv_b, T
        first = last
        if j < ends.size:
            record(out, j, C, v, r)
    state[0], state[1], state[2], state[3] = q
    state[10], state[17] = correction, dt_before
    for i in range(3):
        state[4 + i], state[7 + i], state[11 + i], state[14 + i] = v[i], r[i], theta_before[i], dv_before[i]
