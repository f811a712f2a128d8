"""Minute means of one gyro over several runs, each run with its own slow drift: what thermal models
of every kind are fitted to.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from infield.table.merge import session_covariance
from infield.thermal.ramp_runs import RampRun
from ins.records import TwinModel

MOST_BINS, SHORTEST_BIN_S = 60, 900.0  # of a run's slow drift


@dataclass(frozen=True)
class AxisBlocks:
    """One gyro's block means: n rows of temperature [degC], rate [degC/min], bias [deg/h] and its
    white sigma.

    bin (n,): index of the drift bin of each row, drift (m, m) [(deg/h)^2]: prior covariance of the
    bins. sense (n, q): from -1 (cooling) to 1 (warming), None where nobody asks for hysteresis.
    """

    temperature_degC: NDArray
    rate_degC_min: NDArray
    bias_deg_h: NDArray
    sigma_deg_h: NDArray
    bin: NDArray
    drift: NDArray
    sense: NDArray | None = None


def axis_blocks(
    runs: Sequence[RampRun],
    k: int,
    twin: TwinModel,
    *,
    free: bool = False,
    rows: Sequence[NDArray] | None = None,
) -> AxisBlocks:
    """Blocks of one gyro over several runs with the drift of each; rows: of each run, None: its
    steady ones.

    free: each run has its own share of Earth rate.
    """
    columns: list[tuple[NDArray, ...]] = []
    drifts: list[NDArray] = []
    for j, run in enumerate(runs):
        chosen = np.flatnonzero(run.steady) if rows is None else rows[j]
        t = run.time_s[chosen]
        bin_s = max(SHORTEST_BIN_S, float(np.ptp(t)) / MOST_BINS)
        bins = np.floor((t - t[0]) / bin_s).astype(int)
        count, before = int(bins[-1]) + 1, sum(d.shape[0] for d in drifts)
        drift = session_covariance(
            axis_index=np.zeros(count),
            time_s=t[0] + bin_s * (np.arange(count) + 0.5),
            duration_s=np.full(count, bin_s),
            gyro=twin.gyro,
            run_length_s=float(run.time_s[-1]),
        )
        drifts.append(drift + (run.level_sigma_deg_h[k] ** 2 if free else 0.0))
        columns.append(
            (
                run.temperature_degC[chosen, k],
                run.rate_degC_min[chosen, k],
                run.bias_deg_h[chosen, k],
                np.full(chosen.size, run.sigma_deg_h[k]),
                before + bins,
            )
        )
    joint = np.asarray(block_diag(*drifts))
    T, rate, bias, sigma, index = (np.concatenate(column) for column in zip(*columns))
    return AxisBlocks(T, rate, bias, sigma, index, joint)
