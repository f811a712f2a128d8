"""What aided replay took from a log beyond what was declared, and what of it is not to be
believed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.aided.antenna import SeenAntenna, antenna_sigmas
from infield.aided.flights import Flights
from infield.aided.noise import SENSOR_PARTS, TOO_WIDE, NoiseScales, believed
from infield.aided.reasons import AidedNote, AidedReason
from ins.filters.aided_records import AidedHistory, Antenna, Fixes
from ins.records import FixType
from ins.robust import chi2
from ins.verdicts import Reason, because

LEAST_APART_S = 0.02  # between the delays of positions and velocities, to be told apart
APART_SIGMAS = 4.0  # of the difference of the two delays, likewise
# chosen: of a fix whose sigmas are right, that it is farther off than that: 1 of 1000
FAR_PROBABILITY = 1e-3


@dataclass(frozen=True, kw_only=True)
class TypeShare:
    """Fixes of one type (None: unknown) that were seen, how many positions and velocities of them
    were rejected, how many fixes were bad: rejected, or used and farther off than one in a thousand
    is; and the share of these.
    """

    fix_type: FixType | None
    count: int
    rejected_position: int
    rejected_velocity: int
    bad: int
    bad_share: float


def shares_by_type(history: AidedHistory, fixes: Fixes) -> tuple[TypeShare, ...]:
    """How many of the fixes of each type were bad, in order of types, unknown ones last."""
    seen = np.isfinite(history.nis).any(axis=1)
    known = [float(kind) for kind in FixType]
    of_kinds: list[tuple[FixType | None, NDArray]] = [
        (kind, seen & (fixes.fix_type == kind)) for kind in FixType
    ]
    of_kinds.append((None, seen & ~np.isin(fixes.fix_type, known)))
    return tuple(_share(history, kind, rows) for kind, rows in of_kinds if rows.any())


def _share(history: AidedHistory, kind: FixType | None, rows: NDArray) -> TypeShare:
    from ins.filters.aided_kernel import REJECTED

    rejected = history.used[rows] == REJECTED
    far = np.nan_to_num(history.nis[rows]) > chi2.isf(FAR_PROBABILITY, 3)
    bad = int((rejected | far).any(axis=1).sum())
    return TypeShare(
        fix_type=kind,
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
            late = [of_positions, of_velocities]
        else:
            late = [("fixes", now.delay_s, sigma[3])]
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
    slow = slow_other = slow_velocity = None
    level_m, down_m, velocity_m_s = flights.declared_m
    if scales.slow:
        slow = _slow(scales.slow, level_m, down_m)
        slow |= {"time_s": scales.slow_s, "scatter": flights.scatter(history)}
    if scales.slow_other:
        other = flights.fixes.other_type
        slow_other = _slow(scales.slow_other, *flights.declared_other_m)
        slow_other |= {"fixes": int(other.sum()), "of": int(other.size)}
    if scales.slow_velocity:
        slow_velocity = {
            "sigma_m_s": scales.slow_velocity * velocity_m_s,
            "time_s": scales.slow_velocity_s,
        }
    factors = {name: getattr(scales, name) for name in (*SENSOR_PARTS, "position", "velocity")}
    note = because(
        AidedNote.NOISE_TAKEN,
        factors=factors,
        stirred=scales.stirred,
        slow=slow,
        slow_other=slow_other,
        slow_velocity=slow_velocity,
        capped=bool(scales.capped),
        source=source,
    )
    return (note,)


def _slow(factor: float, level_m: float, down_m: float) -> dict[str, float]:
    """Sizes of a slow error."""
    return {"level_m": factor * level_m, "down_m": factor * down_m}


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
        declared_m_s=declared_m_s,
        said_m_s=scales.velocity * declared_m_s,
    )
    return (note,)


def unbelieved(scales: NoiseScales, technology: str) -> tuple[Reason, ...]:
    """Factors on the sensors that no noise explains."""
    return tuple(
        because(
            AidedReason.NOISE_UNBELIEVED,
            factor=name,
            value=getattr(scales, name),
            most=believed(name, technology),
            technology=technology,
        )
        for name in scales.beyond(technology)
    )
