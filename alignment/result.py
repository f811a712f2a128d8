"""Results of alignment: value, sigma, evidence, verdict."""

from dataclasses import dataclass

from numpy.typing import NDArray

from alignment.level_fit import LevelFit, LevelFound
from alignment.motion.stillness import Motion
from alignment.navigation_filter import FilterPass, StepPlan
from alignment.reasons import LATITUDE_REASONS, AlignmentVerdict
from ins.estimation.error_filter import ErrorFilter
from ins.records import NavHistory, Phase, Span
from ins.verdicts import Reason


@dataclass(frozen=True)
class BiasPrior:
    """What is known of the gyro bias beyond what was already subtracted: constants over time bins.

    edges_s (N + 1,); covariance (3N, 3N) [(rad/s)^2], order x, y, z of bin 0, then of bin 1 ...
    """

    edges_s: NDArray
    covariance: NDArray


@dataclass(frozen=True)
class Solution:
    """A navigation solution linearised about itself, and the filter's last state of its errors.

    applied_bias_rad_s (N, 3): what the last pass had subtracted beyond the table. `clone_s`: the
    time of the theta clone. level: of the motion that it ran under. last: that pass, which can be
    run again under other aids.
    """

    history: NavHistory
    motion: Motion
    plan: StepPlan
    prior: BiasPrior
    applied_bias_rad_s: NDArray
    clone_s: float
    fitted: LevelFit
    level: LevelFound
    last: FilterPass

    @property
    def filter(self) -> ErrorFilter:
        """The filter under the level that was found."""
        return self.fitted.filter

    @property
    def displacement_sigma_m(self) -> float:
        """RMS of the parked vehicle about its place [m], in the middle of its steps."""
        return self.level.place_m

    @property
    def bias(self) -> tuple[NDArray, NDArray]:
        """Posterior mean (3N,) and covariance (3N, 3N) of the gyro bias beyond the table
        [rad/s].
        """
        mean, covariance = self.filter.bias
        return mean + self.applied_bias_rad_s.ravel(), covariance


@dataclass(frozen=True)
class Alignment:
    """Attitude at `time_s`, the end of the parked time, with sigmas [rad]; NaN where refused.

    used_share: of the parked seconds that were used; level: of the vehicle's motion in them.
    """

    verdict: AlignmentVerdict
    reasons: tuple[Reason, ...]
    time_s: float = float("nan")
    roll_rad: float = float("nan")
    pitch_rad: float = float("nan")
    heading_rad: float = float("nan")
    sigma_roll_rad: float = float("nan")
    sigma_pitch_rad: float = float("nan")
    sigma_heading_rad: float = float("nan")
    latitude_rad: float = float("nan")
    sigma_latitude_rad: float = float("nan")
    duration_s: float = 0.0
    phases: tuple[Phase, ...] = ()
    excluded: tuple[Span, ...] = ()
    nis_mean: float = float("nan")
    dof: int = 0
    C_nb: NDArray | None = None
    used_share: float = 0.0
    level: LevelFound | None = None

    @property
    def wrong_latitude(self) -> tuple[Reason, ...]:
        """What is wrong with the latitude that was entered; empty where nothing is."""
        return tuple(r for r in self.reasons if r.code in LATITUDE_REASONS)
