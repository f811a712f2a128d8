"""The parked filter under the level of motion that its own residuals show.

Source: innovations likelihood, Schweppe (1965); t-distributed weights, Lange, Little, Taylor
(1989), section 3. Pinned by: tests/alignment/test_parked_level.py
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from alignment.mooring_motion import MooringMotion
from alignment.motion.kinds import STILL
from alignment.motion.level import ParkedLevel
from alignment.navigation_filter import PARKED, ParkedConstraint, StepPlan
from ins.estimation import error_model as em
from ins.estimation.choice import SURE_NATS, Level, climb, powers_of_two
from ins.estimation.error_filter import GATE_SIGMA, ErrorFilter
from ins.kalman import nis_band

FINENESS = 2  # sizes of a parameter for each doubling
STRIDES = (2, 1)  # in sizes: of a parameter in the search, wide ones first
# of a vehicle that stands, per square root of a second: 0.3 m in 20 min. What walks farther swings,
# or rolls.
LARGEST_WALK_M = 0.01
# of one that rolls unseen: 0.04 m by side motion of 0.02 m/s over 2 s, more on a rough road
ROLLING_WALK_M = 0.3
# Swings that are tried: from what several steps of the filter resolve to what a walk describes as
# well; lightly damped (mooring lines), well damped (fenders, a soft quay).
PERIODS_S, DAMPINGS = (30.0, 60.0, 120.0, 240.0), (0.15, 0.5)
FIRST_SWING_M = 0.125
FINER = (2.0**-0.5, 2.0**0.5)  # of period and damping, once the likeliest mooring is known
OF_SWING = 2  # numbers of a mooring beside its RMS: period and damping
# nats by which a place that swings must be likelier than one that walks off. Both are sketches of
# what they stand for: straight rolls of 100 to 900 s gained up to 15, a moored ship 40 in ten
# minutes and 300 in an hour (tests/alignment/test_mooring_motion.py)
COMES_BACK = 20.0
# a moored ship: PIANC (1995) stops work at 1 m of surge
LARGEST_PLACE_M = 1.0
LARGEST_YAW_WALK_RAD = 1e-3
# Of the local level: where the search for a walk over ten seconds and for a larger level begins.
# Place and its walk are alike in size; a heading that people turn by arcseconds walks a hundred
# times its quiet jitter, which may be a gyro's last bit, and less than that shows nothing.
SMALLEST_WALK = 0.25  # of the local level in ten seconds: a variance of 6 % beside it
FIRST_WALKS = {"place": (SMALLEST_WALK,), "yaw": (SMALLEST_WALK, 4.0, 64.0)}
FIRST_FACTORS = {"place": (2.0**0.5,), "yaw": (2.0**0.5, 8.0, 64.0)}
# beyond the largest the likelihood changes no more (LARGEST_PLACE_M, LARGEST_YAW_WALK_RAD)
FACTORS = powers_of_two(1.0, 2.0**20, fineness=FINENESS)
WALKS = powers_of_two(SMALLEST_WALK, 2.0**20, fineness=FINENESS)
GRIDS = {
    "place": FACTORS,
    "place_walk": WALKS,
    "yaw": FACTORS,
    "yaw_walk": WALKS,
    "swing_m": powers_of_two(2.0**-10, LARGEST_PLACE_M, fineness=FINENESS),
}
SHOWN_BY = {"place": ("still", "stop"), "yaw": ("heading held",)}  # measurements of each level
# mean squared innovation over its variance: 10 sigmas on end. A filter that believes in a quiet
# level is led astray by what it is shown
LED_ASTRAY = 100.0
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
    local level, over ten seconds); unit: what multiplies the unit's own noise; swing_m: RMS of a
    place that swings; free: it may walk as far as that of a vehicle that rolls.
    """

    place: float = 1.0
    place_walk: float = 0.0
    yaw: float = 1.0
    yaw_walk: float = 0.0
    unit: float = 1.0
    mooring: MooringMotion | None = None
    swing_m: float = 0.0
    free: bool = False

    def sized(self, **sizes: float) -> "Scale":
        """The scale with other sizes of some parameters."""
        return Scale(**{**self._asdict(), **sizes})


QUIET = Scale()


