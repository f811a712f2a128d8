"""A latitude that was entered wrong by so much that its effect is no longer in proportion to it.

The runs are then looked at again from the latitude that was found, and what the entered one does in
proportion is laid over: the coefficient that is fitted is still entered less true, and the second
order of half a degree (50 m of way north, 1 % of the Earth rate's change) is no longer left for
other effects to explain.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ins.errors.platform import ARCMIN, latitude_error
from ins.errors.telemetry import Trace, total
from ins.records import Run
from simreal.evidence.run_view import RunView
from simreal.inference.attribute import Attribution, Attributor
from simreal.inference.scoring import fit

WRONG_LATITUDE = "site_latitude_error"
# below, the second order is under a hundredth of a sigma: 50 m in proportion to the square, of
# 0.5 deg, over a fix of 1 m
IN_PROPORTION_RAD = 0.5 * ARCMIN


def entered_wrong_rad(attribution: Attribution | Attributor) -> float:
    """Entered less true latitude, where it was found to be beyond proportion; else 0."""
    columns = attribution.columns
    for slot in attribution.slots:
        if slot.hypothesis.name == WRONG_LATITUDE and slot.group is not None:
            beta, _ = fit(attribution.bank, columns)
            wrong = float(beta[np.isin(columns, slot.columns)][0]) * ARCMIN
            return wrong if abs(wrong) > IN_PROPORTION_RAD else 0.0
    return 0.0


def with_latitude_less(runs: Sequence[Run], wrong_rad: float) -> list[Run]:
    """The runs from the latitude that was found."""
    return [
        replace(
            run,
            header=replace(
                run.header,
                site=replace(run.header.site, lat_rad=run.header.site.lat_rad - wrong_rad),
            ),
        )
        for run in runs
    ]


def with_entered(known: Trace | None, view: RunView, wrong_rad: float) -> Trace | None:
    """What is known of a run, less what the entered latitude does in proportion to its error."""
    if not wrong_rad:
        return known
    (unit,) = latitude_error(view.telemetry, "site", {})
    laid_over = unit.scaled(-wrong_rad / ARCMIN)
    return laid_over if known is None else total((known, laid_over))
