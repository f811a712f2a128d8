"""Why an aided solution is what it is, and what it took from the log, as codes.

Sentences: `infield.reports.words.aided`.
"""

from enum import StrEnum


class AidedVerdict(StrEnum):
    """REFUSED: nothing was flown. INCONSISTENT: flown, and not to be believed."""

    AIDED = "aided"
    INCONSISTENT = "inconsistent"
    REFUSED = "refused"


class AidedGrade(StrEnum):
    """How good a solution is; DEGRADED: in stretches that are named."""

    GOOD = "good"
    DEGRADED = "degraded"
    INCONSISTENT = "inconsistent"


class AidedWeakness(StrEnum):
    """Why a stretch of a solution is degraded."""

    START = "wide_start"
    HEADING = "heading_wide"
    OUTAGE = "outage"
    REJECTED = "fixes_rejected"
    LEAP = "positions_leap"
    BEGUN_ANEW = "begun_anew"
    RECEIVER = "receiver_unsure"


class StartMethod(StrEnum):
    """How an aided solution was begun: parked, in motion, or from headings all round; ALL_HEADINGS:
    none of them is known to be the vehicle's.
    """

    GYROCOMPASS = "gyrocompass"
    MATCHING = "velocity matching"
    HEADINGS = "several headings"
    SURVEYED = "surveyed heading"
    ALL_HEADINGS = "all headings"


class AidedReason(StrEnum):
    """Why nothing was flown, or what speaks against the solution."""

    NO_FIXES = "no_fixes"
    FEW_FIXES = "few_fixes"
    NO_VELOCITY_CHANGE = "no_velocity_change"
    HEADING_UNSURE = "heading_unsure"
    HEADINGS_DIFFER = "headings_differ"
    NIS_HIGH = "nis_high"
    MANY_REJECTED = "many_rejected"
    NOISE_UNBELIEVED = "noise_unbelieved"
    RECEIVER_CONTRADICTS = "receiver_contradicts"


class AidedNote(StrEnum):
    """What was taken from the log beyond what was declared, and what it contradicts."""

    HEADING_OPEN = "heading_open"
    WHEELS_TAKEN = "wheels_taken"
    NO_WHEELS = "no_wheels"
    USUAL_MOTION = "usual_motion"
    REPEATED_FIXES = "repeated_fixes"
    FIXES_WIDENED = "fixes_widened"
    FIXES_SAY = "fixes_say"
    SITE_ELSEWHERE = "site_elsewhere"
    OFF_THE_TRACK = "off_the_track"
    LEVER_ARM_TAKEN = "lever_arm_taken"
    DELAY_TAKEN = "delay_taken"
    NOISE_TAKEN = "noise_taken"
