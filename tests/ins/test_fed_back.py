"""Flights whose attitudes are fed back: from a heading that is far off, about any reference."""

from dataclasses import replace

import numpy as np
import pytest

from infield.aided.flight import aided_noise
from ins.attitude import dcm_from_rotation_vector, rotation_vector_from_dcm
from ins.filters.aided_filter import FromHeadings, first_about, solved, without_start
from ins.filters.aided_records import AidedOptions
from ins.filters.aided_tape import Task
from ins.filters.reference import About
from ins.units import DEG
from tests.infield.aided_cases import errors, flown, ideal, twin_of
from tests.ins.test_aided_filter import ANTENNA, begun, fixes_from, prior, truth_at


def task_of(seed: int, heading_off_rad: float, heading_sigma_rad: float):
    """A simulated MEMS flight that starts with its heading off."""
    twin = twin_of("mems", flicker=False)
    made, sigma, error = flown(ideal(), twin, seed, "mems"), prior(twin), np.zeros(15)
    error[8], sigma[8] = heading_off_rad, heading_sigma_rad
    task = Task(
        start=begun(truth_at(made, error=error), np.diag(sigma**2)),
        noise=aided_noise(twin, "mems"),
        fixes=fixes_from(made, twin),
        antenna=ANTENNA,
        options=AidedOptions(),
    )
    return made, task


def by_fixes(made, task) -> About:
    imu = made.run.imu
    return About.by_fixes(imu, task.start, task.fixes, imu.end_s, task.noise.vrw)


def test_a_small_error_is_that_of_the_linear_sweep():
    """Where a heading is right to 0.05 rad the likelihood is that of the sweep about the smoothed
    solution to 0.5 %, and the last attitude to 0.3 of its sigma.
    """
    made, task = task_of(3, 0.0, 0.05)
    about = first_about(made.run.imu, task)
    linear = solved(about, task)
    back = without_start(FromHeadings(about, task, record=True).flown(task.start))
    assert np.nansum(back.loglik) == pytest.approx(np.nansum(linear.loglik), rel=5e-3)
    turn = rotation_vector_from_dcm(back.C_nb[-1:] @ np.swapaxes(linear.C_nb[-1:], 1, 2))[0]
    assert (np.abs(turn) < 0.3 * np.sqrt(np.diag(linear.phi_covariance[-1]))).all()


@pytest.mark.parametrize(
    ("off_deg", "delays_s", "nats"),
    [(100.0, (0.0, 0.0), 1.0), (179.0, (0.0, 0.0), 1.0), (100.0, (0.1, 0.3), 1.0)],
)
def test_reference_may_have_any_attitude(off_deg, delays_s, nats):
    """A flight from the right heading, about attitudes that are turned by half the compass and
    tilted by 5 deg, also with delays that are wrong by as much as its turns take: likelihood to 1
    nat of 4,356 and of 1,428 (0.2 and 0.04 measured), attitude to 0.15 of its sigma (0.11).
    """
    made, task = task_of(4, 0.0, 0.05)
    delay_s, velocity_delay_s = delays_s
    late = replace(task.antenna, delay_s=delay_s, velocity_delay_s=velocity_delay_s)
    task = replace(task, antenna=late)
    crude = by_fixes(made, task)
    turn = dcm_from_rotation_vector(np.array([0.0, 0.0, off_deg * DEG]))
    turn = dcm_from_rotation_vector(np.array([5.0 * DEG, 0.0, 0.0])) @ turn
    rows = crude.rows
    turned = crude.along(
        type(rows)(rows.time_s, rows.place, rows.v_n_m_s, turn @ rows.C_nb, rows.v_variance),
        task.fixes.time_s,
        task.noise.vrw,
    )
    plain, other = (
        FromHeadings(about, task, record=True).flown(task.start) for about in (crude, turned)
    )
    assert np.nansum(other.loglik) == pytest.approx(np.nansum(plain.loglik), abs=nats)
    off = rotation_vector_from_dcm(other.C_nb @ np.swapaxes(plain.C_nb, 1, 2))[60:]
    sigma = np.sqrt(np.diagonal(plain.phi_covariance, axis1=1, axis2=2))[60:]
    assert np.sqrt(np.mean((off / sigma) ** 2)) < 0.15


def test_a_heading_that_is_off_comes_back():
    """From 20 deg off, one sigma, the heading is right to 3 sigmas at the end of eight minutes."""
    made, task = task_of(5, 20.0 * DEG, 20.0 * DEG)
    history = FromHeadings(by_fixes(made, task), task, record=True).flown(task.start)
    heading = errors(made, without_start(history))[-1, 8]
    assert abs(heading) < 3.0 * np.sqrt(history.variance[-1, 8])
    assert np.sqrt(history.variance[-1, 8]) < 2.0 * DEG
