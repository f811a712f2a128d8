"""Fixes that are none, without accuracy, in other units, twice: left out and listed, or refused
with what would help.
"""

import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.readers.hostile_rows import PLACELESS, SECONDS, convert, noisy, with_fixes
from tests.trajectories.readers.known_motion import LAT_DEG
from tests.trajectories.readers.test_maps import FIXES, GNSS, N, csv_text
from trajectories.runs.directory import read_run, write_run

FIRST = SECONDS < 20


def test_no_fix_at_the_origin(tmp_path):
    """A receiver that writes zeros until it has a place: the site is that of the first fix."""
    zeros = {
        name: np.where(FIRST, 0.0, FIXES[name]) for name in ("lat", "lon", "h", "v1", "v2", "v3")
    }
    made = with_fixes(tmp_path, **zeros)
    assert made.run.gnss.time_s.size == 40
    assert np.degrees(made.run.header.site.lat_rad) == pytest.approx(LAT_DEG, abs=1e-3)
    assert "GPS rows 1-20 left out" in str(made.record.notes)
    with pytest.raises(InputError, match=r"lat_deg .*GPS rows 1-60 left out"):
        with_fixes(tmp_path, **{name: 0 * SECONDS for name in ("lat", "lon", "h")})


@pytest.mark.parametrize("missing", [np.nan, 0.0, -1.0])
def test_a_fix_without_its_sigma_keeps_its_place(tmp_path, missing):
    """NaN there, the others as logged; so it is after the run was written and read again."""
    made = with_fixes(tmp_path, s=np.where(SECONDS % 5 == 0, missing, 0.4))
    assert made.run.gnss.time_s.size == 60
    line = (
        "gps.csv: GPS rows 1, 6, 11, 16, 21, 26, 31, 36, 41, 46 and 2 more stretches without"
        " sigma_horizontal_m: "
    )
    assert f"{line}the declared one of the twin counts there" in str(made.record.notes)
    write_run(tmp_path / "run", made.run, conversion=made.record)
    for gnss in (made.run.gnss, read_run(tmp_path / "run").gnss):
        np.testing.assert_array_equal(np.isnan(gnss.sigma_horizontal_m), SECONDS % 5 == 0)
        np.testing.assert_allclose(gnss.sigma_horizontal_m[SECONDS % 5 != 0], 0.4)
        np.testing.assert_allclose(gnss.sigma_vertical_m, 0.9)
    assert with_fixes(tmp_path, s=np.full(60, missing)).run.gnss.sigma_horizontal_m is None


def test_a_receiver_that_knows_nothing_is_not_believed(tmp_path):
    """4 294 967.295 m, all bits of u-blox's hAcc: such a fix is left out, and does not count with
    the twin's half metre.
    """
    made = with_fixes(tmp_path, s=np.where(SECONDS % 5 == 0, 4_294_967.295, 0.4))
    assert made.run.gnss.time_s.size == 48 and "sigma is 1e+06 or more" in made.record.notes[0]


UNITS = [
    (
        {"lat": np.radians(FIXES["lat"]), "lon": np.radians(FIXES["lon"])},
        {},
        'degrees or radians\\? unit = "rad" or "deg"',
    ),
    (
        {"lat": FIXES["lat"] * 1e7, "lon": FIXES["lon"] * 1e7},
        {},
        'needed at most 90 deg: unit = "1e-7 deg"',
    ),
    ({"lat": FIXES["lon"], "lon": FIXES["lat"]}, {}, "latitude and longitude exchanged"),
    (
        {"lat": 3415.0 + 0 * SECONDS, "lon": 10_854.0 + 0 * SECONDS},
        {},
        "degrees and minutes\\? needed decimal degrees",
    ),
    ({}, {"unit": "rad"}, 'needed at most 1.5708 rad: unit = "deg"'),
]


@pytest.mark.parametrize(
    ("changes", "place", "line"), UNITS, ids=["rad", "1e7", "exchanged", "minutes", "not rad"]
)
def test_positions_in_another_unit_are_refused(tmp_path, changes, place, line):
    with pytest.raises(InputError, match=rf"gps.csv: latitudes of .*{line}"):
        with_fixes(tmp_path, gnss={"position": {**GNSS["position"], **place}}, **changes)


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"lat": np.radians(FIXES["lat"]), "lon": np.radians(FIXES["lon"])}, {"unit": "rad"}),
        (
            {"lat": FIXES["lat"] * 1e7, "lon": FIXES["lon"] * 1e7, "h": FIXES["h"] * 1e3},
            {"unit": "1e-7 deg", "height_unit": "mm"},
        ),
        ({}, {"unit": "deg"}),
        ({"h": FIXES["h"] / 0.3048}, {"height_unit": "ft"}),
    ],
)
def test_positions_in_a_unit_that_is_said(tmp_path, changes, place):
    gnss = with_fixes(
        tmp_path, gnss={"position": {**GNSS["position"], **place}}, **changes
    ).run.gnss
    np.testing.assert_allclose(np.degrees(gnss.lat_rad), FIXES["lat"], atol=1e-9)
    np.testing.assert_allclose(gnss.height_m, FIXES["h"], atol=1e-9)


def test_fixes_written_twice(tmp_path):
    twice = {
        name: np.repeat(values, 2) for name, values in {"stamp": 5000.01 + SECONDS, **FIXES}.items()
    }
    made = with_fixes(tmp_path, **twice)
    assert made.run.gnss.time_s.size == 60 and "time repeats or goes back" in made.record.notes[0]


def test_a_fix_held_in_every_row_counts_once_and_one_logged_again_counts_again(tmp_path):
    """A parked receiver that holds its place: in every row the same, or each second anew with
    nothing between.
    """
    held, anew = noisy(), noisy()
    for name, values in FIXES.items():
        held[name], anew[name] = np.full(N, values[0]), np.full(N, np.nan)
        anew[name][::100] = values[0]
    made = convert(tmp_path, held, {"gnss": GNSS}, PLACELESS)
    assert made.run.gnss.time_s.size == 1
    assert "5999 rows repeat" in str(made.record.notes)
    assert convert(tmp_path, anew, {"gnss": GNSS}, PLACELESS).run.gnss.time_s.size == 60


def test_a_wheel_beyond_any_vehicle(tmp_path):
    speed = np.where(SECONDS == 5, 1e9, np.where(SECONDS > 50, np.nan, 3.0))
    (tmp_path / "wheel.csv").write_text(csv_text({"stamp": 5000.01 + SECONDS, "v": speed}))
    made = convert(
        tmp_path,
        noisy(),
        {"odometer": {"column": "v", "file": "wheel.csv", "time": {"column": "stamp"}}},
    )
    assert made.run.odometer.speed_m_s.tolist() == [3.0] * 50
    beyond, without = made.record.notes
    assert "1 odometer rows dropped" in beyond and "9 odometer rows dropped" in without