@dataclass(frozen=True)
class LevelFound:
    """How the parked vehicle moved: RMS of its place, per axis [m], and heading [rad] in the middle
    of its steps and at their roughest, walks of both over ten seconds, scale of the unit's noise;
    sigma_cost: heading sigma under this level over that on a calm vehicle; swing_m, swing_s: RMS
    and period of a place that swings, None where it does not.
    """

    place_m: float
    largest_place_m: float
    place_walk_m: float
    yaw_rad: float
    largest_yaw_rad: float
    yaw_walk_rad: float
    unit_noise: float
    sigma_cost: float
    swing_m: float = 0.0
    swing_s: float | None = None


@dataclass(frozen=True)
class LevelFit:
    """A filter that has run, and the level that it ran under; rolls: its place walks off."""

    filter: ErrorFilter
    parked: ParkedConstraint
    scale: Scale
    rolls: bool = False


class FilterRun(Protocol):
    """A filter over the steps of a pass, from its start."""

    def __call__(
        self, parked: ParkedConstraint, unit: float, *, first_stand: bool = False
    ) -> ErrorFilter:
        """unit: scale of the unit's noise; first_stand: only up to where the vehicle first rolls,
        whose steps are many and say nothing of a stand.
        """


@dataclass(frozen=True)
class SearchInputs:
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
        quiet = float(np.min(held.yaw_jitter_rad))
        return replace(held, displacement_sigma_m=place, yaw_jitter_rad=quiet)

    def constraint(self, scale: Scale) -> ParkedConstraint:
        """How the vehicle is held under a scale."""
        place, yaw = self.level.place_m[self.plan.last], self.level.yaw_rad[self.plan.last]
        dt = self.time_s[self.plan.last] - self.time_s[self.plan.first]
        tenth = np.sqrt(dt / 10.0)
        most = ROLLING_WALK_M if scale.free else LARGEST_WALK_M
        walk = np.minimum(scale.place_walk * place * tenth, most * np.sqrt(dt))
        # gusts are no multiple of the quiet jitter, which may be a gyro's last bit
        quiet = float(np.min(yaw)) if yaw.size else 0.0
        turn = np.minimum(scale.yaw_walk * quiet * tenth, LARGEST_YAW_WALK_RAD * np.sqrt(dt))
        return ParkedConstraint(
            displacement_sigma_m=np.minimum(scale.place * place, LARGEST_PLACE_M),
            yaw_jitter_rad=np.sqrt(yaw**2 + (scale.yaw**2 - 1.0) * quiet**2),
            hold_heading=self.hold_heading,
            place_walk_m=walk,
            yaw_walk_rad=turn,
            gate=np.inf,
            mooring=scale.mooring,
            swing_m=scale.swing_m,
        )


def fit(
    run: FilterRun,
    stretch: SearchInputs,
    units: tuple[float, ...] = (1.0,),
    *,
    rough: bool = False,
    near: Scale = QUIET,
) -> LevelFit:
    """The filter under the likeliest level.

    units: rising scales of the unit's own noise to choose from. Beyond the likeliest, the first
    under which the residuals are no larger than their band is taken, the last where none is.
    rough: of an early pass, whose level is looked for only where a quiet one is absurd. near: what
    was likeliest for a solution close to this one.
    """
    search = _Search(run, stretch)
    scale = QUIET if rough and search.plausible() else search.likeliest(units, near)
    fitted = search.under(scale)
    for unit in units:
        if unit > scale.unit and not explained(fitted.filter):
            fitted = search.under(scale._replace(unit=unit))
    return fitted


def under_given(level: LevelFound, run: FilterRun, stretch: SearchInputs) -> LevelFit:
    """The filter under a level that another stretch of the session showed, nothing searched for."""
    parked = stretch.constraint(QUIET)
    dt = stretch.time_s[stretch.plan.last] - stretch.time_s[stretch.plan.first]
    tenth = np.sqrt(dt / 10.0)
    held = replace(
        parked,
        displacement_sigma_m=np.full(dt.size, level.place_m),
        yaw_jitter_rad=np.full(dt.size, level.yaw_rad),
        place_walk_m=level.place_walk_m * tenth,
        yaw_walk_rad=level.yaw_walk_rad * tenth,
    )
    scale = QUIET._replace(unit=level.unit_noise)
    return LevelFit(run(held, level.unit_noise), held, scale)


