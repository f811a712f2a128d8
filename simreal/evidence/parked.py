"""The parked stretch of a run: ten-second means less what the twin expects, whitened with the
twin's own noise::

    r_c = b_c(t) + (A phi)_c + noise,   c = gyro x, y, z, accelerometer x, y, z

phi: error of the nominal attitude, which the run itself gave and nobody else knows, so it is wide:
what a heading or a level can absorb never counts as a gap. Everything is linear: the same operator
whitens the data and every signature.
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
    """

    def __init__(
        self, view: RunView, twin: TwinModel, noise: tuple[ChannelNoise, ...] | None = None
    ) -> None:
        first = int(np.searchsorted(view.seconds.end_s, view.start_s + 1e-6))
        self.bins = int((view.end_s - view.start_s + 1e-6) // PARKED_MEAN_S)
        self.seconds = slice(first, first + self.bins * int(PARKED_MEAN_S))
        self.start_s = round(view.start_s - view.run.imu.start_s)
        self.noise = channel_noises(twin, view.run_s, view.C_nb) if noise is None else noise
        self.live = ~view.seconds.dead
        site = view.run.header.site
        nominal = rest_readings(view.C_nb, lat_rad=site.lat_rad, height_m=site.height_m)
        # measured less nominal: what phi makes the nominal ones less
        self.A = -np.vstack([nominal.rate_of_phi, nominal.force_of_phi])
        self.expected = np.concatenate([nominal.rate, nominal.force])
        heading = min(view.sigma_heading_rad, WIDE_HEADING_RAD)
        self._sigma0 = np.array([WIDE_TILT_RAD, WIDE_TILT_RAD, heading])
        self._factors = [cholesky_of(n, self.bins, self.start_s) for n in self.noise]
        self._prepare()

    @property
    def rows(self) -> int:
        return 6 * self.bins

    def _prepare(self) -> None:
        ones = np.ones(self.bins)
        tilde = np.zeros((6, self.bins, 3))
        for c in range(6):
            if self.live[c]:
                tilde[c] = np.outer(
                    solve_triangular(self._factors[c], ones, lower=True), self.A[c] * self._sigma0
                )
        self._tilde = tilde.reshape(-1, 3)  # per sigma of phi
        U, s, _ = np.linalg.svd(self._tilde, full_matrices=False)
        self._U, self._shrink = U, 1.0 - 1.0 / np.sqrt(1.0 + s**2)
        self._posterior = np.linalg.inv(self._tilde.T @ self._tilde + np.eye(3))
        self._gains = np.zeros((6, self.bins))
        prior = np.zeros(6)
        for c, noise in enumerate(self.noise):
            to_end = _covariance_with_end(noise, self.bins, self.start_s)
            self._gains[c] = (
                solve_triangular(self._factors[c], to_end[:-1], lower=True) if self.live[c] else 0.0
            )
            prior[c] = to_end[-1]
        self._end_variance = prior - np.sum(self._gains**2, axis=1)

    def residual(self, view: RunView) -> NDArray:
        """Ten-second means less expectation (6, bins)."""
        mean = (
            view.seconds.mean[self.seconds].reshape(self.bins, int(PARKED_MEAN_S), 6).mean(axis=1)
        )
        return ((mean - self.expected) * self.live).T

    def of_traces(self, traces: list[Trace]) -> NDArray:
        """Ten-second means (6, bins, m) of what effects add."""
        out = np.zeros((6, self.bins, len(traces)))
        for offset, name in ((0, "gyro_rad_s"), (3, "accel_m_s2")):
            for held, series in stacked(traces, name, self.seconds):
                means = series.reshape(self.bins, int(PARKED_MEAN_S), 3, -1).mean(axis=1)
                out[offset : offset + 3, :, held] = means.transpose(1, 0, 2)
        return out * self.live[:, None, None]

    def whiten(self, residual: NDArray) -> tuple[NDArray, Handoff]:
        """Whitened columns (6 * bins, m) of residuals (6, bins, m), and what they say of the state
        at the end.
        """
        m = residual.shape[2]
        z = np.zeros_like(residual)
        for c in range(6):
            used = np.flatnonzero(np.any(residual[c] != 0.0, axis=0))
            if used.size and self.live[c]:
                z[c][:, used] = solve_triangular(
                    self._factors[c], residual[c][:, used], lower=True, check_finite=False
                )
        flat = z.reshape(self.rows, m)
        phi = self._posterior @ (self._tilde.T @ flat)
        bias = np.einsum(
            "cb,cbm->cm", self._gains, (flat - self._tilde @ phi).reshape(6, self.bins, m)
        )
        white = flat - self._U @ (self._shrink[:, None] * (self._U.T @ flat))
        return white, Handoff(
            np.vstack([self._sigma0[:, None] * phi, bias]), self._end_covariance()
        )

    def _end_covariance(self) -> NDArray:
        P = np.zeros((9, 9))
        # of phi's error
        carried = -np.einsum("cb,cbk->ck", self._gains, self._tilde.reshape(6, self.bins, 3))
        P[:3, :3] = np.outer(self._sigma0, self._sigma0) * self._posterior
        P[3:, :3] = carried @ self._posterior * self._sigma0
        P[:3, 3:] = P[3:, :3].T
        P[3:, 3:] = np.diag(self._end_variance) + carried @ self._posterior @ carried.T
        return P


def _covariance_with_end(noise: ChannelNoise, bins: int, start_s: float) -> NDArray:
    """Covariance of the slow bias (no white, no bounded noise) over the ten seconds after with each
    bin's mean (bins,), then its own variance.
    """
    slow = replace(noise, white=0.0, bounded=0.0, sway=0.0)
    return slow.covariance(bins + 1, PARKED_MEAN_S, start_s)[-1]
