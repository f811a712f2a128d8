"""The parked filter under the level of motion that its own residuals show.

The local level (`alignment.motion.level`) says how far place and heading stray within half a
minute. What is slower (a place that people leave for another, a gust that leans on the vehicle) is
a walk of place and heading. Its size, the scale of the local level and that of the unit's own noise
are found by the likelihood of the filter's innovations: a parameter leaves its quiet value, and
only upwards, where that is e^SURE times as likely. Single steps that still stand out are given the
variance that they show (Student's t), once.

Source: innovations likelihood, Schweppe (1965); t-distributed weights, Lange, Little, Taylor
(1989), section 3. Pinned by: tests/alignment/test_parked_level.py
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alignment.motion.kinds import STILL
from alignment.motion.level import ParkedLevel
from alignment.navigation_filter import PARKED, ParkedConstraint, StepPlan
from ins.filters import error_model as em
from ins.filters.error_filter import GATE_SIGMA, ErrorFilter
from ins.kalman import nis_band

SURE = 3.0  # nats of log-likelihood for each parameter: odds of 20 to 1
FACTORS = (0.5, 0.71, 1.41, 2.0)  # of a parameter in a round of the search
ROUNDS = 8
# of a vehicle that stands, per square root of a second: 0.3 m in 20 min. One that rolls unseen has
# side motion of 0.04 m (0.02 m/s over 2 s)
LARGEST_WALK_M = 0.01
LARGEST_PLACE_M = 1.0  # a moored ship
LARGEST_YAW_WALK_RAD = 1e-3
# Of the local level: where the search for a walk over ten seconds and for a larger level begins.
# Place and its walk are alike in size; a heading that people turn by arcseconds walks a hundred
# times its quiet jitter, which may be a gyro's last bit, and less than that shows nothing.
FIRST_WALKS = {"place": (0.25,), "yaw": (0.25, 4.0, 60.0)}
FIRST_FACTORS = {"place": (1.41,), "yaw": (1.41, 8.0, 60.0)}
SHOWN_BY = {"place": ("still", "stop"), "yaw": ("heading held",)}  # measurements of each level
# nats that a step of the search must gain: a parameter 0.4 of its sigma off costs less
HIGHER = 0.1
STRAYS = 13.8  # squared innovation of a place (2 degrees of freedom) that is chance once in 1,000
FREEDOM = 4.0  # of Student's t
# correlation of successive innovations below which they count as independent, 3 sigma of 144 of
# them (3 / 12), and how many are needed to say so: of 12, 3 sigma are 0.87. At half and at twice
# of 0.25 tests/alignment/test_parked_level.py fails
LEAST_ALIKE, FEWEST_ALIKE = 0.25, 12


class Scale(NamedTuple):
    """What multiplies the local level of place and heading, and the walks beside them (of the
    local level, over ten seconds); unit: what multiplies the unit's own noise.
    """

    place: float = 1.0
    place_walk: float = 0.0
    yaw: float = 1.0
    yaw_walk: float = 0.0
    unit: float = 1.0


QUIET = Scale()


@dataclass(frozen=True)
class LevelFound:
    """How the parked vehicle moved: RMS of its place, per axis [m], and heading [rad] in the middle
    of its steps and at their roughest, walks of both over ten seconds, scale of the unit's noise;
    sigma_cost: heading sigma under this level over that on a calm vehicle.
    """

    place_m: float
    largest_place_m: float
    place_walk_m: float
    yaw_rad: float
    largest_yaw_rad: float
    yaw_walk_rad: float
    unit_noise: float
    sigma_cost: float


@dataclass(frozen=True)
class Fitted:
    """A filter that has run, and the level that it ran under."""

    filter: ErrorFilter
    parked: ParkedConstraint
    scale: Scale
    found: LevelFound


Run = Callable[[ParkedConstraint, float], ErrorFilter]  # the last: scale of the unit's noise


@dataclass(frozen=True)
class Stretch:
    """What the search needs of a run: its plan, the level at its epochs (k,) and their times."""

    plan: StepPlan
    level: ParkedLevel
    time_s: NDArray
    hold_heading: bool
    calm_m: float  # what the vehicle's place is declared to stray by

    def calm(self) -> ParkedConstraint:
        """How the vehicle would be held were it as calm as declared."""
        held = self.constraint(QUIET)
        place = np.minimum(held.displacement_sigma_m, self.calm_m)
        return replace(
            held, displacement_sigma_m=place, yaw_jitter_rad=float(np.min(held.yaw_jitter_rad))
        )

    def constraint(self, scale: Scale, gate: float = np.inf) -> ParkedConstraint:
        """How the vehicle is held under a scale."""
        place, yaw = self.level.place_m[self.plan.last], self.level.yaw_rad[self.plan.last]
        dt = self.time_s[self.plan.last] - self.time_s[self.plan.first]
        tenth = np.sqrt(dt / 10.0)
        walk = np.minimum(scale.place_walk * place * tenth, LARGEST_WALK_M * np.sqrt(dt))
        # gusts are no multiple of the quiet jitter, which may be a gyro's last bit
        quiet = float(np.min(yaw)) if yaw.size else 0.0
        turn = np.minimum(scale.yaw_walk * quiet * tenth, LARGEST_YAW_WALK_RAD * np.sqrt(dt))
        return ParkedConstraint(
            displacement_sigma_m=np.minimum(scale.place * place, LARGEST_PLACE_M),
            yaw_jitter_rad=np.sqrt(yaw**2 + (scale.yaw**2 - 1.0) * quiet**2),
            hold_heading=self.hold_heading,
            place_walk_m=walk,
            yaw_walk_rad=turn,
            gate=gate,
        )


def fit(
    run: Run, stretch: Stretch, units: tuple[float, ...] = (1.0,), *, rough: bool = False
) -> Fitted:
    """The filter under the likeliest level.

    units: rising scales of the unit's own noise to choose from. Beyond the likeliest, the first
    under which the residuals are no larger than their band is taken, the last where none is.
    rough: of an early pass, whose level is not looked for.
    """
    search = _Search(run, stretch)
    scale = QUIET if rough else search.likeliest(units)
    fitted = search.under(scale)
    for unit in units:
        if unit > scale.unit and not explained(fitted.filter):
            fitted = search.under(scale._replace(unit=unit))
    return fitted


def explained(flt: ErrorFilter) -> bool:
    """Whether the filter's residuals are within the band of their chi-square (99.9 %)."""
    dof = sum(flt.tally.dof.values())
    return dof == 0 or sum(flt.tally.nis.values()) / dof <= nis_band(dof, 0.999)[1]


