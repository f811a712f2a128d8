"""What the name of a column says: the quantity, its axis and its unit, in the words of loggers in
English and German.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ins.records import AXES, InputError
from trajectories.readers.rows.column_map import (
    ACCEL_INCREMENTS,
    ACCEL_RATES,
    CELSIUS,
    GYRO_INCREMENTS,
    GYRO_RATES,
    TIME_UNITS,
)

if TYPE_CHECKING:
    import pandas as pd

# Words of a name, by what they say it holds; the first quantity with one of them counts.
QUANTITIES: dict[str, set[str]] = {
    "time": set("time timestamp stamp zeit t tow sow epoch utc sec seconds millis elapsed".split()),
    "temperature": set("temp temperature temperatur celsius kelvin degc degf".split()),
    "gyro": set(
        "gyro gyr gyros gyroscope omega omg angular rate rot rotation drehrate dtheta dth".split()
    ),
    "accel": set(
        "acc accel accelerometer acceleration specific force beschleunigung dv fib".split()
    ),
    "lat": {"lat", "latitude", "breite"},
    "lon": {"lon", "lng", "long", "longitude", "laenge"},
    "height": {"height", "alt", "altitude", "hoehe", "h", "ellh"},
    "velocity": {"v", "vel", "velocity", "speed", "geschwindigkeit"},
}
# letters that are one word with their axis: wx, gx, ax, fx, vn
SHORT = {"w": "gyro", "g": "gyro", "a": "accel", "f": "accel", "v": "velocity", "t": "temperature"}
LETTERS = {"p": ("gyro", "x"), "q": ("gyro", "y"), "r": ("gyro", "z")}  # body rates
WAYS = {"n": "n", "e": "e", "d": "d", "u": "u", "north": "n", "east": "e", "down": "d", "up": "u"}
WAYS |= {"nord": "n", "ost": "e"}
XYZ = {"x": "x", "y": "y", "z": "z", "n": "x", "e": "y", "d": "z"}  # of a unit that lies north
AXES_OF: dict[str, dict[str, str]] = {"velocity": WAYS, "time": {}, "lat": {}, "lon": {}}
OTHER = r"(mag|magnetometer|mfd|quat|quaternion|q[0-3]|roll|pitch|yaw|heading|bias|std|sigma|est)"
PER_HOUR = {"degh": "deg/h", "dph": "deg/h", "deghr": "deg/h", "degperh": "deg/h"}
SPELLINGS: dict[str, dict[str, str]] = {  # letters and digits of a unit: as a map writes it
    "time": {
        "s": "s", "sec": "s", "secs": "s", "seconds": "s", "ms": "ms", "msec": "ms",
        "millis": "ms", "us": "us", "usec": "us", "micros": "us", "ns": "ns", "nsec": "ns",
    },
    "gyro": {
        "rads": "rad/s", "radsec": "rad/s", "radps": "rad/s", "radpers": "rad/s",
        "mrads": "mrad/s", "degs": "deg/s",
        "degsec": "deg/s", "degps": "deg/s", "dps": "deg/s", "grads": "deg/s", "degpers": "deg/s",
        "arcsecs": "arcsec/s", "rad": "rad", "mrad": "mrad", "urad": "urad", "deg": "deg",
        "arcsec": "arcsec", **PER_HOUR,
    },
    "accel": {
        "ms2": "m/s2", "mps2": "m/s2", "msec2": "m/s2", "mss": "m/s2", "cms2": "cm/s2",
        "mms2": "mm/s2", "fts2": "ft/s2", "g": "g", "gs": "g", "gee": "g", "mg": "mg", "ug": "ug",
        "ms": "m/s", "mps": "m/s", "cms": "cm/s", "mms": "mm/s", "fts": "ft/s",
    },
    "temperature": {
        "c": "degC", "degc": "degC", "celsius": "degC", "gradc": "degC", "k": "K", "kelvin": "K",
        "f": "degF", "degf": "degF",
    },
    "lat": {"deg": "deg", "rad": "rad", "e7": "1e-7 deg", "1e7": "1e-7 deg"},
    "height": {"m": "m", "cm": "cm", "mm": "mm", "ft": "ft"},
    "velocity": {"ms": "m/s", "mps": "m/s", "kmh": "km/h", "kph": "km/h", "kn": "kn", "kt": "kn"},
}  # fmt: skip
SPELLINGS["lon"] = SPELLINGS["lat"]
WORN = {"\u00b5": "u", "\u03bc": "u", "\u00b0": "deg", "\u00b2": "2", "\u03c9": "omega"}
WORN |= {"\u00e4": "ae", "\u00f6": "oe", "\u00fc": "ue"}


@dataclass(frozen=True)
class NamedColumn:
    """What a name says; empty where it says nothing. stem: what columns of one triad share."""

    name: str
    quantity: str = ""
    axis: str = ""
    unit: str = ""
    stem: str = ""


@dataclass(frozen=True, eq=False)
class FrameArrays:
    """Columns of a table in SI units: (n,), (n, 3), (n, 3), (n,) or (n, 3) or None."""

    time_s: NDArray
    gyro_rad_s: NDArray
    accel_m_s2: NDArray
    temperature_degC: NDArray | None


def named(name: str) -> NamedColumn:
    """What the name of a column says.

    Examples
    --------
    >>> named("GyrX [°/s]").unit, named("acc_y_g").axis, named("Drehrate_z").quantity
    ('deg/s', 'y', 'gyro')
    """
    words, in_brackets = _words(name)
    if re.fullmatch(OTHER, words[0]) or not words[0]:
        return NamedColumn(name)
    quantity, axis, rest = _axis(words)
    spelled = SPELLINGS.get(quantity, {})
    units = [in_brackets, *("".join(rest[k:]) for k in range(len(rest)))]
    unit = next((spelled[u] for u in units if u in spelled), "")
    if words[0] in LETTERS or len(words[0]) == 2:  # of wx the w, of p, q, r nothing
        words = [words[0][:-1], *words[1:]]
    stem = "_".join(word for word in words if word not in {*AXES, *WAYS})
    return NamedColumn(name, quantity, axis, unit, stem)


def says_other(name: str) -> bool:
    """Whether a name says what no sensor of a run reads: a magnetometer, a quaternion, a place."""
    return any(re.fullmatch(f"{OTHER}|pos|position", word) for word in _words(name)[0])


def _words(name: str) -> tuple[list[str], str]:
    """The words of a name in small letters, and the unit between its brackets."""
    text = "".join(WORN.get(sign, sign) for sign in name)
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text).lower()
    body, _, unit = re.sub(r"[\])}]", "", re.sub(r"[({]", "[", text)).partition("[")
    words = [word for word in re.split(r"[^a-z0-9]+", body) if word] or [""]
    if len(words) == 1 and (joined := re.fullmatch(r"([a-z]{2,})([xyz])", words[0])):
        if any(joined[1] in known for known in QUANTITIES.values()):
            words = [joined[1], joined[2]]
    if words[-2:] in (["deg", "c"], ["deg", "f"]):
        words[-2:] = ["".join(words[-2:])]
    return words, re.sub(r"[^a-z0-9]", "", unit)


def _axis(words: list[str]) -> tuple[str, str, list[str]]:
    """Quantity, axis, and the words that are neither."""
    first = words[0]
    if len(first) == 2 and first[0] in SHORT and first[1] in (*AXES, "n", "e", "d", "u"):
        return SHORT[first[0]], first[1], words[1:]
    if first in LETTERS:
        return *LETTERS[first], words[1:]
    if first == "t" and len(words) > 1 and words[1] not in SPELLINGS["time"]:
        return "temperature", next((w for w in words if w in AXES), ""), words[1:]
    for quantity, known in QUANTITIES.items():
        at = {k for k, word in enumerate(words) if word.rstrip("0123456789") in known}
        if not at or (quantity == "time" and 0 not in at):
            continue
        turned = AXES_OF.get(quantity, XYZ)
        axes = {k: turned[word] for k, word in enumerate(words) if word in turned and k not in at}
        if quantity in ("gyro", "accel") and not axes:
            continue
        of_unit = SPELLINGS.get(quantity, {})
        taken = {*axes, *(k for k in at if words[k] not in of_unit)}
        rest = [word for k, word in enumerate(words) if k not in taken]
        return quantity, next(iter(axes.values()), ""), rest
    return "", "", words


def triad(columns: Iterable[NamedColumn], quantity: str, axes: str = "xyz") -> list[NamedColumn]:
    """The three columns of one stem, in the order of the axes; empty where there are none."""
    stems: dict[str, dict[str, NamedColumn]] = {}
    for column in columns:
        if column.quantity == quantity and column.axis in axes:
            stems.setdefault(column.stem, {}).setdefault(column.axis, column)
    whole = [of for of in stems.values() if len(of) == len(axes)]
    return [whole[0][axis] for axis in axes] if whole else []


def frame_arrays(frame: "pd.DataFrame") -> FrameArrays:
    """The columns of a pandas table whose names say quantity, axis and unit.

    Raises
    ------
    InputError
        Names what is missing, or the column whose name says no unit.
    """
    if frame.index.name is not None and frame.index.name not in frame.columns:
        frame = frame.reset_index()
    columns = [named(str(name)) for name in frame.columns]
    times = [column for column in columns if column.quantity == "time"]
    if not times:
        raise InputError("columns: none is a time, needed one such as time_s")
    time_s = _values(frame, times[:1], TIME_UNITS)[:, 0]
    sensors = {}
    for quantity, rates, increments, example in (
        ("gyro", GYRO_RATES, GYRO_INCREMENTS, "gyro_x_rad_s"),
        ("accel", ACCEL_RATES, ACCEL_INCREMENTS, "accel_x_m_s2"),
    ):
        three = triad(columns, quantity)
        if not three:
            raise InputError(f"columns: no {quantity} x, y and z, needed three such as {example}")
        values = _values(frame, three, rates | increments)
        if three[0].unit in increments:
            dt_s = np.diff(time_s, prepend=np.nan)
            dt_s[0] = np.median(dt_s[1:]) if dt_s.size > 1 else np.nan
            values = values / dt_s[:, None]
        sensors[quantity] = values
    warm = triad(columns, "temperature") or [c for c in columns if c.quantity == "temperature"][:1]
    degC = None
    if warm:
        factors = {unit: factor for unit, (factor, _) in CELSIUS.items()}
        degC = _values(frame, warm, factors) + CELSIUS[warm[0].unit][1]
        degC = degC[:, 0] if len(warm) == 1 else degC
    return FrameArrays(time_s, sensors["gyro"], sensors["accel"], degC)


def _values(
    frame: "pd.DataFrame", columns: list[NamedColumn], factors: Mapping[str, float]
) -> NDArray:
    """Columns (n, k) in SI units."""
    unit = columns[0].unit
    for column in columns:
        if column.unit not in factors or column.unit != unit:
            known = ", ".join(factors)
            raise InputError(f"column {column.name}: its name says no unit, needed one of {known}")
    try:
        found = frame[[column.name for column in columns]].to_numpy(dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"column {columns[0].name}: not numbers") from None
    return found * factors[unit]
