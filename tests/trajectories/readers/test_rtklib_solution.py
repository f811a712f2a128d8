"""Solution files of RTKLIB written by hand as its manual lays them out, beside a KF-GINS log and
beside a map.
"""

import datetime

import numpy as np
import pytest

from ins.records import FixType, InputError
from tests.trajectories.readers.known_motion import GIVEN, HEIGHT_M, LAT_DEG, LON_DEG, parked
from tests.trajectories.readers.test_kfgins import SOW, write_imu
from trajectories.readers.conversion import convert_log

WEEK = 2017  # 2018-09-02 on; 18 leap seconds then
EPOCH = datetime.datetime(1980, 1, 6)
KIND = "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,4:dgps,5:single,ns=# of satellites)"
NAMES = (
    "latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m)"
    " age(s) ratio"
)
SPEED = " vn(m/s) ve(m/s) vu(m/s) sdvn sdve sdvu sdvne sdveu sdvun"
SECONDS = 60
LEAP_S = 18
KNOWN = {key: value for key, value in GIVEN.items() if key not in ("site", "start_utc")}


def write(path, *, clock="GPST", stamp="date", between=" ", speed=True, kind=KIND, names=NAMES):
    """A solution that climbs at 0.5 m/s, one row a second; the third has no solution."""
    lines = ["% program   : by hand", kind, f"%  {clock}  {names}{SPEED if speed else ''}"]
    for k in range(SECONDS):
        tow = SOW + k - (LEAP_S if clock == "UTC" else 0)
        at = EPOCH + datetime.timedelta(weeks=WEEK, seconds=tow)
        time = f"{at:%Y/%m/%d %H:%M:%S}.000" if stamp == "date" else f"{WEEK}{between}{tow:.3f}"
        quality = 0 if k == 2 else 1 + k % 2
        place = [f"{LAT_DEG:.9f}", f"{LON_DEG:.9f}", f"{HEIGHT_M + 0.5 * k:.4f}"]
        rest = [quality, 9, 0.03, 0.05, 0.11, 0, 0, 0, 0.0, 3.5]
        moving = [0.0, 0.0, 0.5, 0.04, 0.04, 0.04, 0, 0, 0] if speed else []
        lines.append(between.join([time, *place, *map(str, [*rest, *moving])]))
    path.write_text("\n".join(lines) + "\n")
    return path


def convert_kfgins(tmp_path, solution):
    imu = write_imu(tmp_path / "imu.txt")
    return convert_log(imu, {"gnss": {"file": solution.name}}, {**KNOWN, "gyro_technology": "rlg"})


@pytest.mark.parametrize("clock", ["GPST", "UTC"])
@pytest.mark.parametrize("stamp", ["date", "week"])
@pytest.mark.parametrize("between", ["   ", ","])
def test_fixes_beside_a_log_of_seconds_of_the_week(tmp_path, clock, stamp, between):
    made = convert_kfgins(
        tmp_path, write(tmp_path / "a.pos", clock=clock, stamp=stamp, between=between)
    )
    gnss = made.run.gnss
    assert gnss is not None and gnss.time_s.size >= SECONDS - 2
    since = gnss.time_s + made.record.time_shift_s - SOW
    assert np.allclose(since, np.round(since), atol=1e-6) and 2 not in np.round(since)
    assert gnss.height_m == pytest.approx(HEIGHT_M + 0.5 * since, abs=1e-4)
    assert gnss.v_n_m_s[:, 2] == pytest.approx(-0.5)
    assert gnss.sigma_horizontal_m == pytest.approx(np.hypot(0.03, 0.05) / np.sqrt(2.0))
    assert gnss.sigma_velocity_m_s == pytest.approx(0.04)
    even = np.round(since).astype(int) % 2 == 0
    np.testing.assert_array_equal(gnss.fix_type, np.where(even, FixType.FIXED, FixType.FLOAT))
    utc = EPOCH + datetime.timedelta(weeks=WEEK, seconds=made.record.time_shift_s - LEAP_S)
    told = datetime.datetime.fromisoformat(made.run.header.start_utc.replace("Z", ""))
    assert abs((told - utc).total_seconds()) < 1e-3


