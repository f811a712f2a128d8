"""Kinds of one error: some of its coefficients alone, and errors that share a prior."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from math import log

from ins.errors.base import ErrorSource, Shape
from ins.errors.telemetry import Telemetry, Trace


@dataclass(frozen=True)
class EachAlone:
    """A formula of `count` traces, each made without the others: alone(run, target, shape, k) is
    that of coefficient k.
    """

    alone: Callable[[Telemetry, str, Shape, int], Trace]
    count: int

    def __call__(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        return tuple(self.alone(run, target, shape, k) for k in range(self.count))


@dataclass(frozen=True)
class PartEffect(ErrorSource):
    """Some coefficients of an effect, the others zero: what acts through one alone does not pay for
    the rest.

    whole : id of that effect. kept : places of the coefficients among its own, so that its traces
    can be used again.
    """

    whole: str = ""
    kept: tuple[int, ...] = ()

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        """Those of the coefficients that are kept."""
        if isinstance(self.formula, EachAlone):
            return tuple(self.formula.alone(run, target, shape, k) for k in self.kept)
        every = super().traces(run, target, shape)
        return tuple(every[k] for k in self.kept)


def with_parts(effect: ErrorSource, *names: str, **renamed: str) -> tuple[ErrorSource, ...]:
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


def sharing_prior(*effects: ErrorSource) -> tuple[ErrorSource, ...]:
    """Effects of one name on one target: together as probable as one."""
    return tuple(replace(e, log_prior=e.log_prior - log(len(effects))) for e in effects)


def _part(effect: ErrorSource, end: str, place: int) -> PartEffect:
    same = {f.name: getattr(effect, f.name) for f in fields(ErrorSource)}
    own = {"id": f"{effect.id}_{end}", "coefficients": (effect.coefficients[place],)}
    return PartEffect(**(same | own), whole=effect.id, kept=(place,))
