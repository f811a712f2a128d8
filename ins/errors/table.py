"""Errors of a unit's thermal table, which estimators carry and a diagnosis weighs by the covariance
of the table itself (effects.md 3.4).
"""

from ins.errors.base import GYROS, Words, error
from ins.errors.prior import Prior

TABLE_AGED = "table_aged"
TABLE_ERROR = error(
    "T01",
    "table_error",
    GYROS,
    diagnosed=False,
    source="An error of its own at each temperature; formats.md, section 2.",
    priors=(
        Prior(
            "session",
            "deg/h",
            {"rlg": 0.01, "fog": 0.05, "mems": 30.0},
            source="a unit as it leaves the factory, whose table says no sigmas",
        ),
        Prior(
            "raw",
            "deg/h",
            {"rlg": 0.1, "fog": 0.3, "mems": 30.0},
            source="three times the RMS of factory curves (0.03 and 0.1 deg/h), as a unit may be of"
            " a poorer grade; checked on raw biases drawn at random",
        ),
    ),
    words=Words(
        what="The gyro's bias is not what its table says at a temperature.",
        brought_on_by="Each session; it is the same in all of them.",
        size="The table's own sigma says it; a unit without a table has its raw bias.",
        remedy="Run `recal update`.",
    ),
)
# Of a gyro's bias [deg/h], one sigma, where no table says it.
DEFAULT_SIGMA_deg_h = TABLE_ERROR.prior("session").each()
RAW_BIAS_DEG_H = TABLE_ERROR.prior("raw").each()
OUTLIER = error(
    "T03",
    "session_outlier",
    GYROS,
    source="A session that shifts all its biases of a gyro.",
    diagnosed=False,
    priors=(
        Prior(
            "learning",
            "1",
            0.02,
            part="share",
            source="of sessions that the gates let pass (docs/reliability.md)",
        ),
        Prior(
            "learning",
            "of the table's sigma",
            5.0,
            part="size",
            source="0.05 deg/h of ring lasers, the step of requirement R16",
        ),
    ),
    words=Words(
        what="One session says something else than all others of its unit.",
        brought_on_by="A wrong site, a shock, a repair, the log of another unit.",
        size="Five times the sigma of a unit without a table.",
        remedy="Look at the session's report; leave it out.",
    ),
)
OF_THE_MONTE_CARLO = "0.006 and 0.004 of 0.01 deg/h (the Monte Carlo of physics.md 6.8)"
TABLE_ERRORS = (
    TABLE_ERROR,
    OUTLIER,
    error(
        "T02",
        TABLE_AGED,
        GYROS,
        diagnosed=False,
        source="A common shift and a smooth shape that walk; physics.md 6.8.",
        priors=tuple(
            Prior(
                "learning",
                "of the table's sigma, per sqrt(year)",
                share,
                part=part,
                walks=True,
                source=OF_THE_MONTE_CARLO,
            )
            for part, share in (("common", 0.6), ("shape", 0.4))
        ),
        words=Words(
            what="The gyro's bias has left its table, as far as the table's own sigma lets it.",
            brought_on_by="Time since the table was made; it is the same in every session.",
            size="A ring laser drifts by about 0.007 deg/h in a year; the table's sigma says it.",
            remedy="Renew the table: `recal update` with these runs.",
        ),
    ),
)
