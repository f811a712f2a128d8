"""Runs of a unit at rest -> minute means for the ring-laser gradient fit: bias, temperature, its
rate, gradient lines.

A gradient line is a logged temperature difference (Tdiff of US 8,781,778); each gyro has one, and
any of them may move any gyro. Rate and lines come from the interval smoother, so that the steps of
a coarse thermometer do not pass for a rate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.thermal.ramp_runs import RAMP_BLOCK_S, RampRun, covered_blocks, ramp_run
from infield.thermometer.gyro_temperature import (
    FEWEST_READINGS,
    GyroTemperature,
    NoTemperature,
    gyro_temperature,
    too_short,
)
from infield.thermometer.smoother import SmoothTemperature, nodes_of, smooth_readings
from ins.records import AXES, Run, TemperatureLog, TwinModel
from ins.thermometer_faults import check_thermometers

# a line that moves less says nothing: 5 steps of the default thermometer (0.01 degC)
FLAT_degC = 0.05


@dataclass(frozen=True)
class GradientLines:
    """Smoothed lines at nodes time_s (n,): value_degC (n, 3), NaN for a line that is not logged;
    smooth: None there.
    """

    time_s: NDArray
    value_degC: NDArray
    smooth: tuple[SmoothTemperature | None, ...]

    @property
    def logged(self) -> tuple[str, ...]:
        return tuple(axis for axis, smooth in zip(AXES, self.smooth) if smooth is not None)

    def at(self, time_s: NDArray) -> NDArray:
        """Lines (k, 3) at given times; the end values are held outside the log, 0 for a line that
        is not logged.
        """
        values = np.where(np.isfinite(self.value_degC), self.value_degC, 0.0)
        return np.stack([np.interp(time_s, self.time_s, column) for column in values.T], axis=1)


@dataclass(frozen=True)
class GradientRun:
    """Minute means of one run: `blocks` (rates over a minute), gradient_degC (n, 3), usable rows
    (n,), lines logged.

    sigma_rate_degC_min, sigma_gradient_degC (3,): of one block in the middle of the run.
    """

    blocks: RampRun
    gradient_degC: NDArray
    usable: NDArray
    lines: tuple[str, ...]
    sigma_rate_degC_min: NDArray
    sigma_gradient_degC: NDArray

    @property
    def minutes(self) -> int:
        return int(self.usable.sum())


def gradient_lines(log: TemperatureLog) -> GradientLines:
    """The differential readings, bursts and jumps out, smoothed as temperatures are."""
    nodes = nodes_of(log.time_s)
    value = np.full((nodes.size, 3), np.nan)
    smooth: list[SmoothTemperature | None] = [None, None, None]
    if log.gradient_degC is not None:
        names = [f"gradient_{axis}_degC" for axis in AXES]
        checked = check_thermometers(log.time_s, dict(zip(names, log.gradient_degC.T)))
        for k, name in enumerate(names):
            rows = np.flatnonzero(checked.valid[name])
            if rows.size >= max(min(FEWEST_READINGS, log.time_s.size), 3):
                found = smooth_readings(
                    nodes,
                    log.time_s[rows],
                    log.gradient_degC[rows, k],
                    checked.resolution_degC[name],
                )
                smooth[k], value[:, k] = found, found.value_degC
    return GradientLines(nodes, value, tuple(smooth))


def gradient_run(run: Run, twin: TwinModel) -> GradientRun:
    """Minute means of a run. InputError where the log cannot be used as it is."""
    why = too_short(run.temperature)
    if why is not None:
        raise NoTemperature(run.header.run_id, why)
    assert run.temperature is not None
    temperature, lines = gyro_temperature(run.temperature), gradient_lines(run.temperature)
    blocks = ramp_run(run, twin, temperature=temperature, window_s=RAMP_BLOCK_S)
    seen = [k for k, axis in enumerate(AXES) if axis not in temperature.unusable]
    gradient = lines.at(blocks.time_s)
    moving = tuple(
        axis for axis in lines.logged if np.ptp(gradient[:, AXES.index(axis)], axis=0) > FLAT_degC
    )
    middle = float(blocks.time_s[blocks.time_s.size // 2]) if blocks.time_s.size else 0.0
    return GradientRun(
        blocks=blocks,
        gradient_degC=gradient,
        usable=covered_blocks(temperature, blocks.time_s, seen),
        lines=moving,
        sigma_rate_degC_min=blocks.rate_sigma_degC_min,
        sigma_gradient_degC=_line_sigma(lines, temperature, middle),
    )


def _line_sigma(lines: GradientLines, temperature: GyroTemperature, middle_s: float) -> NDArray:
    """Sigma (3,) of each line's mean over a minute."""
    row = temperature.mean_rows(middle_s - 0.5 * RAMP_BLOCK_S, middle_s + 0.5 * RAMP_BLOCK_S)[None]
    return np.array([0.0 if s is None else np.sqrt(s.covariance(row)[0, 0]) for s in lines.smooth])
