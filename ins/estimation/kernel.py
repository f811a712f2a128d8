"""The compiled loop of the estimator: propagation and scalar updates without Python in between.
Import lazily.

Arrays in, arrays changed in place; SI and radians, silent; nothing is checked:
`ins.estimation.error_filter` does that.

Core order, twelve errors that move (`ins.estimation.states`): W 0-2, POS 3-5, THETA 6-8, S 9-10,
LATERAL 11. Those that take part in a run are its `moves`; `place` says where in the state each
stands. What sensors and gravity get wrong drives them through nine inputs: gyros 0-2 and
accelerometers 3-5 in body axes, acceleration north, east, down 6-8. All other states stand still,
drive through the tape's entries, or are set by its operations.
"""

from math import cos, sin, sqrt

import numpy as np

from ins.estimation import states
from ins.estimation.tape import (
    ADD,
    ADVANCE,
    ASSIGN,
    BIN,
    INPUTS,
    KEEP,
    LEAPT,
    LOST,
    MEASURE,
    MOVING,
    NOT_FINITE,
    RECORD,
    REFUSED,
    RENEW,
    RENEWED,
    ROLLING,
    SOLUTION,
    USED,
)
from ins.jit import entry, jit

# columns of a step
DT, C_NB, V_N, OMEGA_IE, TRANSPORT, GRAVITY, RADIUS = 0, 1, 10, 13, 16, 19, 20
JUMP_W, JUMP_THETA, STEP_COLUMNS = 21, 22, 23
ARW, VRW, LATERAL_RMS, LATERAL_TIME = 0, 1, 2, 3  # of the noise
# first core number of each error
W, POS, THETA = states.W.start, states.POS.start, states.THETA.start
S, LATERAL, CORE = states.S.start, states.LATERAL, states.CORE
GYROS, ACCELS, NED = 0, 3, 6  # first input of each kind
# what a solution that is begun anew is known to: attitude [rad]; m or m/s where it was not seen
RENEWED_TILT_RAD, UNSEEN_OFF = 0.02, 10.0
# gaps between refused positions that make a filter lost, however long they are: an outage counts
# as a fifth of the time at most; chosen
FEWEST_GAPS = 5.0
# only kernels call it: less to compile, but a call from Python would end the process
inner = jit(no_cpython_wrapper=True)


@inner
def system(step, lateral_time_s, A, B):
    """Fill A and B with the rates of the core errors (equations: ins.estimation.error_model).

    Parameters
    ----------
    step : ndarray, shape (STEP_COLUMNS,)
    lateral_time_s : float
        Correlation time of the lateral velocity.
    A : ndarray, shape (12, 12)
        By the core errors; changed in place.
    B : ndarray, shape (12, 9)
        By the inputs; changed in place.
    """
    A[:, :] = 0.0
    B[:, :] = 0.0
    g, R = step[GRAVITY], step[RADIUS]
    v_dot_i = 0.0
    for i in range(3):
        v_dot_i += step[V_N + i] * step[OMEGA_IE + i]
    en = (
        step[TRANSPORT] * step[V_N + 1],
        -step[TRANSPORT + 1] * step[V_N],
        -step[TRANSPORT + 2] * step[V_N + 1],
    )
    for i in range(3):
        # -omega x e of row i: omega of the one after next times the next component, and so on
        j, k = (i + 1) % 3, (i + 2) % 3
        ie_j, ie_k = step[OMEGA_IE + j], step[OMEGA_IE + k]
        A[W + i, W + j], A[W + i, W + k] = 2.0 * ie_k + en[k], -2.0 * ie_j - en[j]
        A[POS + i, POS + j], A[POS + i, POS + k] = en[k], -en[j]
        A[THETA + i, THETA + j], A[THETA + i, THETA + k] = ie_k + en[k], -ie_j - en[j]
        # v x (omega_ie x theta) = omega_ie (v . theta) - theta (v . omega_ie)
        for m in range(3):
            A[W + i, THETA + m] = step[OMEGA_IE + i] * step[V_N + m]
        A[W + i, THETA + i] -= v_dot_i
        A[POS + i, W + i] = 1.0
        # theta x v
        A[POS + i, THETA + j], A[POS + i, THETA + k] = step[V_N + k], -step[V_N + j]
        A[W + i, POS + i] = 2.0 * g / R if i == 2 else -g / R
        B[W + i, NED + i] = 1.0
        for m in range(3):
            C, C_j, C_k = (step[C_NB + 3 * i + m], step[C_NB + 3 * j + m], step[C_NB + 3 * k + m])
            B[THETA + i, GYROS + m] = C
            B[W + i, GYROS + m] = step[V_N + j] * C_k - step[V_N + k] * C_j  # v x eps
            B[W + i, ACCELS + m] = C
            if m < 2:
                A[S + m, W + i] = C
    A[W, THETA + 1] -= g  # -theta x g
    A[W + 1, THETA] += g
    A[S + 1, LATERAL] = 1.0
    A[LATERAL, LATERAL] = -1.0 / lateral_time_s


@inner
def product(A, X, moves, out):
    """A X over the errors that take part."""
    for i in moves:
        for j in range(X.shape[1]):
            out[i, j] = 0.0
        for k in moves:
            a = A[i, k]
            if a != 0.0:
                for j in range(X.shape[1]):
                    out[i, j] += a * X[k, j]


