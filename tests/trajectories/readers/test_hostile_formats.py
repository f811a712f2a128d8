"""What goes wrong in logs of one maker: weeks that are not known, sensors of two rates, packets
lost or doubled, wraps.
"""

import gzip
import struct

import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.readers import ardupilot_logs as ap
from tests.trajectories.readers import test_kfgins, test_novatel, test_psins, test_px4
from tests.trajectories.readers.known_motion import (
    GIVEN,
    LAT_DEG,
    LON_DEG,
    PLACELESS,
    Output,
    parked,
)
from trajectories.readers.conversion import convert_log

ROWS = 2000


def px4_messages() -> tuple[bytes, list[tuple[tuple[str, int], bytes]]]:
    """The head of a log, and each message with its topic and instance."""
    head, *rest = test_px4.ulog(rows=ROWS)
    return head, [(test_px4.IDS[struct.unpack("<H", message[3:5])[0]], message) for message in rest]


def px4(path, messages, options=None):
    head, _ = px4_messages()
    return convert_log(test_px4.write(path / "flight.ulg", [head, *messages]), options or {}, {})


def test_px4_with_a_slow_accelerometer(tmp_path):
    """Raw rows of 100 and 25 Hz do not belong together: the increments that PX4 made of them do."""
    every: dict[tuple[str, int], int] = {}
    kept = []
    for topic, message in px4_messages()[1]:
        every[topic] = every.get(topic, 0) + 1
        if topic[0] != "sensor_accel" or every[topic] % 4 == 1:
            kept.append(message)
    made = px4(tmp_path, kept)
    assert made.run.imu.rows == ROWS
    assert any("vehicle_imu 1: rates are less" in note for note in made.record.notes)
    with pytest.raises(InputError, match="sensor_gyro 1: 100 Hz, sensor_accel 25 Hz"):
        px4(tmp_path, kept, {"topic": "sensor_gyro"})


def changed(messages: list[bytes], name: str, change) -> list[bytes]:
    """The old ArduPilot messages of a name with other values."""
    kind, letters, _ = ap.OLD[name]
    form = struct.Struct("<" + "".join(ap.LETTERS[c] for c in letters))
    return [
        (
            m[:3] + form.pack(*change(list(form.unpack(m[3:]))))
            if m[:3] == ap.HEAD + bytes([kind])
            else m
        )
        for m in messages
    ]


def ardupilot(path, messages, given=None):
    return convert_log(ap.write(path / "flight.bin", messages), {}, given or {})


def test_ardupilot_over_the_wrap_of_its_milliseconds(tmp_path):
    """IMU and GPS alike: the same run as without."""
    plain = ap.old_messages(rows=ROWS)
    shift = 2**32 - 20_000
    wrapped = changed(plain, "IMU", lambda v: [(v[0] + shift) % 2**32, *v[1:]])
    wrapped = changed(wrapped, "GPS", lambda v: [*v[:-1], (v[-1] + shift) % 2**32])
    a, b = ardupilot(tmp_path, plain).run, ardupilot(tmp_path, wrapped).run
    assert a.header.start_utc == b.header.start_utc and a.imu.rows == b.imu.rows == ROWS
    np.testing.assert_allclose(a.gnss.time_s, b.gnss.time_s, atol=1e-6)
    # by whole seconds
    np.testing.assert_allclose(a.temperature.gyro_degC, b.temperature.gyro_degC, atol=0.01)


def test_ardupilot_temperatures_that_are_none(tmp_path):
    for degC, said in (
        (293.0, "Temp is 0 or no temperature in all messages"),
        (0.0, "Temp is 0"),
        (np.nan, "Temp is 0"),
    ):
        made = ardupilot(
            tmp_path, changed(ap.old_messages(rows=200), "IMU", lambda v, t=degC: [*v[:-1], t])
        )
        assert made.run.temperature is None and any(said in note for note in made.record.notes)
    odd = changed(
        ap.old_messages(rows=200), "IMU", lambda v: [*v[:-1], 400.0 if v[0] % 400 == 0 else v[-1]]
    )
    made = ardupilot(tmp_path, odd)
    assert made.run.temperature.gyro_degC.max() < 40
    assert any("temperatures are 400 to 400 degC" in note for note in made.record.notes)


