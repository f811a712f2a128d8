"""The compiled loop of the satellite-aided filter: navigation, covariance and updates, no Python in
between. Import lazily.

Fifteen errors, computed - true, of the Earth-frame solution, resolved north, east, down where the
solution is, twelve constants of the sensors, two of the vertical, nine of the receiver and five of
its antenna::

    P 0-2    position [m]; p' = v - omega_en x p
    V 3-5    velocity [m/s]; v' = theta x f - (2 omega_ie + omega_en) x v
             + g/R (-p_N, -p_E, 2 p_D) + C del
    T 6-8    attitude theta [rad]; theta' = -(omega_ie + omega_en) x theta + C eps
    G 9-11   what the gyros read beyond the bias that is taken off, eps [rad/s], body axes; a
             random walk
    A 12-14  the same of the accelerometers, del [m/s^2]
    K 15-17  scale errors of the gyros, M 18-23 their misalignments [rad], S 24-26 scale errors of
             the accelerometers: they stand still, and where the prior of all is zero they are left
             out of the sums
    F 27-28  what a deflected vertical makes the unit feel north and east, over gravity [rad]:
             v' = g F, a first-order Gauss-Markov process of the way
    B 29-31  slow error of the positions [m], north, east, down: one of time
    O 32-34  the same of fixes of the other type, which goes on while none of that type comes
    W 35-37  slow error of the velocities [m/s], the same with a time constant of its own
    L 38-40  lever arm, IMU to antenna [m], body axes; stands still
    D 41     delay of the positions, how much older than their time they are [s]; stands still
    E 42     delay of the velocities

theta is the error of C_eb ("psi angle"); no error of position enters it. Groves (2013), section
14.2.2 (ECEF), with the signs of CONVENTIONS.md. The antenna's five may be estimated, or considered:
they then widen what is estimated and are left as they are (Schmidt's filter; Jazwinski 1970,
section 8.2). What an update finds is taken off the solution at once, so the errors' means are zero
in between. Arrays in, arrays changed in place; SI and radians, silent; nothing is checked:
`ins.filters.aided_filter` does that.

Decision: docs/decisions/0006-error-state-w.md.
Decision: docs/decisions/0063-leaps.md.
"""

from math import cos, exp, isfinite, log, sin, sqrt, tan

import numpy as np

from ins.earth import EARTH_RATE_RAD_S, SEMI_MAJOR_AXIS_M
from ins.filters import states
from ins.filters.aided_records import JUMPED, REJECTED, RESET, USED
from ins.jit import jit
from ins.strapdown.kernel import (
    C_NB_AT,
    C_NB_DT_AT,
    COUNT,
    HISTORY_COLUMNS,
    LIMIT,
    LOOK_AHEAD_S,
    LOOK_ROWS,
    SUMS,
    V_N_AT,
    R,
    V,
    add,
    dcm,
    dcm_ne,
    gravity,
    local_frame,
    record,
    rotate,
    rotation_quaternion,
)
from ins.strapdown.loop import integrate, put_triple, triple

