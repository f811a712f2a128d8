"""Whether fixes, their velocities and a wheel speak of the same motion: units and axes of a map
that rest does not show.

Positions are the yardstick: a receiver's velocity is that of its positions, and a wheel's speed
that of the velocity.
"""

import numpy as np
from numpy.typing import NDArray

from ins.earth import displacement_ned
from ins.records import GnssLog, OdometerLog
from trajectories.runs.checks import Findings

COMPARED_ABOVE_M_S = 2.0  # three sigmas of the difference of fixes of 0.5 m a second apart
CLIMBING_M_S = 0.5  # chosen: 100 ft/min, a fifth of a usual slow climb (500)
LEAST_PAIRS = 20  # of fixes: the median has 0.28 of one pair's scatter, 1.25 / sqrt(20)
# of two fixes: one of a fix a second may be lost (2 s); a turn between would show
MAX_APART_S = 2.5
# of the speed, median: what velocities may be off their positions; the nearest wrong unit, m/s
# taken for kn, is off by 0.49
OFF = 0.3
# of the speed, median: what the right unit leaves; kn and mph are 0.15 apart, and
# tests/trajectories/test_conversion_streams.py fails at half and at twice of it
FITS = 0.1
SPEED_FACTORS = {  # a speed that reads so many times what it is
    3.6: "km/h taken for m/s",
    1 / 3.6: "m/s taken for km/h",
    3600 / 1852: "kn taken for m/s",
    1852 / 3600: "m/s taken for kn",
    1.852: "km/h taken for kn",
    1 / 1.852: "kn taken for km/h",
    1 / 0.44704: "mph taken for m/s",
    1e3: "mm/s taken for m/s",
    1e2: "cm/s taken for m/s",
    1e-2: "m/s taken for cm/s",
}


def check_streams(
    gnss: GnssLog | None, odometer: OdometerLog | None, *, label: str, findings: Findings
) -> None:
    """Adds an error where velocities or a wheel show another unit, order or sign than they were
    taken for.
    """
    if gnss is None or gnss.time_s.size <= LEAST_PAIRS:
        return
    for told in (_velocities(gnss), _wheel(gnss, odometer) if odometer is not None else ""):
        findings.error(*([f"{label}: {told}"] if told else []))


def _velocities(gnss: GnssLog) -> str:
    """What is wrong with the velocities against the positions, and what would be right."""
    way, v = _pairs(gnss)
    moving = np.linalg.norm(way[:, :2], axis=1) > COMPARED_ABOVE_M_S
    if np.count_nonzero(moving) >= LEAST_PAIRS:
        level, seen = way[moving, :2], v[moving, :2]
        orders = {
            "": seen,
            "east taken for north (frame?)": seen[:, ::-1],
            "signs turned round": -seen,
        }
        found = []
        for order, values in orders.items():
            for factor, unit in {1.0: "", **SPEED_FACTORS}.items():
                cause = ", ".join(filter(None, (order, unit)))
                found.append((_off(values / factor, level), cause))
        off, cause = min(found)
        if found[0][0] > OFF and off < FITS and cause:
            return (
                f"velocities of the fixes are {found[0][0]:.0%} off what their positions do:"
                f" {cause}?"
            )
    climbing = np.abs(way[:, 2]) > CLIMBING_M_S
    if (
        np.count_nonzero(climbing) >= LEAST_PAIRS
        and abs(np.median(v[climbing, 2] / way[climbing, 2]) + 1) < OFF
    ):
        return "the fixes rise where their velocity says down: up taken for down (frame?)"
    return ""


def _pairs(gnss: GnssLog) -> tuple[NDArray, NDArray]:
    """Mean velocity north, east, down between fixes by their positions, and by their velocities,
    (n, 3) each [m/s].
    """
    step = np.diff(gnss.time_s)
    k = np.flatnonzero((step > 0) & (step <= MAX_APART_S))
    level = displacement_ned(
        gnss.lat_rad[k + 1],
        gnss.lon_rad[k + 1],
        lat0_rad=gnss.lat_rad[k],
        lon0_rad=gnss.lon_rad[k],
        height0_m=gnss.height_m[k],
    )
    way = np.column_stack([level[:, :2], gnss.height_m[k] - gnss.height_m[k + 1]]) / step[k, None]
    return way, 0.5 * (gnss.v_n_m_s[k] + gnss.v_n_m_s[k + 1])


def _off(values: NDArray, right: NDArray) -> float:
    return float(np.median(np.linalg.norm(values - right, axis=1) / np.linalg.norm(right, axis=1)))


def _wheel(gnss: GnssLog, odometer: OdometerLog) -> str:
    """The unit in which the wheel would agree with the velocity of the fixes."""
    speed = np.linalg.norm(gnss.v_n_m_s[:, :2], axis=1)
    beside = np.interp(gnss.time_s, odometer.time_s, odometer.speed_m_s, left=np.nan, right=np.nan)
    rows = np.isfinite(beside) & (speed > COMPARED_ABOVE_M_S) & (beside != 0.0)
    if np.count_nonzero(rows) < LEAST_PAIRS:
        return ""
    ratio = np.abs(beside[rows]) / speed[rows]
    typical = float(np.median(ratio))
    steady = np.median(np.abs(ratio / typical - 1)) < FITS
    cause = next(
        (told for factor, told in SPEED_FACTORS.items() if abs(typical / factor - 1) < FITS), ""
    )
    return (
        f"the wheel reads {typical:.3g} times the speed of the fixes: {cause}?"
        if steady and cause
        else ""
    )
