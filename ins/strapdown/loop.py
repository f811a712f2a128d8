"""The strapdown loop of one trajectory, LOOK_ROWS rows at a time. Import lazily: this module loads
numba.

The formulas are those of ins.strapdown.kernel; conventions as there. Only attitude, velocity and
position hang on the row before; everything else is worked out for all rows of a block side by side,
in one flat array, so that loops over them become vector instructions: element c of row l at
(c ROWS + l).

Where gravity is looked up: at the middle of each row by a look-ahead that starts from the solution
itself at most LOOK_ROWS rows or LOOK_AHEAD_S seconds before, and keeps gravity, Coriolis and
damping as they were then. It is off by less than 1e-6 m (jerk of gravity at 300 m/s, 0.16 s), 2e-12
m/s^2 of gravity; at rows of 0.1 s and longer by nothing.

Decision: docs/decisions/0001-ecef-quaternion.md.
"""

import numpy as np

from ins.strapdown.kernel import (
    A_LAST,
    A_USED,
    BEFORE,
    C_NB_DT_AT,
    CORRECTION,
    COUNT,
    DT_BEFORE,
    ELAPSED,
    F_LAST,
    F_USED,
    LIMIT,
    LOOK_ROWS,
    OMEGA,
    SEEN,
    R,
    U,
    V,
    add,
    compensate,
    dcm,
    dcm_ne_at,
    drift_of,
    force_increment,
    inner,
    inner_part,
    interval_weights,
    kernel,
    look_ahead,
    pull,
    record,
    rotate,
    rotation_quaternion,
    row,
    square,
    translate,
    turn_attitude,
    unit,
)

ROWS = LOOK_ROWS
# Columns of a block: the row as read and as the one before; state before and after it; what it does
# in the body frame, in the Earth frame, where it looks gravity up; its shares of the sums. Columns
# and INT64_ZERO are np.int64, since numba compiles a function anew for each Python integer that it
# is given by name.
INT64_ZERO = np.int64(0)
(
    THETA,
    DV,
    THETA_BEFORE,
    DV_BEFORE,
    T_ROW,
    WEIGHTS,
    HEIGHT_REF,
    Q,
    Q_NEW,
    V_OLD,
    V_NEW,
    R_NEW,
    TURNED,
    DV_START,
    SCROLL,
    DV_E,
    SCROLL_E,
    MIDDLE,
    UP,
    ERROR,
    PULL,
    DR,
    SHARE,
) = np.array(
    [0, 3, 6, 9, 12, 13, 16, 17, 21, 25, 28, 31, 34, 38, 41, 44, 47, 50, 53, 56, 57, 60, 63],
    dtype=np.int64,
)
SHARES = 21
ONE, TWO, THREE = np.uintp(ROWS), np.uintp(2 * ROWS), np.uintp(3 * ROWS)  # columns on
FAST_ANGLE_2 = 0.008  # increments below 0.09 rad: with coning still below the series' 0.1


@inner_part
def at(c, l):
    """Where element l of column c is. Unsigned, since numba would ask of any other index whether it
    is below zero.
    """
    return np.uintp(c * ROWS + l)


@inner_part
def vector(F, c, l):
    """Three columns from c on, of row l."""
    i = at(c, l)
    return F[i], F[i + ONE], F[i + TWO]


@inner_part
def quaternion(F, c, l):
    """Four columns from c on, of row l."""
    i = at(c, l)
    return F[i], F[i + ONE], F[i + TWO], F[i + THREE]


@inner_part
def put(F, c, l, a):
    """Write three columns from c on, of row l."""
    i = at(c, l)
    F[i], F[i + ONE], F[i + TWO] = a


@inner_part
def put_quaternion(F, c, l, q):
    """Write four columns from c on, of row l."""
    i = at(c, l)
    F[i], F[i + ONE], F[i + TWO], F[i + THREE] = q


@inner_part
def triple(state, c):
    """Three elements of the state from c on."""
    return state[c], state[c + 1], state[c + 2]


@inner_part
def put_triple(state, c, a):
    """Write three elements of the state from c on."""
    state[c], state[c + 1], state[c + 2] = a


@inner_part
def body_frame(F, l, small):
    """What a row does in the body frame of its start."""
    rotation, dv_start, scroll = compensate(
        vector(F, THETA, l),
        vector(F, DV, l),
        vector(F, THETA_BEFORE, l),
        vector(F, DV_BEFORE, l),
        vector(F, WEIGHTS, l),
        small,
    )
    put_quaternion(F, TURNED, l, rotation_quaternion(rotation, small))
    put(F, DV_START, l, dv_start)
    put(F, SCROLL, l, scroll)


