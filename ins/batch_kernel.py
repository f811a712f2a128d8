"""The strapdown loop over many trajectories at once. Import lazily: this module loads numba.

The step is that of ins.strapdown_kernel, operation by operation, so that a trajectory comes out with the same bits in
either; conventions as there.

A tile is TILE trajectories side by side in one flat array, so that the loop over them becomes vector instructions:
element c of lane l at (c TILE + l). Elements: the state as in integrate; this step's increments; the biases of the
bin; (scale factor and misalignment) matrices, gyro then accelerometer; and what the lane adds to height_ref.
"""

from ins.strapdown_kernel import (
    BEFORE,
    CORRECTION,
    OMEGA,
    STATE_SIZE,
    add,
    compensate,
    dcm,
    kernel,
    part,
    record,
    rotate,
    row,
    square,
    translate,
    turn_attitude,
)

TILE = 16
INCREMENTS, BIAS, MATRIX, HEIGHT, TILE_SIZE = STATE_SIZE, STATE_SIZE + 6, STATE_SIZE + 12, STATE_SIZE + 30, STATE_SIZE + 31
FAST_ANGLE_2 = 0.008  # increments below 0.09 rad: with coning still below the series' 0.1


@part
def lane_vector(F, c, l):
    return F[c * TILE + l], F[(c + 1) * TILE + l], F[(c + 2) * TILE + l]


@part
def lane_matrix(F, c, l):
    return lane_vector(F, c, l) + lane_vector(F, c + 3, l) + lane_vector(F, c + 6, l)


@part
def set_lane_vector(F, c, l, a):
    F[c * TILE + l], F[(c + 1) * TILE + l], F[(c + 2) * TILE + l] = a


@part
def step_lane(F, l, T, T_before, height_ref, gains, small):
    """The state of lane l after one step; small: all lanes are known to turn less than 0.1 rad."""
    q = (F[l], F[TILE + l], F[2 * TILE + l], F[3 * TILE + l])
    theta, dv = lane_vector(F, INCREMENTS, l), lane_vector(F, INCREMENTS + 3, l)
    rotation, dv_start, scroll = compensate(
        theta, dv, lane_vector(F, BEFORE, l), lane_vector(F, BEFORE + 3, l), T, T_before, small
    )
    v, r, correction, _, _, _ = translate(
        dcm(q), dv_start, scroll, lane_vector(F, 4, l), lane_vector(F, 7, l), F[CORRECTION * TILE + l], T,
        height_ref + F[HEIGHT * TILE + l], gains,
    )  # fmt: skip
    F[l], F[TILE + l], F[2 * TILE + l], F[3 * TILE + l] = turn_attitude(q, rotation, OMEGA * T, small)
    set_lane_vector(F, 4, l, v)
    set_lane_vector(F, 7, l, r)
    F[CORRECTION * TILE + l] = correction
    set_lane_vector(F, BEFORE, l, theta)
    set_lane_vector(F, BEFORE + 3, l, dv)


@part
def form_increments(F, dtheta, dv, T, own, k):
    """The increments of every lane: (I + M)(shared) + bias T + own; the largest squared angle, this step and last."""
    shared_theta, shared_dv, largest = row(dtheta, k), row(dv, k), 0.0
    for l in range(TILE):
        theta = add(add(shared_theta, rotate(lane_matrix(F, MATRIX, l), shared_theta), 1.0), lane_vector(F, BIAS, l), T)
        force = add(add(shared_dv, rotate(lane_matrix(F, MATRIX + 9, l), shared_dv), 1.0), lane_vector(F, BIAS + 3, l), T)
        set_lane_vector(F, INCREMENTS, l, theta)
        set_lane_vector(F, INCREMENTS + 3, l, force)
    if own.size > 0:
        for c in range(6):
            for l in range(TILE):
                F[(INCREMENTS + c) * TILE + l] += own[k, c, l]
    for l in range(TILE):
        largest = max(largest, square(lane_vector(F, INCREMENTS, l)), square(lane_vector(F, BEFORE, l)))
    return largest


@kernel
def integrate_tile(
    dt, dtheta, dv, own, bin_of_row, bias, height_ref, gains, ends, F, out, run, runs, epoch
):  # fmt: skip
    """All rows of TILE trajectories; the state after row ends[j] - 1 goes to out[run : run + runs, epoch + j].

    dtheta, dv (n, 3): shared. own (n, 6, TILE), or of size 0: increments added to them. bias (bins, 6, TILE) [rad/s,
    m/s^2], bin_of_row (n,). F: the tile, TILE_SIZE elements a lane, carried from part to part. out (all runs, epochs,
    C_NB_DT columns of ins.strapdown_kernel).
    """
    bin_now, first, T_before = -1, 0, F[(STATE_SIZE - 1) * TILE]
    for j in range(ends.size + 1):
        last = ends[j] if j < ends.size else dt.size
        for k in range(first, last):
            if bin_of_row[k] != bin_now:
                bin_now = bin_of_row[k]
                for c in range(6):
                    for l in range(TILE):
                        F[(BIAS + c) * TILE + l] = bias[bin_now, c, l]
            T, height = dt[k], height_ref[k]
            if form_increments(F, dtheta, dv, T, own, k) < FAST_ANGLE_2:
                for l in range(TILE):
                    step_lane(F, l, T, T_before, height, gains, True)
            else:
                for l in range(TILE):
                    step_lane(F, l, T, T_before, height, gains, False)
            T_before = T
        first = last
        if j < ends.size:
            for l in range(runs):
                q = (F[l], F[TILE + l], F[2 * TILE + l], F[3 * TILE + l])
                record(out[run + l], epoch + j, dcm(q), lane_vector(F, 4, l), lane_vector(F, 7, l))
    F[(STATE_SIZE - 1) * TILE] = T_before
