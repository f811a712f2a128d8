"""NaveGo logs by hand, structs as in its navego_example_synth.m: SI units, radians, forward, right,
down.
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
    check_parked,
    parked,
)
from trajectories.readers.conversion import convert_log

pytestmark = pytest.mark.usefixtures("forked")
OUT = parked()


def imu(output: Output = OUT, **changes) -> dict:
    return {
        "t": output.time_s[:, None],
        "fb": output.dv / 0.01,
        "wb": output.dtheta / 0.01,
        "freq": 100.0,
        "arw": np.full((1, 3), 1e-5),
        "ini_align": np.zeros((1, 3)),
        **changes,
    }


def gnss(**changes) -> dict:
    n = 60
    one = np.ones((n, 1))
    return {
        "t": np.arange(1.0, n + 1)[:, None],
        "lat": np.radians(LAT_DEG) * one,
        "lon": np.radians(LON_DEG) * one,
        "h": HEIGHT_M * one,
        "vel": np.tile([1.0, 2.0, -0.5], (n, 1)),
        "stdm": np.array([[3.0, 4.0, 10.0]]),
        "stdv": np.full((1, 3), 0.1),
        "larm": np.array([[0.5], [-0.25], [-1.0]]),
        "freq": 1.0,
        **changes,
    }


def ref() -> dict:
    one = np.ones((OUT.rows, 1))
    angles = {
        k: np.radians(v) * one
        for k, v in (("roll", ROLL_DEG), ("pitch", PITCH_DEG), ("yaw", HEADING_DEG - 360))
    }
    place = {
        "lat": np.radians(LAT_DEG) * one,
        "lon": np.radians(LON_DEG) * one,
        "h": HEIGHT_M * one,
    }
    return {
        "t": OUT.time_s[:, None],
        **place,
        "vel": np.zeros((OUT.rows, 3)),
        **angles,
        "DCMnb": np.zeros((OUT.rows, 9)),
    }


def write(path, **variables):
    savemat(path, variables, do_compression=True)
    return path


def test_imu_receiver_and_reference(tmp_path):
    made = convert_log(
        write(tmp_path / "log.mat", imu1=imu(), gnss=gnss(), ref=ref()), {}, PLACELESS
    )
    check_parked(made.run, OUT)
    assert made.record.format == "navego"
    fixes = made.run.gnss
    assert np.degrees(fixes.lat_rad[0]) == pytest.approx(LAT_DEG) and fixes.time_s.size == 60
    np.testing.assert_allclose(fixes.v_n_m_s, np.tile([1.0, 2.0, -0.5], (60, 1)))
    np.testing.assert_allclose(fixes.sigma_horizontal_m, 5 / np.sqrt(2))
    np.testing.assert_allclose(fixes.sigma_vertical_m, 10.0)
    np.testing.assert_allclose(fixes.sigma_velocity_m_s, 0.1)
    assert made.run.header.gnss_lever_arm_m == (0.5, -0.25, -1.0)
    reference = made.reference
    angles = np.degrees([reference.roll_rad[3], reference.pitch_rad[3], reference.heading_rad[3]])
    np.testing.assert_allclose(angles, [ROLL_DEG, PITCH_DEG, HEADING_DEG])


def test_several_imus_and_a_receiver_of_another_file(tmp_path):
    """As NaveGo saves them: imu1.mat, imu2.mat, gnss.mat; a solution in between is no receiver."""
    upside = imu(fb=-OUT.dv / 0.01)
    write(
        tmp_path / "imus.mat",
        imu1=upside,
        imu2=imu(),
        nav1_e={**ref(), "vel": np.zeros((OUT.rows, 3))},
    )
    write(tmp_path / "gnss.mat", gnss=gnss())
    made = convert_log(tmp_path / "imus.mat", {"imu": 2, "gnss": {"file": "gnss.mat"}}, PLACELESS)
    check_parked(made.run, OUT)
    assert made.run.header.run_id == "imus-imu2" and made.run.gnss.time_s.size == 60
    assert made.reference is None
    with pytest.raises(InputError, match=r"mean f at rest is \+9\.\d+ m/s2 on z"):
        convert_log(tmp_path / "imus.mat", {}, GIVEN)
    made = convert_log(tmp_path / "imus.mat", {"imu": 2}, GIVEN)
    assert made.run.gnss is None
    assert "no gnss struct" in str(made.record.notes)


@pytest.mark.parametrize(
    ("variables", "options", "line"),
    [
        ({"imu": imu(wb=np.degrees(OUT.dtheta) / 0.01)}, {}, r"deg/s\? multiply by pi/180"),
        ({"imu": imu(fb=OUT.dv / 0.01 / 9.80665)}, {}, r"0\.9989 m/s2, needed 9\.8"),
        ({"imu": imu(fb=OUT.dv.T)}, {}, r"log\.mat: imu\.fb 3x6000, needed 3 columns"),
        ({"imu": imu(t=OUT.time_s[:50, None])}, {}, "t has 50 rows, wb 6000"),
        ({"imu": imu(), "gnss": gnss(lat=np.full((60, 1), LAT_DEG))}, {}, r"gnss\.lat up to 34"),
        ({"imu": imu()}, {"imu": 2}, r"log\.mat: no IMU 2 \(--imu\), has imu"),
        ({"nav": ref()}, {"format": "navego"}, r"no IMU 1 \(--imu\)"),
        ({"imu": imu()}, {"gnss": {"file": "log.mat"}}, "no struct with t, lat, lon, h"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, variables, options, line):
    with pytest.raises(InputError, match=line):
        convert_log(write(tmp_path / "log.mat", **variables), options, GIVEN)
