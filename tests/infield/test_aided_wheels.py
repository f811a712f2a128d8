"""Wheels in aided replay: found in a car, not in aircraft; outages held by them; slips rejected."""

from dataclasses import replace

import numpy as np
import pytest

from infield.aided.flight import Aiding, Vehicle, navigate_aided
from infield.aided.wheels import seen_wheels
from ins.attitude import dcm_from_euler, dcm_from_rotation_vector
from ins.filters.aided_records import AidedHistory
from ins.records import Run
from ins.units import DEG
from ins.verdicts import codes, sentences
from tests.infield.aided_cases import flown, ideal, normalised, twin_of
from tests.infield.car_cases import CRAB_MRAD, SCALE_PPM, driven
from tests.infield.test_aided_checks import turned

OUT = ((300.0, 360.0), (420.0, 480.0))


def fly(run: Run, vehicle: Vehicle = Vehicle.FIND, left_out=OUT):
    aiding = Aiding(left_out=left_out, vehicle=vehicle)
    twin = twin_of(run.header.gyro_technology)
    return navigate_aided(run, run.imu, twin, rest=None, gyro_sigma_deg_h=None, aiding=aiding)


@pytest.fixture(scope="module")
def drive() -> AidedHistory:
    """The solution of a simulated drive, all fixes used."""
    history = fly(driven(3).run, Vehicle.OTHER, ()).history
    assert history is not None
    return history


@pytest.mark.parametrize("drives", [1, pytest.param(12, marks=pytest.mark.slow)])
def test_wheels_hold_a_car_without_fixes(drives):
    """Two minutes without fixes: the odometer takes nine tenths of the error, side and height alone
    some of it; errors are those of the sigmas (RMS of error over sigma 0.5 to 1.6), and those of
    the whole drive too.
    """
    level, over, ratios = [], [], []
    for seed in range(drives):
        run = driven(seed).run
        found = fly(run, Vehicle.OTHER), fly(replace(run, odometer=None)), fly(run)
        level.append([[s.rms_level_m for s in f.outage_scores] for f in found])
        over.append([[s.error_over_sigma for s in f.outage_scores] for f in found])
        ratios.append(normalised(driven(seed), found[2].history, 60))
        assert "wheels_taken" in codes(found[1].notes) and "wheels_taken" in codes(found[2].notes)
    free, sides, wheels = np.sqrt(np.mean(np.square(level), axis=(0, 2)))
    assert wheels < 0.2 * free and sides < free
    assert (np.sqrt(np.mean(np.square(over), axis=(0, 2)))[1:] < 1.6).all()
    assert (np.mean(ratios, axis=0) < 1.8).all()


def test_axes_and_scale_are_found_however_the_unit_is_mounted(drive):
    """Turned by 80 deg about the vertical and 5 deg about x: the vehicle's axes are the same ones,
    and the crab and the odometer's scale are within what a drive shows.
    """
    made = driven(3)
    C = dcm_from_rotation_vector(np.array([0.0, 0.0, 80.0 * DEG]))
    C = dcm_from_rotation_vector(np.array([5.0 * DEG, 0.0, 0.0])) @ C
    seen = []
    other = fly(turned(made.run, C), Vehicle.OTHER, ()).history
    for run, lever, history in ((made.run, np.eye(3), drive), (made.run, C, other)):
        wheels = seen_wheels(history, run.odometer, lever @ np.zeros(3))
        assert wheels.found == "rolls" and wheels.wheels is not None
        assert wheels.scale == pytest.approx(1.0 + 1e-6 * SCALE_PPM, abs=2e-3)
        seen.append(wheels.wheels.C_vb @ lever)
    forward = seen[0][0]
    assert np.arctan2(forward[1], forward[0]) == pytest.approx(-1e-3 * CRAB_MRAD, abs=2.0 * DEG / 5)
    assert seen[0] == pytest.approx(seen[1], abs=0.1)
    assert seen[0][0] == pytest.approx(seen[1][0], abs=0.01)


def turned_unit(history: AidedHistory, yaw_deg: float, pitch_deg: float) -> AidedHistory:
    """The solution of a unit that is mounted turned: its own axes, the same motion."""
    C = dcm_from_euler(0.0, pitch_deg * DEG, yaw_deg * DEG)
    return replace(history, C_nb=history.C_nb @ C)


def test_the_mounting_is_found_with_its_sigma(drive):
    """A unit 6 deg to the left and 7 deg nose down on the car's axes: yaw and pitch of the way in
    its axes within 3 of their sigmas, which are below half a degree.
    """
    for yaw_deg, pitch_deg in ((0.0, 0.0), (-6.0, -7.0), (80.0, 5.0)):
        seen = seen_wheels(turned_unit(drive, yaw_deg, pitch_deg), None, np.zeros(3))
        assert seen.found == "rolls"
        ahead = dcm_from_euler(0.0, pitch_deg * DEG, yaw_deg * DEG).T @ [
            1.0,
            -1e-3 * CRAB_MRAD,
            0.0,
        ]
        true = np.arctan2(ahead[1], ahead[0]), -ahead[2]
        for found, sigma, angle in zip(
            (seen.mounting.yaw_rad, seen.mounting.pitch_rad), seen.mounting.sigma_rad, true
        ):
            assert sigma < 0.5 * DEG and abs(found - angle) < 3.0 * sigma


def test_a_boat_in_a_current_is_no_car(drive):
    """The same turns at the same headings in a current of 1 m/s: it goes not where it points."""
    current = np.array([0.8, 0.6, 0.0])
    boat = replace(drive, v_n_m_s=drive.v_n_m_s + current)
    assert seen_wheels(boat, None, np.zeros(3)).found == "slips"


def test_aircraft_bank_and_nothing_changes_unasked():
    """A flight has no wheels, and is told so; without being asked for, no drive is held by any."""
    made = flown(ideal(180.0), twin_of("mems"), 2)
    run = replace(made.run, header=replace(made.run.header, gyro_technology="mems"))
    plain, asked = fly(run, Vehicle.OTHER, ()), fly(run, left_out=())
    assert codes(asked.notes)[0] == "no_wheels" and "banks" in sentences(asked.notes)[0]
    assert np.array_equal(plain.history.C_nb, asked.history.C_nb)
    assert not {"no_wheels", "wheels_taken"} & set(codes(plain.notes))
    assert plain.history.rolled == (0, 0)


def test_slipping_wheels_are_rejected():
    """Ten seconds of a locked wheel, and a third of a drive of one that spins at twice the speed:
    the first is rejected second by second, the second takes the wheels out.
    """
    run = driven(4).run
    odometer = run.odometer
    t = odometer.time_s
    locked = np.where((t > 200.0) & (t < 210.0), 0.0, odometer.speed_m_s)
    found = fly(replace(run, odometer=replace(odometer, speed_m_s=locked)), left_out=())
    assert "wheels_taken" in codes(found.notes)
    assert 5 <= found.history.rolled[1] <= 20
    spun = np.where((t > 200.0) & (t < 430.0), 2.0, 1.0) * odometer.speed_m_s
    found = fly(replace(run, odometer=replace(odometer, speed_m_s=spun)), left_out=())
    assert found.verdict == "aided"
    made = driven(4)
    assert (normalised(made, found.history, 60) < 3.0).all()
