"""Exported parameters, evaluated as the autopilots' own documentation has it, in float32, on a
simulated raw gyro.

The evaluations below are written from those documents (docs/mems.md), not from
infield.table.autopilot_params.
"""

import re

import numpy as np
import pytest

from infield.table.autopilot_params import read_cubic
from infield.table.autopilot_table import FREE_LEVEL_DEG_H, export_cubic, table_of_cubic
from infield.table.cubic_fit import fit_cubics, valid_range
from infield.table.thermal_table import EvenNodes, default_table, prior_covariance
from ins.records import InputError
from ins.units import DEG_PER_HOUR

UTC = "2026-03-01T05:00:00Z"
# of a rate of 0.1 rad/s in float32: half a unit in the last place is 7.5e-9/2 rad/s = 8e-4 deg/h
FLOAT32_DEG_H = 3e-3
F = np.float32


def table(curve, sigma=10.0, low=-10.0, high=60.0):
    """A mems table on 5 degC nodes through curve(T) -> (3, n) [deg/h]."""
    found = default_table(
        imu_serial="SN-1",
        gyro_technology="mems",
        created_utc=UTC,
        span=EvenNodes(low_degC=low, high_degC=high, spacing_degC=5.0),
    )
    T = found.temperature_degC[0]
    P = prior_covariance((T,) * 3, (np.full(T.size, sigma),) * 3)
    return found.replaced(parameters=np.concatenate(curve(T)), covariance=P)


def straight(T):
    return [300.0 + 4.0 * (T - 20), -900.0 - 7.0 * (T - 20), 25.0 + 0.3 * T]


def curved(T):
    return [
        300 + 4 * (T - 20) + 0.03 * (T - 20) ** 2,
        -80 + 1e-3 * (T - 30) ** 3,
        25 + 12 * np.sin(T / 18),
    ]


def text_values(text, pattern):
    """Name -> float32, from the file's own text; any other line is ignored."""
    return {m[1]: F(m[2]) for m in re.finditer(pattern, text, flags=re.M)}


def px4_corrected(text, raw, T, instance):
    """raw (n, 3) float32 less the thermal offset: clamp, powers, sum, as PX4's
    calc_thermal_offsets_3D describes.
    """
    p = text_values(text, r"^1\t1\t(TC_G\d_\w+)\t(\S+)\t9$")
    dt = (
        np.clip(T.astype(F), p[f"TC_G{instance}_TMIN"], p[f"TC_G{instance}_TMAX"])
        - p[f"TC_G{instance}_TREF"]
    )
    out = np.empty_like(raw)
    for axis in range(3):
        x0, x1, x2, x3 = (p[f"TC_G{instance}_X{k}_{axis}"] for k in range(4))
        out[:, axis] = raw[:, axis] - (x0 + x1 * dt + x2 * (dt * dt) + x3 * (dt * dt * dt))
    return out


def ardupilot_corrected(text, raw, T, instance, cal_degC):
    """raw (n, 3) float32 less p(T - 35), plus p(cal - 35), both clamped: ArduPilot's
    correct_sensor, Horner, 1e-6.
    """
    p = text_values(text, r"^(INS_TCAL\d_\w+) (\S+)$")
    assert p[f"INS_TCAL{instance}_ENABLE"] == 1
    low, high = p[f"INS_TCAL{instance}_TMIN"], p[f"INS_TCAL{instance}_TMAX"]
    out = np.empty_like(raw)
    for axis, letter in enumerate("XYZ"):
        c1, c2, c3 = (p[f"INS_TCAL{instance}_GYR{k}_{letter}"] for k in (1, 2, 3))

        def at(temperature, c1=c1, c2=c2, c3=c3):
            d = np.clip(np.asarray(temperature, dtype=F), low, high) - F(35.0)
            return (c1 + (c2 + c3 * d) * d) * d * F(1e-6)

        out[:, axis] = raw[:, axis] - at(T) + at(cal_degC)
    return out


def raw_gyro(held, T, rng):
    """A true rate plus the table's bias, float32 rad/s, and the true rate."""
    true = rng.normal(0.0, 0.02, (T.size, 3))
    bias = np.stack([held.bias_deg_h(axis, T) for axis in range(3)], axis=1) * DEG_PER_HOUR
    return (true + bias).astype(F), true


