"""What wind, tyres and installation may add to a taxi, and which of it the data ask for.

Decision: docs/decisions/0093-one-choice.md.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.kinds import ROLLING
from alignment.navigation_filter import Aid, FilterPass
from infield.session.estimate import Found, RollingEvidence
from infield.session.reasons import Nuisance
from ins.errors.catalogue import prior
from ins.estimation import choice, states
from ins.estimation.error_filter import ErrorFilter
from ins.units import MILLIRADIAN

_TURNING, _GUSTS = prior("turning_crab", "taxi"), prior("gust_crab", "taxi")
CRAB_TURN_RAD, GUST_TIME_S = _TURNING.scale, _GUSTS.scale
_GNSS_DELAY_S = prior("gnss_lever_arm_or_latency", "taxi", "latency").size
# beyond which a model is linearised anew: 3 cm at 10 m/s and 2 cm, small beside 0.5 m of a fix
DELAY_SETTLED_S, ARM_SETTLED_M = 0.003, 0.02
LINEARISED_MOST = 3
# to 2 deg, above which tyres skid; a realistic taxi tells the heading to 0.27 mrad (CHANGELOG.md)
CRABS_RAD = choice.powers_of_two(0.25 * MILLIRADIAN, 40.0 * MILLIRADIAN)
ROUNDS = 8  # of constants and wandering crabs, of which there are two


@dataclass(frozen=True)
class Assumed:
    """What the aids take for possible beyond what is declared: about which values of arm and delays
    they are linearised, and the RMS of crabs that change on their own.
    """

    free: frozenset[Nuisance] = frozenset()
    antenna_m: tuple[float, float] = (0.0, 0.0)
    gnss_delay_s: float = 0.0
    gnss_velocity_delay_s: float = 0.0
    turning_crab_rad: float = _TURNING.size * MILLIRADIAN
    gust_crab_rad: float = _GUSTS.size * MILLIRADIAN


AS_DECLARED = Assumed()


# What every taxi estimates: the measurements that show it, and its state.
ALWAYS: Mapping[Nuisance, tuple[str, str]] = {
    Nuisance.CRAB: ("lateral", "KAPPA"),
    Nuisance.WHEEL_ARM_X: ("lateral", "LEVER_X"),
    Nuisance.WHEEL_SCALE: ("odometer", "ODOMETER"),
}
# Prior sigmas by the names of the states (ins.estimation.states), as in the list of errors.
CONSTANTS: Mapping[Nuisance, Mapping[str, float]] = {
    Nuisance.CROSS_WIND: {"WIND": prior("cross_wind_crab", "taxi").size * MILLIRADIAN},
    Nuisance.SIDE_SLIP: {"SLIP": prior("side_slip", "taxi").size * MILLIRADIAN},
    Nuisance.WHEEL_ARM_Y: {"WHEEL_Y": prior("lever_arm", "taxi", "y").size},
    Nuisance.ODOMETER_DELAY: {"ODOMETER_DELAY": prior("odometer_time_offset", "taxi").size},
    Nuisance.ANTENNA: {"GNSS_ARM": prior("gnss_lever_arm_or_latency", "taxi", "arm").size},
    Nuisance.GNSS_DELAY: {"GNSS_DELAY": _GNSS_DELAY_S, "GNSS_VELOCITY_DELAY": _GNSS_DELAY_S},
}
# The state of a crab that changes on its own, and where `Assumed` holds its RMS.
WANDERING: Mapping[Nuisance, tuple[str, str]] = {
    Nuisance.TURNING_CRAB: ("CRAB_TURN", "turning_crab_rad"),
    Nuisance.GUSTS: ("CRAB_GUST", "gust_crab_rad"),
}


@dataclass(frozen=True)
class RollingModel:
    """The filter under what the data ask for, what it assumes, and the evidence."""

    filter: ErrorFilter
    assumed: Assumed
    evidence: RollingEvidence


@dataclass(frozen=True)
class Bench:
    """Where models are tried: the last pass of the solution, the declared prior sigmas of nuisance
    states, and the aids under what is assumed.
    """

    last: FilterPass
    sigma0: Mapping[str, float]
    aids: Callable[[Assumed], Sequence[Aid]]

    def run(self, assumed: Assumed) -> ErrorFilter:
        return self.last.run(priors_under(self.sigma0, assumed), self.aids(assumed))


def priors_under(declared: Mapping[str, float], assumed: Assumed) -> Mapping[str, float]:
    """Prior sigmas of nuisance states under what is assumed."""
    sigma0 = dict(declared)
    for nuisance in sorted(assumed.free):
        if nuisance in WANDERING:
            state, level = WANDERING[nuisance]
            sigma0[state] = getattr(assumed, level)
        else:
            sigma0.update(CONSTANTS[nuisance])
    return sigma0


def rolling_model(bench: Bench, declared: ErrorFilter) -> RollingModel:
    """The nuisances that the data ask for, with the filter under them."""
    best, assumed = declared, AS_DECLARED
    gains: dict[Nuisance, float] = {}
    if np.any(bench.last.plan.kind == ROLLING):
        best, assumed, gains = _chosen(bench, declared)
    tally = declared.tally
    dof = sum(tally.dof.values())
    evidence = RollingEvidence(
        found=tuple(_found(best, assumed, nuisance, gain) for nuisance, gain in gains.items()),
        always=tuple(
            Found(nuisance, best.x[[i]], np.sqrt(best.P[[i], [i]]), np.array([sigma]), 0.0)
            for nuisance, i, sigma in _always(bench, best)
        ),
        declared_nis=sum(tally.nis.values()) / max(dof, 1),
        declared_dof=dof,
    )
    return RollingModel(best, assumed, evidence)


def _always(bench: Bench, flt: ErrorFilter) -> Iterator[tuple[Nuisance, int, float]]:
    """What every taxi estimates, its state and prior sigma, where it was measured."""
    for nuisance, (kind, name) in ALWAYS.items():
        if kind in flt.tally.dof:
            yield nuisance, getattr(states, name), bench.sigma0[name]


def _chosen(
    bench: Bench, declared: ErrorFilter
) -> tuple[ErrorFilter, Assumed, dict[Nuisance, float]]:
    """The likeliest model: constants, and where they stay as they are, a crab beside them that
    changes on its own, until nothing gains.
    """
    best, assumed = declared, AS_DECLARED
    wandering: dict[Nuisance, float] = {}
    constants: dict[Nuisance, float] = {}
    for _ in range(ROUNDS):
        constants = _constants(bench, assumed)
        free = frozenset([*wandering, *constants])
        if free != assumed.free:
            best, assumed = _settled(bench, _with(assumed, free))
            continue
        tried = {
            nuisance: bench.run(_with(assumed, free | {nuisance}))
            for nuisance in WANDERING
            if nuisance not in free
        }
        gain = {n: flt.tally.loglik - best.tally.loglik for n, flt in tried.items()}
        leader = max(gain, key=lambda n: gain[n], default=None)
        if leader is None or gain[leader] < choice.SURE_NATS:
            break
        before = best.tally.loglik
        best, assumed = _levelled(bench, leader, tried[leader], _with(assumed, free | {leader}))
        wandering[leader] = best.tally.loglik - before
    return best, assumed, {**constants, **wandering}


def _levelled(
    bench: Bench, nuisance: Nuisance, flt: ErrorFilter, assumed: Assumed
) -> tuple[ErrorFilter, Assumed]:
    """The likeliest RMS of a crab that changes on its own."""
    name = WANDERING[nuisance][1]
    flt, sizes = choice.climb(
        flt,
        [choice.Level(name, CRABS_RAD, getattr(assumed, name))],
        lambda sizes, _: bench.run(choice.with_sizes(assumed, sizes)),
        lambda one, other: one.tally.loglik - other.tally.loglik,
    )
    return flt, choice.with_sizes(assumed, sizes)


def _constants(bench: Bench, assumed: Assumed) -> dict[Nuisance, float]:
    """Constant nuisances with what each adds to the others, largest first."""
    wide = bench.run(_with(assumed, assumed.free | frozenset(CONSTANTS)))
    found = choice.FreeConstants(wide.x, wide.P, {n: _states_of(n) for n in CONSTANTS})
    taken = choice.choose(list(CONSTANTS), found.gain)
    gains = {n: found.gain(taken) - found.gain([m for m in taken if m != n]) for n in taken}
    return dict(sorted(gains.items(), key=lambda item: -item[1]))


def _states_of(nuisance: Nuisance) -> tuple[NDArray, NDArray]:
    """Indices and prior sigmas of the states of a constant nuisance."""
    index: list[int] = []
    prior: list[float] = []
    for name, sigma in CONSTANTS[nuisance].items():
        of_name = np.atleast_1d(np.arange(states.BASE)[getattr(states, name)])
        index.extend(of_name.tolist())
        prior.extend([sigma] * len(of_name))
    return np.array(index), np.array(prior)


def _with(assumed: Assumed, free: frozenset[Nuisance]) -> Assumed:
    """The same with other nuisances free; what is not free is as declared."""
    assumed = replace(assumed, free=free)
    if Nuisance.ANTENNA not in free:
        assumed = replace(assumed, antenna_m=AS_DECLARED.antenna_m)
    if Nuisance.GNSS_DELAY not in free:
        assumed = replace(assumed, gnss_delay_s=0.0, gnss_velocity_delay_s=0.0)
    return assumed


def _settled(bench: Bench, assumed: Assumed) -> tuple[ErrorFilter, Assumed]:
    """The filter linearised about the arm and the delays that it finds."""
    flt = bench.run(assumed)
    for _ in range(LINEARISED_MOST):
        found = _values(flt, assumed)
        if _close(found, assumed):
            break
        assumed = found
        flt = bench.run(assumed)
    return flt, assumed


def _values(flt: ErrorFilter, assumed: Assumed) -> Assumed:
    """What is assumed, about the values in a filter's state; what is not free stays as it is."""
    if Nuisance.ANTENNA in assumed.free:
        x, y = flt.x[states.GNSS_ARM]
        assumed = replace(assumed, antenna_m=(float(x), float(y)))
    if Nuisance.GNSS_DELAY in assumed.free:
        assumed = replace(
            assumed,
            gnss_delay_s=float(flt.x[states.GNSS_DELAY]),
            gnss_velocity_delay_s=float(flt.x[states.GNSS_VELOCITY_DELAY]),
        )
    return assumed


def _close(one: Assumed, other: Assumed) -> bool:
    off_m = np.abs(np.subtract(one.antenna_m, other.antenna_m)).max()
    off_s = max(
        abs(one.gnss_delay_s - other.gnss_delay_s),
        abs(one.gnss_velocity_delay_s - other.gnss_velocity_delay_s),
    )
    return bool(off_m < ARM_SETTLED_M and off_s < DELAY_SETTLED_S)


def _found(flt: ErrorFilter, assumed: Assumed, nuisance: Nuisance, gain_nats: float) -> Found:
    if nuisance in WANDERING:
        level = np.array([getattr(assumed, WANDERING[nuisance][1])])
        return Found(nuisance, level, None, level, gain_nats)
    index, prior = _states_of(nuisance)
    return Found(nuisance, flt.x[index], np.sqrt(np.diag(flt.P)[index]), prior, gain_nats)