MOTION, DRIVING, N = states.AIDED_MOTION, states.AIDED_DRIVING, states.AIDED_STATES
# first index of each error
P_, V_, T_ = states.AIDED_POS.start, states.AIDED_VEL.start, states.AIDED_THETA.start
G_, A_ = states.AIDED_GYRO.start, states.AIDED_ACCEL.start
K_, M_ = states.AIDED_GYRO_SCALE.start, states.AIDED_MISALIGNED.start
S_ = states.AIDED_ACCEL_SCALE.start
READING, READ_OF = np.array(states.READING_GYRO), np.array(states.READ_AXIS)
F_ = states.AIDED_DEFLECTION.start
B_, O_ = states.AIDED_SLOW_POS.start, states.AIDED_SLOW_OTHER.start
W_ = states.AIDED_SLOW_VEL.start
L_, D_, E_ = states.AIDED_LEVER.start, states.AIDED_DELAY, states.AIDED_VELOCITY_DELAY
# places and counts that kernels take as arguments: numba compiles a function anew for each Python
# integer that it is called with, 4 s of the 25 that the first aided replay compiled for
AT_P, AT_V, AT_T, AT_0, AT_3 = (np.int64(k) for k in (P_, V_, T_, 0, 3))
AT_G, AT_A, AT_K, AT_S = (np.int64(k) for k in (G_, A_, K_, S_))
AT_BEFORE = np.int64(1)  # V_BEFORE
ALL, BELOW_LEVER, LOOK_WIDTH = np.int64(N), np.int64(L_), np.int64(LOOK_ROWS)
ARW, VRW, GYRO_WALK, ACCEL_WALK = 0, 1, 2, 3  # of the noise, per sqrt(s)
# of the noise: sigmas and time constant of the slow error of positions
SLOW_LEVEL, SLOW_DOWN, SLOW_S = 4, 5, 6
SLOW_V, SLOW_V_S = 7, 8  # and of velocities
# of the noise: how far the accelerometers' biases go with the shaking, m/s^2 a m/s^2
STIRRED = 9
# of the noise: deflection of the vertical, its sigma (0: no state, nothing of it is summed) and the
# length of its correlation
DEFLECTION, DEFLECTION_WAY = 10, 11
# of the noise: sigmas of the slow error of fixes of the other type; its time constant is SLOW_S
SLOW_OTHER_LEVEL, SLOW_OTHER_DOWN = 12, 13
SHAKEN = 14  # of the noise: how much of the shaking is white noise of the accelerometers
# of the settings; CONSIDER: the antenna is, if above 0; HAS_SCALES: scales and misalignments are
# states, if above 0
GATE, STAND_SIGMA, RESET_S, STAND_RATE, CONSIDER, HAS_SCALES = 0, 1, 2, 3, 4, 5
# what a step carries over the end of a piece, at places 0 to 33: seconds between positions that
# were rejected; NIS and count of the standing updates so far; seconds and steps so far
DT, V_BEFORE, RATE, REJECTED_S = 0, 1, 4, 7
STAND_NIS, STOOD, CLOCK, STEPS = 8, 9, 10, 11
# and at 12 to 17 the variance that leaps of the positions add to their slow errors, fading with
# these: of the one and of the other type of fixes, NED
LEAPT = 12
# and of the specific force, NED: its mean while it stays the same, of how many steps, its latest
# mean
STEADY, STEADY_STEPS, LATEST = 18, 21, 22
# and of the shaking, at 25 to 31: the last row's specific force, body axes, the mean square of its
# changes from row to row, the mean over SHAKEN_S of the root of that, its least and its most; at 32
# the rows of the step, at 33 the CLOCK of the latest position that was rejected (0: none since one
# was used)
FORCE_BEFORE, SHAKING, SHAKEN_LATELY, SHAKEN_LEAST, SHAKEN_MOST = 25, 28, 29, 30, 31
STEP_ROWS, REJECTED_AT, CARRY = 32, 33, 34
# of what is taken off: biases of gyros and accelerometers, scales and misalignments, slow errors,
# lever arm, delays, deflection of the vertical
B_SCALE, B_SLOW, B_SLOW_VEL, B_LEVER, B_DELAY, B_VELOCITY_DELAY = 6, 18, 24, 27, 30, 31
B_DEFLECTION, TAKEN = 32, 34
# the trail, one row a step: time, velocity, what velocity and position have gained since the
# start, angular rate, noise of the specific force (NED); places of 16 columns, and 256 rows: 51 s
# of steps of 0.2 s
TRAIL_T, TRAIL_V, TRAIL_DV, TRAIL_DR, TRAIL_W, TRAIL_ROWS = 0, 1, 4, 7, 10, 256
TRAIL_N, TRAIL = 13, 16
# of an output row: geodetic position, v_n, C_nb, biases, variances of the 15 errors, covariance of
# the NED attitude error
O_BIAS, O_VAR, O_PHI, OUT = 15, 21, 36, 45
# of a fix: residuals and their sigmas, position then velocity; NIS of each; what became of each;
# log likelihood of each
F_RESIDUAL, F_SIGMA, F_NIS, F_USED, F_LOGLIK, FIX = 0, 6, 12, 14, 16, 18
# of the tape, a row for each scalar measurement: its row of H, P H', its variance, its residual
TAPE_H, TAPE_K, TAPE = 0, states.AIDED_STATES, 2 * states.AIDED_STATES + 2
# of a fix that is given, behind its 12 values: whether it is of the other type
OTHER = 12
POLE_TAN = 1e6
UNSEEN_OFF = 10.0  # m or m/s: where it had to be begun anew and was not seen
# gaps between rejected positions that make a filter lost, however long they are: an outage counts
# as a fifth of the time at most; chosen
FEWEST_GAPS = 5.0
# squared sigmas of the specific force of a step, three components, beyond which it has changed:
# chi-square of 3, 1e-3 of noise; and the steps that its latest mean is of, and its mean at most
CHANGED, LATEST_STEPS, STEADY_AT_MOST = 16.27, 10.0, 1500.0
# squared sigmas of a gyro's bias and noise beyond which a step has a turn in it: 6e-5 of noise do
TURNS = 16.0
SHAKEN_S = 2.0  # chosen: of 100 rows at 50 Hz the shaking is known to 7 %
# integral of the squared difference of the shaking and its mean over SHAKEN_S after a jump from 0
# to 1, over SHAKEN_S: of sqrt(1 - exp(-u)) less its exponential mean, by numbers
OF_A_JUMP = 0.2954
TINY = 1e-12  # (m/s^2)^2: the square of 0.1 micro-g, below any accelerometer's noise
RESET_TILT_RAD = 0.02  # what the attitude may be off by where the solution had to be begun anew
# only kernels call it: less to compile, but a call from Python would end the process
inner = jit(no_cpython_wrapper=True)


@inner
def put_skew(M, i, j, a, k):
    """Block (i, j) of M to k skew(a)."""
    M[i, j + 1], M[i, j + 2] = -k * a[2], k * a[1]
    M[i + 1, j], M[i + 1, j + 2] = k * a[2], -k * a[0]
    M[i + 2, j], M[i + 2, j + 1] = -k * a[1], k * a[0]


@inner
def unsure_force(P, row, dt, unsure):
    """Variance (3,) of the computed specific force, NED: of theta x g + C del, what tilt and
    accelerometers leave of a velocity's rate.
    """
    down = row[SUMS + 8] / dt
    for i in range(3):
        total = 0.0
        tilt = T_ + 1 - i
        by_tilt = 0.0 if i == 2 else (down if i == 0 else -down)
        for j in range(3):
            C_j = row[C_NB_DT_AT + 3 * i + j] / dt
            if i < 2:
                total += 2.0 * by_tilt * C_j * P[tilt, A_ + j]
            for k in range(3):
                total += C_j * P[A_ + j, A_ + k] * row[C_NB_DT_AT + 3 * i + k] / dt
        if i < 2:
            total += by_tilt * by_tilt * P[tilt, tilt]
        unsure[i] = max(total, 0.0)


@inner
def steady_force(P, row, dt, vrw, carry, force, unsure):
    """The specific force of a step (3,) [m/s^2], NED: its mean while it stays the same, else as
    computed. unsure (3,): written.

    The computed force holds the noise of the accelerometers and, times gravity, of the tilt. In the
    place of the true one it would show the heading: to velocities it is a motion of known size that
    the fixes do not confirm, and each step of it adds to what the filter believes to know.
    """
    unsure_force(P, row, dt, unsure)
    n, white = carry[STEADY_STEPS], vrw * vrw / dt
    change, late = 0.0, 0.0
    for i in range(3):
        force[i] = row[SUMS + 6 + i] / dt
        carry[LATEST + i] += (force[i] - carry[LATEST + i]) / LATEST_STEPS
        if n > 0.0:
            # of a mean that forgets by a share a of each step: a / (2 - a)
            shown = white / (2.0 * LATEST_STEPS - 1.0) + white / n + unsure[i] + TINY
            off, now_off = carry[LATEST + i] - carry[STEADY + i], force[i] - carry[STEADY + i]
            late += off * off / shown
            change += now_off * now_off / (white * (1.0 + 1.0 / n) + unsure[i] + TINY)
    if n == 0.0 or change > CHANGED:
        carry[STEADY_STEPS] = 1.0
        for i in range(3):
            carry[STEADY + i] = carry[LATEST + i] = force[i]
        return
    if n > LATEST_STEPS and late > CHANGED:
        carry[STEADY_STEPS] = LATEST_STEPS
        for i in range(3):
            carry[STEADY + i] = carry[LATEST + i]
    else:
        carry[STEADY_STEPS] = min(n + 1.0, STEADY_AT_MOST)
        for i in range(3):
            carry[STEADY + i] += (force[i] - carry[STEADY + i]) / carry[STEADY_STEPS]
    for i in range(3):
        force[i] = carry[STEADY + i]


