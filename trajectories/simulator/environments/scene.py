"""Where and when environments act: an even grid of times over the run, and how far it is parked.

The grid runs on for WRAP_S after the run's end, so that Fourier series over it may close on
themselves without a step: what happens there is cut away.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from ins.records import InputError
from trajectories.simulator.sensors import IdealSensors
from trajectories.simulator.vehicle import smooth_step

NODE_HZ = 40.0  # at least so many nodes a second: ten in a period of the fastest footfall, 4 Hz
PLAIN_HZ = 80.0  # from here on no nodes between rows: the trapezoid is off by 0.3 % at 2.5 Hz
FADE_S = 20.0  # an environment comes after a stop, and goes before a start, over this
# Before the vehicle starts: the slowest mode of the gear (1 Hz, damping 0.07) rings down to 0.5 %.
RING_S = 12.0
WRAP_S = 120.0


@dataclass(frozen=True, kw_only=True)
class Scene:
    """The grid of an environment.

    rows: of the run; steps: nodes to a row, node `steps` * k is the start of row k; time_s (J,): of
    the nodes, those after the run's end included; parked (J,): from 0 (rolling) to 1; stand_s:
    start and end of the first stand, in which people come, fuel and cargo are taken.
    """

    rows: int
    steps: int
    dt_s: float
    time_s: NDArray
    parked: NDArray
    stand_s: tuple[float, float]

    @property
    def nodes(self) -> int:
        """Nodes within the run, its start and its end included."""
        return self.rows * self.steps + 1

    @property
    def frequency_hz(self) -> NDArray:
        """Of the Fourier series over the grid, (J // 2 + 1,)."""
        return np.fft.rfftfreq(self.time_s.size, self.dt_s)


def scene_of(ideal: IdealSensors) -> Scene:
    """The scene of a whole ideal run.

    Raises InputError where the vehicle never stands: there is nothing to lay an environment over.
    """
    steps = 1 if ideal.rate_hz >= PLAIN_HZ else 2 * int(np.ceil(0.5 * NODE_HZ / ideal.rate_hz))
    dt = ideal.dt_s / steps
    rows = ideal.time_s.size
    count = next_fast_len(rows * steps + 1 + int(WRAP_S / dt), real=True)
    time_s = np.arange(count) * dt
    stands = _stands(ideal)
    if not stands:
        raise InputError("environment: the vehicle never stands, needed a segment at rest")
    return Scene(
        rows=rows,
        steps=steps,
        dt_s=dt,
        time_s=time_s,
        parked=_parked(time_s, stands, rows * ideal.dt_s),
        stand_s=stands[0],
    )


def closed(scene: Scene, series: NDArray) -> NDArray:
    """A series (J, m) with a way back to its first values after the run's end."""
    back = _back(scene.time_s, float(scene.time_s[scene.nodes - 1]))
    return series[:1] + (series - series[:1]) * back[:, None]


def _stands(ideal: IdealSensors) -> list[tuple[float, float]]:
    breaks = ideal.truth.breaks_s
    still = [k for k, stretch in enumerate(ideal.truth.stretches) if stretch.spline is None]
    return [(float(breaks[k]), float(breaks[k + 1])) for k in still]


def _parked(time_s: NDArray, stands: list[tuple[float, float]], end_s: float) -> NDArray:
    """1 while parked, 0 while rolling; a run that starts or ends at rest does so amid it all."""
    parked = np.zeros(time_s.size)
    for start_s, stop_s in stands:
        comes = smooth_step((time_s - start_s) / FADE_S) if start_s > 0.0 else np.ones(time_s.size)
        goes = smooth_step((stop_s - RING_S - time_s) / FADE_S)
        if stop_s >= end_s - 1e-6:
            goes = np.ones(time_s.size)
        parked += comes * goes * (time_s >= start_s)
    parked = np.minimum(parked, 1.0)
    way = parked[int(np.searchsorted(time_s, end_s))]
    back = _back(time_s, end_s)
    return np.where(time_s > end_s, parked[0] + (way - parked[0]) * back, parked)


def _back(time_s: NDArray, end_s: float) -> NDArray:
    """1 until the run's end, then down to 0 where the grid closes."""
    return 1.0 - smooth_step((time_s - end_s) / (time_s[-1] - end_s))
