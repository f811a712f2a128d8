"""A fitted thermal model in use: its bias along a run's temperatures, taken out of the log in batch
or in real-time order.

A model has two parts: what a settled unit has at a temperature (the part that a thermal table holds
as well), and what rates and gradients add. "all" takes out both, "rates" the second alone, so that
the table stays the bias of the settled unit.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from infield.table.temperature_model import TemperatureModel
from infield.thermal.gradient_runs import gradient_lines
from infield.thermal.ramp_runs import RAMP_BLOCK_S
from infield.thermometer.causal_rate import causal_rates, time_constant_s
from infield.thermometer.gyro_temperature import GyroTemperature, gyro_temperature
from ins.records import ImuLog, ImuSource, Run, TemperatureLog
from ins.strapdown.compensation import compensate, corrected
from ins.units import DEG_PER_HOUR

PARTS = ("all", "rates")


BiasSeries = Callable[[NDArray], NDArray]


def bias_deg_h(
    model: TemperatureModel, T: NDArray, rate: NDArray, gradient: NDArray, *, part: str = "all"
) -> NDArray:
    """The model's bias (n, 3); part: "all" or "rates"."""
    if part not in PARTS:
        raise ValueError(f"part {part!r}, needed one of {', '.join(PARTS)}")
    rates = model.rates_deg_h(T, rate, gradient)
    return rates if part == "rates" else rates + model.settled_deg_h(T)


def _not_late(
    model: TemperatureModel,
    readings: tuple[NDArray, NDArray, NDArray],
    change: Callable[[NDArray], NDArray],
    part: str,
) -> NDArray:
    """The bias (n, 3) of temperatures, rates and lines that read late."""
    T, rate, lines = readings
    bias = bias_deg_h(model, T, rate, lines, part=part)
    lag = model.lags_s
    if not lag.any():
        return bias
    of_lines = model.rates_deg_h(T, np.zeros_like(rate), lines)
    return np.asarray(bias + lag[:, 0] * change(bias - of_lines) + lag[:, 1] * change(of_lines))


def batch_series(
    model: TemperatureModel, log: TemperatureLog, temperature: GyroTemperature, *, part: str = "all"
) -> BiasSeries:
    """Bias (k, 3) [deg/h] at any times from the smoothed temperatures and lines of the whole run,
    straight between nodes.
    """
    nodes = temperature.time_s
    lines = gradient_lines(log).at(nodes) if model.lines else np.zeros((nodes.size, 3))
    readings = temperature.temperature_degC, temperature.rate_degC_min, lines

    def change(values: NDArray) -> NDArray:
        before, after = (
            np.stack([np.interp(nodes + s, nodes, column) for column in values.T], axis=1)
            for s in (-0.5 * RAMP_BLOCK_S, 0.5 * RAMP_BLOCK_S)
        )
        return np.asarray((after - before) / RAMP_BLOCK_S)

    bias = _not_late(model, readings, change, part)
    return lambda time_s: np.stack([np.interp(time_s, nodes, column) for column in bias.T], axis=1)


def causal_series(model: TemperatureModel, log: TemperatureLog, *, part: str = "all") -> BiasSeries:
    """The same in real-time order: at each time from readings up to it alone; 0 before the first
    and where there is none.
    """
    tau_s = time_constant_s(log.time_s, log.gyro_degC)
    T, rate = causal_rates(log.time_s, log.gyro_degC, tau_s)
    lines = (
        np.zeros_like(T)
        if log.gradient_degC is None
        else causal_rates(log.time_s, log.gradient_degC)[0]
    )

    def change(values: NDArray) -> NDArray:
        return causal_rates(log.time_s, values)[1] / 60.0  # per minute, as rates of temperature

    readings = T, rate, np.where(np.isfinite(lines), lines, 0.0)
    bias = _not_late(model, readings, change, part)
    bias = np.where(np.isfinite(bias), bias, 0.0)

    def at(time_s: NDArray) -> NDArray:
        row = np.searchsorted(log.time_s, time_s, side="right") - 1
        return np.where((row >= 0)[:, None], bias[np.maximum(row, 0)], 0.0)

    return at


def means_both_ways(run: Run, model: TemperatureModel, time_s: NDArray) -> tuple[NDArray, NDArray]:
    """What either way takes out of the blocks of a run: with the whole run's temperatures smoothed,
    and in real-time order.

    Which ten-second sums a block is made of is judged on the log as it came. Taken out of the rows
    first, a step of a late thermometer (600 s times its rate) would pass for a bump, and the
    blocks of the two logs would no longer be those of the same minutes.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Centres of the blocks, each RAMP_BLOCK_S long.

    Returns
    -------
    smoothed, real_time : ndarray, shape (n, 3) [deg/h]
        Mean of the model's bias over each block.

    Raises
    ------
    ValueError
        A run without temperatures.
    """
    log = run.temperature
    if log is None:
        raise ValueError(f"run {run.header.run_id}: no gyro temperature, needed to compensate it")
    seconds = time_s[:, None] + np.arange(0.5, RAMP_BLOCK_S) - 0.5 * RAMP_BLOCK_S

    def means(series: BiasSeries) -> NDArray:
        return np.asarray(series(seconds.ravel()).reshape(*seconds.shape, 3).mean(axis=1))

    smoothed = batch_series(model, log, gyro_temperature(log))
    return means(smoothed), means(causal_series(model, log))


def less(imu: ImuSource, series: BiasSeries) -> ImuSource:
    """A log less a bias; one that is in its file stays there."""

    def correct(piece: ImuLog) -> ImuLog:
        return compensate(
            piece, gyro_bias_rad_s=series(piece.time_s - 0.5 * piece.dt_s) * DEG_PER_HOUR
        )

    return corrected(imu, correct)