@pytest.mark.parametrize(("curve", "instance"), [(straight, 0), (curved, 2)])
def test_px4_leaves_what_the_table_leaves(curve, instance):
    held, rng = table(curve), np.random.default_rng(3)
    made = export_cubic(held, "px4", number=instance, device_id=3670026)
    text = made.text(unit="SN-1 (mems)", revision=1, sha256="0" * 64)
    assert f"1\t1\tTC_G{instance}_ID\t3670026\t6\n" in text
    # beyond: both hold the end value
    T = np.concatenate([np.linspace(-10, 60, 141), [-40.0, 85.0]])
    raw, true = raw_gyro(held, T, rng)
    left = (px4_corrected(text, raw, T, instance) - true) / DEG_PER_HOUR
    stated = np.array([fit.max_error_deg_h for fit in made.fits])
    assert np.all(np.abs(left) <= 1.02 * stated + made.rounding_deg_h + FLOAT32_DEG_H)
    # what is stated is no mere upper bound
    assert np.abs(left).max() >= 0.9 * stated.max() - FLOAT32_DEG_H
    assert made.rounding_deg_h < 1e-3
    if curve is straight:
        assert stated.max() < 1e-6


@pytest.mark.parametrize(
    ("curve", "instance", "cal_degC"), [(straight, 1, 35.0), (curved, 3, 22.5)]
)
def test_ardupilot_leaves_a_constant_that_its_start_takes(curve, instance, cal_degC):
    held, rng = table(curve, sigma=30.0), np.random.default_rng(4)
    made = export_cubic(held, "ardupilot", number=instance)
    T = np.linspace(-10, 60, 141)
    raw, true = raw_gyro(held, T, rng)
    left = (
        ardupilot_corrected(made.text(unit="", revision=1, sha256=""), raw, T, instance, cal_degC)
        - true
    ) / DEG_PER_HOUR
    at_cal = np.array([held.bias_deg_h(axis, cal_degC)[0] for axis in range(3)])
    stated = np.array([fit.max_error_deg_h for fit in made.fits])
    constant = left.mean(axis=0)
    assert np.all(np.abs(left - constant) <= 1.02 * stated + made.rounding_deg_h + FLOAT32_DEG_H)
    # the bias at the temperature of the start
    assert np.all(np.abs(constant - at_cal) <= 1.02 * stated + FLOAT32_DEG_H)


def test_the_test_sees_a_wrong_sign_and_a_wrong_unit():
    held, rng, T = table(straight), np.random.default_rng(5), np.linspace(0, 50, 51)
    text = export_cubic(held, "px4", number=0, device_id=1).text(unit="", revision=1, sha256="")
    raw, true = raw_gyro(held, T, rng)
    for wrong in (text.replace("X1_0\t0", "X1_0\t-0"), re.sub(r"(TREF\t)(\S+)", r"\g<1>0.0", text)):
        assert wrong != text
        assert np.abs((px4_corrected(wrong, raw, T, 0) - true) / DEG_PER_HOUR).max() > 10.0


@pytest.mark.parametrize(
    ("autopilot", "number", "ending"), [("px4", 1, ".params"), ("ardupilot", 2, ".parm")]
)
def test_round_trip(tmp_path, autopilot, number, ending):
    held = table(curved)
    made = export_cubic(held, autopilot, number=number, device_id=77 if autopilot == "px4" else 0)
    path = tmp_path / f"unit{ending}"
    path.write_text(made.text(unit="u", revision=1, sha256="s"))
    back, notes = table_of_cubic(
        read_cubic(path), imu_serial="SN-1", gyro_technology="mems", created_utc=UTC
    )
    T = np.linspace(-10, 60, 200)
    for k, fit in enumerate(made.fits):
        level = fit.coefficients[0] if autopilot == "ardupilot" else 0.0
        assert np.abs(back.bias_deg_h(k, T) - (fit.value_deg_h(T) - level)).max() < 1e-3
        expected = 31.2 if autopilot == "px4" else np.hypot(FREE_LEVEL_DEG_H, 17.1)
        assert back.sigma_deg_h(k, 20.0)[0] == pytest.approx(expected, rel=0.01)
    assert any("sigma" in note or "known to" in note for note in notes)
    again = export_cubic(back, autopilot, number=number, device_id=77 if autopilot == "px4" else 0)
    assert max(fit.max_error_deg_h for fit in again.fits) < 1e-3
    difference = again.cubic.offset_deg_h(T) - made.cubic.offset_deg_h(T)
    assert np.abs(difference).max() < 1e-3