@inner
def transition(step, flags, noise, moves, room, Phi, Gamma, Q):
    """Transition, input and process noise of the core errors over a step.

    The exponential to third order, Simpson's rule (ins.estimation.error_model.discretize).

    Parameters
    ----------
    step : ndarray, shape (STEP_COLUMNS,)
    flags : ndarray of int64, shape (4,)
    noise : ndarray, shape (4,)
        As of `ProcessNoise.values`.
    moves : ndarray of int64, shape (m,)
        Numbers of the core errors that take part.
    room : ndarray, shape (5, 12, 12)
        Room to work in.
    Phi : ndarray, shape (12, 12)
        Changed in place.
    Gamma : ndarray, shape (12, 9)
        From what each input is wrong by over the step; changed in place.
    Q : ndarray, shape (12, 12)
        Its lower triangle is changed in place.
    """
    A, A2, A3, half, q = room[0], room[1], room[2], room[3], room[4]
    B, AB, A2B = np.empty((CORE, INPUTS)), np.empty((CORE, INPUTS)), np.empty((CORE, INPUTS))
    system(step, noise[LATERAL_TIME], A, B)
    product(A, A, moves, A2)
    product(A2, A, moves, A3)
    product(A, B, moves, AB)
    product(A2, B, moves, A2B)
    dt = step[DT]
    h = 0.5 * dt
    for i in moves:
        for j in moves:
            one = 1.0 if i == j else 0.0
            Phi[i, j] = one + dt * (A[i, j] + dt * (A2[i, j] / 2.0 + dt * A3[i, j] / 6.0))
            half[i, j] = one + h * (A[i, j] + h * (A2[i, j] / 2.0 + h * A3[i, j] / 6.0))
        for j in range(INPUTS):
            Gamma[i, j] = dt * (B[i, j] + dt * (AB[i, j] / 2.0 + dt * A2B[i, j] / 6.0))
    density(B, flags[ROLLING] != 0, noise, moves, q)
    for i in moves:
        for j in moves:
            Q[i, j] = dt / 6.0 * q[i, j]
    spread(half, q, 4.0 * dt / 6.0, moves, Q)
    spread(Phi, q, dt / 6.0, moves, Q)
    if flags[KEEP] == 0:
        Phi[S, S] = Phi[S + 1, S + 1] = 0.0  # the displacement of a step starts at zero
    if flags[ROLLING] == 0:
        Phi[LATERAL, LATERAL] = Phi[S + 1, LATERAL] = 0.0
        Q[LATERAL, LATERAL] = noise[LATERAL_RMS] * noise[LATERAL_RMS]
    for i in range(3):
        Q[W + i, W + i] += step[JUMP_W]
        Q[THETA + i, THETA + i] += step[JUMP_THETA]


@inner
def density(B, rolling, noise, moves, q):
    """Spectral density q (12, 12) of the core errors.

    Gyro noise enters theta and, through v x C_nb, w, just as the bias does.
    """
    # products, since numba compiles x**2 as a loop over the bits of 2
    arw2, vrw2 = noise[ARW] * noise[ARW], noise[VRW] * noise[VRW]
    for i in moves:
        for j in moves:
            total = 0.0
            for k in range(GYROS, ACCELS):
                total += B[i, k] * B[j, k]
            q[i, j] = arw2 * total
        if i < POS:
            q[i, i] += vrw2
    if rolling:
        q[LATERAL, LATERAL] = 2.0 * noise[LATERAL_RMS] * noise[LATERAL_RMS] / noise[LATERAL_TIME]


@inner
def spread(M, q, weight, moves, Q):
    """Add the lower triangle of weight M q M' to Q."""
    row = np.empty(CORE)
    for i in moves:
        for k in moves:
            row[k] = 0.0
        for j in moves:
            m = M[i, j]
            if m != 0.0:
                for k in moves:
                    row[k] += m * q[j, k]
        for j in moves:
            if j > i:
                break
            total = 0.0
            for k in moves:
                total += row[k] * M[j, k]
            Q[i, j] += weight * total


@inner
def drive(Gamma, moves, first, last, state, target, value, driven, G):
    """What one unit of each driving state adds to the core errors over a step: columns of G
    (12, d), their states in driven (d,). The entries are those from first to last - 1; those of one
    state stand together. Returns how many.
    """
    count = 0
    for e in range(first, last):
        if count == 0 or driven[count - 1] != state[e]:
            driven[count] = state[e]
            for i in moves:
                G[i, count] = 0.0
            count += 1
        for i in moves:
            G[i, count - 1] += value[e] * Gamma[i, target[e]]
    return count


