"""WGS-84 and gravity against published figures, boule, and their own derivatives."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ins import earth
from ins.attitude import skew
from ins.units import DEG, MICRO_G

VECTORS = tomllib.loads((Path(__file__).parent.parent / "vectors" / "wgs84.toml").read_text())
ONE_MM = 1e-3
LATITUDES = np.radians([-90.0, -45.0, -10.0, 0.1, 30.0, 45.0, 70.0, 89.9, 90.0])
latitude = st.floats(-np.pi / 2, np.pi / 2)
longitude = st.floats(-np.pi, np.pi)


def test_ellipsoid_matches_the_published_figures():
    e = VECTORS["ellipsoid"]
    assert earth.SEMI_MINOR_AXIS_M == pytest.approx(e["semi_minor_axis_m"], abs=1e-4)
    assert earth.ECCENTRICITY_SQUARED == pytest.approx(e["eccentricity_squared"], abs=1e-14)
    # gravities are given to 1e-10
    assert earth.SOMIGLIANA_K == pytest.approx(e["somigliana_k"], abs=1e-11)
    assert earth.GRAVITY_RATIO_M == pytest.approx(e["gravity_ratio_m"], abs=1e-13)
    meridian, transverse = earth.radii_of_curvature(np.pi / 2)
    assert meridian == pytest.approx(e["polar_radius_of_curvature_m"], abs=1e-4)
    assert transverse == pytest.approx(e["polar_radius_of_curvature_m"], abs=1e-4)


def test_gravity_on_the_ellipsoid_matches_the_published_figures():
    e = VECTORS["ellipsoid"]
    assert earth.gravity_magnitude(0.0, 0.0) == pytest.approx(e["gravity_equator_m_s2"], abs=1e-10)
    assert earth.gravity_magnitude(np.pi / 2, 0.0) == pytest.approx(
        e["gravity_pole_m_s2"], abs=1e-10
    )
    nodes, weights = np.polynomial.legendre.leggauss(40)
    lat = nodes * np.pi / 2
    meridian, transverse = earth.radii_of_curvature(lat)
    area = weights * meridian * transverse * np.cos(lat)
    mean = np.sum(area * earth.gravity_magnitude(lat, 0.0)) / np.sum(area)
    assert mean == pytest.approx(e["gravity_mean_m_s2"], abs=1e-9)


@pytest.mark.parametrize(
    ("height_m", "bound_ug"), [(0.0, 1e-4), (300.0, 0.01), (10e3, 0.1), (20e3, 0.2)]
)
def test_gravity_with_height_matches_boule(height_m, bound_ug):
    boule = pytest.importorskip("boule")
    lat_deg = np.degrees(LATITUDES)
    expected = 1e-5 * boule.WGS84.normal_gravity(
        (np.zeros_like(lat_deg), lat_deg, np.full_like(lat_deg, height_m))
    )
    assert earth.gravity_magnitude(LATITUDES, height_m) == pytest.approx(
        expected, abs=bound_ug * MICRO_G
    )


def test_ecef_matches_the_published_example():
    example = VECTORS["north_sea"]
    lat, lon = (
        np.dot(example[k], [1, 1 / 60, 1 / 3600]) * DEG for k in ("lat_deg_min_s", "lon_deg_min_s")
    )
    assert earth.ecef_from_geodetic(lat, lon, example["height_m"]) == pytest.approx(
        example["ecef_m"], abs=ONE_MM
    )


@given(lat=latitude, lon=longitude, height=st.floats(-500, 20e3))
def test_geodetic_round_trip(lat, lon, height):
    r_e = earth.ecef_from_geodetic(lat, lon, height)
    assert earth.ecef_from_geodetic(*earth.geodetic_from_ecef(r_e)) == pytest.approx(r_e, abs=1e-6)


def test_shapes_are_kept_also_of_length_one():
    for shape in ((), (1,), (2, 1), (3, 2)):
        r_e = earth.ecef_from_geodetic(
            np.full(shape, 0.7), np.full(shape, 0.1), np.full(shape, 5.0)
        )
        assert r_e.shape == shape + (3,)
        assert all(part.shape == shape for part in earth.geodetic_from_ecef(r_e))


def test_latitude_beyond_the_pole_is_refused():
    with pytest.raises(ValueError, match="needed within"):
        earth.ecef_from_geodetic(91 * DEG, 0.0, 0.0)


@given(lat=latitude, lon=longitude)
def test_dcm_en_is_a_rotation_and_its_down_is_the_inward_normal(lat, lon):
    C_en = earth.dcm_en(lat, lon)
    assert C_en.T @ C_en == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(C_en) == pytest.approx(1.0)
    step = earth.ecef_from_geodetic(lat, lon, 1000.0) - earth.ecef_from_geodetic(lat, lon, 0.0)
    assert C_en[:, 2] == pytest.approx(-step / 1000, abs=1e-9)


@pytest.mark.parametrize("lat", np.radians([-45.0, 0.1, 70.0]))
def test_transport_rate_is_the_turning_of_ned(lat):
    """omega_en_n against the numerical derivative of C_en along the motion."""
    v_n, height, lon, h = np.array([200.0, -150.0, 3.0]), 9000.0, 0.4, 1.0
    meridian, transverse = earth.radii_of_curvature(lat)
    lat_rate = v_n[0] / (meridian + height)
    lon_rate = v_n[1] / ((transverse + height) * np.cos(lat))
    C = [earth.dcm_en(lat + s * lat_rate * h, lon + s * lon_rate * h) for s in (-1, 1)]
    C_dot = (C[1] - C[0]) / (2 * h)
    expected = earth.dcm_en(lat, lon).T @ C_dot
    assert skew(earth.omega_en_n(lat, height, v_n)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("lat", np.radians([-45.0, 0.1, 70.0]))
def test_radii_turn_angles_into_distances(lat):
    d = 1e-5
    north = earth.ecef_from_geodetic(lat + d, 0.0, 0.0) - earth.ecef_from_geodetic(
        lat - d, 0.0, 0.0
    )
    east = earth.ecef_from_geodetic(lat, d, 0.0) - earth.ecef_from_geodetic(lat, -d, 0.0)
    meridian, transverse = earth.radii_of_curvature(lat)
    assert np.linalg.norm(north) == pytest.approx(2 * d * meridian, rel=1e-8)
    assert np.linalg.norm(east) == pytest.approx(2 * d * transverse * np.cos(lat), rel=1e-8)


def test_displacement_is_the_local_distance_also_over_the_date_line():
    lat0, lon0, h0 = 0.7, np.pi - 1e-4, 200.0
    C_en, r0 = earth.dcm_en(lat0, lon0), earth.ecef_from_geodetic(lat0, lon0, h0)
    lat, lon = lat0 + 3e-4, lon0 + 4e-4 - 2 * np.pi
    offset_n = C_en.T @ (earth.ecef_from_geodetic(lat, lon, h0) - r0)
    got = earth.displacement_ned(lat, lon, lat0_rad=lat0, lon0_rad=lon0, height0_m=h0)
    assert got == pytest.approx(offset_n[:2], rel=1e-3)


def test_earth_rate_in_ned_is_the_earth_axis():
    for lat in LATITUDES:
        omega_e = earth.dcm_en(lat, 0.3) @ earth.omega_ie_n(lat)
        assert omega_e == pytest.approx([0, 0, earth.EARTH_RATE_RAD_S], abs=1e-19)