@inner
def turns(P, row, dt, arw, angle):
    """The angles of a step (3,), none where bias and noise of a gyro may read as much.

    A gyro's noise turns the attitude once for each unit of it, as a scale error of 1 would: on
    straight ways a scale is found that is as much of 1 as the noise tells of it.
    """
    for i in range(3):
        angle[i] = row[SUMS + 9 + i]
        variance = (P[G_ + i, G_ + i] * dt + arw * arw) * dt
        if angle[i] * angle[i] <= TURNS * variance:
            angle[i] = 0.0


@inner
def transition(row, steady, angle, dt, Phi, scaled):
    """Phi (29, 29) of a step of dt.

    row (36,): the strapdown output at its end, with what the step added up. steady (3,): specific
    force with less noise, angle (3,): what is no noise of the angles turned. scaled: whether scales
    and misalignments are states.
    """
    lat, height, v_N, v_E = row[0], row[2], row[V_N_AT], row[V_N_AT + 1]
    radius = SEMI_MAJOR_AXIS_M + height
    t = min(max(tan(lat), -POLE_TAN), POLE_TAN)
    s = t / sqrt(1.0 + t * t)
    c = 1.0 / sqrt(1.0 + t * t)
    ie, en = np.zeros(3), np.zeros(3)
    ie[0], ie[2] = EARTH_RATE_RAD_S * c, -EARTH_RATE_RAD_S * s
    en[0], en[1], en[2] = v_E / radius, -v_N / radius, -v_E * t / radius
    force = np.zeros(3)
    Phi[:, :] = 0.0
    both, coriolis = np.zeros(3), np.zeros(3)
    for i in range(3):
        force[i] = steady[i] * dt
        both[i], coriolis[i] = ie[i] + en[i], 2.0 * ie[i] + en[i]
    put_skew(Phi, AT_P, AT_P, en, -dt)
    put_skew(Phi, AT_V, AT_V, coriolis, -dt)
    put_skew(Phi, AT_T, AT_T, both, -dt)
    put_skew(Phi, AT_V, AT_T, force, -1.0)
    put_skew(Phi, AT_P, AT_T, force, -0.5 * dt)
    pull = gravity(s, height) / radius
    for i in range(3):
        gradient = 2.0 * pull if i == 2 else -pull
        Phi[P_ + i, V_ + i] = dt
        Phi[V_ + i, P_ + i] += dt * gradient
        Phi[P_ + i, P_ + i] += 0.5 * dt * dt * gradient
        Phi[V_ + i, V_ + i] += 0.5 * dt * dt * gradient
        for j in range(3):
            C_dt = row[C_NB_DT_AT + 3 * i + j]
            Phi[T_ + i, G_ + j] = C_dt
            Phi[V_ + i, A_ + j] = C_dt
            Phi[P_ + i, A_ + j] = 0.5 * dt * C_dt
    for i in range(2):
        Phi[V_ + i, F_ + i] = dt * pull * radius
        Phi[P_ + i, F_ + i] = 0.5 * dt * dt * pull * radius
    turned_to(Phi, AT_G, AT_A, dt)
    if scaled:
        put_scales(Phi, row, force, angle, dt)
    for i in range(DRIVING):
        Phi[i, i] += 1.0


@inner
def turned_to(Phi, first, last, dt):
    """What turns the attitude over a step moves velocity and position; columns first to last."""
    for i in range(3):
        for j in range(first, last):
            for k in range(3):
                Phi[V_ + i, j] += 0.5 * Phi[V_ + i, T_ + k] * Phi[T_ + k, j]
                Phi[P_ + i, j] += dt / 6.0 * Phi[V_ + i, T_ + k] * Phi[T_ + k, j]


@inner
def put_scales(Phi, row, force, angle, dt):
    """Columns of scales and misalignments: the angles and the specific force of the step, along
    the mean of the body axes over it.
    """
    for j in range(3):
        along = 0.0
        for k in range(3):
            along += row[C_NB_DT_AT + 3 * k + j] * force[k] / dt
        for i in range(3):
            C = row[C_NB_DT_AT + 3 * i + j] / dt
            Phi[T_ + i, K_ + j] = C * angle[j]
            Phi[V_ + i, S_ + j] = C * along
            Phi[P_ + i, S_ + j] = 0.5 * dt * C * along
    for m in range(6):
        for i in range(3):
            Phi[T_ + i, M_ + m] = row[C_NB_DT_AT + 3 * i + READING[m]] / dt * angle[READ_OF[m]]
    turned_to(Phi, AT_K, AT_S, dt)


@inner
def shake(carry, dv, dt):
    """The mean square of what the specific force changes by from row to row, with this row's.

    It forgets within SHAKEN_S; a third of the squares of three components, half of it each row's.
    """
    total, before = 0.0, 0.0
    for i in range(3):
        force, last = dv[i] / dt, carry[FORCE_BEFORE + i]
        total += (force - last) * (force - last) / 6.0
        before += last * last
        carry[FORCE_BEFORE + i] = force
    if before == 0.0:
        return  # the first row
    share = min(dt / SHAKEN_S, 1.0) if carry[SHAKING] > 0.0 else 1.0
    carry[SHAKING] += share * (total - carry[SHAKING])


@inner
def shaken_by(carry, dt):
    """How fast the shaking changes at the end of a step of dt [m/s^2/sqrt(s)].

    A random walk of that density goes as far as the shaking jumps, however long the steps are.
    """
    shaken, so_far_s = sqrt(carry[SHAKING]), carry[CLOCK]
    off = shaken - carry[SHAKEN_LATELY] if so_far_s > 0.0 else 0.0
    carry[SHAKEN_LATELY] = shaken - off * exp(-dt / SHAKEN_S)
    if so_far_s > 2.0 * SHAKEN_S:
        carry[SHAKEN_MOST] = max(carry[SHAKEN_MOST], shaken)
        least = carry[SHAKEN_LEAST]
        carry[SHAKEN_LEAST] = min(least, shaken) if least > 0.0 else shaken
    return off / sqrt(OF_A_JUMP * SHAKEN_S)


