"""What azimuths alone allow: their rank, and how near they are to four places 90 deg apart."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from infield.misalignment.harmonic_fit import harmonics
from infield.misalignment.reasons import MisalignmentReason
from ins.documents import UNWRITTEN
from ins.errors.catalogue import prior
from ins.units import DEG
from ins.verdicts import Reason, because

MAX_OFF_DEG = 2.0  # of an azimuth from its nominal place (requirements R21)
# a stop below this says less than the flicker of the gyro: ARW / sqrt(t) alone is 0.007 deg/h
SHORTEST_STOP_S = 300.0
# of the error that all given headings share, 1 sigma: docs/reference/formats.md section 6
SIGMA_HEADING_DEG = 0.1


@dataclass(frozen=True, kw_only=True)
class AzimuthSettings:
    """max_off_deg: how far an azimuth may be off its place; prior_mrad: what a coupling may be
    before the measurement; sigma_mounting_arcsec: of the unit's base against the axis that it is
    turned about, None: not known; sigma_heading_deg: of the error that all given headings share.
    """

    shortest_s: float = SHORTEST_STOP_S
    max_off_deg: float = MAX_OFF_DEG
    prior_mrad: float = prior("gyro_misalignment_x", "azimuths").size
    sigma_mounting_arcsec: float | None = None
    sigma_heading_deg: float = SIGMA_HEADING_DEG


# least over largest singular value of [1, cosH, sinH]: azimuths closer than 2 deg are one
RANK_TOLERANCE = 0.02
# of an azimuth that is said to be at the limit itself; 3e-7 deg/h of Earth rate
ROUNDING_DEG = 1e-6


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """What the azimuths alone allow: rank and condition number of [1, cosH, sinH], and the four
    places.

    origin_deg: of the cross 0, 90, 180, 270 deg that they stand on; missing_deg: places where
    nothing stood within 45 deg; largest_off_deg: of the stop nearest to each place from it;
    limit_off_deg: of that; reasons: why four azimuths are not there.
    """

    rank: int
    needed: int = 3
    condition: float
    origin_deg: float
    missing_deg: tuple[float, ...]
    largest_off_deg: float
    limit_off_deg: float
    reasons: tuple[Reason, ...] = field(metadata=UNWRITTEN)


def azimuth_geometry(heading_rad: ArrayLike, *, max_off_deg: float = MAX_OFF_DEG) -> Geometry:
    """Rank report of headings (m,): four azimuths 90 deg apart, each within `max_off_deg`, or the
    reasons why not.
    """
    heading = np.atleast_1d(np.asarray(heading_rad, dtype=float))
    s = np.linalg.svd(harmonics(heading), compute_uv=False)
    rank = int(np.sum(s > RANK_TOLERANCE * s[0]))
    condition = float(s[0] / s[2]) if s.size == 3 and rank == 3 else float("inf")
    origins = [0.0, *heading]
    origin, missing, off = min(
        (_cross(heading, o) for o in origins), key=lambda c: (len(c[1]), c[2])
    )
    reasons = []
    if missing:
        reasons.append(
            because(
                MisalignmentReason.AZIMUTHS_MISSING,
                found=4 - len(missing),
                missing_deg=missing,
                rank=rank,
            )
        )
    elif off > max_off_deg + ROUNDING_DEG:
        reasons.append(
            because(
                MisalignmentReason.STOP_OFF_ITS_PLACE,
                off_deg=off,
                needed_deg=max_off_deg,
                rank=rank,
            )
        )
    return Geometry(
        rank=rank,
        condition=condition,
        origin_deg=origin,
        missing_deg=missing,
        largest_off_deg=off,
        limit_off_deg=max_off_deg,
        reasons=tuple(reasons),
    )


def _cross(heading: NDArray, first_rad: float) -> tuple[float, tuple[float, ...], float]:
    """Origin, missing places and largest offset [deg] of the cross near `first_rad` (0: the
    cardinal one, kept).
    """
    turn = np.mod(heading - first_rad, 2 * np.pi) / (np.pi / 2)
    place = np.round(turn).astype(int) % 4
    offset = (turn - np.round(turn)) * 90.0
    nearest = [float(o[np.argmin(np.abs(o))]) for q in range(4) if (o := offset[place == q]).size]
    shift = float(np.median(nearest)) if first_rad else 0.0
    origin = float(np.mod(first_rad / DEG + shift, 360.0))
    missing = tuple(
        float(np.mod(origin + 90.0 * q, 360.0)) for q in range(4) if not np.any(place == q)
    )
    return float(np.mod(origin, 90.0)), missing, float(np.max(np.abs(np.array(nearest) - shift)))
