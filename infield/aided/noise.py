"""How much larger than declared the noise of a log is, by the aided filter's own innovations.

The declared noise stands wherever the innovations fit it. Where they do not, factors are raised,
and lowered for fixes alone (`narrower`): white noise of the sensors, walks of their biases, how far
the accelerometers' biases go with the shaking of the vehicle (a copter that takes off: 2 to 3 m/s^2
where they clip), sigmas of the satellite positions and of the velocities, all by the likelihood of
the innovations, with the antenna free (`infield.aided.antenna`), so that no lever arm or delay
passes for noise. A slow error of the positions, which hides in innovations that fit, is tried in
any case, one for each of two types of fixes. NIS is then near one by construction and tests nothing
any more; the document says so and keeps the first.

Decision: docs/decisions/0037-receiver-errors-and-noise.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from alignment.gyrocompass import nis_verdict
from ins.errors.catalogue import prior
from ins.estimation.choice import Level, Sizes, climb, powers_of_two
from ins.filters.aided_filter import KINDS
from ins.filters.aided_records import USED, AidedHistory, AidedNoise, Antenna
from ins.robust import chi2

# mean NIS above its band but below this is said, not acted on; sigmas 10 % too small: 1.1^2 is 1.21
MATERIAL = 1.2
# chosen: of the sigmas that fixes are declared with, at half of which and below innovations show
# another receiver than the declared one; a receiver that declares its whole error, half of it slow,
# has 0.7 of that from fix to fix
TOO_WIDE = 0.5
# of the declared sigma of positions, below which what they scatter by from one to the next leaves
# something that this does not show: as much as MATERIAL is above (1.2^-0.5)
SHOWS_LESS = 0.91
# s; as long as any: what is declared and does not show in innovations is no less after an hour
UNSHOWN_S = 800.0
CHANGE_GAIN_NATS = 5.0  # of likelihood that a change must bring; odds of e^5, 150 to 1
COARSE, FINE = 2, 1  # doublings of a factor in a step of the search; chosen: 5 steps to 1024
TYPE_STRIDES = (2, 4, 6)  # from no slow error to one of 1, 4 or 16 times the declared sigma
# factors that are tried; a slow error, and biases that move with the shaking, may be none
SLOW_FACTORS = (0.0, *powers_of_two(0.5, 64.0))
GRIDS: Mapping[str, tuple[float, ...]] = {
    "white": powers_of_two(1.0, 1024.0),
    "walk": powers_of_two(1.0, 1024.0),
    "accel_white": powers_of_two(1.0, 4096.0),
    "accel_walk": powers_of_two(1.0, 1024.0),
    "stirred": (0.0, *powers_of_two(0.0625, 4.0)),
    "slow": SLOW_FACTORS,
    "slow_s": powers_of_two(100.0, 800.0),
    "slow_velocity": SLOW_FACTORS,
    "slow_velocity_s": powers_of_two(0.75, 48.0),
    "slow_other": SLOW_FACTORS,
}
OF_OTHER_TYPE = "slow_other"  # is looked for where a log has fixes of two types
OF_WHAT = {"slow_s": "slow", "slow_velocity_s": "slow_velocity"}  # time constants
SENSOR_PARTS = ("white", "walk", "accel_white", "accel_walk")  # gyros, then accelerometers
# all but "stirred", which is looked for by itself
STEADY_PARTS = tuple(name for name in GRIDS if name != "stirred")
SLOW_PARTS = ("slow", "slow_s", "slow_velocity", "slow_velocity_s", OF_OTHER_TYPE)
# factors on sensors from which on no noise explains a log; white noise of MEMS accelerometers
# stands out: 60 m/s^2 of vibration, beyond which autopilots warn, sampled at 50 Hz are 8 000 times
# the declared 100 ug/sqrt(Hz)
BELIEVED = {"mems": 1024.0, "fog": 32.0, "rlg": 32.0}
BELIEVED_ACCEL_WHITE = {"mems": 4096.0, "fog": 32.0, "rlg": 32.0}
GNSS_PASSES, SEARCH_PASSES = 3, 1
# share of rejected fixes up to which they are the receiver's outliers; a log with 28 of 679
# (0.04) needed no more noise without them
MAX_OUTLIERS = 0.1


@dataclass(frozen=True, kw_only=True)
class NoiseScales:
    """Factors on declared sigmas; slow, slow_velocity: on those of a position and a velocity, for
    slow errors of time constants slow_s, slow_velocity_s [s]; slow_other: as slow, of fixes of the
    other type. stirred: as in `AidedNoise`.
    """

    white: float = 1.0
    walk: float = 1.0
    accel_white: float = 1.0
    accel_walk: float = 1.0
    stirred: float = 0.0
    position: float = 1.0
    velocity: float = 1.0
    slow: float = 0.0
    slow_s: float = prior("gnss_slow_error", "replay", "position").scale
    slow_velocity: float = 0.0
    slow_velocity_s: float = prior("gnss_slow_error", "replay", "velocity").scale
    slow_other: float = 0.0

    @property
    def fitted(self) -> bool:
        return self != replace(NOTHING, slow_s=self.slow_s, slow_velocity_s=self.slow_velocity_s)

    @property
    def accelerometers_as_declared(self) -> bool:
        return self.accel_white == self.accel_walk == 1.0

    @property
    def of_both_types(self) -> "NoiseScales":
        """Slow errors of both types of fixes where one has any: half the sigma that the receiver
        gives to the other at least, for the same sky makes both, and one that is below the white
        noise does not show in the innovations.
        """
        if not self.slow and not self.slow_other:
            return self
        least = SLOW_FACTORS[1]
        return replace(self, slow=max(self.slow, least), slow_other=max(self.slow_other, least))

    def beyond(self, technology: str) -> tuple[str, ...]:
        """Names of the sensors' factors that no noise of a technology explains."""
        return tuple(
            name for name in SENSOR_PARTS if getattr(self, name) >= believed(name, technology)
        )

    def sensors_as(self, other: "NoiseScales") -> bool:
        """Whether no sensor is noisier by more than a fine step than under other factors."""
        return all(
            getattr(self, name) <= 2.0**FINE * getattr(other, name)
            for name in (*SENSOR_PARTS, "stirred")
        )

    @property
    def capped(self) -> tuple[str, ...]:
        """Names of the factors that stand at the largest that is tried."""
        return tuple(
            name
            for name, grid in GRIDS.items()
            if name not in OF_WHAT and getattr(self, name) >= grid[-1]
        )

    def of(
        self,
        noise: AidedNoise,
        level_m: float,
        down_m: float,
        velocity_m_s: float,
        other_m: tuple[float, float] = (0.0, 0.0),
    ) -> AidedNoise:
        """The noise under these factors, from the declared sigmas of a position and a velocity;
        other_m: of a position of the other type, level and down.
        """
        return replace(
            noise,
            arw=self.white * noise.arw,
            vrw=self.accel_white * noise.vrw,
            gyro_walk=self.walk * noise.gyro_walk,
            accel_walk=self.accel_walk * noise.accel_walk,
            stirred=self.stirred,
            slow_level_m=self.slow * level_m,
            slow_down_m=self.slow * down_m,
            slow_s=self.slow_s,
            slow_velocity_m_s=self.slow_velocity * velocity_m_s,
            slow_velocity_s=self.slow_velocity_s,
            slow_other_level_m=self.slow_other * other_m[0],
            slow_other_down_m=self.slow_other * other_m[1],
        )


