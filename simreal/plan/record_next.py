"""What to record next: for each cause that the runs leave open, the recording that would tell it
from its rivals.
"""

from infield.table.thermal_table import ThermalTable
from simreal.effects.base import SLOW_NAME
from simreal.inference.causes import LEAST_PROBABILITY, Cause, Rival
from simreal.inference.diagnosis import Diagnosis

MOST_CAUSES = 3  # each simulates a few recordings


def record_next(diagnosis: Diagnosis, table: ThermalTable | None) -> list[str]:
    """Advice in sentences; empty where every cause stands alone and is seen to repeat."""
    out: list[str] = []
    open_causes = [(c, rivals) for c in diagnosis.causes if c.named and (rivals := _likely(c))]
    if open_causes:
        from simreal.plan.advice import advice  # with the simulator: half a second of CPU
    for cause, rivals in open_causes[:MOST_CAUSES]:
        names = [(cause.effect, cause.target), *((r.effect, r.target) for r in rivals)]
        out += advice(names, diagnosis.attribution.plain_evidence, table)
    out += [_again(c) for c in diagnosis.causes if not c.named]
    if len(diagnosis.attribution.evidence.views) == 1:
        out += [
            _repeats(c) for c in diagnosis.causes if c.named and c.class_ == "R" and not c.rivals
        ]
    out += [_slow(c) for c in diagnosis.causes if c.effect == SLOW_NAME and not _below_declared(c)]
    if diagnosis.left_present:
        out.append(
            "For what is left: a repeat under the same conditions, to see whether it comes again."
        )
    return list(dict.fromkeys(out))


def _likely(cause: Cause) -> list[Rival]:
    return [r for r in cause.rivals if r.probability >= LEAST_PROBABILITY]


def _again(cause: Cause) -> str:
    """For an answer without a name."""
    return (
        f"For {cause.effect} on {cause.target}: other starts (ambient, hot, cooling), to see"
        " whether it goes with temperature, its rate, time since power-on or the run."
    )


def _slow(cause: Cause) -> str:
    return (
        f"For the slow variation on {cause.target}: three hours or more at a steady temperature,"
        " with all the housekeeping there is, to see what it follows."
    )


def _below_declared(cause: Cause) -> bool:
    return any(p.value < 0 for p in cause.parameters.values())


def _repeats(cause: Cause) -> str:
    return (
        f"A second run with another start, to see whether {cause.effect} on {cause.target} repeats."
    )
