"""ArduPilot logs of every form, written by hand in ardupilot_logs.py: one parked unit, whole, cut
off and garbled.
"""

import numpy as np
import pytest
from scipy.io import savemat

from ins.records import FixType, InputError
from ins.units import DEG
from tests.trajectories.readers import ardupilot_logs as logs
from tests.trajectories.run_cases import F_B
from trajectories.readers.containers.dataflash import read_tables
from trajectories.readers.conversion import convert_log
from trajectories.readers.formats.ardupilot import fixes

DT_S = 0.02

pytestmark = pytest.mark.usefixtures("forked")


@pytest.fixture
def old(tmp_path):
    return logs.write(tmp_path / "flight.bin", logs.old_messages())


def check_parked(run, *, w=logs.W, decimals: float = 1e-6):
    """Rates, forces, place and velocities of the parked unit."""
    np.testing.assert_allclose(run.imu.dtheta_rad / DT_S, np.tile(w, (logs.ROWS, 1)), rtol=1e-6)
    np.testing.assert_allclose(
        run.imu.dv_m_s / DT_S, np.tile(F_B, (logs.ROWS, 1)), rtol=1e-6, atol=decimals
    )
    assert run.header.gyro_technology == "mems"
    assert run.header.site.lat_rad == pytest.approx(logs.LAT_DEG * DEG, abs=1e-9)
    assert run.header.site.lon_rad == pytest.approx(logs.LON_DEG * DEG, abs=1e-9)
    assert run.header.site.height_m == pytest.approx(logs.HEIGHT_M, abs=1e-6)
    np.testing.assert_allclose(
        run.gnss.v_n_m_s, np.tile([0.0, 2.0, -0.5], (run.gnss.time_s.size, 1)), atol=1e-12
    )
    assert run.gnss.time_s[1] - run.gnss.time_s[0] == pytest.approx(0.2, abs=1e-6)
    assert set(run.gnss.fix_type) <= {FixType.SINGLE, FixType.DIFFERENTIAL}


def test_dataflash_of_old_firmware(old):
    """UTC by hand: week 1871 began on 2015-11-15 00:00:00 GPS; the first row is at 603 920.00 s,
    its interval before.
    """
    made = convert_log(old, {}, {})
    check_parked(made.run)
    assert made.record.format == "dataflash"
    assert made.run.header.run_id == "flight-imu1"
    assert made.run.header.imu_serial == "PX4v2-0033003E3431471231373638-imu1"
    assert made.run.header.start_utc == "2015-11-21T23:45:02.980Z"
    assert made.record.time_shift_s == pytest.approx(19.98)
    assert made.run.gnss.time_s[0] == pytest.approx(5 * DT_S + DT_S, abs=1e-9)
    assert made.run.faults == ()


def test_the_second_imu_and_its_temperature(old):
    made = convert_log(old, {"imu": 2}, {})
    check_parked(made.run, w=2 * logs.W)
    assert (made.run.header.run_id, made.run.header.imu_serial[-5:]) == ("flight-imu2", "-imu2")
    T = made.run.temperature
    np.testing.assert_allclose(T.gyro_degC[:, 0], 40.0 + (T.time_s - DT_S) / DT_S / 500, atol=1e-4)
    np.testing.assert_array_equal(T.gyro_degC[:, 0], T.gyro_degC[:, 2])
    assert any("INS_GYR2OFFS_X Y Z = +0.001000" in n for n in made.record.notes)


def test_gyro_offsets_added_back(old):
    assert convert_log(old, {"imu": 2}, {}).run.header.level_removed
    assert not convert_log(old, {}, {}).run.header.level_removed
    made = convert_log(old, {"imu": 2, "gyro_offsets": "add_back"}, {})
    assert not made.run.header.level_removed
    check_parked(made.run, w=2 * logs.W + [0.001, 0.002, 0.003])
    with pytest.raises(InputError, match=r"gyro_offsets: .* INS_GYROFFS_X Y Z"):
        convert_log(old, {"gyro_offsets": "add_back"}, {})


