"""KF-GINS logs written by hand as its README lays them out: parked, a right turn, fixes and truth
in files of their own.
"""

import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.readers.known_motion import (
    GIVEN,
    HEIGHT_M,
    LAT_DEG,
    LON_DEG,
    PLACELESS,
    check_parked,
    parked,
)
from trajectories.readers.conversion import convert_log

SOW = 456_250.0
OUT = parked(start_s=SOW)


def write_imu(path, output=OUT, *, sign=1.0):
    rows = np.column_stack([output.time_s, output.dtheta, output.dv * sign])
    np.savetxt(path, rows, fmt="%16.9f" + " %.12e" * 6)
    return path


def write_gnss(path, *, velocity=False, speed_sigmas=True, seconds=60, start_s=SOW):
    """North at 1 m/s, climbing at 0.5 m/s: metres by the radius of a degree on this parallel."""
    t = start_s + np.arange(seconds)
    k = np.arange(seconds)
    columns = [t, LAT_DEG + k / 110_922.0, np.full(seconds, LON_DEG), HEIGHT_M + 0.5 * k]
    columns += [np.full(seconds, v) for v in ((1.0, 0.0, -0.5) if velocity else ())]
    columns += [np.full(seconds, s) for s in (0.012, 0.009, 0.02)]
    if velocity and speed_sigmas:
        columns += [np.full(seconds, 0.03)] * 3
    np.savetxt(
        path, np.column_stack(columns), fmt="%.3f %.12f %.12f" + " %.4f" * (len(columns) - 3)
    )
    return path


def test_parked_text(tmp_path):
    made = convert_log(write_imu(tmp_path / "imu.txt"), {}, GIVEN)
    check_parked(made.run, OUT)
    assert made.record.format == "kfgins"
    assert made.record.time_shift_s == pytest.approx(SOW, abs=1e-6)
    assert list(made.record.notes) == []


@pytest.mark.parametrize(
    "head", ["% sow dtx dty dtz dvx dvy dvz\n", "sow dtx dty dtz dvx dvy dvz\n"]
)
@pytest.mark.parametrize("comma", [False, True])
def test_a_line_of_names_and_commas(tmp_path, head, comma):
    text = write_imu(tmp_path / "imu.txt").read_text()
    text = "\n".join(",".join(line.split()) for line in text.splitlines()) + "\n" if comma else text
    (tmp_path / "imu.txt").write_text(
        (head.replace(" ", ",") if comma and head[0] != "%" else head) + text
    )
    made = convert_log(tmp_path / "imu.txt", {}, GIVEN)
    check_parked(made.run, OUT)
    assert made.record.format == "kfgins"


def test_doubles(tmp_path):
    """As the awesome-gins datasets have them."""
    np.column_stack([OUT.time_s, OUT.dtheta, OUT.dv]).astype("<f8").tofile(tmp_path / "imu.bin")
    made = convert_log(tmp_path / "imu.bin", {}, GIVEN)
    check_parked(made.run, OUT)
    assert made.record.format == "kfgins"


def test_fixes_of_another_file_give_the_place(tmp_path):
    gnss = write_gnss(tmp_path / "gnss.txt")
    made = convert_log(write_imu(tmp_path / "imu.txt"), {"gnss": {"file": "gnss.txt"}}, PLACELESS)
    run = made.run
    assert np.degrees(run.header.site.lat_rad) == pytest.approx(LAT_DEG, abs=1e-6)
    assert run.gnss.time_s[[0, -1]] == pytest.approx([0.0, 59.0], abs=1e-5)
    np.testing.assert_allclose(run.gnss.v_n_m_s, np.tile([1.0, 0.0, -0.5], (60, 1)), atol=1e-3)
    np.testing.assert_allclose(run.gnss.sigma_horizontal_m, np.sqrt((0.012**2 + 0.009**2) / 2))
    np.testing.assert_allclose(run.gnss.sigma_vertical_m, 0.02)
    np.testing.assert_allclose(
        run.gnss.sigma_velocity_m_s[1:-1], 0.0106 * np.sqrt(2) / 2, rtol=0.02
    )
    assert any("differences of their positions" in note for note in made.record.notes)
    assert made.record.other_sources[0].source == gnss.name


@pytest.mark.parametrize("speed_sigmas", [False, True])
def test_fixes_with_velocity(tmp_path, speed_sigmas):
    """10 columns, or 13."""
    write_gnss(tmp_path / "gnss.txt", velocity=True, speed_sigmas=speed_sigmas)
    made = convert_log(write_imu(tmp_path / "imu.txt"), {"gnss": {"file": "gnss.txt"}}, PLACELESS)
    gnss = made.run.gnss
    np.testing.assert_allclose(gnss.v_n_m_s, np.tile([1.0, 0.0, -0.5], (60, 1)))
    np.testing.assert_allclose(gnss.sigma_vertical_m, 0.02)
    if speed_sigmas:
        np.testing.assert_allclose(gnss.sigma_velocity_m_s, 0.03)
    else:
        assert gnss.sigma_velocity_m_s is None


def test_truth_gives_reference_date_and_place(tmp_path):
    """456 250 s are Friday 06:44:10 of week 2017 (from 2018-09-02), GPS 18 s ahead of UTC."""
    t = SOW + np.arange(0.0, 60.0, 0.5)
    row = [LAT_DEG, LON_DEG, HEIGHT_M, 1.0, 2.0, -0.5, 3.0, -2.0, 40.0]
    np.savetxt(
        tmp_path / "truth.nav",
        np.column_stack([np.full(t.size, 2017), t, np.tile(row, (t.size, 1))]),
        fmt="%.9f",
    )
    options = {"truth": "truth.nav"}
    made = convert_log(
        write_imu(tmp_path / "imu.txt"), options, {"imu_serial": "S", "gyro_technology": "mems"}
    )
    assert made.run.header.start_utc == "2018-09-07T06:43:52.000Z"
    assert np.degrees(made.run.header.site.lon_rad) == pytest.approx(LON_DEG)
    reference = made.reference
    np.testing.assert_allclose(
        np.degrees([reference.roll_rad[5], reference.pitch_rad[5], reference.heading_rad[5]]),
        [3, -2, 40],
    )
    np.testing.assert_allclose(reference.v_n_m_s[7], [1.0, 2.0, -0.5])
    assert reference.time_s[0] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize(
    ("options", "given", "line"),
    [
        ({}, PLACELESS, r"lat_deg \(--lat-deg\)"),
        ({}, {"lat_deg": 1.0, "lon_deg": 1.0, "height_m": 1.0}, "imu_serial .*start_utc"),
        ({"gnss": {"file": "no.txt"}}, GIVEN, r"no\.txt: no such file"),
        ({"gnss": {"file": "imu.txt"}}, GIVEN, r"a sigma of -0\.0977\d+ m"),
        ({"gnss": {"file": "six.txt"}}, GIVEN, r"six\.txt: 6 columns, needed 7 or 10 or 13"),
        ({"gps_weeks": 2000}, GIVEN, "unknown key gps_weeks"),
        ({"truth": "six.txt"}, GIVEN, "6 columns, needed 11"),
    ],
)
def test_what_is_missing_or_wrong_is_named(tmp_path, options, given, line):
    write_imu(tmp_path / "imu.txt")
    np.savetxt(tmp_path / "six.txt", np.ones((30, 6)))
    with pytest.raises(InputError, match=line):
        convert_log(tmp_path / "imu.txt", options, given)
