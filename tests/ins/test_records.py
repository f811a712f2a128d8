"""Records: what they refuse, and that they cannot be changed afterwards."""

import dataclasses

import numpy as np
import pytest

from ins.records import ImuLog, InputError, NavState, Phase, RunHeader, Site

PLACE = dict(lat_rad=0.8, lon_rad=0.1, height_m=100.0)


def log(n=5, **changes):
    fields = dict(
        time_s=0.1 * np.arange(1, n + 1),
        dt_s=np.full(n, 0.1),
        dtheta_rad=np.zeros((n, 3)),
        dv_m_s=np.ones((n, 3)),
    )
    return ImuLog(**{**fields, **changes})


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("lat_rad", 1.6, "latitude"),
        ("lat_rad", np.nan, "latitude"),
        ("lon_rad", 7.0, "longitude"),
        ("height_m", 40000.0, "height"),
        ("height_m", np.nan, "height"),
    ],
)
def test_site_refuses(key, value, word):
    with pytest.raises(InputError, match=word):
        Site(**{**PLACE, key: value})


def test_latitude_given_as_degrees_is_named_in_degrees():
    with pytest.raises(InputError, match="2578"):
        Site(**{**PLACE, "lat_rad": 45.0})


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        (dict(time_s=[0.1, 0.2, 0.2, 0.3, 0.4]), "increasing"),
        (dict(dtheta_rad=np.zeros((5, 2))), "dtheta_rad"),
        (dict(dv_m_s=np.zeros((4, 3))), "differ in length"),
        (dict(dt_s=np.zeros(3)), "differ in length"),
    ],
)
def test_imu_log_refuses(changes, word):
    with pytest.raises(InputError, match=word):
        log(**changes)


def test_arrays_are_copied_and_read_only():
    dv = np.asfortranarray(np.ones((5, 3)))
    imu = log(dv_m_s=dv)
    dv[0, 0] = 7.0
    assert imu.dv_m_s[0, 0] == 1.0
    assert imu.dv_m_s.flags.c_contiguous
    with pytest.raises(ValueError, match="read-only"):
        imu.dv_m_s[0, 0] = 2.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        imu.source = "rates"


def test_between_takes_the_rows_whose_interval_ends_inside():
    assert log().between(0.1, 0.35).time_s == pytest.approx([0.2, 0.3])


def test_rate_is_that_of_the_median_interval():
    assert log(time_s=[0.1, 0.2, 0.3, 0.4, 5.0]).rate_hz == pytest.approx(10.0)


def test_phase_and_technology_are_from_their_lists():
    with pytest.raises(InputError, match="towing"):
        Phase(phase="towing", start_s=0.0, end_s=1.0)
    with pytest.raises(InputError, match="before it starts"):
        Phase(phase="taxi", start_s=2.0, end_s=1.0)
    with pytest.raises(InputError, match="laser"):
        RunHeader(
            run_id="r",
            tail="",
            imu_serial="s",
            gyro_technology="laser",
            start_utc="",
            site=Site(**PLACE),
        )


def test_nav_state_checks_its_shapes():
    with pytest.raises(InputError, match="C_nb"):
        NavState(time_s=0.0, site=Site(**PLACE), v_n_m_s=np.zeros(3), C_nb=np.zeros(3))
