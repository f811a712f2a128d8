"""Unit factors against figures worked out by hand."""

import pytest

from ins import units


@pytest.mark.parametrize(
    ("value", "si"),
    [
        (180 * units.DEG, 3.141592653589793),
        (206264.80624709636 * units.ARCSEC, 1.0),
        (1000 * units.MILLIRADIAN, 1.0),
        (0.01 * units.DEG_PER_HOUR, 4.84813681109536e-08),
        (15.041067 * units.DEG_PER_HOUR, 7.292115e-5),  # Earth rate
        (1e6 * units.MICRO_G, 9.80665),
        (1e6 * units.PPM, 1.0),
        (60 * units.NAUTICAL_MILE, 111120.0),
        (3600 * units.KNOT, 1852.0),
    ],
)
def test_factor_gives_si(value, si):
    assert value == pytest.approx(si, rel=1e-7)


def test_angle_random_walk_grows_to_its_figure_in_one_hour():
    sigma_rad = 0.002 * units.DEG_PER_SQRT_HOUR * 3600**0.5
    assert sigma_rad / units.DEG == pytest.approx(0.002)


def test_rate_random_walk_grows_to_its_figure_in_one_hour():
    sigma_rad_s = 0.002 * units.DEG_PER_HOUR_SQRT_HOUR * 3600**0.5
    assert sigma_rad_s / units.DEG_PER_HOUR == pytest.approx(0.002)
    assert 2.0 * units.MICRO_G_PER_SQRT_HOUR * 3600**0.5 / units.MICRO_G == pytest.approx(2.0)