@inner
def kept_on_the_way(Phi, length_m):
    """What a step keeps of a deflection of the vertical.

    Phi turns places by the step's way over Earth's radius: north and east.
    """
    north, east = Phi[P_, P_ + 2], Phi[P_ + 1, P_ + 2]
    return exp(-SEMI_MAJOR_AXIS_M * sqrt(north * north + east * east) / length_m)


@inner
def predict(P, Phi, dt, noise, vrw, leapt, stirred, moved, fading):
    """P to Phi P Phi' + Q in place; moved (9, 43), fading (43,): room to work in.

    Phi is of the first 29; its columns of scales are zero where they are no states. Biases and
    scales stand still, so its rows 9-26 are unit, and so are those of the antenna; the deflection
    of the vertical and slow errors fade at the step's end, and so does what leaps of the positions
    add to their variance, leapt (6,). stirred: as by `shaken_by`.

    The first sums run row upon row, so that the compiler adds four columns at a time, each in the
    order of k; half of Phi is zero, three quarters where scales are no states. P is symmetric to
    the last bit, and stays so.
    """
    for i in range(G_):
        for j in range(N):
            moved[i, j] = 0.0
        for k in range(DRIVING):
            phi = Phi[i, k]
            if phi != 0.0:
                for j in range(N):
                    moved[i, j] += phi * P[k, j]
    for j in range(G_):
        for i in range(j, G_):
            total = 0.0
            for k in range(DRIVING):
                total += moved[i, k] * Phi[j, k]
            P[i, j] = P[j, i] = total
        for i in range(G_, N):
            P[i, j] = P[j, i] = moved[j, i]
    slow, slow_v = exp(-dt / noise[SLOW_S]), exp(-dt / noise[SLOW_V_S])
    plumb_line = kept_on_the_way(Phi, noise[DEFLECTION_WAY])
    for i in range(N):
        fading[i] = 1.0
    for i in range(F_, L_):
        fading[i] = plumb_line if i < B_ else (slow if i < W_ else slow_v)
    for i in range(N):
        first, last = (0, N) if F_ <= i < L_ else (F_, L_)
        for j in range(first, last):
            P[i, j] *= fading[i] * fading[j]
    for i in range(F_, L_):
        fades, at = fading[i], SLOW_LEVEL
        if i < B_:
            at = DEFLECTION
        elif i >= W_:
            at = SLOW_V
        elif i >= O_:
            at = SLOW_OTHER_LEVEL
        if i == O_ - 1 or i == W_ - 1:
            at += 1  # down, beside level
        sigma = noise[at]
        P[i, i] += sigma * sigma * (1.0 - fades * fades)
        if B_ <= i < W_:
            P[i, i] += leapt[i - B_] * (1.0 - fades * fades)
            leapt[i - B_] *= fades * fades
    # products, since numba compiles x**2 as a loop over the bits of 2
    vrw2, dt2, arw2 = vrw * vrw, dt * dt, noise[ARW] * noise[ARW]
    walk2, stirs = noise[GYRO_WALK] * noise[GYRO_WALK], noise[STIRRED] * stirred
    accel2 = noise[ACCEL_WALK] * noise[ACCEL_WALK] + stirs * stirs
    for i in range(3):
        P[P_ + i, P_ + i] += vrw2 * (dt2 * dt) / 3.0
        P[P_ + i, V_ + i] += vrw2 * dt2 / 2.0
        P[V_ + i, P_ + i] += vrw2 * dt2 / 2.0
        P[V_ + i, V_ + i] += vrw2 * dt
        P[T_ + i, T_ + i] += arw2 * dt
        P[G_ + i, G_ + i] += walk2 * dt
        P[A_ + i, A_ + i] += accel2 * dt


@inner
def update(x, P, H, z, variance, room, first):
    """Use scalar measurements z (m,) with rows H (m, 43), one after the other, in place.

    variance (m,): independent errors. room (3, 45): written; row k holds P H' of measurement k, its
    variance and its residual. Errors from `first` on are considered and left as they are. Returns
    the NIS of all of them together, and the log likelihood.
    """
    nis, loglik = 0.0, 0.0
    for m in range(z.size):
        s, y = variance[m], z[m]
        K = room[m]
        K[:N] = 0.0
        for j in range(N):
            h = H[m, j]
            if h != 0.0:
                for i in range(N):
                    K[i] += P[j, i] * h
        for i in range(N):
            s += H[m, i] * K[i]
            y -= H[m, i] * x[i]
        K[N], K[N + 1] = s, y
        nis += y * y / s
        loglik -= 0.5 * (log(s) + y * y / s)
        weight = 1.0 / s
        for i in range(N):
            gain = K[i]
            if i < first:
                x[i] += gain * y / s
            last = N if i < first else first
            for j in range(last):
                P[i, j] -= gain * K[j] * weight
    return nis, loglik


@inner
def put(target, source, n):
    """target[:n] = source[:n]; written so, numba compiles texts for an error message, 3 s."""
    for i in range(n):
        target[i] = source[i]


@inner
def write_down(H, room, tape, taped):
    """Write three measurements that were used on the tape, where there is one."""
    if tape.shape[0] == 0:
        return
    for m in range(3):
        line = tape[taped[0]]
        put(line[TAPE_H:], H[m], N)
        put(line[TAPE_K:], room[m], N + 2)
        taped[0] += 1


@inner
def write_restart(tape, taped):
    """Write on the tape that position and velocity were begun anew: a row without variance."""
    if tape.shape[0] > 0:
        tape[taped[0]] = 0.0
        taped[0] += 1


@inner
def correct(state, bias, x):
    """Take the errors x (43,) off the solution and make them zero.

    The solution is Earth-frame position, velocity, attitude, and `bias` (34,).
    """
    C = dcm_ne(local_frame(triple(state, R)))
    C_en = (C[0], C[3], C[6], C[1], C[4], C[7], C[2], C[5], C[8])
    put_triple(state, R, add(triple(state, R), rotate(C_en, triple(x, AT_P)), -1.0))
    put_triple(state, V, add(triple(state, V), rotate(C_en, triple(x, AT_V)), -1.0))
    turn = rotate(C_en, triple(x, AT_T))
    a, b, c, d = rotation_quaternion((-turn[0], -turn[1], -turn[2]), False)
    w, p, q, r = state[0], state[1], state[2], state[3]
    state[0] = a * w - b * p - c * q - d * r
    state[1] = a * p + b * w + c * r - d * q
    state[2] = a * q - b * r + c * w + d * p
    state[3] = a * r + b * q - c * p + d * w
    for i in range(B_SLOW):
        bias[i] += x[G_ + i]
    for i in range(2):
        bias[B_DEFLECTION + i] += x[F_ + i]
    for i in range(N - B_):
        bias[B_SLOW + i] -= x[B_ + i]
    x[:] = 0.0
    state[COUNT] = state[LIMIT] = 0.0  # gravity is looked up anew from here


