"""What `recal watch` says while it runs, as one line of JSON, a screen and a page have it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from infield.reports.documents.update_records import UpdateDocument
from ins.documents import UNWRITTEN


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

    until_s: of the session; excluded_s: seconds left out of it, by reason; at_end_degC: of the
    gyros, at the end of the longest stay that was predicted; advice, faults: sentences; enough:
    every gyro is below its target; plan_min: the stay that the advice names.
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
    plan_min: float | None = None
    cpu_s: float = 0.0
    document: UpdateDocument | None = field(default=None, metadata=UNWRITTEN)


@dataclass(frozen=True, kw_only=True)
class WatchState:
    """The session at this moment.

    runs: its parts; time_s: of its last row; dropped: rows that were not recorded, by reason;
    gyro_degC: now; visited_degC: lowest and highest; estimate: the last one, None before the first.
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
