"""The compiled loop of the error filter: propagation and scalar updates without Python in between.
Import lazily.

Arrays in, arrays changed in place; SI and radians, silent; nothing is checked:
`ins.filters.error_filter` does that.

Core order, sixteen states that move or drive: W 0-1, POS 2-3, THETA 4-6, S 7-8, LATERAL 9 (these
ten move), then ACCEL 10-11, SCALE_Z 12 and the bias of the step's bin 13-15, which only drive. All
others stand still.
"""

from math import sqrt

import numpy as np

from ins.filters import states
from ins.filters.program import (
    ADD,
    ADVANCE,
    BIN,
    KEEP,
    LOST,
    MEASURE,
    MOVING,
    NOT_FINITE,
    REFUSED,
    ROLLING,
    USED,
)
from ins.jit import entry, jit

# columns of a step
DT, C_NB, V_N, OMEGA_IE, TRANSPORT, GRAVITY, RADIUS, TURN = 0, 1, 10, 13, 16, 19, 20, 21
JUMP_YAW, JUMP_W, JUMP_THETA, STEP_COLUMNS = 22, 23, 24, 25
ARW, VRW, ACCEL_RRW, YAW_CREEP, LATERAL_RMS, LATERAL_TIME = 0, 1, 2, 3, 4, 5  # of the noise
# first index of each state in the full vector (ins.filters.states)
W, CLONE_DOWN, YAW, BASE = states.W.start, states.THETA_CLONE.stop - 1, states.YAW, states.BASE
# of the core states, but the bias, in the full state
POSITIONS = states.MOVING_STATES + states.DRIVING_STATES
MOVE = len(states.MOVING_STATES)  # core states that move
BIAS = len(POSITIONS)  # first core state of the bias of the step's bin
CORE = BIAS + 3
# core states with process noise: those that move and the accelerometers' biases
NOISY = MOVE + 2
# only kernels call it: less to compile, but a call from Python would end the process
inner = jit(no_cpython_wrapper=True)


@inner
def system(step, lateral_time_s, A):
    """Fill A with the rates of the core states (equations: ins.filters.error_model).

    Parameters
    ----------
    step : ndarray, shape (STEP_COLUMNS,)
    lateral_time_s : float
        Correlation time of the lateral velocity.
    A : ndarray, shape (16, 16)
        Changed in place.
    """
    A[:, :] = 0.0
    vx, vy, vz = step[V_N], step[V_N + 1], step[V_N + 2]
    ix, iy, iz = step[OMEGA_IE], step[OMEGA_IE + 1], step[OMEGA_IE + 2]
    ex, ey, ez = step[TRANSPORT] * vy, -step[TRANSPORT + 1] * vx, -step[TRANSPORT + 2] * vy
    g, R = step[GRAVITY], step[RADIUS]
    coriolis = 2.0 * iz + ez
    A[0, 1], A[1, 0] = coriolis, -coriolis
    A[0, 2] = A[1, 3] = -g / R
    # v x (omega_ie x theta) = omega_ie (v . theta) - theta (v . omega_ie)
    v_dot_i = vx * ix + vy * iy + vz * iz
    A[0, 4], A[0, 5], A[0, 6] = ix * vx - v_dot_i, ix * vy - g, ix * vz
    A[1, 4], A[1, 5], A[1, 6] = iy * vx + g, iy * vy - v_dot_i, iy * vz
    A[2, 0] = A[3, 1] = 1.0
    A[2, 3], A[3, 2] = ez, -ez
    A[2, 5], A[2, 6] = vz, -vy  # theta x v
    A[3, 4], A[3, 6] = -vz, vx
    x, y, z = ix + ex, iy + ey, iz + ez
    A[4, 5], A[4, 6], A[5, 4], A[5, 6], A[6, 4], A[6, 5] = z, -y, -z, x, y, -x
    for i in range(2):
        for j in range(2):
            A[i, 10 + j] = step[C_NB + 3 * i + j]
            A[7 + i, j] = step[C_NB + 3 * j + i]
    A[8, 9] = 1.0
    A[9, 9] = -1.0 / lateral_time_s
    rate = step[TURN] / step[DT]
    for j in range(3):
        cx, cy, cz = step[C_NB + j], step[C_NB + 3 + j], step[C_NB + 6 + j]
        A[0, 13 + j], A[1, 13 + j] = vy * cz - vz * cy, vz * cx - vx * cz  # v x eps
        A[4, 13 + j], A[5, 13 + j], A[6, 13 + j] = cx, cy, cz
    for i in range(MOVE):
        A[i, 12] = A[i, 15] * rate


