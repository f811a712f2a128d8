"""WGS-84: shape, rotation, plumb-line gravity. The only module that imports pymap3d.

Latitude, longitude in radians, heights in metres above the ellipsoid, north-east-down components.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

SEMI_MAJOR_AXIS_M = 6378137.0  # WGS-84 (NIMA TR8350.2, table 3.1)
FLATTENING = 1 / 298.257223563  # WGS-84 (NIMA TR8350.2, table 3.1)
EARTH_RATE_RAD_S = 7.292115e-5  # WGS-84 (NIMA TR8350.2, table 3.1)
GM_M3_S2 = 3.986004418e14  # WGS-84 (NIMA TR8350.2, table 3.1)
GRAVITY_EQUATOR_M_S2 = 9.7803253359  # WGS-84 (NIMA TR8350.2, table 3.4)
GRAVITY_POLE_M_S2 = 9.8321849378  # WGS-84 (NIMA TR8350.2, table 3.4)
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
SEMI_MINOR_AXIS_M = SEMI_MAJOR_AXIS_M * (1 - FLATTENING)
SOMIGLIANA_K = (
    SEMI_MINOR_AXIS_M * GRAVITY_POLE_M_S2 / (SEMI_MAJOR_AXIS_M * GRAVITY_EQUATOR_M_S2) - 1
)
GRAVITY_RATIO_M = EARTH_RATE_RAD_S**2 * SEMI_MAJOR_AXIS_M**2 * SEMI_MINOR_AXIS_M / GM_M3_S2


def gravity_magnitude(lat_rad: ArrayLike, height_m: ArrayLike) -> NDArray:
    """Normal gravity, positive down: attraction plus centrifugal.

    Parameters
    ----------
    lat_rad, height_m : array_like, shape (...)
        Geodetic latitude; height above the ellipsoid, valid -500 to 20 000 m.

    Returns
    -------
    gravity : ndarray, shape (...)
        In m/s^2.

    Notes
    -----
    Somigliana's formula on the ellipsoid, second order in height.

    Left out: deflection of the vertical and gravity anomalies (up to about 50 micro-g), the small
    northward component at height (0.8 micro-g per km at 45 deg).

    Source: NIMA TR8350.2 (2000), eqs. (4-1) and (4-3). Pinned by: boule in tests/ins/test_earth.py

    Examples
    --------
    >>> round(float(gravity_magnitude(0.0, 0.0)), 6)
    9.780325
    """
    sin2 = np.sin(np.asarray(lat_rad, dtype=float)) ** 2
    h = np.asarray(height_m, dtype=float)
    surface = (
        GRAVITY_EQUATOR_M_S2 * (1 + SOMIGLIANA_K * sin2) / np.sqrt(1 - ECCENTRICITY_SQUARED * sin2)
    )
    a = SEMI_MAJOR_AXIS_M
    return surface * (
        1 - 2 / a * (1 + FLATTENING + GRAVITY_RATIO_M - 2 * FLATTENING * sin2) * h + 3 * h**2 / a**2
    )


def gravity_n(lat_rad: ArrayLike, height_m: ArrayLike) -> NDArray:
    """Plumb-line gravity resolved in NED.

    Parameters
    ----------
    lat_rad, height_m : array_like, shape (...)
        Geodetic latitude; height above the ellipsoid, valid -500 to 20 000 m.

    Returns
    -------
    g_n : ndarray, shape (..., 3)
        In m/s^2, positive down; at rest and level an accelerometer reads -g_n.

    Notes
    -----
    What is left out is that of `gravity_magnitude`.
    """
    g = gravity_magnitude(lat_rad, height_m)
    return np.stack([np.zeros_like(g), np.zeros_like(g), g], axis=-1)


def omega_ie_n(lat_rad: ArrayLike) -> NDArray:
    """Earth rate resolved in NED.

    Parameters
    ----------
    lat_rad : array_like, shape (...)
        Geodetic latitude.

    Returns
    -------
    omega_ie_n : ndarray, shape (..., 3)
        (Omega cos L, 0, -Omega sin L) [rad/s].

    Notes
    -----
    Left out: polar motion (below 3e-6 rad) and changes of the length of day (5e-8 of the rate).

    Examples
    --------
    >>> omega_ie_n(0.0) / EARTH_RATE_RAD_S
    array([ 1.,  0., -0.])
    """
    L = np.asarray(lat_rad, dtype=float)
    return EARTH_RATE_RAD_S * np.stack([np.cos(L), np.zeros_like(L), -np.sin(L)], axis=-1)


def omega_ie_n_by_lat(lat_rad: ArrayLike) -> NDArray:
    """Earth rate resolved in NED, by latitude: what a latitude's error leaves in the gyros.

    Parameters
    ----------
    lat_rad : array_like, shape (...)
        Geodetic latitude.

    Returns
    -------
    omega_ie_n_by_lat : ndarray, shape (..., 3)
        (-Omega sin L, 0, -Omega cos L) [rad/s per rad].

    Notes
    -----
    Source: the derivative of `omega_ie_n`.

    Examples
    --------
    >>> omega_ie_n_by_lat(0.0) / EARTH_RATE_RAD_S
    array([-0.,  0., -1.])
    """
    L = np.asarray(lat_rad, dtype=float)
    return EARTH_RATE_RAD_S * np.stack([-np.sin(L), np.zeros_like(L), -np.cos(L)], axis=-1)


def radii_of_curvature(lat_rad: ArrayLike) -> tuple[NDArray, NDArray]:
    """Meridian and transverse radius of curvature of the ellipsoid.

    Parameters
    ----------
    lat_rad : array_like, shape (...)
        Geodetic latitude.

    Returns
    -------
    meridian_m, transverse_m : ndarray, shape (...)
        Of the surface, without the height.

    Notes
    -----
    Source: Groves (2013), eqs. (2.105), (2.106).
    """
    w2 = 1 - ECCENTRICITY_SQUARED * np.sin(np.asarray(lat_rad, dtype=float)) ** 2
    transverse = SEMI_MAJOR_AXIS_M / np.sqrt(w2)
    return transverse * (1 - ECCENTRICITY_SQUARED) / w2, transverse


def omega_en_n(lat_rad: ArrayLike, height_m: ArrayLike, v_n: ArrayLike) -> NDArray:
    """Transport rate of the north-pointing frame resolved in NED.

    Parameters
    ----------
    lat_rad, height_m : array_like, shape (...)
        Geodetic latitude within +-90 deg, where the rate is singular; height above the ellipsoid.
    v_n : array_like, shape (..., 3)
        Velocity relative to Earth, NED [m/s].

    Returns
    -------
    omega_en_n : ndarray, shape (..., 3)
        In rad/s.

    Notes
    -----
    Source: Groves (2013), eq. (5.44).
    """
    v = np.asarray(v_n, dtype=float)
    meridian, transverse = radii_of_curvature(lat_rad)
    east_rate = v[..., 1] / (transverse + height_m)
    return np.stack(
        [east_rate, -v[..., 0] / (meridian + height_m), -east_rate * np.tan(lat_rad)], axis=-1
    )


def transport_by_speed(lat_rad: ArrayLike, height_m: ArrayLike) -> NDArray:
    """Transport rates of the north-pointing frame for each metre a second.

    Parameters
    ----------
    lat_rad, height_m : array_like, shape (...)
        As of `omega_en_n`.

    Returns
    -------
    rates : ndarray, shape (..., 3)
        1/(R_E + h), 1/(R_N + h) and tan L/(R_E + h) [1/m]: omega_en_n is (a v_E, -b v_N, -c v_E).

    Notes
    -----
    Source: Groves (2013), eq. (5.44).
    """
    meridian, transverse = radii_of_curvature(lat_rad)
    height = np.asarray(height_m, dtype=float)
    east, north = 1.0 / (transverse + height), 1.0 / (meridian + height)
    return np.stack([east, north, east * np.tan(lat_rad)], axis=-1)


def dcm_en(lat_rad: ArrayLike, lon_rad: ArrayLike) -> NDArray:
    """Matrix that takes NED components into ECEF components.

    Parameters
    ----------
    lat_rad, lon_rad : array_like, shape (...)
        Geodetic position.

    Returns
    -------
    C_en : ndarray, shape (..., 3, 3)

    Notes
    -----
    Source: Groves (2013), eq. (2.150).
    """
    L, lon = np.broadcast_arrays(np.asarray(lat_rad, dtype=float), np.asarray(lon_rad, dtype=float))
    sL, cL, sl, cl = np.sin(L), np.cos(L), np.sin(lon), np.cos(lon)
    C_en = np.empty(L.shape + (3, 3))
    C_en[..., 0, 0], C_en[..., 0, 1], C_en[..., 0, 2] = -sL * cl, -sl, -cL * cl
    C_en[..., 1, 0], C_en[..., 1, 1], C_en[..., 1, 2] = -sL * sl, cl, -cL * sl
    C_en[..., 2, 0], C_en[..., 2, 1], C_en[..., 2, 2] = cL, 0.0, -sL
    return C_en


def ecef_from_geodetic(lat_rad: ArrayLike, lon_rad: ArrayLike, height_m: ArrayLike) -> NDArray:
    """ECEF position of a geodetic one.

    Parameters
    ----------
    lat_rad, lon_rad, height_m : array_like, shape (...)
        Geodetic position, height above the ellipsoid.

    Returns
    -------
    r_e : ndarray, shape (..., 3)
        In m.

    Raises
    ------
    ValueError
        For a latitude beyond 90 deg, which pymap3d would accept.

    Examples
    --------
    >>> ecef_from_geodetic(0.0, 0.0, 0.0)
    array([6378137.,       0.,       0.])
    """
    import pymap3d

    lat = np.asarray(lat_rad, dtype=float)
    if not np.all(np.abs(lat) <= np.pi / 2):
        raise ValueError(
            f"latitude {np.degrees(np.max(np.abs(lat))):.3f} deg, needed within +-90 deg"
        )
    return np.stack(
        pymap3d.geodetic2ecef(lat, np.asarray(lon_rad, dtype=float), height_m, deg=False), axis=-1
    )


def geodetic_from_ecef(r_e: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
    """Geodetic position of an ECEF one.

    Parameters
    ----------
    r_e : array_like, shape (..., 3)
        In m.

    Returns
    -------
    lat_rad, lon_rad, height_m : ndarray, shape (...)
        Geodetic position, height above the ellipsoid.
    """
    import pymap3d

    r = np.asarray(r_e, dtype=float)
    lat, lon, height = pymap3d.ecef2geodetic(r[..., 0], r[..., 1], r[..., 2], deg=False)
    shape = r.shape[:-1]  # pymap3d drops a length of one
    return np.reshape(lat, shape), np.reshape(lon, shape), np.reshape(height, shape)


def displacement_ned(
    lat_rad: ArrayLike,
    lon_rad: ArrayLike,
    *,
    lat0_rad: ArrayLike,
    lon0_rad: ArrayLike,
    height0_m: ArrayLike,
) -> NDArray:
    """North and east distance of positions from a place, on its local ellipsoid.

    Parameters
    ----------
    lat_rad, lon_rad : array_like, shape (...)
        The positions.
    lat0_rad, lon0_rad, height0_m : array_like, shape (...)
        The place.

    Returns
    -------
    way_m : ndarray, shape (..., 2)
        North and east [m].

    Notes
    -----
    Neglected: the curvature of meridian and parallel, 1e-4 of the distance within 50 km.
    """
    lat0_rad, height0_m = np.asarray(lat0_rad, dtype=float), np.asarray(height0_m, dtype=float)
    meridian, transverse = radii_of_curvature(lat0_rad)
    dlon = np.mod(np.asarray(lon_rad, dtype=float) - lon0_rad + np.pi, 2 * np.pi) - np.pi
    north = (np.asarray(lat_rad, dtype=float) - lat0_rad) * (meridian + height0_m)
    return np.stack([north, dlon * (transverse + height0_m) * np.cos(lat0_rad)], axis=-1)
