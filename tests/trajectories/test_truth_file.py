"""A profile of somebody else's as the motion of a run: followed, navigated back, and refused where
it cannot be.
"""

from pathlib import Path

import numpy as np
import pytest

from ins.earth import radii_of_curvature
from ins.records import ImuLog, InputError, NavState, Site
from ins.strapdown.mechanization import navigate
from ins.units import DEG
from trajectories.simulator.scenario import (
    scenario_from_dict,
    scenario_ideal,
    scenario_truth,
    simulate_scenario,
)
from trajectories.simulator.truth_file import COLUMNS, departure

DATA = Path(__file__).parents[3] / "shared" / "data"
ONE_MM, ONE_CM = 1e-3, 1e-2
LAT = 51.0


def drive(n=4001, dt=0.01, speed=12.0, *, start=0.0):
    """40 s: away from rest (or at `start` m/s), a right turn of 60 deg, a stop of 5 s; rows (n, 10)
    as in the files.
    """
    t = dt * np.arange(n)

    def blend(a, b):
        u = np.clip((t - a) / (b - a), 0, 1)
        return u**3 * (10 - 15 * u + 6 * u**2)

    v = start + (speed - start) * blend(2, 12) - speed * blend(25, 35)
    heading = 60 * DEG * blend(14, 22)
    v_n = np.stack([v * np.cos(heading), v * np.sin(heading), np.zeros(n)], axis=-1)
    meridian, transverse = radii_of_curvature(LAT * DEG)
    middle = 0.5 * (v_n[1:] + v_n[:-1]) * dt
    north, east = np.vstack([np.zeros(3), np.cumsum(middle, axis=0)])[:, :2].T
    lat = LAT * DEG + north / (meridian + 10)
    place = np.stack(
        [lat / DEG, east / ((transverse + 10) * np.cos(lat)) / DEG, np.full(n, 10.0)], axis=-1
    )
    zero = np.zeros(n)
    return np.column_stack([t, place, v_n, zero, 0.5 + zero, heading / DEG])