@inner
def product(A, B, out):
    """A B of two matrices whose last six rows are zero."""
    for i in range(MOVE):
        for j in range(CORE):
            out[i, j] = 0.0
        for k in range(MOVE):
            a = A[i, k]
            if a != 0.0:
                for j in range(CORE):
                    out[i, j] += a * B[k, j]


@inner
def transition(step, flags, noise, A, A2, A3, half, Phi, q, Q):
    """Transition and process noise of the core states over a step.

    The exponential to third order, Simpson's rule (ins.filters.error_model.discretize).

    Parameters
    ----------
    step : ndarray, shape (STEP_COLUMNS,)
    flags : ndarray of int64, shape (4,)
    noise : ndarray, shape (6,)
        As of `ProcessNoise.values`.
    A, A2, A3, half : ndarray, shape (16, 16)
        Room to work in.
    Phi : ndarray, shape (16, 16)
        Changed in place.
    q : ndarray, shape (12, 12)
        Room to work in.
    Q : ndarray, shape (12, 12)
        Its lower triangle is changed in place.
    """
    system(step, noise[LATERAL_TIME], A)
    product(A, A, A2)
    product(A2, A, A3)
    dt = step[DT]
    h = 0.5 * dt
    for i in range(CORE):
        for j in range(CORE):
            one = 1.0 if i == j else 0.0
            Phi[i, j] = one
            half[i, j] = one
            if i < MOVE:
                Phi[i, j] += dt * (A[i, j] + dt * (A2[i, j] / 2.0 + dt * A3[i, j] / 6.0))
                half[i, j] += h * (A[i, j] + h * (A2[i, j] / 2.0 + h * A3[i, j] / 6.0))
    density(A, flags[ROLLING] != 0, noise, q)
    for i in range(NOISY):
        for j in range(i + 1):
            Q[i, j] = dt / 6.0 * q[i, j]
    spread(half, q, 4.0 * dt / 6.0, Q)
    spread(Phi, q, dt / 6.0, Q)
    if flags[KEEP] == 0:
        Phi[7, 7] = Phi[8, 8] = 0.0  # the displacement of a step starts at zero
    if flags[ROLLING] == 0:
        Phi[9, 9] = Phi[8, 9] = 0.0
        Q[9, 9] = noise[LATERAL_RMS] * noise[LATERAL_RMS]
    for i in range(2):
        Q[i, i] += step[JUMP_W]
    for i in range(4, 7):
        Q[i, i] += step[JUMP_THETA]


@inner
def density(A, rolling, noise, q):
    """Spectral density q (12, 12) of the core states.

    Gyro noise enters theta and, through v x C_nb, w, just as the bias does.
    """
    q[:, :] = 0.0
    # products, since numba compiles x**2 as a loop over the bits of 2
    arw2, vrw2 = noise[ARW] * noise[ARW], noise[VRW] * noise[VRW]
    for i in range(7):
        for j in range(7):
            q[i, j] = arw2 * (A[i, 13] * A[j, 13] + A[i, 14] * A[j, 14] + A[i, 15] * A[j, 15])
    for i in range(2):
        q[i, i] += vrw2
        q[10 + i, 10 + i] = noise[ACCEL_RRW] * noise[ACCEL_RRW]
    if rolling:
        rms2 = noise[LATERAL_RMS] * noise[LATERAL_RMS]
        q[9, 9] = 2.0 * rms2 / noise[LATERAL_TIME]


