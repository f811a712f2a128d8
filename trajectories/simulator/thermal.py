"""Temperature histories of a unit after power-on: block, gyros, accelerometers, gradient, ambient.

The block approaches its settled temperature with one time constant; each gyro follows the block
with a second one, so its temperature starts level (second order). The sun on the apron adds a slow
load from a given time on.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.records import InputError

CLIMB_S = 900.0  # over which the air of a flight becomes that of the cruise, and back


@dataclass(frozen=True, kw_only=True)
class Temperatures:
    """True temperatures [degC] at n times: gyros, accelerometers, gradient at each gyro (n, 3);
    block, ambient (n,).
    """

    gyro_degC: NDArray
    accel_degC: NDArray
    gradient_degC: NDArray
    block_degC: NDArray
    ambient_degC: NDArray


@dataclass(frozen=True, kw_only=True)
class ThermalHistory:
    """One power-on: the unit starts at `start_degC` and settles at `settled_degC` (block).

    gyro_rise_degC: each gyro's own heat above the block; gradient_fraction: Tdiff per block-to-gyro
    difference; sun_degC, from sun_start_s on, warms the block with the time constant sun_tau_s.
    flight_degC: by how much the air around the unit is warmer from flight_start_s to flight_end_s
    (below 0: colder); the block follows with flight_tau_s.
    """

    ambient_degC: float
    start_degC: float
    settled_degC: float
    block_tau_s: float = 1500.0
    gyro_tau_s: tuple[float, float, float] = (420.0, 480.0, 360.0)
    gyro_rise_degC: tuple[float, float, float] = (1.5, 2.5, 0.8)
    gradient_fraction: tuple[float, float, float] = (0.3, -0.2, 0.25)
    sun_degC: float = 0.0
    sun_start_s: float = 0.0
    sun_tau_s: float = 1800.0
    flight_degC: float = 0.0
    flight_start_s: float = 0.0
    flight_end_s: float = 0.0
    flight_tau_s: float = 2400.0

    def __post_init__(self) -> None:
        taus = (self.block_tau_s, self.sun_tau_s, self.flight_tau_s, *self.gyro_tau_s)
        if not min(taus) > 0 or {self.block_tau_s, self.flight_tau_s} & {*self.gyro_tau_s}:
            raise InputError(
                "thermal: time constants must be above 0, gyro_tau_s other than block_tau_s and"
                " flight_tau_s"
            )
        if self.flight_degC and not self.flight_end_s > self.flight_start_s:
            raise InputError(
                f"flight_end_s {self.flight_end_s:g} s, needed after flight_start_s"
                f" {self.flight_start_s:g} s"
            )

    def at(self, time_s: ArrayLike) -> Temperatures:
        """Temperatures at times (n,) since power-on."""
        t = np.asarray(time_s, dtype=float)
        sun = self.sun_degC * first_order_rise(t - self.sun_start_s, self.sun_tau_s)
        step = self.settled_degC - self.start_degC
        block = self.start_degC + step * first_order_rise(t, self.block_tau_s) + sun
        own = np.stack(
            [r * first_order_rise(t, tau) for r, tau in zip(self.gyro_rise_degC, self.gyro_tau_s)],
            axis=-1,
        )
        lagged = self.start_degC + np.stack(
            [
                step * _second_order(t, self.block_tau_s, tau)
                + self.sun_degC * _second_order(t - self.sun_start_s, self.sun_tau_s, 0.999 * tau)
                for tau in self.gyro_tau_s
            ],
            axis=-1,
        )
        ambient = np.full(t.shape, self.ambient_degC)
        if self.flight_degC:
            block, lagged, ambient = self._flown(t, block, lagged, ambient)
        gradient = np.asarray(self.gradient_fraction) * (block[:, None] - lagged)
        accel = np.repeat(lagged.mean(axis=1)[:, None], 3, axis=1)
        return Temperatures(
            gyro_degC=lagged + own,
            accel_degC=accel,
            gradient_degC=gradient,
            block_degC=block,
            ambient_degC=ambient,
        )

    def _flown(
        self, t: NDArray, block: NDArray, lagged: NDArray, ambient: NDArray
    ) -> tuple[NDArray, NDArray, NDArray]:
        """Block, gyros without their own heat, and air, with the air of a flight."""
        since, after = t - self.flight_start_s, t - self.flight_end_s
        block = block + self.flight_degC * (
            first_order_rise(since, self.flight_tau_s) - first_order_rise(after, self.flight_tau_s)
        )
        follows = [
            _second_order(since, self.flight_tau_s, tau)
            - _second_order(after, self.flight_tau_s, tau)
            for tau in self.gyro_tau_s
        ]
        lagged = lagged + self.flight_degC * np.stack(follows, axis=-1)
        aloft = np.clip(since / CLIMB_S, 0.0, 1.0) - np.clip(after / CLIMB_S, 0.0, 1.0)
        return block, lagged, ambient + self.flight_degC * aloft


def first_order_rise(t: NDArray, tau_s: float) -> NDArray:
    """First-order step response, 0 before its start."""
    return -np.expm1(-np.maximum(t, 0.0) / tau_s)


def _second_order(t: NDArray, tau1_s: float, tau2_s: float) -> NDArray:
    """Step response of two lags in series (distinct time constants), 0 before its start."""
    return (tau1_s * first_order_rise(t, tau1_s) - tau2_s * first_order_rise(t, tau2_s)) / (
        tau1_s - tau2_s
    )


STARTS = {
    "cold": ThermalHistory(ambient_degC=-5.0, start_degC=-5.0, settled_degC=34.0),
    "ambient": ThermalHistory(ambient_degC=20.0, start_degC=20.0, settled_degC=42.0),
    "hot": ThermalHistory(
        ambient_degC=36.0, start_degC=41.0, settled_degC=44.0, sun_degC=4.0, sun_start_s=600.0
    ),
    "cooling": ThermalHistory(ambient_degC=5.0, start_degC=46.0, settled_degC=26.0),
}


def thermal_history(start: str, *, rng: np.random.Generator | None = None) -> ThermalHistory:
    """A named power-on (one of STARTS); an rng moves its temperatures by 3 degC, its block time by
    15 % (1 sigma).

    Raises InputError where the name is not one of STARTS.
    """
    if start not in STARTS:
        raise InputError(f"thermal start {start!r}, needed one of {', '.join(STARTS)}")
    history = STARTS[start]
    if rng is None:
        return history
    shift = 3.0 * rng.standard_normal(3)
    return replace(
        history,
        ambient_degC=history.ambient_degC + shift[0],
        start_degC=history.start_degC + shift[0] + shift[1],
        settled_degC=history.settled_degC + shift[0] + shift[2],
        block_tau_s=history.block_tau_s
        * float(np.clip(1 + 0.15 * rng.standard_normal(), 0.6, 1.6)),
    )
