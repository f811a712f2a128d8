"""What `recal watch` says while it runs, as one line of JSON, a screen and a page have it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from infield.reports.documents.update_records import UpdateDocument
from ins.documents import UNWRITTEN

Row = tuple[str, str]
FIRST_S = 90.0  # of a session, before its first estimate: 60 s of rest, and its start
ALIGNING = "aligning"  # the verdict of a session that is only too short so far


@dataclass(frozen=True, kw_only=True)
class GyroState:
    """A gyro: bias beyond the table with its sigma before the session, now, and at the end of the
    plan, the stay that the advice names; None where it is not known. target: what sigma it is to
    reach.
    """

    bias_deg_h: float | None
    sigma_before_deg_h: float
    sigma_now_deg_h: float
    sigma_plan_deg_h: float | None
    target_deg_h: float


@dataclass(frozen=True, kw_only=True)
class Estimated:
    """An update of the rows so far.

    until_s: of the session; verdict: of the update, or ALIGNING where only time is lacking, then
    waits_for says what is waited for, and waits_s how long, where that is known; excluded_s:
    seconds left out of it, by reason; at_end_degC: of the gyros, at the end of the longest stay
    that was predicted; advice, faults: sentences; enough: every gyro is below its target; plan_min:
    the stay that the advice names.
    """

    until_s: float
    verdict: str
    used_s: float
    excluded_s: Mapping[str, float]
    heading_deg: float | None
    sigma_heading_deg: float | None
    gyros: Mapping[str, GyroState]
    at_end_degC: Sequence[float] = ()
    faults: Sequence[str] = ()
    advice: Sequence[str] = ()
    enough: bool = False
    waits_for: str | None = None
    waits_s: float | None = None
    plan_min: float | None = None
    cpu_s: float = 0.0
    document: UpdateDocument | None = field(default=None, metadata=UNWRITTEN)


@dataclass(frozen=True, kw_only=True)
class WatchState:
    """The session at this moment.

    runs: its parts; time_s: of its last row; dropped: rows that were not recorded, by reason;
    gyro_degC: now; visited_degC: lowest and highest; estimate: the last one, None before the first;
    ending: what is done after the session's end.
    """

    schema: str = "recal.watch/1"
    runs: Sequence[str]
    time_s: float
    rate_hz: float | None
    phase: str
    rows: int
    dropped: Mapping[str, int]
    gyro_degC: Sequence[float]
    visited_degC: Sequence[float]
    faults: Sequence[str]
    estimate: Estimated | None
    ending: str | None = None


def rows(state: WatchState) -> list[Row]:
    """What is shown first: name and value."""
    rate = "" if state.rate_hz is None else f" at {state.rate_hz:.4g} Hz"
    dropped = ", ".join(f"{n} {why}" for why, n in state.dropped.items()) or "none"
    found = [] if state.ending is None else [("ended", state.ending)]
    found += [
        ("phase", f"{state.phase}, {clock(state.time_s)}"),
        ("rows", f"{state.rows}{rate}, dropped: {dropped}"),
    ]
    if len(state.runs) > 1:
        found.append(("parts", f"{len(state.runs)}: a gap of more than 1 s begins another run"))
    if state.gyro_degC:
        now = ", ".join(f"{value:.1f}" for value in state.gyro_degC)
        low, high = state.visited_degC
        to_come = ""
        if state.estimate is not None and state.estimate.at_end_degC:
            to_come = f"; in 40 min at rest {max(state.estimate.at_end_degC):.1f}"
        found.append(("gyros", f"{now} degC; visited {low:.1f} to {high:.1f}{to_come}"))
    if state.estimate is not None:
        found += _estimate_rows(state, state.estimate)
    elif state.ending is None:
        left_s = FIRST_S - state.time_s
        comes = f"comes in {clock(left_s)} of rows" if left_s > 0 else "is being made"
        found.append(("estimate", f"the first one {comes}"))
    return found


def _estimate_rows(state: WatchState, found: Estimated) -> list[Row]:
    left_out = ", ".join(f"{s:.0f} s {why}" for why, s in found.excluded_s.items()) or "nothing"
    old = clock(state.time_s - found.until_s)
    verdict = "" if found.verdict == ALIGNING else f"{found.verdict}, "
    lines = [] if found.waits_for is None else [("aligning", f"needs {found.waits_for}")]
    lines += [
        ("estimate", f"{verdict}of the rows until {clock(found.until_s)} ({old} ago)"),
        ("seconds", f"{found.used_s:.0f} used, left out: {left_out}"),
    ]
    if found.heading_deg is not None:
        lines.append(("heading", f"{found.heading_deg:.3f} +- {found.sigma_heading_deg:.3f} deg"))
    return lines


GYRO_HEAD = ("gyro", "bias", "sigma before", "now", "after the plan", "target")


def gyro_rows(found: Estimated) -> list[tuple[str, ...]]:
    """Gyro by gyro [deg/h], by GYRO_HEAD."""
    lines: list[tuple[str, ...]] = []
    for axis, gyro in found.gyros.items():
        plan = "-" if gyro.sigma_plan_deg_h is None else f"{gyro.sigma_plan_deg_h:.4f}"
        lines.append(
            (
                axis,
                f"{gyro.bias_deg_h:+.4f}",
                f"{gyro.sigma_before_deg_h:.4f}",
                f"{gyro.sigma_now_deg_h:.4f}",
                plan,
                f"{gyro.target_deg_h:.4f}",
            )
        )
    return lines


def clock(seconds: float) -> str:
    """h:mm:ss."""
    whole = max(int(seconds), 0)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
