"""The start that motion cannot spoil: exact where nothing errs, indifferent to its own first
attitude, and right while people walk about.
"""

import numpy as np
import pytest

from alignment.inertial_start import attitude_of, start_attitude
from ins.attitude import dcm_from_euler, dcm_from_rotation_vector, rotation_vector_from_dcm
from ins.records import NavState
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG
from tests.alignment.rough_parking import ABOARD, Rough, Unit, parked

PERFECT = Unit(arw_deg_sqrt_h=0.0, vrw_ug_sqrt_hz=0.0, gyro_deg_h=0.0, accel_ug=0.0)
STONE = Rough(people_s=np.inf, doors_s=np.inf, sway_m=0.0, yaw_deg=0.0)
EXACT_RAD = 1e-6  # Earth rate times the milliseconds that a window's centre is off


def made(seed, seconds, rough, unit=PERFECT, **options):
    return parked(np.random.default_rng([seed, 15]), seconds, rough, unit, **options)


def whole(log):
    return float(log.imu.time_s[0] - log.imu.dt_s[0]), float(log.imu.time_s[-1])


def error_rad(C_nb, log):
    truth = dcm_from_euler(log.roll_rad[0], log.pitch_rad[0], log.heading_rad[0])
    return rotation_vector_from_dcm(C_nb @ truth.T)


@pytest.mark.parametrize("seconds", [60.0, 300.0])
@pytest.mark.parametrize("lat_deg", [-60.0, 0.0, 34.0, 70.0])
def test_without_errors_it_is_the_truth(seconds, lat_deg):
    log = made(1, seconds, STONE, lat_deg=lat_deg)
    assert np.abs(error_rad(start_attitude(log.imu, log.site, whole(log)), log)).max() < EXACT_RAD


@pytest.mark.parametrize("tilt_deg", [0.0, 2.0, 20.0])
def test_the_attitude_of_the_solution_it_is_made_from_drops_out(tilt_deg):
    """A solution that begins 20 deg off carries the same gyros: the answer moves by less than a
    hundredth of the offset's effect on gravity.
    """
    log = made(2, 120.0, STONE)
    C_nb = dcm_from_euler(log.roll_rad[0], log.pitch_rad[0], log.heading_rad[0])
    start = NavState(
        time_s=whole(log)[0],
        site=log.site,
        v_n_m_s=np.zeros(3),
        C_nb=dcm_from_rotation_vector(tilt_deg * DEG * np.array([0.6, -0.5, 0.62])) @ C_nb,
    )
    history = navigate(log.imu, start, epoch_s=1.0, vertical=VerticalChannel(mode="hold"))
    assert np.abs(error_rad(attitude_of(history, log.site), log)).max() < 3.0 * EXACT_RAD


@pytest.mark.parametrize(("seconds", "limit_deg"), [(120.0, 1.5), (600.0, 0.1)])
def test_people_and_gusts_leave_the_heading(seconds, limit_deg):
    """People tilt the vehicle by 0.3 deg and gusts sway it by a centimetre: RMS over five logs
    within the linear range of the filter (a degree or two), and better with time.
    """
    errors = [
        error_rad(start_attitude(log.imu, log.site, whole(log)), log)[2]
        for log in (made(seed, seconds, ABOARD) for seed in range(5))
    ]
    assert np.sqrt(np.mean(np.square(errors))) < limit_deg * DEG


def test_a_push_in_the_middle_weighs_little():
    """A vehicle pushed at 1 m/s^2 for two seconds within ten minutes: Cauchy's weights leave a
    tenth of what the push does to a plain solution.
    """
    log = made(3, 600.0, STONE)
    dv = np.array(log.imu.dv_m_s)
    dv[3000:3020, 0] += 0.1
    dv[3040:3060, 0] -= 0.1
    pushed = type(log.imu)(
        time_s=log.imu.time_s, dt_s=log.imu.dt_s, dtheta_rad=log.imu.dtheta_rad, dv_m_s=dv
    )
    assert np.abs(error_rad(start_attitude(pushed, log.site, whole(log)), log)).max() < 1e-4
