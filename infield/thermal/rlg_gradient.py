"""Ring-laser gyro: K1..K6 of block temperature, its rate and temperature differences (US
8,781,778), from runs at rest.

Least squares over minute means with each run's turn-on, flicker and random walk marginalised
(`fog_ramps.axis_blocks`). Terms that the data do not hold apart are named and dropped
(`gradient_terms`); of the rest those stay that foretell held-out blocks best, every fifth stretch
of 20 min in turn. Whole runs left out choose badly: a run heated from its own side is told by no
other (a term ten times its sigma was dropped). Source: physics.md section 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from infield.thermal.fog_ramps import CONTRADICTS, TURNED_RAD, levels_differ
from infield.thermal.gradient_fit import STRETCH_MIN, AxisFit, AxisModel
from infield.thermal.gradient_runs import GradientRun
from ins.records import AXES, TwinModel

SHORTEST_MIN = 20  # usable minutes of a run
FEWEST_MIN = 60  # of all runs together
SPAN_degC = 10.0  # of temperatures in all
ONE_SIDED = 0.25  # of the rate's RMS, what must be left beyond a curve of temperature
CURVE_ORDER = 3  # of that curve
MOVING_degC_min = 0.05  # a rate faster than this has a sign
BOTH_WAYS_degC = 5.0  # of temperatures passed warming and cooling


@dataclass(frozen=True)
class GradientStudy:
    """All that came of the runs; refused, inconsistent: why there is no fit. range_degC (3, 2):
    temperatures fitted to.
    """

    runs: tuple[GradientRun, ...]
    twin: TwinModel
    refused: tuple[str, ...]
    notes: tuple[str, ...]
    reference_degC: float = 0.0
    validation: str = ""
    axes: tuple[AxisModel, ...] = ()
    inconsistent: tuple[str, ...] = ()
    remounted: bool = False


def fit_gradients(
    runs: Sequence[GradientRun], twin: TwinModel, *, remounted: bool = False
) -> GradientStudy:
    """Fit every gyro with a thermometer. remounted: the unit was moved between runs (also found
    from the level).
    """
    blocks = [run.blocks for run in runs]
    notes = (
        ["the unit stands on another level in some runs: taken as mounted anew"]
        if levels_differ(blocks)
        else []
    )
    study = GradientStudy(tuple(runs), twin, (), tuple(notes), remounted=remounted or bool(notes))
    why = _cannot_fit(runs)
    if why:
        return replace(study, refused=why)
    lines = tuple(axis for axis in AXES if all(axis in run.lines for run in runs))
    notes += _line_notes(runs, lines)
    T = np.concatenate([run.blocks.temperature_degC[run.usable] for run in runs])
    reference = float(np.round(T.mean()))
    usable = [k for k, axis in enumerate(AXES) if all(axis not in run.unusable for run in blocks)]
    notes += [
        f"gyro {axis}: no thermometer, left out" for k, axis in enumerate(AXES) if k not in usable
    ]
    axes = tuple(AxisFit(k, runs, twin, reference, lines, study.remounted).model() for k in usable)
    notes += [f"gyro {a.axis}: {found.words()}" for a in axes for found in a.collinear]
    notes += [
        f"gyro {a.axis}: the residual scatters {np.sqrt(a.scatter):.2f} times as much as white"
        " noise and the twin's drift say: sigmas are widened by that"
        for a in axes
        if a.scatter > 1.5
    ]
    against = tuple(
        f"gyro {a.axis}: the residual scatters {np.sqrt(a.scatter):.1f} times as much as white"
        f" noise and the twin's drift say, needed at most {np.sqrt(CONTRADICTS):g}: something else"
        " than temperature, its rate and gradients moves this bias"
        for a in axes
        if a.scatter > CONTRADICTS
    )
    return replace(
        study,
        axes=() if against else axes,
        notes=tuple(notes),
        inconsistent=against,
        reference_degC=reference,
        validation=f"every fifth stretch of {STRETCH_MIN} min",
    )


def _line_notes(runs: Sequence[GradientRun], lines: tuple[str, ...]) -> list[str]:
    if not any(run.lines for run in runs):
        return [
            "no gradient column moves in any run: fitted without gradient terms, which then hide in"
            " the rate terms"
        ]
    idle = [axis for axis in AXES if axis not in lines]
    return [
        f"line gradient_{axis}: does not move or is not logged in every run: left out"
        for axis in idle
    ]


def _cannot_fit(runs: Sequence[GradientRun]) -> tuple[str, ...]:
    """Reasons, each with what was measured, what was needed and what would help."""
    for run in runs:
        if run.blocks.turned_rad > TURNED_RAD:
            return (
                (
                    f"moving base: run {run.blocks.run_id} turns by"
                    f" {np.degrees(run.blocks.turned_rad):.2g} deg, needed rest within"
                    f" {np.degrees(TURNED_RAD):.2g} deg: Earth rate would pass for a thermal bias"
                ),
            )
        if run.minutes < SHORTEST_MIN:
            return (
                (
                    f"too short: run {run.blocks.run_id} has {run.minutes} min of rest, needed"
                    f" {SHORTEST_MIN}"
                ),
            )
    total = sum(run.minutes for run in runs)
    if total < FEWEST_MIN:
        return (f"too short: {total} min of rest in all runs, needed {FEWEST_MIN}",)
    T, rate = (
        np.concatenate([column[run.usable].mean(axis=1) for run, column in zip(runs, columns)])
        for columns in (
            [r.blocks.temperature_degC for r in runs],
            [r.blocks.rate_degC_min for r in runs],
        )
    )
    if np.ptp(T) < SPAN_degC:
        return (f"temperature spans {np.ptp(T):.1f} degC in all runs, needed {SPAN_degC:g}",)
    return _one_sided(T, rate)


def _one_sided(T: NDArray, rate: NDArray) -> tuple[str, ...]:
    """Warming alone (or cooling alone) along one curve of temperature: the rate says nothing that
    temperature does not.
    """
    up, down = T[rate > MOVING_degC_min], T[rate < -MOVING_degC_min]
    both = min(up.max(), down.max()) - max(up.min(), down.min()) if up.size and down.size else 0.0
    if both >= BOTH_WAYS_degC:
        return ()
    t = (T - T.mean()) / max(np.std(T), 1e-9)
    left = rate - np.polynomial.polynomial.polyval(
        t, np.polynomial.polynomial.polyfit(t, rate, CURVE_ORDER)
    )
    share = float(np.sqrt(np.mean(left**2) / max(np.mean(rate**2), 1e-12)))
    if share >= ONE_SIDED:
        return ()
    way = "warms" if rate.mean() > 0 else "cools"
    return (
        (
            f"one-sided heating: the unit only {way}, and {100 * share:.0f} % of dT/dt is left"
            f" beyond a curve of temperature, needed {100 * ONE_SIDED:.0f} %: K4 cannot be told"
            f" from K2 and K3; warm and cool it over the same {BOTH_WAYS_degC:g} degC, or dwell on"
            " the way"
        ),
    )