def test_a_log_compensated_in_flight_is_refused(tmp_path):
    """What the autopilot took out would be learnt as if the unit had no bias there (PX4 PR 20660
    and 21073 were such).
    """
    switch = logs.message(logs.OLD["PARM"], "INS_TCAL2_ENABLE", 1.0)
    log = logs.write(tmp_path / "flight.bin", [*logs.old_messages(), switch])
    with pytest.raises(InputError, match="IMU2: INS_TCAL2_ENABLE is 1"):
        convert_log(log, {"imu": 2}, {})
    assert convert_log(log, {"imu": 1}, {}).run.header.applied_table_sha256 is None
    told = convert_log(log, {"imu": 2, "run": {"applied_table_sha256": "a" * 64}}, {})
    assert told.run.header.applied_table_sha256 == "a" * 64


def test_dataflash_of_new_firmware(tmp_path):
    """Us, instances, no fix at first, accuracy from GPA (its columns are in hundredths)."""
    made = convert_log(logs.write(tmp_path / "new.bin", logs.new_messages()), {"imu": 2}, {})
    check_parked(made.run, w=2 * logs.W)
    assert made.run.header.imu_serial == "new-imu2"
    assert made.run.gnss.time_s.size == 40
    assert any("GPS rows 1-10 left out: no 3D fix" in n for n in made.record.notes)
    assert made.run.gnss.sigma_horizontal_m[0] == pytest.approx(1.5)
    assert made.run.gnss.sigma_vertical_m[0] == pytest.approx(2.5)
    assert made.run.gnss.sigma_velocity_m_s[0] == pytest.approx(0.3)
    np.testing.assert_allclose(made.run.temperature.gyro_degC, 30.5)
    assert made.run.header.start_utc == "2015-11-21T23:45:02.980Z"


def test_text_form(tmp_path):
    made = convert_log(logs.write_text(tmp_path / "flight.log"), {}, {})
    check_parked(made.run, decimals=1e-6)
    assert made.record.format == "dataflash_text"
    np.testing.assert_allclose(made.run.temperature.gyro_degC[0], 30.0 + 24.5 / 500, atol=1e-3)


@pytest.mark.parametrize("suffix", ["", "_0"])
@pytest.mark.parametrize("compress", [True, False])
def test_matlab_form(tmp_path, suffix, compress):
    path = tmp_path / "flight.mat"
    savemat(path, logs.mat_variables(suffix=suffix), do_compression=compress)
    made = convert_log(path, {}, {})
    check_parked(made.run)
    assert made.record.format == "ardupilot_mat"
    assert made.run.temperature is None  # it has no such column
    assert made.run.header.start_utc == "2015-11-21T23:45:02.980Z"


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"imu": 3}, r"flight\.bin: no IMU 3, has 1, 2 \(--imu\)"),
        ({"imu": 0}, r"map: imu: got 0, needed at least 1"),
        ({"column": 1}, r"map: unknown key column"),
        ({"gyro_offsets": "raw"}, r"map: gyro_offsets: got \"raw\""),
    ],
)
def test_wrong_options_are_named(old, options, line):
    with pytest.raises(InputError, match=line):
        convert_log(old, options, {})


def test_a_log_without_gps_needs_the_site(tmp_path):
    messages = [m for m in logs.old_messages() if m[2] != logs.OLD["GPS"][0]]
    path = logs.write(tmp_path / "log.bin", messages)
    with pytest.raises(InputError, match=r"start_utc .*lat_deg \(--lat-deg\)"):
        convert_log(path, {}, {})
    site = {
        "lat_deg": -35.0,
        "lon_deg": 149.0,
        "height_m": 500.0,
        "start_utc": "2015-11-22T00:00:00Z",
    }
    assert convert_log(path, {}, site).run.gnss is None


# Damage


@pytest.mark.parametrize("lost", [1, 20, 42])
def test_cut_off_within_a_message(tmp_path, lost):
    """The last message ends early: dropped, the place named, all before it kept."""
    whole = b"".join(m for m in logs.old_messages() if m[2] != logs.OLD["GPS"][0])
    path = tmp_path / "cut.bin"
    path.write_bytes(whole[:-lost])
    tables, notes = read_tables(path, {"IMU", "IMU2"})
    assert tables["IMU"]["TimeMS"].size == logs.ROWS
    assert tables["IMU2"]["TimeMS"].size == logs.ROWS - 1
    length = len(logs.old_messages()[-1])
    start = len(whole) - length
    assert notes == [
        f"cut.bin: ends within a message, the last {length - lost} bytes (from byte {start})"
        " dropped"
    ]