@inner
def propagate(x, P, moves, place, Phi, Q, driven, count, G, walk, density_of, dt, T, block):
    """x = F x, P = F P F' + Q, touching only the rows and columns that move or walk.

    driven, count, G: as of `drive`; walk, density_of (w,): states that walk at random, which
    may drive meanwhile; T (12, n), block (12, 12): scratch.
    """
    n = x.size
    for i in moves:
        total = 0.0
        for j in range(n):
            T[i, j] = 0.0
        for k in moves:
            f = Phi[i, k]
            if f != 0.0:
                c = place[k]
                total += f * x[c]
                for j in range(n):
                    T[i, j] += f * P[c, j]
        for d in range(count):
            f = G[i, d]
            if f != 0.0:
                c = driven[d]
                total += f * x[c]
                for j in range(n):
                    T[i, j] += f * P[c, j]
        block[i, 0] = total
    for i in moves:
        x[place[i]] = block[i, 0]
    for i in moves:
        for j in moves:
            if j > i:
                break
            total = Q[i, j]
            for k in moves:
                total += T[i, place[k]] * Phi[j, k]
            for d in range(count):
                total += T[i, driven[d]] * G[j, d]
            block[i, j] = total
    for w in range(walk.size):
        added = density_of[w] * dt
        P[walk[w], walk[w]] += added
        for d in range(count):
            if driven[d] == walk[w]:
                # of a walk from zero: its mean over the step, and the mean's square
                for i in moves:
                    T[i, walk[w]] += 0.5 * added * G[i, d]
                    for j in moves:
                        if j > i:
                            break
                        block[i, j] += added / 3.0 * G[i, d] * G[j, d]
    for i in moves:
        for j in range(n):
            P[place[i], j] = T[i, j]
            P[j, place[i]] = T[i, j]
    for i in moves:
        for j in moves:
            if j > i:
                break
            P[place[i], place[j]] = block[i, j]
            P[place[j], place[i]] = block[i, j]


@inner
def expected(x, P, first, last, index, value, R, v):
    """v = P h; returns h x and h P h' + R of a sparse row h."""
    n = x.size
    for j in range(n):
        v[j] = 0.0
    hx = 0.0
    for k in range(first, last):
        c, a = index[k], value[k]
        if a != 0.0:
            hx += a * x[c]
            for j in range(n):
                v[j] += a * P[c, j]
    variance = R
    for k in range(first, last):
        variance += value[k] * v[index[k]]
    return hx, variance


@inner
def correct(x, P, v, residual, variance, considered):
    """The optimal update by one scalar: x += v residual / S, P -= v v' / S.

    Symmetric to the last bit. States from `considered` on are left as they are (Schmidt's filter;
    Jazwinski 1970, section 8.2). v becomes the gain over the innovation's sigma. Returns the
    innovation over its sigma.
    """
    n = x.size
    root = sqrt(variance)
    for j in range(n):
        v[j] /= root
    y = residual / root
    for i in range(n):
        a = v[i]
        if i < considered:
            x[i] += a * y
        if a != 0.0:
            for j in range(n if i < considered else considered):
                P[i, j] -= a * v[j]
    return y


@inner
def measure(
    x,
    P,
    first,
    last,
    first_entry,
    index,
    value,
    z,
    R,
    gate,
    v,
    normalised,
    spread,
    gains,
    alone,
    considered,
):
    """Rows first to last - 1 with independent noise, one after another; all or none pass the gate.

    Of refused rows, the innovations stand in `normalised` at the gate at most, each as if it were
    alone. gains (rows, n): written where it has rows; alone (rows, 2): innovation of each row as if
    it were alone, and its variance. Returns what became of them.
    """
    refused = False
    for r in range(first, last):
        hx, variance = expected(x, P, first_entry[r], first_entry[r + 1], index, value, R[r], v)
        residual = z[r] - hx
        if not (residual - residual == 0.0 and variance - variance == 0.0):
            return NOT_FINITE
        if variance < 0.9 * R[r] or variance <= 0.0:
            return LOST
        if residual * residual > gate * gate * variance:
            refused = True
        spread[r] = variance
        normalised[r] = min(max(residual / sqrt(variance), -gate), gate)
        alone[r, 0], alone[r, 1] = residual, variance
    if refused:
        return REFUSED
    for r in range(first, last):
        hx, variance = expected(x, P, first_entry[r], first_entry[r + 1], index, value, R[r], v)
        if variance < 0.9 * R[r] or variance <= 0.0:
            return LOST
        spread[r] = variance
        normalised[r] = correct(x, P, v, z[r] - hx, variance, considered)
        if gains.shape[0] > 0:
            for j in range(considered):
                gains[r, j] = v[j]
    return USED


@inner
def rotation_of(a, E):
    """E (3, 3) = exp([a x])."""
    square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
    size = sqrt(square)
    # their limits to 2e-9 of themselves below 1e-4 rad
    s = sin(size) / size if size > 1e-4 else 1.0 - square / 6.0
    c = (1.0 - cos(size)) / square if size > 1e-4 else 0.5
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            E[i, m] = c * a[i] * a[m]
        E[i, i] += 1.0 - c * square
        E[i, j] -= s * a[k]
        E[i, k] += s * a[j]


@inner
def turn_by(E, turn, M, left, right):
    """turn (3, 3) <- E turn, turn E' or E turn E'; M (3, 3) is room."""
    for side in range(2):
        if (side == 0 and left) or (side == 1 and right):
            for i in range(3):
                for m in range(3):
                    M[m, i] = E[i, 0] * turn[0, m] + E[i, 1] * turn[1, m] + E[i, 2] * turn[2, m]
        else:
            for i in range(3):
                for m in range(3):
                    M[m, i] = turn[i, m]
        for i in range(3):
            for m in range(3):
                turn[i, m] = M[i, m]  # transposed: from its other side next, and back


