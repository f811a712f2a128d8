"""The options of `recal table`."""

from collections.abc import Callable
from functools import partial

from recal.cli.parameters.shared import option
from recal.cli.parameters.verbs import Made, made_from
from recal.cli.terminal.help import METHOD

REVISIONS = "NUMBER|factory|previous|active"
OF_TABLE = (
    option(
        "serial",
        str | None,
        None,
        help="Serial number of the unit. Needed where the store holds several.",
    ),
    option(
        "technology",
        str | None,
        None,
        metavar="rlg|fog|mems",
        help="Technology of the unit's gyros. Needed where neither store nor file tells it.",
    ),
    option(
        "mode", str | None, None, help="Gyro mode of the unit. Needed where the unit has several."
    ),
    option("note", str, "", help="A note kept with the revision."),
    option("revision", str, "active", metavar=REVISIONS, help="Which revision of the table."),
    option(
        "by",
        str | None,
        None,
        help="Who decides. Default: the operator of your config.toml, else your login name.",
    ),
    option(
        "imu",
        int | None,
        None,
        min=0,
        rich_help_panel=METHOD,
        help="Number of the IMU in an autopilot's parameter names.",
    ),
)
of_table: Callable[..., Callable[..., Made]] = partial(made_from, "", "", *OF_TABLE)
