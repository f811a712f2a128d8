"""Each aid's rows against the nonlinear navigation: rolling, turning, with lever arms, crab and
scale errors.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from alignment.motion.kinds import ROLLING, STILL
from alignment.navigation_filter import StepPlan, views_of
from infield.session.navigated.taxi_heading import (
    CentreLineAid,
    GnssAid,
    LateralAid,
    OdometerAid,
    SurveyedHeadingAid,
    heading_source,
)
from ins.attitude import dcm_from_euler
from ins.earth import geodetic_from_ecef
from ins.estimation import error_model as em
from ins.estimation.measurements.antenna import RowSums
from ins.records import NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG
from tests.ins.filter_steps import dense
from tests.ins.nonlinear_errors import Errors, error_states, perturbed_imu, perturbed_state
from tests.scenarios.study import REFERENCE_TWIN, table_to_zero
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Straight, Turn
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

WHEEL = (-4.0, 1.5, 1.2)  # from the IMU to the no-slip point
ANTENNA = (3.0, -2.0, -1.5)
UPRIGHT = (0.0, 0.0)  # roll and pitch of the unit on its wheels [rad]
SILENT = replace(
    REFERENCE_TWIN,
    gyro=replace(REFERENCE_TWIN.gyro, arw_deg_sqrt_h=0.0),
    accel=replace(REFERENCE_TWIN.accel, vrw_ug_sqrt_hz=0.0, turn_on_ug=0.0),
    gnss=replace(
        REFERENCE_TWIN.gnss, sigma_horizontal_m=0.0, sigma_vertical_m=0.0, sigma_velocity_m_s=0.0
    ),
    odometer=replace(REFERENCE_TWIN.odometer, noise_m_s=0.0),
    vehicle=replace(
        REFERENCE_TWIN.vehicle, lateral_noise_m_s=0.0, yaw_creep_arcsec_sqrt_h=0.0, sway_m_s=0.0
    ),
)
ONE_MM = 1e-3


class Listener:
    """Writes down what an aid measures: name, z, dense rows and R of each measurement."""

    def __init__(self):
        self.seen = []

    def measure(self, name, at, z, rows, variance, *, gate):
        for k in range(len(at)):
            z_k, R = (
                [np.broadcast_to(value, (len(at),))[k] for value in part] for part in (z, variance)
            )
            H = np.stack([dense(row, em.BASE + 3, k) for row in rows])
            self.seen.append((name, np.array(z_k), H, np.diag(R)))


class Velocities:
    """A tape that keeps z (n, 2) and R (n,) of what an aid measures last."""

    last = None

    def measure(self, name, at, z, rows, variance, *, gate):
        if len(at):
            self.last = np.array(z).T, np.array(variance[0])


@cache
def taxi(crab_mrad=0.0, odometer_ppm=0.0, lean=UPRIGHT):
    """A silent taxi from rest: 60 s parked at heading 25 deg, a 90 deg turn, 40 s straight."""
    segments = (Park(duration_s=60.0), Turn(angle_deg=90.0), Straight(duration_s=40.0))
    truth = build_truth(
        lay(segments),
        Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0),
        heading_rad=25 * DEG,
        roll_rad=lean[0],
        pitch_rad=lean[1],
        wheel_reference_m=WHEEL,
    )
    twin = replace(
        SILENT,
        vehicle=replace(SILENT.vehicle, crab_mrad=crab_mrad),
        odometer=replace(SILENT.odometer, scale_ppm=odometer_ppm),
    )
    rng = np.random.default_rng(1)
    unit = aged_unit(rng, ageing_offset_deg_h=0.0, ageing_shape_deg_h=0.0, table=table_to_zero())
    return simulate_run(
        ideal_sensors(truth, 100.0),
        thermal_history("ambient"),
        unit,
        twin,
        rng=rng,
        plan=SessionPlan(with_gnss=True, with_odometer=True, gnss_lever_arm_m=ANTENNA),
    )


NO_ERRORS = Errors()


@cache
def solution(errors=NO_ERRORS, crab_mrad=0.0, odometer_ppm=0.0, lean=UPRIGHT):
    simulated = taxi(crab_mrad, odometer_ppm, lean)
    C_nb = dcm_from_euler(*lean, simulated.reference.heading_rad[0])
    start = NavState(time_s=0.0, site=simulated.run.header.site, v_n_m_s=np.zeros(3), C_nb=C_nb)
    imu = perturbed_imu(simulated.run.imu, errors)
    return navigate(
        imu, perturbed_state(start, errors), epoch_s=1.0, vertical=VerticalChannel(mode="hold")
    )


def view(history, end_s, kind=ROLLING):
    one = np.array([0])
    return views_of(history, StepPlan(one + end_s - 1, one + end_s, one + kind, one, np.zeros(1)))


def seen_by(aid, history, end_s, kind=ROLLING):
    listener = Listener()
    aid.measure(listener, view(history, end_s, kind))
    return listener.seen


TURNING_S, STRAIGHT_S = 79, 115
ERRORS = {
    "w_N": Errors(w=(0.05, 0.0, 0.0)),
    "w_E": Errors(w=(0.0, 0.05, 0.0)),
    "theta_N": Errors(theta=(2e-5, 0.0, 0.0)),
    "theta_E": Errors(theta=(0.0, 2e-5, 0.0)),
    "theta_D": Errors(theta=(0.0, 0.0, 1e-3)),
    "p_N": Errors(p=(30.0, 0.0, 0.0)),
    "p_E": Errors(p=(0.0, 30.0, 0.0)),
    "accel_x": Errors(accel=(3e-4, 0.0, 0.0)),
}


def true_state(name, end_s):
    """The filter's state at the end of the step: from the nonlinear solution, S from its
    displacements.
    """
    good, bad = solution(), solution(ERRORS[name])
    x = np.zeros(em.BASE + 3)
    e = error_states(good, bad, end_s)
    x[em.W], x[em.POS], x[em.THETA] = e[:2], e[3:5], e[6:]
    x[em.S] = (bad.displacement_b_m - good.displacement_b_m)[end_s, :2]
    return x, bad


@cache
def rows():
    """What the rows of the taxi add up to."""
    return RowSums(taxi().run.imu)


def aids():
    run = taxi().run
    course = 115 * DEG
    return {
        "lateral": LateralAid(WHEEL),
        "odometer": OdometerAid(run.odometer, 0.01, WHEEL),
        "gnss": GnssAid(run.gnss, rows(), ANTENNA, 0.5, 0.03),
        "centre line": CentreLineAid(course),
    }


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize(
    ("kind", "end_s"),
    [
        ("lateral", TURNING_S),
        ("lateral", STRAIGHT_S),
        ("odometer", TURNING_S),
        ("odometer", STRAIGHT_S),
        ("gnss", TURNING_S),
        ("gnss", STRAIGHT_S),
        ("centre line", STRAIGHT_S),
    ],
)
def test_rows_are_the_derivative_of_what_the_aid_reads(kind, end_s, error):
    """z of the perturbed solution less z of the true one = H x; to 1 % and half a mm."""
    x, bad = true_state(error, end_s)
    before, after = seen_by(aids()[kind], solution(), end_s), seen_by(aids()[kind], bad, end_s)
    assert len(before) == len(after) > 0
    for (_, z0, H, _), (_, z1, _, _) in zip(before, after):
        change, predicted = z1 - z0, H @ x
        assert change == pytest.approx(predicted, abs=0.5 * ONE_MM + 0.01 * np.abs(predicted).max())


@pytest.mark.parametrize("end_s", [TURNING_S, STRAIGHT_S])
@pytest.mark.parametrize("kind", ["lateral", "odometer", "gnss"])
def test_a_perfect_solution_leaves_no_residual(kind, end_s):
    """Lever arms in the turn: 4 m times 9 deg/s are 0.6 m in a second, and vanish with the right
    signs only.
    """
    assert abs(view(solution(), TURNING_S).heading_change_rad[0]) > 0.1
    tolerance = {"lateral": ONE_MM, "odometer": 3 * ONE_MM, "gnss": 20 * ONE_MM}[kind]
    for _, z, _, _ in seen_by(aids()[kind], solution(), end_s):
        assert z == pytest.approx(np.zeros(len(z)), abs=tolerance)


@pytest.mark.parametrize("lean", [(0.05, 0.0), (0.0, -0.05)])
def test_a_vehicle_that_leans_has_its_arm_beside_it(lean):
    """A unit 1.2 m above its wheels, on a road that leans by 0.05: 6 cm of arm, 1 cm a second
    in the turn, in the odometer's row with a roll and in the lateral one with a pitch.
    """
    history, run = solution(lean=lean), taxi(lean=lean).run
    turn = view(history, TURNING_S).heading_change_rad[0]
    assert abs(turn * WHEEL[2] * 0.05) > 9 * ONE_MM
    for aid in (LateralAid(WHEEL), OdometerAid(run.odometer, 0.01, WHEEL)):
        ((_, z, _, _),) = seen_by(aid, history, TURNING_S)
        assert abs(z[0]) < 2 * ONE_MM


def test_an_odometer_stamped_on_the_edges_of_steps_is_read():
    """One sample a second, each at a step's end: it belongs to that step, with its own noise."""
    log = taxi().run.odometer
    whole = np.flatnonzero(np.isclose(log.time_s, np.round(log.time_s), atol=1e-6))
    rare = replace(log, time_s=log.time_s[whole], speed_m_s=log.speed_m_s[whole])
    ((_, z, H, R),) = seen_by(OdometerAid(rare, 0.01, WHEEL), solution(), STRAIGHT_S)
    assert abs(z[0]) < 5 * ONE_MM
    forward = view(solution(), STRAIGHT_S).displacement_b_m[0, 0]
    assert H[0, em.ODOMETER] == pytest.approx(-forward, rel=0.01)
    assert R[0] >= 0.01**2