@inner
def rows_of_fix(row, rate_b, lever_b, slow, H):
    """Rows (6, 43) of antenna position and velocity, NED; the arm and its swing (6,).

    Delays and what the lever arm does to the velocity are the caller's. slow: first state of the
    slow error of this type of fixes.
    """
    H[:, :] = 0.0
    arm, swing = np.zeros(3), np.zeros(3)
    spin = np.zeros(3)
    spin[0] = rate_b[1] * lever_b[2] - rate_b[2] * lever_b[1]
    spin[1] = rate_b[2] * lever_b[0] - rate_b[0] * lever_b[2]
    spin[2] = rate_b[0] * lever_b[1] - rate_b[1] * lever_b[0]
    for i in range(3):
        H[i, P_ + i] = H[i, slow + i] = 1.0
        H[3 + i, V_ + i] = H[3 + i, W_ + i] = 1.0
        for j in range(3):
            arm[i] += row[C_NB_AT + 3 * i + j] * lever_b[j]
            swing[i] += row[C_NB_AT + 3 * i + j] * spin[j]
        cx, cy, cz = row[C_NB_AT + 3 * i], row[C_NB_AT + 3 * i + 1], row[C_NB_AT + 3 * i + 2]
        H[3 + i, G_] = -(cy * lever_b[2] - cz * lever_b[1])  # eps x lever = -lever x eps
        H[3 + i, G_ + 1] = -(cz * lever_b[0] - cx * lever_b[2])
        H[3 + i, G_ + 2] = -(cx * lever_b[1] - cy * lever_b[0])
        H[i, L_], H[i, L_ + 1], H[i, L_ + 2] = cx, cy, cz
    put_skew(H, AT_0, AT_T, arm, -1.0)
    put_skew(H, AT_3, AT_T, swing, -1.0)
    return arm, swing


@inner
def restart(P, seen):
    """Position and velocity known no better than they were seen to be off.

    The attitude is known within RESET_TILT_RAD.
    """
    for i in range(6):
        for j in range(N):
            P[i, j] = P[j, i] = 0.0
        P[i, i] = seen[i] * seen[i] + 1.0
    for i in range(3):
        P[T_ + i, T_ + i] += RESET_TILT_RAD * RESET_TILT_RAD


@inner
def jump(P, seen, slow, leapt):
    """Positions leapt while the velocities fit: either those before or those from now on are off.

    Position and slow error take what was seen, both alike: the fixes alone cannot tell which.
    leapt (6,): the variance that keeps the slow error so large for its time constant. slow: its
    first state.
    """
    for i in range(3):
        k, seen2 = slow - B_ + i, seen[i] * seen[i]
        leapt[k] = max(leapt[k], seen2)
        P[P_ + i, P_ + i] += seen2
        P[slow + i, slow + i] += seen2


@inner
def count_rejected(carry, reset_s):
    """Count a rejected position; True: the filter is lost, for it rejects them for reset_s (0: no).

    The time between rejected positions counts, each gap for no more than its share.
    """
    if carry[REJECTED_AT] != 0.0:
        carry[REJECTED_S] += min(carry[CLOCK] - carry[REJECTED_AT], reset_s / FEWEST_GAPS)
    carry[REJECTED_AT] = carry[CLOCK]
    return 0.0 < reset_s <= carry[REJECTED_S]


@inner
def begin_anew(z, H, x, P, variance, slow, carry, settings, room, tape, taped):
    """Widen P by what a position of a lost filter is off: z (6,) as in `take_fix`; variance (3,) of
    its velocity.

    JUMPED where the velocity fits: the positions leapt. Else RESET: position and velocity are begun
    anew.
    """
    seen = np.zeros(6)
    for i in range(6):
        seen[i] = z[i] if isfinite(z[i]) else UNSEEN_OFF
    if isfinite(z[3]):
        nis, _ = update(x.copy(), P.copy(), H[3:6], z[3:6], variance, room, ALL)
        if nis <= settings[GATE]:
            jump(P, seen, slow, carry[LEAPT:STEADY])
            return JUMPED
    restart(P, seen)
    write_restart(tape, taped)
    return RESET


@inner
def leave_trail(trail, carry, row, steady):
    """Write the step that ends now: row (36,) is the strapdown output there, steady (3,) its
    specific force with less noise.
    """
    k, last = int(carry[STEPS]) % TRAIL_ROWS, int(carry[STEPS] - 1) % TRAIL_ROWS
    carry[CLOCK] += carry[DT]
    trail[k, TRAIL_T] = carry[CLOCK]
    for i in range(3):
        v, before = row[V_N_AT + i], carry[V_BEFORE + i]
        trail[last, TRAIL_V + i] = before  # as corrected where that step began
        trail[k, TRAIL_V + i] = v
        trail[k, TRAIL_DV + i] = trail[last, TRAIL_DV + i] + v - before
        trail[k, TRAIL_DR + i] = trail[last, TRAIL_DR + i] + 0.5 * (v + before) * carry[DT]
        trail[k, TRAIL_N + i] = row[SUMS + 6 + i] / carry[DT] - steady[i]
        trail[k, TRAIL_W + i] = 0.0
        for j in range(3):
            trail[k, TRAIL_W + i] += row[C_NB_AT + 3 * i + j] * carry[RATE + j]
    carry[STEPS] += 1.0