@inner
def spread(M, q, weight, Q):
    """Add the lower triangle of weight M q M' to Q."""
    row = np.empty(NOISY)
    for i in range(NOISY):
        for k in range(NOISY):
            row[k] = 0.0
        for j in range(NOISY):
            m = M[i, j]
            if m != 0.0:
                for k in range(NOISY):
                    row[k] += m * q[j, k]
        for j in range(i + 1):
            total = 0.0
            for k in range(NOISY):
                total += row[k] * M[j, k]
            Q[i, j] += weight * total


@inner
def propagate(x, P, core, Phi, Q, jump_yaw, T, block):
    """x = F x, P = F P F' + Q, touching only the ten rows and columns that move.

    T (10, n), block (10, 10): scratch.
    """
    n = x.size
    for i in range(MOVE):
        block[i, 0] = 0.0
        for j in range(n):
            T[i, j] = 0.0
        for k in range(CORE):
            f = Phi[i, k]
            if f != 0.0:
                c = core[k]
                block[i, 0] += f * x[c]
                for j in range(n):
                    T[i, j] += f * P[c, j]
    for i in range(MOVE):
        x[core[i]] = block[i, 0]
    for i in range(MOVE):
        for j in range(i + 1):
            total = Q[i, j]
            for k in range(CORE):
                total += T[i, core[k]] * Phi[j, k]
            block[i, j] = total
    for i in range(MOVE, NOISY):
        for j in range(i + 1):
            if j < MOVE:
                T[j, core[i]] += Q[i, j]
            else:
                P[core[i], core[j]] += Q[i, j]
                if i != j:
                    P[core[j], core[i]] = P[core[i], core[j]]
    for i in range(MOVE):
        for j in range(n):
            P[core[i], j] = T[i, j]
            P[j, core[i]] = T[i, j]
    for i in range(MOVE):
        for j in range(i + 1):
            P[core[i], core[j]] = block[i, j]
            P[core[j], core[i]] = block[i, j]
    P[YAW, YAW] += jump_yaw


@inner
def expected(x, P, index, value, R, v):
    """v = P h; returns h x and h P h' + R of a sparse row h."""
    n = x.size
    for j in range(n):
        v[j] = 0.0
    hx = 0.0
    for k in range(index.size):
        c, a = index[k], value[k]
        if a != 0.0:
            hx += a * x[c]
            for j in range(n):
                v[j] += a * P[c, j]
    variance = R
    for k in range(index.size):
        variance += value[k] * v[index[k]]
    return hx, variance


@inner
def correct(x, P, v, residual, variance):
    """The optimal update by one scalar: x += v residual / S, P -= v v' / S.

    Symmetric to the last bit. Returns the innovation over its sigma.
    """
    n = x.size
    root = sqrt(variance)
    for j in range(n):
        v[j] /= root
    y = residual / root
    for i in range(n):
        a = v[i]
        x[i] += a * y
        if a != 0.0:
            for j in range(n):
                P[i, j] -= a * v[j]
    return y


@inner
def measure(x, P, index, value, z, R, gate, v, normalised, spread):
    """Rows (m) with independent noise, one after another; all or none pass the gate.

    Of refused rows, the innovations stand in `normalised` at the gate at most, each as if it were
    alone. Returns what became of them.
    """
    refused = False
    for r in range(z.size):
        hx, variance = expected(x, P, index[r], value[r], R[r], v)
        residual = z[r] - hx
        if not (residual - residual == 0.0 and variance - variance == 0.0):
            return NOT_FINITE
        if variance < 0.9 * R[r] or variance <= 0.0:
            return LOST
        if residual * residual > gate * gate * variance:
            refused = True
        spread[r] = variance
        normalised[r] = min(max(residual / sqrt(variance), -gate), gate)
    if refused:
        return REFUSED
    for r in range(z.size):
        hx, variance = expected(x, P, index[r], value[r], R[r], v)
        if variance < 0.9 * R[r] or variance <= 0.0:
            return LOST
        spread[r] = variance
        normalised[r] = correct(x, P, v, z[r] - hx, variance)
    return USED


# ways in for `ins.filters.error_model`
system_alone, transition_alone = entry(system), entry(transition)


@inner
def assign(x, P, target, index, value, variance, v):
    """State `target` becomes a combination of states plus independent noise (no entries: a fresh
    prior).
    """
    hx, total = expected(x, P, index, value, 0.0, v)
    x[target] = hx
    for j in range(x.size):
        P[target, j] = v[j]
        P[j, target] = v[j]
    P[target, target] = total + variance


