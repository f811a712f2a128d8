"""What is known of a run second by second: the quantities that effects depend on, and what an
effect adds to a log.

Both the diagnosis (on a grid of seconds, from the estimated motion) and the injection into a
simulation (at the rows of the log) hand this record to the same effect, so that an effect is
written once.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

PARKED, ROLLING, AIRBORNE = 0, 1, 2  # kinds of a second, 0 to 2
# traces that are summed together; chosen: of an hour, three axes each, 5 MB, what a core caches
TRACES_AT_ONCE = 64


@dataclass(frozen=True, kw_only=True)
class Telemetry:
    """A run at n instants `time_s` (since power-on), each the middle of an interval `dt_s` long.

    Attributes
    ----------
    run_index : int
        Which of the runs under study; effects that repeat do not look at it.
    rate_rad_s, force_m_s2 : shape (n, 3)
        True body rate (Earth rate included) and specific force, as estimated.
    C_nb, v_n_m_s : shape (n, 3, 3), (n, 3)
        Attitude and velocity.
    speed_m_s, turn_rad_s : shape (n,)
        Speed along body x; rate of the heading.
    kind : shape (n,)
        PARKED, ROLLING or AIRBORNE.
    lat_rad, height_m : float
        Of the site.
    temperature_degC, temperature_rate_degC_min : shape (n, 3)
        Of the gyros, smoothed; None where not logged.
    accel_degC : shape (n, 3)
        Of the accelerometers (the gyros' where not logged).
    gradient_degC, block_degC, ambient_degC : shape (n, 3), (n,), (n,)
        None where not logged.
    vibration_m2_s4, swing_rad2_s2 : shape (n, 3)
        Variance of the specific force and of the rate within each second beyond that of the parked
        rows.
    at_range : shape (n, 6)
        Share of each second's rows at the end of the sensor's range (gyros, accelerometers; below 0
        at the lower end).
    above_m : shape (n,)
        Height over the site, by GNSS; None where none is logged.
    table_deg_h : shape (n, 3)
        The twin's table at these temperatures.
    heading_known : bool
        False where nothing shows north.
    """

    run_index: int
    time_s: NDArray
    dt_s: float
    rate_rad_s: NDArray
    force_m_s2: NDArray
    C_nb: NDArray
    v_n_m_s: NDArray
    speed_m_s: NDArray
    turn_rad_s: NDArray
    kind: NDArray
    lat_rad: float
    height_m: float
    temperature_degC: NDArray | None = None
    temperature_rate_degC_min: NDArray | None = None
    accel_degC: NDArray | None = None
    gradient_degC: NDArray | None = None
    block_degC: NDArray | None = None
    ambient_degC: NDArray | None = None
    vibration_m2_s4: NDArray | None = None
    swing_rad2_s2: NDArray | None = None
    at_range: NDArray | None = None
    above_m: NDArray | None = None
    table_deg_h: NDArray | None = None
    heading_known: bool = True
    has_gnss: bool = False
    has_odometer: bool = False

    @property
    def n(self) -> int:
        return int(self.time_s.size)

    @cached_property
    def heading_rad(self) -> NDArray:
        """Heading of body x (n,)."""
        return np.arctan2(self.C_nb[:, 1, 0], self.C_nb[:, 0, 0])

    @cached_property
    def turns_rad(self) -> dict[str, tuple[float, float]]:
        """Largest rotations about the axis of each gyro that was asked for: a plan asks of each
        recording hundreds of times (`gyro_needs.turns_rad`).
        """
        return {}

    @cached_property
    def headings_from(self) -> dict[float, NDArray]:
        """Headings less each that was asked for, rounded, each once (`several_headings`)."""
        return {}

    @property
    def parked(self) -> NDArray:
        return self.kind == PARKED

    @property
    def rolling(self) -> NDArray:
        return self.kind == ROLLING

    @property
    def acceleration_m_s2(self) -> NDArray:
        """Rate of change of the speed along body x (n,)."""
        return self.rate_of(self.speed_m_s)

    def rate_of(self, values: NDArray) -> NDArray:
        """Derivative with time of a series (n, ...)."""
        if self.n < 2:
            return np.zeros_like(values)
        return np.asarray(np.gradient(values, self.time_s, axis=0))


@dataclass(frozen=True)
class Trace:
    """What an effect adds to a run's channels, (n, ...) at the instants of a `Telemetry`; None:
    nothing.

    gyro_rad_s, accel_m_s2 (n, 3) : measured less true, body axes.
    lateral_m_s (n,) : side velocity of the no-slip point that the twin does not expect (body y).
    odometer_m_s (n,) : read less true. gnss_position_m, gnss_velocity_m_s (n, 3) : read less true,
    NED. temperature_degC (n, 3) : read less true.
    """

    gyro_rad_s: NDArray | None = None
    accel_m_s2: NDArray | None = None
    lateral_m_s: NDArray | None = None
    odometer_m_s: NDArray | None = None
    gnss_position_m: NDArray | None = None
    gnss_velocity_m_s: NDArray | None = None
    temperature_degC: NDArray | None = None

    def scaled(self, factor: float) -> "Trace":
        """The trace times a number."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return Trace(**{k: None if v is None else factor * v for k, v in values.items()})


def total(traces: Iterable[Trace]) -> Trace:
    """The sum of traces on the same instants."""
    out = Trace()
    for trace in traces:
        for f in fields(trace):
            value, held = getattr(trace, f.name), getattr(out, f.name)
            if value is not None:
                out = replace(out, **{f.name: value if held is None else held + value})
    return out


def stacked(traces: Sequence[Trace], name: str, rows: slice) -> Iterator[tuple[NDArray, NDArray]]:
    """Numbers (k,) of the traces that hold a channel, and their series (rows, ..., k),
    TRACES_AT_ONCE of them at a time.
    """
    held = [k for k, trace in enumerate(traces) if getattr(trace, name) is not None]
    for first in range(0, len(held), TRACES_AT_ONCE):
        part = held[first : first + TRACES_AT_ONCE]
        series = np.stack([getattr(traces[k], name)[rows] for k in part], axis=-1)
        yield np.array(part), series


def on_axis(values: NDArray, axis: int) -> NDArray:
    """A series (n,) as column `axis` of (n, 3), the others zero."""
    out = np.zeros((values.size, 3))
    out[:, axis] = values
    return out
