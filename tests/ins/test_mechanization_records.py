"""What navigate() promises beyond the physics: epochs, accumulations, intervals, invariants,
refusals.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ins import earth
from ins.records import ImuLog, InputError, NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate

from .test_mechanization import HOLD, TILTED, offsets_ned


def random_walk(n=400, dt=0.02, seed=5, jitter=0.3):
    rng = np.random.default_rng(seed)
    dt_s = dt * rng.uniform(1 - jitter, 1 + jitter, n)
    imu = ImuLog(
        time_s=np.cumsum(dt_s),
        dt_s=dt_s,
        dtheta_rad=dt_s[:, None] * rng.uniform(-1, 1, (n, 3)),
        dv_m_s=dt_s[:, None] * ([0, 0, -9.8] + rng.uniform(-3, 3, (n, 3))),
    )
    site = Site(lat_rad=0.9, lon_rad=3.14, height_m=500.0)
    return imu, NavState(time_s=0.0, site=site, v_n_m_s=[40.0, 60.0, -1.0], C_nb=TILTED)


def test_epochs_end_at_the_nearest_sample():
    imu, state = random_walk()
    h = navigate(imu, state, epoch_s=0.25)
    for k, t in enumerate(h.time_s):
        assert t == min([0.0, *imu.time_s], key=lambda s, k=k: abs(s - 0.25 * k))
    assert imu.time_s[-1] - h.time_s[-1] < 0.25 + 0.02


def test_epochs_do_not_change_the_solution():
    imu, state = random_walk()
    fine, coarse = navigate(imu, state, epoch_s=None), navigate(imu, state, epoch_s=1.0)
    assert fine.time_s.size == imu.time_s.size + 1
    rows = np.searchsorted(fine.time_s, coarse.time_s)
    for name in ("lat_rad", "lon_rad", "height_m", "v_n_m_s", "C_nb"):
        assert np.array_equal(getattr(fine, name)[rows], getattr(coarse, name))
    for name in ("C_nb_dt", "displacement_n_m", "displacement_b_m", "dv_f_n_m_s", "dtheta_b_rad"):
        total = np.cumsum(getattr(fine, name), axis=0)[rows]
        assert np.cumsum(getattr(coarse, name), axis=0) == pytest.approx(total, abs=1e-12)
        assert not getattr(coarse, name)[0].any()


def test_a_run_in_two_parts_is_the_run_in_one():
    """Started again from a history row, with the rows before it still in the log."""
    imu, state = random_walk()
    whole = navigate(imu, state, epoch_s=None)
    k = 150
    site = Site(lat_rad=whole.lat_rad[k], lon_rad=whole.lon_rad[k], height_m=whole.height_m[k])
    middle = NavState(
        time_s=whole.time_s[k], site=site, v_n_m_s=whole.v_n_m_s[k], C_nb=whole.C_nb[k]
    )
    second = navigate(imu, middle, epoch_s=None)
    assert second.v_n_m_s[-1] == pytest.approx(whole.v_n_m_s[-1], abs=1e-8)
    assert second.lat_rad[-1] == pytest.approx(whole.lat_rad[-1], abs=1e-11)
    assert second.C_nb[-1] == pytest.approx(whole.C_nb[-1], abs=1e-11)


def test_accumulations_are_the_integrals_they_claim_to_be():
    """Against sums over the rows of the solution at every sample."""
    imu, state = random_walk(jitter=0.0, n=600, dt=0.005)
    h = navigate(imu, state, epoch_s=None)
    dt = imu.dt_s[:, None]
    v_n, C_nb = h.v_n_m_s, h.C_nb
    assert h.dtheta_b_rad[1:] == pytest.approx(imu.dtheta_rad)
    assert h.C_nb_dt[1:] == pytest.approx(dt[:, :, None] * (C_nb[1:] + C_nb[:-1]) / 2, abs=1e-9)
    assert h.displacement_n_m[1:] == pytest.approx(dt * (v_n[1:] + v_n[:-1]) / 2, abs=3e-5)
    v_b = np.einsum("nji,nj->ni", C_nb, v_n)
    assert h.displacement_b_m[1:] == pytest.approx(dt * (v_b[1:] + v_b[:-1]) / 2, abs=1e-7)
    middle = (C_nb[1:] + C_nb[:-1]) / 2
    assert h.dv_f_n_m_s[1:] == pytest.approx(np.einsum("nij,nj->ni", middle, imu.dv_m_s), abs=1e-4)
    rate = 2 * earth.omega_ie_n(h.lat_rad) + earth.omega_en_n(h.lat_rad, h.height_m, v_n)
    slope = earth.gravity_n(h.lat_rad, h.height_m) - np.cross(rate, v_n)
    gained = h.dv_f_n_m_s[1:] + dt * (slope[1:] + slope[:-1]) / 2
    assert np.diff(v_n, axis=0) == pytest.approx(gained, abs=1e-8)
    north_east = np.cumsum(h.displacement_n_m, axis=0)[-1, :2]
    assert north_east == pytest.approx(offsets_ned(h)[-1], rel=1e-4)
    assert h.displacement_n_m[:, 2].sum() == pytest.approx(-(h.height_m[-1] - 500.0), abs=1e-3)


def test_logged_intervals_are_integrated_not_the_nominal_ones():
    """Constant rate and force on jittered intervals: heading and speed are those of the true
    elapsed time.
    """
    rng = np.random.default_rng(8)
    dt = 0.01 * rng.uniform(0.5, 1.5, 2000)
    lat, spin = 0.6, np.array([0, 0, 0.3])
    imu = ImuLog(
        time_s=np.cumsum(dt),
        dt_s=dt,
        dtheta_rad=np.outer(dt, spin + [0, 0, -earth.EARTH_RATE_RAD_S * np.sin(lat)]),
        dv_m_s=np.outer(dt, [0, 0, -float(earth.gravity_magnitude(lat, 0.0))]),
    )
    state = NavState(
        time_s=0.0,
        site=Site(lat_rad=lat, lon_rad=0.0, height_m=0.0),
        v_n_m_s=np.zeros(3),
        C_nb=np.eye(3),
    )
    h = navigate(imu, state, epoch_s=None, vertical=HOLD)
    heading = np.arctan2(h.C_nb[-1, 1, 0], h.C_nb[-1, 0, 0])
    assert heading == pytest.approx((0.3 * imu.time_s[-1] + np.pi) % (2 * np.pi) - np.pi, abs=1e-4)


def test_longitude_crosses_the_date_line():
    imu, state = random_walk()
    h = navigate(imu, state, epoch_s=None)
    assert np.all((h.lon_rad >= -np.pi) & (h.lon_rad <= np.pi))
    east = NavState(
        time_s=0.0,
        site=Site(lat_rad=0.9, lon_rad=np.pi - 1e-6, height_m=500.0),
        v_n_m_s=[0, 60.0, 0],
        C_nb=TILTED,
    )
    h = navigate(imu, east, epoch_s=None)
    assert h.lon_rad[-1] < -3.1
    assert offsets_ned(h)[-1, 1] == pytest.approx(h.displacement_n_m[:, 1].sum(), rel=1e-3)


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**31),
    n=st.integers(2, 200),
    lat=st.floats(-np.pi / 2, np.pi / 2),
    lon=st.floats(-np.pi, np.pi),
)
def test_attitude_stays_a_rotation_and_everything_finite(seed, lat, lon, n):
    imu, state = random_walk(n=n, dt=0.1, seed=seed)
    start = NavState(
        time_s=0.0,
        site=Site(lat_rad=lat, lon_rad=lon, height_m=500.0),
        v_n_m_s=state.v_n_m_s,
        C_nb=TILTED,
    )
    h = navigate(imu, start, epoch_s=None)
    for field in (h.lat_rad, h.lon_rad, h.height_m, h.v_n_m_s, h.C_nb_dt, h.dv_f_n_m_s):
        assert np.isfinite(field).all()
    assert np.abs(np.einsum("nji,njk->nik", h.C_nb, h.C_nb) - np.eye(3)).max() < 1e-12


def test_same_input_gives_the_same_bytes():
    one, two = (navigate(*random_walk()) for _ in range(2))
    assert one.C_nb.tobytes() == two.C_nb.tobytes()
    assert one.lat_rad.tobytes() == two.lat_rad.tobytes()


# ------------------------------------------------------------------------------------------------
# refusals


def test_refusals_name_row_and_need():
    imu, state = random_walk(n=10)
    dv = np.array(imu.dv_m_s)
    dv[4, 1] = np.nan
    broken = ImuLog(time_s=imu.time_s, dt_s=imu.dt_s, dtheta_rad=imu.dtheta_rad, dv_m_s=dv)
    with pytest.raises(InputError, match="row 4 at"):
        navigate(broken, state)
    stopped = ImuLog(
        time_s=imu.time_s, dt_s=0 * imu.dt_s, dtheta_rad=imu.dtheta_rad, dv_m_s=imu.dv_m_s
    )
    with pytest.raises(InputError, match="dt_s above 0"):
        navigate(stopped, state)
    changes = [
        (dict(time_s=5.0), "needed rows after"),
        (dict(time_s=-5.0), "after the initial state"),
        (dict(C_nb=2 * np.eye(3)), "rotation"),
        (dict(C_nb=np.diag([1.0, 1, -1])), "rotation"),
        (dict(C_nb=np.full((3, 3), np.nan)), "rotation"),
        (dict(v_n_m_s=[np.nan, 0, 0]), "v_n_m_s"),
    ]
    fields = dict(time_s=0.0, site=state.site, v_n_m_s=state.v_n_m_s, C_nb=state.C_nb)
    for change, word in changes:
        with pytest.raises(InputError, match=word):
            navigate(imu, NavState(**{**fields, **change}))
    with pytest.raises(InputError, match="epoch_s"):
        navigate(imu, state, epoch_s=0.0)
    with pytest.raises(InputError, match="at least 20"):
        navigate(imu, state, vertical=VerticalChannel(mode="hold", time_constant_s=0.1))