@pytest.mark.parametrize(("autopilot", "number"), [("px4", 0), ("ardupilot", 1)])
@pytest.mark.parametrize(
    "curve",
    [
        lambda T: [20 * np.sin(T / 4), 0 * T, 3.0 * T],
        lambda T: [400.0 / (1 + np.exp(25 - T)), 0 * T, np.where(T > 30, 300.0, 0.0)],
    ],
)
def test_a_forced_stiff_cubic_comes_back_as_uncertain_as_it_is_wrong(
    tmp_path, autopilot, number, curve
):
    """Errors against the table that went out, at all its nodes, within three of the sigmas that
    come back; with ArduPilot, which has no constant, those of the change since 35 degC.
    """
    held = table(curve, sigma=1.5)
    made = export_cubic(
        held,
        autopilot,
        number=number,
        device_id=7 if autopilot == "px4" else 0,
        span_degC=(-10.0, 60.0),
    )
    assert made.too_stiff and max(fit.max_error_deg_h for fit in made.fits) > 10.0
    path = tmp_path / "forced.params"
    path.write_text(made.text(unit="u", revision=1, sha256="s"))
    back, notes = table_of_cubic(
        read_cubic(path), imu_serial="SN-1", gyro_technology="mems", created_utc=UTC
    )
    assert any("its cubic is off the table" in note for note in notes)
    T = held.temperature_degC[0]
    for axis, fit in zip("xyz", made.fits):
        error, rows = back.bias_deg_h(axis, T) - held.bias_deg_h(axis, T), back.basis(axis, T)
        if autopilot == "ardupilot":
            error, rows = error - error[T == 35.0], rows - rows[T == 35.0]
        sigma = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", rows, back.covariance, rows), 0.0))
        assert np.abs(error).max() >= 0.3 * fit.max_error_deg_h
        assert np.all(np.abs(error) <= 3.0 * sigma + 1e-6)
        assert back.sigma_deg_h(axis, T).max() < 4000.0


def test_the_fit_weighs_by_the_table():
    """Where the table is known poorly the cubic may miss it; where it is known well it may not."""
    held = table(lambda T: [np.where(T > 45, 40.0, 0.0) + 0 * T] * 3, sigma=1.0)
    T = held.temperature_degC[0]
    P = prior_covariance((T,) * 3, (np.where(T > 42, 50.0, 1.0),) * 3)
    fit = fit_cubics(held.replaced(covariance=P), low_degC=-10, high_degC=60, reference_degC=25)[0]
    equal = fit_cubics(held, low_degC=-10, high_degC=60, reference_degC=25)[0]
    cold = np.linspace(-10, 35, 50)
    assert np.abs(fit.value_deg_h(cold)).max() < 0.5 * np.abs(equal.value_deg_h(cold)).max()


def test_valid_range_leaves_out_what_is_only_believed():
    held = table(straight)
    T = held.temperature_degC[0]
    P = prior_covariance((T,) * 3, (np.where(np.abs(T - 30) <= 15, 3.0, 30.0),) * 3)
    low, high = valid_range(held.replaced(covariance=P))
    assert 10.0 < low <= 15.1 and 44.9 <= high < 50.0
    assert valid_range(held) == (-10.0, 60.0)


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ("INS_TCAL1_ENABLE 0\nINS_TCAL1_TMIN 0\nINS_TCAL1_TMAX 50\n", "INS_TCAL1_ENABLE is 0"),
        (
            "INS_TCAL1_ENABLE,1\nINS_TCAL1_TMIN,0\nINS_TCAL1_TMAX,50\n",
            "INS_TCAL1_GYR1_X is missing",
        ),
        ("INS_TCAL1_ENABLE=1\nINS_TCAL1_TMIN=50\nINS_TCAL1_TMAX=50\n", "needed TMIN below TMAX"),
        ("INS_TCAL1_ENABLE 1\nINS_TCAL1_TMIN x\n", "line 2: INS_TCAL1_TMIN: got 'x'"),
        ("INS_TCAL1_TMIN 3\nINS_TCAL1_TMIN 4\n", "line 2: INS_TCAL1_TMIN: 4 after 3"),
        ("INS_TCAL1_ENABLE 1\nINS_TCAL2_ENABLE 1\n", "several: ardupilot 1, ardupilot 2"),
        ("hello\n", "none named"),
    ],
)
def test_bad_files_say_where(tmp_path, lines, reason):
    path = tmp_path / "bad.parm"
    path.write_text(lines)
    with pytest.raises(InputError, match=re.escape(reason)) as error:
        read_cubic(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)
