"""Ring-laser gyro: K1..K6 of block temperature, its rate and temperature differences (US
8,781,778), from runs at rest.

Least squares over minute means with each run's turn-on, flicker and random walk marginalised
(`thermal.study.axis_blocks`). Terms that the data do not hold apart are named and dropped
(`thermal.rlg.terms`); of the rest those stay that foretell held-out blocks best, every fifth
stretch of 20 min in turn. Whole runs left out choose badly: a run heated from its own side is told
by no other (a term ten times its sigma was dropped). Source: physics.md section 3.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from infield.thermal.compensation import means_both_ways
from infield.thermal.ramp_runs import RAMP_BLOCK_S, GradientRun, gradient_run
from infield.thermal.reasons import BiasDriver, LatePart, ThermalNote, ThermalReason
from infield.thermal.rlg.fit import (
    STRETCH_MIN,
    AxisFit,
    AxisModel,
    five_minute_means,
    noise_of_means,
)
from infield.thermal.rlg.lag import Lag, corrected_columns
from infield.thermal.rlg.model import RlgModel
from infield.thermal.rlg.terms import columns
from infield.thermal.study import (
    ThermalStudy,
    contradicted,
    levels_differ,
    moving_base,
    widened,
    with_thermometer,
)
from ins.documents import written
from ins.records import AXES, Run, TwinModel
from ins.verdicts import Reason, because

FEWEST_MIN = 60  # of all runs together: 7 blocks of a minute for each of the 8 terms
# of temperatures in all; chosen: as OVERLAP_degC of the ramps, 10 blocks at 1 degC/min
SPAN_degC = 10.0
# of the rate's RMS, what must be left beyond a curve of temperature: with less the sigma of K4
# grows more than 4 times
ONE_SIDED = 0.25
CURVE_ORDER = 3  # of that curve
# a rate faster than this has a sign; as HEATING_DEG_C_MIN of reports.documents.session
MOVING_degC_min = 0.05
BOTH_WAYS_degC = 5.0  # of temperatures passed warming and cooling; chosen: 1/2 of SPAN_degC


@dataclass(frozen=True, kw_only=True)
class GradientStudy(ThermalStudy):
    """All that came of the runs."""

    runs: tuple[GradientRun, ...]
    reference_degC: float = 0.0
    validation: str = ""
    axes: tuple[AxisModel, ...] = ()


def fit_gradients(
    runs: Sequence[GradientRun], twin: TwinModel, *, remounted: bool = False
) -> GradientStudy:
    """Fit every gyro with a thermometer. remounted: the unit was moved between runs (also found
    from the level).
    """
    blocks = [run.blocks for run in runs]
    notes = [because(ThermalNote.REMOUNTED)] if levels_differ(blocks) else []
    moved = remounted or bool(notes)
    study = GradientStudy(runs=tuple(runs), twin=twin, notes=tuple(notes), remounted=moved)
    why = _cannot_fit(runs)
    if why:
        return replace(study, refused=why)
    lines = tuple(axis for axis in AXES if all(axis in run.lines for run in runs))
    T = np.concatenate([run.blocks.temperature_degC[run.usable] for run in runs])
    reference = float(np.round(T.mean()))
    usable, left_out = with_thermometer(blocks)
    axes = tuple(AxisFit(k, runs, twin, reference, lines, moved).model() for k in usable)
    dropped = [
        because(ThermalNote.DROPPED, axis=a.axis, why=found.why)
        for a in axes
        for found in a.collinear
    ]
    late = [_late(a.axis, a.lag) for a in axes if a.lag.found]
    against = contradicted(axes, BiasDriver.GRADIENTS)
    return replace(
        study,
        axes=() if against else axes,
        notes=(*notes, *_line_notes(runs, lines), *left_out, *dropped, *late, *widened(axes)),
        inconsistent=against,
        reference_degC=reference,
        validation=f"every fifth stretch of {STRETCH_MIN} min",
    )


def _late(axis: str, lag: Lag) -> Reason:
    """A note of thermometers that read late."""
    parts = []
    if lag.gyro_s > 0.0:
        parts.append(because(LatePart.GYRO, lag_s=lag.gyro_s, sigma_s=lag.sigma_gyro_s))
    if lag.lines_s > 0.0:
        parts.append(because(LatePart.LINES, lag_s=lag.lines_s, sigma_s=lag.sigma_lines_s))
    return because(
        ThermalNote.LATE_THERMOMETER, axis=axis, late=tuple(parts), gain_chi2=lag.gain_chi2
    )


def _line_notes(runs: Sequence[GradientRun], lines: tuple[str, ...]) -> list[Reason]:
    if not any(run.lines for run in runs):
        return [because(ThermalNote.NO_LINES)]
    return [because(ThermalNote.LINE_IDLE, axis=axis) for axis in AXES if axis not in lines]


def _cannot_fit(runs: Sequence[GradientRun]) -> tuple[Reason, ...]:
    """Reasons, each with what was measured, what was needed and what would help."""
    for run in runs:
        why = moving_base(run.blocks) or _too_short(run)
        if why:
            return why
    total = sum(run.minutes for run in runs)
    if total < FEWEST_MIN:
        return (because(ThermalReason.RUNS_TOO_SHORT, minutes=total, needed_min=FEWEST_MIN),)
    T = np.concatenate([run.blocks.temperature_degC[run.usable].mean(axis=1) for run in runs])
    rate = np.concatenate([run.blocks.rate_degC_min[run.usable].mean(axis=1) for run in runs])
    span = float(np.ptp(T))
    if span < SPAN_degC:
        return (because(ThermalReason.NARROW, span_degC=span, needed_degC=SPAN_degC),)
    return _one_sided(T, rate)


def _too_short(run: GradientRun) -> tuple[Reason, ...]:
    if run.minutes >= STRETCH_MIN:
        return ()
    why = because(
        ThermalReason.RUN_TOO_SHORT,
        run_id=run.blocks.run_id,
        minutes=run.minutes,
        needed_min=STRETCH_MIN,
    )
    return (why,)


def _one_sided(T: NDArray, rate: NDArray) -> tuple[Reason, ...]:
    """Warming alone (or cooling alone) along one curve of temperature."""
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
    one_sided = because(
        ThermalReason.ONE_SIDED,
        warms=bool(rate.mean() > 0),
        share=share,
        needed=ONE_SIDED,
        both_ways_degC=BOTH_WAYS_degC,
    )
    return (one_sided,)


@dataclass(frozen=True, kw_only=True)
class CheckedMeans:
    """RMS of one gyro's five-minute means, less their mean: before, with temperature alone, after
    (smoothed), in real time.
    """

    before_deg_h: float
    temperature_only_deg_h: float
    after_deg_h: float
    causal_after_deg_h: float
    noise_deg_h: float
    over_temperature_only: float
    over_noise: float
    means: int


@written("run_id=run.blocks.run_id sha256=run.blocks.sha256 share_inside axes")
@dataclass(frozen=True, kw_only=True)
class RlgHeldOut:
    """What the model leaves of one run; means[axis]: time (m,) and values (m, 4), in the order of
    `CheckedMeans`.
    """

    run: GradientRun
    share_inside: float
    axes: Mapping[str, CheckedMeans]
    means: Mapping[str, tuple[NDArray, NDArray]]


SETTLE_S = 600.0  # in which the causal filter starts; chosen: 10 min, ten blocks


def held_out_run(
    run: Run, model: RlgModel, fits: tuple[AxisModel, ...], twin: TwinModel
) -> RlgHeldOut:
    """Takes the model's bias out of the blocks both ways; left out: the first SETTLE_S."""
    raw = gradient_run(run, twin)
    b, axes, means = raw.blocks, {}, {}
    batch, causal = (b.bias_deg_h - taken for taken in means_both_ways(run, model, b.time_s))
    inside = model.inside(b.temperature_degC)
    for fit in fits:
        k = AXES.index(fit.axis)
        rows = np.flatnonzero(raw.usable & inside[:, k] & (b.time_s - b.time_s[0] > SETTLE_S))
        if rows.size < 3 * int(SETTLE_S / RAMP_BLOCK_S):
            continue
        X = columns(
            b.temperature_degC[:, k],
            b.rate_degC_min[:, k],
            raw.gradient_degC,
            model.reference_degC,
            fit.nodes_degC,
        )
        X = corrected_columns(X, b.time_s, fit.lag)[rows]
        plain = b.bias_deg_h[rows, k] - X @ fit.temperature_only
        values = np.column_stack([b.bias_deg_h[rows, k], plain, batch[rows, k], causal[rows, k]])
        found, time_s, blocks = five_minute_means(b.time_s[rows], values)
        found = found - found.mean(axis=0)
        before, with_temperature, after, late = np.sqrt(np.mean(found**2, axis=0)).tolist()
        noise = float(np.sqrt(noise_of_means(twin, raw, k, time_s, blocks) / len(found)))
        axes[fit.axis] = CheckedMeans(
            before_deg_h=before,
            temperature_only_deg_h=with_temperature,
            after_deg_h=after,
            causal_after_deg_h=late,
            noise_deg_h=noise,
            over_temperature_only=after / with_temperature,
            over_noise=after / noise,
            means=int(time_s.size),
        )
        means[fit.axis] = time_s, found
    share = float(inside[raw.usable].mean())
    return RlgHeldOut(run=raw, share_inside=share, axes=axes, means=means)
