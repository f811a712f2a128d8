"""All effects the diagnosis may name: the project's own, and users' under the entry point group
`recal.effects`.
"""

from functools import cache
from importlib.metadata import entry_points

from ins.records import InputError
from simreal.effects.accelerometer import ACCELEROMETER
from simreal.effects.base import Effect
from simreal.effects.compensation import COMPENSATION
from simreal.effects.data import DATA_EFFECTS
from simreal.effects.flown.flight import FLIGHT_EFFECTS
from simreal.effects.gyro_events import GYRO_EVENTS
from simreal.effects.gyro_noise import GYRO_NOISE
from simreal.effects.gyro_rate import GYRO_RATE
from simreal.effects.gyro_thermal import GYRO_THERMAL
from simreal.effects.navigation import NAVIGATION_EFFECTS
from simreal.effects.platform import PLATFORM
from simreal.effects.wheels import WHEELS

GROUP = "recal.effects"


@cache
def catalogue() -> tuple[Effect, ...]:
    """The catalogue with the effects that installed packages add; an entry point names an effect or
    a tuple of them.

    InputError where one of them does not follow the protocol or takes an id that is in use.
    """
    own = (
        *GYRO_THERMAL,
        *GYRO_EVENTS,
        *GYRO_RATE,
        *GYRO_NOISE,
        *COMPENSATION,
        *ACCELEROMETER,
        *PLATFORM,
        *WHEELS,
        *NAVIGATION_EFFECTS,
        *DATA_EFFECTS,
        *FLIGHT_EFFECTS,
    )
    found, ids = list(own), {e.id for e in own}
    for point in entry_points(group=GROUP):
        loaded = point.load()
        for effect in loaded if isinstance(loaded, tuple | list) else (loaded,):
            if not isinstance(effect, Effect):
                raise InputError(
                    f"entry point {point.name} of {GROUP}: {effect!r} does not follow"
                    " simreal.effects.base.Effect"
                )
            if effect.id in ids:
                raise InputError(f"entry point {point.name} of {GROUP}: id {effect.id!r} is in use")
            found.append(effect)
            ids.add(effect.id)
    return tuple(found)


def effects_named(name: str, among: tuple[Effect, ...] | None = None) -> tuple[Effect, ...]:
    """The effects that go by a name (several kinds of `slow_variation` share theirs), or by an
    id.
    """
    every = catalogue() if among is None else among
    return tuple(e for e in every if name in (e.name, e.id))
