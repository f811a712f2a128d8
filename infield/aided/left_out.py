"""Fixes left out of an aided flight on purpose, and how far off the solution is from them: what a
user gets where the receiver is without sky.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from alignment.motion.inertial import Where
from ins.earth import dcm_en, ecef_from_geodetic
from ins.filters.aided_records import AidedHistory, Fixes
from ins.filters.states import AIDED_POS
from ins.records import InputError


@dataclass(frozen=True, kw_only=True)
class OutageScore:
    """A stretch whose fixes were left out: level and vertical error of the solution there [m], RMS
    and at the last fix, sigma there, and RMS error over sigma of the three components, the fixes'
    own sigma in it.
    """

    start_s: float
    end_s: float
    fixes: int
    rms_level_m: float
    rms_down_m: float
    end_level_m: float
    sigma_end_level_m: float
    error_over_sigma: float


def check_left_out(spans: tuple[Where, ...], fixes: Fixes, end_s: float) -> None:
    """InputError where a stretch is not in the log, or has no fixes to score."""
    for start_s, stop_s in spans:
        if not start_s < stop_s <= end_s:
            raise InputError(
                f"outage {start_s:g}:{stop_s - start_s:g}: ends at {stop_s:g} s, needed a stretch"
                f" within the log, which ends at {end_s:.6g} s"
            )
        if not _inside(fixes, (start_s, stop_s)).any():
            raise InputError(
                f"outage {start_s:g}:{stop_s - start_s:g}: no satellite fix in it, needed one at"
                " least to score"
            )


def without(fixes: Fixes, spans: tuple[Where, ...]) -> Fixes:
    """The fixes less those of these stretches."""
    if not spans:
        return fixes
    gone = np.any([_inside(fixes, span) for span in spans], axis=0)
    hole = np.where(gone[:, None], np.nan, 0.0)
    return replace(fixes, r_e_m=fixes.r_e_m + hole, v_n_m_s=fixes.v_n_m_s + hole)


def scored(
    history: AidedHistory, fixes: Fixes, spans: tuple[Where, ...]
) -> tuple[OutageScore, ...]:
    """The solution against the fixes that it was not given; stretches before its start have no
    score.
    """
    antenna = history.antenna
    times_s = fixes.time_s - antenna.delay_s
    known = (times_s >= history.time_s[0]) & (times_s <= history.time_s[-1])
    found = []
    for span in spans:
        rows = np.flatnonzero(_inside(fixes, span) & known & np.isfinite(fixes.r_e_m[:, 0]))
        if rows.size:
            found.append(_score(history, fixes, rows, times_s[rows], span))
    return tuple(found)


def _inside(fixes: Fixes, span: Where) -> NDArray:
    return (fixes.time_s >= span[0]) & (fixes.time_s <= span[1])


def _score(
    history: AidedHistory, fixes: Fixes, rows: NDArray, times_s: NDArray, span: Where
) -> OutageScore:
    lever = history.C_nb @ history.antenna.lever_arm_m
    C_en = dcm_en(history.lat_rad, history.lon_rad)
    r_e = ecef_from_geodetic(history.lat_rad, history.lon_rad, history.height_m)
    v_e = np.einsum("kij,kj->ki", C_en, history.v_n_m_s)
    at = CubicHermiteSpline(history.time_s, r_e, v_e)(times_s)
    arm = np.stack([np.interp(times_s, history.time_s, axis) for axis in lever.T], axis=1)
    variance = np.stack(
        [np.interp(times_s, history.time_s, v) for v in history.variance[:, AIDED_POS].T], axis=1
    )
    near = C_en[np.clip(np.searchsorted(history.time_s, times_s), 0, len(C_en) - 1)]
    off = np.einsum("kji,kj->ki", near, at - fixes.r_e_m[rows]) + arm
    level = np.linalg.norm(off[:, :2], axis=1)
    over = off**2 / (variance + fixes.sigma_position_m[rows] ** 2)
    return OutageScore(
        start_s=span[0],
        end_s=span[1],
        fixes=int(rows.size),
        rms_level_m=float(np.sqrt(np.mean(level**2))),
        rms_down_m=float(np.sqrt(np.mean(off[:, 2] ** 2))),
        end_level_m=float(level[-1]),
        sigma_end_level_m=float(np.sqrt(variance[-1, :2].sum())),
        error_over_sigma=float(np.sqrt(np.mean(over))),
    )
