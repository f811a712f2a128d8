"""Velocities for fixes that were logged without: differences of their positions, with a sigma that
owns up to it.

They hold nothing that the positions do not. The sigma takes the errors of two fixes as independent,
where those of a receiver go on for minutes and mostly cancel in a difference: too large, so that
counting position and velocity claims no more than that.

Decision: docs/decisions/0040-known-by-gravity.md.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ins.earth import displacement_ned
from ins.units import DEG
from trajectories.readers.columns.fixes import RawFixes

# between the fixes on either side; chosen: a fix a second is 2 s, one lost on either side 4 s;
# further apart says nothing of the velocity between
MAX_SPAN_S = 4.0
# of the change of velocity from one interval to the next: what the mean over both may be off
UNSTEADY = 0.25


def with_velocities(raw: RawFixes, *, label: str) -> tuple[RawFixes, list[str]]:
    """The fixes with v_n_m_s over the interval from the fix before to the one after, and
    sigma_velocity; a note.

    Needs sigmas of the positions: without them there is no sigma of a difference, and the fixes
    come back without velocity.
    """
    if raw.sigmas is None or not np.isfinite(raw.sigmas[0]).any():
        return raw, [
            f"{label}: fixes without velocity, and no sigma to give to differences of their"
            " positions"
        ]
    with np.errstate(invalid="ignore"):
        usable = (
            raw.is_3d
            & (np.abs(raw.lat_deg) <= 90)
            & np.isfinite(raw.log_s + raw.lon_deg + raw.height_m)
        )
    rows = np.flatnonzero(usable & np.isfinite(raw.sigmas[:2]).all(axis=0))
    v_n, sigmas = np.full((raw.log_s.size, 3), np.nan), np.array(raw.sigmas, dtype=float)
    if rows.size < 2:
        return replace(raw, v_n_m_s=v_n), [
            f"{label}: {rows.size} fixes without velocity, needed 2 for a difference"
        ]
    time_s, k = raw.log_s[rows], np.arange(rows.size)
    before, after = np.maximum(k - 1, 0), np.minimum(k + 1, rows.size - 1)
    span = time_s[after] - time_s[before]
    with np.errstate(divide="ignore", invalid="ignore"):
        near = (span > 0) & (span <= MAX_SPAN_S)
        velocity = np.where(
            near[:, None], _way_n(raw, rows[before], rows[after]) / span[:, None], np.nan
        )
        steps = _way_n(raw, rows[:-1], rows[1:]) / np.diff(time_s)[:, None]
        change = np.linalg.norm(steps[after - 1] - steps[np.minimum(before, rows.size - 2)], axis=1)
        noise = np.hypot(sigmas[0, rows[before]], sigmas[0, rows[after]]) / span
    v_n[rows], sigmas[2, rows] = velocity, np.hypot(noise, UNSTEADY * change)
    typical = float(np.nanmedian(sigmas[2, rows])) if np.isfinite(sigmas[2, rows]).any() else np.nan
    note = (
        f"{label}: fixes have no velocity: differences of their positions, sigma {typical:.3g} m/s"
        " (median)"
    )
    return replace(raw, v_n_m_s=v_n, sigmas=sigmas), [note]


def _way_n(raw: RawFixes, a: NDArray, b: NDArray) -> NDArray:
    """North, east, down from fixes a to fixes b [m], shape (n, 3)."""
    lat, lon, height = raw.lat_deg * DEG, raw.lon_deg * DEG, raw.height_m
    level = displacement_ned(lat[b], lon[b], lat0_rad=lat[a], lon0_rad=lon[a], height0_m=height[a])
    return np.column_stack([level, height[a] - height[b]])
