"""Gyro temperatures of a run: smoothed with their covariance, and what is wrong with the
thermometers.

What a fault costs: an axis whose thermometer cannot be used at all is left out (its bias has no
temperature), a span without a trustworthy reading leaves its bins out, a coarse or noisy
thermometer widens the sigma of the points (`of_bins`, times the slope of the table
there), and a run without any gyro temperature is refused.
"""

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import ThermalTable
from infield.thermometer.smoother import SmoothTemperature, nodes_of, smooth_readings
from ins.records import AXES, InputError, Span, TemperatureLog
from ins.thermometer_faults import (
    HOLE_S,
    OF_THE_COLUMN,
    FaultKind,
    PLAUSIBLE_MEDIAN_degC,
    ThermometerFault,
    check_thermometers,
)
from ins.verdicts import Reason, ReasonCode, because, sentence


class ThermometerReason(ReasonCode):
    """What follows from a fault, or why no gyro has a temperature."""

    NONE_LOGGED = (
        "none_logged",
        "no gyro temperature in the run: a bias without its temperature has no place in the table",
    )
    TOO_FEW_ROWS = (
        "too_few_rows",
        "gyro temperature: {rows} {rows:row|rows} over {span_s:g} s, needed at least {needed_rows}"
        " rows over {needed_s:.0f} s",
    )
    ALL_STUCK = (
        "all_stuck",
        "all gyro thermometers are stuck (a constant temperature is accepted by"
        ' "accepted_constant_temperature": true in run.json)',
    )
    NONE_USABLE = "none_usable", "no gyro thermometer can be used"
    OF_ANOTHER = "of_another", "{column}: {fault}"
    COARSE = "coarse", "thermometer {column}: {fault}; its sigma is wider"
    UNIT_STUCK = "unit_stuck", "{fault}; no bias is learnt meanwhile"
    CONSTANT = (
        "constant",
        "thermometer {column}: {fault}; a step of 1 degC could hide in it, and is in its sigma",
    )
    HOLE = "hole", "thermometer {column}: {fault}; nothing is learnt there beyond two minutes"
    AXIS_LEFT_OUT = "axis_left_out", "thermometer {column}: {fault}; the axis is left out"
    READINGS_LEFT_OUT = (
        "readings_left_out",
        "thermometer {column}: {fault}; these readings are left out",
    )


class NoTemperature(InputError):
    """A run without the gyro temperature that a fit needs.

    Parameters
    ----------
    run_id : str
        The run.
    reason : Reason
        Why it has none.
    """

    def __init__(self, run_id: str, reason: Reason) -> None:
        super().__init__(f"{run_id}: {sentence(reason)}")
        self.reason = reason


# of a temperature log that a session can be told from; chosen: the log of a minute with 12 nodes
# of the smoother (5 s)
FEWEST_READINGS, SHORTEST_LOG_S = 10, 60.0
# step of a thermometer that never changes and is accepted: whole degrees, the coarsest usual
UNSEEN_STEP_degC = 1.0
SAMPLES = 60  # of a span for its mean: every 5 s of a bin of 5 min
# a hole up to this is bridged by the smoother, with the sigma that it has there
BRIDGED_HOLE_S = 2.0 * HOLE_S


