"""Each map of examples/maps on a log written as its remarks say: no option is needed, gravity and
Earth rate come out.
"""

import gzip

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from ins.json_file import read_toml
from tests.recal.test_convert import MAPS
from tests.trajectories.readers import test_kfgins, test_navego, test_novatel, test_psins
from tests.trajectories.readers.known_motion import HEIGHT_M, LAT_DEG, LON_DEG, at_rest, parked
from trajectories.readers.conversion import convert_log

DEG_H, MG = np.pi / 180 / 3600, 9.80665e-3
UNIX_S = 1_772_341_200.0  # 2026-03-01T05:00:00Z
# logs of ../shared/data, tested in tests/recal/test_convert.py
REAL = ("calgary_project_data", "x_LN100_up", "x_adi_up")


def recorder_csv(folder):
    out, (w, f) = parked(), (v / 0.01 for v in parked().rfu())
    remark = "# a recorder, seen to start\n"
    rows = []
    for k, (t, a, b) in enumerate(zip(out.time_s, w, f)):
        readings = ";".join(f"{v:.9g}" for v in (*a / DEG_H, *b / MG))
        oven = "" if k % 100 else "68.0"
        rows.append(f"{1e3 * (UNIX_S + t):.0f};{readings};{oven};ok")
    names = "utc_ms;wx;wy;wz;ax;ay;az;oven;state\nms;deg/h;deg/h;deg/h;mg;mg;mg;degF;-\n"
    (folder / "log.csv.gz").write_bytes(
        gzip.compress((remark + names + remark + "\n".join(rows) + "\n").encode())
    )
    fixes = [
        f"{1e3 * (UNIX_S + k):.0f},{LAT_DEG},{LON_DEG},{HEIGHT_M},0.4,0.8,1.0,2.0,0.5,"
        f"{3 if k > 5 else 0}"
        for k in range(1, 60)
    ]
    (folder / "recorder_gps.csv").write_text(
        "\n".join(["utc_ms,lat,lon,h,sh,sv,ve,vn,vu,quality", *fixes]) + "\n"
    )
    return folder / "log.csv.gz", out


def check_recorder_csv(made):
    np.testing.assert_allclose(made.run.temperature.gyro_degC, 20.0)
    np.testing.assert_allclose(made.run.gnss.v_n_m_s, np.tile([2.0, 1.0, -0.5], (54, 1)))
    assert made.run.header.start_utc == "2026-03-01T05:00:00.000Z"


def recorder_parquet(folder):
    out = parked()
    flu = np.array([1.0, -1.0, -1.0])
    w, f = out.dtheta / 0.01 * flu, out.dv / 0.01 / 9.80665 * flu
    n = out.rows

    def record(v):
        return pa.StructArray.from_arrays([pa.array(v[:, k]) for k in range(3)], ["x", "y", "z"])

    fixes = {
        "lat": np.radians(LAT_DEG + 1e-6 * np.arange(60.0)),
        "lon": np.radians(LON_DEG),
        "alt": HEIGHT_M,
        "sn": 0.3,
        "se": 0.4,
        "sd": 0.9,
        "sigma_v": 0.02,
        "vn": 0.1,
        "ve": 0.0,
        "vd": 0.0,
    }
    pq.write_table(
        pa.table(
            {
                "t_us": np.round(out.time_s * 1e6).astype(np.int64),
                "gyro": record(w),
                "accel": record(f),
                "temp": record(np.tile([20.0, 21.0, 22.0], (n, 1))),
                "wheel": np.full(n, 36.0),
                **{name: np.repeat(values * np.ones(60), 100) for name, values in fixes.items()},
            }
        ),
        folder / "log.parquet",
    )
    return folder / "log.parquet", out


def check_recorder_parquet(made):
    assert made.run.gnss.time_s.size == 60
    np.testing.assert_allclose(made.run.gnss.sigma_horizontal_m, 0.5 / np.sqrt(2))
    np.testing.assert_allclose(made.run.gnss.sigma_velocity_m_s, 0.02)
    np.testing.assert_allclose(made.run.temperature.gyro_degC[3], [20.0, 21.0, 22.0])
    np.testing.assert_allclose(made.run.odometer.speed_m_s, 10.0)


def matlab_struct(folder):
    out = parked()
    w, f = out.rfu()
    oven = {"t": np.arange(1.0, 60.0)[:, None], "T": np.tile([293.15, 294.15, 295.15], (59, 1))}
    savemat(
        folder / "matlab_struct.mat",
        {"log": {"t": out.time_s[:, None], "inc": np.hstack([w / DEG_H, f])}, "oven": oven},
    )
    return folder / "matlab_struct.mat", out


