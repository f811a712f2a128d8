"""What a fit of a twin found: parameters with sigmas, what each rests on, and curves to draw."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from numpy.typing import NDArray

from ins.records import TwinModel
from simreal.twin.fit.streams import Line
from simreal.twin.reasons import Why


class Needs(StrEnum):
    """The unit of what a recording lacks."""

    PARKED_SECONDS = "parked_s"
    RUNS = "runs"
    NOTHING = ""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number of a twin.

    name: section and key; value, sigma: of the twin that is written; low, high: 95 % (one-sided
    limit in `high` where not identified); believed: before; seconds: parked time that it rests on;
    why: code where not identified; needed: how much of `needs` in one recording would identify it
    (infinite: none of a week).
    """

    name: str
    value: float
    sigma: float
    low: float
    high: float
    identified: bool
    believed: float
    seconds: float
    nats: float | None = None
    why: Why | None = None
    needs: Needs = Needs.NOTHING
    needed: float = float("nan")


@dataclass(frozen=True, kw_only=True)
class ChannelCurve:
    """A channel's spectrum and Allan deviation, of the data and of the fitted model.

    hz, power, model (b,): two-sided spectrum [unit^2/Hz], dof (b,) behind each power; tau_s, allan,
    allan_model (k,), allan_low, allan_high (k,): 95 % of what the model leads one to expect.
    """

    channel: str
    hz: NDArray
    power: NDArray
    model: NDArray
    dof: NDArray
    tau_s: NDArray
    allan: NDArray
    allan_model: NDArray
    allan_low: NDArray
    allan_high: NDArray
    p_value: float


@dataclass(frozen=True, kw_only=True)
class RunUsed:
    """A run of a fit, or why it was not used; parked_s: at rest and still."""

    run_id: str
    sha256: str
    parked_s: float
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class TwinFit:
    """A fitted twin.

    covariance: of the parameters `names`; differ: per triad the p-value that its axes are alike and
    the white noise of each; axes: of each channel the variances of its white noise and of its
    quantisation over those of the twin, where its triad's differ; shared (3,): largest share of a
    band of a gyro that the vehicle made; read_below_hz: of each triad whose rows a filter has
    smoothed, the frequency up to which they were read; rocked: channels that people or wind move,
    of which nothing below GEAR_BELOW_HZ was read in one of the runs.
    """

    twin: TwinModel
    parameters: tuple[Parameter, ...]
    names: tuple[str, ...]
    covariance: NDArray
    curves: tuple[ChannelCurve, ...]
    lines: tuple[Line, ...]
    runs: tuple[RunUsed, ...]
    differ: Mapping[str, float]
    axis_white: Mapping[str, float]
    axes: Mapping[str, tuple[float, float]]
    shared: NDArray
    left_out: Mapping[str, float]
    seconds: float
    read_below_hz: Mapping[str, float]
    rocked: tuple[str, ...]

    def of(self, name: str) -> Parameter:
        """The parameter of a name."""
        return next(p for p in self.parameters if p.name == name)
