"""Stretches cut out of a run: what is kept, on which clock, and that a cut run can be written and
read.
"""

import numpy as np
import pytest

from ins.records import ImuLog, InputError, Span
from tests.cut import cut_run
from tests.trajectories.run_cases import F_B, W_B, full_run
from trajectories.runs.directory import read_run, write_run


@pytest.fixture
def run():
    return full_run(faults=(Span(start_s=5.0, end_s=12.0, reason="dropout: 3 imu rows lost"),))


def test_two_halves_share_every_row_between_them(run):
    first, second = cut_run(run, 0.0, 17.0), cut_run(run, 17.0, 40.0)
    assert first.imu.rows + second.imu.rows == run.imu.rows
    np.testing.assert_array_equal(
        np.concatenate([first.imu.time_s, second.imu.time_s]), run.imu.time_s
    )
    joined = np.concatenate([first.imu.dtheta_rad, second.imu.dtheta_rad])
    # first intervals: nominal to rounding
    np.testing.assert_allclose(joined, run.imu.dtheta_rad, rtol=1e-9)
    assert second.imu.start_s == pytest.approx(17.01) and second.imu.end_s == 40.0


def test_the_clock_stays_that_of_the_run(run):
    part = cut_run(run, 17.0, 30.0)
    assert part.header.start_utc == run.header.start_utc
    assert part.header.run_id == "R1-17-30s"
    np.testing.assert_array_equal(part.temperature.time_s, np.arange(17.0, 31.0))
    np.testing.assert_array_equal(part.temperature.gyro_degC, run.temperature.gyro_degC[17:31])
    np.testing.assert_array_equal(part.temperature.block_degC, run.temperature.block_degC[17:31])
    assert part.temperature.accel_degC is None
    np.testing.assert_array_equal(part.gnss.sigma_velocity_m_s, run.gnss.sigma_velocity_m_s[17:31])
    assert part.odometer.time_s.size == 14
    assert [(p.phase, p.start_s, p.end_s) for p in part.phases] == [("alignment", 17.0, 30.0)]
    assert part.faults == ()
    assert [(s.start_s, s.end_s) for s in cut_run(run, 8.0, 20.0).faults] == [(8.0, 12.0)]


def test_written_and_read_again(tmp_path, run):
    write_run(tmp_path / "run", run)
    run = read_run(tmp_path / "run")
    part = cut_run(run, 12.5, 33.3)
    write_run(tmp_path / "part", part)
    again = read_run(tmp_path / "part")
    assert again.sha256 == part.sha256 != run.sha256
    np.testing.assert_array_equal(again.imu.dt_s, part.imu.dt_s)


def test_the_first_row_holds_one_nominal_interval():
    """After a dropout of a second the first row would claim 0.01 s for a second's motion: the next
    row is the first.
    """
    time_s = np.concatenate([np.arange(1, 1001), np.arange(1100, 2001)]) / 100
    dt_s = np.diff(time_s, prepend=0.0)
    imu = ImuLog(
        time_s=time_s, dt_s=dt_s, dtheta_rad=W_B * dt_s[:, None], dv_m_s=F_B * dt_s[:, None]
    )
    for start_s, first_s in ((10.0, 11.01), (10.5, 11.01), (11.0, 11.01), (9.99, 10.0)):
        part = cut_run(full_run(imu=imu), start_s, 20.0).imu
        assert part.start_s == pytest.approx(first_s)
        np.testing.assert_allclose(
            part.dtheta_rad / part.dt_s[:, None], np.tile(W_B, (part.rows, 1)), rtol=1e-9
        )
        np.testing.assert_allclose(
            part.dv_m_s / part.dt_s[:, None], np.tile(F_B, (part.rows, 1)), rtol=1e-9
        )


@pytest.mark.parametrize(
    ("start_s", "end_s"), [(40.0, 50.0), (20.0, 20.0), (30.0, 20.0), (10.0, 10.015)]
)
def test_an_empty_cut_is_bad_input(run, start_s, end_s):
    with pytest.raises(InputError, match="not two imu rows"):
        cut_run(run, start_s, end_s)