@pytest.mark.parametrize(
    ("letters", "labels"), [("s#FFFooo--O--ZZ", ()), ("s#EEEooo--O--ZZ", (("E", "deg/s"),))]
)
def test_ardupilot_that_declares_its_units_twice(tmp_path, letters, labels):
    """Logs of two firmwares, joined: the second FMTU names another unit, or the second UNIT calls
    the same letter otherwise.
    """
    forms = {
        "FMTU": (136, "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
        "UNIT": (137, "QbZ", "TimeUS,Id,Label"),
    }
    extra = [ap.fmt(kind, name, kinds, columns) for name, (kind, kinds, columns) in forms.items()]
    extra += [
        ap.message(forms["UNIT"], 0, ord(k), text)
        for k, text in (("E", "rad/s"), ("F", "deg/s"), ("o", "m/s/s"), *labels)
    ]
    first = ap.message(forms["FMTU"], 0, ap.NEW["IMU"][0], "s#EEEooo--O--ZZ", "F-000000-------")
    second = ap.message(forms["FMTU"], 0, ap.NEW["IMU"][0], letters, "F-000000-------")
    messages = ap.new_messages(rows=200)
    assert (
        ardupilot(tmp_path, messages[:6] + extra[:5] + [first, first] + messages[6:]).run.imu.rows
        == 200
    )
    with pytest.raises(InputError, match="IMU 1: its units are declared twice"):
        ardupilot(tmp_path, messages[:6] + extra + [first, second] + messages[6:])


def test_texts_of_autopilots_and_receivers_as_editors_save_them(tmp_path):
    """A byte order mark, old line ends, gzip are read; UTF-16 is refused."""
    ap.write_text(tmp_path / "a.log", rows=200)
    test_psins.simu_file(tmp_path / "a.imu", parked(seconds=20.0))
    test_novatel.write(
        tmp_path / "a.asc",
        test_novatel.raw_lines(parked(dt=0.005, start_s=200_000.0, seconds=20.0)),
    )
    for name, rows in (("a.log", 200), ("a.imu", 2000), ("a.asc", 4000)):
        data = (tmp_path / name).read_bytes()
        given = {} if name == "a.log" else GIVEN
        (tmp_path / f"marked-{name}").write_bytes(b"\xef\xbb\xbf" + data)
        (tmp_path / f"{name}.gz").write_bytes(gzip.compress(data))
        for other in (f"marked-{name}", f"{name}.gz"):
            assert convert_log(tmp_path / other, {}, given).run.imu.rows == rows
        (tmp_path / name).write_bytes(data.decode().encode("utf-16"))
        with pytest.raises(InputError, match=rf"{name}: text in UTF-16, needed UTF-8"):
            convert_log(tmp_path / name, {}, given)


OUT = parked(seconds=60.0, start_s=100.0)


def kfgins(path, fixes: list[str], out: Output = OUT, **options):
    test_kfgins.write_imu(path / "imu.txt", out)
    (path / "gnss.txt").write_text("\n".join(fixes) + "\n")
    return convert_log(
        path / "imu.txt", {"format": "kfgins", "gnss": {"file": "gnss.txt"}, **options}, PLACELESS
    )


def fix(time_s: float, lat=LAT_DEG, lon=LON_DEG, sigma="0.01") -> str:
    return f"{time_s:.3f} {lat:.9f} {lon:.9f} 380.0 {sigma} {sigma} 0.02"


def test_kfgins_fixes(tmp_path):
    """In the next week; at the origin; in radians; without any sigma."""
    over = Output((OUT.time_s + 604_800 - 130) % 604_800, OUT.dtheta, OUT.dv)
    made = kfgins(tmp_path, [fix(t) for t in np.arange(5.0, 29.0)], over)
    np.testing.assert_allclose(made.run.gnss.time_s, np.arange(35.0, 59.0), atol=1e-6)
    made = kfgins(
        tmp_path, [fix(t, *((0.0, 0.0) if t < 120 else ())) for t in np.arange(101.0, 160.0)]
    )
    assert np.degrees(made.run.header.site.lat_rad) == pytest.approx(LAT_DEG)
    with pytest.raises(InputError, match=r"0.597775 and 1.90066"):
        kfgins(
            tmp_path,
            [fix(t, np.radians(LAT_DEG), np.radians(LON_DEG)) for t in np.arange(101.0, 160.0)],
        )
    with pytest.raises(InputError, match=r"lat_deg .*GPS rows 1-59 left out"):
        kfgins(tmp_path, [fix(t, sigma="nan") for t in np.arange(101.0, 160.0)])