@jit
def run(
    x,
    P,
    steps,
    flags,
    noise,
    ops,
    index,
    value,
    z,
    R,
    gate,
    outcome,
    normalised,
    spread,
    gain,
    filtered,
):
    """Work through a program.

    Parameters
    ----------
    x, P : ndarray, shapes (n,), (n, n)
        Changed in place.
    steps, flags : ndarray, shapes (K, 25), (K, 4)
        As of `ins.filters.program.Steps.table`.
    noise : ndarray, shape (6,)
        As of `ProcessNoise.values`.
    ops : ndarray of int64, shape (m, 4)
        Kind of operation, step or target, first row, rows.
    index, value : ndarray, shape (rows, nz)
        States and coefficients of each row.
    z, R : ndarray, shape (rows,)
        Measured values, variances.
    gate : ndarray, shape (m,)
        In sigmas.
    outcome : ndarray of int64, shape (m,)
        What became of each operation; written.
    normalised : ndarray, shape (rows,)
        Innovations over their sigma; written.
    spread : ndarray, shape (rows,)
        Variances of the innovations; written.
    gain : ndarray, shape (m,)
        Log of the ratio in variance of the cloned heading; written.
    filtered : ndarray, shape (bins, 2, 3)
        Bias and variance of each bin when it ended; written.

    Returns
    -------
    stopped : int
        The operation at which it stopped, being LOST or NOT_FINITE; -1: none.
    """
    n = x.size
    core = np.empty(CORE, np.int64)
    for k in range(BIAS):
        core[k] = POSITIONS[k]
    for k in range(3):
        core[BIAS + k] = BASE + k
    A, A2, A3 = np.zeros((CORE, CORE)), np.zeros((CORE, CORE)), np.zeros((CORE, CORE))
    half, Phi = np.zeros((CORE, CORE)), np.zeros((CORE, CORE))
    q, Q = np.zeros((NOISY, NOISY)), np.zeros((NOISY, NOISY))
    T, block, v = np.zeros((MOVE, n)), np.zeros((MOVE, MOVE)), np.zeros(n)
    step = np.empty(STEP_COLUMNS)
    for m in range(ops.shape[0]):
        kind, which, first, count = ops[m, 0], ops[m, 1], ops[m, 2], ops[m, 3]
        outcome[m] = USED
        if kind == ADVANCE:
            # step[:] = ... compiles text handling for an error message, 3 s
            for k in range(STEP_COLUMNS):
                step[k] = steps[which, k]
            if flags[which, MOVING] != 0:  # errors are linearised about the velocity less its error
                step[V_N] -= x[W]
                step[V_N + 1] -= x[W + 1]
            for k in range(3):
                core[BIAS + k] = BASE + 3 * flags[which, BIN] + k
            transition(step, flags[which], noise, A, A2, A3, half, Phi, q, Q)
            creep = noise[YAW_CREEP] * noise[YAW_CREEP] * step[DT]
            propagate(x, P, core, Phi, Q, creep + step[JUMP_YAW], T, block)
        elif kind == MEASURE:
            before = P[CLONE_DOWN, CLONE_DOWN]
            rows = slice(first, first + count)
            outcome[m] = measure(
                x,
                P,
                index[rows],
                value[rows],
                z[rows],
                R[rows],
                gate[m],
                v,
                normalised[rows],
                spread[rows],
            )
            if outcome[m] < 0:
                return m
            if before > 0.0 and outcome[m] == USED:
                gain[m] = np.log(before / P[CLONE_DOWN, CLONE_DOWN])
        elif kind == ADD:
            P[which, which] += R[first]
        else:
            assign(x, P, which, index[first], value[first], R[first], v)
        if kind == ADVANCE or kind == MEASURE:
            for k in range(3):
                b = core[BIAS + k]
                filtered[(core[BIAS] - BASE) // 3, 0, k] = x[b]
                filtered[(core[BIAS] - BASE) // 3, 1, k] = P[b, b]
    return -1
