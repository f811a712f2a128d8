"""Whether the noise model fits the runs that it is used on: what `update`, `align` and `diagnose`
say of it in one line. The rest is what they found already; eight minutes of rows are read again.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from infield.reports.documents.alignment import NoiseFit
from infield.session.log import find_rest
from infield.table.thermal_table import ThermalTable
from ins.records import Run, TwinModel
from recal.service.inputs.records import AnyRun, twin_fit_command
from simreal.report.twin_check_document import agreement_line
from simreal.twin.fit.agreement import Agreement, agreement
from simreal.twin.fit.streams import stream_at_rest

if TYPE_CHECKING:
    from infield.session.results import UpdateResult  # the estimators of updates behind it


def update_agreement(result: "UpdateResult") -> Agreement | None:
    """The noise model against the rest that the sessions of an update found; None where that is too
    little.
    """
    streams = []
    for session in result.sessions:
        if session.estimate is None:
            continue
        motion = session.estimate.motion
        stream = stream_at_rest(
            session.run, result.twin, result.before, motion=motion, temperature=session.temperature
        )
        if stream is not None:
            streams.append(stream)
    return agreement(streams, result.twin) if streams else None


def fit_at_rest(
    run: Run, twin: TwinModel, table: ThermalTable | None, given: Sequence[AnyRun]
) -> NoiseFit | None:
    """The noise model against the first rest of a run."""
    rest = find_rest(run)
    stream = None if rest is None else stream_at_rest(run, twin, table, rest=rest)
    return noise_fit(None if stream is None else agreement([stream], twin), given)


def noise_fit(found: Agreement | None, given: Sequence[AnyRun]) -> NoiseFit | None:
    """What a document says of an agreement; given: the runs, for the command."""
    if found is None:
        return None
    text = agreement_line(found, twin_fit_command(given))
    return NoiseFit(fits=found.fits, p_value=found.p_value, text=text)
