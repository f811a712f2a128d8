"""A twin's effects on the way to an update: what they add along a run, and the noise they stand
for.

Both the update that takes found effects out of its log and the prediction of an update use it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from infield.thermal.found_effects import FoundEffect
from ins.errors.telemetry import Telemetry
from ins.records import TwinModel
from simreal.declared.declared_noise import DECLARED, declared_square
from simreal.declared.twin_effects import TwinEffect


def along(item: TwinEffect, run: Telemetry) -> FoundEffect:
    """What a deterministic effect adds to gyros and accelerometers along a run, with its sigma."""
    trace = item.trace(run)
    zero = np.zeros((run.n, 3))
    columns = item.effect.traces(run, item.target, item.shape)
    squares = [
        (sigma * unit.gyro_rad_s) ** 2
        for unit, sigma in zip(columns, item.sigmas)
        if unit.gyro_rad_s is not None
    ]
    return FoundEffect(
        effect=item.effect.name,
        target=item.target,
        time_s=run.time_s,
        gyro_rad_s=zero if trace.gyro_rad_s is None else trace.gyro_rad_s,
        accel_m_s2=zero if trace.accel_m_s2 is None else trace.accel_m_s2,
        gyro_sigma_rad_s=np.sqrt(np.sum(squares, axis=0)) if squares else zero,
    )


def foretells(item: TwinEffect) -> bool:
    """Can the effect be predicted in a run that it was not fitted to? Not what belongs to one run,
    nor a noise that no number of a twin stands for.
    """
    return not item.run_id and (not item.is_noise or item.effect.id in DECLARED)


def with_noise_of(twin: TwinModel, items: Iterable[TwinEffect]) -> TwinModel:
    """The twin with the noise effects in its own numbers.

    A twin has one number for all axes of a kind: the mean square over the axes, so that sums of
    squares over all of them are expected right.
    """
    by_kind: dict[str, list[TwinEffect]] = {}
    for item in items:
        if item.is_noise and foretells(item):
            by_kind.setdefault(item.effect.id, []).append(item)
    for key, kinds in by_kind.items():
        twin = _with_square(twin, key, _mean_square(twin, key, kinds))
    return twin


def _mean_square(twin: TwinModel, key: str, items: Sequence[TwinEffect]) -> float:
    declared = declared_square(twin, key)
    squares = [
        max(declared + sum(item.square for item in items if item.target == target), 0.0)
        for target in items[0].effect.targets
    ]
    return float(np.mean(squares))


def _with_square(twin: TwinModel, key: str, square: float) -> TwinModel:
    section, name, unit = DECLARED[key]
    record = replace(getattr(twin, section), **{name: float(np.sqrt(square)) * unit})
    changed: TwinModel = replace(twin, **{section: record})
    return changed
