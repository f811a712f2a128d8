"""What the key `simulator` of diagnosis.json holds: a field is a key."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class GapValueRecord:
    """RMS per run beyond noise with its 95 % interval, and as measured, noise included; of the NIS
    the mean square per degree of freedom, 1 where there is no gap.
    """

    value: float
    interval_95: tuple[float, ...]
    measured: float


@dataclass(frozen=True, kw_only=True)
class GoneValueRecord:
    """Share of the squared gap that is gone."""

    fraction: float
    interval_95: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class QuantityRecord:
    """A quantity of the update over all predicted runs, by the twin as it was and with what was
    found. noise: RMS that the twin expects of noise alone.
    """

    quantity: str
    unit: str
    runs: int
    noise: float
    before: GapValueRecord
    after: GapValueRecord
    gone: GoneValueRecord


@dataclass(frozen=True, kw_only=True)
class EffectQuantityRecord:
    """The gap of a quantity with this effect alone in the twin, and with all others but it."""

    quantity: str
    unit: str
    alone: GapValueRecord
    alone_gone: GoneValueRecord
    without: GapValueRecord


@dataclass(frozen=True, kw_only=True)
class EffectOnPredictionRecord:
    """An effect in the fits: how many found it, and what a prediction gains by it. predicted: False
    of what belongs to one run alone, or is no part of an update.
    """

    effect: str
    target: str
    fits: int
    predicted: bool
    quantities: tuple[EffectQuantityRecord, ...]


@dataclass(frozen=True, kw_only=True)
class RunQuantityRecord:
    """Measured less predicted in one run, and one sigma of it by noise; of the NIS the values per
    degree of freedom. The drift has two values, of gyros x and y.
    """

    quantity: str
    unit: str
    before: tuple[float, ...]
    after: tuple[float, ...]
    sigma_before: tuple[float, ...]
    sigma_after: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class PredictedRunRecord:
    """A run, the runs that the twin was fitted to for it, and what was found in those."""

    run_id: str
    fitted_to: tuple[str, ...]
    found: tuple[str, ...]
    quantities: tuple[RunQuantityRecord, ...]


@dataclass(frozen=True, kw_only=True)
class UnpredictedRecord:
    """A run that was not predicted."""

    run_id: str
    why: str


@dataclass(frozen=True, kw_only=True)
class SimulatorRecord:
    """How well the twin predicts the update of runs that it was not fitted to."""

    fits: int
    quantities: tuple[QuantityRecord, ...]
    effects: tuple[EffectOnPredictionRecord, ...]
    runs: tuple[PredictedRunRecord, ...]
    not_predicted: tuple[UnpredictedRecord, ...]
