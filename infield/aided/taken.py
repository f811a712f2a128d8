"""What aided replay took from a log beyond what was declared, and what of it is not to be
believed.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.aided.antenna import SeenAntenna, antenna_sigmas
from infield.aided.flights import Flights
from infield.aided.noise import SHOWS_LESS, TOO_WIDE, NoiseScales, believed
from infield.aided.reasons import AidedNote, AidedPart, AidedReason, NoiseFactor
from ins.filters.aided_records import REJECTED, AidedHistory, Antenna, Fixes
from ins.records import FixType
from ins.robust import chi2
from ins.verdicts import Reason, because

LEAST_APART_S = 0.02  # between the delays of positions and velocities, to be told apart
APART_SIGMAS = 4.0  # of the difference of the two delays, likewise
# chosen: of a fix whose sigmas are right, that it is farther off than that: 1 of 1000
FAR_PROBABILITY = 1e-3
FIX_TYPE_NAMES = {
    FixType.SINGLE: "single",
    FixType.DIFFERENTIAL: "corrected",
    FixType.FLOAT: "float",
    FixType.FIXED: "fixed",
}
UNKNOWN = "unknown"  # of a fix whose receiver does not say its type


@dataclass(frozen=True, kw_only=True)
class TypeShare:
    """Fixes of one type that were seen, how many positions and velocities of them
    were rejected, how many fixes were bad: rejected, or used and farther off than one in a thousand
    is; and the share of these.
    """

    fix_type: str
    count: int
    rejected_position: int
    rejected_velocity: int
    bad: int
    bad_share: float


def shares_by_type(history: AidedHistory, fixes: Fixes) -> tuple[TypeShare, ...]:
    """How many of the fixes of each type were bad, in order of types, unknown ones last."""
    seen = np.isfinite(history.nis).any(axis=1)
    known = [float(kind) for kind in FixType]
    of_types = {name: seen & (fixes.fix_type == kind) for kind, name in FIX_TYPE_NAMES.items()}
    of_types[UNKNOWN] = seen & ~np.isin(fixes.fix_type, known)
    return tuple(_share(history, name, rows) for name, rows in of_types.items() if rows.any())


def _share(history: AidedHistory, name: str, rows: NDArray) -> TypeShare:
    rejected = history.used[rows] == REJECTED
    far = np.nan_to_num(history.nis[rows]) > chi2.isf(FAR_PROBABILITY, 3)
    bad = int((rejected | far).any(axis=1).sum())
    return TypeShare(
        fix_type=name,
        count=int(rows.sum()),
        rejected_position=int(rejected[:, 0].sum()),
        rejected_velocity=int(rejected[:, 1].sum()),
        bad=bad,
        bad_share=bad / float(rows.sum()),
    )


def antenna_notes(seen: SeenAntenna, declared: Antenna) -> tuple[Reason, ...]:
    """What was taken of the antenna, against what was declared."""
    now, sigma = seen.antenna, antenna_sigmas(seen.antenna)
    notes = []
    if seen.freed.arm:
        notes.append(
            because(
                AidedNote.LEVER_ARM_TAKEN,
                lever_arm_m=now.lever_arm_m,
                sigma_m=sigma[:3],
                declared_m=declared.lever_arm_m,
                gain_nats=seen.gain_nats,
            )
        )
    if seen.freed.delay:
        of_positions = ("positions", now.delay_s, sigma[3])
        of_velocities = ("velocities", now.velocity_delay_s, sigma[4])
        least_s = max(APART_SIGMAS * float(np.hypot(*sigma[3:])), LEAST_APART_S)
        if abs(now.delay_s - now.velocity_delay_s) > least_s:
            lags = [of_positions, of_velocities]
        else:
            lags = [("fixes", now.delay_s, sigma[3])]
        late = tuple(
            because(
                AidedPart.OLDER, what=what, lag_s=abs(lag_s), sigma_s=sigma_s, late=bool(lag_s > 0)
            )
            for what, lag_s, sigma_s in lags
        )
        notes.append(because(AidedNote.DELAY_TAKEN, late=late, gain_nats=seen.gain_nats))
    return tuple(notes)


def noise_notes(
    scales: NoiseScales, flights: Flights, history: AidedHistory, source: str
) -> tuple[Reason, ...]:
    """How much larger than declared the noise was taken; empty where it stood. source: of what was
    declared.
    """
    if not scales.fitted:
        return ()
    factors = {factor: getattr(scales, factor) for factor in NoiseFactor}
    scatter = flights.scatter(history) if scales.slow else float("nan")
    scatters_less = bool(scatter <= SHOWS_LESS)
    added = scales.stirred or scales.shaken or scales.slow_other or scales.slow_velocity
    larger = bool(added or max(factors.values()) > 1.0)
    as_declared = scales.slow and not scatters_less
    note = because(
        AidedNote.NOISE_TAKEN,
        larger=bool(larger or as_declared),
        source=source,
        parts=(_factors(factors), *_added(scales, flights)),
        scatters_less=scatters_less,
        scatter=scatter,
        capped=bool(scales.capped),
    )
    return (note,)


def _factors(factors: Mapping[NoiseFactor, float]) -> Reason:
    """What was taken larger or smaller than declared, as far as two digits show it."""
    sizes = tuple(
        because(AidedPart.TIMES, factor=factor, times=times)
        for factor, times in factors.items()
        if not 0.995 <= times < 1.05
    )
    if not sizes:
        return because(AidedPart.NOISE_AS_DECLARED)
    return because(AidedPart.NOISE_LARGER, sizes=sizes)


def _added(scales: NoiseScales, flights: Flights) -> list[Reason]:
    """Noise that was not declared at all."""
    parts = []
    level_m, down_m, velocity_m_s = flights.declared_m
    if scales.shaken:
        parts.append(because(AidedPart.SHAKEN, shaken=scales.shaken))
    if scales.stirred:
        parts.append(because(AidedPart.STIRRED, stirred=scales.stirred))
    if scales.slow:
        parts.append(
            because(
                AidedPart.SLOW,
                level_m=scales.slow * level_m,
                down_m=scales.slow * down_m,
                time_s=scales.slow_s,
            )
        )
    if scales.slow_other:
        other, (level_m, down_m) = flights.fixes.other_type, flights.declared_other_m
        parts.append(
            because(
                AidedPart.SLOW_OTHER,
                level_m=scales.slow_other * level_m,
                down_m=scales.slow_other * down_m,
                fixes=int(other.sum()),
                of=int(other.size),
            )
        )
    if scales.slow_velocity:
        parts.append(
            because(
                AidedPart.SLOW_VELOCITY,
                sigma_m_s=scales.slow_velocity * velocity_m_s,
                time_s=scales.slow_velocity_s,
            )
        )
    return parts


def fixes_note(scales: NoiseScales, fixes: Fixes) -> tuple[Reason, ...]:
    """What the fixes are declared to be good to beside what the innovations say, where the two are
    a factor of two apart.
    """
    apart = [max(f, 1.0 / f) for f in (scales.position, scales.velocity)]
    if max(apart) * TOO_WIDE < 1.0:
        return ()
    declared_m = float(np.median(fixes.sigma_position_m[:, 0]))
    declared_m_s = float(np.median(fixes.sigma_velocity_m_s[:, 0]))
    note = because(
        AidedNote.FIXES_SAY,
        declared_m=declared_m,
        said_m=scales.position * declared_m,
        position_stands=scales.position == 1.0,
        declared_m_s=declared_m_s,
        said_m_s=scales.velocity * declared_m_s,
        velocity_stands=scales.velocity == 1.0,
    )
    return (note,)


def unbelieved(scales: NoiseScales, technology: str) -> tuple[Reason, ...]:
    """Factors on the sensors that no noise explains."""
    return tuple(
        because(
            AidedReason.NOISE_UNBELIEVED,
            factor=NoiseFactor(name),
            value=getattr(scales, name),
            most=believed(name, technology),
            technology=technology,
        )
        for name in scales.beyond(technology)
    )
