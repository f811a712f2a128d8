"""The slowest part of a stream: means over tens of seconds, with their whole covariance.

What is no noise is taken out with flat priors: a constant for each level on which the vehicle
stands (Earth rate, gravity, turn-on), the bias against temperature, what the other triad tells of a
slow tilt. Only contrasts that are free of all that enter the likelihood (restricted maximum
likelihood), so each of them costs what it costs.

Decision: docs/decisions/0034-flicker-walk.md.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from simreal.twin.fit.streams import ParkedStream
from simreal.twin.fit.terms import NoiseTerm, Shape, bin_covariance

FEWEST_BINS = 6  # one for a level, two for temperature, one for a tilt, 2 that say something
# degC a log must span for each power of the temperature: a table's bias bends over about 20 degC
POWERS_degC = (1.0, 6.0, 15.0)
RATE_ABOVE_degC = 6.0  # from here on, with the 2nd power, the rate of temperature is one too
# contrasts of the slowest waves whose whole covariance counts; those of quicker ones are next to
# independent of them and of each other, as cosines of a random walk are
WHOLE = 48
DIED_DOWN = 3.0  # times its own decay: 5 % of the sway are left
SHAPE_GRID = 0.1  # of a log frequency or damping, as which templates are kept
RANK = 1e-8  # relative: a regressor that the others hold already, to the root of 1e-16


@dataclass(frozen=True)
class SlowData:
    """Contrasts y (n - p,) of one channel in one run: Q (n, n - p) makes them of means over bins
    start_s, end_s (n,); of_bins: covariances of the means themselves, which the channels of a run
    share.
    """

    channel: int
    start_s: NDArray
    end_s: NDArray
    run_s: float
    Q: NDArray
    y: NDArray
    of_bins: dict[tuple[NoiseTerm, Shape], NDArray] = field(repr=False)
    known: dict[tuple[NoiseTerm, Shape], "Covariance"] = field(default_factory=dict, repr=False)

    @property
    def block_s(self) -> float:
        """Length of each bin."""
        return float(self.end_s[0] - self.start_s[0])

    def kind(self, term: NoiseTerm, shape: Shape) -> tuple[NoiseTerm, Shape]:
        """The template that a term has here: what is white is white; a sway that has died down
        within a bin looks like any bounded error; another one is told to a tenth of its shape.
        """
        if term in (NoiseTerm.WHITE, NoiseTerm.CREEP):
            return NoiseTerm.WHITE, Shape()
        if term is NoiseTerm.SWAY:
            if shape.sway_zeta * shape.sway_w * self.block_s > DIED_DOWN:
                return NoiseTerm.QUANTIZATION, Shape()
            w, zeta = (
                float(np.exp(np.round(np.log(v) / SHAPE_GRID) * SHAPE_GRID))
                for v in (shape.sway_w, shape.sway_zeta)
            )
            return NoiseTerm.SWAY, Shape(sway_w=w, sway_zeta=zeta)
        return term, shape if term is NoiseTerm.MARKOV else Shape()

    @property
    def whole(self) -> int:
        """How many of the slowest contrasts are taken with their whole covariance."""
        return min(WHOLE, self.y.size)

    def covariance(self, term: NoiseTerm, shape: Shape, *, keep: bool = True) -> "Covariance":
        """Covariance of the contrasts for a term of unit variance; kept while its shape stays."""
        if term is NoiseTerm.WHITE:
            ones = np.full(self.y.size, 1.0 / self.block_s)
            return Covariance(np.diag(ones[: self.whole]), ones[self.whole :])
        key = (term, shape)
        if key in self.known:
            return self.known[key]
        if key not in self.of_bins:
            self.of_bins.pop(next((k for k in self.of_bins if k[0] is term), key), None)
            V = bin_covariance(term, self.start_s, self.end_s, shape, run_s=self.run_s)
            self.of_bins[key] = V
        half = self.of_bins[key] @ self.Q
        slow = self.Q[:, : self.whole].T @ half[:, : self.whole]
        quick = np.einsum("nk,nk->k", self.Q[:, self.whole :], half[:, self.whole :])
        found = Covariance(slow, quick)
        if keep:
            self.known.pop(next((k for k in self.known if k[0] is term), key), None)
            self.known[key] = found
        return found


@dataclass(frozen=True)
class Covariance:
    """Of contrasts: the slowest among each other (w, w), the variances of the rest."""

    slow: NDArray
    quick: NDArray


def slow_data(stream: ParkedStream, block_s: float) -> list[SlowData]:
    """The six channels of a stream as means over block_s."""
    n = round(block_s)
    rows = [np.arange(a, a + (b - a) // n * n).reshape(-1, n) for a, b in stream.spans]
    blocks = np.concatenate(rows)
    if len(blocks) < FEWEST_BINS:
        return []
    end = stream.seconds.end_s
    start_s, end_s = end[blocks[:, 0]] - 1.0, end[blocks[:, -1]]
    mean = stream.seconds.mean[blocks].mean(axis=1)
    common = _common(stream, stream.place[blocks[:, 0]], 0.5 * (start_s + end_s))
    found = []
    of_bins: dict[tuple[NoiseTerm, Shape], NDArray] = {}
    for c in range(6):
        own = [common[min(c % 3, len(common) - 1)]]
        if c < 3:
            own.append(_tilting(stream, mean, end_s - start_s, stream.place[blocks[:, 0]], c))
        X = np.concatenate(own, axis=1)
        Q, y = _contrasts(X, mean[:, c])
        if y.size >= FEWEST_BINS:
            found.append(SlowData(c, start_s, end_s, stream.run_s, Q, y, of_bins))
    return found


def _common(stream: ParkedStream, place: NDArray, middle_s: NDArray) -> list[NDArray]:
    """Regressors (n, p) that each axis has: places, powers of temperature."""
    places = (place[:, None] == np.unique(place)).astype(float)
    if stream.temperature is None:
        return [places]
    T = stream.temperature.at(middle_s)
    nodes = stream.temperature
    found = []
    for axis in range(3):
        span = float(np.ptp(T[:, axis]))
        u = (T[:, axis] - T[:, axis].mean()) / max(span, 1e-9)
        columns = [places]
        columns += [u[:, None] ** (k + 1) for k, least in enumerate(POWERS_degC) if span > least]
        if span > RATE_ABOVE_degC:
            rate = np.interp(middle_s, nodes.time_s, nodes.rate_degC_min[:, axis])
            columns.append((rate - rate.mean())[:, None])
        found.append(np.concatenate(columns, axis=1))
    return found


def _tilting(
    stream: ParkedStream, mean: NDArray, seconds: NDArray, place: NDArray, axis: int
) -> NDArray:
    """Regressor (n, 1): the rate about a body axis at which the vertical of the accelerometers
    turns, d(up)/dt = -omega x up; none across a disturbance.
    """
    site = stream.run.header.site
    gravity = float(gravity_magnitude(site.lat_rad, site.height_m))
    up = mean[:, 3:] / gravity
    change = np.zeros_like(up)
    change[1:-1] = 0.5 * (up[2:] - up[:-2])
    alike = np.zeros(len(up), bool)
    alike[1:-1] = (place[2:] == place[1:-1]) & (place[:-2] == place[1:-1])
    rate = np.cross(stream.up_b, change / seconds[:, None])[:, axis] * alike
    size = float(np.sqrt(np.mean(rate**2)))
    # a vehicle that tilts by less than this has no tilt to speak of
    if size < 1e-9 * EARTH_RATE_RAD_S:
        return np.zeros((len(up), 0))
    return np.asarray((rate / size)[:, None])


def _contrasts(X: NDArray, values: NDArray) -> tuple[NDArray, NDArray]:
    """An orthonormal basis (n, n - p) of what the regressors leave, slow contrasts first, and the
    values (n - p,) in it.
    """
    n = len(X)
    U, s, _ = np.linalg.svd(X / np.maximum(np.linalg.norm(X, axis=0), 1e-300), full_matrices=False)
    U = U[:, s > RANK * s[0]]
    k, m = np.arange(n), np.arange(n)
    waves = np.cos(np.pi * np.outer(m + 0.5, k) / n)  # slow first
    waves -= U @ (U.T @ waves)
    Q, R = np.linalg.qr(waves)
    # columns that the regressors hold come out without size; there are as many as regressors
    keep = np.sort(np.argsort(-np.abs(np.diag(R)))[: n - U.shape[1]])
    Q = Q[:, keep]
    Q -= U @ (U.T @ Q)
    Q, _ = np.linalg.qr(Q)
    return Q, Q.T @ values
