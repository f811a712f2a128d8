"""Noise effects with a negative coefficient: a simulation with less noise than the twin declares.

The twin's numbers hold for all three axes, so the number is lowered to what the quietest axis has
and the others get their part back as an added noise of the same kind.

Decision: docs/decisions/0030-less-noise.md.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ins.records import InputError, TwinModel
from ins.units import ARCSEC
from simreal.declared.twin_effects import TwinEffect

DECLARED = {  # id of the effect: section and key of the twin, and its unit over the coefficient's
    "gyro_quantization": ("gyro", "quantization_rad", ARCSEC),
    "gyro_angle_random_walk": ("gyro", "arw_deg_sqrt_h", 1.0),
    "gyro_bias_instability": ("gyro", "bias_instability_deg_h", 1.0),
    "gyro_rate_random_walk": ("gyro", "rate_random_walk_deg_h_sqrt_h", 1.0),
    "accel_noise": ("accel", "vrw_ug_sqrt_hz", 1.0),
    "accel_bias_instability": ("accel", "bias_instability_ug", 1.0),
    "accel_rate_random_walk": ("accel", "rate_random_walk_ug_sqrt_h", 1.0),
    "platform_sway": ("vehicle", "sway_m_s", 1.0),
}


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
