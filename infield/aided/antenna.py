"""Whether the fixes of a log are of the antenna that its run.json names: its lever arm, and how
late their times are.

Four flights are compared by the likelihood of their innovations: antenna as declared; delays free;
lever arm free; both free. What is free is a state of the filter with a wide prior, so a free flight
pays for its freedom, and under the declared antenna a gain of g nats has a probability below
exp(-g) (Markov's inequality on the likelihood ratio). A lever arm is taken only where it is also
off by more than the slow errors of a receiver can make it, ARM_FLOOR of a fix's sigma. What is
taken enters the last flight as a considered parameter: its sigma widens the solution's and is not
made smaller by the fixes that it was found from.

Decision: docs/decisions/0037-receiver-errors-and-noise.md.
"""

from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from infield.aided.noise import (
    CHANGE_GAIN_NATS,
    COARSE,
    FINE,
    SLOW_PARTS,
    STEADY_PARTS,
    Flown,
    Fly,
    Model,
    NoiseScales,
    flown,
    misfits,
    narrower,
    raised_noise,
    with_gnss,
    with_types,
    with_unshown,
)
from ins.errors.catalogue import prior
from ins.estimation import choice
from ins.filters.aided_records import AidedHistory, Antenna
from ins.robust import chi2

PRIOR_ARM_M = prior("gnss_lever_arm_or_latency", "replay", "arm").size
PRIOR_DELAY_S = prior("gnss_lever_arm_or_latency", "replay", "latency").size
FREED_GAIN_NATS = 7.0  # for each thing that is freed
PASSES = 4  # of a free flight, each begun where the last one ended
SETTLED_S, SETTLED_M = 0.003, 0.1  # 0.003 s at 30 m/s is 0.09 m, as much as the other
LEAST_DELAY_S = 0.01  # 1 m at 100 m/s, within the noise of a fix
# four sigmas of the prior: receivers are a quarter of a second late, filters of velocities half a
# second; what fits at 6 s fits a receiver that tells nothing of the motion
MOST_DELAY_S = 4.0 * PRIOR_DELAY_S
MOST_ARM_M = 4.0 * PRIOR_ARM_M  # likewise; 33 m were found on a copter
ARM_FLOOR, LEAST_ARM_M = 0.3, 0.03  # of the sigma of a position; of structures that bend
# where velocities are older than positions, a filter made them so, and a filter is no pure delay
FILTERED_M_S = 1.5
DELAY_FLOOR_S = 0.005  # of stamps that jitter
ARM_PROBABILITY = 1e-4  # 1 of 10 000 true declared arms is doubted
# in which no large bias hides the antenna
WIDE = NoiseScales(
    white=8.0, walk=32.0, accel_white=8.0, accel_walk=32.0, position=3.0, velocity=8.0
)
# sensors on a running airframe: between the two lies a valley of likelihood, 84 nats deep at walks
# of 4 on a copter whose walks of 16 bring 2,100
SHAKEN = NoiseScales(white=8.0, walk=32.0, accel_white=8.0, accel_walk=32.0)
# whose accelerometers clip and rectify where the vehicle shakes
STIRRED_UNITS = ("mems",)
STIRRED_STRIDES = (5, 3, 1)  # from none to 1, 0.25 and 0.0625
SHAKING_CHANGES = 2.0  # chosen: least to most in a log; of white noise, known to 7 %, it is 1.3
ARM, DELAYS = slice(0, 3), slice(3, 5)


class Freed(NamedTuple):
    arm: bool
    delay: bool


def _freed(parts: tuple[str, ...]) -> Freed:
    return Freed(arm="arm" in parts, delay="delay" in parts)


NOTHING_FREED, BOTH = Freed(arm=False, delay=False), Freed(arm=True, delay=True)


@dataclass(frozen=True, kw_only=True)
class SeenAntenna:
    """The antenna that a log was flown with, what of it was taken from the fixes, and what the
    fixes alone say.

    seen: with everything free, floors in its covariance; None where that could not be flown.
    gain_nats: of what was taken, over the declared antenna.
    """

    antenna: Antenna
    freed: Freed = NOTHING_FREED
    seen: Antenna | None = None
    gain_nats: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """history: under model; declared: as declared."""

    model: Model
    antenna: SeenAntenna
    history: AidedHistory
    declared: AidedHistory


