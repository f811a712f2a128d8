"""Truth from samples: the samples of a known truth give it back; stretches that do not meet are
refused.
"""

import numpy as np
import pytest

from ins.earth import ecef_from_geodetic
from ins.records import InputError, Site
from trajectories.simulator.motions import lay
from trajectories.simulator.sampled_truth import SampledMove, SampledStand, truth_from_samples
from trajectories.simulator.segments import Park, Stop, Straight, Turn
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.truth import build_truth

SITE = Site(lat_rad=0.8, lon_rad=0.1, height_m=250.0)
LEVER = (-6.0, 0.3, 2.0)
ONE_CM = 0.01


def known():
    motion = lay(
        [
            Park(duration_s=60.0),
            Turn(angle_deg=90.0),
            Straight(duration_s=40.0),
            Stop(duration_s=30.0),
        ]
    )
    return build_truth(
        motion, SITE, heading_rad=2.9, roll_rad=0.01, pitch_rad=-0.02, wheel_reference_m=LEVER
    )


def sampled(truth, step_s=0.5):
    """Its stretches, as an estimator would give them."""
    out = []
    for a, b, stretch in zip(truth.breaks_s[:-1], truth.breaks_s[1:], truth.stretches):
        t = np.linspace(a, b, max(int((b - a) / step_s), 1) + 1)
        euler = truth.kinematics(t).euler_rad
        if stretch.spline is not None:
            speed = truth.motion.speed_m_s(t)
            move = SampledMove(
                time_s=t,
                euler_rad=euler,
                speed_m_s=speed,
                v_n_m_s=np.zeros((t.size, 3)),
                airborne=np.zeros(t.size),
            )
            out.append(move)
        else:
            out.append(SampledStand(start_s=float(a), end_s=float(b), euler_rad=euler[0]))
    return out


def test_samples_of_a_truth_give_it_back():
    truth = known()
    again = truth_from_samples(SITE, sampled(truth), wheel_reference_m=LEVER)
    t = np.arange(0.0, truth.motion.end_s, 0.07)
    one, two = truth.kinematics(t), again.kinematics(t)
    assert np.abs(one.r_e - two.r_e).max() < 10 * ONE_CM
    assert np.abs(one.v_e - two.v_e).max() < ONE_CM
    # the turn's blends are shorter than its samples see
    assert np.abs(one.euler_rad - two.euler_rad).max() < 2e-3
    moving = [[s.spline is not None for s in found.stretches] for found in (truth, again)]
    assert np.array_equal(truth.breaks_s, again.breaks_s) and moving[0] == moving[1]
    assert np.abs(truth.motion.speed_m_s(t) - again.motion.speed_m_s(t)).max() < ONE_CM


def test_half_the_step_divides_the_error():
    truth, t = known(), np.arange(61.0, 130.0, 0.03)
    true = truth.kinematics(t).euler_rad[:, 2]

    def error(step_s):
        return np.abs(
            truth_from_samples(SITE, sampled(truth, step_s)).kinematics(t).euler_rad[:, 2] - true
        ).max()

    assert error(0.25) < error(0.5) / 4


def test_the_sensors_are_at_rest_where_it_stands():
    truth = truth_from_samples(SITE, sampled(known()), wheel_reference_m=LEVER)
    ideal = ideal_sensors(truth, 10.0)
    assert np.all(ideal.dtheta_rad[ideal.at_rest & (ideal.time_s < 60)] == ideal.dtheta_rad[0])
    start = ecef_from_geodetic(SITE.lat_rad, SITE.lon_rad, SITE.height_m)
    assert np.all(truth.kinematics(np.array([0.0, 59.0])).r_e == start)
    assert ideal.at_rest.sum() == pytest.approx(900, abs=2)


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s[1:],
        lambda s: [s[0], s[2]],
        lambda s: [s[0], s[0]],
        lambda s: [s[0], SampledMove(**{**vars(s[1]), "time_s": s[1].time_s + 0.1}), s[2]],
    ],
)
def test_stretches_that_do_not_meet_are_refused(change):
    with pytest.raises(InputError, match="sampled truth"):
        truth_from_samples(SITE, change(sampled(known())))
