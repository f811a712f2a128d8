"""`recal.Run`: arrays and pandas tables in, checked as a run directory is; its page, its plot."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import recal
from ins.records import InputError
from tests.infield.sessions import simulated

ROUNDED = 1e-11  # rad and m/s: an increment over its interval and times it


def arrays(run):
    """What a recorder holds of a run: rates, forces, temperatures at the rate of the imu."""
    imu = run.imu.whole()
    degC = [
        np.interp(imu.time_s, run.temperature.time_s, column)
        for column in run.temperature.gyro_degC.T
    ]
    rates = imu.dtheta_rad / imu.dt_s[:, None], imu.dv_m_s / imu.dt_s[:, None]
    return imu.time_s, *rates, np.stack(degC, axis=1)


def unit(run):
    """What nobody can see in the numbers."""
    header = run.header
    return {
        "lat_deg": np.degrees(header.site.lat_rad),
        "lon_deg": np.degrees(header.site.lon_rad),
        "height_m": header.site.height_m,
        "serial": header.imu_serial,
        "technology": header.gyro_technology,
        "start_utc": header.start_utc,
    }


@pytest.fixture(scope="module")
def recorded():
    return simulated(1).run


@pytest.fixture(scope="module")
def made(recorded):
    time_s, w, f, degC = arrays(recorded)
    return recal.Run.from_arrays(time_s, w, f, temperature_degC=degC, **unit(recorded))


def test_arrays_are_the_run_that_they_came_from(recorded, made):
    old, new = recorded.imu.whole(), made.imu.whole()
    assert np.array_equal(old.time_s, new.time_s)
    assert np.abs(old.dtheta_rad - new.dtheta_rad).max() < ROUNDED
    assert np.abs(old.dv_m_s - new.dv_m_s).max() < ROUNDED
    assert made.header.site.lat_rad == pytest.approx(recorded.header.site.lat_rad)
    assert made.header.start_utc == recorded.header.start_utc


def test_a_run_of_arrays_is_recalibrated_as_the_recorded_one(recorded, made):
    site = made.header.site  # as well known as 45.0 says
    bare = replace(recorded, phases=(), header=replace(recorded.header, site=site))
    a, b = (recal.update(run).table for run in (bare, made))
    sigma = np.sqrt(np.diag(a.covariance))
    assert np.abs((a.parameters - b.parameters) / sigma).max() < 0.01
    assert np.sqrt(np.diag(b.covariance)) == pytest.approx(sigma, rel=0.01)


@pytest.mark.parametrize(
    "names, factors",
    [
        (("time_s", "gyro_{}_rad_s", "accel_{}_m_s2", "gyro_{}_degC"), (1, 1, 1)),
        (("t_ms", "Gyr_{} [deg/s]", "Acc_{} [g]", "T_{}_C"), (1e3, 180 / np.pi, 1 / 9.80665)),
    ],
)
def test_a_table_says_its_units_in_the_names(recorded, made, names, factors):
    time_s, w, f, degC = arrays(recorded)
    frame = pd.DataFrame({names[0]: time_s * factors[0]})
    for k, axis in enumerate("xyz"):
        frame[names[1].format(axis)] = w[:, k] * factors[1]
        frame[names[2].format(axis)] = f[:, k] * factors[2]
        frame[names[3].format(axis)] = degC[:, k]
    read = recal.Run.from_frame(frame, **unit(recorded))
    assert read.imu.whole().dtheta_rad == pytest.approx(made.imu.whole().dtheta_rad, abs=1e-12)
    assert read.imu.whole().dv_m_s == pytest.approx(made.imu.whole().dv_m_s, abs=1e-9)
    assert read.temperature.gyro_degC == pytest.approx(made.temperature.gyro_degC)
    bare = frame.rename(columns={names[1].format("y"): "gyro_y"})
    with pytest.raises(InputError, match="gyro"):
        recal.Run.from_frame(bare, **unit(recorded))


def test_fixes_come_as_columns(recorded):
    time_s, w, f, _ = arrays(recorded)
    site = recorded.header.site
    seconds = np.arange(1.0, 60.0)
    fixes = {"time_s": seconds, "lat_deg": np.degrees(site.lat_rad) + 0 * seconds}
    fixes |= {
        "lon_deg": np.degrees(site.lon_rad) + 0 * seconds,
        "height_m": site.height_m + 0 * seconds,
    }
    fixes |= dict.fromkeys(("vn_m_s", "ve_m_s", "vd_m_s"), 0 * seconds)
    given = recal.Run.from_arrays(time_s, w, f, gnss=pd.DataFrame(fixes), **unit(recorded))
    assert given.gnss.time_s.size == seconds.size and given.temperature is None
    del fixes["vn_m_s"]
    with pytest.raises(InputError, match="vn_m_s"):
        recal.Run.from_arrays(time_s, w, f, gnss=fixes, **unit(recorded))


@pytest.mark.parametrize("what", ["shape", "units", "order", "missing", "latitude", "sign"])
def test_arrays_that_contradict_themselves_are_refused(recorded, what):
    time_s, w, f, _ = (np.array(values) for values in arrays(recorded))
    given = unit(recorded)
    if what == "shape":
        w = w[:-1]
    elif what == "units":
        f = f / 9.80665
    elif what == "order":
        time_s[100] = time_s[99]
    elif what == "missing":
        w[7, 1] = np.nan
    elif what == "latitude":
        given["lat_deg"] = 145.0
    elif what == "sign":
        f = -f
    with pytest.raises(InputError) as refused:
        recal.Run.from_arrays(time_s, w, f, **given)
    assert "/tmp" not in str(refused.value) and "\n" not in str(refused.value)