@inner
def feed_back(x, place, travels, turn, room):
    """The attitude's error goes into turn (3, 3), by which the solution is off its reference.

    w is then about an attitude without it; travels (3,): the velocity that w is about.
    """
    a = room[2, 0]
    for i in range(3):
        a[i] = -x[place[THETA + i]]
        x[place[THETA + i]] = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        x[place[W + i]] -= a[j] * travels[k] - a[k] * travels[j]
    rotation_of(a, room[0])
    turn_by(room[0], turn, room[1], True, False)


@inner
def set_about(x, P, place, off, new):
    """w is from now on about the reference's velocity less `new`, not less off (3,), in place."""
    d = (new[0] - off[0], new[1] - off[1], new[2] - off[2])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        w, a, b = place[W + i], place[THETA + j], place[THETA + k]
        x[w] += d[k] * x[a] - d[j] * x[b]
        for m in range(x.size):
            P[w, m] += d[k] * P[a, m] - d[j] * P[b, m]
        for m in range(x.size):
            P[m, w] += d[k] * P[m, a] - d[j] * P[m, b]
        off[i] = new[i]


@inner
def turn_rows(first, count, first_entry, index, value, z, levers, states, place, turn, off):
    """Rows of a measurement of a turned solution, z and value in place; of its velocity is off (3,)
    less than that of the reference. levers, states: as of `sweep`.
    """
    for r in range(first, first + count):
        of, a, b = levers[r], first_entry[r], first_entry[r + 1]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            # turned less not turned, of what turns
            more_j, more_k = -of[9 + j], -of[9 + k]
            for m in range(3):
                one = 1.0 if i == m else 0.0
                z[r] += of[i] * (turn[i, m] - one) * of[3 + m]
                more_j += turn[j, m] * of[9 + m]
                more_k += turn[k, m] * of[9 + m]
            # theta x d of row a is theta times d x a
            added = more_j * of[k] - more_k * of[j] - (off[j] * of[6 + k] - off[k] * of[6 + j])
            if added != 0.0:
                for e in range(a, b):
                    if index[e] == place[THETA + i]:
                        value[e] += added
                        break
    if count != 3 or (levers[first, 0] == 0.0):
        return
    entry = np.zeros(3, np.int64)
    for s in range(states.shape[0]):
        found = 0
        for i in range(3):
            for e in range(first_entry[first + i], first_entry[first + i + 1]):
                if index[e] == states[s, 0]:
                    entry[i] = e
                    found += 1
                    break
        if found < 3:
            continue
        rest = float(states[s, 1])
        x = value[entry[0]] - rest * levers[first, 12]
        y = value[entry[1]] - rest * levers[first, 13]
        w = value[entry[2]] - rest * levers[first, 14]
        for i in range(3):
            value[entry[i]] = (
                rest * levers[first, 12 + i] + turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * w
            )


@inner
def turn_step(step, turn):
    """The attitude of a step, turned."""
    for m in range(3):
        a, b, c = step[C_NB + m], step[C_NB + 3 + m], step[C_NB + 6 + m]
        for i in range(3):
            step[C_NB + 3 * i + m] = turn[i, 0] * a + turn[i, 1] * b + turn[i, 2] * c


@inner
def set_turned(x, place, step, shift, push, turn, room):
    """Errors of a turned solution at the end of a step: it is set to velocity and place of its
    reference there, and keeps the attitude that its gyros give it.

    shift (9,): as of the reference; push (9,): velocity that the reference gains by its specific
    force over the step, the velocity at its end that w is about, and by how much it gets further
    than by the mean of its velocities.
    """
    dt, a, less = step[DT], room[2, 0], room[2, 1]
    a[0] = -dt * (step[OMEGA_IE] + step[TRANSPORT] * step[V_N + 1])
    a[1] = -dt * (step[OMEGA_IE + 1] - step[TRANSPORT + 1] * step[V_N])
    a[2] = -dt * (step[OMEGA_IE + 2] - step[TRANSPORT + 2] * step[V_N + 1])
    for i in range(3):
        less[i] = push[i]
        lag = push[6 + i]
        for k in range(3):
            less[i] -= turn[i, k] * push[k]
            lag -= turn[i, k] * push[6 + k]
        x[place[POS + i]] += shift[POS + i] + lag
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # half of the rotation of the frame
        gained = less[i] + 0.5 * (a[j] * less[k] - a[k] * less[j])
        jump = shift[THETA + j] * push[3 + k] - shift[THETA + k] * push[3 + j]
        x[place[W + i]] += shift[W + i] + jump + gained
        x[place[POS + i]] += 0.5 * dt * gained
    rotation_of(a, room[0])
    turn_by(room[0], turn, room[1], True, True)
    for i in range(3):
        a[i] = shift[THETA + i]
    rotation_of(a, room[0])
    turn_by(room[0], turn, room[1], False, True)


# ways in for `ins.estimation.error_model`
system_alone, transition_alone = entry(system), entry(transition)


