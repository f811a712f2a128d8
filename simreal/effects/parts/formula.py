"""Effects written as formulas: one function gives the traces or the noise, one says what recordings
lack.

A declaration in the catalogue names the functions; the class only hands the calls on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from math import log

from ins.records import InputError
from simreal.effects.base import AddedNoise, CatalogueEffect, Shape
from simreal.effects.telemetry import Telemetry, Trace

Formula = Callable[[Telemetry, str, Shape], tuple[Trace, ...]]
NoiseFormula = Callable[[Telemetry, str, Shape], tuple[AddedNoise, ...]]
Need = Callable[[Sequence[Telemetry], str], str]


@dataclass(frozen=True)
class EachAlone:
    """A formula of `count` traces, each made without the others: alone(run, target, shape, k) is
    that of coefficient k.
    """

    alone: Callable[[Telemetry, str, Shape, int], Trace]
    count: int

    def __call__(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        return tuple(self.alone(run, target, shape, k) for k in range(self.count))


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
    """An effect whose methods are functions of (run, target, shape) and of (runs, target)."""

    formula: Formula = no_trace
    noise_formula: NoiseFormula = no_noise
    need: Need = nothing

    def needs(self, runs: Sequence[Telemetry], target: str) -> str:
        return self.need(runs, target)

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        return self.formula(run, target, shape)

    def noise(self, run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
        return self.noise_formula(run, target, shape)


@dataclass(frozen=True)
class PartEffect(FormulaEffect):
    """Some coefficients of an effect, the others zero: what acts through one alone does not pay for
    the rest.

    whole : id of that effect. kept : places of the coefficients among its own, so that its traces
    can be used again.
    """

    whole: str = ""
    kept: tuple[int, ...] = ()

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        if isinstance(self.formula, EachAlone):
            return tuple(self.formula.alone(run, target, shape, k) for k in self.kept)
        every = self.formula(run, target, shape)
        return tuple(every[k] for k in self.kept)


def with_parts(effect: FormulaEffect, *names: str, **renamed: str) -> tuple[FormulaEffect, ...]:
    """An effect, and the same with one coefficient only for each of these (none: for each of its
    own).

    All go by the name of the effect and share the prior of one; a part's id ends in the name of its
    coefficient, or in a key of `renamed`, whose value is that name.
    """
    places = {c.name: k for k, c in enumerate(effect.coefficients)}
    chosen = {name: name for name in names or (() if renamed else places)} | renamed
    return sharing_prior(
        effect, *(_part(effect, end, places[name]) for end, name in chosen.items())
    )


def sharing_prior(*effects: FormulaEffect) -> tuple[FormulaEffect, ...]:
    """Effects of one name on one target: together as probable as one."""
    return tuple(replace(e, log_prior=e.log_prior - log(len(effects))) for e in effects)


def _part(effect: FormulaEffect, end: str, place: int) -> PartEffect:
    same = {f.name: getattr(effect, f.name) for f in fields(FormulaEffect)}
    own = {"id": f"{effect.id}_{end}", "coefficients": (effect.coefficients[place],)}
    return PartEffect(**(same | own), whole=effect.id, kept=(place,))


@dataclass(frozen=True)
class OutOfReach(CatalogueEffect):
    """A known effect that a log of this format does not show: never found, always listed with what
    it needs.
    """

    need: str = ""

    def needs(self, runs: Sequence[Telemetry], target: str) -> str:
        return self.need

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        raise InputError(f"{self.name}: no trace in a log of this format, needed {self.need}")