class _Search:
    """Filters over one program under one scale after another, each run once."""

    def __init__(self, run: Run, stretch: Stretch) -> None:
        self._run, self._stretch = run, stretch
        self._filters: dict[Scale, ErrorFilter] = {}

    def under(self, scale: Scale) -> Fitted:
        """The filter under a scale, single strays widened, what is beyond the gate left out."""
        plan, parked = self._stretch.plan, self._stretch.constraint(scale)
        ungated = self._ungated(scale)
        slower = _slower(ungated, _strayed(ungated, plan, parked))
        strayed = replace(slower, gate=GATE_SIGMA)
        flt = self._run(strayed, scale.unit)
        calm = self._run(self._stretch.calm(), 1.0)
        return Fitted(flt, strayed, scale, _found(flt, calm, strayed, scale.unit, plan))

    def likeliest(self, units: tuple[float, ...]) -> Scale:
        """The likeliest scale, each parameter beyond its quiet value penalised."""
        scale, best = self._with_unit(QUIET, self._value(QUIET))
        for unit in units[1:]:
            louder = scale._replace(unit=unit)
            if max(map(self._value, (louder, QUIET._replace(unit=unit)))) <= best + SURE:
                break
            found, value = self._with_unit(QUIET._replace(unit=unit), -np.inf)
            if value <= best + SURE:
                break
            scale, best = found, value
        return scale

    def _with_unit(self, scale: Scale, best: float) -> tuple[Scale, float]:
        """The likeliest level beside one scale of the unit's noise, and its penalised value."""
        best = max(best, self._value(scale))
        for own, walk in (("place", "place_walk"), ("yaw", "yaw_walk")):
            if own == "yaw" and not self._stretch.hold_heading:
                continue
            if self._most_to_gain(own, scale) < 0.5 * SURE:
                continue
            walks = [scale._replace(**{walk: size}) for size in FIRST_WALKS[own]]
            wider = [scale._replace(**{own: size}) for size in FIRST_FACTORS[own]]
            start = max((*walks, *wider), key=self._value)
            if self._value(start) - SURE <= best:
                continue
            found = self._climb(start, (own, walk))
            penalty = SURE * sum(a != b for a, b in zip(found, scale))
            if self._value(found) - penalty > best:
                best, scale = self._value(found) - penalty, found
        return scale, best

    def _most_to_gain(self, own: str, scale: Scale) -> float:
        """About the log-likelihood [nats] that any level of place or heading could add.

        So far from the noise they were taken for are n innovations of mean square q, correlated by
        r from step to step: n (q - 1 - ln q) / 2 + n r^2 / 2. Quiet data are not searched.
        """
        seen = self._ungated(scale).tally.normalised
        gain = 0.0
        for name in SHOWN_BY[own]:
            if name not in seen or len(seen[name]) < 2:
                continue
            x = seen[name]
            power = float(np.mean(x**2))
            alike = float(np.mean(x[1:] * x[:-1])) / power
            louder = power - 1.0 - np.log(power) if power > 1.0 else 0.0
            gain += 0.5 * x.size * (louder + max(alike, 0.0) ** 2)
        return gain

    def _climb(self, scale: Scale, names: tuple[str, ...]) -> Scale:
        """Up the likelihood by one parameter after another, until none of the factors helps."""
        for _ in range(ROUNDS):
            before = scale
            for name in names:
                for factor in FACTORS:
                    size = factor * (getattr(scale, name) or FIRST_WALKS[names[0]][0])
                    tried = scale._replace(**{name: size})
                    if min(tried.place, tried.yaw) < 1.0:
                        continue
                    if self._value(tried) > self._value(scale) + HIGHER:
                        scale = tried
            if scale == before:
                break
        return scale

    def _value(self, scale: Scale) -> float:
        """Log-likelihood of what was measured of the standing vehicle."""
        told = self._ungated(scale).tally.log_likelihood
        return sum(told.get(name, 0.0) for name in PARKED)

    def _ungated(self, scale: Scale) -> ErrorFilter:
        if scale not in self._filters:
            self._filters[scale] = self._run(self._stretch.constraint(scale), scale.unit)
        return self._filters[scale]


