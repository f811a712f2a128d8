"""Satellite fixes of a log: the good ones, the site, and what UTC the log's clock shows.

Decision: docs/decisions/0040-known-by-gravity.md.
"""

from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ins.columns import FIX_SIGMA_COLUMNS
from ins.earth import displacement_ned
from ins.records import GnssLog, LatitudeSource
from ins.units import DEG
from trajectories.readers.registry import ConvertedLog
from trajectories.readers.rows.clocks import UNIX_S, utc_text
from trajectories.readers.rows.row_cleaning import row_ranges
from trajectories.runs.notes import About, Note
from trajectories.runs.streams import latitude_sigma_rad

MAX_JUMP_DEG = 0.01  # between a fix and the median of five: 1.1 km, no aircraft at 5 Hz
# between a fix and the median of five, 2 s at one fix a second: a clock that was set
MAX_JUMP_S = 10.0
MAX_SPEED_M_S = 1000.0  # chosen: twice the 515 m/s (1,000 kt) at which receivers for export stop
MAX_HEIGHT_M = 30_000.0  # that of a site (ins.records.Site); receivers for export stop at 18 km
# Between a fix and what belongs to it in a message of its own: velocity, accuracy; fixes come at
# 5 Hz and slower.
MATCH_S = 0.15
# of a sigma [m, m/s]: what receivers write that know nothing (docs/log_formats.md)
LOST_SIGMA = 1e6
# between the fixes on either side; chosen: a fix a second is 2 s, one lost on either side 4 s;
# further apart says nothing of the velocity between
MAX_SPAN_S = 4.0
# of the change of velocity from one interval to the next: what the mean over both may be off
UNSTEADY = 0.25


@dataclass(frozen=True, kw_only=True)
class RawFixes:
    """What a log says of its fixes, shape (n,) each, on its own clock; v_n_m_s (n, 3).

    is_3d: has a position; unix_s: UTC, NaN where unknown; sigmas (3, n): horizontal, vertical [m],
    velocity [m/s]; fix_type (n,): `FixType`, NaN where unknown.
    """

    log_s: NDArray
    is_3d: NDArray
    lat_deg: NDArray
    lon_deg: NDArray
    height_m: NDArray
    v_n_m_s: NDArray
    unix_s: NDArray
    sigmas: NDArray | None = None
    fix_type: NDArray | None = None


class StartKeys(TypedDict, total=False):
    """Keys of run.json that fixes know."""

    site: dict[str, float | str]
    start_utc: str


@dataclass(frozen=True, kw_only=True)
class LoggedFixes:
    """The good fixes on the log's own clock [s], and UTC (since 1970) less log seconds (None where
    unknown).
    """

    gnss: GnssLog
    unix_less_log_s: float | None

    def header(self, log: ConvertedLog) -> StartKeys:
        """run.json keys: the first fix from the log's start on (the last where all are earlier),
        and start_utc.
        """
        k = min(int(np.searchsorted(self.gnss.time_s, log.time_shift_s)), self.gnss.time_s.size - 1)
        place = (self.gnss.lat_rad[k] / DEG, self.gnss.lon_rad[k] / DEG, self.gnss.height_m[k])
        site: dict[str, float | str] = {
            name: round(float(v), 7) for name, v in zip(("lat_deg", "lon_deg", "height_m"), place)
        }
        site["sigma_lat_deg"] = round(latitude_sigma_rad(self.gnss, k) / DEG, 9)
        site["lat_source"] = LatitudeSource.RECEIVER.value
        if self.unix_less_log_s is None:
            return {"site": site}
        return {"site": site, "start_utc": utc_text(self.unix_less_log_s + log.time_shift_s)}

    def on_run_time(self, log: ConvertedLog) -> GnssLog | None:
        """The fixes beside the log's imu rows, on run time; None where there is none."""
        time_s = self.gnss.time_s - log.time_shift_s
        rows = (time_s >= 0) & (time_s <= log.imu.end_s)
        if not rows.any():
            return None
        kept = {k: v[rows] for k, v in vars(self.gnss).items() if v is not None}
        return GnssLog(**{**kept, "time_s": time_s[rows]})


def chosen(raw: RawFixes, rows: NDArray) -> RawFixes:
    """Some of the fixes, by index or by mask (n,)."""
    return RawFixes(
        log_s=raw.log_s[rows],
        is_3d=raw.is_3d[rows],
        lat_deg=raw.lat_deg[rows],
        lon_deg=raw.lon_deg[rows],
        height_m=raw.height_m[rows],
        v_n_m_s=raw.v_n_m_s[rows],
        unix_s=raw.unix_s[rows],
        sigmas=None if raw.sigmas is None else raw.sigmas[:, rows],
        fix_type=None if raw.fix_type is None else raw.fix_type[rows],
    )


def largest(values: NDArray) -> float:
    """The largest size of what is finite; 0 where nothing is."""
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))


def may_be_radians(lat: NDArray, lon: NDArray) -> bool:
    """Whether all positions lie within a quarter and half turn of radians: as degrees, in the Gulf
    of Guinea, without land.
    """
    placed = np.isfinite(lat) & np.isfinite(lon) & ((lat != 0.0) | (lon != 0.0))
    return (
        bool(placed.any()) and largest(lat[placed]) <= np.pi / 2 and largest(lon[placed]) <= np.pi
    )


