"""Errors of many gyro and accelerometer triads, run by run, as they change the increments of one
shared log::

    dtheta' = (I + M) dtheta + b dt + sigma sqrt(dt) n        and the same for dv, in body axes

b is constant over bins of time, so that any slow course (temperature, flicker, a table's residual)
is followed by short bins; n is white, of unit variance. Signs: measured - true (CONVENTIONS.md).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.records import ImuLog, InputError, frozen_array

RUN_FIELDS = ("gyro_bias_rad_s", "accel_bias_m_s2", "gyro_matrix", "accel_matrix", "seeds")


@dataclass(frozen=True, kw_only=True)
class SensorErrors:
    """What each run's sensors read beyond the shared log; None and zero: nothing.

    Parameters
    ----------
    gyro_bias_rad_s, accel_bias_m_s2 : array_like, shape (runs, 3) or (runs, bins, 3)
        With bins where there are edges.
    edges_s : array_like, shape (bins + 1,)
        Strictly increasing. A row belongs to the bin in which the middle of its interval lies; the
        first and the last bin reach beyond the edges.
    gyro_matrix, accel_matrix : array_like, shape (runs, 3, 3)
        Scale factor errors on the diagonal, misalignments beside it.
    gyro_noise_rad_sqrt_s, accel_noise_m_s_sqrt_s : float
        Angle and velocity random walk, one for all runs (`ins.noise` has them in SI).
    seeds : array_like of int, shape (runs,)
        Needed for noise. A run's noise depends on its seed alone, drawn row after row of the log.

    Raises
    ------
    InputError
        Numbers of runs that differ, values that are not finite, noise without seeds.
    """

    gyro_bias_rad_s: ArrayLike | None = None
    accel_bias_m_s2: ArrayLike | None = None
    edges_s: ArrayLike | None = None
    gyro_matrix: ArrayLike | None = None
    accel_matrix: ArrayLike | None = None
    gyro_noise_rad_sqrt_s: float = 0.0
    accel_noise_m_s_sqrt_s: float = 0.0
    seeds: ArrayLike | None = None

    def __post_init__(self) -> None:
        bins = None
        if self.edges_s is not None:
            edges = frozen_array(self.edges_s, (None,), "SensorErrors.edges_s")
            if edges.size < 2 or not np.all(np.diff(edges) > 0):
                raise InputError(
                    "SensorErrors.edges_s: needs two or more edges, strictly increasing"
                )
            object.__setattr__(self, "edges_s", edges)
            bins = edges.size - 1
        for name in ("gyro_bias_rad_s", "accel_bias_m_s2"):
            self._freeze(name, (None, 3) if bins is None else (None, bins, 3))
        for name in ("gyro_matrix", "accel_matrix"):
            self._freeze(name, (None, 3, 3))
        if self.seeds is not None:
            object.__setattr__(self, "seeds", tuple(int(s) for s in np.asarray(self.seeds).ravel()))
        sigmas = np.array([self.gyro_noise_rad_sqrt_s, self.accel_noise_m_s_sqrt_s])
        if not (np.isfinite(sigmas).all() and np.all(sigmas >= 0)) or (
            sigmas.any() and self.seeds is None
        ):
            raise InputError(
                "SensorErrors: noise must be finite, not negative, and have seeds, one for each run"
            )
        present = [name for name in RUN_FIELDS if getattr(self, name) is not None]
        counts = {name: len(getattr(self, name)) for name in present}
        if len(set(counts.values())) > 1:
            told = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise InputError(f"SensorErrors: runs differ: {told}")

    def _freeze(self, name: str, shape: tuple[int | None, ...]) -> None:
        if getattr(self, name) is None:
            return
        values = frozen_array(getattr(self, name), shape, f"SensorErrors.{name}")
        if not np.isfinite(values).all():
            run = int(np.argwhere(~np.isfinite(values))[0][0])
            raise InputError(f"SensorErrors.{name}: run {run} is not finite")
        object.__setattr__(self, name, values)

    @property
    def runs(self) -> int | None:
        """Number of runs; None where nothing tells."""
        return next(
            (len(getattr(self, n)) for n in RUN_FIELDS if getattr(self, n) is not None), None
        )

    @property
    def noisy(self) -> bool:
        """Whether the sensors add noise."""
        return self.gyro_noise_rad_sqrt_s > 0 or self.accel_noise_m_s_sqrt_s > 0

    def bins(self, imu: ImuLog) -> NDArray:
        """The bin of each row.

        Parameters
        ----------
        imu : ImuLog
            The shared log, n rows.

        Returns
        -------
        bins : ndarray of int, shape (n,)
        """
        inner = np.empty(0) if self.edges_s is None else np.asarray(self.edges_s)[1:-1]
        return np.searchsorted(inner, imu.time_s - 0.5 * imu.dt_s, side="right")

    def biases(self, run: int) -> NDArray:
        """Gyro and accelerometer biases of one run.

        Parameters
        ----------
        run : int

        Returns
        -------
        biases : ndarray, shape (bins, 6)
            In rad/s, then m/s^2.
        """
        bins = 1 if self.edges_s is None else len(np.asarray(self.edges_s)) - 1
        out = np.zeros((bins, 6))
        for columns, bias in (
            (slice(0, 3), self.gyro_bias_rad_s),
            (slice(3, 6), self.accel_bias_m_s2),
        ):
            if bias is not None:
                out[:, columns] = np.asarray(bias)[run]
        return out

    def matrices(self, run: int) -> NDArray:
        """M of the gyros and of the accelerometers of one run.

        Parameters
        ----------
        run : int

        Returns
        -------
        matrices : ndarray, shape (2, 3, 3)
        """
        return np.stack(
            [
                np.zeros((3, 3)) if m is None else np.asarray(m)[run]
                for m in (self.gyro_matrix, self.accel_matrix)
            ]
        )

    def generator(self, run: int) -> np.random.Generator:
        """The source of a run's noise: six normal numbers a row, from row 0 of the log on.

        Parameters
        ----------
        run : int

        Returns
        -------
        generator : numpy.random.Generator
        """
        return np.random.default_rng(int(np.asarray(self.seeds)[run]))

    def noise(self, generator: np.random.Generator, dt_s: NDArray) -> NDArray:
        """Noise of the next rows.

        Parameters
        ----------
        generator : numpy.random.Generator
            Of the run, left after the rows before.
        dt_s : ndarray, shape (n,)
            Intervals of the rows.

        Returns
        -------
        noise : ndarray, shape (n, 6)
            In rad, then m/s.
        """
        sigma = np.repeat([self.gyro_noise_rad_sqrt_s, self.accel_noise_m_s_sqrt_s], 3)
        return generator.standard_normal((dt_s.size, 6)) * (np.sqrt(dt_s)[:, None] * sigma)

    def increments(self, run: int, shared: NDArray, dt_s: NDArray, bins: NDArray) -> NDArray:
        """Increments as one run's sensors give them, without noise.

        Parameters
        ----------
        run : int
        shared : ndarray, shape (n, 6)
            dtheta and dv of the shared log [rad], [m/s].
        dt_s : ndarray, shape (n,)
        bins : ndarray of int, shape (n,)
            The bin of each row.

        Returns
        -------
        rows : ndarray, shape (n, 6)
        """
        M, out = self.matrices(run), shared.copy()
        for k in range(2):
            d = shared[:, 3 * k : 3 * k + 3]
            out[:, 3 * k : 3 * k + 3] += (
                M[k, :, 0] * d[:, :1] + M[k, :, 1] * d[:, 1:2] + M[k, :, 2] * d[:, 2:]
            )
        return out + dt_s[:, None] * self.biases(run)[bins]

    def applied(self, imu: ImuLog, run: int) -> ImuLog:
        """The log that one run's sensors would have written, to the bit that the batch navigates.

        Parameters
        ----------
        imu : ImuLog
            The shared log, from its first row.
        run : int

        Returns
        -------
        imu : ImuLog
        """
        rows = self.increments(
            run, np.hstack([imu.dtheta_rad, imu.dv_m_s]), imu.dt_s, self.bins(imu)
        )
        if self.noisy:
            rows = rows + self.noise(self.generator(run), imu.dt_s)
        return ImuLog(
            time_s=imu.time_s,
            dt_s=imu.dt_s,
            dtheta_rad=rows[:, :3],
            dv_m_s=rows[:, 3:],
            source=imu.source,
        )