@inner
def assign(x, P, target, first, last, index, value, variance, v):
    """State `target` becomes a combination of states plus independent noise (no entries: a fresh
    prior).
    """
    hx, total = expected(x, P, first, last, index, value, 0.0, v)
    x[target] = hx
    for j in range(x.size):
        P[target, j] = v[j]
        P[j, target] = v[j]
    P[target, target] = total + variance


@inner
def renew(
    x,
    P,
    place,
    ops,
    m,
    first_entry,
    index,
    value,
    z,
    R,
    after_s,
    clock_s,
    lost,
    leapt,
    v,
    outcome,
    normalised,
    spread,
    gains,
    alone,
    considered,
):
    """Begin a lost filter anew: one that refuses the positions of fixes for after_s (0: none).

    Operation m follows the measurements of its fix: position, and velocity where there is one; its
    row names the states of the position's slow error. Where the velocity fits, the positions leapt:
    either those before or those from now on are off, and position and slow error take what was
    seen, both alike. Else velocity and position are known no better than they were seen to be off.
    lost (2,): seconds between refused positions, and when the last one was (0: none); leapt (n,):
    variance that keeps slow errors as large for their time constant. Returns what became of it.
    """
    count = ops[m, 1]
    first = ops[m - count, 2]
    if outcome[m - count] == USED:
        lost[0] = lost[1] = 0.0
        return USED
    if lost[1] != 0.0:
        lost[0] += min(clock_s - lost[1], after_s / FEWEST_GAPS)
    lost[1] = clock_s
    if not 0.0 < after_s <= lost[0]:
        return REFUSED
    lost[0] = lost[1] = 0.0
    became = RENEWED
    if count == 2 and outcome[m - 1] == USED:
        became = LEAPT
        count = 1
        for i in range(3):
            seen = alone[first + i, 0]
            slow = index[first_entry[ops[m, 2]] + i]
            P[place[POS + i], place[POS + i]] += seen * seen
            P[slow, slow] += seen * seen
            leapt[slow] = max(leapt[slow], seen * seen)
    else:
        for i in range(6):
            c = place[W + i]
            seen = alone[first + i - POS, 0] if i >= POS else UNSEEN_OFF
            if i < POS and count == 2:
                seen = alone[ops[m - 1, 2] + i, 0]
            for j in range(x.size):
                P[c, j] = P[j, c] = 0.0
            P[c, c] = seen * seen + 1.0
        for i in range(3):
            P[place[THETA + i], place[THETA + i]] += RENEWED_TILT_RAD * RENEWED_TILT_RAD
    for o in range(m - ops[m, 1], m - ops[m, 1] + count):
        measure(
            x,
            P,
            ops[o, 2],
            ops[o, 2] + ops[o, 3],
            first_entry,
            index,
            value,
            z,
            R,
            np.inf,
            v,
            normalised,
            spread,
            gains,
            alone,
            considered,
        )
    return became


