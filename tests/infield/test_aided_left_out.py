"""Fixes left out of an aided flight on purpose: not used, scored, and honest."""

import numpy as np
import pytest

from infield.aided.flight import Aiding, navigate_aided
from ins.earth import displacement_ned
from ins.records import InputError
from tests.infield.aided_cases import flown, ideal, twin_of

PARK_S = 180.0
SPAN = (350.0, 410.0)


def fly(seed: int, *spans):
    made, twin = flown(ideal(PARK_S), twin_of("mems"), 800 + seed), twin_of("mems")
    run = made.run
    found = navigate_aided(
        run, run.imu, twin, rest=None, gyro_sigma_deg_h=None, aiding=Aiding(left_out=spans)
    )
    return made, found


def test_score_is_the_error_against_the_truth():
    """A minute without fixes: the fixes there are unseen, and the error against them is that
    against the truth but for their own noise (0.5 m).
    """
    made, found = fly(1, SPAN)
    (score,), history = found.outage_scores, found.history
    inside = (history.fix_time_s >= SPAN[0]) & (history.fix_time_s <= SPAN[1])
    assert (history.used[inside] == 0).all() and score.fixes == inside.sum()
    rows = (history.time_s >= SPAN[0]) & (history.time_s <= SPAN[1])
    ref, t = made.reference, history.time_s[rows]
    off = displacement_ned(
        history.lat_rad[rows],
        history.lon_rad[rows],
        lat0_rad=np.interp(t, ref.time_s, ref.lat_rad),
        lon0_rad=np.interp(t, ref.time_s, ref.lon_rad),
        height0_m=np.interp(t, ref.time_s, ref.height_m),
    )
    true = np.linalg.norm(off, axis=1)
    assert score.rms_level_m == pytest.approx(np.sqrt(np.mean(true**2)), abs=0.6)
    assert score.end_level_m == pytest.approx(true[-1], abs=2.0)
    assert score.sigma_end_level_m > 5.0
    assert [w.why for w in found.weak] == ["outage"]


def test_errors_in_outages_are_within_their_sigmas():
    """Four flights of two outages: error over sigma, RMS over all, 0.5 to 1.5."""
    ratios = []
    for seed in range(4):
        _, found = fly(seed, (300.0, 330.0), (450.0, 510.0))
        ratios += [score.error_over_sigma for score in found.outage_scores]
    assert len(ratios) == 8 and 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.5
    assert max(ratios) < 3.0


def test_stretches_that_cannot_be_scored_are_named():
    with pytest.raises(InputError, match="outage 600:60: ends at 660 s, needed a stretch within"):
        fly(1, (600.0, 660.0))
    with pytest.raises(InputError, match="no satellite fix in it"):
        fly(1, (300.2, 300.4))