@inner
def past(trail, carry, time_s, out):
    """What the solution moved since a time.

    out (12,) = velocity and position gained since, acceleration (with less noise) and angular rate
    there (NED). From the trail, linear in velocity within a step; before the oldest row at that
    step's acceleration.
    """
    now = int(carry[STEPS] - 1)
    k = now
    for _ in range(min(now, TRAIL_ROWS - 1)):
        k -= 1
        if trail[k % TRAIL_ROWS, TRAIL_T] <= time_s:
            break
    a, b, end = trail[k % TRAIL_ROWS], trail[(k + 1) % TRAIL_ROWS], trail[now % TRAIL_ROWS]
    h, u = b[TRAIL_T] - a[TRAIL_T], time_s - a[TRAIL_T]
    for i in range(3):
        force = (b[TRAIL_DV + i] - a[TRAIL_DV + i]) / h
        out[i] = end[TRAIL_DV + i] - a[TRAIL_DV + i] - force * u
        out[3 + i] = end[TRAIL_DR + i] - a[TRAIL_DR + i] - (a[TRAIL_V + i] + 0.5 * force * u) * u
        out[6 + i] = force - b[TRAIL_N + i]
        out[9 + i] = a[TRAIL_W + i] + (b[TRAIL_W + i] - a[TRAIL_W + i]) * u / h


@inner
def take_fix(
    state, row, fix, late_s, carry, trail, settings, x, P, bias, H, room, out, tape, taped
):
    """Use a fix `late_s` after the solution's own time (< 0).

    The fix: position ECEF 3, v_n 3, variances 6 (NaN: not measured), and above 0 where it is of the
    other type. It is compared with the solution where it was then, less the delay: the trail leads
    back there.
    """
    slow = O_ if fix[OTHER] > 0.0 else B_
    arm, swing = rows_of_fix(row, carry[RATE : RATE + 3], bias[B_LEVER : B_LEVER + 3], slow, H)
    at_position, at_velocity, swings, swung = np.zeros(12), np.zeros(12), np.zeros(3), np.zeros(3)
    back_s = bias[B_DELAY] - late_s
    past(trail, carry, carry[CLOCK] - back_s, at_position)
    past(trail, carry, carry[CLOCK] + late_s - bias[B_VELOCITY_DELAY], at_velocity)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        swings[i] = at_position[9 + j] * arm[k] - at_position[9 + k] * arm[j]
        swung[i] = at_velocity[9 + j] * arm[k] - at_velocity[9 + k] * arm[j]
        for m in range(3):  # the lever arm turned at that rate
            H[3 + i, L_ + m] = (
                at_velocity[9 + j] * row[C_NB_AT + 3 * k + m]
                - at_velocity[9 + k] * row[C_NB_AT + 3 * j + m]
            )
    r, z = triple(state, R), np.zeros(6)
    apart = add(r, triple(fix, AT_0), -1.0)
    put_triple(z, AT_0, rotate(dcm_ne(local_frame(r)), apart))
    for i in range(3):
        z[i] += (
            arm[i]
            + bias[B_SLOW + slow - B_ + i]
            - at_position[3 + i]
            - 0.5 * back_s * (swing[i] + swings[i])
        )
        z[3 + i] = row[V_N_AT + i] - at_velocity[i] + swung[i] + bias[B_SLOW_VEL + i] - fix[3 + i]
        H[i, D_] = -(row[V_N_AT + i] - at_position[i] + swings[i])
        H[3 + i, E_] = -at_velocity[6 + i]
    first = BELOW_LEVER if settings[CONSIDER] > 0.0 else ALL
    became = USED
    used, read = False, np.zeros(N, np.int64)
    for kind in range(2):
        a = 3 * kind
        if not isfinite(z[a]):
            continue
        x_new, P_new = x.copy(), P.copy()
        of = (H[a : a + 3], z[a : a + 3], fix[6 + a : 9 + a], room, first)
        nis, loglik = update(x_new, P_new, *of)
        if kind == 0 and nis > settings[GATE] and count_rejected(carry, settings[RESET_S]):
            became = begin_anew(z, H, x, P, fix[9:12], slow, carry, settings, room, tape, taped)
            x_new, P_new = x.copy(), P.copy()
            nis, loglik = update(x_new, P_new, *of)
        for i in range(3):
            s, y = fix[6 + a + i], z[a + i]
            count = 0
            for j in range(N):
                if H[a + i, j] != 0.0:
                    read[count] = j
                    count += 1
            for m in range(count):
                j = read[m]
                y -= H[a + i, j] * x[j]
                for l in range(count):
                    k = read[l]
                    s += H[a + i, j] * P[j, k] * H[a + i, k]
            out[F_RESIDUAL + a + i] = y
            out[F_SIGMA + a + i] = sqrt(s)
        out[F_NIS + kind] = nis
        if nis <= settings[GATE]:
            for i in range(N):
                x[i] = x_new[i]
                for j in range(N):
                    P[i, j] = P_new[i, j]
            write_down(H[a : a + 3], room, tape, taped)
            out[F_USED + kind] = became
            out[F_LOGLIK + kind] = loglik
            used = True
            if kind == 0:
                carry[REJECTED_S] = carry[REJECTED_AT] = 0.0
        else:
            out[F_USED + kind] = REJECTED
            out[F_LOGLIK + kind] = loglik + 0.5 * (nis - settings[GATE])
    if used:
        correct(state, bias, x)


@inner
def stand(state, row, dt, noise, settings, x, P, bias, H, room, tape, taped):
    """A standing vehicle has no velocity and, where STAND_RATE is given, no rate but Earth's.

    The rate: dtheta/dt - C_bn omega_ie = eps - C_bn (omega_ie x theta), noise ARW^2/dt +
    STAND_RATE^2. Returns the NIS of the velocity. The antenna is left as it is, but where a tape is
    written: smoothing asks for the gain that is best.
    """
    first = ALL if tape.shape[0] > 0 else BELOW_LEVER
    H[:, :] = 0.0
    for i in range(3):
        H[i, V_ + i] = 1.0
    off, variance, z = np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        off[i], variance[i] = row[V_N_AT + i], settings[STAND_SIGMA] * settings[STAND_SIGMA]
    nis, _ = update(x, P, H[0:3], off, variance, room, first)
    write_down(H[0:3], room, tape, taped)
    if settings[STAND_RATE] > 0.0:
        ie = np.zeros(3)
        ie[0], ie[2] = EARTH_RATE_RAD_S * cos(row[0]), -EARTH_RATE_RAD_S * sin(row[0])
        white = noise[ARW] * noise[ARW] / dt + settings[STAND_RATE] * settings[STAND_RATE]
        H[:, :] = 0.0
        for i in range(3):
            H[i, G_ + i] = 1.0
            z[i], variance[i] = row[SUMS + 9 + i] / dt, white
            for j in range(3):
                C_ji = row[C_NB_AT + 3 * j + i]
                z[i] -= C_ji * ie[j]
                k, m = (j + 1) % 3, (j + 2) % 3  # row j of omega_ie x theta
                H[i, T_ + m] -= C_ji * ie[k]
                H[i, T_ + k] += C_ji * ie[m]
        update(x, P, H[0:3], z, variance, room, first)
        write_down(H[0:3], room, tape, taped)
    correct(state, bias, x)
    return nis


