"""What a log of fixes says against itself or its header: fixes that repeat, a site elsewhere, a
unit that looks sideways.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from infield.aided.reasons import AidedNote
from infield.aided.start import SOON_S
from ins.attitude import euler_from_dcm, wrap_pi
from ins.earth import ecef_from_geodetic
from ins.filters.aided_records import AidedHistory, Fixes
from ins.records import Site
from ins.units import DEG
from ins.verdicts import Reason, because

# no two good fixes are the same above it: of ten a second 5 cm apart, where 1e-7 deg are 1 cm
REPEATS_ABOVE_M_S = 0.5
# 0.1 m/s of the receiver's noise are 1.1 deg of course at 5 m/s; the median of 30 rows has 0.23
# of the scatter of one (1.25 / sqrt(30))
ON_TRACK_M_S, ON_TRACK_ROWS = 5.0, 30
# chosen: mountings are within a degree or two, so 5 deg are no mounting; a scatter beyond 20 deg
# is wind or slip, not a turned unit. It is a note and changes nothing
OFF_TRACK_RAD, SPREAD_RAD = 5.0 * DEG, 20.0 * DEG
SITE_OFF_M, SITE_SIGMAS = 30.0, 5.0  # 5 sigmas: 6e-7 of Gaussian errors lie beyond


def without_repeats(fixes: Fixes) -> tuple[Fixes, tuple[Reason, ...]]:
    """The fixes less those whose position is, bit for bit, that of the one before while the
    receiver says that it moves.
    """
    r_e, speed = fixes.r_e_m, np.linalg.norm(fixes.v_n_m_s, axis=1)
    same = np.zeros(len(r_e), dtype=bool)
    same[1:] = (r_e[1:] == r_e[:-1]).all(axis=1) & (speed[1:] > REPEATS_ABOVE_M_S)
    if not same.any():
        return fixes, ()
    rows = np.flatnonzero(same)
    hole = np.where(same[:, None], np.nan, 0.0)
    note = because(
        AidedNote.REPEATED_FIXES,
        count=rows.size,
        first_s=fixes.time_s[rows[0]],
        last_s=fixes.time_s[rows[-1]],
        speed_m_s=float(np.median(speed[rows])),
    )
    return replace(fixes, r_e_m=r_e + hole, v_n_m_s=fixes.v_n_m_s + hole), (note,)


def site_note(
    fixes: Fixes, stands: tuple[Where, ...], site: Site, start_s: float
) -> tuple[Reason, ...]:
    """Whether a log that begins parked has its first fixes where the header says that it stands."""
    parked = next((s for s in stands if s[0] < start_s + SOON_S), None)
    if parked is None:
        return ()
    rows = np.flatnonzero(
        (fixes.time_s >= parked[0]) & (fixes.time_s <= parked[1]) & np.isfinite(fixes.r_e_m[:, 0])
    )
    if not rows.size:
        return ()
    off = np.median(fixes.r_e_m[rows], axis=0) - ecef_from_geodetic(
        site.lat_rad, site.lon_rad, site.height_m
    )
    off_m = float(np.linalg.norm(off))
    sigma_m = float(np.linalg.norm(fixes.sigma_position_m[rows[0]]))
    if off_m < max(SITE_OFF_M, SITE_SIGMAS * sigma_m):
        return ()
    return (because(AidedNote.SITE_ELSEWHERE, off_m=off_m),)


def mounting_note(history: AidedHistory) -> tuple[Reason, ...]:
    """Whether body x keeps off the track: a unit turned about the vertical is navigated right, and
    its heading is its own.
    """
    v_n = history.v_n_m_s
    rows = np.linalg.norm(v_n[:, :2], axis=1) > ON_TRACK_M_S
    if rows.sum() < ON_TRACK_ROWS:
        return ()
    off = wrap_pi(euler_from_dcm(history.C_nb[rows])[2] - np.arctan2(v_n[rows, 1], v_n[rows, 0]))
    mean = _middle(off)
    spread = float(np.median(np.abs(wrap_pi(off - mean))))
    if abs(mean) < OFF_TRACK_RAD or spread > SPREAD_RAD:
        return ()
    return (because(AidedNote.OFF_THE_TRACK, mean_rad=mean, spread_rad=spread),)


def _middle(angles: NDArray) -> float:
    """Median of angles [rad] about their mean direction."""
    around = np.arctan2(np.sin(angles).mean(), np.cos(angles).mean())
    return float(wrap_pi(around + np.median(wrap_pi(angles - around))))