@jit
def sweep(
    x,
    P,
    moves,
    place,
    steps,
    flags,
    shifts,
    noise,
    walk,
    density_of,
    drive_first,
    drive_state,
    drive_target,
    drive_value,
    ops,
    first_entry,
    index,
    value,
    z,
    R,
    gate,
    watched,
    bins,
    outcome,
    normalised,
    spread,
    gain,
    filtered,
    gains,
    alone,
    considered,
    recorded,
    x_rows,
    P_rows,
    pushes,
    levers,
    turning_states,
    turn,
    turns,
):
    """Work through a tape.

    Parameters
    ----------
    x, P : ndarray, shapes (n,), (n, n)
        Changed in place.
    moves : ndarray of int64, shape (m,)
        Numbers of the core errors that take part, ascending.
    place : ndarray of int64, shape (12,)
        Where in x each core error stands.
    steps, flags : ndarray, shapes (K, 23), (K, 4)
        As of `ins.estimation.tape.Steps.table`.
    shifts : ndarray, shape (K, 9) or (0, 9)
        How much larger the errors w, p, theta are after each step because the solution was set
        anew there.
    noise : ndarray, shape (4,)
        As of `ProcessNoise.values`.
    walk, density_of : ndarray, shape (w,)
        States that walk at random, and the variance that each gains in a second.
    drive_first : ndarray of int64, shape (K + 1,)
        First of the entries of each step.
    drive_state, drive_target, drive_value : ndarray, shape (entries,)
        State, input and what one unit of the state makes the input wrong by.
    ops : ndarray of int64, shape (m, 4)
        Kind of operation, step or target, first row, rows.
    first_entry : ndarray of int64, shape (rows + 1,)
        First of the entries of each row.
    index, value : ndarray, shape (entries,)
        States and coefficients.
    z, R : ndarray, shape (rows,)
        Measured values, variances.
    gate : ndarray, shape (m,)
        In sigmas.
    watched : int
        The state whose variance `gain` is about.
    bins : ndarray of int64, shape (bins, 3)
        Where in x each bin's bias stands.
    outcome : ndarray of int64, shape (m,)
        What became of each operation; written.
    normalised : ndarray, shape (rows,)
        Innovations over their sigma; written.
    spread : ndarray, shape (rows,)
        Variances of the innovations; written.
    gain : ndarray, shape (m,)
        Log of the ratio in variance of the watched state; written.
    filtered : ndarray, shape (bins, 2, 3)
        Bias and variance of each bin when it ended; written.
    gains : ndarray, shape (rows, n) or (0, n)
        Gain of each row over its innovation's sigma; written where it has rows.
    alone : ndarray, shape (rows, 2)
        Innovation of each row as if it were measured alone, and its variance; written.
    considered : int
        The place from which on states are not estimated.
    recorded : ndarray of int64, shape (q,)
        Places of the states whose covariance is recorded.
    x_rows, P_rows : ndarray, shapes (records, n), (records, q, q)
        Written at each RECORD.
    pushes : ndarray, shape (K, 10) or (0, 10)
        Where it has rows, attitudes are fed back: as of `ins.estimation.error_filter.FedBack`.
    levers : ndarray, shape (rows, 15) or (0, 15)
        As of `FedBack`; z and value are changed in place.
    turning_states : ndarray of int64, shape (q, 2)
        Places of those of `FedBack`, and whether all turns.
    turn : ndarray, shape (3, 3)
        From the reference to the attitude that is fed back; changed in place.
    turns : ndarray, shape (records, 3, 3)
        Written at each RECORD where attitudes are fed back.

    Returns
    -------
    stopped : int
        The operation at which it stopped, being LOST or NOT_FINITE; -1: none.
    """
    n, now_bin = x.size, 0
    room = np.zeros((5, CORE, CORE))
    Phi, Q, Gamma = np.zeros((CORE, CORE)), np.zeros((CORE, CORE)), np.zeros((CORE, INPUTS))
    driven, G = np.zeros(n, np.int64), np.zeros((CORE, n))
    T, block, v = np.zeros((CORE, n)), np.zeros((CORE, CORE)), np.zeros(n)
    step, turning, closed = np.empty(STEP_COLUMNS), np.zeros((3, 3, 3)), pushes.shape[0] > 0
    clock_s, lost, leapt, written = 0.0, np.zeros(2), np.zeros(n), 0
    off, none, own = np.zeros(3), np.zeros(3), np.zeros(3)
    less = np.zeros(3)
    for m in range(ops.shape[0]):
        kind, which, first, count = ops[m, 0], ops[m, 1], ops[m, 2], ops[m, 3]
        outcome[m] = USED
        if kind == ADVANCE:
            # step[:] = ... compiles text handling for an error message, 3 s
            for k in range(STEP_COLUMNS):
                step[k] = steps[which, k]
            if flags[which, MOVING] != 0:  # errors are linearised about the velocity less its error
                for i in moves:
                    if i < POS:
                        step[V_N + i] -= x[place[i]]
            if closed:
                for i in range(3):
                    own[i] = pushes[max(which - 1, 0), 3 + i] - off[i]
                feed_back(x, place, own, turn, turning)
                turn_step(step, turn)
                for i in range(3):
                    own[i] = x[place[W + i]]
                set_about(x, P, place, off, own)
                for i in range(3):
                    less[i] = pushes[which, i]
                    for k in range(3):
                        less[i] -= turn[i, k] * pushes[which, k]
                    step[V_N + i] -= off[i] + 0.5 * pushes[which, 9] * less[i]
            now_bin = flags[which, BIN]
            transition(step, flags[which], noise, moves, room, Phi, Gamma, Q)
            used = drive(
                Gamma,
                moves,
                drive_first[which],
                drive_first[which + 1],
                drive_state,
                drive_target,
                drive_value,
                driven,
                G,
            )
            propagate(
                x, P, moves, place, Phi, Q, driven, used, G, walk, density_of, step[DT], T, block
            )
            clock_s += step[DT]
            if closed:
                set_turned(x, place, step, shifts[which], pushes[which], turn, turning)
                for i in range(3):
                    off[i] = x[place[W + i]]
            elif shifts.shape[0] > 0:
                for i in moves:
                    if i < SOLUTION:
                        x[place[i]] += shifts[which, i]
        elif kind == MEASURE:
            if closed:
                turn_rows(
                    first,
                    count,
                    first_entry,
                    index,
                    value,
                    z,
                    levers,
                    turning_states,
                    place,
                    turn,
                    off,
                )
            before = P[watched, watched]
            outcome[m] = measure(
                x,
                P,
                first,
                first + count,
                first_entry,
                index,
                value,
                z,
                R,
                gate[m],
                v,
                normalised,
                spread,
                gains,
                alone,
                considered,
            )
            if outcome[m] < 0:
                return m
            if before > 0.0 and outcome[m] == USED:
                gain[m] = np.log(before / P[watched, watched])
        elif kind == ADD:
            P[which, which] += R[first]
        elif kind == RENEW:
            outcome[m] = renew(
                x,
                P,
                place,
                ops,
                m,
                first_entry,
                index,
                value,
                z,
                R,
                gate[m],
                clock_s,
                lost,
                leapt,
                v,
                outcome,
                normalised,
                spread,
                gains,
                alone,
                considered,
            )
        elif kind == RECORD:
            if closed:
                set_about(x, P, place, off, none)
            for i in range(n):
                x_rows[written, i] = x[i]
            for i in range(recorded.size):
                for j in range(recorded.size):
                    P_rows[written, i, j] = P[recorded[i], recorded[j]]
            if closed:
                for i in range(3):
                    for k in range(3):
                        turns[written, i, k] = turn[i, k]
            written += 1
        else:
            added = R[first]
            if leapt[which] > 0.0:  # an error that fades: what a leap made it goes on for as long
                kept = value[first_entry[first]]
                added += leapt[which] * (1.0 - kept * kept)
                leapt[which] *= kept * kept
            assign(x, P, which, first_entry[first], first_entry[first + 1], index, value, added, v)
        if (kind == ADVANCE or kind == MEASURE) and now_bin < bins.shape[0]:
            for k in range(3):
                b = bins[now_bin, k]
                filtered[now_bin, 0, k] = x[b]
                filtered[now_bin, 1, k] = P[b, b]
    if closed:
        set_about(x, P, place, off, none)
    return -1