@dataclass(frozen=True)
class GyroTemperature:
    """Nodes time_s (n,), temperature (n, 3) [degC], rate (n, 3) [degC/min] and which rows (n, 3)
    rest on readings.

    unusable: axes without a thermometer; the others' mean stands in for them. smooth: per axis,
    None where unusable. gradient_degC (n, 3): Tdiff at each gyro, None where not logged.
    """

    time_s: NDArray
    temperature_degC: NDArray
    rate_degC_min: NDArray
    usable: NDArray
    faults: tuple[ThermometerFault, ...]
    unusable: tuple[str, ...]
    smooth: tuple[SmoothTemperature | None, ...]
    gradient_degC: NDArray | None = None
    # by edges: every table that a session is laid on asks for the same bins
    _of_edges: dict[bytes, "BinTemperatures"] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def at(self, time_s: NDArray) -> NDArray:
        """Temperature (k, 3) at given times; the end values are held outside the log."""
        return np.stack(
            [np.interp(time_s, self.time_s, self.temperature_degC[:, i]) for i in range(3)], axis=1
        )

    def between(self, start_s: float, end_s: float) -> slice:
        """Rows inside [start, end]; at least one."""
        a, b = np.searchsorted(self.time_s, [start_s, end_s])
        a = min(int(a), len(self.time_s) - 1)
        return slice(a, max(int(b), a + 1))

    def mean_rows(self, start_s: float, end_s: float) -> NDArray:
        """Weights (n,) of the nodes in the mean over a span, straight lines between them, the ends
        held beyond.
        """
        middle_s = start_s + (end_s - start_s) * (np.arange(SAMPLES) + 0.5) / SAMPLES
        place = np.interp(middle_s, self.time_s, np.arange(self.time_s.size))
        j = np.minimum(place.astype(int), self.time_s.size - 2)
        n = self.time_s.size
        return (np.bincount(j, 1.0 - (place - j), n) + np.bincount(j + 1, place - j, n)) / SAMPLES

    def covered(self, start_s: float, end_s: float) -> NDArray:
        """Share (3,) of a span in which each axis has a trustworthy reading."""
        grid = float(self.time_s[1] - self.time_s[0])
        inside = (self.time_s >= start_s - 0.5 * grid) & (self.time_s < end_s + 0.5 * grid)
        return np.minimum(self.usable[inside].sum(axis=0) * grid / max(end_s - start_s, grid), 1.0)

    def of_bins(self, edges_s: NDArray) -> "BinTemperatures":
        """What the log says of bins between edges (N + 1,)."""
        key = edges_s.tobytes()
        if key not in self._of_edges:
            self._of_edges[key] = self._bins(edges_s)
        return self._of_edges[key]

    def left_out(self) -> tuple[Span, ...]:
        """What is wrong, as spans of time for the list of what was left out."""
        return tuple(
            Span(start_s=f.start_s, end_s=f.end_s, reason=fault_reason(f)) for f in self.faults
        )

    def why_unusable(self) -> dict[str, str]:
        """For each axis without a thermometer, what is wrong with it."""
        said = {f.column[5]: f.text for f in reversed(self.faults) if f.column.startswith("gyro_")}
        return {axis: said.get(axis, "has too few readings") for axis in self.unusable}

    def _bins(self, edges_s: NDArray) -> "BinTemperatures":
        rows = np.stack([self.mean_rows(a, b) for a, b in pairwise(edges_s)])
        width = self.time_s[1] - self.time_s[0]
        ends = np.stack([self.mean_rows(e - 0.5 * width, e + 0.5 * width) for e in edges_s])
        slopes = np.diff(ends, axis=0) / np.diff(edges_s)[:, None]
        none = np.zeros((len(rows), len(rows)))
        P, rates = (
            np.stack([none if s is None else s.covariance(of) for s in self.smooth])
            for of in (rows, slopes)
        )
        sigma = 60.0 * np.stack([np.sqrt(np.diag(each)) for each in rates], axis=1)
        covered = np.array([self.covered(a, b) for a, b in pairwise(edges_s)])
        for values in (rows, P, sigma, covered):
            values.flags.writeable = False
        return BinTemperatures(rows=rows, covariance=P, rate_sigma_degC_min=sigma, covered=covered)


@dataclass(frozen=True, kw_only=True)
class BinTemperatures:
    """What a temperature log says of N bins.

    rows (N, n): weights of the log's nodes in each bin's mean; covariance (3, N, N) [degC^2]: of
    each axis's means, zero for an unusable axis; rate_sigma_degC_min (N, 3): of the mean rates;
    covered (N, 3): share in which the axis has a trustworthy reading.
    """

    rows: NDArray
    covariance: NDArray
    rate_sigma_degC_min: NDArray
    covered: NDArray


def fault_reason(fault: ThermometerFault) -> Reason:
    """A fault with what follows from it."""
    return because(_follows(fault), column=fault.column, fault=fault.text)


def _follows(fault: ThermometerFault) -> ThermometerReason:
    if not fault.column.startswith("gyro_"):
        unit = fault.kind is FaultKind.STUCK
        return ThermometerReason.UNIT_STUCK if unit else ThermometerReason.OF_ANOTHER
    if fault.kind in OF_THE_COLUMN:
        return ThermometerReason.AXIS_LEFT_OUT
    of_kind = {
        FaultKind.COARSE: ThermometerReason.COARSE,
        FaultKind.CONSTANT: ThermometerReason.CONSTANT,
        FaultKind.HOLE: ThermometerReason.HOLE,
    }
    return of_kind.get(fault.kind, ThermometerReason.READINGS_LEFT_OUT)


def no_thermometer(temperature: GyroTemperature) -> tuple[Reason, ...]:
    """Reasons of a run whose gyro thermometers are all out."""
    stuck = {f.kind for f in temperature.faults} - {FaultKind.HOLE} == {FaultKind.STUCK}
    code = ThermometerReason.ALL_STUCK if stuck else ThermometerReason.NONE_USABLE
    return (because(code), *(fault_reason(f) for f in temperature.faults))


def plausible_range(table: ThermalTable) -> tuple[float, float]:
    """Where a gyro may be: the usual range, or what the table of the unit covers."""
    nodes = np.concatenate(table.temperature_degC)
    return min(PLAUSIBLE_MEDIAN_degC[0], float(nodes.min())), max(
        PLAUSIBLE_MEDIAN_degC[1], float(nodes.max())
    )


def too_short(log: TemperatureLog | None) -> Reason | None:
    """Why a temperature log cannot serve a session, None where it can."""
    if log is None:
        return because(ThermometerReason.NONE_LOGGED)
    rows, span_s = log.time_s.size, float(log.time_s[-1] - log.time_s[0])
    if rows >= FEWEST_READINGS and span_s >= SHORTEST_LOG_S:
        return None
    return because(
        ThermometerReason.TOO_FEW_ROWS,
        rows=rows,
        span_s=math.floor(10.0 * span_s) / 10.0,  # 59.97 is not 60
        needed_rows=FEWEST_READINGS,
        needed_s=SHORTEST_LOG_S,
    )


