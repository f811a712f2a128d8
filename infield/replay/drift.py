"""How far a free-inertial solution drifts, in aviation's measures: against a parked position,
against an outside track::

    rate_nm_h      radial position error at the end of the span / hours since navigation began
                   (radial error rate)
    rms_rate_nm_h  RMS radial error over the span / RMS time over the span: the slope of the
                   straight line through the start that has the error's own RMS; less at the
                   mercy of the Schuler phase at the end than rate_nm_h
    drift_class    "2T+2" where the error stays within 2 T + 2 NM at every time T [h] of the
                   span, else "3T+3", else "beyond 3T+3"

A constant tilt rate u from rest gives R u (1 - sin(w t)/(w t)) t of position error, w the Schuler
rate: 60 NM/h for each deg/h over whole periods of 84.4 min, and between 0 and 1.22 times that in
between (physics.md 6.3).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ins.documents import UNWRITTEN
from ins.earth import displacement_ned, radii_of_curvature
from ins.records import GnssLog, NavHistory, ReferenceLog, Site
from ins.units import HOUR, KNOT, NAUTICAL_MILE

# residual ground speed at the gate above which the crew realigns; requirements.md: 5 kt at the gate
REALIGN_M_S = 5.0 * KNOT
DRIFT_CLASSES = (("2T+2", 2.0, 2.0), ("3T+3", 3.0, 3.0))  # name, NM/h, NM


@dataclass(frozen=True, kw_only=True)
class Drift:
    """Errors of a solution over a span, and their measures (this module's head).

    time_s (n,): since navigation began; position_m, velocity_m_s (n, 2): north and east, computed -
    true. limit_2t_2_nm, limit_3t_3_nm: of the classes, at the end.
    """

    time_s: NDArray = field(repr=False, metadata=UNWRITTEN)
    position_m: NDArray = field(repr=False, metadata=UNWRITTEN)
    velocity_m_s: NDArray = field(repr=False, metadata=UNWRITTEN)
    hours: float
    end_radial_error_m: float
    end_radial_error_nm: float
    max_radial_error_nm: float
    rate_nm_h: float
    rms_rate_nm_h: float
    end_speed_m_s: float
    max_speed_m_s: float
    end_speed_kt: float
    drift_class: str
    limit_2t_2_nm: float
    limit_3t_3_nm: float

    @property
    def radial_m(self) -> NDArray:
        return np.linalg.norm(self.position_m, axis=1)

    @property
    def speed_m_s(self) -> NDArray:
        return np.linalg.norm(self.velocity_m_s, axis=1)


def drift_of(time_s: NDArray, position_m: NDArray, velocity_m_s: NDArray) -> Drift:
    """The measures of errors; arguments as of a `Drift`."""
    radial_m = np.linalg.norm(position_m, axis=1)
    speed_m_s = np.linalg.norm(velocity_m_s, axis=1)
    hours = float(time_s[-1] / HOUR)
    (_, slope2, offset2), (_, slope3, offset3) = DRIFT_CLASSES
    return Drift(
        time_s=time_s,
        position_m=position_m,
        velocity_m_s=velocity_m_s,
        hours=hours,
        end_radial_error_m=float(radial_m[-1]),
        end_radial_error_nm=float(radial_m[-1]) / NAUTICAL_MILE,
        max_radial_error_nm=float(radial_m.max()) / NAUTICAL_MILE,
        rate_nm_h=float(radial_m[-1] / NAUTICAL_MILE / hours),
        rms_rate_nm_h=float(np.sqrt(np.mean(radial_m**2) / np.mean(time_s**2)) / KNOT),
        end_speed_m_s=float(speed_m_s[-1]),
        max_speed_m_s=float(speed_m_s.max()),
        end_speed_kt=float(speed_m_s[-1]) / KNOT,
        drift_class=_drift_class(time_s, radial_m),
        limit_2t_2_nm=slope2 * hours + offset2,
        limit_3t_3_nm=slope3 * hours + offset3,
    )


def _drift_class(time_s: NDArray, radial_m: NDArray) -> str:
    for name, slope, offset in DRIFT_CLASSES:
        if np.all(radial_m <= (slope * time_s / HOUR + offset) * NAUTICAL_MILE):
            return name
    return f"beyond {DRIFT_CLASSES[-1][0]}"


def parked_drift(history: NavHistory, site: Site, until_s: float) -> Drift:
    """Position less the site and velocity less zero, from the end of the alignment to the first
    movement.
    """
    rows = slice(1, int(np.searchsorted(history.time_s, until_s, side="right")))
    position = displacement_ned(
        history.lat_rad[rows],
        history.lon_rad[rows],
        lat0_rad=site.lat_rad,
        lon0_rad=site.lon_rad,
        height0_m=site.height_m,
    )
    return drift_of(
        time_s=history.time_s[rows] - history.time_s[0],
        position_m=position,
        velocity_m_s=history.v_n_m_s[rows, :2],
    )


def drift_against(
    history: NavHistory, other: GnssLog | ReferenceLog, lever_arm_m: NDArray, from_s: float
) -> Drift | None:
    """The solution less an outside track, at the track's times nearest to the solution's own, from
    `from_s` on.

    None where the track has nothing there.
    lever_arm_m (3,): from the IMU to the point of the track. The offset between the two while
    parked (a site entered roughly) is taken out: it is no drift.
    """
    t0, t1 = float(history.time_s[0]), float(history.time_s[-1])
    used = _nearest(history.time_s, other.time_s)
    used = used[(other.time_s[used] >= t0) & (other.time_s[used] <= t1)]
    t = other.time_s[used]
    after = t > from_s
    if not after.any():
        return None
    k = np.clip(
        np.rint(np.interp(t, history.time_s, np.arange(history.time_s.size))).astype(int), 1, None
    )
    dt = np.diff(history.time_s)[k - 1]
    # Earth rate stays in: 0.1 mm/s per metre of arm
    omega_b = history.dtheta_b_rad[k] / dt[:, None]
    arm_n = np.einsum("kij,j->ki", history.C_nb[k], lever_arm_m)
    turn_n = np.einsum("kij,kj->ki", history.C_nb[k], np.cross(omega_b, lever_arm_m))
    lat, lon = (
        np.interp(t, history.time_s, a) for a in (history.lat_rad, np.unwrap(history.lon_rad))
    )
    v = np.stack([np.interp(t, history.time_s, history.v_n_m_s[:, i]) for i in (0, 1)], axis=1)
    meridian, transverse = radii_of_curvature(lat)
    dlon = np.mod(lon - other.lon_rad[used] + np.pi, 2 * np.pi) - np.pi
    north = (lat - other.lat_rad[used]) * (meridian + other.height_m[used])
    position = (
        np.stack([north, dlon * (transverse + other.height_m[used]) * np.cos(lat)], axis=1)
        + arm_n[:, :2]
    )
    velocity = v + turn_n[:, :2] - other.v_n_m_s[used, :2]
    before = other.time_s <= min(t0 + 1.0, t1)
    return drift_of(
        time_s=t[after] - t0,
        position_m=position[after] - _offset(history, other, before, arm_n[0, :2]),
        velocity_m_s=velocity[after],
    )


def _nearest(time_s: NDArray, track_s: NDArray) -> NDArray:
    """Rows of the track nearest to each time, each once."""
    edges = 0.5 * (track_s[1:] + track_s[:-1])
    return np.unique(np.searchsorted(edges, time_s))


def _offset(
    history: NavHistory, other: GnssLog | ReferenceLog, rows: NDArray, arm_n: NDArray
) -> NDArray:
    """Median of start position less track while still parked (2,) [m]; zero where the track begins
    later.
    """
    if not rows.any():
        return np.zeros(2)
    back = displacement_ned(
        other.lat_rad[rows],
        other.lon_rad[rows],
        lat0_rad=float(history.lat_rad[0]),
        lon0_rad=float(history.lon_rad[0]),
        height0_m=float(history.height_m[0]),
    )
    return np.asarray(-np.median(back, axis=0) + arm_n)