def check_matlab_struct(made):
    """Raw axes are right, forward, up: body x is the second thermometer."""
    np.testing.assert_allclose(made.run.temperature.gyro_degC[3], [21.0, 20.0, 22.0])


def kfgins(folder):
    out = parked(start_s=test_kfgins.SOW)
    test_kfgins.write_gnss(folder / "GNSS-RTK.txt")
    t = test_kfgins.SOW + np.arange(0.0, 60.0)
    truth = np.tile([LAT_DEG, LON_DEG, HEIGHT_M, 0, 0, 0, 3, -2, 40], (60, 1))
    np.savetxt(folder / "truth.nav", np.column_stack([np.full(60, 2017), t, truth]), fmt="%.9f")
    return test_kfgins.write_imu(folder / "imu.txt", out), out


def check_kfgins(made):
    assert made.run.gnss.time_s.size == 60 and made.reference is not None
    assert made.run.header.gnss_lever_arm_m == (-0.073, 0.302, 0.087)


def novatel(folder):
    out = parked(dt=0.005, start_s=test_novatel.SECONDS)
    return test_novatel.write(folder / "span.log", test_novatel.raw_lines(out, kind="RAWIMUS")), out


def psins(folder):
    np.savetxt(folder / "gps.txt", test_psins.gps_rows(), fmt="%.12e")
    return test_psins.text_file(folder / "imu.txt"), test_psins.OUT


def navego(folder):
    upside = test_navego.imu(fb=-test_navego.OUT.dv / 0.01)
    test_navego.write(folder / "navego_gnss.mat", gnss=test_navego.gnss())
    return (
        test_navego.write(folder / "imus.mat", imu1=upside, imu2=test_navego.imu()),
        test_navego.OUT,
    )


GPS_START_S = 2408 * 604_800.0 + 18.0  # 2026-03-01T00:00:00Z: week 2408, 18 leap seconds


def imar_text(folder):
    """Fixes every second; week included in the seconds, 5 h after the week began."""
    out = parked()
    w, f = np.degrees(out.dtheta / 0.01), out.dv / 0.01
    rows = []
    for k, (t, a, b) in enumerate(zip(out.time_s, w, f)):
        fix = f"{LAT_DEG};{LON_DEG};{HEIGHT_M};1.0;2.0;-0.5" if k % 100 == 0 else ";;;;;"
        readings = ";".join(f"{v:.12g}" for v in (*a, *b))
        rows.append(f"{GPS_START_S + 18_000 + t:.6f};{readings};31.0;{fix}")
    (folder / "inav.txt").write_text("# a remark\n" + "\n".join(rows) + "\n")
    return folder / "inav.txt", out


def check_imar_text(made):
    assert made.run.gnss.time_s.size == 60
    assert made.run.header.start_utc == "2026-03-01T05:00:00.000Z"
    np.testing.assert_allclose(made.run.temperature.gyro_degC, 31.0)


def applanix_text(folder):
    out = parked(start_s=18_000.0)
    table = np.column_stack([out.time_s, out.dv, out.dtheta])
    np.savetxt(folder / "imu.txt", table, fmt="%.12e", header="time dv dtheta", comments="")
    return folder / "imu.txt", out


WRITERS = {
    f.__name__: f
    for f in (
        recorder_csv,
        recorder_parquet,
        matlab_struct,
        kfgins,
        novatel,
        psins,
        navego,
        imar_text,
        applanix_text,
    )
}
MORE = {
    f.__name__.removeprefix("check_"): f
    for f in (
        check_recorder_csv,
        check_recorder_parquet,
        check_matlab_struct,
        check_kfgins,
        check_imar_text,
    )
}


def test_every_map_is_tested():
    assert {p.stem for p in MAPS.glob("*.toml")} == {*WRITERS, *REAL}


@pytest.mark.parametrize("name", WRITERS)
def test_a_map_does_what_it_says(tmp_path, name):
    log, out = WRITERS[name](tmp_path)
    made = convert_log(log, read_toml(MAPS / f"{name}.toml"), {})
    w, f = at_rest()
    span = made.run.imu.dt_s.sum()
    assert made.run.imu.rows == out.rows
    np.testing.assert_allclose(made.run.imu.dtheta_rad.sum(axis=0) / span, w, atol=1e-8)
    np.testing.assert_allclose(made.run.imu.dv_m_s.sum(axis=0) / span, f, atol=1e-4)
    if name in MORE:
        MORE[name](made)
