"""What a vehicle does, and what disturbs it while it stands."""

from enum import IntEnum, StrEnum


class Kind(IntEnum):
    """What the vehicle does in an epoch; what is larger moves more."""

    STILL = 0
    DISTURBED = 1
    ROLLING = 2
    AIRBORNE = 3


class Cause(StrEnum):
    """Why an epoch of a standing vehicle is left out."""

    MOTION = "motion"
    BUMP = "bump"
    LOADING = "loading"
    GUST = "gust"
    PUSH = "tug push"
    CLIPPING = "clipping"
    SHOCK = "shock"
    DROPOUT = "dropout"


STILL, DISTURBED, ROLLING, AIRBORNE = Kind
