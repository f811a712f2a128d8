"""Effects written as formulas: one function gives the traces or the noise, one says what recordings lack.

A declaration in the catalogue names the functions; the class only hands the calls on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ins.records import InputError
from simreal.effects.base import AddedNoise, CatalogueEffect, Shape
from simreal.telemetry import Telemetry, Trace

Formula = Callable[[Telemetry, str, Shape], tuple[Trace, ...]]
NoiseFormula = Callable[[Telemetry, str, Shape], tuple[AddedNoise, ...]]
Need = Callable[[Sequence[Telemetry], str], str]


def no_trace(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Of a purely stochastic effect."""
    return ()


def no_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """Of a deterministic effect."""
    return ()


def nothing(runs: Sequence[Telemetry], target: str) -> str:
    """Any run shows the effect."""
    return ""


@dataclass(frozen=True)
class FormulaEffect(CatalogueEffect):
    """An effect whose methods are functions of (run, target, shape) and of (runs, target).

    log_prior : added to its log Bayes factor in nats; below 0 for what is gross or not there at all.
    """

    formula: Formula = no_trace
    noise_formula: NoiseFormula = no_noise
    need: Need = nothing
    log_prior: float = 0.0

    def needs(self, runs: Sequence[Telemetry], target: str) -> str:
        return self.need(runs, target)

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        return self.formula(run, target, shape)

    def noise(self, run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
        return self.noise_formula(run, target, shape)


@dataclass(frozen=True)
class OutOfReach(CatalogueEffect):
    """A known effect that a log of this format does not show: never found, always listed with what it needs."""

    need: str = ""

    def needs(self, runs: Sequence[Telemetry], target: str) -> str:
        return self.need

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        raise InputError(f"{self.name}: no trace in a log of this format, needed {self.need}")
