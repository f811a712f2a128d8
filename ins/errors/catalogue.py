"""All errors: the project's own, and users' under the entry point group `recal.errors`."""

from collections.abc import Iterator
from functools import cache
from importlib.metadata import EntryPoint, entry_points

from ins.errors.accelerometer import ACCELEROMETER
from ins.errors.base import SLOW_NAME, Effect, ErrorSource, Words
from ins.errors.data import DATA_EFFECTS
from ins.errors.flight import FLIGHT_EFFECTS
from ins.errors.gyro.compensation import COMPENSATION
from ins.errors.gyro.events import GYRO_EVENTS
from ins.errors.gyro.noise import GYRO_NOISE
from ins.errors.gyro.rate import GYRO_RATE
from ins.errors.gyro.thermal import GYRO_THERMAL
from ins.errors.navigation import NAVIGATION_EFFECTS
from ins.errors.platform import PLATFORM
from ins.errors.prior import Prior
from ins.errors.table import TABLE_ERRORS
from ins.errors.unnamed import FREE_FUNCTIONS
from ins.errors.wheels import WHEELS
from ins.records import InputError

GROUPS = ("recal.errors", "recal.effects")  # the latter is the older name
OWN: tuple[ErrorSource, ...] = (
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
    *TABLE_ERRORS,
)

_OF_ID = {source.id: source for source in OWN}


@cache
def catalogue() -> tuple[Effect, ...]:
    """What a diagnosis may name, a plan separate and a twin hold.

    Returns
    -------
    errors : tuple of Effect
        Those of the list that a run can show, and those of installed packages: an entry point
        names an error or a tuple of them.

    Raises
    ------
    InputError
        One of them does not follow the protocol or takes an id that is in use.
    """
    found: list[Effect] = [source for source in OWN if source.diagnosed]
    ids = {source.id for source in OWN}
    for point in _points():
        for effect in _loaded(point):
            if not isinstance(effect, Effect):
                raise InputError(
                    f"entry point {point.name} of {point.group}: {effect!r} does not follow"
                    " simreal.effects.own.Effect"
                )
            if effect.id in ids:
                raise InputError(
                    f"entry point {point.name} of {point.group}: id {effect.id!r} is in use"
                )
            found.append(effect)
            ids.add(effect.id)
    return tuple(found)


def _points() -> Iterator[EntryPoint]:
    """Entry points of both groups; one that stands in both, once."""
    seen: set[tuple[str, str]] = set()
    for group in GROUPS:
        for point in entry_points(group=group):
            if (point.name, point.value) not in seen:
                seen.add((point.name, point.value))
                yield point


def _loaded(point: EntryPoint) -> tuple[object, ...]:
    """What an entry point names; InputError where its package cannot be imported."""
    try:
        loaded = point.load()
    except Exception as fault:  # whatever the module of a user raises
        raise InputError(
            f"entry point {point.name} of {point.group}: {point.value} cannot be loaded:"
            f" {type(fault).__name__}: {fault}"
        ) from fault
    return tuple(loaded) if isinstance(loaded, tuple | list) else (loaded,)


def prior(id: str, recipe: str, part: str = "") -> Prior:
    """What an estimator assumes of an error of the list.

    Parameters
    ----------
    id : str
        Of the error.
    recipe, part : str
        As in `Prior`.

    Returns
    -------
    prior : Prior

    Raises
    ------
    LookupError
        That estimator does not carry it.
    """
    return _OF_ID[id].prior(recipe, part)


def estimated_of_users(recipe: str) -> tuple[ErrorSource, ...]:
    """Errors of installed packages that an estimator is to carry.

    Those of the project have states of their own.

    Parameters
    ----------
    recipe : str
        As in `Prior`.

    Returns
    -------
    errors : tuple of ErrorSource
    """
    own = (e for e in catalogue() if isinstance(e, ErrorSource) and e.id not in _OF_ID)
    return tuple(e for e in own if any(recipe in prior.recipes.split() for prior in e.priors))


def effects_named(name: str, among: tuple[Effect, ...] | None = None) -> tuple[Effect, ...]:
    """The effects that go by a name, or by an id.

    Parameters
    ----------
    name : str
        Several kinds of `slow_variation` share theirs.
    among : tuple of Effect, optional
        Default: the catalogue.

    Returns
    -------
    effects : tuple of Effect
    """
    every = catalogue() if among is None else among
    return tuple(e for e in every if name in (e.name, e.id))


def rivals_of(effect: Effect) -> tuple[str, ...]:
    """Names that an effect is easily confused with: its own rivals, and what names it as one.

    Parameters
    ----------
    effect : Effect

    Returns
    -------
    names : tuple of str
    """
    called = _called(effect)
    naming = (_called(other) for other in catalogue() if called in other.rivals)
    return tuple(dict.fromkeys((*effect.rivals, *naming)))


def _called(effect: Effect) -> str:
    """What others call it: a slow process by its id."""
    return effect.id if effect.name == SLOW_NAME else effect.name


def words_of(name: str) -> Words | None:
    """The words on an error or a free function.

    Parameters
    ----------
    name : str

    Returns
    -------
    words : Words or None
        None where a user's own has none.
    """
    of_errors = {e.name: e.words for e in (*OWN, *catalogue()) if isinstance(e, ErrorSource)}
    return of_errors.get(name) or FREE_FUNCTIONS.get(name)
