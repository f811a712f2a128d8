"""The compiled loop's own formulas against the array modules, and compiled against plain Python."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ins import earth
from ins.attitude import dcm_from_rotation_vector
from ins.records import ImuLog
from ins.strapdown import increments
from ins.strapdown import kernel as strapdown_kernel
from ins.strapdown.mechanization import navigate

from .inertial_truth import ideal_imu, true_state
from .test_mechanization_oracle import edges, flight

ONE_NANOMETRE = 1e-9
PICORAD = 1e-12


@given(lat=st.floats(-np.pi / 2, np.pi / 2), height=st.floats(-500, 30e3))
def test_gravity_is_that_of_ins_earth(lat, height):
    expected = earth.gravity_magnitude(lat, height)
    assert strapdown_kernel.gravity(np.sin(lat), height) == pytest.approx(expected, rel=1e-14)


@given(
    lat=st.floats(-np.pi / 2, np.pi / 2), lon=st.floats(-3.1, 3.1), height=st.floats(-1000, 30e3)
)
def test_local_frame_is_that_of_ins_earth(lat, lon, height):
    """One step of Bowring, to 30 km: 20 nm of height, 1e-12 rad (6 micrometres); longitude beyond 1
    mm of the pole.
    """
    sL, cL, sl, cl, h = strapdown_kernel.local_frame(
        tuple(earth.ecef_from_geodetic(lat, lon, height))
    )
    assert h == pytest.approx(height, abs=20 * ONE_NANOMETRE)
    assert np.arctan2(sL, cL) == pytest.approx(lat, abs=PICORAD)
    if np.cos(lat) * 6.4e6 > 2e-3:
        assert np.arctan2(sl, cl) == pytest.approx(lon, abs=PICORAD + 2e-9 / (np.cos(lat) * 6.4e6))
        C_ne = np.reshape(strapdown_kernel.dcm_ne((sL, cL, sl, cl, h)), (3, 3))
        assert C_ne == pytest.approx(
            earth.dcm_en(lat, lon).T, abs=1e-10 + 2e-9 / (np.cos(lat) * 6.4e6)
        )


@given(
    lat=st.floats(-np.pi / 2, np.pi / 2), lon=st.floats(-3.1, 3.1), height=st.floats(-1000, 30e3)
)
def test_the_normal_is_that_of_the_local_frame(lat, lon, height):
    """And so is C_ne from it, also within 1 mm of a pole."""
    r = tuple(earth.ecef_from_geodetic(lat, lon, height))
    frame, (up, h) = strapdown_kernel.local_frame(r), strapdown_kernel.normal(r)
    assert h == pytest.approx(frame[4], abs=5 * ONE_NANOMETRE)
    assert up[2] == pytest.approx(frame[0], abs=1e-15)
    C_ne = strapdown_kernel.dcm_ne(frame)
    assert up == pytest.approx(
        (-C_ne[6], -C_ne[7], -C_ne[8]), abs=1e-9 if np.hypot(r[0], r[1]) < 2e-3 else 1e-15
    )
    assert strapdown_kernel.dcm_ne_at(r, up) == pytest.approx(
        C_ne, abs=1e-9 if np.hypot(r[0], r[1]) < 2e-3 else 1e-14
    )


@pytest.mark.parametrize("z", [6356752.3142, -6356800.0])
@pytest.mark.parametrize("xy", [(0.0, 0.0), (3e-4, -4e-4)])
def test_at_the_pole_longitude_is_zero(xy, z):
    frame = strapdown_kernel.local_frame((*xy, z))
    assert frame[2:4] == (0.0, 1.0)
    assert frame[0] == pytest.approx(np.sign(z))
    assert frame[4] == pytest.approx(abs(z) - earth.SEMI_MINOR_AXIS_M, abs=1e-6)


triple = st.tuples(*[st.floats(-0.3, 0.3)] * 3)


interval = st.floats(1e-3, 0.1)


def scrolling(imu: ImuLog):
    """-(slope T^2 + dtheta x dv) / 12: the end correction of the trapezoid, with the slope of
    specific force as seen from inertial space.
    """
    dt, before = imu.dt_s[1], imu.dt_s[0]
    slope = 2 * dt * (imu.dv_m_s[1] / dt - imu.dv_m_s[0] / before) / (dt + before) * dt
    slope = slope if dt <= increments.MAX_INTERVAL_RATIO * before else np.zeros(3)
    return [None, -(slope + np.cross(imu.dtheta_rad[1], imu.dv_m_s[1])) / 12]


@given(
    theta=triple, dv=triple, theta_before=triple, dv_before=triple, dt=interval, dt_before=interval
)
def test_compensation_is_that_of_ins_increments(theta, dv, theta_before, dv_before, dt, dt_before):
    imu = ImuLog(
        time_s=[0.0, 1.0],
        dt_s=[dt_before, dt],
        dtheta_rad=[theta_before, theta],
        dv_m_s=[dv_before, dv],
    )
    weights = strapdown_kernel.interval_weights(dt, dt_before)
    got = strapdown_kernel.compensate(theta, dv, theta_before, dv_before, weights, False)
    for one, function in zip(
        got, (increments.rotation_vectors, increments.velocity_increments, scrolling), strict=True
    ):
        assert one == pytest.approx(function(imu)[1], abs=1e-11)


def test_thresholds_are_the_same_in_both_modules():
    assert strapdown_kernel.MAX_INTERVAL_RATIO == increments.MAX_INTERVAL_RATIO


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 0.0999999, 0.1000001, 0.5, 3.0])
def test_attitude_step_is_exact_across_the_series_threshold(size):
    rotation = size * np.array([0.48, -0.6, 0.64])
    q = np.array([0.5, -0.1, 0.7, 0.2])
    q /= np.linalg.norm(q)
    earth_angle = 7.3e-7
    turned = strapdown_kernel.rotation_quaternion(tuple(rotation), False)
    new = strapdown_kernel.unit(strapdown_kernel.turn_attitude(tuple(q), turned, earth_angle))
    C = np.reshape(strapdown_kernel.dcm(tuple(q)), (3, 3)) @ dcm_from_rotation_vector(rotation)
    expected = dcm_from_rotation_vector([0.0, 0.0, -earth_angle]) @ C
    assert np.reshape(strapdown_kernel.dcm(new), (3, 3)) == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("size", [0.0999999, 0.1000001])
def test_velocity_step_is_continuous_across_the_series_threshold(size):
    dv = (1.0, 2.0, -3.0)
    theta = tuple(size * np.array([0.48, -0.6, 0.64]))
    imu = ImuLog(time_s=[0.0, 1.0], dt_s=[1.0, 1.0], dtheta_rad=[theta] * 2, dv_m_s=[dv] * 2)
    got = strapdown_kernel.compensate(
        theta, dv, theta, dv, strapdown_kernel.interval_weights(1.0, 1.0), False
    )[1]
    assert got == pytest.approx(increments.velocity_increments(imu)[1], abs=1e-11)


@pytest.mark.parametrize("dt", [0.005, 0.01])
def test_looking_gravity_up_ahead_costs_less_than_a_micrometre(dt, monkeypatch):
    """Ten minutes at up to 350 m/s with 2 g turns, against gravity looked up from the solution
    itself at every row.
    """
    imu, start = ideal_imu(flight, edges(600, dt)), true_state(flight, 0.0)
    ahead = navigate(imu, start, epoch_s=60.0)
    monkeypatch.setattr(strapdown_kernel, "LOOK_AHEAD_S", 0.0)
    at_once = navigate(imu, start, epoch_s=60.0)
    assert not np.array_equal(ahead.lat_rad, at_once.lat_rad)
    off = [earth.ecef_from_geodetic(h.lat_rad, h.lon_rad, h.height_m) for h in (ahead, at_once)]
    assert np.abs(off[0] - off[1]).max() < 1e-6
    assert np.abs(ahead.v_n_m_s - at_once.v_n_m_s).max() < 1e-8
    assert np.abs(ahead.C_nb - at_once.C_nb).max() < 1e-12


RUN = """
import sys
{before}
import numpy as np
from ins.strapdown import loop as strapdown_loop
from ins.strapdown.mechanization import navigate
from ins.records import ImuLog, NavState, Site
rng = np.random.default_rng(3)
n, dt = 300, 0.02
imu = ImuLog(time_s=dt * np.arange(1, n + 1), dt_s=dt * rng.uniform(0.8, 1.2, n),
             dtheta_rad=rng.uniform(-0.02, 0.02, (n, 3)),
             dv_m_s=[0, 0, -0.196] + rng.uniform(-0.1, 0.1, (n, 3)))
