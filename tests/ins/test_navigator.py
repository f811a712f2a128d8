"""Navigation of a log in parts: the same bits as in one, wherever it is cut."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ins.records import ImuLog, InputError, NavHistory, NavState
from ins.strapdown.mechanization import Navigator, VerticalChannel, navigate

from .test_mechanization_records import random_walk


def part(imu, a, b):
    return ImuLog(
        time_s=imu.time_s[a:b],
        dt_s=imu.dt_s[a:b],
        dtheta_rad=imu.dtheta_rad[a:b],
        dv_m_s=imu.dv_m_s[a:b],
    )


def in_parts(imu, state, cuts, **options):
    navigator = Navigator(state, **options)
    for a, b in zip([0, *cuts], [*cuts, imu.time_s.size]):
        navigator.feed(part(imu, a, b))
    return navigator.finish()


def same_bits(one, two):
    return all(
        getattr(one, f.name).tobytes() == getattr(two, f.name).tobytes() for f in fields(NavHistory)
    )


@st.composite
def cuts_of(draw, rows):
    """Cuts at least two rows apart, since a log has two rows or more."""
    steps = draw(st.lists(st.integers(2, rows // 2), max_size=12))
    cuts = np.cumsum(steps)
    return [int(c) for c in cuts if c <= rows - 2]


ROWS = 120
SERIES = VerticalChannel(
    mode="aided", time_s=[0.0, 1.0, 9.0], height_m=[500.0, 510.0, 490.0], time_constant_s=5.0
)


@settings(max_examples=25, deadline=None)
@given(
    cuts=cuts_of(ROWS),
    seed=st.integers(0, 2**31),
    start_row=st.integers(-1, ROWS - 3),
    epoch_s=st.sampled_from([None, 0.005, 0.02, 0.05, 0.25, 0.3, 1.0, 50.0]),
    vertical=st.sampled_from([None, VerticalChannel(mode="hold"), SERIES]),
)
def test_any_cut_gives_the_same_bits(cuts, seed, start_row, epoch_s, vertical):
    imu, state = random_walk(n=ROWS, seed=seed)
    time_s = 0.0 if start_row < 0 else imu.time_s[start_row]
    state = NavState(time_s=time_s, site=state.site, v_n_m_s=state.v_n_m_s, C_nb=state.C_nb)
    whole = navigate(imu, state, epoch_s=epoch_s, vertical=vertical)
    assert same_bits(in_parts(imu, state, cuts, epoch_s=epoch_s, vertical=vertical), whole)


def test_finishing_midway_changes_nothing_after():
    imu, state = random_walk(n=ROWS)
    navigator = Navigator(state, epoch_s=0.3)
    navigator.feed(part(imu, 0, 70))
    midway = navigator.finish()
    assert same_bits(midway, navigate(part(imu, 0, 70), state, epoch_s=0.3))
    navigator.feed(part(imu, 70, ROWS))
    assert same_bits(navigator.finish(), navigate(imu, state, epoch_s=0.3))


def test_a_bad_row_before_the_start_gives_no_slope():
    imu, state = random_walk(n=ROWS)
    dv = np.array(imu.dv_m_s)
    dv[9] = np.nan
    later = NavState(time_s=imu.time_s[9], site=state.site, v_n_m_s=state.v_n_m_s, C_nb=state.C_nb)
    broken = ImuLog(time_s=imu.time_s, dt_s=imu.dt_s, dtheta_rad=imu.dtheta_rad, dv_m_s=dv)
    assert same_bits(navigate(broken, later), navigate(part(imu, 10, ROWS), later))


def test_refusals():
    imu, state = random_walk(n=ROWS)
    navigator = Navigator(state)
    with pytest.raises(InputError, match="needed rows after"):
        navigator.finish()
    navigator.feed(part(imu, 0, 50))
    with pytest.raises(InputError, match="fed before"):
        navigator.feed(part(imu, 40, ROWS))
    dv = np.array(imu.dv_m_s)
    dv[63, 2] = np.inf
    broken = ImuLog(time_s=imu.time_s, dt_s=imu.dt_s, dtheta_rad=imu.dtheta_rad, dv_m_s=dv)
    with pytest.raises(InputError, match=f"row 63 at {imu.time_s[63]:.6g} s"):
        navigator.feed(part(broken, 50, ROWS))
    navigator.feed(part(imu, 50, ROWS))  # the refused part left nothing behind
    assert same_bits(navigator.finish(), navigate(imu, state))