def gyro_temperature(
    log: TemperatureLog, *, plausible_degC: tuple[float, float] = PLAUSIBLE_MEDIAN_degC
) -> GyroTemperature:
    """Check the thermometers and smooth what can be trusted; one row is held for ever."""
    checked = check_thermometers(
        log.time_s, _columns(log), plausible_degC=plausible_degC, constant=log.constant
    )
    nodes = nodes_of(log.time_s)
    n = nodes.size
    T, usable = np.full((n, 3), np.nan), np.zeros((n, 3), dtype=bool)
    smooth: list[SmoothTemperature | None] = [None, None, None]
    for k, axis in enumerate(AXES):
        name = f"gyro_{axis}_degC"
        rows = np.flatnonzero(checked.valid[name])
        if rows.size < max(min(FEWEST_READINGS, log.time_s.size), 3):
            continue
        found = smooth_readings(
            nodes, log.time_s[rows], log.gyro_degC[rows, k], checked.resolution_degC[name]
        )
        if any(f.column == name and f.kind is FaultKind.CONSTANT for f in checked.faults):
            found = replace(found, level_degC=UNSEEN_STEP_degC / np.sqrt(12.0))
        smooth[k], T[:, k], usable[:, k] = (
            found,
            found.value_degC,
            _near_readings(nodes, log.time_s[rows]),
        )
    unusable = tuple(axis for k, axis in enumerate(AXES) if smooth[k] is None)
    T = _filled(nodes, T, usable, log)
    faults = tuple(f for f in checked.faults if f.column.startswith(("gyro_", "temperature")))
    return GyroTemperature(
        time_s=nodes,
        temperature_degC=T,
        rate_degC_min=60.0 * np.gradient(T, nodes, axis=0),
        usable=usable,
        faults=faults,
        unusable=unusable,
        smooth=tuple(smooth),
        gradient_degC=_gradient(nodes, log),
    )


def _columns(log: TemperatureLog) -> dict[str, NDArray]:
    """The thermometers by their names in the file."""
    columns = {f"gyro_{axis}_degC": log.gyro_degC[:, k] for k, axis in enumerate(AXES)}
    if log.accel_degC is not None:
        columns |= {f"accel_{axis}_degC": log.accel_degC[:, k] for k, axis in enumerate(AXES)}
    if log.block_degC is not None:
        columns["block_degC"] = log.block_degC
    if log.ambient_degC is not None:
        columns["ambient_degC"] = log.ambient_degC
    return columns


def _near_readings(nodes_s: NDArray, time_s: NDArray) -> NDArray:
    """Nodes (n,) between two readings that are not far apart, or close to one."""
    after = np.searchsorted(time_s, nodes_s)
    before, behind = time_s[np.maximum(after - 1, 0)], time_s[np.minimum(after, time_s.size - 1)]
    if time_s.size > 1:
        bridged = max(BRIDGED_HOLE_S, 5.0 * float(np.median(np.diff(time_s))))
    else:
        bridged = BRIDGED_HOLE_S
    nearest = np.minimum(np.abs(nodes_s - before), np.abs(nodes_s - behind))
    return (behind - before <= bridged) & (nearest <= bridged)


def _filled(nodes_s: NDArray, T: NDArray, usable: NDArray, log: TemperatureLog) -> NDArray:
    """Where an axis has no reading: the mean of the others, shifted so that it meets the axis's own
    at the seams.
    """
    T = T.copy()
    trusted = np.where(usable, T, np.nan)
    for k in range(3):
        gap = ~usable[:, k]
        if not gap.any():
            continue
        others = np.delete(trusted, k, axis=1)
        seen = np.isfinite(others).any(axis=1)
        mean = np.full(nodes_s.size, np.nan)
        mean[seen] = np.nanmean(others[seen], axis=1)
        own = usable[:, k]
        both = own & seen
        if both.any():
            offset = np.interp(nodes_s, nodes_s[both], (T[:, k] - mean)[both])
            T[gap & seen, k] = (mean + offset)[gap & seen]
        elif not own.any() and seen.any():
            T[:, k] = np.interp(nodes_s, nodes_s[seen], mean[seen])
        elif not own.any():
            T[:, k] = _as_read(nodes_s, log, k)
    return T


def _as_read(nodes_s: NDArray, log: TemperatureLog, axis: int) -> NDArray:
    """The readings of an axis as they are, where no thermometer can be used."""
    read = np.isfinite(log.gyro_degC[:, axis])
    if read.any():
        return np.interp(nodes_s, log.time_s[read], log.gyro_degC[read, axis])
    return np.zeros(nodes_s.size)


def _gradient(nodes_s: NDArray, log: TemperatureLog) -> NDArray | None:
    """Differential readings at the nodes; NaN for an axis without any."""
    if log.gradient_degC is None:
        return None
    out = np.full((nodes_s.size, 3), np.nan)
    for k in range(3):
        read = np.isfinite(log.gradient_degC[:, k])
        if read.any():
            out[:, k] = np.interp(nodes_s, log.time_s[read], log.gradient_degC[read, k])
    return out
