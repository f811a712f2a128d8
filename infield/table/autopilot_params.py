"""Thermal gyro parameters of PX4 and ArduPilot: names, units, signs, and the files that hold them::

    PX4        rate = raw - (X0 + X1 x + X2 x^2 + X3 x^3)    [rad/s]
               x = T - TREF, T held within TMIN..TMAX
    ArduPilot  rate = raw - p(T - 35) + p(Tcal - 35)         [rad/s]
               p(x) = (GYR1 x + GYR2 x^2 + GYR3 x^3) / 1e6

Both subtract what the gyro reads above the truth, as a table does. ArduPilot has no constant: it
measures its offsets at a start, at Tcal (INS_GYRn_CALTEMP). Values live as float32 on board. Axes
are the sensor's, before the board's rotation. Sources (public, read 2026-11): PX4-Autopilot
src/modules/temperature_compensation/TemperatureCompensation.cpp,
src/lib/sensor_calibration/Gyroscope.hpp, Tools/process_sensor_caldata.py; ArduPilot
libraries/AP_InertialSensor/AP_InertialSensor_tempcal.cpp, Tools/scripts/tempcal_IMU.py.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from infield.table.cubic_fit import stated_fit
from infield.table.thermal_table import SettledCurve, TemperatureModel
from ins.records import AXES, InputError
from ins.units import DEG_PER_HOUR
from ins.user_input import read_bounded

PX4, ARDUPILOT = "px4", "ardupilot"
PARAMETER_ENDINGS = {PX4: (".params",), ARDUPILOT: (".parm", ".param")}
NUMBERS = {PX4: (0, 1, 2, 3), ARDUPILOT: (1, 2, 3)}  # that the parameter names use
ARDUPILOT_REFERENCE_DEGC, ARDUPILOT_SCALE = 35.0, 1e6
INT32, FLOAT32 = "6", "9"  # MAV_PARAM_TYPE, the last column of a QGroundControl file
MAX_DEVICE_ID = 2**31 - 1  # an int32 of PX4
MAX_PARAMETER_BYTES = 5_000_000  # chosen: 1,500 parameters of 50 bytes are 75 kB


@dataclass(frozen=True, kw_only=True)
class AutopilotCubic(TemperatureModel):
    """Thermal parameters of one IMU as an autopilot holds them, in recal's units.

    coefficients (3, 4): x, y, z; constant first [deg/h per degC^k] about reference_degC; ArduPilot:
    the constant is 0. number: in the parameter names, from 0 (PX4) or 1 (ArduPilot). device_id:
    PX4's sensor id. stated_error_deg_h, stated_sigma_deg_h (3,): what the file's comments tell of
    its fit and of its table, 0 where nothing.
    """

    autopilot: str
    number: int
    low_degC: float
    high_degC: float
    reference_degC: float
    coefficients: NDArray
    device_id: int = 0
    stated_error_deg_h: NDArray = field(default_factory=lambda: np.zeros(3))
    stated_sigma_deg_h: NDArray = field(default_factory=lambda: np.zeros(3))

    def rounding_deg_h(self) -> float:
        """Largest difference over the range between the cubic and its evaluation on board, in
        float32 throughout.
        """
        T = np.linspace(self.low_degC, self.high_degC, 121)
        x = T.astype(np.float32) - np.float32(self.reference_degC)
        coefficients = (self.coefficients * DEG_PER_HOUR).astype(np.float32)
        on_board = np.polynomial.polynomial.polyval(x, coefficients.T).T
        return float(np.max(np.abs(on_board / DEG_PER_HOUR - self.offset_deg_h(T))))

    @property
    def curves(self) -> Mapping[str, SettledCurve]:
        """What the autopilot subtracts of each gyro; ArduPilot's less its value at Tcal."""
        span = (self.low_degC, self.high_degC)
        return {axis: SettledCurve(span, partial(self._value, k)) for k, axis in enumerate(AXES)}

    def offset_deg_h(self, temperature_degC: NDArray) -> NDArray:
        """What the autopilot subtracts, shape (k, 3), at temperatures (k,) of all three gyros."""
        return self.settled_deg_h(np.repeat(np.asarray(temperature_degC)[:, None], len(AXES), 1))

    def _value(self, gyro: int, temperature_degC: NDArray) -> NDArray:
        x = np.clip(temperature_degC, self.low_degC, self.high_degC) - self.reference_degC
        return np.asarray(np.polynomial.polynomial.polyval(x, self.coefficients[gyro]))


def parameters(cubic: AutopilotCubic) -> dict[str, float]:
    """Parameter names and values, in the order of the autopilot's own tool."""
    c, n = cubic.coefficients * DEG_PER_HOUR, cubic.number
    if cubic.autopilot == PX4:
        head = {
            f"TC_G{n}_ID": float(cubic.device_id),
            f"TC_G{n}_TMAX": cubic.high_degC,
            f"TC_G{n}_TMIN": cubic.low_degC,
            f"TC_G{n}_TREF": cubic.reference_degC,
        }
        return head | {
            f"TC_G{n}_X{k}_{axis}": float(c[axis, k]) for k in range(4) for axis in range(3)
        }
    head = {
        f"INS_TCAL{n}_ENABLE": 1.0,
        f"INS_TCAL{n}_TMIN": cubic.low_degC,
        f"INS_TCAL{n}_TMAX": cubic.high_degC,
    }
    return head | {
        f"INS_TCAL{n}_GYR{k}_{name.upper()}": float(c[axis, k] * ARDUPILOT_SCALE)
        for k in range(1, 4)
        for axis, name in enumerate(AXES)
    }


