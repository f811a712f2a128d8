"""Twin files: nothing lost on the way, nothing guessed, each wrong key named."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ins.records import (
    GYRO_TECHNOLOGIES,
    AccelNoise,
    GyroNoise,
    InputError,
    TwinModel,
    VehicleNoise,
)
from ins.twin_file import default_twin, read_twin, twin_from_dict, twin_to_dict

FORMATS_EXAMPLE = """{
 "schema": "recal.twin/1", "imu_serial": "SN-0042", "gyro_technology": "rlg", "table": "table.json",
 "gyro": {"arw_deg_sqrt_h": 0.002, "bias_instability_deg_h": 0.002,
          "rate_random_walk_deg_h_sqrt_h": 0.002, "turn_on_deg_h": 0.003,
          "scale_factor_ppm": [0, 0, 0], "misalignment_mrad": [0, 0, 0, 0, 0, 0],
          "quantization_rad": 0.0},
 "accel": {"vrw_ug_sqrt_hz": 10.0, "bias_ug": [0, 0, 0], "bias_instability_ug": 1.0,
           "rate_random_walk_ug_sqrt_h": 2.0, "turn_on_ug": 30.0},
 "temperature": {"noise_degC": 0.01, "resolution_degC": 0.01},
 "gnss": {"sigma_horizontal_m": 0.5, "sigma_vertical_m": 0.75, "sigma_velocity_m_s": 0.03},
 "odometer": {"scale_ppm": 0.0, "noise_m_s": 0.01},
 "vehicle": {"crab_mrad": 0.0, "lateral_noise_m_s": 0.02, "yaw_creep_arcsec_sqrt_h": 3.0,
             "sway_m_s": 0.001, "sway_hz": 0.28, "sway_damping": 0.2},
 "effects": []}"""


def twin(**changes):
    data = {"schema": "recal.twin/1", "gyro_technology": "rlg", **changes}
    return twin_from_dict(data, source="test", name="twin.json")


@pytest.mark.parametrize("technology", ["rlg", "fog"])
def test_the_example_of_the_contract_is_the_default(tmp_path, technology):
    (tmp_path / "twin.json").write_text(FORMATS_EXAMPLE.replace('"rlg"', f'"{technology}"'))
    read = read_twin(tmp_path / "twin.json")
    assert read.imu_serial == "SN-0042"
    assert read.table == "table.json"
    assert read.source == str(tmp_path / "twin.json")
    default = default_twin(technology)
    assert default.source == f"defaults of {technology}"
    for section in ("gyro", "accel", "temperature", "gnss", "odometer", "vehicle"):
        assert getattr(read, section) == getattr(default, section), section


@pytest.mark.parametrize("technology", GYRO_TECHNOLOGIES)
def test_missing_keys_take_the_default_of_the_technology(technology):
    read = twin(gyro_technology=technology, gyro={"arw_deg_sqrt_h": 0.5})
    default = default_twin(technology)
    assert read.gyro.arw_deg_sqrt_h == 0.5
    assert read.gyro.turn_on_deg_h == default.gyro.turn_on_deg_h
    assert read.accel == default.accel


size = st.floats(min_value=0, max_value=1e6)
signed = st.floats(min_value=-1e6, max_value=1e6)


@settings(max_examples=50, deadline=None)
@given(
    size,
    st.tuples(signed, signed, signed),
    st.tuples(*[signed] * 6),
    signed,
    st.text(min_size=1, max_size=20).filter(str.isprintable),
)
def test_round_trip(noise, three, six, crab, name):
    twin = TwinModel(
        imu_serial=name,
        table="t/table.json",
        source="s",
        gyro=GyroNoise(arw_deg_sqrt_h=noise, scale_factor_ppm=three, misalignment_mrad=six),
        accel=AccelNoise(bias_ug=three),
        vehicle=VehicleNoise(crab_mrad=crab),
        effects=(
            {
                "effect": "gyro_thermal_rate",
                "target": "gyro_y",
                "parameters": {"c": crab, "list": [1, noise]},
            },
        ),
    )
    text = json.dumps(twin_to_dict(twin))
    assert twin_from_dict(json.loads(text), source="s", name="x") == twin


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"gyro": {"arw_deg_h": 1}}, "gyro.arw_deg_h (did you mean arw_deg_sqrt_h?)"),
        ({"gyros": {}}, "twin.json: unknown key gyros (did you mean gyro?)"),
        ({"gyro": {"arw_deg_sqrt_h": -0.1}}, "gyro.arw_deg_sqrt_h: got -0.1"),
        ({"gyro": {"arw_deg_sqrt_h": float("nan")}}, "gyro.arw_deg_sqrt_h: got nan"),
        ({"accel": {"bias_ug": [1, float("inf"), 2]}}, "twin.json: accel.bias_ug[1]: got inf"),
        (
            {"effects": [{"effect": "a", "target": "b", "parameters": {"c": float("nan")}}]},
            "parameters.c: got",
        ),
        ({"gyro": {"arw_deg_sqrt_h": None}}, "gyro.arw_deg_sqrt_h: got null"),
        ({"gyro": {"arw_deg_sqrt_h": "0.1"}}, 'gyro.arw_deg_sqrt_h: got "0.1"'),
        ({"gyro": {"scale_factor_ppm": [1, 2]}}, "twin.json: gyro.scale_factor_ppm"),
        ({"gyro": {"misalignment_mrad": [1, 2, 3]}}, "twin.json: gyro.misalignment_mrad"),
        ({"effects": [{"effect": "a"}]}, "twin.json: key effects[0].target is missing"),
        ({"effects": [{"effect": "a", "target": "b", "size": 1}]}, "effects[0].size"),
        ({"gyro_technology": "laser"}, 'gyro_technology: got "laser"'),
        ({"schema": "recal.twin/2"}, 'schema: got "recal.twin/2"'),
        ({"table": ""}, "twin.json: table"),
    ],
)
def test_what_is_wrong_is_named(changes, line):
    with pytest.raises(InputError) as caught:
        twin(**changes)
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_are_not_twins(tmp_path):
    for content, why in (
        (b"\xff\xfe", "not UTF-8"),
        (b"[]", r"holds \[\]"),
        (b"", "is empty"),
        (b'{"gyro": NaN}', "NaN"),
    ):
        (tmp_path / "t.json").write_bytes(content)
        with pytest.raises(InputError, match=why):
            read_twin(tmp_path / "t.json")
    with pytest.raises(InputError, match="cannot be read"):
        read_twin(tmp_path / "missing.json")
    with pytest.raises(InputError, match="gyro_technology 'laser'"):
        default_twin("laser")