def write(path, rows, *, header=True):
    lines = [",".join(COLUMNS)] if header else []
    path.write_text(
        "\n".join([*lines, *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n"
    )
    return path


def scenario(folder, file="truth.csv", **keys):
    data = {
        "schema": "recal.scenario/1",
        "imu": {"rate_hz": 50},
        "thermal": {"start": "ambient"},
        "truth": {"file": file, "park_s": 60.0, **keys},
    }
    return scenario_from_dict(data, name="s", folder=folder)


@pytest.mark.parametrize("header", [True, False])
def test_run_follows_the_file(tmp_path, header):
    write(tmp_path / "truth.csv", drive(), header=header)
    plan = scenario(tmp_path, park_after_s=20)
    truth = scenario_truth(plan)
    off = departure(truth, plan.profile)
    assert off.position_m < ONE_CM and off.velocity_m_s < ONE_CM and off.attitude_deg < 0.05
    assert truth.motion.end_s == pytest.approx(60 + 40 + 20)
    # the file itself stands for its first 2 s
    assert truth.motion.rest[0] == pytest.approx((0, 62), abs=0.5)
    assert truth.motion.rest[-1] == pytest.approx((95, 120), abs=0.5)


def test_navigation_from_the_ideal_sensors_returns_to_the_file(tmp_path):
    rows = drive()
    write(tmp_path / "truth.csv", rows)
    ideal = scenario_ideal(scenario(tmp_path))
    imu = ImuLog(
        time_s=ideal.time_s,
        dt_s=np.full(ideal.time_s.size, 0.02),
        dtheta_rad=ideal.dtheta_rad,
        dv_m_s=ideal.dv_m_s,
    )
    initial = NavState(time_s=0.0, site=ideal.truth.site, v_n_m_s=np.zeros(3), C_nb=ideal.C_nb[0])
    history = navigate(imu, initial, epoch_s=1.0)
    end = rows[np.searchsorted(rows[:, 0], history.time_s[-1] - 60.0)]
    metres = (
        (history.lat_rad[-1] - end[1] * DEG) * 6.37e6,
        (history.lon_rad[-1] - end[2] * DEG) * 6.37e6 * np.cos(LAT * DEG),
    )
    # 200 m of way; Schuler's feedback is below a millimetre in 100 s
    assert np.hypot(*metres) < 10 * ONE_CM
    assert history.v_n_m_s[-1] == pytest.approx(end[4:7], abs=2 * ONE_MM)


def test_a_run_up_meets_the_first_row(tmp_path):
    rows = drive(start=8.0)
    write(tmp_path / "truth.csv", rows)
    plan = scenario(tmp_path, run_up_s=15.0)
    off = departure(scenario_truth(plan), plan.profile)
    assert off.position_m < 2 * ONE_CM and off.velocity_m_s < ONE_CM
    meridian, _ = radii_of_curvature(LAT * DEG)
    assert (LAT * DEG - plan.profile.site.lat_rad) * (meridian + 10) == pytest.approx(
        0.5 * 8.0 * 15.0, abs=ONE_CM
    )
    assert plan.profile.time_s[0] == pytest.approx(75.0)


def test_a_simulated_run_has_the_place_and_the_streams(tmp_path):
    write(tmp_path / "truth.csv", drive(start=0.0))
    simulated, _ = simulate_scenario(scenario(tmp_path), seed=3)
    site = simulated.run.header.site
    assert (site.lat_rad, site.height_m) == pytest.approx((LAT * DEG, 10.0))
    course = np.arctan2(*simulated.reference.v_n_m_s[simulated.reference.time_s > 84][0, 1::-1])
    assert course == pytest.approx(60 * DEG, abs=0.01)


@pytest.mark.parametrize(
    ("change", "keys", "line"),
    [
        (lambda r: drive(start=3.0), {}, "row 1 moves at 3 m/s"),
        (lambda r: np.where(np.arange(10) == 1, 91.0, r), {}, "truth.csv: row 1: lat_deg 91"),
        (lambda r: r[[0, 1, 1, *range(3, 50)]], {}, "truth.csv: row 3: time_s 0.01 after 0.01"),
        (lambda r: np.where(r == r[7, 0], np.nan, r), {}, "row 8: column time_s: got nan"),
        (lambda r: r[:5], {}, "truth.csv: 5 rows, needed 10"),
        (lambda r: r[:2000], {"park_after_s": 5.0}, "truth.park_after_s"),
        (lambda r: drive(start=3.0), {"run_up_s": 5.0, "park_s": 0.0}, "truth.park_s: got 0"),
        (lambda r: r, {"step_s": 0.0}, "step_s above 0"),
        (lambda r: r, {"parks": 1.0}, "unknown key parks"),
        (lambda r: r, {"file": "none.csv"}, "none.csv: cannot be read"),
    ],
)
def test_refusals_name_the_row_or_the_key(tmp_path, change, keys, line):
    write(tmp_path / "truth.csv", change(drive()))
    with pytest.raises(InputError, match=line.replace("(", r"\(")) as error:
        scenario(tmp_path, **keys)
    assert str(error.value).startswith("s: ") and "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["time_s,lat_deg\n0,1\n", "0,1,2\n1,2,3\n"])
def test_wrong_columns_are_named(tmp_path, text):
    (tmp_path / "truth.csv").write_text(text)
    with pytest.raises(InputError, match=r"needed (time_s|10: time_s)"):
        scenario(tmp_path)


@pytest.mark.parametrize("key", ["site", "attitude", "motion"])
def test_truth_goes_with_no_other_motion(tmp_path, key):
    write(tmp_path / "truth.csv", drive())
    data = {
        "schema": "recal.scenario/1",
        "thermal": {"start": "cold"},
        "truth": {"file": "truth.csv"},
        key: {},
    }
    if key == "motion":
        data[key] = [{"segment": "park", "duration_s": 1}]
    with pytest.raises(InputError, match=f"{key} and truth are both given"):
        scenario_from_dict(data, name="s", folder=tmp_path)


@pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data is not beside the project")
@pytest.mark.parametrize(("number", "keys"), [(0, {}), (1, {}), (2, {"run_up_s": 20.0})])
def test_profiles_of_groves_are_followed(number, keys):
    plan = scenario(DATA, file=f"groves_Profile_{number}.csv", **keys)
    off = departure(scenario_truth(plan), plan.profile)
    # of 60 s to 175 s; they carry 0.1 m/s of noise and yaw steps that 0.1 s rounds off
    assert off.position_m < ONE_CM
    assert off.velocity_m_s < 0.15 and off.attitude_deg < 0.7
    assert isinstance(plan.profile.site, Site)