NOTHING = NoiseScales()


def believed(name: str, technology: str) -> float:
    """The factor on a sensor from which on no noise explains a log."""
    of = BELIEVED_ACCEL_WHITE if name == "accel_white" else BELIEVED
    return of[technology]


@dataclass(frozen=True, kw_only=True)
class Model:
    """What a log is flown with beside its declared noise."""

    antenna: Antenna
    scales: NoiseScales = field(default_factory=NoiseScales)


class Fly(Protocol):
    """Navigates a log from its start, the whole of it or the part that models are fitted on; None
    where no start is found. technology: of the log's unit; two_types: whether its fixes are of two
    types, each with a slow error of its own.
    """

    @property
    def technology(self) -> str: ...

    @property
    def two_types(self) -> bool: ...

    @property
    def typical(self) -> float:
        """Median level sigma of the fixes, over the one that was declared for the log."""
        ...

    def scatter(self, history: AidedHistory) -> float:
        """What positions change by from one to the next beside the sensors' way, over what their
        declared sigmas allow for.
        """
        ...

    def __call__(self, model: Model, *, whole: bool = False) -> AidedHistory | None: ...


@dataclass(frozen=True)
class Flown:
    model: Model
    history: AidedHistory

    def over(self, other: "Flown") -> float:
        """Log likelihood ratio to another flight of the same log, over the fixes that both saw; a
        rejected one counts as if at the gate.
        """
        mine, others = self.history.loglik, other.history.loglik
        seen = np.isfinite(mine) & np.isfinite(others)
        return float((mine[seen] - others[seen]).sum())