def found(fitted: LevelFit, run: FilterRun, stretch: SearchInputs) -> LevelFound:
    """The level that a filter ran under, in numbers."""
    calm = run(stretch.calm(), 1.0)
    flt, parked = fitted.filter, fitted.parked
    still, down = stretch.plan.kind == STILL, em.THETA.stop - 1
    return LevelFound(
        place_m=_middle(parked.displacement_sigma_m, still),
        largest_place_m=_largest(parked.displacement_sigma_m, still),
        place_walk_m=_middle(parked.place_walk_m, still),
        yaw_rad=_middle(parked.yaw_jitter_rad, still),
        largest_yaw_rad=_largest(parked.yaw_jitter_rad, still),
        yaw_walk_rad=_middle(parked.yaw_walk_rad, still),
        unit_noise=fitted.scale.unit,
        swing_m=parked.swing_m,
        swing_s=None if parked.mooring is None else parked.mooring.period_s,
        sigma_cost=float(np.sqrt(flt.P[down, down] / calm.P[down, down])),
    )


def explained(flt: ErrorFilter) -> bool:
    """Whether the filter's residuals are within the band of their chi-square (99.9 %)."""
    dof = sum(flt.tally.dof.values())
    return dof == 0 or sum(flt.tally.nis.values()) / dof <= nis_band(dof, 0.999)[1]


class _Search:
    """Filters over one tape under one scale after another, each run once."""

    def __init__(self, run: FilterRun, stretch: SearchInputs) -> None:
        self._run, self._stretch = run, stretch
        self._values: dict[Scale, float] = {}
        self._quiet: ErrorFilter | None = None
        self.rolls = False

    def under(self, scale: Scale) -> LevelFit:
        """The filter under a scale, single strays widened, what is beyond the gate left out."""
        plan, parked = self._stretch.plan, self._stretch.constraint(scale)
        ungated = self._ungated(scale)
        slower = _slower(ungated, _strayed(ungated, plan, parked))
        strayed = replace(slower, gate=GATE_SIGMA)
        # what was found to walk off under one noise of the unit may stand under another
        rolls = self.rolls and scale.mooring is None and scale.place_walk > 0.0
        return LevelFit(self._run(strayed, scale.unit), strayed, scale, rolls)

    def plausible(self) -> bool:
        """Whether a quiet level leaves residuals that may still be errors of the solution."""
        tally = self._ungated(QUIET).tally
        return all(
            tally.nis[name] < LED_ASTRAY * tally.dof[name] for name in PARKED if name in tally.nis
        )

    def likeliest(self, units: tuple[float, ...], near: Scale = QUIET) -> Scale:
        """The likeliest scale, each parameter beyond its quiet value penalised."""
        if near != QUIET and near.unit == 1.0 and not self._wanders(near._replace(free=True)):
            again = self._needed(self._climb(near, _moved(near)))
            if self._value(again) - _penalty(again) > self._value(QUIET):
                return again
        scale, best = self._with_unit(QUIET, self._value(QUIET))
        for unit in units[1:]:
            louder, alone = scale._replace(unit=unit), QUIET._replace(unit=unit)
            beside = self._value(louder) - self._value(scale)
            if max(beside, self._value(alone) - best) <= SURE_NATS:
                break
            found, value = self._with_unit(alone, -np.inf)
            if value <= best + SURE_NATS:
                break
            scale, best = found, value
        return scale

    def _with_unit(self, scale: Scale, best: float) -> tuple[Scale, float]:
        """The likeliest level beside one scale of the unit's noise, and its penalised value."""
        best = max(best, self._value(scale))
        shown = ("place", "yaw") if self._stretch.hold_heading else ("place",)
        gains = {own: self._most_to_gain(own, scale) for own in shown}
        # what is most off first: it spoils the states that the other is judged by
        for own in sorted(gains, key=lambda own: -gains[own]):
            if self._most_to_gain(own, scale) < 0.5 * SURE_NATS:
                continue
            walk = f"{own}_walk"
            walks = [scale.sized(**{walk: size}) for size in FIRST_WALKS[own]]
            wider = [scale.sized(**{own: size}) for size in FIRST_FACTORS[own]]
            if max(map(self._value, (*walks, *wider))) - SURE_NATS <= best:
                continue
            free = own == "place"
            found = max(  # one explains what the other does, as far as it can: from either side
                self._climb(max(walks, key=self._value)._replace(free=free), (walk, own)),
                self._climb(max(wider, key=self._value)._replace(free=free), (own, walk)),
                key=self._value,
            )
            found = self._swung(found) if self._wanders(found) else found._replace(free=False)
            found = self._needed(found)
            penalty = _penalty(found) - _penalty(scale)
            if self._value(found) - penalty > best:
                best, scale = self._value(found) - penalty, found
        return scale, best

    def _needed(self, scale: Scale) -> Scale:
        """The scale without jitter or walk whose loss the others make up for, to SURE_NATS: a walk
        that gains less is chance, and makes the heading's sigma twice as large.
        """
        moved = [name for name in _moved(scale) if name != "swing_m"]
        for name in moved:
            others = tuple(other for other in moved if other != name)
            without = self._climb(scale.sized(**{name: getattr(QUIET, name)}), others)
            if self._value(without) + SURE_NATS > self._value(scale):
                return self._needed(without)
        return scale

    def _wanders(self, scale: Scale) -> bool:
        """Whether a place that may walk freely walks farther than a vehicle that stands can."""
        most, held = (
            np.max(self._stretch.constraint(scale._replace(free=free)).place_walk_m, initial=0.0)
            for free in (scale.free, False)
        )
        return bool(most > held)

    def _swung(self, walks: Scale) -> Scale:
        """A place that swings where it is likelier than one that walks off."""
        names = ("swing_m", "place", "place_walk")
        stands = QUIET._replace(unit=walks.unit, yaw=walks.yaw, yaw_walk=walks.yaw_walk)
        swings = [
            stands._replace(mooring=MooringMotion(period_s, damping), swing_m=FIRST_SWING_M)
            for period_s in PERIODS_S
            for damping in DAMPINGS
        ]
        best = self._climb(max(swings, key=self._value), names)
        for name in ("period_s", "damping"):
            for factor in FINER:
                assert best.mooring is not None
                finer = replace(best.mooring, **{name: factor * getattr(best.mooring, name)})
                best = max(best, best._replace(mooring=finer), key=self._value)
        best = self._climb(best, names)
        if self._value(best) - _penalty(best) > self._value(walks) - _penalty(walks) + COMES_BACK:
            return best
        self.rolls = True
        return self._climb(walks._replace(free=False), ("place", "place_walk"))

    def _most_to_gain(self, own: str, scale: Scale) -> float:
        """About the log-likelihood [nats] that any level of place or heading could add."""
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
        """Up the likelihood by these parameters."""
        best, _ = climb(
            scale,
            [Level(name, GRIDS[name], getattr(scale, name)) for name in names],
            lambda sizes, _: scale.sized(**sizes),
            lambda one, other: self._value(one) - self._value(other),
            least_nats=HIGHER,
            strides=STRIDES,
        )
        return best

    def _value(self, scale: Scale) -> float:
        """Log-likelihood of what was measured of the standing vehicle."""
        if scale not in self._values:
            parked = self._stretch.constraint(scale)
            told = self._run(parked, scale.unit, first_stand=True).tally.log_likelihood
            self._values[scale] = sum(told.get(name, 0.0) for name in PARKED)
        return self._values[scale]

    def _ungated(self, scale: Scale) -> ErrorFilter:
        if scale != QUIET:
            return self._run(self._stretch.constraint(scale), scale.unit)
        if self._quiet is None:
            self._quiet = self._run(self._stretch.constraint(QUIET), 1.0)
        return self._quiet


