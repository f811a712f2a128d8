"""Compensation undoes the sensor model exactly; signs of bias and misalignment."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ins.records import ImuLog, InputError
from ins.strapdown.compensation import compensate, gyro_matrix
from ins.units import DEG_PER_HOUR


def log(n=6, seed=1):
    rng = np.random.default_rng(seed)
    dt = np.linspace(0.008, 0.012, n)
    return ImuLog(
        time_s=np.cumsum(dt),
        dt_s=dt,
        dtheta_rad=rng.standard_normal((n, 3)),
        dv_m_s=rng.standard_normal((n, 3)),
        source="rates",
    )


def measured(true, *, bias, accel_bias, scale_ppm, misalignment_mrad):
    """The sensor model written out gyro by gyro: formats.md, section 3."""
    xy, xz, yx, yz, zx, zy = 1e-3 * np.asarray(misalignment_mrad)
    x, y, z = true.dtheta_rad.T
    sx, sy, sz = 1 + 1e-6 * np.asarray(scale_ppm)
    dtheta = np.stack(
        [sx * x + xy * y + xz * z, yx * x + sy * y + yz * z, zx * x + zy * y + sz * z], axis=-1
    )
    dt = true.dt_s[:, None]
    return ImuLog(
        time_s=true.time_s,
        dt_s=true.dt_s,
        dtheta_rad=dtheta + bias * dt,
        dv_m_s=true.dv_m_s + accel_bias * dt,
        source=true.source,
    )


@given(
    bias=st.tuples(*[st.floats(-1, 1)] * 3),
    accel=st.tuples(*[st.floats(-1, 1)] * 3),
    scale=st.tuples(*[st.floats(-1e4, 1e4)] * 3),
    misalignment=st.tuples(*[st.floats(-50, 50)] * 6),
)
def test_round_trip(bias, accel, scale, misalignment):
    true = log()
    raw = measured(
        true,
        bias=np.array(bias),
        accel_bias=np.array(accel),
        scale_ppm=scale,
        misalignment_mrad=misalignment,
    )
    back = compensate(
        raw,
        gyro_bias_rad_s=bias,
        accel_bias_m_s2=accel,
        gyro_scale_factor_ppm=scale,
        gyro_misalignment_mrad=misalignment,
    )
    assert back.dtheta_rad == pytest.approx(true.dtheta_rad, abs=1e-13)
    assert back.dv_m_s == pytest.approx(true.dv_m_s, abs=1e-13)
    assert back.source == "rates"


def test_bias_is_what_the_gyro_reads_above_the_truth():
    back = compensate(log(), gyro_bias_rad_s=[0.01 * DEG_PER_HOUR, 0, 0])
    assert back.dtheta_rad - log().dtheta_rad == pytest.approx(
        -np.outer(log().dt_s, [4.84813681e-8, 0, 0]), abs=1e-15
    )


def test_bias_of_each_row():
    bias = np.arange(18.0).reshape(6, 3)
    back = compensate(log(), gyro_bias_rad_s=bias, accel_bias_m_s2=2 * bias)
    assert log().dtheta_rad - back.dtheta_rad == pytest.approx(bias * log().dt_s[:, None])
    assert log().dv_m_s - back.dv_m_s == pytest.approx(2 * bias * log().dt_s[:, None])


def test_nothing_to_remove_changes_nothing():
    assert np.array_equal(compensate(log()).dtheta_rad, log().dtheta_rad)
    assert np.array_equal(compensate(log()).dv_m_s, log().dv_m_s)


def test_misalignment_order_is_xy_xz_yx_yz_zx_zy():
    M = gyro_matrix(scale_factor_ppm=(7, 8, 9), misalignment_mrad=(1, 2, 3, 4, 5, 6))
    expected = [[1 + 7e-6, 1e-3, 2e-3], [3e-3, 1 + 8e-6, 4e-3], [5e-3, 6e-3, 1 + 9e-6]]
    assert np.array_equal(M, np.array(expected))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        (dict(gyro_bias_rad_s=[1, 2]), "gyro_bias"),
        (dict(accel_bias_m_s2=np.zeros((5, 3))), "accel_bias"),
        (dict(gyro_bias_rad_s=[np.nan, 0, 0]), "not finite"),
        (dict(gyro_misalignment_mrad=(0, 0, 0)), "needed"),
        (dict(gyro_scale_factor_ppm=(-1e6, 0, 0)), "no inverse"),
    ],
)
def test_refusals(changes, word):
    with pytest.raises(InputError, match=word):
        compensate(log(), **changes)
