"""Many trajectories at once, on one clock: Monte Carlo studies of drift, finite differences about a
flight.

`navigate_batch` is `ins.strapdown.mechanization.navigate` for runs that share their times. What
differs between runs is the initial state and either the sensor errors laid over one shared log
(`SensorErrors`: nothing of the size of the log is made for a run) or the log itself. Each run comes
out with the bits that `navigate` gives for it alone, whatever the number of threads and whichever
runs are beside it; the sums over epochs that NavHistory has are not made::

    # bias: (runs, 3), or (runs, bins, 3) with edges_s
    errors = SensorErrors(gyro_bias_rad_s=bias)
    flown = navigate_batch(imu, start, errors=errors, epoch_s=10.0, threads=2)
    flown.lat_rad, flown.v_n_m_s  # (runs, epochs), (runs, epochs, 3)
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.navigation_batch_errors import SensorErrors
from ins.records import ImuLog, InputError, NavState
from ins.strapdown.mechanization import VerticalChannel
from ins.strapdown.start import (
    EpochEnds,
    check_initial,
    check_rows,
    check_start,
    earth_frame_state,
    initial_row,
    interval_at,
)

CHUNK_ROWS = 4096  # rows of own increments (noise, own logs) made at a time: 3 MB a thread
EPOCH_COLUMNS = 15  # columns of an epoch


@dataclass(frozen=True, kw_only=True)
class BatchHistory:
    """Navigation solutions of all runs at the epoch ends; epoch 0 is the initial state.

    Parameters
    ----------
    time_s : ndarray, shape (epochs,)
    states : ndarray, shape (runs, epochs, 15)
        Read-only: latitude, longitude [rad], height [m], v_n [m/s], C_nb in row order. The
        properties are views of it.
    """

    time_s: NDArray
    states: NDArray

    @property
    def lat_rad(self) -> NDArray:
        """Latitude, shape (runs, epochs)."""
        return self.states[:, :, 0]

    @property
    def lon_rad(self) -> NDArray:
        """Longitude in [-pi, pi], shape (runs, epochs)."""
        return self.states[:, :, 1]

    @property
    def height_m(self) -> NDArray:
        """Height above the ellipsoid, shape (runs, epochs)."""
        return self.states[:, :, 2]

    @property
    def v_n_m_s(self) -> NDArray:
        """Velocity, NED, shape (runs, epochs, 3)."""
        return self.states[:, :, 3:6]

    @property
    def C_nb(self) -> NDArray:
        """Attitude, shape (runs, epochs, 3, 3)."""
        return self.states[:, :, 6:].reshape(*self.states.shape[:2], 3, 3)


def navigate_batch(
    imu: ImuLog | Sequence[ImuLog],
    initial: NavState | Sequence[NavState],
    *,
    errors: SensorErrors | None = None,
    epoch_s: float | None = 1.0,
    vertical: VerticalChannel | None = None,
    threads: int = 1,
) -> BatchHistory:
    """Integrate many runs from their initial states on.

    Parameters
    ----------
    imu : ImuLog, or one for each run
        One: shared by all runs. Several: with the same time_s and dt_s.
    initial : NavState, or one for each run
        Several: at the same time_s.
    errors : SensorErrors or None
        Each run's sensor errors, added to the shared log.
    epoch_s, vertical : as in `navigate`
        Epochs and damping are the same for all runs; mode "hold" without a height holds each run's
        own.
    threads : int
        Threads over tiles of 16 runs; the result does not depend on it.

    Returns
    -------
    BatchHistory
        120 bytes a run and epoch. Besides that, memory grows with the shared log and not with runs
        times rows.

    Raises
    ------
    InputError
        As `navigate`, with the run named; numbers of runs that differ; times that differ between
        runs; errors together with a log for each run.

    Notes
    -----
    Of a log for each run, the row before the first used must be valid as well.
    14 ns a row and run in full tiles of 16 (with noise: about 45 ns more, in the drawing of it);
    fewer than 16 runs cost as much as 16. The first call ever compiles for 5 s.

    Pinned by: tests/ins/test_batch.py (bit for bit against `navigate` of the perturbed log)
    """
    from benchmarks.navigation_batch_kernel import TILE

    job = _Job(imu, initial, errors, epoch_s, vertical or VerticalChannel())
    tiles = [range(a, min(a + TILE, job.runs)) for a in range(0, job.runs, TILE)]
    if threads > 1:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(job.fly, tiles))
    else:
        for tile in tiles:
            job.fly(tile)
    job.states.flags.writeable = False
    return BatchHistory(time_s=job.time_s, states=job.states)


class _Job:
    """What the tiles share: the log, where it starts and its epochs end, and the array they all
    write to.
    """

    def __init__(
        self,
        imu: ImuLog | Sequence[ImuLog],
        initial: NavState | Sequence[NavState],
        errors: SensorErrors | None,
        epoch_s: float | None,
        vertical: VerticalChannel,
    ) -> None:
        self.logs = [imu] if isinstance(imu, ImuLog) else list(imu)
        self.starts = [initial] if isinstance(initial, NavState) else list(initial)
        self.errors = errors or SensorErrors()
        self.vertical = vertical
        self.runs = _run_count(self.logs, self.starts, errors)
        log, start_s = self.logs[0], self.starts[0].time_s
        self.first = int(np.searchsorted(log.time_s, start_s, side="right"))
        _check(self.logs, self.starts, self.first)
        vertical.check_interval(log.dt_s[self.first :])
        clock = EpochEnds(start_s, epoch_s)
        ends = clock.settle(log.time_s[self.first :])
        self.ends = self.first + (
            np.append(ends, log.time_s.size - self.first) if clock.last_row_ends_one() else ends
        )
        self.time_s = np.concatenate([[start_s], log.time_s[self.ends - 1]])
        self.bins = self.errors.bins(log)
        self.own_height = vertical.mode == "hold" and vertical.height_m is None
        self.height_ref = vertical.reference_height(log.time_s, log.dt_s, 0.0)
        self.shared = log
        if len(self.logs) > 1:
            self.shared = replace(
                log, dtheta_rad=np.zeros_like(log.dtheta_rad), dv_m_s=np.zeros_like(log.dv_m_s)
            )
        self.states = np.empty((self.runs, self.ends.size + 1, EPOCH_COLUMNS))

    def fly(self, tile: range) -> None:
        """Navigate the runs of one tile and write their states."""
        from benchmarks import navigation_batch_kernel as kernel

        own = _own_increments(self, tile, kernel.TILE)
        a, b = self.first, min(self.first + CHUNK_ROWS, self.shared.time_s.size)
        begin = max(a - 1, 0)
        rows = own(begin, b)
        F, bias = self._load(tile, rows, begin)
        rows = rows[a - begin :]
        if not rows.size:
            b = self.shared.time_s.size
        done = 1
        while done <= self.ends.size:
            ends = self.ends[(self.ends > a) & (self.ends <= b)]
            kernel.integrate_tile(
                self.shared.dt_s[a:b],
                self.shared.dtheta_rad[a:b],
                self.shared.dv_m_s[a:b],
                rows,
                self.bins[a:b],
                bias,
                self.height_ref[a:b],
                self.vertical.gains(),
                self.vertical.look_s,
                ends - a,
                F,
                self.states,
                tile[0],
                len(tile),
                done,
            )
            done += ends.size
            a, b = b, min(b + CHUNK_ROWS, self.shared.time_s.size)
            if done <= self.ends.size:
                rows = own(a, b)

    def _load(self, tile: range, own: NDArray, begin: int) -> tuple[NDArray, NDArray]:
        """The flat array of the kernel with the tile's starts and errors, and its biases (bins, 6,
        TILE).
        """
        from benchmarks import navigation_batch_kernel as kernel

        F = np.zeros((kernel.TILE_SIZE, kernel.TILE))
        # the last run fills the tile
        lanes = [min(tile[0] + lane, tile[-1]) for lane in range(kernel.TILE)]
        for lane, run in enumerate(lanes):
            start = self.starts[run % len(self.starts)]
            self.states[run, 0] = initial_row(start)[0, :EPOCH_COLUMNS]
            F[: kernel.CORRECTION, lane] = earth_frame_state(start)
            F[kernel.BEFORE : kernel.U, lane] = self._interval_before(run, own[..., lane], begin)
            F[kernel.MATRIX_AT : kernel.HEIGHT, lane] = self.errors.matrices(run).ravel()
            F[kernel.HEIGHT, lane] = start.site.height_m if self.own_height else 0.0
        return F.ravel(), np.ascontiguousarray(
            np.stack([self.errors.biases(run) for run in lanes], axis=-1)
        )

    def _interval_before(self, run: int, own: NDArray, begin: int) -> NDArray:
        """dtheta, dv, dt (7,) that the run read before its first row; the first row where there is
        none.
        """
        known = self.first > 0 and interval_at(self.logs[0], self.first - 1) is not None
        row = slice(self.first - 1, self.first) if known else slice(self.first, self.first + 1)
        read = np.hstack([self.shared.dtheta_rad[row], self.shared.dv_m_s[row]])
        read = self.errors.increments(run, read, self.shared.dt_s[row], self.bins[row])[0]
        return np.append(read + own[row.start - begin] if own.size else read, self.shared.dt_s[row])


def _own_increments(job: _Job, tile: range, width: int) -> Callable[[int, int], NDArray]:
    """What is added to the shared rows [a, b): (b - a, 6, width), or of size 0; asked for in order,
    without overlap.
    """
    if len(job.logs) > 1:
        return partial(_logged, [job.logs[run] for run in tile], width)
    if not job.errors.noisy:
        return lambda a, b: np.empty((0, 6, width))
    dt_s, generators = job.shared.dt_s, [job.errors.generator(run) for run in tile]
    for a in range(0, max(job.first - 1, 0), CHUNK_ROWS):  # the noise before the start
        for generator in generators:
            job.errors.noise(generator, dt_s[a : min(a + CHUNK_ROWS, job.first - 1)])

    def noise(a: int, b: int) -> NDArray:
        rows = np.zeros((b - a, 6, width))
        for lane, generator in enumerate(generators):
            rows[:, :, lane] = job.errors.noise(generator, dt_s[a:b])
        return rows

    return noise


def _logged(logs: list[ImuLog], width: int, a: int, b: int) -> NDArray:
    rows = np.zeros((b - a, 6, width))
    for lane, log in enumerate(logs):
        rows[:, :3, lane], rows[:, 3:, lane] = log.dtheta_rad[a:b], log.dv_m_s[a:b]
    return rows


def _run_count(logs: list[ImuLog], starts: list[NavState], errors: SensorErrors | None) -> int:
    """Runs that all agree on; a single log or start is shared."""
    if errors is not None and len(logs) > 1:
        raise InputError(
            "errors perturb one shared log, got a log for each run: apply them to the logs"
        )
    counts = {
        "imu": len(logs),
        "initial": len(starts),
        "errors": (errors.runs if errors is not None else None) or 1,
    }
    runs = max(counts.values())
    if min(counts.values()) == 0 or any(count not in (1, runs) for count in counts.values()):
        told = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InputError(f"runs differ: {told}; needed one number, or 1 where shared")
    if errors is not None and errors.runs not in (None, runs):
        raise InputError(
            f"runs differ: errors {errors.runs}, initial {len(starts)}; errors are never shared"
        )
    return runs


def _check(logs: list[ImuLog], starts: list[NavState], first: int) -> None:
    log, start = logs[0], starts[0]
    if first == log.time_s.size:
        raise InputError(
            f"imu: ends at {log.time_s[-1]:.6g} s, needed rows after the initial"
            f" {start.time_s:.6g} s"
        )
    for run, one in enumerate(logs):
        if not (np.array_equal(one.time_s, log.time_s) and np.array_equal(one.dt_s, log.dt_s)):
            raise InputError(
                f"run {run}: imu has other times than run 0, needed the same time_s and dt_s"
            )
        with _naming(run, len(logs)):
            check_rows(one, first if len(logs) == 1 else max(first - 1, 0), 0)
            check_start(one, first, start)
    for run, state in enumerate(starts):
        with _naming(run, len(starts)):
            check_initial(state)
            if state.time_s != start.time_s:
                raise InputError(
                    f"initial time_s {state.time_s:.6g} s, needed {start.time_s:.6g} s as in run 0"
                )


@contextmanager
def _naming(run: int, of: int) -> Iterator[None]:
    """Put the run before the error line, where there are several."""
    try:
        yield
    except InputError as error:
        raise InputError(f"run {run}: {error}" if of > 1 else str(error)) from None