def _found(
    flt: ErrorFilter, calm: ErrorFilter, parked: ParkedConstraint, unit: float, plan: StepPlan
) -> LevelFound:
    still, down = plan.kind == STILL, em.THETA.stop - 1
    return LevelFound(
        place_m=_middle(parked.displacement_sigma_m, still),
        largest_place_m=_largest(parked.displacement_sigma_m, still),
        place_walk_m=_middle(parked.place_walk_m, still),
        yaw_rad=_middle(parked.yaw_jitter_rad, still),
        largest_yaw_rad=_largest(parked.yaw_jitter_rad, still),
        yaw_walk_rad=_middle(parked.yaw_walk_rad, still),
        unit_noise=unit,
        sigma_cost=float(np.sqrt(flt.P[down, down] / calm.P[down, down])),
    )


def _middle(value: NDArray | float, still: NDArray) -> float:
    return float(np.median(np.broadcast_to(value, still.shape)[still])) if still.any() else 0.0


def _largest(value: NDArray | float, still: NDArray) -> float:
    return float(np.max(np.broadcast_to(value, still.shape)[still], initial=0.0))


def _slower(flt: ErrorFilter, parked: ParkedConstraint) -> ParkedConstraint:
    """The constraint with the noise that its innovations show from step to step: where they are
    alike for several steps (a swell of a minute), so many steps say as much as one.
    """
    seen = flt.tally.normalised
    place = max((_alike(seen[name]) for name in ("still", "stop") if name in seen), default=1.0)
    yaw = _alike(seen["heading held"]) if "heading held" in seen else 1.0
    return replace(
        parked,
        displacement_sigma_m=np.sqrt(place) * parked.displacement_sigma_m,
        yaw_jitter_rad=np.sqrt(yaw) * parked.yaw_jitter_rad,
    )


def _alike(normalised: NDArray) -> float:
    """How many successive innovations (n, r) say as much as one: 1 + 2 sum of their correlations up
    to the first that is not certain.
    """
    n, steps = len(normalised), 1.0
    if n < FEWEST_ALIKE:
        return steps
    power = np.mean(normalised**2)
    for lag in range(1, n // 2):
        rho = float(np.mean(normalised[lag:] * normalised[:-lag]) / power)
        if rho < max(LEAST_ALIKE, 3.0 / np.sqrt(normalised.size)):
            break
        steps += 2.0 * rho
    return steps


def _strayed(flt: ErrorFilter, plan: StepPlan, parked: ParkedConstraint) -> ParkedConstraint:
    """The constraint with the steps that stand out given the variance that they show; itself where
    none does.
    """
    still = np.flatnonzero(plan.kind == STILL)
    seen = [flt.tally.normalised[n] for n in ("still", "stop") if n in flt.tally.normalised]
    if not seen or len(still) != sum(map(len, seen)):
        return parked
    square = np.sum(np.concatenate(seen) ** 2, axis=1)
    out = square > STRAYS
    if not out.any():
        return parked
    wider = np.ones(len(plan.kind))
    wider[still[out]] = np.sqrt((FREEDOM + square[out]) / (FREEDOM + 2.0))
    place = wider * parked.displacement_sigma_m
    moved = np.hypot(parked.place_walk_m, place)
    return replace(
        parked,
        displacement_sigma_m=place,
        place_walk_m=np.where(wider > 1.0, moved, parked.place_walk_m),
    )
