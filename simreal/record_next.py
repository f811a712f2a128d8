"""What to record next: for each cause that the runs leave open, the recording that would tell it from its rivals."""

from infield.table import ThermalTable
from simreal.causes import Cause, Rival
from simreal.diagnosis import Diagnosis
from simreal.plan_advice import advice

MOST_CAUSES = 3  # each simulates a few recordings
LEAST_PROBABILITY = 0.01  # of a rival that is worth a recording


def record_next(diagnosis: Diagnosis, table: ThermalTable | None) -> list[str]:
    """Advice in sentences; empty where every cause stands alone and is seen to repeat."""
    out: list[str] = []
    open_causes = [(c, rivals) for c in diagnosis.causes if c.named and (rivals := _likely(c))]
    for cause, rivals in open_causes[:MOST_CAUSES]:
        names = [(cause.effect, cause.target), *((r.effect, r.target) for r in rivals)]
        out += advice(names, diagnosis.attribution.plain_evidence, table)
    out += [_again(c) for c in diagnosis.causes if not c.named]
    if len(diagnosis.attribution.evidence.views) == 1:
        out += [_repeats(c) for c in diagnosis.causes if c.named and c.class_ == "R" and not c.rivals]
    return list(dict.fromkeys(out))


def _likely(cause: Cause) -> list[Rival]:
    return [r for r in cause.rivals if r.probability >= LEAST_PROBABILITY]


def _again(cause: Cause) -> str:
    """For an answer without a name."""
    return (
        f"For {cause.effect} on {cause.target}: other starts (ambient, hot, cooling), to see whether it goes with temperature, "
        "its rate, time since power-on or the run."
    )


def _repeats(cause: Cause) -> str:
    return f"A second run with another start, to see whether {cause.effect} on {cause.target} repeats."
