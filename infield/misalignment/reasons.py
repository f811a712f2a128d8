"""Why a study of azimuths is what it is, and what it cannot show: codes with the templates
of their sentences.
"""

from enum import StrEnum

from ins.verdicts import ReasonCode


class MisalignmentVerdict(StrEnum):
    """INCONSISTENT: fitted, and the azimuths contradict each other."""

    MEASURED = "measured"
    REFUSED = "refused"
    INCONSISTENT = "inconsistent"


class MisalignmentReason(ReasonCode):
    """Why nothing was fitted, or what contradicts the model."""

    AZIMUTHS_MISSING = (
        "azimuths_missing",
        "stops on {found} of the four azimuths, needed all, 90 deg apart: none near {missing_deg:,"
        " |.0f} deg; rank {rank} of 3",
    )
    STOP_OFF_ITS_PLACE = (
        "stop_off_its_place",
        "a stop is {off_deg:.2f} deg off its place on 0, 90, 180, 270 deg, needed within"
        " {needed_deg:g} deg; rank {rank} of 3",
    )
    NOTHING_GAINED = (
        "nothing_gained",
        "the best coupling has a sigma of {best_mrad:.3g} mrad, the prior is {prior_mrad:g} mrad:"
        " nothing is gained",
    )
    AZIMUTHS_CONTRADICT = (
        "azimuths_contradict",
        "the azimuths contradict each other: chi-square {chi2:.1f} of {dof} degrees of freedom, at"
        " most {limit:.1f} at 99.9 %; largest residual {residual_deg_h:+.4f} deg/h of gyro {axis}"
        " at stop {stop}",
    )
    NO_STOP = "no_stop", "no stop in the runs"
    AZIMUTHS_NOT_FOUND = (
        "azimuths_cannot_be_found",
        "gyro bias within {reach_deg_h:.3g} deg/h against {level_rate_deg_h:.3g} deg/h of level"
        " Earth rate: the azimuths cannot be found with these gyros",
        "give the headings of the stops",
    )
    HEADINGS_MISCOUNTED = "headings_miscounted", "{headings} headings for {stops} stops"
    HEADING_CONTRADICTED = (
        "heading_contradicted",
        "stop {stop} ({run_id}): heading given {given_rad:deg .2f} deg, the gyros say"
        " {seen_rad:deg .2f} deg: order of the runs, or azimuths counted from north to west?",
    )


class StopReason(ReasonCode):
    """Why a stretch of a run is no stop."""

    LEFT_OUT = "stretch_left_out", "{run_id}, {start_s:.0f} to {end_s:.0f} s: {why}"
    NO_STRETCH = (
        "no_stretch_between_turns",
        "{run_id}: no stretch of {needed_s:.0f} s between turns",
    )
    NEVER_RESTS = "never_rests", "never rests for a minute (a moving base?)"
    MOVES = "moves", "{witness}"
    CREEPS = "creeps", "turns by {turned_rad:deg .2f} deg while it stands"
    TOO_SHORT = "rest_too_short", "at rest for {used_s:.0f} s, needed {needed_s:.0f} s"


class MisalignmentNote(ReasonCode):
    """What holds beside any verdict."""

    NO_TEMPERATURE = (
        "run_without_temperature",
        "{run_id}: {shortage}; its stops may be at any temperature of the table",
    )
    TEMPERATURES_APART = (
        "temperatures_apart",
        "the gyros are up to {spread_degC:.1f} degC apart between stops: compared through the"
        " unit's table",
    )
    HEADINGS_TURNED = (
        "given_headings_share_an_error",
        "the headings given differ from the gyros' by {turned_rad:deg +.2f} deg in common,"
        " {times:.1f} times what the declared sigma and couplings of {prior_mrad:g} mrad allow:"
        " taken as a common heading error, so xy and yx cannot be separated (a larger --prior-mrad"
        " allows for a triad that is turned in its case)",
    )
    HEADINGS_SCATTER = (
        "given_headings_scatter",
        "the gyros show errors of {sigma_rad:arcsec .0f} arcsec (1 sigma) in the heading of each"
        " stop beyond the declared ones: the sigmas allow for it",
    )


class Azimuths(ReasonCode):
    """Where the azimuths come from."""

    FOUND = (
        "found_with_the_gyros",
        "found with the gyros: north unknown, one heading a run, turns within a run by the"
        " vertical gyro",
    )
    GIVEN = (
        "given",
        "given: each stop within {sigma_stop_rad:arcsec g} arcsec, their common north within"
        " {sigma_north_rad:deg .3g} deg (1 sigma)",
    )
    OF_TABLE = (
        "of_the_table",
        "as in the table, {exact:without error|their common north within {sigma_heading_rad:deg"
        " .3g} deg (1 sigma)}",
    )


class Unseen(ReasonCode):
    """Why something is not observable."""

    VERTICAL = (
        "vertical_coupling_is_a_bias",
        "at one attitude and latitude a coupling of the vertical rate is a constant bias: it stays"
        " in the table",
        "tilt the unit to see it",
    )
    NORTH = (
        "north_is_free",
        "a turn of both level gyros about the vertical looks like a heading error:",
        "give headings (--heading-deg) from a line outside",
    )
    DIAGONAL = (
        "needs_diagonal_headings",
        "without given azimuths xy + yx is observable only off the cardinal headings:",
        "stand on 45, 135, 225, 315 deg",
    )
    WEAK = (
        "sigma_near_the_prior",
        "too noisy: its sigma is close to that of the prior",
        "stay longer at each stop, or make the stops in one power-on",
    )
    MOUNTING = (
        "mounting_unknown",
        "a tilt of the unit's base against the turning axis has the same effect",
        "give --sigma-mounting-arcsec to state a bias",
    )
    NO_ACCELEROMETERS = "table_without_accelerometers", "a table of biases has no accelerometers"
    NOT_FITTED = "nothing_fitted", "nothing was fitted"
    OFFSET_OR_TILT = "offset_not_told_from_tilt", "these headings do not separate offset from tilt"
    GROUND_DIFFERS = (
        "ground_differs",
        "the tilt of the ground differed from stop to stop: chi-square {chi2:.0f} of {dof} degrees"
        " of freedom",
        "turn the unit in one place",
    )