def file_text(cubic: AutopilotCubic, comments: Sequence[str]) -> str:
    """The file that QGroundControl (PX4) or a ground station of ArduPilot loads; comments begin
    with #.
    """
    lines = [f"# {line}" for line in comments]
    values = parameters(cubic)
    if cubic.autopilot == ARDUPILOT:
        return "\n".join([*lines, *(f"{name} {_decimal(v)}" for name, v in values.items())]) + "\n"
    lines += ["#", "# Vehicle-Id Component-Id Name Value Type"]
    for name, value in values.items():
        whole = name.endswith("_ID")
        lines.append(
            "\t".join(
                [
                    "1",
                    "1",
                    name,
                    str(int(value)) if whole else _decimal(value),
                    INT32 if whole else FLOAT32,
                ]
            )
        )
    return "\n".join(lines) + "\n"


def read_parameters(path: Path) -> dict[str, float]:
    """Names and values of a parameter file: QGroundControl's five columns, or `NAME VALUE` with
    space, comma or =.

    Lines of other forms and # comments are passed over. InputError where the file cannot be read or
    gives one name twice.
    """
    found: dict[str, float] = {}
    for number, line in enumerate(_text(path).splitlines(), start=1):
        cells = re.split(r"[\s,=]+", line.split("#")[0].strip())
        if len(cells) == 5 and cells[0].isdecimal():
            name, value = (cells[2], cells[3])
        else:
            name, value = (cells + ["", ""])[:2]
        if not re.fullmatch(r"(TC_G\d|INS_TCAL\d)_\w+", name):
            continue
        try:
            read = float(value)
        except ValueError:
            read = float("nan")
        if not np.isfinite(read):
            raise InputError(
                f"{path}: line {number}: {name}: got {value[:40]!r}, needed a finite number"
            )
        if name in found and found[name] != read:
            raise InputError(f"{path}: line {number}: {name}: {read:g} after {found[name]:g}")
        found[name] = read
    return found


def _text(path: Path) -> str:
    try:
        return read_bounded(path, MAX_PARAMETER_BYTES).decode("utf-8-sig", "replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None


def read_cubic(
    path: Path, *, autopilot: str | None = None, number: int | None = None
) -> AutopilotCubic:
    """The thermal parameters of one IMU in a file; which one must be said where several are in
    use.
    """
    values = read_parameters(path)
    held = [(p, n) for p, numbers in NUMBERS.items() for n in numbers if _in_use(values, p, n)]
    if autopilot is not None:
        held = [(p, n) for p, n in held if p == autopilot]
    if number is not None:
        held = [(p, n) for p, n in held if n == number]
    if not held:
        wanted = f" of {autopilot or 'PX4 or ArduPilot'}" + (
            "" if number is None else f", IMU {number}"
        )
        off = "; ".join(
            f"{k} is {v:g}" for k, v in values.items() if k.endswith(("_ENABLE", "_ID"))
        )
        raise InputError(
            f"{path}: no thermal gyro parameters in use{wanted} ({off or 'none named'})"
        )
    if len(held) > 1:
        raise InputError(
            f"{path}: several: {', '.join(f'{p} {n}' for p, n in held)}; needed one (--from, --imu)"
        )
    comments = (
        (k, line.partition("#")[2]) for k, line in enumerate(_text(path).splitlines(), start=1)
    )
    error, sigma = stated_fit(comments, file=str(path))
    return replace(
        cubic_of(values, *held[0], name=str(path)),
        stated_error_deg_h=error,
        stated_sigma_deg_h=sigma,
    )


def cubic_of(
    values: Mapping[str, float], autopilot: str, number: int, *, name: str
) -> AutopilotCubic:
    """Parameters to coefficients; InputError names what is missing or contradicts itself."""
    stem = f"TC_G{number}_" if autopilot == PX4 else f"INS_TCAL{number}_"

    def value(key: str) -> float:
        if stem + key not in values:
            raise InputError(f"{name}: {stem}{key} is missing")
        return values[stem + key]

    low, high = value("TMIN"), value("TMAX")
    if not -100.0 <= low < high <= 200.0:
        raise InputError(f"{name}: {stem}TMIN {low:g}, TMAX {high:g}: needed TMIN below TMAX, degC")
    c = np.zeros((3, 4))
    for axis, letter in enumerate(AXES):
        for k in range(4):
            if autopilot == PX4:
                c[axis, k] = value(f"X{k}_{axis}") / DEG_PER_HOUR
            elif k:
                c[axis, k] = value(f"GYR{k}_{letter.upper()}") / ARDUPILOT_SCALE / DEG_PER_HOUR
    return AutopilotCubic(
        autopilot=autopilot,
        number=number,
        low_degC=low,
        high_degC=high,
        coefficients=c,
        reference_degC=value("TREF") if autopilot == PX4 else ARDUPILOT_REFERENCE_DEGC,
        device_id=int(value("ID")) if autopilot == PX4 else 0,
    )


def _in_use(values: Mapping[str, float], autopilot: str, number: int) -> bool:
    """Named in the file and switched on: PX4 by a sensor id, ArduPilot by ENABLE 1 (2 is still
    learning).
    """
    if autopilot == PX4:
        return values.get(f"TC_G{number}_ID", 0.0) != 0.0
    return values.get(f"INS_TCAL{number}_ENABLE", 0.0) == 1.0


def _decimal(value: float) -> str:
    """The float32 that the autopilot will hold, shortest decimal that gives it back, never with an
    exponent.
    """
    return np.format_float_positional(np.float32(value), unique=True, trim="-")
