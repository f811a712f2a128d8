"""A fitted ring-laser model on a run that nothing was fitted to: what it leaves, smoothed and in
real-time order.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.thermal.compensation import means_both_ways
from infield.thermal.gradient_runs import GradientRun, gradient_run
from infield.thermal.ramp_runs import RAMP_BLOCK_S
from infield.thermal.rlg.fit import AxisModel, five_minute_means, noise_of_means
from infield.thermal.rlg.lag import corrected_columns
from infield.thermal.rlg.model import RlgModel
from infield.thermal.rlg.terms import columns
from ins.records import AXES, Run, TwinModel


@dataclass(frozen=True)
class RlgHeldOut:
    """Five-minute means of one run, each gyro less its mean: before, with temperature alone, after
    (smoothed), in real time.

    rms_deg_h, noise_deg_h: by gyro; rms_deg_h[axis] (4,) in that order. means[axis]: time (m,) and
    values (m, 4).
    """

    run: GradientRun
    rms_deg_h: dict[str, NDArray]
    noise_deg_h: dict[str, float]
    means: dict[str, tuple[NDArray, NDArray]]
    share_inside: float


def held_out_run(
    run: Run,
    model: RlgModel,
    fits: tuple[AxisModel, ...],
    twin: TwinModel,
    *,
    settle_s: float = 600.0,
) -> RlgHeldOut:
    """Takes the model's bias out of the blocks both ways; left out: settle_s, in which the causal
    filter starts.
    """
    raw = gradient_run(run, twin)
    b, rms, noise, means = raw.blocks, {}, {}, {}
    batch, causal = (b.bias_deg_h - taken for taken in means_both_ways(run, model, b.time_s))
    inside = model.inside(b.temperature_degC)
    for fit in fits:
        k = AXES.index(fit.axis)
        rows = np.flatnonzero(raw.usable & inside[:, k] & (b.time_s - b.time_s[0] > settle_s))
        if rows.size < 3 * int(settle_s / RAMP_BLOCK_S):
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
        rms[fit.axis] = np.sqrt(np.mean(found**2, axis=0))
        noise[fit.axis] = float(np.sqrt(noise_of_means(twin, raw, k, time_s, blocks) / len(found)))
        means[fit.axis] = time_s, found
    return RlgHeldOut(raw, rms, noise, means, float(inside[raw.usable].mean()))
