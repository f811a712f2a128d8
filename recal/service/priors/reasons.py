"""Why nothing was learnt or forecast from a store's sessions: codes with the templates of their
sentences.
"""

from ins.verdicts import ReasonCode


class NothingKept(ReasonCode):
    """What a store lacks that priors are learnt from."""

    NO_UNIT = "no_unit", "no unit{of} with a table:", "recal table list names its units"
    NO_SESSION = (
        "no_session",
        "{units:its one unit|{units} units}{of} {units:has|have} no session that can be learnt"
        " from{unread: ({left_out} cannot be read)|}:",
        "recal update --commit keeps sessions",
    )


class PriorsReason(ReasonCode):
    """Why nothing was learnt, or what could not be."""

    NO_SESSIONS = "no_sessions", "store {store}: {lacks}"
    FEW_SESSIONS = (
        "few_sessions",
        "{sessions} sessions do not show {hidden:, |}: there the default stands",
    )
    ONE_UNIT = (
        "one_unit",
        "one unit: the values of the technology are this unit's, widened by the assumed spread from"
        " unit to unit",
    )
    NOT_SETTLED = (
        "not_settled",
        "the search did not converge: use the defaults; more sessions would help",
    )


class ForecastReason(ReasonCode):
    """Why no drift was foretold."""

    FINDS_NO_HEADING = (
        "finds_no_heading",
        "gyros that find no heading do not navigate free-inertially",
    )
    NONE_NAVIGATES = "none_navigates", "store {store}: no unit{of} that navigates free-inertially"
    NO_UNIT = (
        "no_unit",
        "store {store}: no unit{of} with a table:",
        "recal table import brings the first",
    )
