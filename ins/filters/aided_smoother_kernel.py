"""The compiled loop of the aided smoother (`ins.filters.aided_smoother`): adjoints from
the end of a log to its beginning.

lam (43,) and Lam (43, 43) are the adjoints of Bryson and Frazier, in the order of
`ins.filters.states`. Arrays in, arrays changed in place, nothing is checked.
"""

from math import exp

import numpy as np

from ins.filters import states
from ins.filters.aided_kernel import DEFLECTION_WAY, SLOW_S, SLOW_V_S, kept_on_the_way
from ins.jit import jit

N, MOTION, UNIT = states.AIDED_STATES, states.AIDED_MOTION, states.AIDED_GYRO.start
DRIVING, DEFLECTED_ = states.AIDED_DRIVING, states.AIDED_DEFLECTION.start
SLOW_, SLOW_V_ = states.AIDED_SLOW_POS.start, states.AIDED_SLOW_VEL.start
LAST_, THETA_ = states.AIDED_SLOW_VEL.stop, states.AIDED_THETA.start
# only kernels call it: less to compile, but a call from Python would end the process
inner = jit(no_cpython_wrapper=True)


@inner
def fading(first, last, fade, lam, Lam):
    """The adjoints before errors from first to last fade."""
    for i in range(first, last):
        lam[i] *= fade
        for j in range(N):
            Lam[i, j] *= fade
        for j in range(N):
            Lam[j, i] *= fade


@inner
def through_step(phi, fade, fade_v, fade_d, lam, Lam, M):
    """lam to Phi' lam, Lam to Phi' Lam Phi; phi (9, 29), M (43, 43) is room.

    The deflection of the vertical fades after it has pushed; slow errors push nothing.
    """
    fading(DEFLECTED_, SLOW_, fade_d, lam, Lam)
    before = lam.copy()
    for j in range(DRIVING):
        total = before[j] if j >= UNIT else 0.0
        for i in range(UNIT):
            total += phi[i, j] * before[i]
        lam[j] = total
    for j in range(DRIVING):
        for l in range(N):
            total = Lam[j, l] if j >= UNIT else 0.0
            for i in range(UNIT):
                total += phi[i, j] * Lam[i, l]
            M[j, l] = total
    for j in range(DRIVING, N):
        for l in range(N):
            M[j, l] = Lam[j, l]
    for i in range(N):
        for j in range(N):
            if j >= DRIVING:
                Lam[i, j] = M[i, j]
                continue
            total = M[i, j] if j >= UNIT else 0.0
            for l in range(UNIT):
                total += M[i, l] * phi[l, j]
            Lam[i, j] = total
    fading(SLOW_, SLOW_V_, fade, lam, Lam)
    fading(SLOW_V_, LAST_, fade_v, lam, Lam)


@inner
def through_measurement(line, lam, Lam, gain, v):
    """The adjoints before a measurement; a line without variance is a new beginning."""
    s, y = line[2 * N], line[2 * N + 1]
    if s == 0.0:
        for i in range(THETA_):
            lam[i] = 0.0
            for j in range(N):
                Lam[i, j] = 0.0
                Lam[j, i] = 0.0
        return
    seen = y / s
    for i in range(N):
        gain[i] = line[N + i] / s
        seen += gain[i] * lam[i]
    # one side after the other: multiplied out, the rounding of what a fix knows to a centimetre
    # would stay beside what is left of it after an outage (tests/ins/test_aided_smoother.py)
    for j in range(N):
        v[j] = 0.0
        for i in range(N):
            v[j] += gain[i] * Lam[i, j]
    for i in range(N):
        lam[i] -= line[i] * seen
        for j in range(N):
            Lam[i, j] -= line[i] * v[j]
    for i in range(N):
        v[i] = 0.0
        for j in range(N):
            v[i] += Lam[i, j] * gain[j]
    for i in range(N):
        for j in range(N):
            Lam[i, j] += (line[i] / s - v[i]) * line[j]


@jit
def backward(step_s, phis, measurements, ends, emits, P_rows, noise, lam, Lam, x_out, P_out):
    """From the end of a piece to its beginning; lam and Lam are changed in place."""
    M, gain, v = np.zeros((N, N)), np.zeros(N), np.zeros(N)
    row = x_out.shape[0]
    for k in range(step_s.size - 1, -1, -1):
        if emits[k]:
            row -= 1
            P = P_rows[row]
            for i in range(N):
                for j in range(N):
                    M[i, j] = 0.0
                    for l in range(N):
                        M[i, j] += P[i, l] * Lam[l, j]
            for i in range(MOTION):
                for j in range(N):
                    x_out[row, i] -= P[i, j] * lam[j]
                for j in range(MOTION):
                    total = P[i, j]
                    for l in range(N):
                        total -= M[i, l] * P[l, j]
                    P_out[row, i, j] = total
        first = ends[k - 1] if k > 0 else 0
        for t in range(ends[k] - 1, first - 1, -1):
            through_measurement(measurements[t], lam, Lam, gain, v)
        fade, fade_v = exp(-step_s[k] / noise[SLOW_S]), exp(-step_s[k] / noise[SLOW_V_S])
        fade_d = kept_on_the_way(phis[k], noise[DEFLECTION_WAY])
        through_step(phis[k], fade, fade_v, fade_d, lam, Lam, M)
