"""The parked stretch of a run: ten-second means less what the twin expects, whitened with the
twin's own noise::

    r_c = b_c(t) + (A phi)_c + noise,   c = gyro x, y, z, accelerometer x, y, z

phi: error of the nominal attitude, which the run itself gave and nobody else knows, so it is wide:
what a heading or a level can absorb never counts as a gap. Everything is linear: the same operator
whitens the data and every signature. A vehicle that moves on its gear is `vehicle_motion`'s.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from ins.errors.telemetry import Trace, stacked
from ins.estimation.measurements.gravity import rest_readings
from ins.records import TwinModel
from simreal.evidence.noise_model import ChannelNoise, channel_noises
from simreal.evidence.run_view import RunView
from simreal.evidence.vehicle_motion import to_the_end

PARKED_MEAN_S = 10.0
WIDE_TILT_RAD, WIDE_HEADING_RAD = 0.1, 1.0


@lru_cache(maxsize=64)
def cholesky_of(noise: ChannelNoise, bins: int, start_s: float) -> NDArray:
    """Lower Cholesky factor (bins, bins) of the covariance of ten-second means."""
    return np.linalg.cholesky(noise.covariance(bins, PARKED_MEAN_S, start_s))


@dataclass(frozen=True)
class Handoff:
    """What the parked stretch knows at its end of phi (3), gyro biases (3), accelerometer biases
    (3): SI.

    mean (9, m) for each of the m columns whitened with it, covariance (9, 9).
    """

    mean: NDArray
    covariance: NDArray


class ParkedBlock:
    """Whitening of one run's parked stretch; channels in the order of `Seconds`, bins of ten
    seconds.

    uneven : density of white noise beyond that of `noise` at each second of the run (6, n).
    """

    def __init__(
        self,
        view: RunView,
        twin: TwinModel,
        noise: tuple[ChannelNoise, ...] | None = None,
        uneven: NDArray | None = None,
    ) -> None:
        first = int(np.searchsorted(view.seconds.end_s, view.start_s + 1e-6))
        self.bins = int((view.end_s - view.start_s + 1e-6) // PARKED_MEAN_S)
        self.seconds = slice(first, first + self.bins * int(PARKED_MEAN_S))
        self.start_s = round(view.start_s - view.run.imu.start_s)
        self.noise = channel_noises(twin, view.run_s, view.C_nb) if noise is None else noise
        self.uneven = np.zeros((6, self.bins))
        if uneven is not None:
            self.uneven = uneven[:, self.seconds].reshape(6, self.bins, -1).mean(axis=2)
        self.live = ~view.seconds.dead
        self.motion = view.motion
        # sensors whose rows are evidence, and those whose rows are of the twin's noise alone
        self.shown, self.steady = self.live.copy(), self.live & (view.motion is None)
        if view.motion is not None:
            self.shown[:3] &= ~view.motion.level
        site = view.run.header.site
        nominal = rest_readings(view.C_nb, lat_rad=site.lat_rad, height_m=site.height_m)
        # measured less nominal: what phi makes the nominal ones less
        self.A = -np.vstack([nominal.rate_of_phi, nominal.force_of_phi])
        self.expected = np.concatenate([nominal.rate, nominal.force])
        heading = min(view.sigma_heading_rad, WIDE_HEADING_RAD)
        self._sigma0 = np.array([WIDE_TILT_RAD, WIDE_TILT_RAD, heading])
        self._factors = [self._factor(c) for c in range(6)]
        self._prepare()

    @property
    def rows(self) -> int:
        return 6 * self.bins

    def _factor(self, c: int) -> NDArray:
        """Lower Cholesky factor of a channel's means."""
        if self.motion is None and not self.uneven[c].any():
            return cholesky_of(self.noise[c], self.bins, self.start_s)
        C = self.noise[c].covariance(self.bins, PARKED_MEAN_S, self.start_s)
        C[np.diag_indices(self.bins)] += self.uneven[c] / PARKED_MEAN_S
        if self.motion is None:
            return np.linalg.cholesky(C)
        C += self.motion.covariance(c)
        for turn in np.flatnonzero(self._integrates(c)):
            of_gyro = replace(self.noise[turn], bounded=0.0, lines=())
            B = self.motion.force_of_turn[c - 3, turn] * to_the_end(self.bins)
            C += B @ of_gyro.covariance(self.bins, PARKED_MEAN_S, self.start_s) @ B.T
        return np.linalg.cholesky(C)

    def _integrates(self, c: int) -> NDArray:
        """Which gyros' errors a channel holds the integral of (3,)."""
        if self.motion is None or c < 3:
            return np.zeros(3, bool)
        return self.live[:3] & (self.motion.force_of_turn[c - 3] != 0.0)

    def _with_turns(self, means: NDArray) -> NDArray:
        """Means (6, bins, m) with what the turning back of the vehicle makes of the gyros' ones."""
        if self.motion is None:
            return means
        turns = np.tensordot(to_the_end(self.bins), means[:3], axes=(1, 1)).transpose(1, 0, 2)
        out = means.copy()
        out[3:] += np.tensordot(self.motion.force_of_turn, turns, axes=(1, 0))
        return out * self.shown[:, None, None]

    def _solved(self, c: int, columns: NDArray) -> NDArray:
        return np.asarray(
            solve_triangular(self._factors[c], columns, lower=True, check_finite=False)
        )

    def log_sigma(self, channels: NDArray) -> float:
        """Log of the root of the determinant of some channels' covariances."""
        return float(sum(np.log(np.diag(self._factors[c])).sum() for c in channels))

    @property
    def log_sigma_of_rows(self) -> float:
        """The same of all rows, with what phi adds to their covariance."""
        return self.log_sigma(np.flatnonzero(self.shown)) - float(np.log1p(-self._shrink).sum())

    def _prepare(self) -> None:
        of_phi = self._with_turns(np.repeat(self.A[:, None, :], self.bins, axis=1))
        tilde = np.zeros((6, self.bins, 3))
        gains = np.zeros((6, 6, self.bins))  # of the bias of a sensor at the end, by channel
        prior = np.zeros(6)
        for c in np.flatnonzero(self.live).tolist():
            to_end = _covariance_with_end(self.noise[c], self.bins, self.start_s)
            prior[c] = to_end[-1]
            if self.shown[c]:
                tilde[c] = self._solved(c, of_phi[c] * self._sigma0)
                gains[c, c] = self._solved(c, to_end[:-1])
            for other in range(3, 6):
                if c < 3 and self.shown[other] and self._integrates(other)[c]:
                    assert self.motion is not None
                    turned = to_the_end(self.bins) @ to_end[:-1]
                    gains[c, other] = self._solved(
                        other, self.motion.force_of_turn[other - 3, c] * turned
                    )
        self._tilde = tilde.reshape(-1, 3)  # per sigma of phi
        U, s, _ = np.linalg.svd(self._tilde, full_matrices=False)
        self._U, self._shrink = U, 1.0 - 1.0 / np.sqrt(1.0 + s**2)
        self._posterior = np.linalg.inv(self._tilde.T @ self._tilde + np.eye(3))
        self._gains = gains.reshape(6, self.rows)
        self._end_variance = np.diag(prior) - self._gains @ self._gains.T

    def residual(self, view: RunView) -> NDArray:
        """Ten-second means less expectation (6, bins)."""
        mean = (
            view.seconds.mean[self.seconds].reshape(self.bins, int(PARKED_MEAN_S), 6).mean(axis=1)
        )
        return ((mean - self.expected) * self.shown).T

    def of_traces(self, traces: list[Trace]) -> NDArray:
        """Ten-second means (6, bins, m) of what effects add."""
        out = np.zeros((6, self.bins, len(traces)))
        for offset, name in ((0, "gyro_rad_s"), (3, "accel_m_s2")):
            for held, series in stacked(traces, name, self.seconds):
                means = series.reshape(self.bins, int(PARKED_MEAN_S), 3, -1).mean(axis=1)
                out[offset : offset + 3, :, held] = means.transpose(1, 0, 2)
        return self._with_turns(out * self.live[:, None, None])

    def whiten(self, residual: NDArray) -> tuple[NDArray, Handoff]:
        """Whitened columns (6 * bins, m) of residuals (6, bins, m), and what they say of the state
        at the end.
        """
        m = residual.shape[2]
        z = np.zeros_like(residual)
        for c in range(6):
            used = np.flatnonzero(np.any(residual[c] != 0.0, axis=0))
            if used.size and self.shown[c]:
                z[c][:, used] = self._solved(c, residual[c][:, used])
        flat = z.reshape(self.rows, m)
        phi = self._posterior @ (self._tilde.T @ flat)
        bias = self._gains @ (flat - self._tilde @ phi)
        white = flat - self._U @ (self._shrink[:, None] * (self._U.T @ flat))
        return white, Handoff(
            np.vstack([self._sigma0[:, None] * phi, bias]), self._end_covariance()
        )

    def _end_covariance(self) -> NDArray:
        P = np.zeros((9, 9))
        # of phi's error
        carried = -self._gains @ self._tilde
        P[:3, :3] = np.outer(self._sigma0, self._sigma0) * self._posterior
        P[3:, :3] = carried @ self._posterior * self._sigma0
        P[:3, 3:] = P[3:, :3].T
        P[3:, 3:] = self._end_variance + carried @ self._posterior @ carried.T
        return P


def _covariance_with_end(noise: ChannelNoise, bins: int, start_s: float) -> NDArray:
    """Covariance of the slow bias (no white, no bounded noise) over the ten seconds after with each
    bin's mean (bins,), then its own variance.
    """
    slow = replace(noise, white=0.0, bounded=0.0, sway=0.0)
    return slow.covariance(bins + 1, PARKED_MEAN_S, start_s)[-1]
