"""PSINS logs written by hand as the toolbox writes them (imufile.m, trjsimu.m): axes right,
forward, up.
"""

import numpy as np
import pytest
from scipy.io import savemat

from ins.records import InputError
from tests.trajectories.readers.known_motion import (
    GIVEN,
    HEADING_DEG,
    HEIGHT_M,
    LAT_DEG,
    LON_DEG,
    PITCH_DEG,
    PLACELESS,
    ROLL_DEG,
    Output,
    at_rest,
    check_parked,
    parked,
)
from trajectories.readers.conversion import convert_log

pytestmark = pytest.mark.usefixtures("forked")
OUT = parked()
RFU_MAP = {  # what somebody would write who takes the columns for forward, right, down
    "format": "text",
    "header_lines": 0,
    "columns": ["gx", "gy", "gz", "ax", "ay", "az", "t"],
    "time": {"column": "t"},
    "gyro": {"columns": ["gx", "gy", "gz"], "unit": "rad"},
    "accel": {"columns": ["ax", "ay", "az"], "unit": "m/s"},
}


def imu_rows(output: Output = OUT) -> np.ndarray:
    """[wm, vm, t]."""
    return np.column_stack([*output.rfu(), output.time_s])


def avp_rows(output: Output = OUT) -> np.ndarray:
    """[pitch roll yaw, vE vN vU, lat lon hgt, t] at rest; heading 40 deg is yaw -40."""
    row = [
        *np.radians([PITCH_DEG, ROLL_DEG, -HEADING_DEG]),
        0.0,
        0.0,
        0.0,
        *np.radians([LAT_DEG, LON_DEG]),
        HEIGHT_M,
    ]
    return np.column_stack([np.tile(row, (output.rows, 1)), output.time_s])


def gps_rows(seconds=60) -> np.ndarray:
    """[vE vN vU, lat lon hgt, t]."""
    row = [1.0, 2.0, 0.5, *np.radians([LAT_DEG, LON_DEG]), HEIGHT_M]
    return np.column_stack([np.tile(row, (seconds, 1)), np.arange(1.0, seconds + 1)])


def simu_file(
    path,
    output: Output = OUT,
    *,
    late=False,
    ending="",
    remark="% 2014-03-21 17:31:51  by somebody\n",
):
    """Counts of 0.001 arcsec and 1 micro-g s remainder carried over, as imufile.m rounds."""
    scales = np.array([0.001] * 3 + [1.0] * 3)
    units = np.r_[[np.pi / 180 / 3600] * 3, [1e-6 * 9.780327] * 3] * scales
    counts = np.diff(
        np.trunc(np.cumsum(np.hstack(output.rfu()) / units, axis=0)), axis=0, prepend=0.0
    )
    tail = " 0" if late else ""
    head = [
        f"0.000000 0.000000 -90.600000 0.000000 0.000000 0.000000{ending}{tail}",
        f"{LAT_DEG:.8f} {LON_DEG:.8f} {HEIGHT_M:.3f} 0.00000000 10.00000000 9.780327{ending}{tail}",
        " ".join(f"{s:.6f}" for s in scales) + tail,
        "",
    ]
    rows = [" ".join(f"{int(v)}" for v in row) + tail for row in counts]
    path.write_text(
        "% PSINS-format SIMU log file. (DO NOT EDIT!)\n"
        + remark
        + "\n"
        + "\n".join([*head, *rows])
        + "\n"
    )
    return path


def text_file(path, output: Output = OUT):
    np.savetxt(path, imu_rows(output), fmt="%.12e")
    return path


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("ending", ["", "f"])
def test_simu_file(tmp_path, late, ending):
    """The place is in its head; the attitude there is inaccurate by its own word."""
    made = convert_log(
        simu_file(tmp_path / "lasergyro.imu", late=late, ending=ending), {}, PLACELESS
    )
    check_parked_on_average(made.run)
    assert made.record.format == "psins"
    assert made.run.header.site.height_m == HEIGHT_M
    assert np.degrees(made.run.header.site.lat_rad) == pytest.approx(LAT_DEG)
    assert any("heading 90.6 deg" in note for note in made.record.notes)
    assert made.run.imu.rate_hz == pytest.approx(100.0)


def check_parked_on_average(run):
    """Counts round; the mean does not: 0.001 arcsec and 1 micro-g s in 60 s."""
    w, f = at_rest()
    span = run.imu.dt_s.sum()
    np.testing.assert_allclose(run.imu.dtheta_rad.sum(axis=0) / span, w, atol=1e-9)
    np.testing.assert_allclose(run.imu.dv_m_s.sum(axis=0) / span, f, atol=1e-5)


