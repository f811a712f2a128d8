"""The key `simulator` of diagnosis.json, and the same in a few lines for people."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simreal.predict.measures import Deviation, Gap, Gone, gap_of, gone_of, nis_gone_of, nis_of
from simreal.predict.records import (
    EffectOnPredictionRecord,
    EffectQuantityRecord,
    GapValueRecord,
    GoneValueRecord,
    PredictedRunRecord,
    QuantityRecord,
    RunQuantityRecord,
    SimulatorRecord,
    UnpredictedRecord,
)

if TYPE_CHECKING:
    # with the estimators of updates behind it, which a diagnosis has no need of
    from simreal.predict.held_out import HeldOutRun, Key, Predicted, Simulator

Which = Callable[["HeldOutRun"], "Predicted"]


@dataclass(frozen=True)
class Quantity:
    """A quantity of the update: its deviation in a prediction (None: not shown), what a gap of it
    is, and how much of one is gone.
    """

    name: str
    unit: str
    of: Callable[["Predicted"], Deviation | None]
    gap: Callable[[Sequence[Deviation]], Gap] = gap_of
    gone: Callable[[Sequence[Deviation], Sequence[Deviation]], Gone] = gone_of


NIS = "nis"
QUANTITIES = (
    Quantity("drift", "NM/h", lambda p: p.drift),
    Quantity("heading", "mrad", lambda p: p.heading),
    Quantity(NIS, "1", lambda p: p.points, nis_of, nis_gone_of),
)


def simulator_record(simulator: "Simulator") -> SimulatorRecord:
    """The document of all predictions."""
    keys = dict.fromkeys(key for run in simulator.runs for key in (*run.found, *run.own))
    return SimulatorRecord(
        fits=len({run.fitted_to for run in simulator.runs}),
        quantities=tuple(_quantities(simulator.runs)),
        effects=tuple(_effect(simulator.runs, key) for key in keys),
        runs=tuple(_run(run) for run in simulator.runs),
        not_predicted=tuple(UnpredictedRecord(run_id=n, why=w) for n, w in simulator.unpredicted),
    )


def simulator_lines(record: SimulatorRecord) -> list[str]:
    """What a prediction of updates gains, in a few lines for people."""
    runs = len(record.runs)
    fits = f"{record.fits} fit{'s' * (record.fits != 1)}"
    lines = [f"  updates of {runs} run{'s' * (runs != 1)} predicted by {fits} to other runs:"]
    lines += [f"    {_quantity_line(q)}" for q in record.quantities]
    for e in record.effects:
        if e.predicted:
            said = ", ".join(
                f"{NAMES[q.quantity]} {share_text(q.alone_gone)}" for q in e.quantities
            )
            found = f"in {e.fits} of {record.fits} fits"
            lines.append(f"    {e.effect} on {e.target} ({found}) alone takes away: {said}")
        else:
            lines.append(f"    {e.effect} on {e.target}: of one run or no part of an update")
    lines += [f"    run {r.run_id} not predicted: {r.why}" for r in record.not_predicted]
    return lines


NAMES = {"drift": "drift", "heading": "heading", NIS: "NIS"}


def _quantity_line(q: QuantityRecord) -> str:
    before, after = interval_text(q.before), interval_text(q.after)
    if q.quantity == NIS:
        said = f"NIS {before} -> {after}, 1 where the twin is right"
    else:
        said = f"{q.quantity} off by {before} -> {after} {q.unit} beyond noise"
    return f"{said}; gone: {share_text(q.gone)}"


def interval_text(gap: GapValueRecord) -> str:
    """A gap of a prediction with its interval, two decimals."""
    low, high = gap.interval_95
    return f"{gap.value:.2f} ({low:.2f} to {high:.2f})"


def share_text(gone: GoneValueRecord) -> str:
    """The share that is gone with its interval; in words where the gap was too small for one."""
    low, high = gone.interval_95
    if low <= -1.0 and high >= 1.0:
        return "gap too small to tell"
    return f"{100 * gone.fraction:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)"


def _quantities(runs: Sequence["HeldOutRun"]) -> list[QuantityRecord]:
    out = []
    for quantity in QUANTITIES:
        before, after = _deviations(runs, quantity, _before, _after)
        if not before:
            continue
        gap = quantity.gap(before)
        out.append(
            QuantityRecord(
                quantity=quantity.name,
                unit=quantity.unit,
                runs=len(before),
                noise=gap.noise,
                before=_gap(gap),
                after=_gap(quantity.gap(after)),
                gone=_gone(quantity.gone(before, after)),
            )
        )
    return out


def _effect(runs: Sequence["HeldOutRun"], key: "Key") -> EffectOnPredictionRecord:
    def alone(run: "HeldOutRun") -> "Predicted":
        return run.alone.get(key, run.before)

    def without(run: "HeldOutRun") -> "Predicted":
        return run.without.get(key, run.after)

    quantities = []
    predicted = any(key in run.found for run in runs)
    for quantity in QUANTITIES if predicted else ():
        before, with_it = _deviations(runs, quantity, _before, alone)
        _, less = _deviations(runs, quantity, _before, without)
        if before and less:
            quantities.append(
                EffectQuantityRecord(
                    quantity=quantity.name,
                    unit=quantity.unit,
                    alone=_gap(quantity.gap(with_it)),
                    alone_gone=_gone(quantity.gone(before, with_it)),
                    without=_gap(quantity.gap(less)),
                )
            )
    found = {run.fitted_to for run in runs if key in (*run.found, *run.own)}
    return EffectOnPredictionRecord(
        effect=key[0],
        target=key[1],
        fits=len(found),
        predicted=predicted,
        quantities=tuple(quantities),
    )


def _before(run: "HeldOutRun") -> "Predicted":
    return run.before


def _after(run: "HeldOutRun") -> "Predicted":
    return run.after


def _deviations(
    runs: Sequence["HeldOutRun"], quantity: Quantity, first: Which, second: Which
) -> tuple[list[Deviation], list[Deviation]]:
    """Those of the runs that show the quantity both times, with as many values."""
    one, other = [], []
    for run in runs:
        a, b = quantity.of(first(run)), quantity.of(second(run))
        if a is not None and b is not None and a.value.size == b.value.size:
            one.append(a)
            other.append(b)
    return one, other


def _run(run: "HeldOutRun") -> PredictedRunRecord:
    return PredictedRunRecord(
        run_id=run.run_id,
        fitted_to=run.fitted_to,
        found=tuple(f"{effect} on {target}" for effect, target in run.found),
        quantities=tuple(
            _run_quantity(quantity, before, after)
            for quantity in QUANTITIES
            if (before := quantity.of(run.before)) is not None
            and (after := quantity.of(run.after)) is not None
        ),
    )


def _run_quantity(quantity: Quantity, before: Deviation, after: Deviation) -> RunQuantityRecord:
    if quantity.name == NIS:
        ratios = [nis_of([d]).measured for d in (before, after)]
        sigmas = [float(np.sqrt(2.0 / d.value.size)) for d in (before, after)]
        values, spread = [(r,) for r in ratios], [(s,) for s in sigmas]
    else:
        values = [tuple(d.value.tolist()) for d in (before, after)]
        spread = [tuple(np.sqrt(np.diag(d.covariance)).tolist()) for d in (before, after)]
    return RunQuantityRecord(
        quantity=quantity.name,
        unit=quantity.unit,
        before=values[0],
        after=values[1],
        sigma_before=spread[0],
        sigma_after=spread[1],
    )


def _gap(gap: Gap) -> GapValueRecord:
    return GapValueRecord(value=gap.value, interval_95=gap.interval_95, measured=gap.measured)


def _gone(gone: Gone) -> GoneValueRecord:
    return GoneValueRecord(fraction=gone.fraction, interval_95=gone.interval_95)
