"""Levelling without gyros: tilts by hand, an honest sigma, and units that the navigation filter
cannot take.
"""

from dataclasses import replace

import numpy as np
import pytest

from alignment.gyrocompass import align
from alignment.reasons import AlignmentReason
from ins.earth import gravity_magnitude, omega_ie_n
from ins.records import ImuLog, Site
from ins.twin_file import default_twin
from ins.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G

SITE = Site(lat_rad=-37.96 * DEG, lon_rad=144.76 * DEG, height_m=16.0)
GRAVITY = float(gravity_magnitude(SITE.lat_rad, SITE.height_m))
DT_S, BIAS_DEG_H = 0.02, np.array([600.0, 900.0, 500.0])
MEMS = default_twin("mems")


def codes_of(result):
    return [reason.code for reason in result.reasons]


def parked(
    *, roll_deg=0.0, pitch_deg=0.0, seconds=90.0, bias_deg_h=BIAS_DEG_H, scale=1.0, turn_rad_s=0.0
) -> ImuLog:
    """Gravity and Earth rate of a unit whose gyros warm up by half their bias; no noise."""
    n = round(seconds / DT_S)
    r, p = roll_deg * DEG, pitch_deg * DEG
    f_b = -GRAVITY * scale * np.array([-np.sin(p), np.cos(p) * np.sin(r), np.cos(p) * np.cos(r)])
    warm = np.linspace(0.5, 1.0, n)[:, None] * bias_deg_h * DEG_PER_HOUR
    w = warm + omega_ie_n(SITE.lat_rad) + [0.0, 0.0, turn_rad_s]
    return ImuLog(
        time_s=DT_S * np.arange(1, n + 1),
        dt_s=np.full(n, DT_S),
        dtheta_rad=w * DT_S,
        dv_m_s=np.tile(f_b * DT_S, (n, 1)),
    )


@pytest.mark.parametrize(
    ("roll_deg", "pitch_deg"), [(0.0, 0.0), (0.7, 4.5), (-20.0, 10.0), (3.0, -30.0)]
)
def test_level_of_a_mems_unit_whose_gyros_drift_by_hundreds_of_deg_h(roll_deg, pitch_deg):
    result = align(parked(roll_deg=roll_deg, pitch_deg=pitch_deg), SITE, MEMS)
    assert result.verdict == "level_only"
    assert codes_of(result) == [
        AlignmentReason.NO_HEADING,
        AlignmentReason.LEVEL_ALONE,
        AlignmentReason.TURNS_OR_BIAS,
    ]
    assert result.roll_rad / DEG == pytest.approx(roll_deg, abs=1e-9)
    assert result.pitch_rad / DEG == pytest.approx(pitch_deg, abs=1e-9)
    assert np.isnan(result.heading_rad) and np.isnan(result.sigma_heading_rad)
    assert [(p.phase, round(p.start_s), round(p.end_s)) for p in result.phases] == [
        ("alignment", 0, 90)
    ]
    assert result.duration_s == pytest.approx(90.0, abs=0.1)


def test_sigma_is_that_of_the_accelerometers_widened_by_what_gravity_shows():
    """By hand: turn-on bias over g and the noise of 30 s; a scale error of 3 % is 30 mrad more."""
    noise = MEMS.accel.vrw_ug_sqrt_hz * MICRO_G / np.sqrt(30.0)
    base = np.hypot(MEMS.accel.turn_on_ug * MICRO_G, noise) / GRAVITY
    assert align(parked(), SITE, MEMS).sigma_roll_rad == pytest.approx(base, rel=1e-3)
    assert align(parked(scale=0.97), SITE, MEMS).sigma_pitch_rad == pytest.approx(
        np.hypot(base, 0.03), rel=1e-3
    )


def test_a_mems_unit_with_a_table_that_good_keeps_the_filter():
    """1 deg/h is a tenth of level Earth rate: a heading, if a poor one."""
    result = align(parked(bias_deg_h=np.zeros(3)), SITE, MEMS, bias_sigma_deg_h=np.full(3, 1.0))
    assert result.verdict == "aligned" and 0.05 < result.sigma_heading_rad < 0.5


@pytest.mark.parametrize("axes", [(0,), (1,), (2,), (0, 1)])
@pytest.mark.parametrize("seed", [1, 3])
def test_a_mems_bias_of_any_size_gets_one_and_the_same_answer(axes, seed):
    """Ten minutes with the noise of the twin: at 12 to 110 deg/h rest was once looked for in a
    solution that drifts by hundreds of m/s, and taken for a taxi or for a flight.
    """
    for bias_deg_h in (0.0, 12.0, 20.0, 35.0, 60.0, 110.0, 300.0, -35.0):
        bias = np.zeros(3)
        bias[list(axes)] = bias_deg_h
        result = align(
            _noisy(parked(roll_deg=1.0, pitch_deg=-2.0, seconds=600.0, bias_deg_h=bias), seed),
            SITE,
            MEMS,
        )
        assert result.verdict == "level_only", bias_deg_h
        assert codes_of(result)[:2] == [AlignmentReason.NO_HEADING, AlignmentReason.LEVEL_ALONE]
        assert [p.phase for p in result.phases] == ["alignment"] and result.duration_s > 200.0
        assert abs(result.roll_rad - 1.0 * DEG) < 4 * result.sigma_roll_rad
        assert abs(result.pitch_rad + 2.0 * DEG) < 4 * result.sigma_pitch_rad


@pytest.mark.parametrize("technology", ["rlg", "fog"])
@pytest.mark.parametrize("bias_deg_h", [12.0, 35.0, 110.0])
def test_a_biased_unit_of_any_technology_is_neither_taxied_nor_flown(technology, bias_deg_h):
    twin = default_twin(technology)
    log = parked(roll_deg=1.0, seconds=600.0, bias_deg_h=np.array([bias_deg_h, 0.0, 0.0]))
    result = align(log, SITE, twin)
    assert result.verdict == "level_only" and [p.phase for p in result.phases] == ["alignment"]
    assert codes_of(result)[-1] == AlignmentReason.LIKE_MEMS
    assert result.reasons[-1].values["technology"] == technology
    assert result.sigma_roll_rad > 2e-3 and result.roll_rad / DEG == pytest.approx(1.0, abs=1e-9)
    known = align(log, SITE, twin, bias_sigma_deg_h=np.full(3, bias_deg_h))
    assert known.verdict == "level_only" and len(known.reasons) == 2 and known.sigma_roll_rad < 1e-3


def _noisy(log: ImuLog, seed: int) -> ImuLog:
    rng = np.random.default_rng(seed)
    arw, vrw = MEMS.gyro.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR, MEMS.accel.vrw_ug_sqrt_hz * MICRO_G
    turn, push = rng.normal(0.0, np.sqrt(DT_S), (2, log.time_s.size, 3))
    return replace(log, dtheta_rad=log.dtheta_rad + arw * turn, dv_m_s=log.dv_m_s + vrw * push)


@pytest.mark.parametrize("technology", ["rlg", "fog"])
@pytest.mark.parametrize("turn_rad_s", [0.003, 0.05])
def test_a_turntable_is_refused(technology, turn_rad_s):
    log = parked(bias_deg_h=np.zeros(3), turn_rad_s=turn_rad_s)
    result = align(log, SITE, default_twin(technology))
    assert result.verdict == "refused"
    assert codes_of(result)[0] == AlignmentReason.TURNS
