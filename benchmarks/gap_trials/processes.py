"""Random processes and memories that the planted effects are made of; written apart from
trajectories and simreal.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter, lfilter_zi, ss2tf

PLAY_WIDTHS = (0.7, 1.0, 1.3)  # a real material has a spread of widths (Preisach), not one
PLAY_WEIGHTS = (0.25, 0.5, 0.25)
BURN_IN_S = 120.0  # of the oscillator, many times its decay


def lagged(values: NDArray, *, tau_s: float, dt_s: float) -> NDArray:
    """First-order lag of (n,) samples, settled before the first."""
    keep = np.exp(-dt_s / tau_s)
    b, a = [1 - keep], [1.0, -keep]
    return lfilter(b, a, values, zi=lfilter_zi(b, a) * values[0])[0]


def white(rng: np.random.Generator, n: int, *, density: float, dt_s: float) -> NDArray:
    """Increments (n,) over dt of white noise with two-sided PSD density^2."""
    return density * np.sqrt(dt_s) * rng.standard_normal(n)


def gauss_markov(
    rng: np.random.Generator, n: int, *, rms: float, tau_s: float, dt_s: float
) -> NDArray:
    """First-order Gauss-Markov samples (n,), steady from the start."""
    keep = np.exp(-dt_s / tau_s)
    drive = rms * np.sqrt(1 - keep**2) * rng.standard_normal(n)
    drive[0] /= np.sqrt(1 - keep**2)
    return lfilter([1.0], [1.0, -keep], drive)


def flicker(rng: np.random.Generator, n: int, *, instability: float, dt_s: float) -> NDArray:
    """Two-sided PSD B^2 / (2 pi f), (n,): Gauss-Markov processes an octave apart, from dt / pi to 4
    n dt / (2 pi).

    Each has the PSD 2 s^2 tau / (1 + (2 pi f tau)^2); their sum is s^2 / (2 f ln 2), so s^2 = B^2
    ln 2 / pi.
    """
    rms = instability * np.sqrt(np.log(2) / np.pi)
    octaves = int(np.ceil(np.log2(2.0 * n)))
    return sum(
        (
            gauss_markov(rng, n, rms=rms, tau_s=dt_s / np.pi * 2.0**k, dt_s=dt_s)
            for k in range(octaves + 1)
        ),
        np.zeros(n),
    )


def random_walk(rng: np.random.Generator, n: int, *, density: float, dt_s: float) -> NDArray:
    """A walk (n,) whose variance grows by density^2 a second."""
    return np.cumsum(density * np.sqrt(dt_s) * rng.standard_normal(n))


def oscillator_velocity(
    rng: np.random.Generator,
    n: int,
    *,
    rms: float,
    frequency_hz: float,
    damping: float,
    dt_s: float,
) -> NDArray:
    """Velocity (n,) of x'' + 2 z w x' + w^2 x = white force, exact at the samples, in its steady
    state.

    The sampled noise is Van Loan's integral; the filter is the transfer function from it to the
    velocity.
    """
    w = 2 * np.pi * frequency_hz
    A = np.array([[0.0, 1.0], [-(w**2), -2 * damping * w]])
    Q = np.diag([0.0, 4 * damping * w * rms**2])  # steady velocity variance rms^2
    loan = expm(np.block([[-A, Q], [np.zeros((2, 2)), A.T]]) * dt_s)
    Phi = loan[2:, 2:].T
    L = np.linalg.cholesky(Phi @ loan[:2, 2:])
    more = int(BURN_IN_S / dt_s)
    drive = rng.standard_normal((2, n + more))
    out = np.zeros(n + more)
    for k in range(2):
        numerator, denominator = ss2tf(Phi, L, np.array([[0.0, 1.0]]), np.zeros((1, 2)), input=k)
        out += lfilter(numerator[0], denominator, drive[k])
    return out[more:]


def play(values: NDArray, *, width: float, step: int = 10) -> NDArray:
    """Mean backlash P(v) - v of a spread of play widths about `width`, (n,), between -width and
    width; free at first.

    Worked out at every `step`-th sample, straight in between.
    """
    rows = np.arange(0, values.size, step)
    out = np.zeros(rows.size)
    for share, weight in zip(PLAY_WIDTHS, PLAY_WEIGHTS):
        half, inside, path = share * width, float(values[0]), np.empty(rows.size)
        for k, value in enumerate(values[rows].tolist()):
            inside = min(max(inside, value - half), value + half)
            path[k] = inside - value
        out += weight * path
    return np.interp(np.arange(values.size), rows, out)


def rounded_sum(increments: NDArray, quantum: float) -> NDArray:
    """Increments (n,) of the accumulated value that counts whole quanta."""
    return np.diff(quantum * np.floor(np.cumsum(increments) / quantum), prepend=0.0)


def smooth_step(time_s: NDArray, *, onset_s: float, rise_s: float) -> NDArray:
    """0 to 1 about onset_s, logistic."""
    return 0.5 * (1 + np.tanh((time_s - onset_s) / rise_s))
