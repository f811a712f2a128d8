"""What the found effects add to the seconds of a run, one trace a fitted coefficient."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.errors.telemetry import Telemetry, Trace, total
from simreal.declared.twin_effects import parse_effects, twin_traces
from simreal.inference.addback import HeldOut
from simreal.inference.attribute import Attribution, Slot, columns_of
from simreal.inference.bank import Hypothesis
from simreal.inference.diagnosis import Diagnosis
from simreal.inference.scoring import fit

# share of an effect's information: below, it is not in those runs; of 12 sigma, the size of the
# blind trials, 0.4 sigma is left
LEAST_ELSEWHERE = 1e-3


def fitted(attribution: Attribution) -> tuple[NDArray, NDArray]:
    """Coefficients of all columns (p,) as fitted together, and their covariance."""
    if not attribution.columns.size:
        return np.zeros(0), np.zeros((0, 0))
    return fit(attribution.bank, attribution.columns)


def fitted_without(attribution: Attribution, run: int) -> tuple[NDArray, NDArray]:
    """Coefficients of all columns (p,) and their covariance, fitted on the other runs; as fitted on
    all where only this run has them.
    """
    bank, columns, evidence = attribution.bank, attribution.columns, attribution.evidence
    beta, covariance = (np.array(part) for part in fitted(attribution))
    rows = evidence.rows_of(run)
    own = bank.matrix(columns)[rows]
    gram = bank.gram[np.ix_(columns, columns)]
    rest = gram - own.T @ own
    seen = np.diag(rest) > LEAST_ELSEWHERE * np.diag(gram)
    score = bank.score[columns] - own.T @ evidence.z[rows] - rest[:, ~seen] @ beta[~seen]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(rest)[seen], 1e-300))
    scaled = rest[np.ix_(seen, seen)] * np.outer(scale, scale)
    inverse = np.linalg.pinv(scaled, rcond=1e-8, hermitian=True) * np.outer(scale, scale)
    beta[seen] = inverse @ score[seen]
    covariance[np.ix_(seen, seen)] = inverse
    return beta, covariance


def found_columns(attribution: Attribution) -> NDArray:
    """Which of the fitted columns (p,) belong to a found effect."""
    return np.isin(attribution.columns, columns_of(attribution.slots))


def unit_traces(diagnosis: Diagnosis, run: int) -> list[Trace]:
    """Of each fitted column in a run (a number among `diagnosis.views`); a run held out has no part
    in events of others.
    """
    attribution = diagnosis.attribution
    columns = attribution.columns.tolist()
    own: dict[int, Trace | None] = {}
    if run < len(attribution.evidence.views):
        own = {c: attribution.bank.traces_of(c, run) for c in columns}
    else:
        telemetry = diagnosis.views[run].telemetry
        for slot in attribution.every:
            own.update(zip(slot.columns.tolist(), _apart(attribution, slot, telemetry)))
    return [own.get(c) or Trace() for c in columns]


def summed(traces: Sequence[Trace], coefficients: NDArray) -> Trace:
    """The traces times their coefficients, together."""
    return total(trace.scaled(float(b)) for trace, b in zip(traces, coefficients))


def fitted_trace(diagnosis: Diagnosis, run: int) -> Trace:
    """What all found effects together add to the seconds of a run."""
    beta = np.where(found_columns(diagnosis.attribution), fitted(diagnosis.attribution)[0], 0.0)
    return summed(unit_traces(diagnosis, run), beta)


def known_trace(diagnosis: Diagnosis, run: int) -> Trace:
    """What the twin itself expects of the effects that it lists, where the diagnosis took it off
    the data.
    """
    known = diagnosis.attribution.evidence.known
    if run < len(known):
        return known[run] or Trace()
    if not any(k is not None for k in known):
        return Trace()
    view = diagnosis.views[run]
    return twin_traces(parse_effects(diagnosis.twin), view.telemetry, view.name)


def _apart(attribution: Attribution, slot: Slot, run: Telemetry) -> Sequence[Trace]:
    """Of a slot in a run that took no part: its columns' traces, none for what belongs to one
    run.
    """
    h = slot.hypothesis
    if slot.group is None or not isinstance(h, Hypothesis) or not HeldOut.judges(slot):
        return ()
    if h.effect is not None:
        return h.effect.traces(run, h.target, slot.group.shape)
    key = h.name, h.target, int(slot.group.shape["nodes"])
    return next(g for g in attribution.bank.generics if g.key == key).traces(run)
