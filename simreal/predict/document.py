"""The key `simulator` of diagnosis.json: how well a twin predicts updates, a field a key, and the
same in a few lines for people.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simreal.inference.addback import Gone
from simreal.inference.diagnosis import NotLookedAt
from simreal.predict.measures import Deviation, Gap, gap_of, gone_of, nis_gone_of, nis_of

if TYPE_CHECKING:
    # with the estimators of updates behind it, which a diagnosis has no need of
    from simreal.predict.held_out import HeldOutRun, Key, Predicted, Simulator


@dataclass(frozen=True, kw_only=True)
class PredictedQuantity:
    """A quantity of the update over all predicted runs, by the twin as it was and with what was
    found. noise: RMS that the twin expects of noise alone.
    """

    quantity: str
    unit: str
    runs: int
    noise: float
    before: Gap
    after: Gap
    gone: Gone


@dataclass(frozen=True, kw_only=True)
class EffectOnQuantity:
    """The gap of a quantity with this effect alone in the twin, and with all others but it."""

    quantity: str
    unit: str
    alone: Gap
    alone_gone: Gone
    without: Gap


@dataclass(frozen=True, kw_only=True)
class EffectOnPrediction:
    """An effect in the fits: how many found it, and what a prediction gains by it. predicted: False
    of what belongs to one run alone, or is no part of an update.
    """

    effect: str
    target: str
    fits: int
    predicted: bool
    quantities: tuple[EffectOnQuantity, ...]


@dataclass(frozen=True, kw_only=True)
class RunQuantity:
    """Measured less predicted in one run, and one sigma of it by noise; of the NIS the values per
    degree of freedom. The drift has two values, of gyros x and y.
    """

    quantity: str
    unit: str
    before: tuple[float, ...]
    after: tuple[float, ...]
    sigma_before: tuple[float, ...]
    sigma_after: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class PredictedRun:
    """A run, the runs that the twin was fitted to for it, and what was found in those."""

    run_id: str
    fitted_to: tuple[str, ...]
    found: tuple[str, ...]
    quantities: tuple[RunQuantity, ...]


@dataclass(frozen=True, kw_only=True)
class PredictedUpdates:
    """How well the twin predicts the update of runs that it was not fitted to."""

    fits: int
    quantities: tuple[PredictedQuantity, ...]
    effects: tuple[EffectOnPrediction, ...]
    runs: tuple[PredictedRun, ...]
    not_predicted: tuple[NotLookedAt, ...]


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


def simulator_record(simulator: "Simulator") -> PredictedUpdates:
    """The document of all predictions."""
    keys = dict.fromkeys(key for run in simulator.runs for key in (*run.found, *run.own))
    return PredictedUpdates(
        fits=len({run.fitted_to for run in simulator.runs}),
        quantities=tuple(_quantities(simulator.runs)),
        effects=tuple(_effect(simulator.runs, key) for key in keys),
        runs=tuple(_run(run) for run in simulator.runs),
        not_predicted=simulator.unpredicted,
    )


def simulator_lines(record: PredictedUpdates) -> list[str]:
    """What a prediction of updates gains, in a few lines for people."""
    runs = len(record.runs)
    lines = [f"  updates of {runs} run{'s' * (runs != 1)} predicted by fits to other runs:"]
    lines += [f"    {_quantity_line(q)}" for q in record.quantities]
    for e in record.effects:
        if e.predicted:
            said = ", ".join(
                f"{NAMES[q.quantity]} {share_text(q.alone_gone)}" for q in e.quantities
            )
            lines.append(f"    {e.effect} on {e.target} alone takes away: {said}")
        else:
            lines.append(f"    {e.effect} on {e.target}: of one run or no part of an update")
    lines += [f"    run {r.run_id} not predicted: {r.why}" for r in record.not_predicted]
    return lines


NAMES = {"drift": "drift", "heading": "heading", NIS: "NIS"}


def _quantity_line(q: PredictedQuantity) -> str:
    before, after = interval_text(q.before), interval_text(q.after)
    if q.quantity == NIS:
        said = f"NIS {before} -> {after}, 1 where the twin is right"
    else:
        said = f"{q.quantity} off by {before} -> {after} {q.unit} beyond noise"
    return f"{said}; gone: {share_text(q.gone)}"


def interval_text(gap: Gap) -> str:
    """A gap of a prediction with its interval, two decimals."""
    low, high = gap.interval_95
    return f"{gap.value:.2f} ({low:.2f} to {high:.2f})"


def share_text(gone: Gone) -> str:
    """The share that is gone with its interval; in words where the gap was too small for one."""
    low, high = gone.interval_95
    if low <= -1.0 and high >= 1.0:
        return "gap too small to tell"
    return f"{100 * gone.fraction:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)"


def _quantities(runs: Sequence["HeldOutRun"]) -> list[PredictedQuantity]:
    out = []
    for quantity in QUANTITIES:
        before, after = _deviations(runs, quantity, _before, _after)
        if not before:
            continue
        gap = quantity.gap(before)
        out.append(
            PredictedQuantity(
                quantity=quantity.name,
                unit=quantity.unit,
                runs=len(before),
                noise=gap.noise,
                before=gap,
                after=quantity.gap(after),
                gone=quantity.gone(before, after),
            )
        )
    return out


def _effect(runs: Sequence["HeldOutRun"], key: "Key") -> EffectOnPrediction:
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
                EffectOnQuantity(
                    quantity=quantity.name,
                    unit=quantity.unit,
                    alone=quantity.gap(with_it),
                    alone_gone=quantity.gone(before, with_it),
                    without=quantity.gap(less),
                )
            )
    found = {run.fitted_to for run in runs if key in (*run.found, *run.own)}
    return EffectOnPrediction(
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


def _run(run: "HeldOutRun") -> PredictedRun:
    return PredictedRun(
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


def _run_quantity(quantity: Quantity, before: Deviation, after: Deviation) -> RunQuantity:
    if quantity.name == NIS:
        ratios = [nis_of([d]).measured for d in (before, after)]
        sigmas = [float(np.sqrt(2.0 / d.value.size)) for d in (before, after)]
        values, spread = [(r,) for r in ratios], [(s,) for s in sigmas]
    else:
        values = [tuple(d.value.tolist()) for d in (before, after)]
        spread = [tuple(np.sqrt(np.diag(d.covariance)).tolist()) for d in (before, after)]
    return RunQuantity(
        quantity=quantity.name,
        unit=quantity.unit,
        before=values[0],
        after=values[1],
        sigma_before=spread[0],
        sigma_after=spread[1],
    )