site = Site(lat_rad=0.9, lon_rad=-2.0, height_m=400.0)
state = NavState(time_s=0.0, site=site, v_n_m_s=[100, 50, -3], C_nb=np.eye(3))
h = navigate(imu, state, epoch_s=0.5)
print(type(strapdown_loop.integrate).__name__)
fields = (h.lat_rad, h.lon_rad, h.height_m, h.v_n_m_s, h.C_nb, h.C_nb_dt, h.displacement_n_m,
          h.displacement_b_m, h.dv_f_n_m_s, h.dtheta_b_rad)
print(np.concatenate([f.reshape(h.time_s.size, -1) for f in fields], axis=1).tolist())
"""


def run_in_a_new_process(before, **environment):
    import json
    import os
    from pathlib import Path

    out = subprocess.run(
        [sys.executable, "-c", RUN.format(before=before)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **environment},
        cwd=Path(strapdown_kernel.__file__).parent.parent,
    ).stdout.splitlines()
    return out[0], np.array(json.loads(out[1]))


def test_compiled_and_plain_python_agree():
    compiled_kind, compiled = run_in_a_new_process("")
    plain_kind, plain = run_in_a_new_process("", NUMBA_DISABLE_JIT="1")
    missing_kind, missing = run_in_a_new_process("sys.modules['numba'] = None")
    assert (compiled_kind, plain_kind, missing_kind) == ("CPUDispatcher", "function", "function")
    assert compiled == pytest.approx(plain, rel=1e-13, abs=1e-12)
    assert np.array_equal(plain, missing)
