"""From runs on four azimuths to a twin: stops, azimuths, refusals, levelling, and sessions that
agree after it.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from infield.misalignment.azimuth_biases import KnownAzimuths
from infield.misalignment.azimuth_runs import AzimuthStop, find_stops
from infield.misalignment.reasons import MisalignmentNote
from infield.misalignment.study import (
    AzimuthSettings,
    corrected_twin,
    level_offsets,
    study_runs,
    study_table,
)
from infield.reports.documents.misalignment import misalignment_document
from infield.reports.misalignment_page import render
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.settings import SessionSettings, misalignment_sigma_mrad
from infield.table.file import table_sha256, table_to_dict
from ins.earth import gravity_magnitude
from ins.records import AccelNoise, InputError
from ins.units import ARCSEC, DEG, MICRO_G
from ins.verdicts import codes, sentences
from tests.infield.azimuth_cases import (
    SITE,
    STOP_S,
    TRUE_MRAD,
    TWIN,
    four_stops,
    one_power_on,
    parked_run,
    simulated,
    table,
)
from trajectories.simulator.motions import Straight

TRUE = dict(zip(("xy", "xz", "yx", "yz", "zx", "zy"), TRUE_MRAD)) | {
    "xy+yx": TRUE_MRAD[0] + TRUE_MRAD[2]
}
FOUR_DEG = (0.0, 90.0, 180.0, 270.0)


def known(*heading_deg):
    return KnownAzimuths(
        heading_rad=np.array(heading_deg) * DEG,
        sigma_stop_rad=2 * ARCSEC,
        sigma_north_rad=5 * ARCSEC,
    )


def study(runs, **options):
    return study_runs(runs, table(), TWIN, **options)


def errors(result):
    """Error over sigma of what was observed."""
    seen = [c for c in result.couplings if c.verdict != "not_observable"]
    return {c.entry: (c.value_rad * 1e3 - TRUE[c.entry]) / (c.sigma_rad * 1e3) for c in seen}


@pytest.mark.parametrize("turn_s", [4.0, 60.0, 600.0])
def test_stops_are_found_with_quick_and_slow_turns_and_the_turns_are_followed(turn_s):
    stops, left_out = find_stops(one_power_on(45.0, turn_s).run, TWIN)
    assert len(stops) == 4 and not left_out
    sigma_deg = np.sqrt([s.turn_variance_rad2 for s in stops]) / DEG
    assert np.all(np.abs([s.turn_rad / DEG for s in stops] - np.array(FOUR_DEG)) <= 3.3 * sigma_deg)
    assert sigma_deg[-1] < 0.0005 + 1e-5 * turn_s
    assert all(s.used_s > STOP_S - 150.0 for s in stops)
    period = STOP_S + turn_s
    for k, stop in enumerate(stops):
        assert k * period - 0.1 <= stop.start_s and stop.end_s <= k * period + STOP_S


@pytest.mark.parametrize("heading_deg", [0.0, 45.0])
def test_one_power_on_without_azimuths(heading_deg):
    result = study([one_power_on(heading_deg).run]).result
    found = errors(result)
    assert result.verdict == "measured" and set(found) == {"zx", "zy", "xy+yx"}
    assert all(abs(z) < 3.3 for z in found.values()), found
    assert all(
        c.verdict == "observed" and c.sigma_rad < 0.15e-3
        for c in result.couplings
        if c.entry in found
    )


def test_one_power_on_with_azimuths_gives_every_coupling():
    result = study([one_power_on(0.0).run], known=known(*FOUR_DEG)).result
    found = errors(result)
    assert len(found) == 5 and all(abs(z) < 3.3 for z in found.values()), found


def test_four_power_ons_with_and_without_azimuths():
    runs = [parked_run(h).run for h in FOUR_DEG]
    given, found = study(runs, known=known(*FOUR_DEG)).result, study(runs).result
    assert len(errors(given)) == 5 and all(abs(z) < 3.3 for z in errors(given).values())
    assert set(errors(found)) == {"zx", "zy"}  # on the cardinal headings nobody sees the sum
    seen = set(errors(study([parked_run(h + 45.0).run for h in FOUR_DEG]).result))
    assert seen == {"zx", "zy", "xy+yx"}


LEVEL_DEG_H = 15.041 * np.cos(0.7)
MADE = {"xy": 3e-4, "yx": -2e-4, "zx": 4e-4, "zy": 1e-4, "xy+yx": 1e-4}


def made_studies(
    seeds, *, noise_deg_h=0.001, declared_deg=0.1, common_deg=None, first_stop_deg=0.0
):
    """Biases made by the sensor model of physics.md section 4, with plain sums of the angles.

    common_deg: error of all headings given, None: drawn as declared; first_stop_deg: more of one.
    """
    rng = np.random.default_rng(21)
    given = np.array(FOUR_DEG) * DEG
    for _ in range(seeds):
        off = rng.normal(0.0, declared_deg * DEG) if common_deg is None else common_deg * DEG
        true = given - off
        true[0] -= first_stop_deg * DEG
        forward, right = LEVEL_DEG_H * np.cos(true), -LEVEL_DEG_H * np.sin(true)
        x, y = forward + MADE["xy"] * right, right + MADE["yx"] * forward
        reads = np.column_stack([x, y, MADE["zx"] * forward + MADE["zy"] * right])
        reads[:, 0] -= LEVEL_DEG_H * np.cos(given)
        reads[:, 1] += LEVEL_DEG_H * np.sin(given)
        yield study_table(
            given,
            reads + rng.normal(0.0, noise_deg_h, reads.shape),
            np.full(reads.shape, noise_deg_h),
            lat_rad=0.7,
            twin=TWIN,
            source="made",
            settings=AzimuthSettings(sigma_heading_deg=declared_deg),
        )


def mean_squares(studies):
    """Mean squared error over variance of each coupling, of the studies that are measured."""
    found = {name: [] for name in MADE}
    for made in studies:
        if made.result.verdict == "measured":
            for c in made.result.couplings:
                found[c.entry].append(((c.value_rad - MADE[c.entry]) / c.sigma_rad) ** 2)
    return {name: float(np.mean(values)) for name, values in found.items()}


@pytest.mark.parametrize("common_deg", [0.1, 1.0])
def test_an_error_that_all_headings_share_is_within_the_sigmas(common_deg):
    low, high = chi2.ppf([0.0005, 0.9995], 400) / 400
    means = mean_squares(made_studies(400, declared_deg=common_deg))
    # the sum takes part in what is allowed for stops (STOP_NATS)
    assert 0.7 < means.pop("xy+yx") < high
    assert all(low < mean < high for mean in means.values()), means


@pytest.mark.parametrize("common_deg", [0.5, 1.0])
def test_an_error_that_all_headings_share_beyond_the_declared_one_is_found(common_deg):
    """Before, xy and yx were 10 sigma off at 1 deg and `measured`."""
    studies = list(made_studies(60, common_deg=common_deg))
    for made in studies:
        assert made.result.verdict == "measured"
        assert MisalignmentNote.HEADINGS_TURNED in {note.code for note in made.notes}
        assert made.result.coupling("xy").verdict == "not_observable"
        assert made.result.coupling("xy+yx").verdict == "observed"
    means = mean_squares(studies)
    assert all(0.6 < mean < 1.5 for mean in means.values()), means
    twin = corrected_twin(studies[0]).gyro
    assert twin.misalignment_mrad[0] == twin.misalignment_mrad[2]


@pytest.mark.parametrize(("noise_deg_h", "contradicted"), [(0.001, 1.0), (0.0035, 0.1)])
def test_one_stop_off_by_a_tenth_of_a_degree_is_found_or_allowed_for(noise_deg_h, contradicted):
    """0.1 deg are 0.87 mrad of yx: 4.6 sigma of 0.0035 deg/h at each stop."""
    studies = list(
        made_studies(100, noise_deg_h=noise_deg_h, declared_deg=0.003, first_stop_deg=0.1)
    )
    verdicts = [made.result.verdict for made in studies]
    assert np.mean([verdict == "inconsistent" for verdict in verdicts]) >= contradicted
    if contradicted < 1.0:
        codes = [{note.code for note in made.notes} for made in studies]
        assert np.mean([MisalignmentNote.HEADINGS_SCATTER in found for found in codes]) > 0.6
        assert mean_squares(studies)["yx"] < 6.0  # 16 before


def test_the_table_merge_takes_both_headings_after_it_and_neither_before():
    corrected = corrected_twin(study([one_power_on(0.0).run], known=known(*FOUR_DEG)))
    runs = [parked_run(heading).run for heading in (45.0, 225.0)]
    parent = table_sha256(table_to_dict(table()))
    before, after = (
        update_calibration(runs, table(), twin, history=UnitHistory(parent_sha256=parent))
        for twin in (TWIN, corrected)
    )
    assert before.outcome == "inconsistent" and after.outcome == "accepted", (
        before.reasons,
        after.reasons,
    )


def test_the_twin_carries_value_and_sigma_into_the_session():
    made = study([one_power_on(45.0).run])
    twin = corrected_twin(made)
    both = made.result.coupling("xy+yx")
    assert (
        twin.gyro.misalignment_mrad[0]
        == twin.gyro.misalignment_mrad[2]
        == pytest.approx(both.value_rad * 500.0)
    )
    assert twin.gyro.misalignment_mrad[1] == 0.0 and twin.gyro.sigma_misalignment_mrad[1] == 0.0
    sigma = misalignment_sigma_mrad(twin, SessionSettings())
    assert sigma[2] == pytest.approx(
        1e3 * np.hypot(made.result.coupling("zx").sigma_rad, made.result.coupling("zy").sigma_rad)
    )
    assumed = SessionSettings(sigma_misalignment_mrad={TWIN.gyro_technology: 0.3})
    assert misalignment_sigma_mrad(TWIN, assumed) == pytest.approx([0.3] * 3)


@pytest.mark.parametrize(
    ("runs", "options", "told"),
    [
        (lambda: [parked_run(h).run for h in FOUR_DEG[:3]], {}, "none near"),
        (
            lambda: [parked_run(h).run for h in FOUR_DEG],
            {"known": known(0, 270, 180, 90)},
            "north to west",
        ),
        (
            lambda: [parked_run(h).run for h in FOUR_DEG],
            {"known": known(0, 94, 180, 270)},
            "4.00 deg off",
        ),
        (
            lambda: [simulated(four_stops(angles_deg=(90.0, 96.0, 90.0)), 45.0).run],
            {},
            "off its place",
        ),
        (
            lambda: [one_power_on().run],
            {"settings": AzimuthSettings(shortest_s=1200.0)},
            "needed 1200 s",
        ),
        (
            lambda: [
                simulated((Straight(duration_s=900.0, speed_m_s=8.0),), 0.0, with_gnss=True).run
            ],
            {},
            "steady roll",
        ),
    ],
)
def test_refusals_say_why(runs, options, told):
    made = study(runs(), **options)
    assert made.result.verdict == "refused" and made.result.fit is None
    assert told in "; ".join(sentences(made.result.reasons))
    document = misalignment_document(made, version="test")
    assert document.couplings == [] and document.rank.rank <= 3 and corrected_twin(made) == TWIN
    assert "Refused" in render(document)


def test_gyros_too_poor_to_find_an_azimuth_are_refused_until_it_is_given():
    from infield.table.thermal_table import default_table

    wide = default_table(
        imu_serial="SN-0042",
        gyro_technology="fog",
        created_utc="2026-01-01T00:00:00Z",
        sigma_deg_h=30.0,
    )
    runs = [parked_run(h).run for h in FOUR_DEG]
    refused = study_runs(runs, wide, TWIN)
    assert refused.result.verdict == "refused"
    assert "azimuths_cannot_be_found" in codes(refused.result.reasons)[0]
    assert study_runs(runs, wide, TWIN, known=known(*FOUR_DEG)).result.fit is not None


def test_bad_inputs_are_one_line():
    run = parked_run(0.0).run
    other = replace(run, header=replace(run.header, imu_serial="SN-7"), sha256="x")
    far = replace(
        run, header=replace(run.header, site=replace(run.header.site, lat_rad=0.5)), sha256="x"
    )
    for runs, options, told in (
        ([run, other], {}, "one unit"),
        ([run, far], {}, "one place"),
        ([run, run], {}, "twice"),
        ([one_power_on().run], {"known": known(0, 90)}, "4 stops"),
    ):
        with pytest.raises(InputError, match=told) as error:
            study(runs, **options)
        assert "\n" not in str(error.value)


def stop(run, f):
    return AzimuthStop(
        run=run, start_s=0.0, end_s=900.0, used_s=900.0, gyro_rad_s=np.zeros(3), f_m_s2=np.array(f)
    )


def test_two_position_levelling_by_hand():
    """Ground 1 mrad down to the north: f_x = o_x + g 1e-3 cosH; o is half the sum of two opposite
    stops.
    """
    g = float(gravity_magnitude(SITE.lat_rad, SITE.height_m))
    heading = np.array(FOUR_DEG) * DEG
    f = [
        (50 * MICRO_G + 1e-3 * g * np.cos(H), -20 * MICRO_G - 1e-3 * g * np.sin(H), -g)
        for H in heading
    ]
    found = level_offsets(
        [stop(0, v) for v in f], heading, AccelNoise(bias_ug=(5.0, 0.0, 0.0)), SITE
    )
    np.testing.assert_allclose(found.offset_ug, [55.0, -20.0], atol=1e-6)
    np.testing.assert_allclose(found.ground_tilt_arcsec * ARCSEC, [1e-3, 0.0], atol=1e-9)
    assert found.same_ground and found.dof == 4
    pair = level_offsets([stop(0, f[0]), stop(0, f[2])], heading[[0, 2]], AccelNoise(), SITE)
    np.testing.assert_allclose(pair.offset_ug, [50.0, -20.0], atol=1e-6)
    assert level_offsets([stop(0, f[0])], heading[:1], AccelNoise(), SITE) is None


def test_offsets_of_a_run_are_bias_and_mounting_and_a_bias_needs_the_mounting():
    run = one_power_on(0.0)
    true_ug = run.accel_bias_true_ug.mean(axis=0)[:2]
    made = study([run.run], settings=AzimuthSettings(sigma_mounting_arcsec=10.0))
    g_ug = float(gravity_magnitude(SITE.lat_rad, 250.0)) / MICRO_G
    of_attitude = g_ug * np.array([np.sin(-1e-3), -np.sin(2e-3) * np.cos(1e-3)])
    assert np.abs(made.levels.offset_ug - of_attitude - true_ug).max() < 5.0
    document = misalignment_document(made, version="test").accelerometers
    # 10 arcsec are 48 ug
    assert document.sigma_bias_ug[0] > 48.0 > 15.0 > document.sigma_offset_ug[0]
    assert misalignment_document(study([run.run]), version="test").accelerometers.bias_ug is None