@jit
def respond(
    E,
    moves,
    place,
    steps,
    flags,
    noise,
    drive_first,
    drive_state,
    drive_target,
    drive_value,
    ops,
    first_entry,
    index,
    value,
    outcome,
    spread,
    gains,
    sensed,
    measured,
    out,
):
    """What further columns add to the innovations of a sweep, by its own gains.

    A column holds what the errors are less what the filter takes them for: e- = Phi e + u,
    nu = H e + m, e+ = e- - K nu.

    Parameters
    ----------
    E : ndarray, shape (n, m)
        The columns at the start; changed in place.
    moves, place, steps, flags, noise, drive_first, drive_state, drive_target, drive_value, ops, \
first_entry, index, value : as of `sweep`
    outcome, spread, gains : as `sweep` wrote them
    sensed : ndarray, shape (K, 9, m)
        What the inputs are wrong by over each step.
    measured : ndarray, shape (rows, m)
        What each row's measured value is changed by.
    out : ndarray, shape (rows, m)
        Innovations over their sigmas; written where the row was used.
    """
    n, m = E.shape
    room = np.zeros((5, CORE, CORE))
    Phi, Q, Gamma = np.zeros((CORE, CORE)), np.zeros((CORE, CORE)), np.zeros((CORE, INPUTS))
    driven, G, moved = np.zeros(n, np.int64), np.zeros((CORE, n)), np.zeros((CORE, m))
    nu = np.zeros(m)
    for o in range(ops.shape[0]):
        kind, which, first, count = ops[o, 0], ops[o, 1], ops[o, 2], ops[o, 3]
        if kind == ADVANCE:
            transition(steps[which], flags[which], noise, moves, room, Phi, Gamma, Q)
            used = drive(
                Gamma,
                moves,
                drive_first[which],
                drive_first[which + 1],
                drive_state,
                drive_target,
                drive_value,
                driven,
                G,
            )
            for i in moves:
                for j in range(m):
                    moved[i, j] = 0.0
                for k in moves:
                    add_row(moved[i], Phi[i, k], E[place[k]])
                for d in range(used):
                    add_row(moved[i], G[i, d], E[driven[d]])
                for k in range(INPUTS):
                    add_row(moved[i], Gamma[i, k], sensed[which, k])
            for i in moves:
                for j in range(m):
                    E[place[i], j] = moved[i, j]
        elif kind == MEASURE:
            if outcome[o] != USED:
                continue
            for r in range(first, first + count):
                root = sqrt(spread[r])
                for j in range(m):
                    nu[j] = measured[r, j]
                for k in range(first_entry[r], first_entry[r + 1]):
                    add_row(nu, value[k], E[index[k]])
                for j in range(m):
                    nu[j] /= root
                    out[r, j] = nu[j]
                for i in range(n):
                    add_row(E[i], -gains[r, i], nu)
        elif kind == ASSIGN:
            for j in range(m):
                nu[j] = 0.0
            for k in range(first_entry[first], first_entry[first + 1]):
                add_row(nu, value[k], E[index[k]])
            for j in range(m):
                E[which, j] = nu[j]


@inner
def add_row(to, factor, row):
    """to (m,) += factor row."""
    if factor != 0.0:
        for j in range(to.size):
            to[j] += factor * row[j]


@inner
def back_through_row(first, last, index, value, normalised, spread, gain, lam, Lam, u):
    """The adjoints before a scalar measurement with row h, innovation y of variance s, gain K::

        lam <- (1 - K h)' lam + h' y / s,    Lam <- (1 - K h)' Lam (1 - K h) + h' h / s

    One side after the other: multiplied out, the rounding of what a fix knows to a centimetre would
    stay beside what is left of it after an outage.
    """
    n, root = lam.size, sqrt(spread)
    seen = normalised
    for i in range(n):
        seen -= gain[i] * lam[i]
        u[i] = 0.0
    for i in range(n):
        add_row(u, gain[i] / root, Lam[i])
    for k in range(first, last):
        lam[index[k]] += value[k] * seen / root
        add_row(Lam[index[k]], -value[k], u)
    for i in range(n):
        u[i] = 0.0
        for j in range(n):
            u[i] -= Lam[i, j] * gain[j] / root
    for k in range(first, last):
        u[index[k]] += value[k] / spread
    for k in range(first, last):
        for i in range(n):
            Lam[i, index[k]] += u[i] * value[k]


