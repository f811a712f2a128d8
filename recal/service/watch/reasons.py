"""What a session that is only too short so far waits for."""

from collections.abc import Sequence

from alignment.motion.stillness import ALIGNMENT_S
from alignment.reasons import AlignmentReason
from infield.session.reasons import ParkedReason, SessionReason
from infield.thermometer.gyro_temperature import ThermometerReason
from ins.verdicts import Reason, ReasonCode, because


class Wait(ReasonCode):
    """What a session that is only too short so far waits for."""

    REST = (
        "rest",
        "{left_s:.0f} s more at rest: {rest_s:.0f} s so far, {needed_s:.0f} s are the least that"
        " is taken",
    )
    FIRST_REST = "first_rest", "a minute at rest: it has moved all the time"
    READINGS = "readings", "{left_s:.0f} s more of gyro temperatures"
    GAIN = "gain", "more time at rest, or a turn: no gyro is better known yet than before"


def waits(reasons: Sequence[Reason], until_s: float) -> Reason | None:
    """What is waited for where a session is refused for nothing but its length.

    Parameters
    ----------
    reasons : sequence of Reason
        Of its refusal.
    until_s : float
        Of its last row [s].

    Returns
    -------
    Reason or None
        Of a code of `Wait`; `left_s` [s] among its values where it is known.
    """
    found = [_wait(reason, until_s) for reason in reasons]
    longest = [wait for wait in found if wait is not None]
    if not longest or len(longest) < len(found):
        return None
    return max(longest, key=lambda wait: wait.values.get("left_s", 0.0))


def _wait(reason: Reason, until_s: float) -> Reason | None:
    values = reason.values
    if reason.code in (SessionReason.NEVER_RESTS, AlignmentReason.NEVER_RESTS):
        return because(Wait.FIRST_REST)
    if reason.code is SessionReason.NO_GAIN and until_s < ALIGNMENT_S:
        return because(Wait.GAIN)
    if reason.code is ThermometerReason.TOO_FEW_ROWS:
        return because(Wait.READINGS, left_s=values["needed_s"] - values["span_s"])
    rest_s = None
    if reason.code is SessionReason.SHORT_REST:
        rest_s = values["rest_s"]
    elif reason.code is ParkedReason.LONGEST_REST:
        begin_s, end_s = values["found"] or (0.0, 0.0)
        rest_s = end_s - begin_s
    if rest_s is None:
        return None
    needed_s = values["needed_s"]
    return because(Wait.REST, left_s=needed_s - rest_s, rest_s=rest_s, needed_s=needed_s)