@inner
def load(F, dt, dtheta, dv, height_ref, first, count, before):
    """Put rows first to first + count in the block.

    Returns the interval before the next row, and the largest squared angle.
    """
    theta_before, dv_before, dt_before = before
    largest = square(theta_before)
    for l in range(count):
        theta, dv_b, T = row(dtheta, first + l), row(dv, first + l), dt[first + l]
        put(F, THETA, l, theta)
        put(F, DV, l, dv_b)
        put(F, THETA_BEFORE, l, theta_before)
        put(F, DV_BEFORE, l, dv_before)
        put(F, WEIGHTS, l, interval_weights(T, dt_before))
        F[at(T_ROW, l)], F[at(HEIGHT_REF, l)] = T, height_ref[first + l]
        largest = max(largest, square(theta))
        theta_before, dv_before, dt_before = theta, dv_b, T
    return (theta_before, dv_before, dt_before), largest


@inner_part
def share_attitude(F, l):
    """What a row adds to the sum of C_nb dt, in the order of the output's columns."""
    half, C, D = 0.5 * F[at(T_ROW, l)], dcm(quaternion(F, Q, l)), dcm(quaternion(F, Q_NEW, l))
    C_ne = dcm_ne_at(vector(F, MIDDLE, l), vector(F, UP, l))
    x = rotate(C_ne, (half * (C[0] + D[0]), half * (C[3] + D[3]), half * (C[6] + D[6])))
    y = rotate(C_ne, (half * (C[1] + D[1]), half * (C[4] + D[4]), half * (C[7] + D[7])))
    z = rotate(C_ne, (half * (C[2] + D[2]), half * (C[5] + D[5]), half * (C[8] + D[8])))
    put(F, SHARE, l, (x[0], y[0], z[0]))
    put(F, SHARE + 3, l, (x[1], y[1], z[1]))
    put(F, SHARE + 6, l, (x[2], y[2], z[2]))


@inner_part
def share_motion(F, l):
    """What a row adds to displacement and force increment (NED) and displacement (body axes)."""
    half, v, w = 0.5 * F[at(T_ROW, l)], vector(F, V_OLD, l), vector(F, V_NEW, l)
    C, D = dcm(quaternion(F, Q, l)), dcm(quaternion(F, Q_NEW, l))
    C_ne = dcm_ne_at(vector(F, MIDDLE, l), vector(F, UP, l))
    put(F, SHARE + 9, l, rotate(C_ne, vector(F, DR, l)))
    x = C[0] * v[0] + C[3] * v[1] + C[6] * v[2] + (D[0] * w[0] + D[3] * w[1] + D[6] * w[2])
    y = C[1] * v[0] + C[4] * v[1] + C[7] * v[2] + (D[1] * w[0] + D[4] * w[1] + D[7] * w[2])
    z = C[2] * v[0] + C[5] * v[1] + C[8] * v[2] + (D[2] * w[0] + D[5] * w[1] + D[8] * w[2])
    put(F, SHARE + 12, l, (half * x, half * y, half * z))
    put(F, SHARE + 15, l, rotate(C_ne, vector(F, DV_E, l)))
    put(F, SHARE + 18, l, vector(F, THETA, l))


@inner
def close_rows(F, out, ends, j, k, count):
    """Add the shares of rows k to k + count to their epochs and record the epochs that end.

    Returns the next epoch.
    """
    a = 0
    while a < count:
        b = min(count, ends[j] - k) if j < ends.size else count
        for c in range(SHARES):
            total = out[j, C_NB_DT_AT + c]
            for l in range(a, b):
                total += F[at(SHARE + c, l)]
            out[j, C_NB_DT_AT + c] = total
        if j < ends.size and b == ends[j] - k:
            record(
                out,
                j,
                dcm(quaternion(F, Q_NEW, b - 1)),
                vector(F, V_NEW, b - 1),
                vector(F, R_NEW, b - 1),
            )
            j += 1
        a = b
    return j


@inner
def body_frames(F, rows, width, small):
    """What the rows do in the body frame of their starts."""
    if small:
        for l in range(width):
            body_frame(F, l, True)
    else:
        for l in range(rows):
            body_frame(F, l, False)


@inner
def turn(F, rows, q):
    """Attitudes before and after each row; the last one."""
    for l in range(rows):
        put_quaternion(F, Q, l, q)
        q = turn_attitude(q, quaternion(F, TURNED, l), OMEGA * F[at(T_ROW, l)])
        put_quaternion(F, Q_NEW, l, q)
    return q


@inner
def resolve(F, width):
    """Force increments and scrolling in the Earth frame."""
    for l in range(width):
        C = dcm(quaternion(F, Q, l))
        put(F, DV_E, l, force_increment(C, vector(F, DV_START, l), OMEGA * F[at(T_ROW, l)]))
        put(F, SCROLL_E, l, rotate(C, vector(F, SCROLL, l)))


@inner
def attract(F, width, gains):
    """Up, height error and gravity's pull where each row looks."""
    for l in range(width):
        up, error, pull_e = pull(vector(F, MIDDLE, l), F[at(HEIGHT_REF, l)], F[at(T_ROW, l)], gains)
        put(F, UP, l, up)
        F[at(ERROR, l)] = error
        put(F, PULL, l, pull_e)


