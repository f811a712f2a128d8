"""What to record next: for each cause that the runs leave open, the recording that would tell it from its rivals."""

from simreal.causes import Cause
from simreal.diagnosis import Diagnosis
from simreal.plan_pairs import INSEPARABLE

MOST_RIVALS = 3
NEVER = {  # names in the catalogue that stand for the pairs of gap.md that no parked recording separates
    frozenset(("gyro_turn_on_bias", "platform_yaw_creep")): 3,
    frozenset(("vertical_deflection", "accel_misalignment")): 1,
    frozenset(("vertical_deflection", "accel_scale_factor")): 1,
    frozenset(("platform_settling", "platform_mount_sag")): 2,
}


def record_next(diagnosis: Diagnosis) -> list[str]:
    """Advice in sentences, empty where every cause stands alone."""
    out = []
    for cause in diagnosis.causes:
        if cause.rivals:
            out += _apart(cause)
        elif cause.shrink is not None and not cause.shrink.held_out:
            out.append(f"A second run like this one, to see whether {cause.effect} on {cause.target} repeats.")
    return list(dict.fromkeys(out))


def _apart(cause: Cause) -> list[str]:
    names = [r.effect for r in cause.rivals if not r.effect.startswith("unknown")][:MOST_RIVALS]
    for name in names:
        number = NEVER.get(frozenset((cause.effect, name)))
        if number is not None:
            return [f"No parked recording tells {cause.effect} from {name}: {INSEPARABLE[number][2]}."]
    if not names:
        return []
    pairs = " ".join(f"--separate {cause.effect}@{cause.target},{name}" for name in names)
    return [
        f"To tell {cause.effect} on {cause.target} from {', '.join(names)}: recal plan RUN... {pairs} says which recording."
    ]
