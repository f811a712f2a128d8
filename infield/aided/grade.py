"""How good an aided solution is along its log: good, or degraded, where and why.

A solution that no stretch speaks against is good. Where its own sigmas are wide, where fixes were
rejected one after the other and where their positions leapt, it is degraded there and stands
everywhere else; `inconsistent` is left for what speaks against all of it
(`infield.aided.flight.judged`).
"""

from dataclasses import dataclass, field

import numpy as np

from alignment.motion.inertial import Where
from infield.aided.reasons import AidedGrade, AidedWeakness
from ins.filters.aided_filter import KINDS, level_sigmas
from ins.filters.aided_records import JUMPED, REJECTED, RESET, AidedHistory, Fixes
from ins.robust import runs_of_true
from ins.units import DEG

# chosen: of the level position's sigma, beyond which it is degraded: 3 times that of the log's best
# tenth, and no less than 3 m, what receivers without corrections are good to
WIDE_TIMES, LEAST_WIDE_M, BEST = 3.0, 3.0, 0.1
LEAST_WIDE_S = 10.0  # chosen: a heading wide for less than 10 s is told by its start's sigma
LOOSE_HEADING_RAD = 5.0 * DEG  # chosen: a tenth of a leg's length abeam (sin 5 deg is 0.09)
# rejected fixes of one stretch are at most so far apart, and so many at least; chosen: 3 good fixes
# within 10 s at 5 Hz are rejected once in 1e13 (the gate's 1e-6 each), 1 or 2 are its daily work
TOGETHER_S, FEWEST_REJECTED = 10.0, 3


@dataclass(frozen=True, kw_only=True)
class Weak:
    """A stretch in which a solution is degraded, why, and that in words."""

    start_s: float
    end_s: float
    why: AidedWeakness
    words: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "words", self.why.template)


def graded(
    history: AidedHistory, fixes: Fixes, outages: tuple[Where, ...], *, inconsistent: bool
) -> tuple[AidedGrade, tuple[Weak, ...]]:
    """The grade of a solution and its weak stretches, in order of time.

    outages: (start, end) of the stretches without a used position.
    """
    weak = sorted(
        [
            *_wide_headings(history),
            *_wide_positions(history, outages),
            *_unsure_receiver(history, fixes),
            *_rejected(history),
        ],
        key=lambda w: w.start_s,
    )
    if inconsistent:
        return AidedGrade.INCONSISTENT, tuple(weak)
    return (AidedGrade.DEGRADED if weak else AidedGrade.GOOD), tuple(weak)


def _wide_headings(history: AidedHistory) -> list[Weak]:
    sigma = level_sigmas(history.phi_covariance, history.C_nb)[:, 2]
    t = history.time_s
    return [
        Weak(start_s=float(t[a]), end_s=float(t[b - 1]), why=AidedWeakness.HEADING)
        for a, b in runs_of_true(sigma > LOOSE_HEADING_RAD)
        if t[b - 1] - t[a] >= LEAST_WIDE_S
    ]


def _wide_positions(history: AidedHistory, outages: tuple[Where, ...]) -> list[Weak]:
    """Stretches of wide positions, each with what made it wide."""
    sigma = np.sqrt(history.variance[:, :2].sum(axis=1))
    wide = sigma > max(WIDE_TIMES * float(np.quantile(sigma, BEST)), LEAST_WIDE_M)
    found = []
    for a, b in runs_of_true(wide):
        span = float(history.time_s[a]), float(history.time_s[b - 1])
        found.append(Weak(start_s=span[0], end_s=span[1], why=_cause(history, outages, span)))
    return found


def _cause(history: AidedHistory, outages: tuple[Where, ...], span: Where) -> AidedWeakness:
    """What made the position of a stretch wide: a leap or a new beginning at its start or in it,
    else an outage, else the start.
    """
    became = history.used[:, 0]
    inside = (history.fix_time_s >= span[0] - 1.0) & (history.fix_time_s <= span[1])
    events = became[inside & (became >= RESET)]
    if events.size:
        return AidedWeakness.LEAP if (events == JUMPED).any() else AidedWeakness.BEGUN_ANEW
    if any(a <= span[1] and b >= span[0] for a, b in outages):
        return AidedWeakness.OUTAGE
    return AidedWeakness.START


def _unsure_receiver(history: AidedHistory, fixes: Fixes) -> list[Weak]:
    """Stretches in which the receiver itself gives wide sigmas to its positions: they excuse
    whatever it says there, so that no test of the innovations speaks against it.
    """
    seen = np.isfinite(fixes.r_e_m[:, 0]) & (fixes.time_s >= history.time_s[0])
    if not seen.any():
        return []
    t, sigma = fixes.time_s[seen], fixes.sigma_position_m[seen, 0]
    wide = sigma > max(WIDE_TIMES * float(np.quantile(sigma, BEST)), LEAST_WIDE_M)
    return [
        Weak(start_s=float(t[a]), end_s=float(t[b - 1]), why=AidedWeakness.RECEIVER)
        for a, b in runs_of_true(wide)
        if t[b - 1] - t[a] >= LEAST_WIDE_S
    ]


def _rejected(history: AidedHistory) -> list[Weak]:
    """Stretches of rejected fixes."""
    found = []
    for kind in range(len(KINDS)):
        times = history.fix_time_s[history.used[:, kind] == REJECTED]
        for part in np.split(times, np.flatnonzero(np.diff(times) > TOGETHER_S) + 1):
            if part.size >= FEWEST_REJECTED:
                found.append(
                    Weak(start_s=float(part[0]), end_s=float(part[-1]), why=AidedWeakness.REJECTED)
                )
    return found
