"""`recal table export --to px4|ardupilot` and the way back, as a user runs them."""

import json

import numpy as np
import pytest

from infield.table.file import json_text, table_to_dict
from infield.table.thermal_table import EvenNodes, default_table, prior_covariance
from recal.cli.console import REFUSED_EXIT
from tests.recal.test_table import ok, refused, run


def stored(folder, sigma=10.0):
    table = default_table(
        imu_serial="SN-1",
        gyro_technology="mems",
        created_utc="2026-03-01T05:00:00Z",
        span=EvenNodes(low_degC=0, high_degC=60, spacing_degC=5),
    )
    T = table.temperature_degC[0]
    P = prior_covariance((T,) * 3, (np.full(T.size, sigma),) * 3)
    beta = np.concatenate([100 + 3 * (T - 30), -40 + 20 * np.sin((T - 20) / 12), 10 - 0.5 * T])
    (folder / "table.json").write_text(
        json_text(table_to_dict(table.replaced(parameters=beta, covariance=P)))
    )
    return json.loads(ok("import", "table.json", "--json"))


def test_px4_there_and_back(folder):
    about = stored(folder)
    told = json.loads(
        ok("export", "--to", "px4", "--imu", 1, "--device-id", 3670026, "-o", "u.params", "--json")
    )
    assert told["verdict"] == "exported"
    assert told["range_degC"] == [0.0, 60.0]
    assert told["reasons"] == []
    assert told["fit"]["y"]["max_error_deg_h"] == pytest.approx(4.9, abs=0.1)
    assert told["rounding_deg_h"] < 1e-3
    text = (folder / "u.params").read_text()
    assert about["sha256"] in text and "TC_G1_X3_2" in text and "CAL_GYRO" in text
    into = ("--serial", "SN-2", "--technology", "mems", "--store", "sqlite:///other.db", "--json")
    back = json.loads(ok("import", "u.params", *into))
    assert "sigma 31.2 deg/h" in back["note"]
    assert "z 0 deg/h" in back["note"]
    table = json.loads(ok("show", "--store", "sqlite:///other.db", "--json"))
    assert table["interpolation"] == "hermite"
    assert table["provenance"]["imported_from"]["device_id"] == 3670026
    assert table["axes"]["x"]["bias_deg_h"][-1] == pytest.approx(190.0, abs=0.01)


def test_ardupilot_comes_back_as_a_relative_table(folder):
    stored(folder)
    ok("export", "--to", "ardupilot", "--imu", 2, "--fit-limit", 3, "-o", "u.parm")
    into = (
        "--serial",
        "SN-2",
        "--technology",
        "mems",
        "--store",
        "sqlite:///other.db",
        "--sigma",
        12,
        "--json",
    )
    back = json.loads(ok("import", "u.parm", *into))
    assert "relative (0 at 35 degC)" in back["note"] and "12 deg/h, as given" in back["note"]
    table = json.loads(ok("show", "--store", "sqlite:///other.db", "--json"))
    x = table["axes"]["x"]
    assert np.interp(35.0, x["temperature_degC"], x["bias_deg_h"]) == pytest.approx(0.0, abs=0.01)
    assert x["bias_deg_h"][-1] == pytest.approx(75.0, abs=0.01)


def test_a_stiff_cubic_is_refused_unless_forced(folder):
    stored(folder, sigma=2.0)
    made = run("export", "--to", "px4", "--device-id", 7, "-o", "u.params", "--json")
    told = json.loads(made.stdout)
    assert made.exit_code == REFUSED_EXIT
    assert told["verdict"] == "refused"
    assert told["output"] is None
    assert "gyro y" in told["reasons"][0] and not (folder / "u.params").exists()
    forced = json.loads(
        ok("export", "--to", "px4", "--device-id", 7, "-o", "u.params", "--force", "--json")
    )
    assert forced["verdict"] == "exported" and forced["reasons"] == told["reasons"]
    assert "WRITTEN ALTHOUGH TOO STIFF: gyro y" in (folder / "u.params").read_text()


@pytest.mark.parametrize(
    "arguments",
    [
        ("--to", "px4", "-o", "u.params"),
        ("--to", "px4", "--device-id", 0, "-o", "u.params"),
        ("--to", "px4", "--device-id", 7, "-o", "u.json"),
        ("--to", "ardupilot", "--imu", 0, "-o", "u.parm"),
        ("--to", "ardupilot", "--device-id", 7, "-o", "u.parm"),
        ("--imu", 1, "-o", "u.json"),
        ("-o", "u.params"),
    ],
)
def test_wrong_usage(folder, arguments):
    stored(folder)
    assert run("export", *arguments).exit_code == 2


def test_bad_input_is_one_line(folder):
    stored(folder)
    assert "beyond the table" in refused(
        "export", "--to", "px4", "--device-id", 7, "--range", 10, 90, "-o", "u.params"
    )
    (folder / "u.params").write_text("1\t1\tTC_G0_ID\t0\t6\n")
    assert "TC_G0_ID is 0" in refused("import", "u.params", "--serial", "S", "--technology", "mems")
    assert run("import", "u.params").exit_code == 2
