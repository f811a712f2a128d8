"""Names and strengths of environments, as a scenario file and the command line give them."""

from dataclasses import dataclass
from enum import StrEnum

from ins.records import InputError

MAX_STRENGTH = 10.0  # refuelling tilts by 1 deg at it, where the gear's springs are still linear


class EnvironmentKind(StrEnum):
    """What happens around the parked vehicle."""

    CALM = "calm"
    GUSTY = "gusty"
    BOARDING = "boarding"
    REFUELLING = "refuelling"
    LOADING = "loading"
    ENGINES = "engines"
    GPU = "gpu"
    MAINTENANCE = "maintenance"
    SHIP = "ship"


@dataclass(frozen=True, kw_only=True)
class Environment:
    """One environment; every motion that it makes is proportional to `strength` (1: the usual)."""

    kind: str
    strength: float = 1.0

    def __post_init__(self) -> None:
        known = [kind.value for kind in EnvironmentKind]
        if self.kind not in known:
            raise InputError(f"kind: got {self.kind[:60]!r}, needed one of {', '.join(known)}")
        if not 0.0 < self.strength <= MAX_STRENGTH:
            raise InputError(
                f"strength: got {self.strength:g}, needed more than 0 and at most {MAX_STRENGTH:g}"
            )


def environment_of(text: str) -> Environment:
    """The environment that KIND or KIND:STRENGTH names.

    Raises InputError naming what was got and what was needed.
    """
    kind, colon, strength = text.partition(":")
    try:
        size = float(strength) if colon else 1.0
    except ValueError:
        raise InputError(
            f"environment {text[:60]!r}: strength: got {strength[:60]!r}, needed a number"
        ) from None
    try:
        return Environment(kind=kind, strength=size)
    except InputError as error:
        raise InputError(f"environment {text[:60]!r}: {error}") from None
