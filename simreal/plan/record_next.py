"""What to record next: for each cause that the runs leave open, the recording that would tell it
from its rivals.
"""

from collections.abc import Sequence

from infield.table.thermal_table import ThermalTable
from ins.errors.base import SLOW_NAME
from ins.errors.table import TABLE_AGED
from simreal.inference.causes import LEAST_PROBABILITY, Cause, Rival
from simreal.inference.diagnosis import Diagnosis

MOST_CAUSES = 3  # each simulates a few recordings


def settling(diagnosis: Diagnosis, table: ThermalTable | None) -> list[list[str]]:
    """Advice in sentences for each cause; empty for one that stands alone and is seen to repeat.
    An aged table asks for an update, not for a recording.
    """
    effects = [c for c in diagnosis.causes if c.effect != TABLE_AGED]
    planned = [c for c in effects if c.named and _likely(c)][:MOST_CAUSES]
    once = len(diagnosis.attribution.evidence.views) == 1
    return [
        _settling(c, diagnosis, table, planned=c in planned, once=once) if c in effects else []
        for c in diagnosis.causes
    ]


def _settling(
    cause: Cause, diagnosis: Diagnosis, table: ThermalTable | None, *, planned: bool, once: bool
) -> list[str]:
    if not cause.named:
        return [_again(cause)]
    out = []
    if planned:
        from simreal.plan.advice import advice  # with the simulator: half a second of CPU

        names = [(cause.effect, cause.target), *((r.effect, r.target) for r in _likely(cause))]
        out += advice(names, diagnosis.attribution.plain_evidence, table)
    if once and cause.repeats == "R" and not cause.rivals:
        out.append(_repeats(cause))
    if cause.effect == SLOW_NAME and not _below_declared(cause):
        out.append(_slow(cause))
    return out


def record_next(diagnosis: Diagnosis, settled_by: Sequence[Sequence[str]]) -> list[str]:
    """What settles the causes (`settling`), and what is left; each sentence once."""
    out = [sentence for sentences in settled_by for sentence in sentences]
    if diagnosis.unexplained.present:
        out.append(
            "For what is left: a repeat under the same conditions, to see whether it comes again."
        )
    return list(dict.fromkeys(out))


def _likely(cause: Cause) -> list[Rival]:
    """The rivals that a recording may tell from it: none outside the catalogue."""
    return [r for r in cause.rivals if r.target and r.probability >= LEAST_PROBABILITY]


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
