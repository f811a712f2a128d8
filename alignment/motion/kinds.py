"""What a vehicle does, what disturbs it while it stands, and what a witness says of that."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import NDArray


class Kind(IntEnum):
    """What the vehicle does in an epoch. It stands up to DISTURBED; from ROLLING on nothing may be
    made of it as of a standing one, UNKNOWN (no witness speaks) included.
    """

    STILL = 0
    DISTURBED = 1
    ROLLING = 2
    AIRBORNE = 3
    UNKNOWN = 4


class Disturbance(StrEnum):
    """Why an epoch of a standing vehicle is left out."""

    MOTION = "motion"
    BUMP = "bump"
    LOADING = "loading"
    GUST = "gust"
    PUSH = "tug push"
    CLIPPING = "clipping"
    SHOCK = "shock"
    DROPOUT = "dropout"


class Witness(StrEnum):
    """Who sees a vehicle stand or move (formats.md, section 5: who saw a stop)."""

    ROWS = "imu"
    NAVIGATION = "navigation"
    GNSS = "gnss"
    WHEELS = "odometer"
    PHASES = "phases"


class Says(IntEnum):
    """What a witness says of an epoch or a stretch."""

    SILENT = 0
    STANDS = 1
    MOVES = 2


@dataclass(frozen=True)
class WitnessEvidence:
    """What one witness says of each epoch (k,), as codes of `Says`.

    seen (k,): a speed [m/s], of the inertial rows a rate of turn [rad/s]; NaN where it sees
    nothing; allowed: what a standing vehicle may show of it.
    """

    witness: Witness
    says: NDArray
    seen: NDArray
    allowed: float

    @property
    def strength(self) -> NDArray:
        """What is seen over what is allowed: above 1 it is movement, if it lasts."""
        return np.asarray(self.seen / self.allowed)


STILL, DISTURBED, ROLLING, AIRBORNE, UNKNOWN = Kind