def fit_model(fly: Fly, antenna: Antenna, sigma_position_m: float) -> Fitted | None:
    """The antenna and the noise that a log needs, with the flight under them; None where it cannot
    be flown.

    antenna: as declared. sigma_position_m: of a level fix, declared.
    """
    first = Model(antenna=antenna)
    declared = fly(first, whole=True)
    if declared is None:
        return None
    as_declared = Fitted(
        model=first, antenna=SeenAntenna(antenna=antenna), history=declared, declared=declared
    )
    found = choose(fly, first, sigma_position_m, refit=False)
    if found is None:
        return as_declared
    at = with_types(found[0], fly)
    loud = misfits(at.history)
    scales = _noise(fly, first, at, loud=loud)
    narrow = narrower(at, fly)
    if narrow is not at:
        learned = _noise(fly, first, narrow, loud=misfits(narrow.history))
        scales = learned if learned.sensors_as(scales) else scales
    now = flown(replace(at.model, scales=scales), fly)
    scales = scales if now is None else with_unshown(now, fly)
    if scales.fitted:
        found = choose(fly, replace(first, scales=scales), sigma_position_m, refit=loud) or found
    best, seen = found
    model = replace(best.model, antenna=seen.antenna)
    history = (
        declared
        if model.scales == first.scales and seen.freed == NOTHING_FREED
        else fly(model, whole=True)
    )
    if history is None:
        return as_declared
    last = Flown(model, history)
    if model.scales.fitted and misfits(history):
        last = with_gnss(last, fly, whole=True, lower=False)
    return Fitted(model=last.model, antenna=seen, history=last.history, declared=declared)


def _noise(fly: Fly, first: Model, found: Flown, *, loud: bool) -> NoiseScales:
    """The likeliest factors. Where the innovations fit, slow errors of the receiver and walks of
    the biases are looked for; where one is found, all are: on a vibrating airframe biases walk 10
    to 100 times as far as at rest, which sigmas of fixes that are declared wide do not show.
    """
    if loud:
        return _all_noise(fly, first, found).model.scales
    quiet = raised_noise(found, fly, (*SLOW_PARTS, "walk", "accel_walk"))
    shaken = flown(replace(found.model, scales=SHAKEN), fly)
    better = shaken is not None and shaken.over(quiet) > CHANGE_GAIN_NATS
    if not quiet.model.scales.fitted and not better:
        return quiet.model.scales
    every = _all_noise(fly, first, found)
    return (every if every.over(quiet) > CHANGE_GAIN_NATS else quiet).model.scales


def _all_noise(fly: Fly, first: Model, found: Flown) -> Flown:
    """The likeliest factors where the innovations do not fit, looked for from noise as declared,
    from WIDE noise and from slow errors of the receiver alone: they explain much of what noisy
    sensors do, and the other way round, and no single factor leads from one to the other.
    """
    of_receiver = raised_noise(found, fly, SLOW_PARTS)
    starts = found, _settled(fly, replace(first, scales=WIDE), BOTH), of_receiver
    better = found
    for start in starts:
        if start is None:
            continue
        other = raised_noise(start, fly, strides=(COARSE,))
        if other.over(better) > 0.0:
            better = other
    steady = raised_noise(better, fly, strides=(FINE,))
    return _stirred(fly, first, steady)


def _stirred(fly: Fly, first: Model, steady: Flown) -> Flown:
    """The likeliest factors with biases of the accelerometers that move with the shaking, where
    they are likelier than without; looked for from noise as declared and from what was found
    without. Noise that nobody believes is not taken for noise that one may. Where nothing is found
    of the accelerometers without, such biases have nothing to stand for: some size of them must
    then be likelier by itself.
    """
    least, most = steady.history.shaking
    if fly.technology not in STIRRED_UNITS or most < SHAKING_CHANGES * least:
        return steady
    base, best, lead = steady, steady, CHANGE_GAIN_NATS
    if steady.model.scales.accelerometers_as_declared:
        if raised_noise(base, fly, ("stirred",), strides=STIRRED_STRIDES) is base:
            return steady
    for scales in (NoiseScales(), steady.model.scales):
        at = flown(replace(first, scales=replace(scales, stirred=1.0)), fly)
        if at is None:
            continue
        other = raised_noise(at, fly, (*STEADY_PARTS, "stirred"))
        doubted = other.model.scales.beyond(fly.technology)
        if doubted and not steady.model.scales.beyond(fly.technology):
            continue
        if (gain := other.over(base)) > lead:
            best, lead = other, gain
    return best


