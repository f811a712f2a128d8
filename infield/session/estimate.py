"""What a session's estimate is: the posterior of its biases and the evidence behind it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from alignment.motion.kinds import UNKNOWN
from alignment.motion.parked_seconds import ParkedSeconds, Sway
from alignment.motion.stillness import Motion
from alignment.motion.turn_between import HeadingChange
from alignment.result import Alignment, Solution
from infield.session.bins import SessionBins
from infield.session.reasons import Nuisance, OwnErrorState, VarianceSource
from infield.table.merge import UNOBSERVED, MergeResult, merge_posterior
from infield.table.thermal_table import ThermalTable
from ins.documents import written
from ins.records import Span
from ins.units import DEG_PER_HOUR
from ins.verdicts import Reason, because, sentence

# of what a session took from its prior in any direction, after two estimates of it were averaged;
# chosen: of 0.2, 0.5 and 0.8, 24 ring-laser flights were off by 0.95, 0.97 and 0.98 of their sigmas
LEARNT_SHARE = 0.5


@dataclass(frozen=True)
class SessionEarth:
    """All S stretches: known (S, 3), covariance (3S, 3S) of the rest, of which unknown headings
    make of_heading (3S, 3S); heading (S,), down (S, 3) as for one stretch.
    """

    known: NDArray
    covariance: NDArray
    of_heading: NDArray
    heading_deg_h: NDArray
    down_b: NDArray


@dataclass(frozen=True)
class ParkedStretch:
    """A stretch of rest: white noise taken (3,), the larger of twin and log; noise_scale: of the
    log over the twin; sway: the spectrum of one that sways.
    """

    seconds: ParkedSeconds
    walk_deg_sqrt_h: NDArray
    noise_scale: float
    sway: Sway | None = None

    @property
    def still_s(self) -> float:
        return float(self.seconds.dt_s[self.seconds.still].sum())


@dataclass(frozen=True)
class ParkedEvidence:
    """What the parked seconds said: rates less table and known Earth rate (N, 3) [deg/h], NaN where
    a bin was not still.

    stretch (N,): which of `stretches` a bin is of, -1 of a bin under way; used_s (N,): still
    seconds of each bin; earth: what of Earth rate is known and the covariance of the rest over all
    stretches; turns: between one stretch and the next; left_out: other rests and why; there may be
    no stretch at all, of a unit that never stood. Against the
    table with nothing believed of each gyro's level, sums of squares: shape_nis,
    shape_nis_compensated (as if the table had been taken out of the log before), shape_dof.
    """

    stretches: tuple[ParkedStretch, ...]
    stretch: NDArray
    rate_deg_h: NDArray
    used_s: NDArray
    earth: SessionEarth
    turns: tuple[HeadingChange, ...]
    left_out: tuple[Span, ...]
    shape_dof: int
    shape_nis: float
    shape_nis_compensated: float

    @property
    def motion(self) -> Motion:
        """The stretches as one motion; nobody says what lies between them."""
        first, *others = (s.seconds.motion for s in self.stretches)
        time_s, kind, cause = [first.time_s], [first.kind], [first.cause]
        for other in others:
            time_s.append(other.time_s)
            kind.append(np.append(UNKNOWN, other.kind[1:]))
            cause.append(other.cause)
        together = np.concatenate(kind)
        return Motion(
            np.concatenate(time_s),
            together,
            np.zeros(together.size),
            float("nan"),
            np.concatenate(cause),
        )

    @property
    def walk_deg_sqrt_h(self) -> NDArray:
        """White noise (3,), of the noisiest stretch."""
        return np.asarray(np.max([s.walk_deg_sqrt_h for s in self.stretches], axis=0))

    @property
    def noise_scale(self) -> float:
        return max(s.noise_scale for s in self.stretches)

    def of_mean(self, covariance: NDArray) -> NDArray:
        """Variance (3,) that a covariance over stretches (3S, 3S) leaves in the session's mean, by
        their seconds.
        """
        of, used_s = self.stretch[self.stretch >= 0], self.used_s[self.stretch >= 0]
        share = np.bincount(of, used_s, len(self.stretches)) / used_s.sum()
        rows = np.kron(share, np.eye(3))
        return np.asarray(np.diag(rows @ covariance @ rows.T))


@dataclass(frozen=True)
class Found:
    """A nuisance of the taxi: its values, sigmas and prior sigmas, SI; by how much the log
    likelihood of all measurements grew as it was taken (0 of what every taxi has).

    sigma is None, and the value an RMS, for what changes on its own.
    """

    nuisance: Nuisance
    value: NDArray
    sigma: NDArray | None
    prior: NDArray
    gain_nats: float

    @property
    def reason(self) -> Reason:
        """What the taxi showed of it; of a cross wind its direction, size and sigma along it."""
        if self.nuisance is not Nuisance.CROSS_WIND or self.sigma is None:
            return because(self.nuisance, value=self.value, sigma=self.sigma, prior=self.prior)
        towards_rad = float(np.arctan2(self.value[1], self.value[0]))
        along = np.array([np.cos(towards_rad), np.sin(towards_rad)])
        return because(
            Nuisance.CROSS_WIND,
            towards_rad=towards_rad % (2.0 * np.pi),
            size_rad=float(np.linalg.norm(self.value)),
            sigma_rad=float(np.linalg.norm(along * self.sigma)),
            prior=self.prior,
        )


# crabs whose level is fitted to the lateral way
FITTED_CRABS = frozenset([Nuisance.TURNING_CRAB, Nuisance.GUSTS])


@dataclass(frozen=True)
class RollingEvidence:
    """What the taxi needed beyond what is declared, what every taxi estimates, and NIS and its
    degrees of freedom as declared, all measurements; a receiver's slow errors, which its parked
    fixes show, count as declared.
    """

    found: tuple[Found, ...]
    always: tuple[Found, ...]
    declared_nis: float
    declared_dof: int

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(found.nuisance.value for found in self.found)

    @property
    def is_test(self) -> bool:
        """Does the NIS of the lateral way test anything? Not where its noise was fitted."""
        return not any(found.nuisance in FITTED_CRABS for found in self.found)


@written("error target coefficient value sigma prior_sigma unit state text")
@dataclass(frozen=True, kw_only=True)
class OwnError:
    """A coefficient of an error that an installed package declares, on a target, in `unit`.

    prior_sigma: taken for possible before; value, sigma: as estimated, None where it was not;
    state: that, or why not.
    """

    error: str
    target: str
    coefficient: str
    unit: str
    prior_sigma: float
    value: float | None = None
    sigma: float | None = None
    state: OwnErrorState = OwnErrorState.NO_TRACE

    @property
    def reason(self) -> Reason:
        """What became of it."""
        return because(
            self.state,
            error=self.error,
            target=self.target,
            coefficient=self.coefficient,
            unit=self.unit,
            value=self.value,
            sigma=self.sigma,
            prior_sigma=self.prior_sigma,
        )

    @property
    def text(self) -> str:
        return sentence(self.reason)


@dataclass(frozen=True)
class OwnErrorsFound:
    """All of a session. in_common: of each that is the same in all runs what one sigma of its prior
    adds to the bins (3N,) [deg/h].
    """

    errors: tuple[OwnError, ...] = ()
    in_common: tuple[NDArray, ...] = ()


@dataclass(frozen=True, kw_only=True)
class BegunInMotion:
    """How a session began that has no first rest: when, how the heading was found and to which
    sigma; parked_s: seconds of the session at rest, after its flight.
    """

    time_s: float
    method: str
    sigma_heading_mrad: float
    parked_s: float


@dataclass(frozen=True)
class SessionEstimate:
    """Posterior of the session's bias beyond the table (mean (3N,), covariance (3N, 3N), deg/h) and
    its evidence.

    heading_error_rad: computed minus true at the end of the alignment; sigma before (alignment
    alone) and after. solution is None, and parked is not, for gyros that find no heading
    (`infield.session.parked`); the heading is NaN then. sweep: tells the `shares`
    (`navigated.noise_shares`). begun: of a session without a first rest; the heading error is that
    of its start then. own: errors of installed packages, None where its filter knows of none.
    """

    bins: SessionBins
    mean_deg_h: NDArray
    covariance: NDArray
    alignment: Alignment
    solution: Solution | None
    heading_error_rad: float = float("nan")
    sigma_heading_rad: float = float("nan")
    sigma_heading_before_rad: float = float("nan")
    nis_mean: float = 0.0
    dof: int = 0
    parked: ParkedEvidence | None = None
    rolling: RollingEvidence | None = None
    sweep: Callable[[], Mapping[VarianceSource, NDArray]] | None = None
    begun: BegunInMotion | None = None
    own: OwnErrorsFound | None = None

    @classmethod
    def of_solution(
        cls,
        bins: SessionBins,
        alignment: Alignment,
        solution: Solution,
        bias: tuple[NDArray, NDArray],
        **found: Any,
    ) -> "SessionEstimate":
        """Of a navigated session; bias: mean and covariance of its bins [rad/s], found: the rest of
        the fields.
        """
        tally = solution.filter.tally
        dof = sum(tally.dof.values())
        return cls(
            bins=bins,
            mean_deg_h=bias[0] / DEG_PER_HOUR,
            covariance=bias[1] / DEG_PER_HOUR**2,
            alignment=alignment,
            solution=solution,
            nis_mean=sum(tally.nis.values()) / max(dof, 1),
            dof=dof,
            **found,
        )

    @cached_property
    def shares(self) -> Mapping[VarianceSource, NDArray]:
        """Of the information about the bins (3N, 3N) [1/(deg/h)^2], what each source of noise took
        part in; empty without a sweep. Eight runs of the filter, so made where a budget asks.
        """
        return {} if self.sweep is None else self.sweep()

    @property
    def motion(self) -> Motion:
        """When the vehicle stood, by the solution or by the parked seconds."""
        if self.parked is None:
            return self.navigated.motion
        if self.parked.stretches:
            return self.parked.motion
        ends_s = np.array([self.bins.start_s[0], self.bins.end_s[-1]])
        cause = np.full(2, "", dtype=object)
        return Motion(ends_s, np.full(2, int(UNKNOWN)), np.zeros(2), float("nan"), cause)

    @property
    def navigated(self) -> Solution:
        """The navigation solution, where there is one."""
        assert self.solution is not None
        return self.solution

    def averaged(self, other: "SessionEstimate", belief: float) -> "SessionEstimate":
        """The other estimate of the same session, with mean and covariance of what is the other's
        with this probability and this one's else (Bar-Shalom (2001), eq. 1.4.16-9).

        Of the covariance that comes of what they differ by, as much as leaves in every direction
        LEARNT_SHARE of what the session took from its prior: tables, tests and budgets take what a
        session learnt for a measurement of its bins, and nothing measures less than nothing.
        """
        apart = other.mean_deg_h - self.mean_deg_h
        mean = self.mean_deg_h + belief * apart
        covariance = (1.0 - belief) * self.covariance + belief * other.covariance
        L = np.linalg.cholesky(self.bins.prior)
        W = solve_triangular(L, np.eye(len(L)), lower=True)
        learnt, V = np.linalg.eigh(np.eye(len(L)) - W @ covariance @ W.T)
        seen = learnt > UNOBSERVED
        between = belief * (1.0 - belief)
        against = between * float(np.sum((V[:, seen].T @ W @ apart) ** 2 / learnt[seen]))
        share = min(1.0, (1.0 - LEARNT_SHARE) / against) if against > 0.0 else 1.0
        covariance += share * between * np.outer(apart, apart)
        return replace(other, mean_deg_h=mean, covariance=covariance)

    def merged_into(self, table: ThermalTable, held_axes: Sequence[str] = ()) -> MergeResult:
        """The table with what the session found; the common part of held axes stays put."""
        bins = self.bins
        return merge_posterior(
            table,
            bins.H,
            bins.table_deg_h,
            bins.prior,
            bins.table_deg_h + self.mean_deg_h,
            self.covariance,
            held_axes=held_axes,
        )
