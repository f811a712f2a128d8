"""One wrong session is left out; several that agree with each other against the table say that the
unit has changed.

Decision: docs/decisions/0016-contradicting-sessions.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from infield.session.reasons import SessionReason
from infield.table.thermal_table import ThermalTable
from ins.records import AXES, frozen_array
from ins.verdicts import Reason, because

# of a session's mean bias from the table, to count as off it; 0.3 % of sound sessions
OFF_SIGMAS = 3.0
SAME_SIGMAS = 3.29  # two sessions of one unit differ by more in 1 of 1000 cases
# sessions that agree: one may be wrong itself; two beyond 3 sigma are no chance (1e-5)
FEWEST_SESSIONS = 2


@dataclass(frozen=True, kw_only=True)
class SessionEvidence:
    """A session in three numbers: mean total bias (3,) [deg/h] at mean temperatures (3,) [degC].

    covariance (3, 3) [(deg/h)^2]: of the session as a whole, turn-on and all else included, the
    table's not. bend_deg_h (3,): the table's mean along the session less the table at the mean
    temperature.
    """

    run_id: str
    run_sha256: str
    start_utc: str
    temperature_degC: NDArray
    bias_deg_h: NDArray
    bend_deg_h: NDArray
    covariance: NDArray

    def __post_init__(self) -> None:
        for name, shape in (
            ("temperature_degC", (3,)),
            ("bias_deg_h", (3,)),
            ("bend_deg_h", (3,)),
            ("covariance", (3, 3)),
        ):
            object.__setattr__(
                self, name, frozen_array(getattr(self, name), shape, f"SessionEvidence.{name}")
            )

    def departure(self, table: ThermalTable) -> tuple[NDArray, NDArray]:
        """Bias less the table (3,) [deg/h], and the table's own sigma there (3,)."""
        at = [
            (table.bias_deg_h(k, T)[0], table.sigma_deg_h(k, T)[0])
            for k, T in enumerate(self.temperature_degC)
        ]
        return self.bias_deg_h - self.bend_deg_h - np.array([b for b, _ in at]), np.array(
            [s for _, s in at]
        )


@dataclass(frozen=True, kw_only=True)
class BiasStep:
    """The unit against its table on one axis: size [deg/h] with sigma, the sessions that agree,
    since when.
    """

    axis: str
    shift_deg_h: float
    sigma_deg_h: float
    since_utc: str
    run_ids: tuple[str, ...]
    run_sha256: tuple[str, ...]

    @property
    def reason(self) -> Reason:
        return because(
            SessionReason.TABLE_DISAGREES,
            axis=self.axis,
            shift_deg_h=self.shift_deg_h,
            sigma_deg_h=self.sigma_deg_h,
            since_utc=self.since_utc,
            count=len(self.run_ids),
            run_ids=self.run_ids,
        )


def find_steps(table: ThermalTable, evidence: Sequence[SessionEvidence]) -> tuple[BiasStep, ...]:
    """Axes on which the newest session and at least one more agree with each other and not with the
    table.

    Only sessions after the table was last changed count: one that agreed with it in between ends
    the story.
    """
    new = {e.run_sha256: e for e in evidence if utc(e.start_utc) >= utc(table.created_utc)}
    ordered = sorted(new.values(), key=lambda e: utc(e.start_utc))
    if len(ordered) < FEWEST_SESSIONS:
        return ()
    departures = [e.departure(table) for e in ordered]
    steps = []
    for k, axis in enumerate(AXES):
        d = np.array([shift[k] for shift, _ in departures])
        own = np.array([e.covariance[k, k] for e in ordered])
        off = np.abs(d) > OFF_SIGMAS * np.sqrt(own + np.array([s[k] for _, s in departures]) ** 2)
        same = (
            off
            & (np.abs(d - d[-1]) <= SAME_SIGMAS * np.sqrt(own + own[-1]))
            & (np.sign(d) == np.sign(d[-1]))
        )
        if not off[-1] or same.sum() < FEWEST_SESSIONS:
            continue
        agreeing = [e for e, yes in zip(ordered, same) if yes]
        weight = 1.0 / own[same]
        steps.append(
            BiasStep(
                axis=axis,
                shift_deg_h=float(weight @ d[same] / weight.sum()),
                sigma_deg_h=float(weight.sum() ** -0.5),
                since_utc=agreeing[0].start_utc,
                run_ids=tuple(e.run_id for e in agreeing),
                run_sha256=tuple(e.run_sha256 for e in agreeing),
            )
        )
    return tuple(steps)


def widened_for(table: ThermalTable, steps: Sequence[BiasStep]) -> ThermalTable:
    """The table with the common shift of each stepped axis made as uncertain as the step is large;
    values stay.
    """
    P = table.covariance.copy()
    for step in steps:
        nodes = table.values_of(step.axis)
        P[nodes, nodes] += step.shift_deg_h**2 + step.sigma_deg_h**2
    return table.replaced(covariance=P)


def utc(text: str) -> datetime:
    """A time stamp with its offset; without one it is UTC."""
    t = datetime.fromisoformat(text.replace("Z", "+00:00"))
    return t if t.tzinfo else t.replace(tzinfo=UTC)
