"""A MEMS unit through the commands: simulate, align, update, export for an autopilot; the real logs
of ../shared/data.
"""

import json
from pathlib import Path

import pytest

from tests.recal.verbs import align, update
from trajectories.readers.conversion import convert_log
from trajectories.runs.directory import write_run
from trajectories.simulator.scenario import read_scenario, simulate_scenario

DATA = Path(__file__).parents[3] / "shared" / "data"
TWIN = {
    "schema": "recal.twin/1",
    "imu_serial": "DRONE-7",
    "gyro_technology": "mems",
    "gyro": {
        "arw_deg_sqrt_h": 0.2,
        "bias_instability_deg_h": 5,
        "rate_random_walk_deg_h_sqrt_h": 5,
        "turn_on_deg_h": 100,
    },
}


@pytest.fixture(scope="module")
def warm_up(tmp_path_factory):
    """A run directory and the twin that goes with it."""
    folder = tmp_path_factory.mktemp("mems")
    write_run(folder / "run", simulate_scenario(read_scenario("mems_warm_up"))[0].run)
    (folder / "twin.json").write_text(json.dumps(TWIN))
    return folder / "run", folder / "twin.json"


def test_align_gives_level_and_zero_rates_and_says_why_no_heading(warm_up, tmp_path):
    run, twin = warm_up
    found = align(run, store_url=f"sqlite:///{tmp_path}/none.db", twin=twin, output=tmp_path)
    assert found["verdict"] == "level_only" and found["reason_codes"][0] == "no_heading"
    assert found["roll_deg"] == pytest.approx(1.5, abs=3 * found["sigma_roll_deg"])
    gyro = found["zero_rate"]["gyro"]
    assert gyro["x"]["sigma_deg_h"] == pytest.approx(7.5, abs=0.1)
    assert gyro["z"]["sigma_deg_h"] < 1.0
    assert not found["zero_rate"]["heading_known"]


@pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data is not beside the project")
@pytest.mark.parametrize("imu", [1, 2, 3])
def test_the_copter_that_rests_for_half_a_minute_is_refused_with_reasons(imu, tmp_path):
    """38 s at 25.7 to 32.9 degC, its start-up offsets taken out: neither a level nor a slope can be
    had honestly.
    """
    found = convert_log(DATA / "ardupilot_log171.bin", {"imu": imu, "to_s": 73.0}, {})
    write_run(tmp_path / "run", found.run, conversion=found.record)
    said = update(
        [tmp_path / "run"], store_url=f"sqlite:///{tmp_path}/none.db", commit=False, output=tmp_path
    )
    assert said["verdict"] == "refused"
    assert "gyro_offsets" in said["reasons"][0] and "needed 60 s" in said["reasons"][1]
