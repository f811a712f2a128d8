"""Aided replay given the whole log: starts, outages, headings that nothing shows, antennas."""

import numpy as np
import pytest

from infield.aided.flight import Aiding, navigate_aided
from infield.aided.smoothing import LEAST_WEIGHT
from infield.replay.free_inertial import TableChoice, replay
from ins.units import DEG
from tests.cut import cut_run
from tests.infield.aided_cases import errors, flown, ideal, normalised, twin_of
from tests.infield.test_aided_headings import fly, slow

OUT = ((300.0, 330.0), (400.0, 430.0))


@pytest.mark.parametrize("flights", [3, pytest.param(30, marks=pytest.mark.slow)])
def test_outages_are_held_from_both_ends(flights):
    """MEMS with all its noise, two stretches of 30 s left out: level errors there a third of the
    filter's or less, errors over sigmas throughout one.
    """
    filters, ours, ratios = [], [], []
    for seed in range(flights):
        made, twin = flown(ideal(60.0), twin_of("mems"), 300 + seed), twin_of("mems")
        found = navigate_aided(
            made.run,
            made.run.imu,
            twin,
            rest=None,
            gyro_sigma_deg_h=None,
            aiding=Aiding(left_out=OUT),
        ).with_smoothed(OUT)
        filters += [score.rms_level_m for score in found.outage_scores]
        ours += [score.rms_level_m for score in found.smoothed_scores]
        ratios.append(normalised(made, found.smoothed, 0))
    assert np.sqrt(np.mean(np.square(ours))) < np.sqrt(np.mean(np.square(filters))) / 3.0 + 0.5
    assert (np.mean(ratios, axis=0) > 0.3).all() and (np.mean(ratios, axis=0) < 1.9).all()


@pytest.mark.parametrize("flights", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_first_minutes_of_a_wide_start_are_as_good_as_the_last(flights):
    """A slow vehicle whose heading is known to some degrees at the start: smoothed, its sigma there
    is no more than 1.5 of the filter's at the end, and the error is within three of it.
    """
    offs = []
    for seed in range(flights):
        made = slow(seed)
        found = fly(made.run).with_smoothed()
        assert found.found.method == "several headings"
        first = float(np.sqrt(found.smoothed.variance[0, 8]))
        assert first < 1.5 * float(np.sqrt(found.history.variance[-1, 8]))
        assert first < 0.5 * found.found.sigma_heading_rad
        offs.append(errors(made, found.smoothed)[0, 8] / first)
    assert np.abs(offs).max() < 3.0


def test_all_headings_are_smoothed_by_their_last_weights():
    """A cruise that shows no heading: the smoothed one is as unknown as the filter's is at the end,
    from the first row on.
    """
    made = flown(ideal(180.0), twin_of("mems"), 42)
    found = fly(cut_run(made.run, 560.0, 600.0)).with_smoothed()
    sigma = np.sqrt(found.smoothed.variance[:, 8])
    end = float(np.sqrt(found.history.variance[-1, 8]))
    assert found.found.method == "all headings" and LEAST_WEIGHT < 0.01
    assert np.abs(sigma / end - 1.0).max() < 0.25
    off = errors(made, found.smoothed)
    assert np.abs(off[:, 8] / sigma).max() < 3.0
    assert (np.abs(off[:, :3]) / np.sqrt(found.smoothed.variance[:, :3])).max() < 5.0


def test_smoothing_is_asked_for():
    """Nothing is smoothed unless asked; a refused flight has nothing to smooth."""
    made, twin = flown(ideal(60.0), twin_of("mems"), 301), twin_of("mems")
    table = [TableChoice(role="active", table=None, origin="none")]
    plain = replay(made.run, table, twin)
    both = replay(made.run, table, twin, aided=Aiding(smooth=True))
    assert plain.aided.smoothed is None and both.aided.smoothed is not None
    assert np.array_equal(plain.aided.history.C_nb, both.aided.history.C_nb)
    assert np.sqrt(both.aided.smoothed.variance[0, 8]) < 1.0 * DEG
    parked = replay(cut_run(made.run, 0.0, 50.0), table, twin, aided=Aiding(smooth=True))
    assert parked.aided is None or parked.aided.smoothed is None
