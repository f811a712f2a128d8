"""What to record next: one plain sentence a rival, for the report of a diagnosis that could not
choose.
"""

from collections.abc import Sequence

import numpy as np

from infield.table.thermal_table import ThermalTable
from ins.records import InputError, Site, TwinModel
from ins.units import DEG
from simreal.evidence.whitened import Evidence
from simreal.plan.gram import RunGrams
from simreal.plan.pairs import Pair, PairAssessment, contender
from simreal.plan.recordings import RecordingMaker, short_list
from simreal.plan.study import EQUAL_GAIN, Plan, Planner

MOST_PAIRS = 4
LEAST_PAIR_GAIN = 0.02  # of a pair's score; chosen: 2 %, less than EQUAL_GAIN
_LAST: list[RecordingMaker] = []


def advice(
    confounded: Sequence[tuple[str, str]],
    evidence: Evidence,
    table: ThermalTable | None = None,
    *,
    without: Sequence[str] = (),
) -> list[str]:
    """Sentences that say which recording tells the first of a credible set from the others.

    confounded : (effect name, target), most probable first; free functions and noise have no
    signature and are passed over. evidence : the runs of the diagnosis. table : the twin's. Empty
    where there is nothing to tell apart.
    """
    pairs = _pairs(confounded)
    if not pairs:
        return []
    last = evidence.views[-1]
    heading_deg = (
        round(float(np.median(last.telemetry.heading_rad[last.telemetry.parked])) / DEG) % 360.0
    )
    planner = Planner(pairs, _maker(evidence.twin, table, last.run.header.site))
    planner.given = [
        RunGrams.of_evidence(evidence.alone(k), planner.contenders)
        for k in range(len(evidence.views))
    ]
    now = planner.plan((), "now")
    plans = planner.best_next(now, short_list(heading_deg, without))
    return [_sentence(k, now.judged[k], plans) for k in range(len(pairs))]


def _pairs(confounded: Sequence[tuple[str, str]]) -> list[Pair]:
    found = []
    for name, target in confounded:
        try:
            found.append(contender(f"{name}@{target}"))
        except InputError:  # a free function, noise, or an effect that is not in the catalogue
            continue
    unique = list({e.key: e for e in found}.values())
    return [Pair(unique[0], other) for other in unique[1 : MOST_PAIRS + 1]] if unique else []


def _maker(twin: TwinModel, table: ThermalTable | None, site: Site) -> RecordingMaker:
    """One for the causes of one diagnosis: its recordings are simulated once."""
    for maker in _LAST:
        if maker.twin == twin and maker.site == site and maker.table is table:
            return maker
    _LAST[:] = [RecordingMaker(twin, table, site)]
    return _LAST[0]


def _sentence(k: int, now: PairAssessment, plans: Sequence[Plan]) -> str:
    pair = now.pair
    names = f"{pair.a.label} from {pair.b.label}"
    if pair.a.target == pair.b.target:
        names = f"{pair.a.effect.name} from {pair.b.effect.name} (on {pair.a.target})"
    if not plans:
        return f"No recording of the short list separates {names}."
    top = max(p.judged[k].score for p in plans)
    gain = max(top - now.score, 0.0)  # shapes are sought anew: it may fall by a thousandth
    near = [p for p in plans if top - p.judged[k].score <= EQUAL_GAIN * gain]
    best = min(near, key=lambda p: p.recordings[-1].cost_hours)
    then = best.judged[k]
    if then.lacks:
        return f"To separate {names}, record {then.lacks}; none of the usual recordings has it."
    if then.score <= now.score + LEAST_PAIR_GAIN:
        return (
            f"No usual recording separates {names} better than these runs: similarity"
            f" {then.cos:.2f} (1: identical)."
        )
    was = "; these runs do not show it" if now.lacks else f" instead of {_times(now)}"
    return (
        f"To separate {names}, record {best.recordings[-1].words}: separable above {_times(then)}"
        f" the usual size{was}."
    )


def _times(judged: PairAssessment) -> str:
    """The size needed over the usual one (geometric mean of its range)."""
    return f"{1.0 / judged.margin:.2g} times" if judged.margin > 0.01 else "more than 100 times"