def test_without_velocities_they_are_differences(tmp_path):
    made = convert_kfgins(tmp_path, write(tmp_path / "a.pos", speed=False))
    assert made.run.gnss.v_n_m_s[5:-5, 2] == pytest.approx(-0.5, abs=1e-3)


def mapped(tmp_path, *, epoch, first_s):
    """The same parked unit as separated values, on a clock with this epoch."""
    out = parked(start_s=0.0)
    rows = np.column_stack([out.time_s + first_s, out.dtheta, out.dv])
    np.savetxt(
        tmp_path / "log.csv", rows, delimiter=",", header="t,a,b,c,d,e,f", comments="", fmt="%.12e"
    )
    time = {"column": "t", **({"epoch": epoch} if epoch else {})}
    return {
        "time": time,
        "gyro": {"columns": ["a", "b", "c"], "unit": "rad"},
        "accel": {"columns": ["d", "e", "f"], "unit": "m/s"},
        "gnss": {"file": "a.pos"},
    }


@pytest.mark.parametrize("epoch", ["gps", "unix"])
def test_fixes_beside_a_map_with_a_dated_clock(tmp_path, epoch):
    write(tmp_path / "a.pos")
    gps_s = WEEK * 604_800.0 + SOW
    unix_s = gps_s + 315_964_800.0 - LEAP_S
    options = mapped(tmp_path, epoch=epoch, first_s=gps_s if epoch == "gps" else unix_s)
    made = convert_log(tmp_path / "log.csv", options, KNOWN)
    since = made.run.gnss.time_s + made.record.time_shift_s - (gps_s if epoch == "gps" else unix_s)
    assert made.run.gnss.height_m == pytest.approx(HEIGHT_M + 0.5 * since, abs=1e-3)
    assert made.run.header.site.height_m == pytest.approx(HEIGHT_M, abs=1.0)


@pytest.mark.parametrize(
    ("how", "needed"),
    [
        ({"clock": "JST"}, "times are JST, needed GPST or UTC"),
        ({"names": NAMES.replace("latitude(deg)", "latitude(d'\")")}, "needed degrees"),
        ({"names": NAMES.replace("latitude(deg)", "x-ecef(m)")}, "out-solformat llh"),
    ],
)
def test_what_is_written_otherwise_is_refused(tmp_path, how, needed):
    with pytest.raises(InputError, match=needed):
        convert_kfgins(tmp_path, write(tmp_path / "a.pos", **how))


def test_a_clock_without_a_date_is_refused(tmp_path):
    write(tmp_path / "a.pos")
    options = mapped(tmp_path, epoch=None, first_s=0.0)
    with pytest.raises(InputError, match=r"a\.pos: its fixes have dates, needed epoch"):
        convert_log(tmp_path / "log.csv", options, KNOWN)


def test_heights_above_the_geoid_are_told(tmp_path):
    solution = write(tmp_path / "a.pos", kind=KIND.replace("ellipsoidal", "geodetic"))
    notes = convert_kfgins(tmp_path, solution).record.notes
    assert any("heights are above the geoid" in note for note in notes)


@pytest.mark.parametrize(("good", "bad"), [(f"{LAT_DEG:.9f}", "north"), ("2018/", "20x8/")])
def test_a_row_that_is_none_is_left_out_and_told(tmp_path, good, bad):
    solution = write(tmp_path / "a.pos")
    text = solution.read_text().splitlines()
    text[20] = text[20].replace(good, bad)
    solution.write_text("\n".join(text) + "\n")
    made = convert_kfgins(tmp_path, solution)
    assert 17 not in np.round(made.run.gnss.time_s + made.record.time_shift_s - SOW)
    assert any("line 21" in note for note in made.record.notes)