def flown(model: Model, fly: Fly) -> Flown | None:
    history = fly(model)
    return None if history is None else Flown(model, history)


def raised_noise(
    start: Flown,
    fly: Fly,
    names: tuple[str, ...] = STEADY_PARTS,
    *,
    strides: tuple[int, ...] = (COARSE, FINE),
) -> Flown:
    """The likeliest factors of these names, antenna as in `start`. The sigmas of the fixes go with
    them where white noise does.
    """
    names = tuple(name for name in names if name != OF_OTHER_TYPE or fly.two_types)
    refit = "white" in names
    best = with_gnss(start, fly) if refit else start
    best, _ = climb(
        best,
        [Level(name, GRIDS[name], getattr(best.model.scales, name)) for name in names],
        lambda sizes, at: _under(at, fly, sizes, refit=refit),
        Flown.over,
        least_nats=CHANGE_GAIN_NATS,
        strides=strides,
    )
    return best


def _under(at: Flown, fly: Fly, sizes: Sizes, *, refit: bool) -> Flown | None:
    """The flight under other factors; None where they make none, as the time constant of a slow
    error that is not there.
    """
    scales = replace(at.model.scales, **sizes)
    absent = [name for name, of in OF_WHAT.items() if getattr(scales, of) == 0.0]
    scales = replace(scales, **{name: getattr(at.model.scales, name) for name in absent})
    if fly.two_types:
        scales = scales.of_both_types
    if scales == at.model.scales:
        return None
    other = flown(replace(at.model, scales=scales), fly)
    return with_gnss(other, fly, passes=SEARCH_PASSES) if refit and other is not None else other


def with_gnss(
    at: Flown, fly: Fly, *, whole: bool = False, lower: bool = True, passes: int = GNSS_PASSES
) -> Flown:
    """The satellite sigmas at which the NIS of each kind is one, not below declared or what they
    were lowered to; `lower` False: raised at most.
    """
    for _ in range(passes):
        scales = at.model.scales
        factor = [np.sqrt(capped_nis(at.history, k)) for k in range(2)]
        if not lower:
            factor = [max(f, 1.0) if misfit(at.history, k) else 1.0 for k, f in enumerate(factor)]
        changed = {
            name: float(max(getattr(scales, name) * f, min(getattr(scales, name), 1.0)))
            for name, f in zip(KINDS, factor)
        }
        if all(abs(changed[name] / getattr(scales, name) - 1.0) < 0.02 for name in KINDS):
            break
        model = replace(at.model, scales=replace(scales, **changed))
        history = fly(model, whole=whole)
        if history is None:
            break
        at = Flown(model, history)
    return at


def with_types(at: Flown, fly: Fly) -> Flown:
    """The flight with the likeliest of a few slow errors where a log has fixes of two types.

    A search by steps does not find them: while the first step is too small for the leaps between
    the types, the gate rejects these, and a rejected fix counts for little.
    """
    if not fly.two_types:
        return at
    return raised_noise(at, fly, ("slow", OF_OTHER_TYPE), strides=TYPE_STRIDES)