def choose(
    fly: Fly, base: Model, sigma_position_m: float, *, refit: bool
) -> tuple[Flown, SeenAntenna] | None:
    """The likeliest of the four flights with the antenna that comes of it, from a model with the
    declared antenna.

    refit: satellite sigmas to each flight's own NIS.
    """
    flight_with = cache(partial(_settled, fly, base, refit=refit))
    none, every = flight_with(NOTHING_FREED), flight_with(BOTH)
    if none is None:
        return None
    seen = None if every is None else _floored(every, sigma_position_m, BOTH)

    def gain(parts: tuple[str, ...]) -> float:
        freed = _freed(parts)
        flight = flight_with(freed)
        if flight is None or not material(flight, base.antenna, freed, sigma_position_m):
            return -np.inf
        return flight.over(none)

    taken = _freed(choice.choose(Freed._fields, gain, cost_nats=FREED_GAIN_NATS))
    best = flight_with(taken) or none
    antenna = base.antenna if taken == NOTHING_FREED else _floored(best, sigma_position_m, taken)
    return best, SeenAntenna(antenna=antenna, freed=taken, seen=seen, gain_nats=best.over(none))


def _settled(fly: Fly, base: Model, freed: Freed, *, refit: bool = False) -> Flown | None:
    """A flight with these parts of the antenna free, begun anew where it ended until it ends where
    it began.
    """
    start = _free(base.antenna, base.antenna, freed)
    at = flown(replace(base, antenna=start), fly)
    for _ in range(PASSES if any(freed) else 0):
        if at is None:
            return None
        end = at.history.antenna
        off_m = float(np.abs(end.lever_arm_m - start.lever_arm_m).max())
        off_s = max(
            abs(end.delay_s - start.delay_s), abs(end.velocity_delay_s - start.velocity_delay_s)
        )
        if off_s < SETTLED_S and off_m < SETTLED_M:
            break
        start = _free(base.antenna, end, freed)
        at = flown(replace(base, antenna=start), fly)
    return with_gnss(at, fly) if refit and at is not None else at


def _free(declared: Antenna, at: Antenna, freed: Freed) -> Antenna:
    """The filter's prior: wide about where it begins, for what is free."""
    sigma = np.array([PRIOR_ARM_M * freed.arm] * 3 + [PRIOR_DELAY_S * freed.delay] * 2)
    late = at if freed.delay else declared
    return Antenna(
        lever_arm_m=at.lever_arm_m if freed.arm else declared.lever_arm_m,
        delay_s=late.delay_s,
        velocity_delay_s=late.velocity_delay_s,
        covariance=np.diag(sigma**2),
        estimated=True,
    )


def _floor_m(flight: Flown, sigma_position_m: float) -> float:
    """What a receiver's slow errors, and the filter of its velocities, can make of a lever arm
    [m].
    """
    end = flight.history.antenna
    filtered = FILTERED_M_S * abs(end.velocity_delay_s - end.delay_s)
    return float(
        np.hypot(
            max(ARM_FLOOR * sigma_position_m * flight.model.scales.position, LEAST_ARM_M), filtered
        )
    )


def material(flight: Flown, declared: Antenna, freed: Freed, sigma_position_m: float) -> bool:
    """Whether what was freed is off what was declared by more than its sigma and what does not
    matter.
    """
    end = flight.history.antenna
    late_s = max(
        abs(end.delay_s - declared.delay_s), abs(end.velocity_delay_s - declared.velocity_delay_s)
    )
    if freed.delay and not LEAST_DELAY_S <= late_s <= MOST_DELAY_S:
        return False
    if not freed.arm:
        return True
    off = end.lever_arm_m - declared.lever_arm_m
    if np.abs(off).max() > MOST_ARM_M:
        return False
    P = end.covariance[ARM, ARM] + _floor_m(flight, sigma_position_m) ** 2 * np.eye(3)
    return bool(off @ np.linalg.solve(P, off) > chi2.isf(ARM_PROBABILITY, 3))


def _floored(flight: Flown, sigma_position_m: float, freed: Freed) -> Antenna:
    """The antenna at the end of a flight, to be considered: floors in its sigmas."""
    end = flight.history.antenna
    P = np.array(end.covariance)
    if freed.arm:
        P[ARM, ARM] += _floor_m(flight, sigma_position_m) ** 2 * np.eye(3)
    if freed.delay:
        P[DELAYS, DELAYS] += DELAY_FLOOR_S**2 * np.eye(2)
    return replace(end, covariance=P, estimated=False)


def antenna_sigmas(antenna: Antenna) -> NDArray:
    """Sigmas (5,) of the lever arm [m] and the delays of positions and velocities [s]."""
    return np.sqrt(np.diag(antenna.covariance))