def test_late_samples_of_a_simu_file(tmp_path):
    """A correction of the interval in microseconds, once and for all after it."""
    path = simu_file(tmp_path / "log.imu", late=True)
    lines = path.read_text().splitlines()
    # below the head and its empty line
    first = next(k for k, line in enumerate(lines) if line == "") + 5
    lines[first + 100] = lines[first + 100][:-1] + "2000"
    path.write_text("\n".join(lines) + "\n")
    made = convert_log(path, {}, PLACELESS)
    assert made.run.imu.end_s == pytest.approx(60.002, abs=1e-6)
    assert made.run.imu.dt_s[100] == pytest.approx(0.012, abs=1e-9)


def test_seven_columns_of_text(tmp_path):
    made = convert_log(text_file(tmp_path / "imu.txt"), {}, GIVEN)
    check_parked(made.run, OUT)
    assert made.record.format == "psins"


@pytest.mark.parametrize("in_trj", [False, True])
def test_mat(tmp_path, in_trj):
    parts = {"imu": imu_rows(), "avp": avp_rows()}
    held = {"trj": {**parts, "ts": 0.01, "avp0": avp_rows()[0, :9, None]}} if in_trj else parts
    savemat(tmp_path / "trj10ms.mat", {**held, "gps": gps_rows()})
    made = convert_log(tmp_path / "trj10ms.mat", {}, PLACELESS)
    check_parked(made.run, OUT)
    assert made.record.format == "psins"
    np.testing.assert_allclose(made.run.gnss.v_n_m_s, np.tile([2.0, 1.0, -0.5], (60, 1)))
    assert np.degrees(made.run.gnss.lat_rad[0]) == pytest.approx(LAT_DEG)
    reference = made.reference
    angles = np.degrees([reference.roll_rad[9], reference.pitch_rad[9], reference.heading_rad[9]])
    np.testing.assert_allclose(angles, [ROLL_DEG, PITCH_DEG, HEADING_DEG])
    assert any("6000 rows as reference" in note for note in made.record.notes)


@pytest.mark.parametrize("kind", ["txt", "mat"])
def test_fixes_of_another_file(tmp_path, kind):
    if kind == "txt":
        np.savetxt(tmp_path / "gps.txt", gps_rows(), fmt="%.12e")
    else:
        savemat(tmp_path / "gps.mat", {"gps": gps_rows()})
    made = convert_log(
        text_file(tmp_path / "imu.txt"), {"gnss": {"file": f"gps.{kind}"}}, PLACELESS
    )
    assert made.run.gnss.time_s.size == 60
    np.testing.assert_allclose(made.run.gnss.v_n_m_s[0], [2.0, 1.0, -0.5])


def test_positions_alone_have_no_sigma_and_give_no_stream(tmp_path):
    savemat(tmp_path / "trj.mat", {"imu": imu_rows(), "gps": gps_rows()[:, 3:]})
    made = convert_log(tmp_path / "trj.mat", {}, GIVEN)
    assert made.run.gnss is None
    assert any("no sigma to give" in note for note in made.record.notes)


@pytest.mark.parametrize("technology", ["rlg", "fog", "mems"])
def test_a_wrong_map_is_refused_with_the_right_one(tmp_path, technology):
    """Right, forward, up taken for forward, right, down: gravity is upside down, and Earth rate
    confirms which way is up.
    """
    with pytest.raises(InputError) as caught:
        convert_log(
            text_file(tmp_path / "imu.txt"), RFU_MAP, GIVEN | {"gyro_technology": technology}
        )
    told = str(caught.value)
    assert 'x = "x", y = "-y", z = "-z"' in told
    assert 'x = "y", y = "x", z = "-z"' in told


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda t: t.replace(" 9.780327", ""), "line 5: got '34"),
        (lambda t: t.replace(" 10.00000000 ", " 0.0 "), "head: interval 0 ms"),
        (lambda t: t.split("34.25")[0], r"log\.imu: \d lines in the head, needed 3"),
        (
            lambda t: t[:-9000] + "\n1 2 x 4 5 6\n" * 90 + t[-9000:].partition("\n")[2],
            r"column wm_z: got .x., needed a number",
        ),
    ],
)
def test_damaged_simu_files_are_named(tmp_path, change, line):
    path = simu_file(tmp_path / "log.imu")
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError, match=line):
        convert_log(path, {}, PLACELESS)
