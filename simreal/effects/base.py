"""What an effect is: parameters with units and bounds, its trace in a run, its injection, and its
rivals.

An effect is a class with one implementation that serves three jobs: injected into a simulation,
signature for the diagnosis, and the simulation with the effect added. Users register their own
under the entry point group `recal.effects` (see examples/own_effect.py).

Decision: docs/decisions/0027-effect-parts.md.
Decision: docs/decisions/0028-effects-are-formulas.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from simreal.effects.telemetry import Telemetry, Trace

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


@dataclass(frozen=True)
class CatalogueEffect:
    """Base of the catalogue's effects: the fields of the protocol, and nothing added. Subclasses
    override.

    log_prior : added to its log Bayes factor in nats; below 0 for what is gross or not there at
    all, and for effects of
        one name on one target, which share the prior of one.
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

    def needs(self, runs: Sequence[Telemetry], target: str) -> str:
        return ""

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        return ()

    def noise(self, run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
        return ()

    def most(self, row_dt_s: float) -> float:
        """The largest coefficient of a noise that rows this far apart can have."""
        return np.inf
