"""What a found effect looks like in the runs: the residual of its main channel with the fitted effect, run by run.

Where the effect repeats and there are several runs, the curve of a run has the coefficients of the *other* runs, so what
is seen is a forecast.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.units import DEG_PER_HOUR, MICRO_G
from simreal.attribute import Attribution
from simreal.causes import shares_of
from simreal.diagnosis import Diagnosis
from simreal.evidence import CHANNELS
from simreal.parked import BIN_S
from simreal.scoring import fit
from simreal.telemetry import Trace, total

MINUTE_BINS = 6
VARIES = 0.2  # of its RMS: an effect whose scatter within a run is larger is no constant of that run
BY_RUN = "leave one run out"


@dataclass(frozen=True)
class RunCurve:
    """One run: time_min (n,), measured (n,) and effect (n,) in the overlay's unit. held_out: fitted on the other runs."""

    run_id: str
    time_min: NDArray
    measured: NDArray
    effect: NDArray
    held_out: bool


@dataclass(frozen=True)
class Overlay:
    """A cause along the runs. unit "deg/h" or "ug": one-minute means of a parked channel, less the attitude, the constant

    of the run (not where the effect is one itself) and the other effects. unit "": evidence summed along the run, what the
    matched filter gives (measured) and what it gives if the effect is as fitted (effect).
    """

    channel: str
    unit: str
    curves: tuple[RunCurve, ...]


def slot_order(diagnosis: Diagnosis) -> list[int]:
    """The attribution's slot behind each of the diagnosis's causes."""
    slots = diagnosis.attribution.slots
    p = [shares_of(diagnosis.attribution, s).get((s.hypothesis.name, s.hypothesis.target), 0.0) for s in slots]
    return [int(k) for k in np.argsort([-v for v in p], kind="stable")]


def overlays(diagnosis: Diagnosis) -> tuple[Overlay | None, ...]:
    """One for each cause, None for noise."""
    return tuple(_overlay(diagnosis, k, cause.shrink) for k, cause in zip(slot_order(diagnosis), diagnosis.causes))


def trace_in_run(attribution: Attribution, columns: NDArray, beta: NDArray, run: int) -> Trace:
    """What a combination of the bank's columns adds to a run's seconds."""
    parts = [(b, attribution.bank.traces_of(int(c), run)) for c, b in zip(columns, beta)]
    return total(trace.scaled(float(b)) for b, trace in parts if trace is not None)


def fitted_trace(diagnosis: Diagnosis, run: int) -> Trace:
    """What all found effects together add to a run's seconds."""
    attribution = diagnosis.attribution
    columns = attribution.columns
    return trace_in_run(attribution, columns, _fit(attribution), run)


def coefficients_without(attribution: Attribution, run: int) -> NDArray:
    """Coefficients of all slots' columns fitted on the other runs; as fitted on all where only this run has them."""
    bank, columns, evidence = attribution.bank, attribution.columns, attribution.evidence
    present, A = bank.blocks[run]
    place = {int(c): j for j, c in enumerate(present)}
    own = np.zeros((A.shape[0], columns.size))
    for j, c in enumerate(columns):
        if int(c) in place:
            own[:, j] = A[:, place[int(c)]]
    gram = bank.gram[np.ix_(columns, columns)]
    rest = gram - own.T @ own
    score = bank.score[columns] - own.T @ evidence.z[evidence.rows_of(run)]
    seen = np.diag(rest) > 1e-3 * np.diag(gram)
    beta = _fit(attribution).copy()
    score = score - rest[:, ~seen] @ beta[~seen]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(rest)[seen], 1e-300))
    scaled = rest[np.ix_(seen, seen)] * np.outer(scale, scale)
    beta[seen] = scale * (np.linalg.pinv(scaled, rcond=1e-8, hermitian=True) @ (scale * score[seen]))
    return beta


def _fit(attribution: Attribution) -> NDArray:
    columns = attribution.columns
    return np.asarray(fit(attribution.bank, columns)[0]) if columns.size else np.zeros(0)


def _overlay(diagnosis: Diagnosis, number: int, shrink: object) -> Overlay | None:
    attribution = diagnosis.attribution
    slot, evidence = attribution.slots[number], attribution.evidence
    if slot.group is None:
        return None
    held = len(evidence.runs) > 1 and getattr(shrink, "how", "") == BY_RUN
    mine = np.isin(attribution.columns, slot.columns)
    u = attribution.bank.signature(attribution.columns, np.where(mine, _fit(attribution), 0.0)) ** 2
    parked = np.zeros(u.size, bool)
    for r, run in enumerate(evidence.runs):
        first = int(evidence.offsets[r])
        parked[first : first + run.parked.rows] = True
    on_sensors = float(u[parked].sum()) > 0.5 * float(u.sum())
    rows = parked if on_sensors else ~parked
    energy = np.bincount(evidence.rows.channel[rows], u[rows], minlength=len(CHANNELS))
    channel = int(energy.argmax())
    runs = [r for r in range(len(evidence.runs)) if float(u[evidence.rows_of(r)].sum()) > 1e-6 * float(u.sum())]
    curves = []
    for r in runs:
        beta = coefficients_without(attribution, r) if held else _fit(attribution)
        make = _parked_curve if on_sensors else _evidence_curve
        curves.append(make(attribution, mine, beta, r, channel, held))
    unit = ("deg/h" if channel < 3 else "ug") if on_sensors else ""
    return Overlay(CHANNELS[channel], unit, tuple(curves))


def _parked_curve(attribution: Attribution, mine: NDArray, beta: NDArray, run: int, channel: int, held: bool) -> RunCurve:
    evidence, columns = attribution.evidence, attribution.columns
    view, block = evidence.views[run], evidence.runs[run].parked
    own = trace_in_run(attribution, columns[mine], beta[mine], run)
    others = trace_in_run(attribution, columns[~mine], beta[~mine], run)
    effect, rest = (block.of_traces([t])[:, :, 0] for t in (own, others))
    left = block.residual(view) - effect - rest
    phi = block.whiten(left[:, :, None])[1].mean[:3, 0]
    measured = (left + effect - (block.A @ phi)[:, None])[channel]
    curve = effect[channel]
    if np.std(curve) > VARIES * np.sqrt(np.mean(curve**2)):
        measured = measured - np.mean(measured - curve)
    unit = DEG_PER_HOUR if channel < 3 else MICRO_G
    time_min = (view.start_s + BIN_S * (np.arange(block.bins) + 0.5)) / 60.0
    t, seen, made = (_means(v) for v in (time_min, measured / unit, curve / unit))
    return RunCurve(view.name, t, seen, made, held)


def _means(values: NDArray) -> NDArray:
    """Over a minute; all of it where there is less."""
    n = values.size // MINUTE_BINS * MINUTE_BINS
    return values[:n].reshape(-1, MINUTE_BINS).mean(axis=1) if n else np.array([values.mean()])


def _evidence_curve(attribution: Attribution, mine: NDArray, beta: NDArray, run: int, channel: int, held: bool) -> RunCurve:
    evidence, bank, columns = attribution.evidence, attribution.bank, attribution.columns
    own = evidence.rows_of(run)
    d = bank.signature(columns[mine], beta[mine])[own]
    z = evidence.z[own] - bank.signature(columns[~mine], beta[~mine])[own]
    time_s = evidence.rows.time_s[own]
    order = np.argsort(time_s, kind="stable")
    measured, effect = np.cumsum((d * z)[order]), np.cumsum((d**2)[order])
    return RunCurve(evidence.views[run].name, time_s[order] / 60.0, measured, effect, held)
