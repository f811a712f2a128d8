"""Text of Xsens and VectorNav, written column by column from their makers' names and units."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ins.records import FixType
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
    check_parked,
    check_right_turn,
    parked,
    parked_and_turned,
)
from trajectories.readers.conversion import convert_log

FLU = np.array([1.0, -1.0, -1.0])
OUT = parked(seconds=10.0, start_s=100.0)
UTC_NAMES = ["UTC_Nano", *(f"UTC_{k}" for k in "Year Month Day Hour Minute Second".split())]


def table(path, names, columns, *, sign="\t", before=()):
    rows = np.array([np.asarray(c).astype(str) for c in columns]).T
    text = "\n".join([*before, sign.join(names), *(sign.join(row) for row in rows), ""])
    path.write_text(text)
    return path


def texts(values, form="{:.10f}"):
    return [form.format(v) if np.isfinite(v) else "" for v in values]


def xsens(
    path, output: Output = OUT, *, fine="mti", gyro=1.0, turned=None, known_from=0, sign="\t"
):
    """Rows of MT Manager, or with `fine` "dot" or None of DOT or of an MTw without a clock.

    turned: quaternions (n, 4) or matrices (n, 3, 3); known_from: row from which UTC and a place
    are known.
    """
    n = output.rows
    dt = float(output.time_s[1] - output.time_s[0])
    count = (np.arange(n) + 65_000) % 65_536
    ticks = {"mti": 1e4, "dot": 1e6, None: np.nan}[fine]
    with np.errstate(invalid="ignore"):
        clock = np.mod(np.round((output.time_s - output.time_s[0] + 429_490.0) * ticks), 2**32)
    names = [
        "PacketCounter",
        "SampleTimeFine",
        "Acc_X",
        "Acc_Y",
        "Acc_Z",
        "Gyr_X",
        "Gyr_Y",
        "Gyr_Z",
    ]
    w, f = output.dtheta / dt * FLU * gyro, output.dv / dt * FLU
    columns = [texts(count, "{:05.0f}"), texts(clock, "{:.0f}"), *map(texts, f.T), *map(texts, w.T)]
    if turned is not None and turned.ndim == 2:
        names += [f"Quat_q{k}" for k in range(4)]
        columns += [texts(q) for q in turned.T]
    elif turned is not None:
        names += [f"Mat[{i}][{j}]" for j in (1, 2, 3) for i in (1, 2, 3)]
        columns += [texts(turned[:, i, j]) for j in range(3) for i in range(3)]
    k = np.arange(n)
    late = k >= known_from
    second = 10 + k // 100
    utc = [k % 100 * 1e7, *(np.full(n, v) for v in (2026, 3, 1, 5, 0)), second]
    names += [*UTC_NAMES, "Latitude", "Longitude", "Altitude", "Temperature"]
    columns += [texts(np.where(late, v, np.nan), "{:.0f}") for v in utc]
    columns += [texts(np.where(late, v, np.nan)) for v in (LAT_DEG, LON_DEG, HEIGHT_M)]
    columns += [texts(np.full(n, 31.0))]
    before = ["// General information: ", "//  DeviceId: 00B42D4B", "// Update Rate: 100.0Hz"]
    return table(path, names, columns, sign=sign, before=before)


@pytest.mark.parametrize("fine", ["mti", "dot", None])
def test_xsens_parked(tmp_path, fine):
    """UTC and a place late in the log: the start is that of the first row. Both counters wrap."""
    path = xsens(tmp_path / "log.txt", fine=fine, known_from=600)
    made = convert_log(path, {}, {})
    check_parked(made.run, OUT)
    header = made.run.header
    assert (made.record.format, header.imu_serial) == ("xsens", "00B42D4B")
    assert header.gyro_technology == "mems" and header.start_utc == "2026-03-01T05:00:09.990Z"
    assert np.degrees(header.site.lat_rad) == pytest.approx(LAT_DEG, abs=1e-9)
    assert made.run.gnss is None
    np.testing.assert_allclose(made.run.temperature.gyro_degC, 31.0)


@pytest.mark.parametrize("sign", [",", ";", "\t"])
def test_xsens_turns_right(tmp_path, sign):
    path = xsens(tmp_path / "log.txt", parked_and_turned(dt=0.05), sign=sign)
    check_right_turn(convert_log(path, {}, {}).run)


@pytest.mark.parametrize("gyro", [1.0, 180 / np.pi])
@pytest.mark.parametrize("as_matrix", [False, True])
def test_the_orientation_tells_the_unit_of_the_gyros(tmp_path, gyro, as_matrix):
    """Orientations of the same turn, left about z by a negative angle."""
    out = parked_and_turned(dt=0.05)
    angle = np.cumsum(out.dtheta[:, 2]) / 2
    turned = np.column_stack([np.cos(angle), 0 * angle, 0 * angle, -np.sin(angle)])
    if as_matrix:
        turned = Rotation.from_quat(turned[:, [1, 2, 3, 0]]).as_matrix()
    made = convert_log(xsens(tmp_path / "log.txt", out, gyro=gyro, turned=turned), {}, {})
    check_right_turn(made.run)
    unit = "rad/s" if gyro == 1.0 else "deg/s"
    assert any(f"gyros in {unit}, as the orientation turns" in n for n in made.record.notes)


def test_a_counter_that_goes_back_is_a_late_row(tmp_path):
    """One step back, not 65,535 ahead: the late row is put back, those behind keep their times."""
    path = xsens(tmp_path / "log.txt", fine=None)
    lines = path.read_text().splitlines()
    lines[500], lines[501] = lines[501], lines[500]
    path.write_text("\n".join([*lines, ""]))
    run = convert_log(path, {}, {}).run
    assert run.imu.end_s == pytest.approx(10.0) and run.imu.rows == OUT.rows


def vectornav(
    path, output: Output = OUT, *, style="sdk", kind="raw", week_from=0, fixes=True, solution=False
):
    """A CSV of the SDK, or of INSTINCT; week_from: row from which the GPS week is known; solution:
    with the unit's own solution, and with rates and forces less its bias estimates.
    """
    n, dt = output.rows, float(output.time_s[1] - output.time_s[0])
    tow = np.round((200_000.0 + dt * np.arange(n)) * 1e9)
    week = np.where(np.arange(n) >= week_from, 2400, 0)
    w, f = output.dtheta / dt, output.dv / dt
    if kind == "increments":
        w, f = np.degrees(output.dtheta), output.dv
    names = VN_NAMES[style, kind]
    columns = [texts(np.round(output.time_s * 1e9), "{:.0f}"), texts(tow, "{:.0f}"), week]
    columns += [*map(texts, w.T), *map(texts, f.T), texts(np.full(n, 25.0))]
    if fixes:
        names = names + VN_FIXES[style]
        k = np.arange(n) // 20  # every 0.2 s, 50 ms old where it comes
        fix_tow = np.round((200_000.0 + 0.2 * k - 0.05) * 1e9)
        fix = [texts(fix_tow, "{:.0f}"), np.full(n, 2400), np.where(np.arange(n) < 100, 2, 3)]
        fix += [texts(LAT_DEG + 1e-6 * k), texts(np.full(n, LON_DEG)), texts(np.full(n, HEIGHT_M))]
        columns += [*fix, *(texts(np.full(n, v)) for v in (1.0, 2.0, -0.5, 0.3, 0.4, 0.9, 0.05))]
    if solution:
        names = names + VN_SOLUTION
        less = np.hstack([w - 1e-3, f + 0.1])
        place = [LAT_DEG, LON_DEG, HEIGHT_M, 1.0, 2.0, -0.5, HEADING_DEG - 360, PITCH_DEG, ROLL_DEG]
        columns += [*map(texts, less.T), *(texts(np.full(n, v)) for v in place)]
    return table(path, names, columns, sign=",")


_XYZ = "XYZ"
VN_NAMES = {
    ("sdk", "raw"): ["timeStartup", "timeGpsTow", "timeGpsWeek"]
    + [f"uncompGyro{a}" for a in _XYZ]
    + [f"uncompAccel{a}" for a in _XYZ]
    + ["temperature"],
    ("sdk", "increments"): ["timeStartup", "timeGpsTow", "timeGpsWeek"]
    + [f"deltaTheta{a}" for a in _XYZ]
    + [f"deltaVel{a}" for a in _XYZ]
    + ["temperature"],
    ("instinct", "raw"): ["Time::TimeStartup [ns]", "Time::GpsTow [ns]", "Time::GpsWeek"]
    + [f"IMU::UncompGyro::{a} [rad/s]" for a in _XYZ]
    + [f"IMU::UncompAccel::{a} [m/s^2]" for a in _XYZ]
    + ["IMU::Temp [Celsius]"],
}
VN_SOLUTION = [f"{k}{a}" for k in ("angularRate", "accel") for a in _XYZ]
VN_SOLUTION += ["lat", "lon", "alt", *(f"velNed{a}" for a in _XYZ), "yaw", "pitch", "roll"]
VN_FIXES = {
    "sdk": ["gps1Tow", "gps1Week", "gnss1Fix", "gnss1PosLat", "gnss1PosLon", "gnss1PosAlt"]
    + [f"gnss1VelNed{a}" for a in _XYZ]
    + [f"gnss1PosUncertainty{a}" for a in "NED"]
    + ["gnss1VelUncertainty"],
    "instinct": ["GNSS1::Tow [ns]", "GNSS1::Week", "GNSS1::Fix"]
    + [f"GNSS1::PosLla::{k}" for k in ("latitude [deg]", "longitude [deg]", "altitude [m]")]
    + [f"GNSS1::VelNed::{a} [m/s]" for a in "NED"]
    + [f"GNSS1::PosU::{a} [m]" for a in "NED"]
    + ["GNSS1::VelU [m/s]"],
}


@pytest.mark.parametrize(("style", "kind"), VN_NAMES)
def test_vectornav_parked(tmp_path, style, kind):
    """Fixes from the second second on, those before in two dimensions; each 50 ms before the row
    that brings it.
    """
    path = vectornav(tmp_path / "log.csv", style=style, kind=kind, week_from=500)
    given = {k: v for k, v in PLACELESS.items() if k == "imu_serial"}
    made = convert_log(path, {}, given)
    check_parked(made.run, OUT)
    assert made.record.format == "vectornav"
    assert made.run.header.start_utc == "2026-01-06T07:33:01.990Z"
    gnss = made.run.gnss
    np.testing.assert_allclose(gnss.time_s, 0.01 + 0.2 * np.arange(5, 50) - 0.05, atol=1e-6)
    np.testing.assert_allclose(gnss.v_n_m_s, np.tile([1.0, 2.0, -0.5], (45, 1)))
    np.testing.assert_allclose(gnss.sigma_horizontal_m, 0.5 / np.sqrt(2))
    np.testing.assert_allclose(gnss.sigma_velocity_m_s, 0.05)
    np.testing.assert_array_equal(gnss.fix_type, FixType.SINGLE)
    assert made.run.header.site.height_m == pytest.approx(HEIGHT_M)
    assert made.run.header.gyro_technology == "mems"


def test_vectornav_turns_right_with_fixes_in_a_file_of_their_own(tmp_path):
    vectornav(tmp_path / "gnss.csv")
    path = vectornav(tmp_path / "log.csv", parked_and_turned(dt=0.05, start_s=100.0), fixes=False)
    made = convert_log(path, {"gnss": {"file": "gnss.csv"}}, GIVEN)
    check_right_turn(made.run)
    assert made.run.gnss.time_s.size == 45 and made.record.other_sources[0].source == "gnss.csv"


def test_vectornav_takes_raw_values_and_the_units_solution_as_reference_alone(tmp_path):
    made = convert_log(vectornav(tmp_path / "log.csv", solution=True), {}, GIVEN)
    check_parked(made.run, OUT)
    np.testing.assert_allclose(made.run.gnss.v_n_m_s[0], [1.0, 2.0, -0.5])
    truth = made.reference
    angles = np.degrees([truth.roll_rad[5], truth.pitch_rad[5], truth.heading_rad[5]])
    np.testing.assert_allclose(angles, [ROLL_DEG, PITCH_DEG, HEADING_DEG])
    np.testing.assert_allclose(truth.v_n_m_s[5], [1.0, 2.0, -0.5])
    assert np.degrees(truth.lat_rad[5]) == pytest.approx(LAT_DEG)
    assert truth.height_m[5] == HEIGHT_M
