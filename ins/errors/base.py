"""What an error is: parameters with units and usual sizes, what it adds to a run, what it is in
words, and what estimators assume of it.

It is declared once, and one implementation serves the simulation, the diagnosis and the plan; its
priors are those of the estimators. Users register their own under the entry point group
`recal.errors` (examples/own_effect.py).

Decision: docs/decisions/0028-effects-are-formulas.md.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ins.errors.prior import Prior
from ins.errors.telemetry import Telemetry, Trace, on_axis
from ins.records import InputError

GYROS = ("gyro_x", "gyro_y", "gyro_z")
ACCELS = ("accel_x", "accel_y", "accel_z")
AXIS = {name: k for names in (GYROS, ACCELS) for k, name in enumerate(names)}
Shape = Mapping[str, float]
# the name that slow processes share (flicker, random walk, Gauss-Markov): tied to nothing logged
SLOW_NAME = "slow_variation"


@dataclass(frozen=True)
class Coefficient:
    """A linear parameter: the trace is proportional to it.

    unit : as in the name of the field's data sheets; low, high : its usual size (absolute value)
    for a navigation-grade unit after factory compensation. A size outside is named and flagged,
    never excluded. signed: False for what can only add (an RMS, a dead band).
    """

    name: str
    unit: str
    low: float
    high: float
    signed: bool = True


@dataclass(frozen=True)
class ShapeParameter:
    """A parameter that the trace is not linear in (time constant, onset, period), with bounds and a
    grid for the scan.

    spread "log": bounds and grid are geometric. of_time: the bounds are cut to the run (an onset).
    """

    name: str
    unit: str
    low: float
    high: float
    steps: int
    spread: str = "log"
    of_time: bool = False

    def grid(self, low: float | None = None, high: float | None = None) -> NDArray:
        """Values of the scan between the bounds (or tighter ones)."""
        a, b = self.low if low is None else low, self.high if high is None else high
        if self.steps == 1:
            return np.array([np.sqrt(a * b) if self.spread == "log" else 0.5 * (a + b)])
        return (
            np.geomspace(a, b, self.steps)
            if self.spread == "log"
            else np.linspace(a, b, self.steps)
        )


@dataclass(frozen=True)
class AddedNoise:
    """Noise that an effect adds to one channel, per unit of its coefficient squared (variances
    add).

    Densities of a channel of rate (gyro, rad/s) or specific force (accel, m/s^2), then the others::

        white     two-sided PSD
        flicker   B^2
        walk      K^2 [per s]
        markov    variance with correlation time markov_tau_s
        bounded   variance of a white, bounded angle or velocity whose difference is read
                  (quantisation)
        sway      variance of the velocity of the twin's sway oscillator, level accelerometers only
        sample    variance of a sample: odometer, gnss; of temperature [degC^2] the thermometer's
                  white noise
        profile   (n,) variance factor over the run's instants where the noise is not steady;
                  None: 1
    """

    channel: str
    white: float = 0.0
    flicker: float = 0.0
    walk: float = 0.0
    markov: float = 0.0
    markov_tau_s: float = 0.0
    bounded: float = 0.0
    sway: float = 0.0
    sample: float = 0.0
    profile: NDArray | None = field(default=None, compare=False)


@runtime_checkable
class Effect(Protocol):
    """The protocol that users' own effects follow as well.

    Attributes
    ----------
    id, name : str
        Short key, unique; name as in reports (effects.md section 2).
    targets : tuple of str
        Channels it may sit on.
    repeats : str
        "R" repeats from run to run (one coefficient for all), "P" has one of its own in each run,
        "E" is an event of one run, "S" stochastic.
    coefficients, shape : tuples
        Its parameters.
    rivals : tuple of str
        Names it is easily confused with, and why it matters.
    """

    @property
    def id(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def targets(self) -> tuple[str, ...]: ...
    @property
    def repeats(self) -> str: ...
    @property
    def coefficients(self) -> tuple[Coefficient, ...]: ...
    @property
    def shape(self) -> tuple[ShapeParameter, ...]: ...
    @property
    def rivals(self) -> tuple[str, ...]: ...

    def needs(self, runs: Sequence[Telemetry], target: str) -> str:
        """What the runs lack for this effect to be seen at all ("turns", "a gyro temperature");
        empty: nothing.
        """

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        """Trace of one unit of each coefficient in a run; empty traces for a purely stochastic
        effect.
        """

    def noise(self, run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
        """Noise added by one unit of the (single) coefficient; empty for a deterministic effect."""


Formula: TypeAlias = Callable[[Telemetry, str, Shape], tuple[Trace, ...]]
NoiseFormula: TypeAlias = Callable[[Telemetry, str, Shape], tuple[AddedNoise, ...]]
Need: TypeAlias = Callable[[Sequence[Telemetry], str], str]


@dataclass(frozen=True, kw_only=True)
class Words:
    """Four sentences on an error, for the reference page and reports.

    Parameters
    ----------
    what : str
        Physically.
    brought_on_by : str
        What has to happen for it to show.
    size : str
        What its usual size means to a user, or how it depends on the unit.
    remedy : str
        What to do about it.
    """

    what: str
    brought_on_by: str
    size: str
    remedy: str


@dataclass(frozen=True)
class ErrorSource:
    """An error, declared once; base of users' own, which may override the three methods.

    Parameters
    ----------
    id, name, targets, coefficients, shape, repeats, rivals
        As in `Effect`. A rival that names this error in turn need not be named again.
    source : str
        Where it is described.
    log_prior : float
        Added to its log Bayes factor in nats; below 0 for what is gross or not there at all, and
        for errors of one name on one target, which share the prior of one.
    number : str
        Of its row in effects.md; empty for a user's own.
    words : Words or None
    formula, noise_formula, need : callable or None
        What the methods `traces`, `noise` and `needs` call.
    out_of_reach : str
        What is needed beyond a log of this format: never found, always listed with that.
    priors : tuple of Prior
        Of the estimators that carry it.
    twin : tuple
        Section and key of the twin that declares its size, and the unit of the key over that of
        the coefficient; empty for none.
    diagnosed : bool
        False where only estimators know it: no hypothesis of a diagnosis.
    """

    id: str
    name: str
    targets: tuple[str, ...]
    coefficients: tuple[Coefficient, ...]
    shape: tuple[ShapeParameter, ...] = ()
    repeats: str = "R"
    rivals: tuple[str, ...] = ()
    source: str = ""
    log_prior: float = 0.0
    number: str = ""
    words: Words | None = None
    formula: Formula | None = None
    noise_formula: NoiseFormula | None = None
    need: Need | None = None
    out_of_reach: str = ""
    priors: tuple[Prior, ...] = field(default=(), compare=False)
    twin: tuple[str, str, float] | tuple[()] = ()
    diagnosed: bool = True

    def prior(self, recipe: str, part: str = "") -> Prior:
        """What an estimator assumes of it; LookupError where that one does not carry it."""
        for prior in self.priors:
            if recipe in prior.recipes.split() and prior.part == part:
                return prior
        raise LookupError(f"{self.id}: no prior of {recipe} {part}")

    def prior_of(self, recipe: str, coefficient: Coefficient) -> Prior | None:
        """What an estimator assumes of one coefficient: the prior of that part, else of the whole;
        None where it does not carry it. InputError where that is in another unit.
        """
        for prior in sorted(self.priors, key=lambda prior: prior.part == ""):
            if recipe in prior.recipes.split() and prior.part in (coefficient.name, ""):
                if prior.unit != coefficient.unit:
                    raise InputError(
                        f"error {self.id}: prior in {prior.unit!r}, needed {coefficient.unit!r}"
                    )
                return prior
        return None

    @property
    def is_noise(self) -> bool:
        """Whether its coefficient is the size of a noise."""
        return self.noise_formula is not None or self.repeats == "S"

    def needs(self, runs: Sequence[Telemetry], target: str) -> str:
        """What the runs lack, see `Effect`."""
        if self.need is None:
            return self.out_of_reach
        return self.need(runs, target)

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        """What it adds to a run, see `Effect`. InputError where no log shows it."""
        if self.out_of_reach:
            raise InputError(
                f"{self.name}: no trace in a log of this format, needed {self.out_of_reach}"
            )
        return self.formula(run, target, shape) if self.formula else ()

    def noise(self, run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
        """Noise that it adds to a run, see `Effect`."""
        return self.noise_formula(run, target, shape) if self.noise_formula else ()

    def most(self, row_dt_s: float) -> float:
        """The largest coefficient of a noise that rows this far apart can have."""
        return np.inf


def error(
    number: str,
    name: str,
    targets: tuple[str, ...],
    coefficients: tuple[Coefficient, ...] = (),
    *,
    id: str = "",
    kind: type[ErrorSource] = ErrorSource,
    **fields: Any,
) -> ErrorSource:
    """A declaration; the id is the name unless given, `fields` are those of `ErrorSource`."""
    return kind(id or name, name, targets, coefficients, number=number, **fields)


COEFFICIENT = "coefficient"  # of an error that has one


def one(unit: str, low: float, high: float, *, signed: bool = True) -> tuple[Coefficient, ...]:
    """The single coefficient of an error, with its usual size."""
    return (Coefficient(COEFFICIENT, unit, low, high, signed),)


def several(names: Sequence[str], unit: str, low: float, high: float) -> tuple[Coefficient, ...]:
    """Coefficients of one unit and size."""
    return tuple(Coefficient(name, unit, low, high) for name in names)


def on_gyro(target: str, *series_rad_s: NDArray) -> tuple[Trace, ...]:
    """One trace for each series (n,) [rad/s] on the target's gyro."""
    return tuple(Trace(gyro_rad_s=on_axis(series, AXIS[target])) for series in series_rad_s)


def on_accel(target: str, *series_m_s2: NDArray) -> tuple[Trace, ...]:
    """One trace for each series (n,) [m/s^2] on the target's accelerometer."""
    return tuple(Trace(accel_m_s2=on_axis(series, AXIS[target])) for series in series_m_s2)
