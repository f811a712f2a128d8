"""The `effects` of a twin (formats.md, section 3): read, checked against the catalogue, and what
they add to a run.

Parameters are the effect's coefficients and shape parameters by name, each a number in the declared
unit or as in diagnosis.json, {"value": 0.03, "sigma": 0.004, "unit": "deg/h per degC/min"}, so that
a cause can be pasted. `run_id` ties an item to one run; without it, it is in every run. A negative
coefficient of a noise effect means that much less than the twin declares: its square is subtracted.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import pairwise
from math import isfinite
from typing import Any, NoReturn, TypeGuard

from ins.errors.base import ACCELS, GYROS, SLOW_NAME, Effect, ErrorSource
from ins.errors.catalogue import catalogue, effects_named
from ins.errors.table import TABLE_AGED
from ins.errors.telemetry import Telemetry, Trace, total
from ins.errors.unnamed import OF_RUN, OF_TEMPERATURE, OF_TIME
from ins.records import EffectDocument, InputError, ParameterValue, TwinModel
from simreal.declared.node_function import FUNCTIONS, NodeFunction, unit_of
from simreal.evidence.whitened import ExtraNoise

PROCESS, RUN_ID = "process", "run_id"
# of the temperature alone, or a constant of one power-on: the table's own subject, or none of it
LEFT_TO_THE_TABLE = frozenset(
    {
        "gyro_thermal_linear",
        "gyro_thermal_quadratic",
        "gyro_turn_on_bias",
        "compensation_misapplied",
        TABLE_AGED,
        OF_TEMPERATURE,
        OF_TIME,
        OF_RUN,
    }
)
# a coefficient of its own in a run, by the run's id (turn-on biases)
PER_RUN = re.compile(r"(\w+)\[(.+)\]")


@dataclass(frozen=True)
class TwinEffect:
    """One item: coefficients in the effect's declared order and units. run_id "": of every run.

    sigmas : of the coefficients, as a diagnosis found them; 0 where nothing is said.
    """

    effect: Effect
    target: str
    coefficients: tuple[float, ...]
    shape: Mapping[str, float] = field(default_factory=dict)
    run_id: str = ""
    sigmas: tuple[float, ...] = ()

    @property
    def square(self) -> float:
        """Of a noise effect: its coefficient squared, negative where there is less noise than
        declared.
        """
        return self.coefficients[0] * abs(self.coefficients[0])

    @property
    def is_noise(self) -> bool:
        if isinstance(self.effect, ErrorSource):
            return self.effect.is_noise
        return self.effect.repeats == "S"

    def in_run(self, run_id: str) -> bool:
        return self.run_id in ("", run_id)

    def trace(self, run: Telemetry) -> Trace:
        """What it adds to a run; an empty trace for noise."""
        if self.is_noise:
            return Trace()
        unit = self.effect.traces(run, self.target, self.shape)
        return total(trace.scaled(c) for trace, c in zip(unit, self.coefficients, strict=True))


def leaves_the_log(name: str, target: str) -> bool:
    """Whether an update takes an effect that is in every run out of its log: one of a gyro or an
    accelerometer that a table over temperature cannot hold.
    """
    return target in (*GYROS, *ACCELS) and name not in LEFT_TO_THE_TABLE


def twin_traces(effects: Sequence[TwinEffect], run: Telemetry, run_id: str) -> Trace:
    """The sum of the deterministic effects of a run, at the instants of its telemetry."""
    return total(item.trace(run) for item in effects if item.in_run(run_id))


def twin_extra_noise(effects: Sequence[TwinEffect], run_id: str | None = None) -> list[ExtraNoise]:
    """The noise effects as the diagnosis takes them; of one run, where it is given."""
    items = [item for item in effects if item.is_noise and (run_id is None or item.in_run(run_id))]
    return [ExtraNoise(item.effect, item.target, item.shape, item.square) for item in items]


def parse_effects(twin: TwinModel) -> tuple[TwinEffect, ...]:
    """The checked `effects` of a twin. InputError names the twin file, the item and the key, what
    was got and needed.
    """
    items = (
        _Item(f"{twin.source}: effects[{k}]", item).parsed() for k, item in enumerate(twin.effects)
    )
    return tuple(effect for effects in items for effect in effects)


@dataclass(frozen=True)
class _Item:
    """One raw item; `where` begins each error line."""

    where: str
    data: EffectDocument

    def parsed(self) -> tuple[TwinEffect, ...]:
        """One effect; of a function of run one for each run."""
        name, target = str(self.data.get("effect", "")), str(self.data.get("target", ""))
        parameters = self.data.get("parameters", {})
        if not isinstance(parameters, Mapping):
            self._fail("parameters", parameters, "an object of names and numbers")
        given = dict(parameters)
        run_id = given.pop(RUN_ID, "")
        if not isinstance(run_id, str):
            self._fail(f"parameters.{RUN_ID}", run_id, "the id of a run")
        if name in FUNCTIONS:
            return self._function(name, target, given, run_id)
        by_run: dict[str, dict[str, ParameterValue]] = {}
        for key in given:
            if of_one := PER_RUN.fullmatch(key):
                by_run.setdefault(of_one[2], {})[of_one[1]] = given[key]
        if by_run and not run_id:
            rest = {key: value for key, value in given.items() if not PER_RUN.fullmatch(key)}
            each = [{**rest, **own, RUN_ID: run} for run, own in by_run.items()]
            return tuple(
                e
                for one in each
                for e in _Item(self.where, {**self.data, "parameters": one}).parsed()
            )
        effect = self._chosen(name, target, given)
        given.pop(PROCESS, None)
        known = _names(effect)
        for key in given:
            if key not in known:
                self._fail(f"parameters.{key}", key, _nearest(key, known))
        coefficients = tuple(self._number(given, c.name, c.unit) for c in effect.coefficients)
        shape = {
            p.name: self._number(given, p.name, p.unit, positive=p.low > 0) for p in effect.shape
        }
        said = self.data.get("sigma", {})
        sigmas = tuple(float(said.get(c.name, 0.0)) for c in effect.coefficients)
        return (TwinEffect(effect, target, coefficients, shape, run_id, sigmas),)

    def _chosen(self, name: str, target: str, given: Mapping[str, ParameterValue]) -> Effect:
        """The one effect that name, target, process and parameters mean."""
        named = effects_named(name)
        if not named:
            self._fail(
                "effect",
                name,
                _nearest(name, sorted({e.name for e in catalogue()} | set(FUNCTIONS))),
            )
        fits = [e for e in named if target in e.targets]
        if not fits:
            self._fail(
                "target", target, _nearest(target, sorted({t for e in named for t in e.targets}))
            )
        if name == SLOW_NAME:
            ids, process = [e.id for e in fits], given.get(PROCESS)
            if process not in ids:
                self._fail(f"parameters.{PROCESS}", process, f"one of {', '.join(ids)}")
            fits = [e for e in fits if e.id == process]
        elif PROCESS in given and any(given[PROCESS] != e.id for e in fits):
            self._fail(f"parameters.{PROCESS}", given[PROCESS], f"no process, or {fits[0].id}")
        # kinds that differ in how they repeat from run to run are one here: run_id says that
        fits = list({frozenset(_names(e)): e for e in reversed(fits)}.values())
        fits.sort(key=lambda e: _misfit(e, given))
        if len(fits) > 1 and _misfit(fits[0], given) == _misfit(fits[1], given):
            kinds = " or ".join(", ".join(c.name for c in e.coefficients) for e in fits)
            self._fail("parameters", ", ".join(given) or None, f"coefficients of one kind: {kinds}")
        if lacking := getattr(fits[0], "out_of_reach", ""):
            self._fail(
                "effect", name, f"an effect that a log of this format shows (this one: {lacking})"
            )
        return fits[0]

    def _function(
        self, name: str, target: str, given: Mapping[str, ParameterValue], run_id: str
    ) -> tuple[TwinEffect, ...]:
        if target not in (*GYROS, *ACCELS):
            self._fail("target", target, _nearest(target, [*GYROS, *ACCELS]))
        known = ["nodes", "values", "unit"]
        for key in known:
            if key not in given:
                self._fail(f"parameters.{key}", None, f"{', '.join(known)}")
        for key in given:
            if key not in known:
                self._fail(f"parameters.{key}", key, _nearest(key, known))
        if given["unit"] != unit_of(target):
            self._fail("parameters.unit", given["unit"], unit_of(target))
        values = self._numbers("values", given["values"])
        if name == OF_RUN:
            return self._of_run(target, given["nodes"], values, run_id)
        nodes = self._numbers("nodes", given["nodes"])
        if len(nodes) != len(values) or any(b <= a for a, b in pairwise(nodes)):
            self._fail(
                "parameters.nodes",
                given["nodes"],
                f"{len(values)} increasing numbers, one for each value",
            )
        return (TwinEffect(_function(name, target, nodes, values), target, (1.0,), {}, run_id),)

    def _of_run(
        self, target: str, runs: Any, values: tuple[float, ...], run_id: str
    ) -> tuple[TwinEffect, ...]:
        if not (
            isinstance(runs, list)
            and len(runs) == len(values)
            and all(isinstance(r, str) and r for r in runs)
        ):
            self._fail("parameters.nodes", runs, "run ids, one for each value")
        if run_id:
            self._fail(f"parameters.{RUN_ID}", run_id, "none: the nodes are the runs")
        return tuple(
            TwinEffect(_function(OF_RUN, target, (), (v,)), target, (1.0,), {}, r)
            for r, v in zip(runs, values)
        )

    def _numbers(self, key: str, given: Any) -> tuple[float, ...]:
        if not (isinstance(given, list) and given and all(_is_number(v) for v in given)):
            self._fail(f"parameters.{key}", given, "a list of numbers")
        return tuple(float(v) for v in given)

    def _number(
        self, given: Mapping[str, ParameterValue], name: str, unit: str, *, positive: bool = False
    ) -> float:
        """A plain number, or one with sigma and unit as in diagnosis.json."""
        key, needed = f"parameters.{name}", f"a number [{unit}]"
        value = given.get(name)
        if isinstance(value, Mapping):
            if strange := sorted(set(value) - {"value", "sigma", "unit"}):
                self._fail(f"{key}.{strange[0]}", value[strange[0]], "value, sigma and unit only")
            if value.get("unit", unit) != unit:
                self._fail(f"{key}.unit", value["unit"], repr(unit))
            value = value.get("value")
        if not _is_number(value):
            self._fail(key, value, needed)
        if positive and not value > 0:
            self._fail(key, value, f"{needed} above 0")
        return float(value)

    def _fail(self, key: str, got: Any, needed: str) -> NoReturn:
        said = "nothing" if got is None else repr(got)[:60]
        raise InputError(f"{self.where}: {key}: got {said}, needed {needed}")


def _function(
    name: str, target: str, nodes: tuple[float, ...], values: tuple[float, ...]
) -> NodeFunction:
    return NodeFunction(
        id=name, name=name, targets=(target,), coefficients=(), nodes=nodes, values=values
    )


def _misfit(effect: Effect, given: Mapping[str, ParameterValue]) -> tuple[int, int]:
    """Parameters given that the effect has not, and those of its own that are not given: kinds of
    one name differ so.
    """
    own, said = set(_names(effect)), set(given) - {PROCESS}
    return len(said - own), len(own - said)


def _names(effect: Effect) -> list[str]:
    return [c.name for c in effect.coefficients] + [p.name for p in effect.shape]


def _is_number(value: Any) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _nearest(got: str, known: Sequence[str]) -> str:
    """The names that are meant, or all of them where they are few."""
    close = get_close_matches(got, known, n=3)
    return f"one of {', '.join(close or (known if len(known) < 12 else known[:8]))}"