def _moved(scale: Scale) -> tuple[str, ...]:
    """The parameters of the level that are beyond their quiet values."""
    names = ("swing_m", "place", "place_walk", "yaw", "yaw_walk")
    return tuple(name for name in names if getattr(scale, name) != getattr(QUIET, name))


def _penalty(scale: Scale) -> float:
    """What a level must gain beyond a quiet one [nats]: SURE_NATS for each number."""
    return SURE_NATS * (len(_moved(scale)) + (0 if scale.mooring is None else OF_SWING))


def _middle(value: NDArray | float, still: NDArray) -> float:
    return float(np.median(np.broadcast_to(value, still.shape)[still])) if still.any() else 0.0


def _largest(value: NDArray | float, still: NDArray) -> float:
    return float(np.max(np.broadcast_to(value, still.shape)[still], initial=0.0))


def _slower(flt: ErrorFilter, parked: ParkedConstraint) -> ParkedConstraint:
    """The constraint with the noise that its innovations show from step to step."""
    seen = flt.tally.normalised
    place = max((_alike(seen[name]) for name in ("still", "stop") if name in seen), default=1.0)
    yaw = _alike(seen["heading held"]) if "heading held" in seen else 1.0
    return replace(
        parked,
        displacement_sigma_m=np.sqrt(place) * parked.displacement_sigma_m,
        yaw_jitter_rad=np.sqrt(yaw) * parked.yaw_jitter_rad,
    )


def _alike(normalised: NDArray) -> float:
    """How many successive innovations (n, r) say as much as one."""
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
    """The constraint with the steps that stand out given the variance that they show."""
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