@inner
def back_through_map(Phi, moves, place, driven, count, G, X, M):
    """X (n, m) <- Phi' X of a step: its rows; M (12, m) is room."""
    for k in moves:
        for j in range(X.shape[1]):
            M[k, j] = 0.0
        for i in moves:
            add_row(M[k], Phi[i, k], X[place[i]])
    for d in range(count):
        for i in moves:
            add_row(X[driven[d]], G[i, d], X[place[i]])
    for k in moves:
        for j in range(X.shape[1]):
            X[place[k], j] = M[k, j]


@inner
def back_through_assignment(target, first, last, index, value, X, u):
    """X (n, m) <- its rows before state `target` became a combination of the others."""
    for j in range(X.shape[1]):
        u[j] = X[target, j]
        X[target, j] = 0.0
    for k in range(first, last):
        add_row(X[index[k]], value[k], u)


@inner
def transpose(X):
    """X to X' in place."""
    for i in range(X.shape[0]):
        for j in range(i):
            X[i, j], X[j, i] = X[j, i], X[i, j]


@jit
def smooth(
    moves,
    place,
    steps,
    flags,
    noise,
    drive_first,
    drive_state,
    drive_target,
    drive_value,
    ops,
    first_entry,
    index,
    value,
    outcome,
    normalised,
    spread,
    gains,
    lam,
    Lam,
    kept,
    x_rows,
    P_rows,
    P_kept,
):
    """From the end of a tape to its beginning: what was recorded, given all measurements.

    The modified form of Bryson and Frazier: adjoints lam (n,) and Lam (n, n) gather what later
    measurements say of the errors, and at each record::

        x_s = x + P lam,    P_s = P - P Lam P

    No covariance is inverted, and process noise does not enter. Bierman (1977), section X.5;
    Bierman, Automatica 9 (1973), 503-511, for scalar measurements.

    Parameters
    ----------
    moves, place, steps, flags, noise, drive_first, drive_state, drive_target, drive_value, ops, \
first_entry, index, value : as of `sweep`
    outcome, normalised, spread, gains : as `sweep` wrote them
    lam, Lam : ndarray, shapes (n,), (n, n)
        Zero; at the end what all measurements say of the start.
    kept : ndarray of int64, shape (q,)
        Places of the states whose covariance is wanted.
    x_rows : ndarray, shape (records, n)
        As recorded; changed in place.
    P_rows : ndarray, shape (records, n, n)
        As recorded of all states.
    P_kept : ndarray, shape (records, q, q)
        Written.
    """
    n, row = lam.size, x_rows.shape[0]
    room = np.zeros((5, CORE, CORE))
    Phi, Q, Gamma = np.zeros((CORE, CORE)), np.zeros((CORE, CORE)), np.zeros((CORE, INPUTS))
    driven, G, M = np.zeros(n, np.int64), np.zeros((CORE, n)), np.zeros((CORE, n))
    u, column = np.zeros(n), lam.reshape(n, 1)
    for m in range(ops.shape[0] - 1, -1, -1):
        kind, which, first = ops[m, 0], ops[m, 1], ops[m, 2]
        if kind == RECORD:
            row -= 1
            P = P_rows[row]
            for i in range(n):
                for j in range(n):
                    x_rows[row, i] += P[i, j] * lam[j]
            for i in range(kept.size):
                for j in range(n):
                    u[j] = 0.0
                for j in range(n):
                    add_row(u, P[kept[i], j], Lam[j])
                for k in range(kept.size):
                    total = P[kept[i], kept[k]]
                    for j in range(n):
                        total -= u[j] * P[j, kept[k]]
                    P_kept[row, i, k] = total
        elif kind == ADVANCE:
            transition(steps[which], flags[which], noise, moves, room, Phi, Gamma, Q)
            used = drive(
                Gamma,
                moves,
                drive_first[which],
                drive_first[which + 1],
                drive_state,
                drive_target,
                drive_value,
                driven,
                G,
            )
            back_through_map(Phi, moves, place, driven, used, G, column, M)
            for _ in range(2):
                back_through_map(Phi, moves, place, driven, used, G, Lam, M)
                transpose(Lam)
        elif kind == ASSIGN:
            a, b = first_entry[first], first_entry[first + 1]
            back_through_assignment(which, a, b, index, value, column, u)
            for _ in range(2):
                back_through_assignment(which, a, b, index, value, Lam, u)
                transpose(Lam)
        elif (kind == MEASURE and outcome[m] == USED) or (kind == RENEW and outcome[m] > USED):
            of_fix = which if kind == RENEW else 0  # operations back to the first of its fix
            for o in range(m - min(of_fix, 1), m - of_fix - 1, -1):
                if o > m - of_fix and outcome[m] == LEAPT:
                    continue  # the velocity had been used
                for r in range(ops[o, 2] + ops[o, 3] - 1, ops[o, 2] - 1, -1):
                    back_through_row(
                        first_entry[r],
                        first_entry[r + 1],
                        index,
                        value,
                        normalised[r],
                        spread[r],
                        gains[r],
                        lam,
                        Lam,
                        u,
                    )
            if kind == RENEW and outcome[m] == RENEWED:
                for i in range(6):
                    c = place[W + i]
                    lam[c] = 0.0
                    for j in range(n):
                        Lam[c, j] = Lam[j, c] = 0.0