def test_lateral_row_holds_no_heading():
    """The trap of physics.md 6.5: neither theta nor position may stand in it."""
    ((_, _, H, _),) = seen_by(LateralAid(WHEEL), solution(), STRAIGHT_S)
    assert not H[0, em.THETA].any()
    assert not H[0, em.POS].any()


def test_gnss_takes_logged_sigmas_and_the_declared_where_none():
    log = taxi().run.gnss
    n = len(log.time_s)
    logged = replace(log, sigma_horizontal_m=np.full(n, 2.0), sigma_velocity_m_s=np.full(n, np.nan))
    seen = seen_by(GnssAid(logged, rows(), ANTENNA, 0.5, 0.03), solution(), STRAIGHT_S)
    assert seen[0][3] == pytest.approx(4.0 * np.eye(2))
    assert seen[1][3] == pytest.approx(0.03**2 * np.eye(2))


@pytest.mark.parametrize("end_s", [74, 75, 76, 79, 83, 84])
def test_gnss_velocity_on_the_arm_fits_its_sigma_while_a_turn_begins_and_ends(end_s):
    """The mean turn rate of a step is not that at the fix: 0.15 m/s on a 3.6 m arm, against a sigma
    of 0.03. From one step alone that is the sigma; with its neighbours the rate is known.
    """
    _, z, _, R = seen_by(aids()["gnss"], solution(), end_s)[-1]
    assert np.abs(z).max() < 2.0 * np.sqrt(R[0, 0])
    assert seen_by(aids()["gnss"], solution(), STRAIGHT_S)[-1][3][0, 0] == pytest.approx(
        0.03**2, rel=1e-3
    )
    z, variance = velocities_in_the_taxi()
    assert np.abs(z[end_s - 61]).max() < 0.03
    assert variance[end_s - 61] < 3.0 * 0.03**2


