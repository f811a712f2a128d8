"""All effects that a trial can plant, by their name in effects.md, section 2."""

from collections.abc import Sequence

from benchmarks.gap_trials import accel_errors, gyro_drifts, gyro_inputs, platform, taxi_errors
from benchmarks.gap_trials.effect import Effect
from benchmarks.gap_trials.other_forms import OTHER_FORMS
from ins.records import InputError

EFFECTS: dict[str, Effect] = {
    effect.name: effect
    for module in (gyro_drifts, gyro_inputs, accel_errors, platform, taxi_errors)
    for effect in module.EFFECTS
}


# planted by name only: the usual trials never draw them
FORMS: dict[str, Effect] = {effect.name: effect for effect in OTHER_FORMS}


def effect_named(name: str) -> Effect:
    if name in FORMS:
        return FORMS[name]
    if name not in EFFECTS:
        raise InputError(f"planted effect {name!r}, needed one of {', '.join(sorted(EFFECTS))}")
    return EFFECTS[name]


def possible(have: frozenset[str], names: Sequence[str] | None = None) -> tuple[Effect, ...]:
    """The effects (of these names) whose needs are met by a plan that has "taxi", "gnss",
    "odometer", "runs" or not.
    """
    chosen = [effect_named(name) for name in names] if names else list(EFFECTS.values())
    return tuple(effect for effect in chosen if effect.needs <= have)