@inner
def roll(state, row, rate_b, rolled, mount, settings, x, P, bias, H, room, tape, taped):
    """A vehicle on wheels goes where it points, at the speed that its wheels tell.

    rolled (4,): speed or NaN, variances of forward, side and upward velocity. mount (12,): vehicle
    axes from body axes, and the arm from the unit to the point that does not slip, body axes.
    Returns what became of it; a measurement beyond the gate is a slip.
    """
    first = N if tape.shape[0] > 0 else L_
    v_b, apart = np.zeros(3), np.zeros(3)
    for i in range(3):
        for j in range(3):
            v_b[i] += row[C_NB_AT + 3 * j + i] * row[V_N_AT + j]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        v_b[i] += rate_b[j] * mount[9 + k] - rate_b[k] * mount[9 + j]
    told = isfinite(rolled[0])
    H[:, :] = 0.0
    for i in range(3):
        for j in range(3):
            apart[i] += mount[3 * i + j] * v_b[j]
            for k in range(3):
                H[i, V_ + j] += mount[3 * i + k] * row[C_NB_AT + 3 * j + k]
        for j in range(3):  # C_vn (v x theta)
            k, m = (j + 1) % 3, (j + 2) % 3
            H[i, T_ + m] += H[i, V_ + j] * row[V_N_AT + k]
            H[i, T_ + k] -= H[i, V_ + j] * row[V_N_AT + m]
    variance = rolled[1:4].copy()
    if told:
        apart[0] -= rolled[0]
    else:
        put(H[0], H[1], N)  # the side twice, each time with twice its variance
        apart[0] = apart[1]
        variance[0] = variance[1] = 2.0 * variance[1]
    x_new, P_new = x.copy(), P.copy()
    nis, _ = update(x_new, P_new, H[0:3], apart, variance, room, first)
    if nis > settings[GATE]:
        return REJECTED
    put(x, x_new, N)
    for i in range(N):
        put(P[i], P_new[i], N)
    write_down(H[0:3], room, tape, taped)
    correct(state, bias, x)
    return USED


@inner
def take_scales_off(bias, dtheta, dv, turned, pushed):
    """Scales and misalignments off a row's increments; turned and pushed (3,) in place."""
    for i in range(3):
        turned[i] -= bias[B_SCALE + i] * dtheta[i]
        pushed[i] -= bias[B_SCALE + S_ - K_ + i] * dv[i]
    for m in range(6):
        turned[READING[m]] -= bias[B_SCALE + M_ - K_ + m] * dtheta[READ_OF[m]]


@inner
def plumb(state, bias, push):
    """What the deflection that is taken off makes the unit feel: push (3,) [m/s^2], body axes."""
    frame = local_frame(triple(state, R))
    C, B = dcm_ne(frame), dcm((state[0], state[1], state[2], state[3]))
    pull = gravity(frame[0], frame[4])
    north, east = pull * bias[B_DEFLECTION], pull * bias[B_DEFLECTION + 1]
    x = north * C[0] + east * C[3]
    y = north * C[1] + east * C[4]
    z = north * C[2] + east * C[5]
    C_bn = (B[0], B[3], B[6], B[1], B[4], B[7], B[2], B[5], B[8])
    put_triple(push, AT_0, rotate(C_bn, (x, y, z)))


@inner
def emit(state, bias, P, rows, k):
    """Write output row k: the solution as it is now, biases, variances."""
    out, r = rows[k], triple(state, R)
    record(rows, k, dcm((state[0], state[1], state[2], state[3])), triple(state, V), r)
    frame = local_frame(r)
    for i in range(6):
        out[O_BIAS + i] = bias[i]
    for i in range(MOTION):
        out[O_VAR + i] = P[i, i]
    radius = SEMI_MAJOR_AXIS_M + frame[4]
    # NED attitude error from theta and position: phi_N = theta_N - p_E/R ... (CONVENTIONS.md)
    rows = np.zeros((3, MOTION))
    for i in range(3):
        rows[i, T_ + i] = 1.0
    rows[0, 1], rows[1, 0] = -1.0 / radius, 1.0 / radius
    rows[2, 1] = min(max(frame[0] / max(frame[1], 1e-9), -POLE_TAN), POLE_TAN) / radius
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(MOTION):
                for m in range(MOTION):
                    if rows[i, k] != 0.0 and rows[j, m] != 0.0:
                        total += rows[i, k] * P[k, m] * rows[j, m]
            out[O_PHI + 3 * i + j] = total


