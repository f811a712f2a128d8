"""Column maps: units, axes, damaged rows, time. A parked unit whose raw axes are x up, y right, z
forward.
"""

import numpy as np
import pytest

from ins.records import InputError
from ins.units import DEG
from tests.trajectories.run_cases import F_B, W_B
from trajectories.readers.columns.imu_columns import converted, second_means
from trajectories.readers.rows.column_map import (
    ACCEL_INCREMENTS,
    ACCEL_RATES,
    GYRO_INCREMENTS,
    GYRO_RATES,
    LogOptions,
    binary_type,
    column_map,
)

N, DT_S = 200, 0.01


def raw_columns(*, start_s: float = 5000.0) -> dict:
    """What such a unit logs, SI rates: body (x, y, z) = (raw z, raw y, -raw x)."""
    columns = {"t": start_s + DT_S * np.arange(N)}
    for name, v in (("w", W_B), ("f", F_B)):
        columns |= {
            f"{name}x": np.full(N, -v[2]),
            f"{name}y": np.full(N, v[1]),
            f"{name}z": np.full(N, v[0]),
        }
    return columns


def options(**changes) -> dict:
    keys = {
        "time": {"column": "t"},
        "axes": {"x": "z", "y": "y", "z": "-x"},
        "gyro": {"columns": ["wx", "wy", "wz"], "unit": "rad/s"},
        "accel": {"columns": ["fx", "fy", "fz"], "unit": "m/s2"},
    }
    return {k: v for k, v in {**keys, **changes}.items() if v is not None}


def convert(columns, **changes):
    keys = column_map(LogOptions(options(**changes)))
    return converted(dict(columns), keys, label="log", notes=[])


def test_axes_units_and_time():
    log = convert(raw_columns())
    np.testing.assert_allclose(log.imu.dtheta_rad, np.tile(W_B * DT_S, (N, 1)), rtol=1e-9)
    np.testing.assert_allclose(log.imu.dv_m_s, np.tile(F_B * DT_S, (N, 1)), rtol=1e-9, atol=1e-18)
    assert log.time_shift_s == pytest.approx(5000.0 - DT_S, abs=1e-9)
    assert log.imu.time_s[0] == pytest.approx(DT_S, abs=1e-9)
    assert log.notes == () and log.faults == ()


@pytest.mark.parametrize("unit", [*GYRO_RATES, *GYRO_INCREMENTS])
def test_gyro_units(unit):
    factor = (GYRO_RATES | GYRO_INCREMENTS)[unit]
    columns = raw_columns()
    span = 1.0 if unit in GYRO_RATES else DT_S
    for k in ("wx", "wy", "wz"):
        columns[k] = columns[k] * span / factor
    log = convert(columns, gyro={"columns": ["wx", "wy", "wz"], "unit": unit})
    np.testing.assert_allclose(log.imu.dtheta_rad, np.tile(W_B * DT_S, (N, 1)), rtol=1e-9)


@pytest.mark.parametrize("unit", [*ACCEL_RATES, *ACCEL_INCREMENTS])
def test_accel_units(unit):
    factor = (ACCEL_RATES | ACCEL_INCREMENTS)[unit]
    columns = raw_columns()
    span = 1.0 if unit in ACCEL_RATES else DT_S
    for k in ("fx", "fy", "fz"):
        columns[k] = columns[k] * span / factor / 2
    log = convert(columns, accel={"columns": ["fx", "fy", "fz"], "unit": unit, "scale": 2.0})
    np.testing.assert_allclose(log.imu.dv_m_s, np.tile(F_B * DT_S, (N, 1)), rtol=1e-9, atol=1e-18)


def test_unit_factors_are_the_published_ones():
    """Independent of ins.units: BIPM and CGPM values typed here."""
    assert GYRO_RATES["deg/h"] == pytest.approx(4.84813681109536e-06 / 1, rel=1e-14)
    # 1 deg/h is 1 arcsec/s
    assert GYRO_RATES["arcsec/s"] == pytest.approx(GYRO_RATES["deg/h"], rel=1e-14)
    assert ACCEL_RATES["g"] == 9.80665
    assert ACCEL_RATES["ug"] == pytest.approx(9.80665e-6, rel=1e-14)
    assert ACCEL_RATES["ft/s2"] == 0.3048


