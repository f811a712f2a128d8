"""What a found effect looks like in the runs: the residual of its main channel with the fitted
effect, run by run.

Where the effect repeats and there are several runs, the curve of a run has the coefficients of the
*other* runs, so what is seen is a forecast.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.units import DEG_PER_HOUR, MICRO_G
from simreal.evidence.parked import PARKED_MEAN_S
from simreal.evidence.whitened import CHANNELS, RunEvidence
from simreal.inference.diagnosis import Diagnosis
from simreal.inference.verdict import Judging
from simreal.predict.traces import (
    LEAST_ELSEWHERE,
    fitted,
    fitted_without,
    known_trace,
    summed,
    unit_traces,
)

MINUTE_BINS = 6
# of its RMS: an effect whose scatter within a run is larger is no constant of that run; chosen:
# below the 0.5 of a ramp that begins at zero
VARIES = 0.2
# squared sigmas of an effect in a parked channel: a smaller one is not seen in its drawing; chosen:
# 3 sigma
LEAST_DRAWN = 9.0


@dataclass(frozen=True)
class RunCurve:
    """One run: time_min (n,), measured (n,) and effect (n,) in the overlay's unit. held_out: fitted
    on the other runs.
    """

    run_id: str
    time_min: NDArray
    measured: NDArray
    effect: NDArray
    held_out: bool


@dataclass(frozen=True)
class Overlay:
    """A cause along the runs: one-minute means of a parked channel, less the attitude, the constant
    of the run (not where the effect is one itself) and the other effects.
    """

    channel: str
    unit: str
    curves: tuple[RunCurve, ...]


def overlays(diagnosis: Diagnosis) -> tuple[Overlay | None, ...]:
    """One for each cause, None for noise and for what hardly touches a parked sensor."""
    by_run = [c.shrink is not None and c.shrink.how is Judging.BY_RUN for c in diagnosis.causes]
    return tuple(_overlay(diagnosis, k, by_run=own) for k, own in zip(diagnosis.order, by_run))


def _overlay(diagnosis: Diagnosis, number: int, *, by_run: bool) -> Overlay | None:
    attribution = diagnosis.attribution
    slot, evidence = attribution.slots[number], attribution.evidence
    if slot.group is None:
        return None
    mine = np.isin(attribution.columns, slot.columns)
    every = fitted(attribution)[0]
    u = attribution.bank.signature(attribution.columns, np.where(mine, every, 0.0)) ** 2
    parked = np.concatenate([np.arange(run.z.size) < run.parked.rows for run in evidence.runs])
    of_channel = np.bincount(evidence.rows.channel[parked], u[parked], minlength=len(CHANNELS))
    if of_channel.max() < LEAST_DRAWN:
        return None
    channel = int(of_channel.argmax())
    curves = []
    for r in range(len(diagnosis.views)):
        apart = r >= len(evidence.views)
        if not apart and float(u[evidence.rows_of(r)].sum()) < LEAST_ELSEWHERE * float(u.sum()):
            continue
        beta = fitted_without(attribution, r)[0] if by_run and not apart else every
        curves.append(_parked_curve(diagnosis, r, mine, beta, channel, held_out=apart or by_run))
    unit = "deg/h" if channel < 3 else "ug"
    return Overlay(CHANNELS[channel], unit, tuple(sorted(curves, key=lambda c: not c.held_out)))


def _evidence_of(diagnosis: Diagnosis, run: int) -> RunEvidence:
    """The run whitened as it was judged; a run held out under the same noise."""
    evidence = diagnosis.attribution.evidence
    if run < len(evidence.runs):
        return evidence.runs[run]
    return RunEvidence(
        diagnosis.views[run], diagnosis.twin, evidence.extra, known_trace(diagnosis, run)
    )


def _parked_curve(
    diagnosis: Diagnosis, run: int, mine: NDArray, beta: NDArray, channel: int, *, held_out: bool
) -> RunCurve:
    view, block = diagnosis.views[run], _evidence_of(diagnosis, run).parked
    units = unit_traces(diagnosis, run)
    traces = [
        summed(units, np.where(mine, beta, 0.0)),
        summed(units, np.where(mine, 0.0, beta)),
        known_trace(diagnosis, run),
    ]
    effect, rest, known = (block.of_traces([t])[:, :, 0] for t in traces)
    left = block.residual(view) - known - effect - rest
    phi = block.whiten(left[:, :, None])[1].mean[:3, 0]
    measured = (left + effect - (block.A @ phi)[:, None])[channel]
    curve = effect[channel]
    if np.std(curve) > VARIES * np.sqrt(np.mean(curve**2)):
        measured = measured - np.mean(measured - curve)
    unit = DEG_PER_HOUR if channel < 3 else MICRO_G
    time_min = (view.start_s + PARKED_MEAN_S * (np.arange(block.bins) + 0.5)) / 60.0
    t, seen, made = (_means(v) for v in (time_min, measured / unit, curve / unit))
    return RunCurve(view.name, t, seen, made, held_out)


def _means(values: NDArray) -> NDArray:
    """Over a minute; all of it where there is less."""
    n = values.size // MINUTE_BINS * MINUTE_BINS
    return values[:n].reshape(-1, MINUTE_BINS).mean(axis=1) if n else np.array([values.mean()])