@jit
def run(
    dt,
    dtheta,
    dv,
    ends,
    fix_of,
    late_s,
    stands,
    emits,
    state,
    opened,
    carry,
    bias,
    x,
    P,
    noise,
    settings,
    trail,
    fixes,
    fix_out,
    rows_out,
    P_out,
    phis,
    tape,
    tape_ends,
    turned,
    pushed,
    turned_seen,
    pushed_seen,
    roll_of,
    rolled,
    mount,
    roll_out,
):
    """Work through the rows of a piece of log; step k ends before row ends[k].

    Parameters
    ----------
    dt : ndarray, shape (n,)
        Intervals [s].
    dtheta, dv : ndarray, shape (n, 3)
        Increments [rad], [m/s].
    ends : ndarray of int64, shape (k,)
        Rows after the last end stay open.
    fix_of : ndarray of int64, shape (k,)
        The fix to use at a step's end, -1 for none.
    late_s : ndarray, shape (k,)
        By how much the fix is after the step's end (<= 0).
    stands, emits : ndarray of bool, shape (k,)
        Whether the vehicle stands, whether a row is put out.
    state, opened, carry, bias, x, P : ndarray
        What a step carries over the end of a piece; changed in place.
    noise, settings : ndarray, shapes (15,), (6,)
    trail : ndarray, shape (TRAIL_ROWS, TRAIL)
        The latest steps; changed in place.
    fixes : ndarray, shape (fixes, 13)
        Position ECEF, v_n, variances of both, whether it is of the other type.
    fix_out : ndarray, shape (fixes, FIX)
        What became of each fix; written.
    rows_out : ndarray, shape (emitted, OUT)
        Written.
    P_out : ndarray, shape (emitted, 15, 15) or (emitted, 41, 41), or with no rows
        Of the first errors, or of all; written where it is asked for.
    phis : ndarray, shape (k, 9, 29), or with no rows
        Rows of each step's transition that are not unit; written where a tape is.
    tape, tape_ends : ndarray, shapes (measurements, TAPE), (k,); or with no rows
        The measurements used, and how many of them up to the end of each step; written where asked.
    turned, pushed, turned_seen, pushed_seen : ndarray, shape (n, 3)
        Room for the increments less what is taken off, and the same memory to be read only, so that
        `integrate` is compiled once, for arrays like those of a log.
    roll_of : ndarray of int64, shape (k,)
        The row of `rolled` to use at a step's end, -1 for none.
    rolled, mount : ndarray, shapes (m, 4), (12,)
        Of a vehicle on wheels (`roll`).
    roll_out : ndarray of int64, shape (m,)
        What became of each; written.
    """
    Phi, H = np.zeros((DRIVING, DRIVING)), np.zeros((6, N))
    moved, fading = np.zeros((G_, N)), np.zeros(N)
    scaled = settings[HAS_SCALES] > 0.0
    room, taped = np.zeros((3, N + 2)), np.zeros(1, np.int64)
    out, end, none = np.zeros((2, HISTORY_COLUMNS)), np.zeros(1, np.int64), np.zeros(0, np.int64)
    flat, steady, unsure, angle = (np.zeros(dt.size), np.zeros(3), np.zeros(3), np.zeros(3))
    deflected, push = noise[DEFLECTION] > 0.0, np.zeros(3)
    gains, look_s = (0.0, 0.0, 0.0), LOOK_AHEAD_S
    first, written = 0, AT_0
    for k in range(ends.size + 1):
        last = ends[k] if k < ends.size else dt.size
        if k == ends.size and last == first:
            break
        if deflected:
            plumb(state, bias, push)
        for l in range(first, last):
            carry[DT] += dt[l]
            carry[STEP_ROWS] += 1.0
            for i in range(3):
                turned[l, i] = dtheta[l, i] - bias[i] * dt[l]
                pushed[l, i] = dv[l, i] - bias[3 + i] * dt[l]
            if scaled:
                take_scales_off(bias, dtheta[l], dv[l], turned[l], pushed[l])
            if deflected:
                for i in range(3):
                    pushed[l, i] -= push[i] * dt[l]
            for i in range(3):
                carry[RATE + i] = turned[l, i] / dt[l]
            shake(carry, dv[l], dt[l])
        for i in range(HISTORY_COLUMNS):
            out[0, i], out[1, i] = opened[i], 0.0
        end[0] = last - first
        integrate(
            dt[first:last],
            turned_seen[first:last],
            pushed_seen[first:last],
            flat[first:last],
            gains,
            look_s,
            LOOK_WIDTH,
            end if k < ends.size else none,
            state,
            out,
        )
        first = last
        if k == ends.size:
            for i in range(HISTORY_COLUMNS):
                opened[i] = out[0, i]
            break
        opened[:] = 0.0
        step_s = carry[DT]
        vrw = noise[VRW]
        if noise[SHAKEN] > 0.0:  # what the rows of the step shook by is white
            shaken = noise[SHAKEN] * noise[SHAKEN] * carry[SHAKING]
            vrw = sqrt(vrw * vrw + shaken * step_s / carry[STEP_ROWS])
        steady_force(P, out[0], step_s, vrw, carry, steady, unsure)
        if scaled:
            turns(P, out[0], step_s, noise[ARW], angle)
        transition(out[0], steady, angle, step_s, Phi, scaled)
        stirred = shaken_by(carry, step_s)
        leapt = carry[LEAPT:STEADY]
        predict(P, Phi, step_s, noise, vrw, leapt, stirred, moved, fading)
        for i in range(2):
            bias[B_DEFLECTION + i] *= kept_on_the_way(Phi, noise[DEFLECTION_WAY])
        for i in range(3):
            bias[B_SLOW + i] *= exp(-step_s / noise[SLOW_S])
            bias[B_SLOW + 3 + i] *= exp(-step_s / noise[SLOW_S])
            bias[B_SLOW_VEL + i] *= exp(-step_s / noise[SLOW_V_S])
        leave_trail(trail, carry, out[0], steady)
        if stands[k]:
            carry[STAND_NIS] += stand(
                state, out[0], step_s, noise, settings, x, P, bias, H, room, tape, taped
            )
            carry[STOOD] += 3.0
        r = roll_of[k]
        if r >= 0 and not stands[k]:
            rate = carry[RATE : RATE + 3]
            roll_out[r] = roll(
                state, out[0], rate, rolled[r], mount, settings, x, P, bias, H, room, tape, taped
            )
        j = fix_of[k]
        if j >= 0:
            if stands[k] or r >= 0:  # what stood or rolled has moved the solution
                q = (state[0], state[1], state[2], state[3])
                record(out, AT_0, dcm(q), triple(state, V), triple(state, R))
            take_fix(
                state,
                out[0],
                fixes[j],
                late_s[k],
                carry,
                trail,
                settings,
                x,
                P,
                bias,
                H,
                room,
                fix_out[j],
                tape,
                taped,
            )
        if phis.shape[0] > 0:
            for i in range(G_):
                put(phis[k, i], Phi[i], DRIVING)
            tape_ends[k] = taped[0]
        if emits[k]:
            emit(state, bias, P, rows_out, written)
            if P_out.shape[0] > 0:
                for i in range(P_out.shape[1]):
                    for l in range(P_out.shape[2]):
                        P_out[written, i, l] = P[i, l]
            written += 1
        C = dcm_ne(local_frame(triple(state, R)))
        put_triple(carry, AT_BEFORE, rotate(C, triple(state, V)))
        carry[DT] = carry[STEP_ROWS] = 0.0