@pytest.mark.parametrize(("unit", "per_second"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_time_units(unit, per_second):
    columns = raw_columns(start_s=50.0)
    columns["t"] = np.round(columns["t"] * per_second)
    log = convert(columns, time={"column": "t", "unit": unit})
    assert log.imu.rate_hz == pytest.approx(100.0, rel=1e-6)
    assert log.time_shift_s == pytest.approx(49.99, abs=1e-6)


def test_a_rate_instead_of_times():
    log = convert(raw_columns(), time=None, rate_hz=100.0)
    assert log.time_shift_s == pytest.approx(0.0, abs=1e-15)
    assert log.imu.time_s[-1] == pytest.approx(2.0)


def test_temperatures_follow_their_gyro():
    """Raw x points up, so its thermometer belongs to body z; by seconds, in kelvin."""
    columns = raw_columns() | {
        k: np.full(N, v + 273.15) for k, v in (("Tx", 30.0), ("Ty", 20.0), ("Tz", 10.0))
    }
    columns["Tx"][::2] += 0.2
    log = convert(columns, temperature={"columns": ["Tx", "Ty", "Tz"], "unit": "K"})
    assert log.temperature.time_s.size == 3  # [0, 1), [1, 2), [2, 2]
    np.testing.assert_allclose(log.temperature.gyro_degC[1], [10.0, 20.0, 30.1], atol=1e-9)
    cyclic = {"x": "y", "y": "z", "z": "x"}
    turned = convert(columns, axes=cyclic, temperature={"columns": ["Tx", "Ty", "Tz"], "unit": "K"})
    np.testing.assert_allclose(turned.temperature.gyro_degC[1], [20.0, 10.0, 30.1], atol=1e-9)
    one = convert(columns, temperature={"columns": ["Ty"], "unit": "K"})
    np.testing.assert_allclose(one.temperature.gyro_degC, 20.0, atol=1e-9)


def test_temperatures_are_means_of_whole_seconds_at_the_mean_of_their_times():
    """Readings at 4 Hz of a ramp of 1 degC/s, one of them missing."""
    time_s = 0.25 * np.arange(1, 9)
    degC = np.repeat(20.0 + time_s[:, None], 3, axis=1)
    degC[5] = np.nan
    found = second_means(time_s, degC)
    np.testing.assert_allclose(found.time_s, [0.5, (1.0 + 1.25 + 1.75) / 3, 2.0])
    np.testing.assert_allclose(found.gyro_degC[:, 0], 20.0 + found.time_s)


def test_damaged_rows_are_dropped_and_listed():
    columns = raw_columns()
    columns["wx"][10] = np.nan
    columns["fz"][20] = 1e30
    columns["t"][30] = columns["t"][29]
    columns["t"][31], columns["wy"][31] = columns["t"][25], 1e-3
    log = convert(columns)
    assert log.imu.time_s.size == N - 4
    dropped = [f"log: row {k} dropped" for k in (11, 21, 31, 32)]
    assert [note.rpartition(": ")[0] for note in log.notes] == dropped
    # neighbours within a second are one stretch
    assert [s.reason for s in log.faults] == ["dropout: 4 imu rows lost"]
    np.testing.assert_allclose(log.imu.dv_m_s.sum(axis=0), F_B * N * DT_S, rtol=1e-9, atol=1e-12)


def test_a_gap_is_refused_with_the_stretch_to_take():
    columns = raw_columns()
    columns["t"][80:] += 3.0
    line = (
        r"log: gap of 3\.010 s after row 80 \(log time 5000\.790 s\), needed at .* --from-s"
        r" 5003\.800 --to-s 5004\.990"
    )
    with pytest.raises(InputError, match=line):
        convert(columns)
    log = convert(columns, from_s=5003.8, to_s=5004.99)
    assert log.imu.time_s.size == N - 80 and log.time_shift_s == pytest.approx(5003.79)
    assert log.notes == ("log: 80 rows outside the stretch that was asked for (from_s, to_s)",)


def test_filler_of_zeros_is_left_out():
    """Zeros before the first and after the last row, as flash memory has them, and rows before the
    clock is set.
    """
    columns = raw_columns()
    for name, values in columns.items():
        values[:20] = values[-30:] = 0.0
        if name == "t":
            values[20:25] = 0.0
    log = convert(columns)
    assert log.imu.time_s.size == N - 55
    assert log.notes == (
        "log: rows 1-20, 171-200 dropped: filler",
        "log: rows 21-25 dropped: time is zero",
    )


def test_late_rows_are_put_back_where_they_fit():
    """A swapped pair comes back in order; a row whose time another row has stays out."""
    columns = raw_columns()
    columns["wx"] = columns["wx"] + 1e-5 * np.arange(N)
    straight = convert({k: v.copy() for k, v in columns.items()})
    for values in columns.values():
        values[[50, 51]] = values[[51, 50]]
    columns["t"][100] = columns["t"][90]
    log = convert(columns)
    np.testing.assert_allclose(log.imu.dtheta_rad[:100], straight.imu.dtheta_rad[:100], rtol=1e-9)
    dropped, late = log.notes
    assert "row 101 dropped" in dropped and "row 52 written late" in late


def test_mixed_increments_and_rates():
    columns = raw_columns()
    for k in ("wx", "wy", "wz"):
        columns[k] = columns[k] * DT_S / DEG
    log = convert(
        columns, gyro={"columns": ["wx", "wy", "wz"], "unit": "deg", "kind": "increments"}
    )
    assert log.imu.source == "increments"
    np.testing.assert_allclose(log.imu.dtheta_rad[5], W_B * DT_S, rtol=1e-9)
    np.testing.assert_allclose(log.imu.dv_m_s[5], F_B * DT_S, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"axes": {"x": "z", "y": "y", "z": "x"}}, 'x = "z", y = "y", z = "x"'),
        ({"axes": {"x": "x", "y": "x", "z": "z"}}, "right-handed set"),
        ({"axes": {"x": "up"}}, 'map: axes.x: got "up"'),
        ({"axis": {}}, "map: unknown key axis (did you mean axes?)"),
        ({"gyro": {"columns": ["wx", "wy", "wz"], "units": "deg/s"}}, "gyro.unit is missing"),
        ({"gyro": {"columns": ["wx", "wy", "wz"], "unit": "deg/min"}}, "gyro.unit: got 'deg/min'"),
        ({"gyro": {"columns": ["wx", "wy", "wz"], "unit": "g"}}, "map: gyro.unit: got 'g'"),
        (
            {"gyro": {"columns": ["wx", "wy", "wz"], "unit": "deg/s", "kind": "increments"}},
            "unit of rates",
        ),
        ({"gyro": {"columns": ["wx", "wy"], "unit": "deg/s"}}, "map: gyro.columns"),
        ({"time": None}, "column or rate_hz"),
        ({"rate_hz": 100.0}, "column or rate_hz"),
        ({"time": None, "rate_hz": 5.0}, "map: rate_hz: got 5.0, needed at least 10"),
        ({"accel": {"columns": ["fx", "fy", "up"], "unit": "g"}}, "log: no column up, has t wx"),
        (
            {"accel": {"columns": ["fx", "fy", "fz"], "unit": "g", "scale": float("nan")}},
            "accel.scale: got nan",
        ),
        ({"temperature": {"columns": ["a", "b"]}}, "map: temperature.columns"),
    ],
)
def test_wrong_maps_are_refused(changes, line):
    with pytest.raises(InputError) as caught:
        convert(raw_columns(), **changes)
    assert line in str(caught.value)


def test_number_types_hold_no_objects():
    assert binary_type(">i2").itemsize == 2
    for text in ("O", "|O8", "V8", "<f8, O", "U10", "<f16", ""):
        with pytest.raises(InputError, match="map: dtype"):
            binary_type(text)