@inner
def move(F, rows, v, r, correction, gains):
    """Velocity and position through the rows."""
    for l in range(rows):
        put(F, V_OLD, l, v)
        v, r, correction, dr = translate(
            v,
            r,
            correction,
            vector(F, DV_E, l),
            vector(F, SCROLL_E, l),
            vector(F, UP, l),
            F[at(ERROR, l)],
            vector(F, PULL, l),
            F[at(T_ROW, l)],
            gains,
        )
        put(F, V_NEW, l, v)
        put(F, R_NEW, l, r)
        put(F, DR, l, dr)
    return v, r, correction


@inner
def share(F, width):
    """What each row adds to the sums."""
    for l in range(width):
        share_attitude(F, l)
    for l in range(width):
        share_motion(F, l)


@kernel
def integrate(dt, dtheta, dv, height_ref, gains, look_s, width, ends, state, out):
    """Use up all rows; output row j ends before row ends[j].

    Parameters
    ----------
    dt : ndarray, shape (n,)
        Intervals [s].
    dtheta, dv : ndarray, shape (n, 3)
        Increments [rad], [m/s].
    height_ref : ndarray, shape (n,)
        The height that the vertical loop is damped to [m].
    gains : (float, float, float)
        k1, k2, k3 of the vertical loop; all zero when free.
    look_s : float
        The longest look-ahead: LOOK_AHEAD_S, or less where the vertical loop is fast.
    width : int
        Rows of a block that are worked out side by side: LOOK_ROWS.
    ends : ndarray of int64
        Rows used up at each epoch end. What follows the last one adds to the row after it.
    state : ndarray, shape (STATE_SIZE,)
        See ins.strapdown.kernel. Changed in place, so that a stream cut anywhere gives the same
        bits.
    out : ndarray, shape (ends.size + 1, COLUMNS)
        Its sums are set by the caller: zero, or in row 0 those of the part before.
    """
    F = np.zeros((SHARE + SHARES) * ROWS)
    q, v, r = (state[0], state[1], state[2], state[3]), triple(state, V), triple(state, R)
    correction, count, elapsed, limit = (
        state[CORRECTION],
        state[COUNT],
        state[ELAPSED],
        state[LIMIT],
    )
    u, s, a, f = triple(state, U), triple(state, SEEN), triple(state, A_USED), triple(state, F_USED)
    a_last, f_last = triple(state, A_LAST), triple(state, F_LAST)
    before = triple(state, BEFORE), triple(state, BEFORE + 3), state[DT_BEFORE]
    for l in range(width):  # unused rows are worked out as well
        put(F, MIDDLE, l, r)
    k, j = INT64_ZERO, INT64_ZERO
    if ends.size > 0 and ends[0] == 0:
        record(out, j, dcm(q), v, r)
        j += 1
    while k < dt.size:
        if count >= limit or elapsed + dt[k] > look_s:
            q, u, s, a, f = unit(q), v, r, a_last, f_last
            limit, count, elapsed = ROWS if limit > 0 else 1, 0, 0.0
        rows = INT64_ZERO
        while (
            k + rows < dt.size
            and count < limit
            and (count == 0 or elapsed + dt[k + rows] <= look_s)
        ):
            elapsed += dt[k + rows]
            rows, count = rows + 1, count + 1
        before, largest = load(F, dt, dtheta, dv, height_ref, k, rows, before)
        body_frames(F, rows, width, largest < FAST_ANGLE_2)
        q = turn(F, rows, q)
        resolve(F, width)
        for l in range(rows):
            T = F[at(T_ROW, l)]
            put(F, MIDDLE, l, add(s, u, 0.5 * T))
            u, s = look_ahead(u, s, a, f, vector(F, DV_E, l), T)
        attract(F, width, gains)
        v, r, correction = move(F, rows, v, r, correction, gains)
        last = rows - 1
        a_last, f_last = drift_of(
            vector(F, V_OLD, last),
            v,
            vector(F, DV_E, last),
            vector(F, UP, last),
            F[at(ERROR, last)],
            F[at(T_ROW, last)],
            gains,
        )
        share(F, width)
        j = close_rows(F, out, ends, j, k, rows)
        k += rows
    state[0], state[1], state[2], state[3] = q
    state[CORRECTION], state[COUNT], state[ELAPSED], state[LIMIT] = (
        correction,
        count,
        elapsed,
        limit,
    )
    for c, value in (
        (V, v),
        (R, r),
        (U, u),
        (SEEN, s),
        (A_USED, a),
        (F_USED, f),
        (A_LAST, a_last),
        (F_LAST, f_last),
    ):
        put_triple(state, c, value)
    put_triple(state, BEFORE, before[0])
    put_triple(state, BEFORE + 3, before[1])
    state[DT_BEFORE] = before[2]
