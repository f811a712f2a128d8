"""Many runs at once: each to the bit what `navigate` makes of it alone, on any number of threads;
and what is refused.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import navigation_batch as batch
from benchmarks.navigation_batch import navigate_batch
from benchmarks.navigation_batch_errors import SensorErrors
from ins.attitude import dcm_from_euler
from ins.records import InputError, NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G
from tests.ins.test_mechanization import HOLD, at_rest
from tests.ins.test_mechanization_records import random_walk
from tests.ins.test_navigator import SERIES

ROWS = 150


def starts_of(runs, rng, *, time_s=0.0):
    return [
        NavState(
            time_s=time_s,
            v_n_m_s=rng.uniform(-200, 200, 3),
            C_nb=dcm_from_euler(*rng.uniform(-1, 1, 3)),
            site=Site(
                lat_rad=rng.uniform(-1.57, 1.57),
                lon_rad=rng.uniform(-3, 3),
                height_m=rng.uniform(0, 9e3),
            ),
        )
        for _ in range(runs)
    ]


def errors_of(runs, rng, *, bins=None, noisy=False):
    shape = (runs, 3) if bins is None else (runs, bins, 3)
    return SensorErrors(
        gyro_bias_rad_s=DEG_PER_HOUR * rng.standard_normal(shape),
        accel_bias_m_s2=MICRO_G * rng.standard_normal(shape),
        edges_s=None if bins is None else np.linspace(0.3, 2.0, bins + 1),
        gyro_matrix=1e-4 * rng.standard_normal((runs, 3, 3)),
        accel_matrix=1e-4 * rng.standard_normal((runs, 3, 3)),
        gyro_noise_rad_sqrt_s=0.002 * DEG_PER_SQRT_HOUR * noisy,
        accel_noise_m_s_sqrt_s=10 * MICRO_G * noisy,
        seeds=rng.integers(0, 2**31, runs),
    )


def assert_is_navigate(flown, run, alone):
    assert np.array_equal(flown.time_s, alone.time_s)
    for name in ("lat_rad", "lon_rad", "height_m", "v_n_m_s", "C_nb"):
        assert np.array_equal(getattr(flown, name)[run], getattr(alone, name)), name


@settings(max_examples=24, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    runs=st.sampled_from([1, 3, 16, 17]),
    error_options=st.fixed_dictionaries(
        {"bins": st.sampled_from([None, 1, 5]), "noisy": st.booleans()}
    ),
    start_row=st.integers(-1, ROWS - 5),
    chunk=st.sampled_from([2, 7, 64, 4096]),
    own_starts=st.booleans(),
    options=st.fixed_dictionaries(
        {
            "epoch_s": st.sampled_from([None, 0.05, 0.3, 1.0]),
            "vertical": st.sampled_from([None, HOLD, SERIES]),
        }
    ),
)
def test_each_run_has_the_bits_of_navigate(
    seed, runs, error_options, start_row, chunk, own_starts, options
):
    rng = np.random.default_rng(seed)
    imu, _ = random_walk(n=ROWS, seed=seed)
    time_s = 0.0 if start_row < 0 else float(imu.time_s[start_row])
    starts = starts_of(runs, rng, time_s=time_s)
    starts = starts if own_starts else [starts[0]]
    errors = errors_of(runs, rng, **error_options)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch, "CHUNK_ROWS", chunk)
        flown = navigate_batch(imu, starts, errors=errors, **options)
    for run in range(runs):
        start = starts[run % len(starts)]
        alone = navigate(errors.applied(imu, run), start, **options)
        assert_is_navigate(flown, run, alone)


@pytest.mark.parametrize("chunk", [2, 50, 4096])
def test_a_log_for_each_run(chunk, monkeypatch):
    monkeypatch.setattr(batch, "CHUNK_ROWS", chunk)
    imu, start = random_walk(n=ROWS)
    errors = errors_of(20, np.random.default_rng(1), noisy=True)
    logs = [errors.applied(imu, run) for run in range(20)]
    flown = navigate_batch(logs, start, epoch_s=0.25)
    for run, log in enumerate(logs):
        assert_is_navigate(flown, run, navigate(log, start, epoch_s=0.25))


def test_a_fast_spin_in_one_lane_changes_no_other():
    """Beyond 0.1 rad a step the tile takes sines instead of series; the lanes that need none keep
    their bits.
    """
    imu, start = random_walk(n=ROWS)
    spin = np.array(imu.dtheta_rad)
    spin[40:60, 2] += np.linspace(0.05, 0.5, 20)
    logs = [imu, replace(imu, dtheta_rad=spin), imu]
    flown = navigate_batch(logs, start, epoch_s=None)
    for run, log in enumerate(logs):
        assert_is_navigate(flown, run, navigate(log, start, epoch_s=None))
    assert not np.array_equal(flown.C_nb[0], flown.C_nb[1])


@pytest.mark.parametrize("noisy", [False, True])
def test_threads_change_no_bit_and_inputs_stay(noisy):
    rng = np.random.default_rng(4)
    imu, _ = random_walk(n=2000)
    starts, errors = starts_of(70, rng), errors_of(70, rng, bins=5, noisy=noisy)
    before = imu.dtheta_rad.tobytes(), imu.dv_m_s.tobytes(), errors.gyro_bias_rad_s.tobytes()
    flown = [
        navigate_batch(imu, starts, errors=errors, threads=threads).states.tobytes()
        for threads in (1, 2, 3, 8)
    ]
    assert len(set(flown)) == 1
    assert before == (
        imu.dtheta_rad.tobytes(),
        imu.dv_m_s.tobytes(),
        errors.gyro_bias_rad_s.tobytes(),
    )


def test_a_bad_row_before_the_start_is_not_used():
    imu, start = random_walk(n=ROWS)
    dv = np.array(imu.dv_m_s)
    dv[9] = np.nan
    later, broken = replace(start, time_s=float(imu.time_s[9])), replace(imu, dv_m_s=dv)
    assert_is_navigate(navigate_batch(broken, later), 0, navigate(broken, later))
    with pytest.raises(InputError, match="run 1: imu: row 9"):
        navigate_batch([imu, broken], later)


def test_noise_is_white_of_the_size_asked_for():
    """Angle random walk of 400 runs of 100 s at the equator: heading sigma within its 99.9 % band
    (chi-square, 400).
    """
    imu, start = at_rest(0.0, duration_s=100, dt=0.05)
    sigma = 0.01 * DEG_PER_SQRT_HOUR
    flown = navigate_batch(
        imu,
        start,
        errors=SensorErrors(gyro_noise_rad_sqrt_s=sigma, seeds=range(400)),
        epoch_s=100.0,
    )
    heading = np.arctan2(flown.C_nb[:, -1, 1, 0], flown.C_nb[:, -1, 0, 0])
    assert 0.78 < np.mean(heading**2) / (sigma**2 * 100) < 1.25
    assert np.corrcoef(heading[:-1], heading[1:])[0, 1] < 3.3 / 20


def test_bias_signs_and_bins():
    """measured - true: a gyro that reads u too much about z for 50 of 100 s turns the heading by 50
    u, and no other run.
    """
    imu, start = at_rest(0.0, duration_s=100, dt=0.05)
    bias = np.zeros((2, 2, 3))
    bias[1, 1, 2] = 1.0 * DEG_PER_HOUR
    errors = SensorErrors(gyro_bias_rad_s=bias, edges_s=[0.0, 50.0, 100.0])
    flown = navigate_batch(
        imu, start, errors=errors, epoch_s=50.0, vertical=VerticalChannel(mode="hold")
    )
    heading = np.arctan2(flown.C_nb[:, :, 1, 0], flown.C_nb[:, :, 0, 0])
    assert heading[1] - heading[0] == pytest.approx([0, 0, 50 * DEG_PER_HOUR], abs=1e-9)


# ------------------------------------------------------------------------------------------------
# refusals


def test_refusals_name_the_run():
    imu, start = random_walk(n=ROWS)
    dv = np.array(imu.dv_m_s)
    dv[63, 2] = np.nan
    with pytest.raises(InputError, match=f"run 2: imu: row 63 at {imu.time_s[63]:.6g} s"):
        navigate_batch([imu, imu, replace(imu, dv_m_s=dv)], start)
    with pytest.raises(InputError, match="run 1: imu has other times"):
        navigate_batch([imu, replace(imu, time_s=imu.time_s + 0.001)], start)
    with pytest.raises(InputError, match="run 1: initial C_nb is not a rotation"):
        navigate_batch(imu, [start, replace(start, C_nb=2 * np.eye(3))])
    with pytest.raises(InputError, match="run 1: initial time_s"):
        navigate_batch(imu, [start, replace(start, time_s=0.02)])
    with pytest.raises(InputError, match="runs differ: imu 2, initial 3"):
        navigate_batch([imu, imu], [start] * 3)
    with pytest.raises(InputError, match="errors are never shared"):
        navigate_batch(imu, [start] * 3, errors=SensorErrors(gyro_bias_rad_s=np.zeros((1, 3))))
    with pytest.raises(InputError, match="apply them to the logs"):
        navigate_batch([imu, imu], start, errors=SensorErrors())
    with pytest.raises(InputError, match="needed rows after"):
        navigate_batch(imu, replace(start, time_s=1e3))
    with pytest.raises(InputError, match="epoch_s"):
        navigate_batch(imu, start, epoch_s=0.0)
    with pytest.raises(InputError, match="time_constant_s"):
        navigate_batch(imu, start, vertical=VerticalChannel(mode="hold", time_constant_s=0.1))


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        (dict(gyro_bias_rad_s=np.zeros((4, 2))), "gyro_bias_rad_s: shape"),
        (dict(gyro_bias_rad_s=np.zeros((4, 2, 3))), "gyro_bias_rad_s: shape"),
        (
            dict(gyro_bias_rad_s=np.zeros((4, 3, 3)), edges_s=[0.0, 1.0, 2.0]),
            "gyro_bias_rad_s: shape",
        ),
        (
            dict(accel_bias_m_s2=[[0.0, 0, 0], [0, np.nan, 0]]),
            "accel_bias_m_s2: run 1 is not finite",
        ),
        (
            dict(gyro_matrix=np.zeros((4, 3, 3)), accel_matrix=np.zeros((5, 3, 3))),
            "gyro_matrix 4, accel_matrix 5",
        ),
        (dict(edges_s=[0.0, 0.0]), "increasing"),
        (dict(gyro_noise_rad_sqrt_s=1e-6), "seeds"),
        (dict(gyro_noise_rad_sqrt_s=-1e-6, seeds=[1]), "negative"),
    ],
)
def test_sensor_errors_refuse(fields, word):
    with pytest.raises(InputError, match=word):
        SensorErrors(**fields)
