"""What aided replay took from a log beyond what was declared, and what of it is not to be
believed.
"""

import numpy as np

from infield.aided.antenna import SeenAntenna, antenna_sigmas
from infield.aided.noise import SENSOR_PARTS, NoiseScales, believed
from infield.aided.reasons import AidedNote, AidedReason
from ins.filters.aided_records import Antenna
from ins.records import TwinModel
from ins.verdicts import Reason, because

LEAST_APART_S = 0.02  # between the delays of positions and velocities, to be told apart
APART_SIGMAS = 4.0  # of the difference of the two delays, likewise


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


def noise_notes(scales: NoiseScales, twin: TwinModel) -> tuple[Reason, ...]:
    """How much larger than declared the noise was taken; empty where it stood."""
    if not scales.fitted:
        return ()
    slow = slow_velocity = None
    if scales.slow:
        slow = {
            "level_m": scales.slow * twin.gnss.sigma_horizontal_m,
            "down_m": scales.slow * twin.gnss.sigma_vertical_m,
            "time_s": scales.slow_s,
        }
    if scales.slow_velocity:
        slow_velocity = {
            "sigma_m_s": scales.slow_velocity * twin.gnss.sigma_velocity_m_s,
            "time_s": scales.slow_velocity_s,
        }
    factors = {name: getattr(scales, name) for name in (*SENSOR_PARTS, "position", "velocity")}
    note = because(
        AidedNote.NOISE_TAKEN,
        factors=factors,
        stirred=scales.stirred,
        slow=slow,
        slow_velocity=slow_velocity,
        capped=bool(scales.capped),
        source=twin.source,
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
