"""What a diagnosis says, as members of enums: its verdict, how a shrink was judged, why a cause
stays out of the twin, which test sees what is left. Their values are the words of diagnosis.json.
"""

from enum import StrEnum


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


class KeptOut(StrEnum):
    """Why a found cause is not written into the twin."""

    NOT_SHOWN = "not_shown"  # a free function that lessens no gap of data not fitted to
    MADE_WORSE = "made_worse"  # more gap in data not fitted to
    OF_MOTION = "of_motion"  # an error of the motion without a name: nothing to simulate
    TABLE_AGED = "table_aged"  # it is what an update is to learn
    # of what an update takes out of its log
    IMPLAUSIBLE = "implausible"  # beyond the sizes that such an effect has
    NOT_UNIQUE = "not_unique"  # another answer of the set would leave another table


class Looks(StrEnum):
    """The tests of what is left, each by what it looks at; NOTHING where nothing is left."""

    NOTHING = ""
    CELLS = "cells"
    TEMPERATURE_BANDS = "temperature bands"
    TIME_WINDOWS = "time windows"
    BURST = "burst"
    KURTOSIS = "kurtosis"
    CROSS_CHANNEL = "cross-channel correlation"