def good_fixes(raw: RawFixes, *, label: str) -> tuple[LoggedFixes | None, list[str]]:
    """The 3D fixes that are finite, in order of time and where their neighbours are; notes on those
    left out.

    A fix at 0 N 0 E exactly is none. Longitudes of 180 to 360 deg are west.
    """
    raw = replace(raw, lon_deg=np.where(raw.lon_deg > 180.0, raw.lon_deg - 360.0, raw.lon_deg))
    rows, left_out = _good_rows(raw)
    sigmas, told = _sigmas(raw.sigmas, rows, label)
    notes: list[str] = [
        Note(f"{label}: GPS {row_ranges(r)} left out: {why}", About.FIXES)
        for why, r in left_out.items()
        if r.size
    ]
    if not rows.size:
        return None, [*notes, Note(f"{label}: no 3D fix: no gnss stream", About.FIXES)]
    gnss = GnssLog(
        time_s=raw.log_s[rows],
        lat_rad=raw.lat_deg[rows] * DEG,
        lon_rad=raw.lon_deg[rows] * DEG,
        height_m=raw.height_m[rows],
        v_n_m_s=raw.v_n_m_s[rows],
        **sigmas,
        fix_type=_types(raw.fix_type, rows),
    )
    with np.errstate(invalid="ignore"):
        dated = rows[(raw.unix_s[rows] > UNIX_S[0]) & (raw.unix_s[rows] < UNIX_S[1])]
    offset = float(np.median(raw.unix_s[dated] - raw.log_s[dated])) if dated.size else None
    if offset is None and np.isfinite(raw.unix_s[rows]).any():
        no_date = f"{label}: GPS weeks that give no date (unknown, or modulo 1024)"
        told.append(Note(no_date, About.DATE))
    return LoggedFixes(gnss=gnss, unix_less_log_s=offset), notes + told


def _good_rows(raw: RawFixes) -> tuple[NDArray, dict[str, NDArray]]:
    columns = np.stack([raw.log_s, raw.lat_deg, raw.lon_deg, raw.height_m, *raw.v_n_m_s.T])
    finite = np.isfinite(columns).all(axis=0)
    with np.errstate(invalid="ignore"):
        sane = (
            (np.abs(raw.lat_deg) <= 90)
            & (np.abs(raw.lon_deg) <= 180)
            & (np.abs(raw.height_m) < MAX_HEIGHT_M)
        )
        sane &= (np.abs(raw.v_n_m_s) < MAX_SPEED_M_S).all(axis=1)
    nowhere = raw.is_3d & (raw.lat_deg == 0.0) & (raw.lon_deg == 0.0)
    lost = (
        np.zeros(nowhere.size, dtype=bool)
        if raw.sigmas is None
        else np.any(raw.sigmas >= LOST_SIGMA, axis=0)
    )
    rows = np.flatnonzero(raw.is_3d & finite & sane & ~nowhere & ~lost)
    near = (_jump(raw.lat_deg[rows]) <= MAX_JUMP_DEG) & (_jump(raw.lon_deg[rows]) <= MAX_JUMP_DEG)
    near &= _jump(raw.log_s[rows]) <= MAX_JUMP_S
    placed = rows[near]
    later = raw.log_s[placed] > np.concatenate(
        [[-np.inf], np.maximum.accumulate(raw.log_s[placed])[:-1]]
    )
    return placed[later], {
        "no 3D fix": np.flatnonzero(~raw.is_3d),
        "0 N 0 E: no fix": np.flatnonzero(nowhere),
        "not finite or beyond any aircraft": np.flatnonzero(
            raw.is_3d & ~(finite & sane) & ~nowhere
        ),
        f"the receiver's own sigma is {LOST_SIGMA:g} or more": np.flatnonzero(
            raw.is_3d & finite & sane & lost & ~nowhere
        ),
        "time or position jumps and comes back": rows[~near],
        "time repeats or goes back": placed[~later],
    }


def _types(types: NDArray | None, rows: NDArray) -> NDArray | None:
    """The types of some fixes; None where none is known."""
    if types is None or not np.isfinite(types[rows]).any():
        return None
    return types[rows]


def _jump(values: NDArray) -> NDArray:
    """Distance of each value from the median of the five around it."""
    return np.abs(values - median_filter(values, size=5, mode="mirror")) if values.size else values


def _sigmas(
    sigmas: NDArray | None, rows: NDArray, label: str
) -> tuple[dict[str, NDArray], list[str]]:
    """The receiver's own accuracies under the names of `GnssLog`, NaN in a fix without, and notes
    on those.

    One that no fix has is left out.
    """
    out, notes = {}, []
    for name, values in zip(FIX_SIGMA_COLUMNS, sigmas[:, rows] if sigmas is not None else ()):
        with np.errstate(invalid="ignore"):
            given = values > 0
        if given.any():
            out[name] = np.where(given, values, np.nan)
        if given.any() and not given.all():
            which = row_ranges(rows[~given])
            notes.append(
                f"{label}: GPS {which} without {name}: the declared one of the twin counts there"
            )
    return out, notes


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
