"""Noise effects with a negative coefficient: a simulation with less noise than the twin declares.

The twin's numbers hold for all three axes, so the number is lowered to what the quietest axis has
and the others get their part back as an added noise of the same kind.

Decision: docs/decisions/0028-effects-are-formulas.md.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ins.errors.catalogue import OWN
from ins.records import InputError, TwinModel
from simreal.declared.twin_effects import TwinEffect

# id of the noise: section and key of the twin, and its unit over the coefficient's
DECLARED = {source.id: source.twin for source in OWN if source.twin and source.is_noise}


def declared_square(twin: TwinModel, effect_id: str) -> float:
    """What a twin declares of a noise effect, its coefficient squared; 0 where it declares none of
    the kind.
    """
    if effect_id not in DECLARED:
        return 0.0
    section, field, unit = DECLARED[effect_id]
    return float((getattr(getattr(twin, section), field) / unit) ** 2)


def without_excess(
    twin: TwinModel, effects: Sequence[TwinEffect], run_id: str
) -> tuple[TwinModel, tuple[TwinEffect, ...]]:
    """The twin to simulate a run with (`effects` empty) and what is to be added to that: no noise
    below zero.

    InputError where an effect takes away noise that the twin does not declare as such.
    """
    added: list[TwinEffect] = []
    lowered: dict[str, list[TwinEffect]] = defaultdict(list)
    for item in effects:
        if not item.in_run(run_id):
            continue
        if item.is_noise and item.square < 0:
            if item.effect.id not in DECLARED:
                raise InputError(
                    f"{twin.source}: {item.effect.name} on {item.target}: coefficient"
                    f" {item.coefficients[0]:g}, needed 0 or more: the twin declares no such noise"
                    " to be lowered"
                )
            lowered[item.effect.id].append(item)
        else:
            added.append(item)
    twin = replace(twin, effects=())
    for key, items in lowered.items():
        twin, back = _lowered(twin, key, items)
        added += back
    return twin, tuple(added)


def _lowered(
    twin: TwinModel, key: str, items: Sequence[TwinEffect]
) -> tuple[TwinModel, list[TwinEffect]]:
    section, field, unit = DECLARED[key]
    record: Any = getattr(twin, section)
    declared = (getattr(record, field) / unit) ** 2
    effect = items[0].effect
    left = {
        t: max(declared + sum(i.square for i in items if i.target == t), 0.0)
        for t in effect.targets
    }
    least = min(left.values())
    twin = replace(twin, **{section: replace(record, **{field: float(np.sqrt(least)) * unit})})
    back = [
        TwinEffect(effect, t, (float(np.sqrt(square - least)),))
        for t, square in left.items()
        if square > least
    ]
    return twin, back