@cache
def velocities_in_the_taxi():
    """z (n, 2) and R (n,) of the velocities of seconds 61 to 120, one step each."""
    at = np.arange(60, 120)
    plan = StepPlan(at, at + 1, np.full(60, ROLLING), np.zeros(60, np.int64), np.zeros(60))
    tape = Velocities()
    aids()["gnss"].measure(tape, views_of(solution(), plan))
    return tape.last


@pytest.mark.parametrize("ago", [0.3, 0.7])
def test_a_fix_within_the_step_is_taken_to_its_own_time(ago):
    """Fixes off the epochs: truth at that time, straight on, leaves millimetres where 0.3 s late
    would be 3 m.
    """
    simulated = taxi()
    t = STRAIGHT_S - ago
    row = int(np.argmin(np.abs(simulated.reference.time_s - t)))
    ref = simulated.reference
    from trajectories.simulator.session import GnssLog, dcm_en, ecef_from_geodetic

    C_nb = dcm_from_euler(*UPRIGHT, ref.heading_rad[row])
    r_e = ecef_from_geodetic(ref.lat_rad[row], ref.lon_rad[row], ref.height_m[row])
    lat, lon, height = geodetic_from_ecef(
        r_e + dcm_en(ref.lat_rad[row], ref.lon_rad[row]) @ C_nb @ ANTENNA
    )
    log = GnssLog(
        time_s=np.array([ref.time_s[row]]),
        lat_rad=np.array([lat]),
        lon_rad=np.array([lon]),
        height_m=np.array([height]),
        v_n_m_s=ref.v_n_m_s[row : row + 1],
    )
    for _, z, _, _ in seen_by(GnssAid(log, rows(), ANTENNA, 0.5, 0.03), solution(), STRAIGHT_S):
        assert z == pytest.approx(np.zeros(2), abs=20 * ONE_MM)