@pytest.mark.parametrize("damage", ["bytes lost", "bytes added", "head garbled", "block of zeros"])
def test_damage_within_is_read_around(tmp_path, damage):
    """At most three messages are lost, no garbled row passes, and the place is named."""
    messages = [m for m in logs.old_messages() if m[2] != logs.OLD["GPS"][0]]
    k = len(messages) - 401
    at = sum(map(len, messages[:k]))
    data = b"".join(messages)
    data = {
        "bytes lost": data[: at + 10] + data[at + 17 :],
        "bytes added": data[: at + 10] + b"\x07" * 9 + data[at + 10 :],
        "head garbled": data[:at] + b"\x00" + data[at + 1 :],
        "block of zeros": data[: at + 5] + bytes(60) + data[at + 65 :],
    }[damage]
    path = tmp_path / "hit.bin"
    path.write_bytes(data)
    tables, notes = read_tables(path, {"IMU", "IMU2"})
    for number, name in ((1, "IMU"), (2, "IMU2")):
        assert logs.ROWS - 2 <= tables[name]["TimeMS"].size <= logs.ROWS
        np.testing.assert_allclose(tables[name]["GyrZ"], number * logs.W[2], rtol=1e-6)
        assert np.all(np.diff(tables[name]["TimeMS"]) > 0)
    assert len(notes) == 1 and "damaged, skipped: bytes " in notes[0]
    first = int(notes[0].split("skipped: bytes ")[1].split("-")[0])
    assert at - 50 <= first <= at


# Units


def log_that_declares(tmp_path, *, gyro: str, accel: str):
    """The new log with FMTU and UNIT as 4.x firmware writes them; its values are as ever."""
    forms = {
        "FMTU": (136, "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
        "UNIT": (137, "QbZ", "TimeUS,Id,Label"),
    }
    extra = [
        logs.fmt(kind, name, letters, columns) for name, (kind, letters, columns) in forms.items()
    ]
    extra += [
        logs.message(forms["UNIT"], 0, ord(k), text)
        for k, text in (("E", gyro), ("o", accel), ("O", "degC"))
    ]
    extra.append(
        logs.message(forms["FMTU"], 0, logs.NEW["IMU"][0], "s#EEEooo--O--ZZ", "F-000000-------")
    )
    return logs.write(
        tmp_path / "new.bin", logs.new_messages()[:6] + extra + logs.new_messages()[6:]
    )


def test_declared_units_are_used(tmp_path):
    check_parked(convert_log(log_that_declares(tmp_path, gyro="rad/s", accel="m/s/s"), {}, {}).run)
    turned = convert_log(log_that_declares(tmp_path, gyro="deg/s", accel="m/s/s"), {}, {}).run
    np.testing.assert_allclose(
        turned.imu.dtheta_rad / DT_S, np.tile(logs.W * np.pi / 180, (logs.ROWS, 1)), rtol=1e-6
    )


@pytest.mark.parametrize(("first", "taken"), [(3.0, 47.0), (1.0, 48.0)])
def test_one_receiver_of_two(first, taken):
    """The first, unless it never has a 3D fix; never both."""
    k = np.arange(20.0)
    number = np.arange(20) % 2 * 1.0
    table = {
        "TimeUS": 1e5 * k,
        "I": number,
        "Status": np.where(number == 0, first, 4.0),
        "Lat": 47.0 + number,
        "Lng": 8.0 + 0 * k,
        "Alt": 500.0 + 0 * k,
        "Spd": 1.0 + 0 * k,
        "GCrs": 0 * k,
        "VZ": 0 * k,
    }
    found, notes = fixes({"GPS": table}, label="log")
    assert found.gnss.time_s.size == 10
    np.testing.assert_allclose(np.degrees(found.gnss.lat_rad), taken)
    assert ("log: GPS 1 taken: the first has no 3D fix" in notes) == (first < 3)
