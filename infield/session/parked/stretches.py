"""Where a unit without a heading stands, all along a log: every rest of a minute and more, and what
is left out and why.

A quiet second is judged on the sensors (`alignment.motion.parked_seconds`); where satellite
velocity is logged it must agree, for a steady roll, a slow circle and a smooth hover are quiet too.
"""

from dataclasses import dataclass
from itertools import pairwise

from alignment.motion.inertial import Where, quiet_stretches
from alignment.motion.kinds import Says
from alignment.motion.seconds import seconds_of
from alignment.motion.speeds import LASTING_S, joined, receiver_says
from infield.session.log import session_end
from infield.session.reasons import ParkedReason
from ins.records import AIRBORNE_PHASES, PARKED_PHASES, Run, Span
from ins.verdicts import Reason, because

# the noise of the default MEMS unit (0.3 deg/sqrt(h)) leaves 2.3 deg/h over it, a thirteenth of
# the 30 of a unit without a table (formats.md section 2)
MIN_PARKED_S = 60.0
# a rest shorter than MIN_PARKED_S and longer than this is named as left out: a third of 60 s
NAMED_ABOVE_S = 20.0


@dataclass(frozen=True)
class StationarySegments:
    """stretches: start and end [s] in order; left_out: other rests and why; why: None, or why
    there is none.

    from_first: the first stretch is the first rest of a minute in the log, which a surveyed heading
    is of.
    """

    stretches: tuple[Where, ...]
    left_out: tuple[Span, ...]
    why: Reason | None
    from_first: bool


def stationary_segments(run: Run, *, shortest_s: float = MIN_PARKED_S) -> StationarySegments:
    """Every rest of `shortest_s` or more."""
    log = seconds_of(run.imu)
    windows = parked_windows(run)
    quiet = [(window, quiet_stretches(log.between(*window))) for window in windows]
    found = [stretch for _, stretches in quiet for stretch in stretches]
    long = [s for s in found if s[1] - s[0] >= shortest_s]
    said = {s: _moves(run, *s) for s in long}
    kept = tuple(s for s in long if said[s] is None)
    short = [_short(a, b) for a, b in found if NAMED_ABOVE_S <= b - a < shortest_s]
    moving = [Span(start_s=a, end_s=b, reason=why) for (a, b), why in said.items() if why]
    named = any(p.phase in PARKED_PHASES for p in run.phases)
    lost = [
        _never_quiet(*window) for window, stretches in quiet if named and not stretches and found
    ]
    left_out = tuple(sorted([*short, *moving, *lost], key=lambda span: span.start_s))
    return StationarySegments(
        kept,
        left_out,
        None if kept else _why_none(found, moving),
        bool(kept) and kept[0] == long[0],
    )


def parked_windows(run: Run) -> tuple[Where, ...]:
    """Where rests may lie: the phases named as parked, those that meet taken as one; else all that
    is not named airborne.
    """
    imu = run.imu
    named = [(p.start_s, p.end_s) for p in run.phases if p.phase in PARKED_PHASES]
    if not named:
        airborne = joined(*((p.start_s, p.end_s) for p in run.phases if p.phase in AIRBORNE_PHASES))
        between = [(a[1], b[0]) for a, b in pairwise([*airborne, (imu.end_s, imu.end_s)])]
        return tuple((a, b) for a, b in [(imu.start_s, session_end(run)), *between] if b > a)
    return tuple(
        (max(a, imu.start_s), min(b, imu.end_s))
        for a, b in joined(*named, gap_s=1.0)
        if b > imu.start_s and a < imu.end_s
    )


def _short(start_s: float, end_s: float) -> Span:
    why = because(ParkedReason.REST_TOO_SHORT, rest_s=end_s - start_s, needed_s=MIN_PARKED_S)
    return Span(start_s=start_s, end_s=end_s, reason=why)


def _moves(run: Run, start_s: float, end_s: float) -> Reason | None:
    """Why satellite velocity says that this is no rest."""
    heard = receiver_says(run.gnss, start_s, end_s)
    if heard.said is not Says.MOVES:
        return None
    if heard.moving_s >= LASTING_S:
        return because(
            ParkedReason.GNSS_MOVES, fastest_m_s=heard.fastest_m_s, moving_s=heard.moving_s
        )
    return because(ParkedReason.GNSS_DRIFTS, mean_m_s=heard.mean_m_s, allowed_m_s=heard.allowed_m_s)


def _never_quiet(start_s: float, end_s: float) -> Span:
    """A phase named as parked of which nothing can be used."""
    named_s = end_s - start_s
    short = named_s < MIN_PARKED_S
    code = ParkedReason.NAMED_TOO_SHORT if short else ParkedReason.NAMED_NOT_AT_REST
    why = because(code, named_s=named_s, needed_s=MIN_PARKED_S)
    return Span(start_s=start_s, end_s=end_s, reason=why)


def _why_none(found: list[Where], moving: list[Span]) -> Reason:
    if moving:
        first = moving[0]
        return because(
            ParkedReason.NO_REST, start_s=first.start_s, end_s=first.end_s, why=first.reason
        )
    longest = max(found, key=lambda s: s[1] - s[0], default=None)
    return because(ParkedReason.LONGEST_REST, found=longest, needed_s=MIN_PARKED_S)