def test_surveyed_heading_is_used_once_and_only_at_rest():
    aid = SurveyedHeadingAid(heading_rad=25 * DEG, sigma_rad=1e-3, at_s=30.0)
    bad = solution(Errors(theta=(0.0, 0.0, 1e-3)))
    assert seen_by(aid, bad, 10, STILL) == []
    assert seen_by(aid, bad, 30, ROLLING) == []
    ((_, z, H, R),) = seen_by(aid, bad, 30, STILL)
    assert z[0] == pytest.approx(1e-3, abs=2e-6)
    assert H[0, em.THETA.stop - 1] == 1.0
    assert R[0, 0] == pytest.approx(1e-6)
    assert seen_by(aid, bad, 31, STILL) == []


def test_centre_line_is_left_alone_in_turns_and_on_other_headings_and_works_backwards():
    assert seen_by(CentreLineAid(115 * DEG), solution(), TURNING_S) == []
    assert seen_by(CentreLineAid(60 * DEG), solution(), STRAIGHT_S) == []
    ((_, z, H, _),) = seen_by(CentreLineAid(115 * DEG), solution(), STRAIGHT_S)
    ((_, back, H_back, _),) = seen_by(CentreLineAid(295 * DEG), solution(), STRAIGHT_S)
    assert z == pytest.approx(np.zeros(1), abs=2 * ONE_MM)
    assert back == pytest.approx(z, abs=1e-9)
    assert H_back == pytest.approx(H)
    ((_, off, H, _),) = seen_by(CentreLineAid(115 * DEG + 1e-3), solution(), STRAIGHT_S)
    assert off[0] == pytest.approx(H[0, em.CENTRE_LINE] * 1e-3, rel=0.02)


@pytest.mark.parametrize(
    ("gains", "word"),
    [
        ({}, None),
        ({"still": 3.0, "heading held": 1.0}, None),
        ({"lateral": 1.0}, "turns"),
        ({"stop": 2.0}, "stops"),
        ({"odometer": 1.0, "lateral": 0.1}, "odometer"),
        ({"gnss": 5.0}, "gnss"),
        ({"survey": 1.0}, "survey"),
        ({"centre line": 1.0}, "survey"),
        ({"lateral": 1.0, "stop": 1.0}, "combined"),
        ({"survey": 1.0, "centre line": 1.0}, "survey"),
        ({"stop": 0.81, "gnss": 0.19}, "stops"),
        ({"stop": 0.79, "gnss": 0.21}, "combined"),
        ({"stop": -0.5}, None),
    ],
)
def test_heading_source_in_the_words_of_the_contract(gains, word):
    assert heading_source(gains) == word
    assert word in (None, "turns", "stops", "gnss", "odometer", "survey", "combined")
