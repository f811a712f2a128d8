"""Noise models of other programs: units, round trips, bounded reading."""

import json

import pytest
from typer.testing import CliRunner

from ins.records import InputError
from ins.twin_file import default_twin, read_twin, twin_to_dict
from recal.cli.app import app
from simreal.twin.exchange import Dialect, flat_values, kalibr_text, twin_from_text

KALIBR = """#Accelerometers
accelerometer_noise_density: 0.0098  #Noise density (continuous-time)
accelerometer_random_walk:   0.002
gyroscope_noise_density:     2.908882e-04
gyroscope_random_walk:       4.0e-05
rostopic:                    /imu0
update_rate:                 200.0
"""
IMU_UTILS = """%YAML:1.0
---
type: IMU
name: xsens
Gyr:
   unit: " rad/s"
   avg-axis:
      gyr_n: 2.908882e-04
      gyr_w: 3.2192e-05
Acc:
   unit: " m/s^2"
   avg-axis:
      acc_n: 9.80665e-04
      acc_w: 6.5e-04
"""


def test_units_of_each_dialect():
    believed = default_twin("mems")
    kalibr = twin_from_text(KALIBR, Dialect.KALIBR, believed, name="imu.yaml")
    assert kalibr.gyro.arw_deg_sqrt_h == pytest.approx(1.0, rel=1e-6)
    assert kalibr.gyro.turn_on_deg_h == believed.gyro.turn_on_deg_h
    other = twin_from_text(IMU_UTILS, Dialect.IMU_UTILS, believed, name="a.yaml")
    assert other.gyro.arw_deg_sqrt_h == pytest.approx(1.0, rel=1e-6)
    assert other.accel.vrw_ug_sqrt_hz == pytest.approx(100.0)
    assert other.gyro.bias_instability_deg_h == pytest.approx(10.0, rel=1e-3)
    sheet = "gyro_noise_density_deg_s_sqrt_hz: 0.004\n"
    icm = twin_from_text(sheet, Dialect.DATASHEET, believed, name="icm.txt")
    assert icm.gyro.arw_deg_sqrt_h == pytest.approx(0.24)


def test_kalibr_and_back(tmp_path):
    twin = default_twin("mems")
    (tmp_path / "twin.json").write_text(json.dumps(twin_to_dict(twin)))
    run = CliRunner().invoke
    asked = ["twin", "export", str(tmp_path / "twin.json"), "--to", "kalibr"]
    assert run(app, [*asked, "-o", str(tmp_path / "imu.yaml")]).exit_code == 0
    back = ["twin", "import", str(tmp_path / "imu.yaml"), "--from", "kalibr", "--serial", "S"]
    assert run(app, [*back, "-o", str(tmp_path / "back.json")]).exit_code == 0
    found = read_twin(tmp_path / "back.json")
    assert found.imu_serial == "S"
    assert found.gyro.arw_deg_sqrt_h == pytest.approx(twin.gyro.arw_deg_sqrt_h, rel=1e-5)
    shown = run(app, ["twin", "export", str(tmp_path / "twin.json"), "--to", "pyins"])
    assert json.loads(shown.stdout)["gyro"]["noise"] == pytest.approx(8.727e-5, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gyroscope_noise_density: much\n", "needed a number"),
        ("gyroscope_noise_density: -1\n", "not negative"),
        ("rostopic: /imu0\n", "no key of kalibr"),
        ("- a\n", "line 1"),
        ("a: 1\n" * 500, "needed at most"),
    ],
)
def test_what_is_no_noise_file_is_named(text, said):
    with pytest.raises(InputError, match=said):
        twin_from_text(text, Dialect.KALIBR, default_twin("mems"), name="imu.yaml")


def test_blocks_within_blocks():
    values = flat_values("imu0:\n  a: 1 # x\n  b:\n    c: 2\nd: 3\n", name="f")
    assert values == {"imu0.a": "1", "imu0.b.c": "2", "d": "3"}
    assert "gyroscope_random_walk" in kalibr_text(default_twin("rlg"), 100.0)
