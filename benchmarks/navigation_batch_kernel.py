"""The strapdown loop over many trajectories at once. Import lazily: this module loads numba.

The step is that of ins.strapdown.kernel, operation by operation, so that a trajectory comes out
with the same bits in either; conventions as there.

A tile is TILE trajectories side by side in one flat array, so that the loop over them becomes
vector instructions: element c of lane l at (c TILE + l). Elements: the state as in integrate; this
step's increments; the biases of the bin; (scale factor and misalignment) matrices, gyro then
accelerometer; and what the lane adds to height_ref.
"""

import numpy as np

from ins.strapdown.kernel import (
    A_LAST,
    A_USED,
    BEFORE,
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
    STATE_SIZE,
    R,
    U,
    V,
    add,
    compensate,
    dcm,
    drift_of,
    force_increment,
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

TILE = 16
INCREMENTS_AT, BIAS_AT, MATRIX_AT, HEIGHT, TILE_SIZE = (
    STATE_SIZE,
    STATE_SIZE + 6,
    STATE_SIZE + 12,
    STATE_SIZE + 30,
    STATE_SIZE + 31,
)
FAST_ANGLE_2 = 0.008  # increments below 0.09 rad: with coning still below the series' 0.1


@inner_part
def at(c, l):
    """Where lane l of element c is. Unsigned, since numba would ask of any other index whether it
    is below zero.
    """
    return np.uintp(c * TILE + l)


@inner_part
def lane_vector(F, c, l):
    """Three elements from c on, of lane l."""
    return F[at(c, l)], F[at(c + 1, l)], F[at(c + 2, l)]


@inner_part
def lane_quaternion(F, l):
    """The attitude of lane l."""
    return F[at(0, l)], F[at(1, l)], F[at(2, l)], F[at(3, l)]


@inner_part
def lane_matrix(F, c, l):
    """Nine elements from c on, of lane l."""
    return lane_vector(F, c, l) + lane_vector(F, c + 3, l) + lane_vector(F, c + 6, l)


@inner_part
def set_lane_vector(F, c, l, a):
    """Write three elements from c on, of lane l."""
    F[at(c, l)], F[at(c + 1, l)], F[at(c + 2, l)] = a


@inner_part
def set_lane_quaternion(F, l, q):
    """Write the attitude of lane l."""
    F[at(0, l)], F[at(1, l)], F[at(2, l)], F[at(3, l)] = q


@inner_part
def restart_look_ahead(F, l):
    """From the solution as it is."""
    set_lane_quaternion(F, l, unit(lane_quaternion(F, l)))
    set_lane_vector(F, U, l, lane_vector(F, V, l))
    set_lane_vector(F, SEEN, l, lane_vector(F, R, l))
    set_lane_vector(F, A_USED, l, lane_vector(F, A_LAST, l))
    set_lane_vector(F, F_USED, l, lane_vector(F, F_LAST, l))


@inner_part
def step_lane(F, l, T, weights, height_ref, gains, small):
    """The state of lane l after one step; small: all lanes are known to turn less than 0.1 rad."""
    theta, dv = lane_vector(F, INCREMENTS_AT, l), lane_vector(F, INCREMENTS_AT + 3, l)
    v, q = lane_vector(F, V, l), lane_quaternion(F, l)
    rotation, dv_start, scroll = compensate(
        theta, dv, lane_vector(F, BEFORE, l), lane_vector(F, BEFORE + 3, l), weights, small
    )
    C = dcm(q)
    dv_e = force_increment(C, dv_start, OMEGA * T)
    u, s = lane_vector(F, U, l), lane_vector(F, SEEN, l)
    up, error, pull_e = pull(add(s, u, 0.5 * T), height_ref + F[at(HEIGHT, l)], T, gains)
    u, s = look_ahead(u, s, lane_vector(F, A_USED, l), lane_vector(F, F_USED, l), dv_e, T)
    v_new, r, correction, _ = translate(
        v,
        lane_vector(F, R, l),
        F[at(CORRECTION, l)],
        dv_e,
        rotate(C, scroll),
        up,
        error,
        pull_e,
        T,
        gains,
    )
    a, f = drift_of(v, v_new, dv_e, up, error, T, gains)
    set_lane_quaternion(F, l, turn_attitude(q, rotation_quaternion(rotation, small), OMEGA * T))
    set_lane_vector(F, V, l, v_new)
    set_lane_vector(F, R, l, r)
    F[at(CORRECTION, l)] = correction
    set_lane_vector(F, BEFORE, l, theta)
    set_lane_vector(F, BEFORE + 3, l, dv)
    set_lane_vector(F, U, l, u)
    set_lane_vector(F, SEEN, l, s)
    set_lane_vector(F, A_LAST, l, a)
    set_lane_vector(F, F_LAST, l, f)


@inner_part
def form_increments(F, dtheta, dv, T, own, k):
    """The increments of every lane: (I + M)(shared) + bias T + own.

    Returns the largest squared angle, of this step and the last.
    """
    shared_theta, shared_dv, largest = row(dtheta, k), row(dv, k), 0.0
    for l in range(TILE):
        theta = add(
            add(shared_theta, rotate(lane_matrix(F, MATRIX_AT, l), shared_theta), 1.0),
            lane_vector(F, BIAS_AT, l),
            T,
        )
        force = add(
            add(shared_dv, rotate(lane_matrix(F, MATRIX_AT + 9, l), shared_dv), 1.0),
            lane_vector(F, BIAS_AT + 3, l),
            T,
        )
        set_lane_vector(F, INCREMENTS_AT, l, theta)
        set_lane_vector(F, INCREMENTS_AT + 3, l, force)
    if own.size > 0:
        for c in range(6):
            for l in range(TILE):
                F[at(INCREMENTS_AT + c, l)] += own[k, c, l]
    for l in range(TILE):
        largest = max(
            largest, square(lane_vector(F, INCREMENTS_AT, l)), square(lane_vector(F, BEFORE, l))
        )
    return largest


@kernel
def integrate_tile(
    dt, dtheta, dv, own, bin_of_row, bias, height_ref, gains, look_s, ends, F, out, run, runs, epoch
):
    """All rows of TILE trajectories; the state after row ends[j] - 1 is put out.

    Parameters
    ----------
    dt : ndarray, shape (n,)
        Intervals [s].
    dtheta, dv : ndarray, shape (n, 3)
        Shared increments [rad], [m/s].
    own : ndarray, shape (n, 6, TILE), or of size 0
        Increments that are added to them.
    bin_of_row : ndarray of int, shape (n,)
    bias : ndarray, shape (bins, 6, TILE)
        In rad/s, then m/s^2.
    height_ref : ndarray, shape (n,)
    gains : (float, float, float)
    look_s : float
        All three as in `ins.strapdown.loop.integrate`.
    ends : ndarray of int64
        Rows used up at each epoch end.
    F : ndarray, shape (TILE_SIZE * TILE,)
        The tile, carried from part to part.
    out : ndarray, shape (all runs, epochs, C_NB_DT)
        Run `run + lane`, epoch `epoch + j` is written.
    run, runs, epoch : int
        First run of the tile, its number of runs, first epoch.
    """
    bin_now, first, T_before = -1, 0, F[at(DT_BEFORE, 0)]
    count, elapsed, limit = F[at(COUNT, 0)], F[at(ELAPSED, 0)], F[at(LIMIT, 0)]
    for j in range(ends.size + 1):
        last = ends[j] if j < ends.size else dt.size
        for k in range(first, last):
            if bin_of_row[k] != bin_now:
                bin_now = bin_of_row[k]
                for c in range(6):
                    for l in range(TILE):
                        F[at(BIAS_AT + c, l)] = bias[bin_now, c, l]
            T, height, weights = dt[k], height_ref[k], interval_weights(dt[k], T_before)
            if count >= limit or elapsed + T > look_s:
                limit, count, elapsed = LOOK_ROWS if limit > 0 else 1, 0, 0.0
                for l in range(TILE):
                    restart_look_ahead(F, l)
            count, elapsed = count + 1, elapsed + T
            if form_increments(F, dtheta, dv, T, own, k) < FAST_ANGLE_2:
                for l in range(TILE):
                    step_lane(F, l, T, weights, height, gains, True)
            else:
                for l in range(TILE):
                    step_lane(F, l, T, weights, height, gains, False)
            T_before = T
        first = last
        if j < ends.size:
            for l in range(runs):
                record(
                    out[run + l],
                    epoch + j,
                    dcm(lane_quaternion(F, l)),
                    lane_vector(F, V, l),
                    lane_vector(F, R, l),
                )
    F[at(DT_BEFORE, 0)] = T_before
    F[at(COUNT, 0)], F[at(ELAPSED, 0)], F[at(LIMIT, 0)] = count, elapsed, limit
