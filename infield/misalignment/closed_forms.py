"""The closed forms of the fibre-optic misalignment document, with its errors put right and one of
them kept to be shown.

Model as printed, (18) to (20), alpha: azimuth of x, positive from north to west, w_N = Omega cosL::

    kx = kx' - w_N cos(alpha - pi/2) sin(exy)
    ky = ky' + w_N cos(alpha - pi/2) sin(eyx)
    kz = kz' -+ w_N cos(alpha) sin(ezy)        printed with -, but (29) and (33) need +

(27), (28) are missing in it and derived here; (29) divides by w_N, where the print multiplies; (29)
and (33) agree with each other and are used together, so that (20) is read with +. Source:
physics.md section 4, errors 1 to 4. One coupling a gyro, no redundancy:
`infield.misalignment.harmonic_fit` has both couplings and the check.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.records import InputError, frozen_array
from ins.units import DEG

PLACES_DEG = (0.0, 90.0, 180.0, 270.0)
# beyond this from its place a stop is not the one that the closed forms mean; 1 - cos(10 deg) is
# 1.5 % of the level Earth rate
NEAR_DEG = 10.0


@dataclass(frozen=True, kw_only=True)
class DocumentAngles:
    """(27), (28), (29) with their sigmas [rad]; literal_ezy_rad: (29) as printed, NaN where its
    arcsine fails.
    """

    exy_rad: float
    eyx_rad: float
    ezy_rad: float
    sigma_rad: tuple[float, float, float]
    literal_ezy_rad: float
    stops: tuple[int, int, int, int]


def document_angles(
    north_to_west_rad: ArrayLike,
    bias_deg_h: ArrayLike,
    covariance: ArrayLike,
    *,
    level_rate_deg_h: float,
) -> DocumentAngles:
    """Misalignment angles from the stops nearest to 0, 90, 180, 270 deg north to west.

    north_to_west_rad (m,); bias_deg_h (m, 3); covariance (3m, 3m) [(deg/h)^2], stop by stop. The
    actual cosines are used, so a stop may be some degrees off its place. InputError where there is
    none within 10 deg of a place, or where an arcsine has no value.
    """
    alpha = frozen_array(north_to_west_rad, (None,), "north_to_west_rad")
    k = frozen_array(bias_deg_h, (alpha.size, 3), "bias_deg_h")
    P = frozen_array(covariance, (3 * alpha.size, 3 * alpha.size), "covariance")
    stops = [_nearest(alpha, place) for place in PLACES_DEG]
    zero, quarter, half, three = stops
    west = np.cos(alpha - np.pi / 2)
    pairs = (
        (0, quarter, three, west[three] - west[quarter]),  # (27): exy
        (1, quarter, three, west[quarter] - west[three]),  # (28): eyx
        (2, zero, half, np.cos(alpha[zero]) - np.cos(alpha[half])),  # (29): ezy
    )
    angles, sigmas, sines = [], [], []
    for gyro, first, second, span in pairs:
        sine = (k[first, gyro] - k[second, gyro]) / (span * level_rate_deg_h)
        a, b = 3 * first + gyro, 3 * second + gyro
        if not abs(sine) < 1:
            apart = k[first, gyro] - k[second, gyro]
            raise InputError(
                f"closed forms: gyro {'xyz'[gyro]} differs by {apart:g} deg/h: no such angle"
            )
        angles.append(float(np.arcsin(sine)))
        spread = np.sqrt(P[a, a] + P[b, b] - 2 * P[a, b])
        sigmas.append(float(spread / abs(span * level_rate_deg_h) / np.sqrt(1 - sine**2)))
        sines.append(sine)
    literal = sines[2] * level_rate_deg_h**2  # as printed: times w_N where it must be divided
    return DocumentAngles(
        exy_rad=angles[0],
        eyx_rad=angles[1],
        ezy_rad=angles[2],
        sigma_rad=(sigmas[0], sigmas[1], sigmas[2]),
        literal_ezy_rad=float(np.arcsin(literal)) if abs(literal) <= 1 else float("nan"),
        stops=(zero, quarter, half, three),
    )


def document_compensation(
    north_to_west_rad: ArrayLike,
    bias_deg_h: ArrayLike,
    angles: DocumentAngles,
    *,
    level_rate_deg_h: float,
) -> NDArray:
    """(31), (32), (33): biases (m, 3) with the modelled coupling taken off."""
    alpha, k = np.asarray(north_to_west_rad, dtype=float), np.array(bias_deg_h, dtype=float)
    west, north = np.cos(alpha - np.pi / 2), np.cos(alpha)
    k[:, 0] += level_rate_deg_h * west * np.sin(angles.exy_rad)  # (31)
    k[:, 1] -= level_rate_deg_h * west * np.sin(angles.eyx_rad)  # (32)
    k[:, 2] -= level_rate_deg_h * north * np.sin(angles.ezy_rad)  # (33)
    return k


def _nearest(alpha: NDArray, place_deg: float) -> int:
    off = np.abs(np.angle(np.exp(1j * (alpha - place_deg * DEG))))
    j = int(np.argmin(off))
    if off[j] > NEAR_DEG * DEG:
        raise InputError(
            f"closed forms: no stop within {NEAR_DEG:g} deg of {place_deg:g} deg north to west"
        )
    return j
