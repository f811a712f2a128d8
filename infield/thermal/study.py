"""What a study of chamber runs comes to, whatever the model: its verdict, and what is said of every
kind of gyro.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from infield.table.merge import session_covariance
from infield.thermal.ramp_runs import RampRun
from infield.thermal.reasons import BiasDriver, ThermalNote, ThermalReason, ThermalVerdict
from ins.records import AXES, InputError, TwinModel
from ins.verdicts import Reason, because

TURNED_RAD = 2e-3  # 0.03 deg/h of Earth rate on another axis: the unit did not rest
CONTRADICTS = 25.0  # chi2 per degree of freedom beyond which this is not the model of these data
NOTED = 1.5  # the same, above which the notes say so; sigmas 22 % too small: 1.22^2 is 1.5
# runs whose levels differ by more were mounted anew; 0.015 deg/h of Earth rate
SAME_LEVEL_RAD = 1e-3
INFLATE_ABOVE = 1.0  # chi2 per degree of freedom above which sigmas are widened by its root

TOLD = 60  # characters of what a document holds in the place of what is needed


@dataclass(frozen=True, kw_only=True)
class ThermalStudy:
    """refused: why nothing could be fitted; inconsistent: what contradicts what was fitted; both
    empty where a model came of the runs.
    """

    twin: TwinModel
    refused: tuple[Reason, ...] = ()
    inconsistent: tuple[Reason, ...] = ()
    notes: tuple[Reason, ...] = ()
    remounted: bool = False

    @property
    def verdict(self) -> ThermalVerdict:
        if self.refused:
            return ThermalVerdict.REFUSED
        return ThermalVerdict.INCONSISTENT if self.inconsistent else ThermalVerdict.FITTED

    @property
    def reasons(self) -> tuple[Reason, ...]:
        return (*self.refused, *self.inconsistent)


class FittedGyro(Protocol):
    """One gyro's fit; scatter: chi2 of its residual per degree of freedom."""

    @property
    def axis(self) -> str: ...

    @property
    def scatter(self) -> float: ...


def levels_differ(runs: Sequence[RampRun]) -> bool:
    levels = np.array([run.roll_pitch_rad for run in runs])
    return bool(len(levels) > 1 and np.ptp(levels, axis=0).max() > SAME_LEVEL_RAD)


def moving_base(run: RampRun, name: str = "run") -> tuple[Reason, ...]:
    """Why a run that turns cannot be used; empty where it rests. name: with its role."""
    if run.turned_rad <= TURNED_RAD:
        return ()
    why = because(
        ThermalReason.MOVING_BASE,
        run=name,
        run_id=run.run_id,
        turned_rad=run.turned_rad,
        needed_rad=TURNED_RAD,
    )
    return (why,)


def with_thermometer(runs: Sequence[RampRun]) -> tuple[list[int], list[Reason]]:
    """Gyros whose temperature is known in every run, and a note for each of the others."""
    usable = [k for k, axis in enumerate(AXES) if all(axis not in run.unusable for run in runs)]
    left_out = [axis for k, axis in enumerate(AXES) if k not in usable]
    return usable, [because(ThermalNote.NO_THERMOMETER, axis=axis) for axis in left_out]


def widened(axes: Iterable[FittedGyro]) -> list[Reason]:
    """A note for each gyro whose sigmas were widened by much."""
    return [
        because(ThermalNote.SIGMAS_WIDENED, axis=a.axis, times=float(np.sqrt(a.scatter)))
        for a in axes
        if a.scatter > NOTED
    ]


def contradicted(axes: Iterable[FittedGyro], moves: BiasDriver) -> tuple[Reason, ...]:
    """Gyros whose residual says that something else than the model moves the bias."""
    return tuple(
        because(
            ThermalReason.RESIDUAL_SCATTERS,
            axis=a.axis,
            times=float(np.sqrt(a.scatter)),
            needed=float(np.sqrt(CONTRADICTS)),
            moves=moves,
        )
        for a in axes
        if a.scatter > CONTRADICTS
    )


def check_fitted(document: Mapping[str, Any], schema: str, name: str) -> None:
    """InputError where a document is no fitted model of a schema."""
    for key, needed in (("schema", schema), ("verdict", ThermalVerdict.FITTED.value)):
        if document.get(key) != needed:
            got = str(document.get(key))[:TOLD]
            raise InputError(f"{name}: {key}: got {got!r}, needed {needed!r}")


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
