"""What a diagnosis says, as members of enums: its verdict, how a shrink was judged, why a cause
stays out of the twin, which test sees what is left. Their values are the words of diagnosis.json.
"""

from enum import StrEnum

from ins.verdicts import ReasonCode


class GapVerdict(StrEnum):
    """Whether simulator and logs agree, and whether effects of the catalogue explain where not."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    PARTLY_EXPLAINED = "partly_explained"
    UNEXPLAINED = "unexplained"
    REFUSED = "refused"


class Judging(StrEnum):
    """The data that a shrink was measured on."""

    BY_RUN = "leave one run out"
    HALF_MINUTES = "alternate half-minutes"
    HALVES = "first half and second half"
    APART = "runs held out"
    SAME_RUN = "the same run"
    SAME_RUN_LESS_FIT = "the same run, less the fit"


ANOTHER_RUN = "Diagnose with a run more, at other temperatures."


class KeptOut(ReasonCode):
    """Why a found cause is not written into the twin, and what would settle it."""

    NOT_SHOWN = (
        "not_shown",
        "a free function must lessen the gap of data that it was not fitted to, and these runs do"
        " not show that it does",
        ANOTHER_RUN,
    )
    MADE_WORSE = (
        "made_worse",
        "it makes the gap of data that it was not fitted to larger",
        ANOTHER_RUN,
    )
    OF_MOTION = (
        "of_motion",
        "an error of the motion without a name is nothing that can be simulated",
        "Record the drive again with a receiver and wheels.",
    )
    TABLE_AGED = "table_aged", "an update learns it; taken out of the log, it would be lost"
    IMPLAUSIBLE = (
        "implausible",
        "it is larger than such an effect is, so that something else may only look like it",
        "Look for it by itself, or for what else makes it.",
    )
    NOT_UNIQUE = (
        "not_unique",
        "another answer would leave another table, and an update would take it out of the log",
        "Let recal update learn the table and diagnose later runs: what is left then is no ageing.",
    )


class Looks(StrEnum):
    """The tests of what is left, each by what it looks at; NOTHING where nothing is left."""

    NOTHING = ""
    CELLS = "cells"
    TEMPERATURE_BANDS = "temperature bands"
    TIME_WINDOWS = "time windows"
    BURST = "burst"
    KURTOSIS = "kurtosis"
    CROSS_CHANNEL = "cross-channel correlation"