def narrower(at: Flown, fly: Fly) -> Flown:
    """The flight with the sigmas that the innovations show, where fixes are declared twice as wide
    and more and that is likelier.

    What a receiver declares is its whole error. What the innovations do not show of that of a
    position is taken for a slow error until the log says otherwise (`raised_noise`): a fix that
    repeats to a decimetre need not be good to one. A velocity is of the Doppler shifts of its own
    moment. Receivers that smooth their positions have errors that last for seconds, neither white
    nor slow: with narrow sigmas the sensors would stand for these, and what is learned so is not
    taken (`NoiseScales.sensors_as`).
    """
    best, lowered = at, dict.fromkeys(KINDS, 1.0)
    for _ in range(GNSS_PASSES):
        shown = {name: float(np.sqrt(capped_nis(best.history, k))) for k, name in enumerate(KINDS)}
        factors = {name: min(lowered[name] * shown[name], 1.0) for name in KINDS}
        factors = {name: f if f <= TOO_WIDE else 1.0 for name, f in factors.items()}
        if factors == lowered:
            break
        scales = replace(at.model.scales, **factors)
        if factors["position"] < 1.0:
            slow = unshown(fly, factors["position"])
            scales = replace(scales, slow=max(slow, 1.0), slow_s=UNSHOWN_S)
        if fly.two_types:
            scales = scales.of_both_types
        other = flown(replace(at.model, scales=scales), fly)
        if other is None or other.over(best) < CHANGE_GAIN_NATS:
            break
        best, lowered = other, factors
    return best


def unshown(fly: Fly, shown: float) -> float:
    """The slow error that is left of declared sigmas of positions, of which this share shows; a
    factor as `NoiseScales.slow`.
    """
    slow = fly.typical * float(np.sqrt(max(1.0 - shown**2, 0.0)))
    return float(np.clip(slow, 0.0, SLOW_FACTORS[-1]))


def with_unshown(at: Flown, fly: Fly) -> NoiseScales:
    """The factors with a slow error of the positions as large as what is declared and does not show
    from fix to fix.

    A sigma that is declared and does not show is no noise that averages out: if it is there at all,
    it lasts. Fixes of 0.5 m declared with 1 m and off by 1 m for minutes were averaged to 0.1 m.
    No likelihood speaks against it: an error that stays moves no innovation. So sigmas that were
    lowered (`narrower`) have it too.
    """
    scales = at.model.scales
    shown = fly.scatter(at.history)
    slow = unshown(fly, shown)
    if shown > SHOWS_LESS or slow <= scales.slow:
        return scales
    scales = replace(scales, slow=slow, slow_s=UNSHOWN_S)
    return scales.of_both_types if fly.two_types else scales


def capped_nis(history: AidedHistory, kind: int) -> float:
    """NIS per degree of freedom of a kind; 1 where there is none.

    Rejected fixes are left out where they are few, the receiver's own outliers. Where they are more
    than MAX_OUTLIERS of all, the median over all tells the noise: of white noise that is declared
    too small it is as wrong as the mean, and leaps and wild fixes, up to half of all, leave it.
    """
    nis, few = _counted(history, kind)
    if not nis.size:
        return 1.0
    return float(nis.mean() / 3.0 if few else np.median(nis) / float(chi2.ppf(0.5, 3)))


def misfit(history: AidedHistory, kind: int) -> bool:
    """Whether the innovations of a kind are larger than their noise allows, and by an amount that
    matters.
    """
    mean = capped_nis(history, kind)
    return mean > MATERIAL and nis_verdict(mean, 3 * _counted(history, kind)[0].size) is not None


def misfits(history: AidedHistory) -> bool:
    return any(misfit(history, k) for k in range(2))


def _counted(history: AidedHistory, kind: int) -> tuple[NDArray, bool]:
    """The NIS that tell the noise of a kind; whether those left out of them are few."""
    nis = history.nis[:, kind]
    seen, outside = np.isfinite(nis), history.used[:, kind] != USED
    few = bool((seen & outside).sum() <= MAX_OUTLIERS * seen.sum())
    return (nis[seen & ~outside] if few else nis[seen]), few
