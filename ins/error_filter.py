"""Kalman filter over the errors of a navigation solution, with the gyro bias as constants over time bins.

State: the base states of `ins.error_model`, then the gyro bias of each time bin in body axes [rad/s]
(bin 0 x, y, z, bin 1 x, ...). The bins are static and start with their full joint covariance, so the last posterior
of every bin is its smoothed estimate; no backward pass is needed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ins import error_model as em
from ins import kalman

GATE_SIGMA = 6.0  # a residual beyond this many sigmas is left out and listed, not used


@dataclass
class Tally:
    """NIS kept by kind of measurement: sum, degrees of freedom, times and reasons of what the gate left out."""

    nis: dict[str, float] = field(default_factory=dict)
    dof: dict[str, int] = field(default_factory=dict)
    rejected: list[tuple[float, str]] = field(default_factory=list)
    normalised: dict[str, list[NDArray]] = field(default_factory=dict)
    heading_gain: dict[str, float] = field(default_factory=dict)

    def add(self, kind: str, seen: kalman.Innovation) -> None:
        self.nis[kind] = self.nis.get(kind, 0.0) + seen.nis
        self.dof[kind] = self.dof.get(kind, 0) + seen.residual.size
        self.normalised.setdefault(kind, []).append(np.linalg.solve(np.linalg.cholesky(seen.S), seen.residual))


class ErrorFilter:
    """x (n,), P (n, n), n = 24 + 3 bins. `sigma0` gives the base states' prior sigmas by name of `error_model`.

    bias_mean (3 bins,) and bias_covariance (3 bins, 3 bins) [rad/s, (rad/s)^2]: the prior of the gyro bias.
    """

    def __init__(
        self,
        *,
        sigma0: Mapping[str, float],
        noise: em.ProcessNoise,
        bias_mean: NDArray,
        bias_covariance: NDArray,
    ) -> None:
        n = em.BASE + bias_mean.size
        self.noise = noise
        self.x, self.P = np.zeros(n), np.zeros((n, n))
        for name, sigma in sigma0.items():
            index = getattr(em, name)
            for i in range(index.start, index.stop) if isinstance(index, slice) else (index,):
                self.P[i, i] = sigma**2
        self.x[em.BASE :] = bias_mean
        self.P[em.BASE :, em.BASE :] = bias_covariance
        self.clone(em.THETA_START)
        self.tally = Tally()

    def clone(self, target: slice) -> None:
        """Copy theta as it stands now into a static clone, fully correlated with it."""
        M = np.eye(self.x.size)
        M[target] = 0.0
        M[target, em.THETA] = np.eye(3)
        self.x, self.P = M @ self.x, M @ self.P @ M.T

    def assign(self, index: int, row: NDArray, sigma: float) -> None:
        """Replace one state by a combination of the others plus independent noise (row zero: a fresh prior)."""
        M = np.eye(self.x.size)
        M[index] = row
        self.x, self.P = M @ self.x, M @ self.P @ M.T
        self.P[index, index] += sigma**2

    def withdraw_prior(self, index: int, sigma: float) -> None:
        """Take back what the prior N(0, sigma^2) of a static state said: the update of that state with variance
        -sigma^2. Exact; needs the posterior of the state to be well inside its prior, else nothing is done.
        """
        S = self.P[index, index] - sigma**2
        if S > -0.5 * sigma**2:
            return
        gain = self.P[:, index] / S
        self.x = self.x - gain * self.x[index]
        P = self.P - np.outer(gain, self.P[index, :])
        self.P = 0.5 * (P + P.T)

    def advance(
        self, step: em.Step, bin_index: int, *, rolling: bool, keep_displacement: bool = False, extra_yaw_rad: float = 0.0
    ) -> None:
        """Propagate over one step with the gyro bias of bin `bin_index`.

        keep_displacement: S goes on from the step before instead of starting at zero.
        extra_yaw_rad: sigma of a sudden turn of the parked vehicle within the step (boarding, a bump).
        """
        Phi, Gamma, Q = em.discretize(step, self.noise, rolling=rolling, keep_displacement=keep_displacement)
        n, column = self.x.size, em.BASE + 3 * bin_index
        F, Q_full = np.eye(n), np.zeros((n, n))
        F[: em.BASE, : em.BASE] = Phi
        F[: em.BASE, column : column + 3] = Gamma
        Q_full[: em.BASE, : em.BASE] = Q
        Q_full[em.YAW, em.YAW] += extra_yaw_rad**2
        self.x, self.P = kalman.predict(self.x, self.P, F, Q_full)

    def measure(self, kind: str, z: NDArray, H: NDArray, R: NDArray, time_s: float, *, gate: bool = True) -> bool:
        """Use a measurement unless the gate refuses it; returns whether it was used."""
        seen = kalman.innovation(self.x, self.P, z, H, R)
        if np.any(np.diag(seen.S) < 0.9 * np.diag(R)):
            raise ArithmeticError(f"{kind} at {time_s:.1f} s: the covariance has lost its digits")
        if gate and np.any(np.abs(seen.residual) > GATE_SIGMA * np.sqrt(np.diag(seen.S))):
            self.tally.rejected.append((time_s, kind))
            return False
        before = self.P[em.THETA_CLONE.stop - 1, em.THETA_CLONE.stop - 1]
        self.x, self.P, seen = kalman.update(self.x, self.P, z, H, R, seen)
        self.tally.add(kind, seen)
        after = self.P[em.THETA_CLONE.stop - 1, em.THETA_CLONE.stop - 1]
        if before > 0.0:
            gain = self.tally.heading_gain
            gain[kind] = gain.get(kind, 0.0) + float(np.log(before / after))
        return True

    def row(self, entries: Mapping[int, float]) -> NDArray:
        """One measurement row (n,) from {state index: coefficient}."""
        H = np.zeros(self.x.size)
        for index, value in entries.items():
            H[index] = value
        return H

    @property
    def bias(self) -> tuple[NDArray, NDArray]:
        """Mean (3 bins,) and covariance of the gyro bias bins."""
        return self.x[em.BASE :].copy(), self.P[em.BASE :, em.BASE :].copy()
