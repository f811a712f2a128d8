"""Columns of a run as a page draws them: a few hundred means, each with the least and the greatest
value of its rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from infield.reports.drawing import BLACK, CURVE_COLOURS, Item, Line, Panel
from ins.records import AXES, GnssLog, ImuSource, Run, TemperatureLog
from ins.units import DEG
from simreal.twin.fit.curves import contradicted
from simreal.twin.fit.result import ChannelCurve, TwinFit

DRAWN_BINS = 1500  # of a curve; chosen: two a pixel of a page 1180 px wide are more than it shows
TRIADS = ("gyro", "accel")


def series_of(run: Run) -> Mapping[str, Panel]:
    """All that a run's streams show over time, by the name of the drawing."""
    found = dict(_imu_series(run.imu))
    if run.temperature is not None:
        found["temperature"] = _temperature_series(run.temperature)
    if run.gnss is not None:
        found |= _gnss_series(run.gnss)
    if run.odometer is not None:
        rows = _few(run.odometer.time_s.size)
        time_s, speed = run.odometer.time_s[rows], run.odometer.speed_m_s[rows]
        found["odometer"] = _panel("Wheel speed", "m/s", [Line(time_s, speed, BLACK, "wheel")])
    return {name: panel for name, panel in found.items() if panel.items}


def _panel(title: str, unit: str, lines: Sequence[Item]) -> Panel:
    """Lines over time; all of a log zoom together."""
    return Panel(
        items=list(lines), label=title, x_label="time [s]", y_label=f"[{unit}]", group="log"
    )


def _imu_series(imu: ImuSource) -> Mapping[str, Panel]:
    """Rates and specific force."""
    edges = np.linspace(imu.start_s, imu.end_s, min(DRAWN_BINS, max(imu.rows // 2, 1)) + 1)[1:-1]
    count = np.zeros(edges.size + 1)
    total = np.zeros((edges.size + 1, 6))
    low, high = np.full(total.shape, np.inf), np.full(total.shape, -np.inf)
    for piece in imu.pieces():
        rows = np.hstack([piece.dtheta_rad, piece.dv_m_s]) / piece.dt_s[:, None]
        of = np.searchsorted(edges, piece.time_s)
        first = np.flatnonzero(np.diff(of, prepend=-1))
        bins = of[first]
        count[bins] += np.diff(np.append(first, of.size))
        total[bins] += np.add.reduceat(rows, first)
        low[bins] = np.minimum(low[bins], np.minimum.reduceat(rows, first))
        high[bins] = np.maximum(high[bins], np.maximum.reduceat(rows, first))
    held = count > 0
    time_s = np.concatenate([[imu.start_s], edges])[held]
    mean = total[held] / count[held, None]
    low, high = low[held], high[held]

    def triad(title: str, unit: str, at: int, scale: float) -> Panel:
        curves = tuple(
            Line(
                time_s,
                mean[:, at + k] * scale,
                CURVE_COLOURS[k],
                axis,
                low=low[:, at + k] * scale,
                high=high[:, at + k] * scale,
            )
            for k, axis in enumerate(AXES)
        )
        return _panel(title, unit, curves)

    return {
        "rate": triad("Angular rate", "deg/s", 0, 1.0 / DEG),
        "force": triad("Specific force", "m/s2", 3, 1.0),
    }


def _temperature_series(log: TemperatureLog) -> Panel:
    """Every thermometer that reads anything, differential readings apart."""
    rows = _few(log.time_s.size)
    columns = {f"gyro {axis}": log.gyro_degC[:, k] for k, axis in enumerate(AXES)}
    if log.accel_degC is not None:
        columns |= {f"accelerometer {axis}": log.accel_degC[:, k] for k, axis in enumerate(AXES)}
    if log.block_degC is not None:
        columns["block"] = log.block_degC
    if log.ambient_degC is not None:
        columns["ambient"] = log.ambient_degC
    known = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    return _lines("Temperatures", "degC", log.time_s[rows], known, rows)


def _lines(
    title: str, unit: str, time_s: NDArray, columns: Mapping[str, NDArray], rows: NDArray
) -> Panel:
    """A line for each column, in turn of the colours."""
    coloured = zip(columns.items(), cycle(CURVE_COLOURS))
    return _panel(
        title,
        unit,
        [Line(time_s, values[rows], colour, name) for (name, values), colour in coloured],
    )


def _gnss_series(log: GnssLog) -> Mapping[str, Panel]:
    """Speed and height of the fixes."""
    rows = _few(log.time_s.size)
    time_s = log.time_s[rows]
    speeds = {
        name: log.v_n_m_s[:, k]
        for k, name in enumerate(("north", "east", "down"))
        if np.isfinite(log.v_n_m_s[:, k]).any()
    }
    height = {"height": log.height_m}
    return {
        "velocity": _lines("Velocity of the fixes", "m/s", time_s, speeds, rows),
        "height": _lines("Height of the fixes", "m", time_s, height, rows),
    }


def _few(rows: int) -> NDArray:
    """At most DRAWN_BINS of so many rows, evenly."""
    return np.unique(np.linspace(0, rows - 1, min(rows, DRAWN_BINS)).round().astype(int))


def shown_noise(fitted: TwinFit | None) -> tuple[TwinFit | None, list[str]]:
    """The fit without the curves of sensors whose data contradict it, and a note on each. Which
    numbers are told is decided by the fit itself.
    """
    if fitted is None:
        return None, []
    channels, notes = list(fitted.channels), []
    for triad in TRIADS:
        mine = [c for c in channels if c.channel.startswith(triad)]
        against = [c for c in mine if contradicted(c)]
        if not against:
            continue
        channels = [_undrawn(c) if c in mine else c for c in channels]
        worst = max(against, key=lambda c: abs(np.log(_furthest(c)[0])))
        ratio, at = _furthest(worst)
        notes.append(
            f"{triad} noise: over {at:g} s the fitted model is {ratio:.3g} times the data"
            f" ({worst.channel}), so it is not drawn. The logger may filter the data, or the rest"
            " is too short or unsteady."
        )
    drawn = replace(fitted, channels=tuple(channels)) if notes else fitted
    shown = {c.channel for c in channels if np.isfinite(c.allan_model).all()}
    moved = [c for c in fitted.read_above_hz if c in shown]
    if moved:
        above_hz = max(fitted.read_above_hz.values())
        notes.append(
            f"noise: people or wind move the vehicle. The noise model of {', '.join(moved)} uses"
            f" frequencies above {above_hz:g} Hz only; the data drawn include the motion."
        )
    return drawn, notes


def _furthest(channel: ChannelCurve) -> tuple[float, float]:
    """Model over data where they are furthest apart, and the averaging time [s]."""
    ratio = channel.allan_model / channel.allan
    k = int(np.argmax(np.abs(np.log(ratio))))
    return float(ratio[k]), float(channel.tau_s[k])


def _undrawn(channel: ChannelCurve) -> ChannelCurve:
    none = np.full(channel.allan.size, np.nan)
    return replace(channel, allan_model=none, allan_low=none, allan_high=none)
