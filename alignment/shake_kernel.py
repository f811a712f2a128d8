"""The one pass over the raw rows behind `alignment.shake`. Import lazily: this module loads numba."""

from math import sqrt

from ins.jit import jit


@jit
def epoch_extremes(dt, dtheta, dv, ends, C_nb, f_n, omega_n, offset, lags, largest, energy):
    """Fill largest |sum over a lag| and mean square of it, (n, lags, 6): dv x, y, z, then dtheta x, y, z.

    largest[..., 0] is of the level pair (x, y) together, [..., 1] stays zero.

    Sums are over the last `lags[i]` rows, less what a unit at rest reads there: C_nb[j - 1]' (f_n, omega_n) dt + offset
    dt for the rows ends[j - 1] to ends[j] of epoch j.
    """
    size = 1
    for i in range(lags.size):
        size = max(size, lags[i] + 1)
    ring, total, rest = [[0.0] * 6 for _ in range(size)], [0.0] * 6, [0.0] * 6
    for j in range(1, ends.size):
        for a in range(3):
            rest[a], rest[3 + a] = offset[a], offset[3 + a]
            for i in range(3):
                rest[a] += C_nb[j - 1, i, a] * f_n[i]
                rest[3 + a] += C_nb[j - 1, i, a] * omega_n[i]
        for k in range(ends[j - 1], ends[j]):
            now = ring[(k + 1) % size]
            for a in range(3):
                total[a] += dv[k, a] - rest[a] * dt[k]
                total[3 + a] += dtheta[k, a] - rest[3 + a] * dt[k]
            for a in range(6):
                now[a] = total[a]
            for i in range(lags.size):
                if k + 1 < lags[i]:
                    continue
                before = ring[(k + 1 - lags[i]) % size]
                for a in range(6):
                    x = total[a] - before[a]
                    energy[j, i, a] += x * x
                    if a > 1:
                        largest[j, i, a] = max(largest[j, i, a], abs(x))
                level = sqrt((total[0] - before[0]) ** 2 + (total[1] - before[1]) ** 2)
                largest[j, i, 0] = max(largest[j, i, 0], level)
        for i in range(lags.size):
            for a in range(6):
                energy[j, i, a] /= max(ends[j] - ends[j - 1], 1)
