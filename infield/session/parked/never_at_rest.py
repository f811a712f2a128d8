"""A session of a unit that finds no heading and never stands for a minute: what it is before its
ways are taken, table and session's prior alone.
"""

import numpy as np

from alignment.reasons import AlignmentReason, AlignmentVerdict
from alignment.result import Alignment
from infield.session.bins import SessionBins
from infield.session.estimate import BegunInMotion, ParkedEvidence, SessionEarth, SessionEstimate
from ins.records import Span
from ins.verdicts import because

NOT_FOUND = float("nan")


def never_at_rest(
    bins: SessionBins, begun: BegunInMotion, left_out: tuple[Span, ...]
) -> SessionEstimate:
    """The session before anything was measured. bins: of its ways; left_out: short rests."""
    count = bins.start_s.size
    none = SessionEarth(
        known=np.zeros((0, 3)),
        covariance=np.zeros((0, 0)),
        of_heading=np.zeros((0, 0)),
        heading_deg_h=np.zeros(0),
        down_b=np.zeros((0, 3)),
    )
    parked = ParkedEvidence(
        stretches=(),
        stretch=np.zeros(0, dtype=np.int64),
        rate_deg_h=np.zeros((0, 3)),
        used_s=np.zeros(0),
        earth=none,
        turns=(),
        left_out=left_out,
        shape_dof=0,
        shape_nis=0.0,
        shape_nis_compensated=0.0,
    )
    return SessionEstimate(
        bins=bins,
        mean_deg_h=np.zeros(3 * count),
        covariance=bins.prior,
        alignment=Alignment(AlignmentVerdict.REFUSED, (because(AlignmentReason.BEGINS_IN_MOTION),)),
        solution=None,
        heading_error_rad=NOT_FOUND,
        sigma_heading_rad=NOT_FOUND,
        sigma_heading_before_rad=NOT_FOUND,
        nis_mean=0.0,
        dof=0,
        parked=parked,
        begun=begun,
    )
