"""The one pass over raw rows behind `alignment.motion.disturbed_epochs`; import lazily (numba)."""

from math import sqrt

import numpy as np

from ins.jit import jit


@jit
def add_rows(first, dt, dtheta, dv, epoch, C_nb, f_n, omega_n, offset, lags, ring, largest, energy):
    """Add the rows `first` on, of the epochs `epoch` (m,), to the largest size of the sum over
    a lag and the sum of its squares.

    largest, energy (n, lags, 6): dv x, y, z, then dtheta x, y, z; largest[..., 0] is of the level
    pair (x, y) together, [..., 1] stays zero. ring (longest lag + 1, 6): the running total after
    the last rows, row k in [(k + 1) % its length].

    Sums are over the last `lags[i]` rows, less what a unit at rest reads there: C_nb[j - 1]' (f_n,
    omega_n) dt + offset dt for the rows of epoch j, j >= 1.
    """
    size, rest, j = ring.shape[0], np.zeros(6), 0
    for m in range(dt.size):
        k = first + m
        if epoch[m] != j:
            j = epoch[m]
            for a in range(3):
                rest[a], rest[3 + a] = offset[a], offset[3 + a]
                for i in range(3):
                    rest[a] += C_nb[j - 1, i, a] * f_n[i]
                    rest[3 + a] += C_nb[j - 1, i, a] * omega_n[i]
        total, now = ring[k % size], ring[(k + 1) % size]
        for a in range(3):
            now[a] = total[a] + (dv[m, a] - rest[a] * dt[m])
            now[3 + a] = total[3 + a] + (dtheta[m, a] - rest[3 + a] * dt[m])
        for i in range(lags.size):
            if k + 1 < lags[i]:
                continue
            before = ring[(k + 1 - lags[i]) % size]
            for a in range(6):
                x = now[a] - before[a]
                energy[j, i, a] += x * x
                if a > 1:
                    largest[j, i, a] = max(largest[j, i, a], abs(x))
            x, y = now[0] - before[0], now[1] - before[1]
            level = sqrt(x * x + y * y)
            largest[j, i, 0] = max(largest[j, i, 0], level)
