"""An error of one's own in one file: a gyro whose bias follows the Earth's magnetic field along its
axis, so that it changes with the heading.

With the entry point `recal.errors` of a package, as in own_effect.py, it can be simulated from the
`effects` of a twin, found by `recal diagnose`, planned for, and estimated by `recal update`, which
its prior asks for; one that a twin lists is taken out of the log by `recal update --twin`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.units import DEG_PER_HOUR
from simreal.effects.own import (
    AXIS,
    GYROS,
    Coefficient,
    ErrorSource,
    Prior,
    Shape,
    Telemetry,
    Trace,
    Words,
    on_axis,
)

# Equator of the Earth's field as an axial dipole; declination and local fields are left out.
# Source: IGRF-13, g_1^0 = -29405 nT.
EQUATOR_GAUSS = 0.294
LEAST_CHANGE_GAUSS = 0.05


def field_gauss(run: Telemetry, target: str) -> NDArray:
    """Field along the gyro's axis (n,): north B cos L, down 2 B sin L, turned into the body."""
    field_n = EQUATOR_GAUSS * np.array([np.cos(run.lat_rad), 0.0, 2.0 * np.sin(run.lat_rad)])
    return np.asarray(run.C_nb[:, :, AXIS[target]] @ field_n)


def axial_field(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per gauss of the Earth's field along the gyro's axis."""
    return (Trace(gyro_rad_s=on_axis(DEG_PER_HOUR * field_gauss(run, target), AXIS[target])),)


def lacks_field_changes(runs: Sequence[Telemetry], target: str) -> str:
    """A field that stays is part of the gyro's constant bias."""
    if not all(run.heading_known for run in runs):
        return "a known heading"
    fields = np.concatenate([field_gauss(run, target) for run in runs] or [np.zeros(1)])
    return "" if np.ptp(fields) > LEAST_CHANGE_GAUSS else "several headings"


AXIAL_FIELD = ErrorSource(
    id="gyro_axial_field",
    name="gyro_axial_field",
    targets=GYROS,
    coefficients=(Coefficient("coefficient", "deg/h per gauss", 0.005, 0.05),),
    rivals=("gyro_magnetic_sensitivity", "gyro_misalignment"),
    source="IEEE Std 952-1997: magnetic sensitivity",
    formula=axial_field,
    priors=(Prior("session", "deg/h per gauss", 0.03, source="its usual size"),),
    need=lacks_field_changes,
    words=Words(
        what="The bias follows the magnetic field along the gyro's own axis.",
        brought_on_by="Another heading, or another latitude.",
        size="0.05 deg/h per gauss is 0.02 deg/h between north and south at 45 degrees.",
        remedy="Shield the gyro; align on the heading that it was calibrated on.",
    ),
)

if __name__ == "__main__":
    print(f"{AXIAL_FIELD.name}: {AXIAL_FIELD.words.what if AXIAL_FIELD.words else ''}")
