"""Column maps: a TOML file that says what the columns of a log mean (examples in examples/maps).

Unknown keys are refused. A sensor's unit decides whether its columns are rates or increments. A
column is named as in the file; in a MATLAB file as `imu.wb[0]` or `imu.wb(:,1)`
(trajectories.readers.columns.mat_columns).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, field_validator, model_validator

from ins.json_file import Json, StrictModel, parse, refuse_non_finite
from ins.records import AXES, InputError
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, MICRO_G, STANDARD_GRAVITY
from trajectories.runs.checks import MAX_RATE_HZ, MIN_RATE_HZ

FOOT = 0.3048  # international foot [m]
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
GYRO_RATES = {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": DEG, "deg/h": DEG_PER_HOUR, "arcsec/s": ARCSEC}
GYRO_INCREMENTS = {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": DEG, "arcsec": ARCSEC}
ACCEL_RATES = {
    "m/s2": 1.0,
    "cm/s2": 1e-2,
    "mm/s2": 1e-3,
    "ft/s2": FOOT,
    "g": STANDARD_GRAVITY,
    "mg": 1e3 * MICRO_G,
    "ug": MICRO_G,
}
ACCEL_INCREMENTS = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "ft/s": FOOT}
SPEEDS = {"m/s": 1.0, "km/h": 1 / 3.6, "kn": 1852 / 3600}
ANGLES_DEG = {"deg": 1.0, "rad": 1 / DEG, "1e-7 deg": 1e-7}
HEIGHTS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": FOOT}
CELSIUS = {"degC": (1.0, 0.0), "K": (1.0, -273.15), "degF": (5 / 9, -160 / 9)}  # factor, offset

# of a site, which run.json keeps together
OF_LATITUDE = ("sigma_lat_deg", "lat_source")
SITE_KEYS = ("lat_deg", "lon_deg", "height_m", *OF_LATITUDE)
PLACEHOLDER = "?"  # of what a starter map leaves to its reader

K = TypeVar("K", bound=BaseModel)
_Axis = Annotated[str, Field(pattern="^[+-]?[xyz]$")]
_Three = Annotated[list[str], Field(min_length=3, max_length=3)]


class LayoutKeys(StrictModel):
    """How rows and columns lie in a file; `format` by the file's content where not given.

    Text: names are in line `names_line` of `header_lines`, the last of them by default, unless
    `columns` gives them; lines that begin with `comment` count nowhere. Binary: `header_bytes`,
    then rows of `dtype`.
    """

    format: Literal["csv", "text", "binary", "parquet", "mat"] | None = None
    columns: Annotated[list[str], Field(min_length=1)] | None = None
    header_lines: Annotated[int, Field(ge=0, le=10_000)] | None = None
    names_line: Annotated[int, Field(ge=1, le=10_000)] | None = None
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = ","
    decimal: Literal[".", ","] = "."
    comment: Annotated[str, Field(min_length=1, max_length=10)] | None = None
    header_bytes: Annotated[int, Field(ge=0)] = 0
    dtype: str | list[str] = "<f8"


class _Columns(StrictModel):
    """Keys that name columns: `column` or `columns`, one name or a list, whichever is written."""

    @model_validator(mode="before")
    @classmethod
    def _alike(cls, keys: Any) -> Any:
        given = dict(keys) if isinstance(keys, Mapping) else {}
        if ("column" in given) == ("columns" in given):
            return keys
        named = given.pop("column", given.pop("columns", None))
        names = [named] if isinstance(named, str) else named
        if "columns" in cls.model_fields:
            return {**given, "columns": names}
        is_one = isinstance(names, list) and len(names) == 1
        return {**given, "column": names[0] if is_one else names}


class TimeKeys(_Columns):
    """The column of time stamps; `epoch`: what they count from, where that gives the date (UTC or
    GPS time).
    """

    column: str
    unit: Literal["s", "ms", "us", "ns"] = "s"
    epoch: Literal["unix", "gps"] | None = None


class FileKeys(_Columns):
    """Another file (relative to the log's folder) on the same clock, and how it is laid out; none:
    the log itself.
    """

    file: str | None = None
    layout: LayoutKeys | None = None
    time: TimeKeys | None = None


class SensorKeys(_Columns):
    """Three columns in the log's own axes x, y, z: value = raw * scale [unit]; the unit says
    increments or rates.
    """

    columns: _Three
    unit: str
    scale: float = 1.0
    kind: Literal["increments", "rates"] | None = None


class TemperatureKeys(FileKeys):
    """One column for all gyros or three in the log's own axes."""

    columns: Annotated[list[str], Field(min_length=1, max_length=3)]
    unit: Literal["degC", "K", "degF"] = "degC"
    scale: float = 1.0

    @field_validator("columns")
    @classmethod
    def _one_or_three(cls, columns: list[str]) -> list[str]:
        if len(columns) == 2:
            raise ValueError("one column or three")
        return columns


class AxesKeys(StrictModel):
    """Which raw axis, with its sign, is each body axis (x forward, y right, z down)."""

    x: _Axis = "x"
    y: _Axis = "y"
    z: _Axis = "z"


class PositionKeys(_Columns):
    """Latitude, longitude [unit], height above the ellipsoid [height_unit]; sigma [m]: horizontal,
    vertical or north, east, down.
    """

    columns: _Three
    unit: Literal["deg", "rad", "1e-7 deg"] = "deg"
    height_unit: Literal["m", "cm", "mm", "ft"] = "m"
    sigma: Annotated[list[str], Field(min_length=2, max_length=3)] | None = None


class VelocityKeys(_Columns):
    """Three columns in the order of `frame`; sigma: one column for all, or three."""

    columns: _Three
    frame: Literal["ned", "enu"] = "ned"
    unit: Literal["m/s", "km/h", "kn"] = "m/s"
    sigma: Annotated[list[str], Field(min_length=1, max_length=3)] | None = None


class FixKeys(_Columns):
    """A column that says how good a fix is: rows below `at_least` have none; scale: whose numbers
    they are, so that they tell the type of the fix too.
    """

    column: str
    at_least: float = 3.0
    scale: Literal["autopilot", "rtklib", "nmea"] | None = None


class GnssKeys(FileKeys):
    """Satellite fixes; without velocities these are differences of the positions (their sigma is
    then needed).
    """

    position: PositionKeys
    velocity: VelocityKeys | None = None
    fix: FixKeys | None = None


class OdometerKeys(FileKeys):
    """Speed along body x."""

    column: str
    unit: Literal["m/s", "km/h", "kn"] = "m/s"
    scale: float = 1.0


class StretchKeys(StrictModel):
    """Every map may say which stretch of the log to take, by the log's own clock [s]; `run` holds
    keys for run.json, those of its site also without [run.site].
    """

    from_s: float = -np.inf
    to_s: float = np.inf
    run: dict[str, Any] = Field(default_factory=dict)

    @field_validator("run")
    @classmethod
    def _with_site(cls, run: dict[str, Json]) -> dict[str, Json]:
        flat = {key: value for key, value in run.items() if key in SITE_KEYS}
        site = run.get("site", {})
        if not flat or not isinstance(site, dict):
            return run
        others = {key: value for key, value in run.items() if key not in SITE_KEYS}
        return {**others, "site": {**site, **flat}}


class MapError(InputError):
    """A fault of a column map. The line begins with "map"; who knows the map's file names it."""


@dataclass(frozen=True)
class LogOptions:
    """The map of a log and the options of the command line as they were given, not checked: each
    reader has a model of its own keys.
    """

    keys: Mapping[str, Any] = field(default_factory=dict)

    def parsed(self, model: type[K]) -> K:
        """The keys as a reader's model. MapError names what is wrong."""
        try:
            refuse_non_finite(dict(self.keys), name="map")
            return parse(model, dict(self.keys), name="map")
        except InputError as error:
            raise MapError(str(error)) from None

    def over(self, others: "LogOptions") -> "LogOptions":
        """These keys, and those of others that these do not have."""
        return LogOptions({**others.keys, **self.keys})


def without_placeholders(
    options: LogOptions, header: Mapping[str, str | float | None]
) -> LogOptions:
    """A map without what `header` says in the place of a PLACEHOLDER of its [run].

    MapError names all that are left.
    """
    left: list[str] = []

    def filled(part: Any, where: str) -> Any:
        kept = {}
        for key, value in part.items():
            is_run = where.startswith("run.")
            if isinstance(value, Mapping):
                kept[key] = filled(value, f"{where}{key}.")
            elif value != PLACEHOLDER:
                kept[key] = value
            elif not (is_run and header.get(key) is not None):
                left.append(f"{where}{key}")
        return kept

    found = LogOptions(filled(options.keys, ""))
    if left:
        raise MapError(f'map: {", ".join(left)}: still "{PLACEHOLDER}", needed its value')
    return found


class ColumnMap(LayoutKeys, StretchKeys):
    """A map file."""

    rate_hz: Annotated[float, Field(ge=MIN_RATE_HZ, le=MAX_RATE_HZ)] | None = None
    time: TimeKeys | None = None
    gyro: SensorKeys
    accel: SensorKeys
    temperature: TemperatureKeys | None = None
    gnss: GnssKeys | None = None
    odometer: OdometerKeys | None = None
    axes: AxesKeys = AxesKeys()


def column_map(options: LogOptions) -> ColumnMap:
    """The map, checked: units, axes of a right-handed set, one source of time."""
    keys = options.parsed(ColumnMap)
    if (keys.time is None) == (keys.rate_hz is None):
        raise MapError("map: needed either a [time] column or rate_hz")
    for name in ("temperature", "gnss", "odometer"):
        part = getattr(keys, name)
        if part is not None and part.time is None and (part.file is not None or keys.time is None):
            raise MapError(f"map: {name}.time: needed, the column of its time stamps")
    _refuse_twice(keys)
    _unit(keys.gyro, "gyro", GYRO_RATES, GYRO_INCREMENTS)
    _unit(keys.accel, "accel", ACCEL_RATES, ACCEL_INCREMENTS)
    M = axis_matrix(keys.axes)
    if round(float(np.linalg.det(M))) != 1:
        drawn = ", ".join(f'{b} = "{getattr(keys.axes, b)}"' for b in AXES)
        raise MapError(f"map: axes {drawn}: needed a right-handed set that uses x, y and z once")
    return keys


def _refuse_twice(keys: ColumnMap) -> None:
    """InputError where a column stands for two things, or a scale makes nothing of all values."""
    time = [keys.time.column] if keys.time else []
    groups = {"gyro and accel": [*time, *keys.gyro.columns, *keys.accel.columns]}
    if keys.gnss is not None:
        groups["gnss"] = [
            *keys.gnss.position.columns,
            *(keys.gnss.velocity.columns if keys.gnss.velocity else []),
        ]
    for name, columns in groups.items():
        twice = [column for column in columns if columns.count(column) > 1]
        if twice:
            raise MapError(f"map: {name}: column {twice[0][:100]} is named twice")
    for name in ("gyro", "accel", "temperature", "odometer"):
        part = getattr(keys, name)
        if part is not None and part.scale == 0.0:
            raise MapError(f"map: {name}.scale: got 0, needed another number")


def stretch_of(keys: StretchKeys) -> dict[str, float]:
    """The stretch that a map asks for, as keys of a column map; none where it asks for none."""
    given = {"from_s": keys.from_s, "to_s": keys.to_s}
    return {name: value for name, value in given.items() if np.isfinite(value)}


def imu_map(
    keys: StretchKeys,
    gyro: Sequence[str],
    accel: Sequence[str],
    *,
    units: tuple[str, str] = ("rad/s", "m/s2"),
    time: TimeKeys | str = "time",
    axes: AxesKeys | None = None,
    warm: str = "",
) -> ColumnMap:
    """The map of a format whose columns are known.

    Parameters
    ----------
    keys : StretchKeys
        The keys of a log's own map, of which the stretch is taken.
    gyro, accel : sequence of three str
        Names of the columns x, y, z.
    units : (str, str)
        Of gyros and accelerometers.
    time : TimeKeys or str
        The column of times; a name: in seconds.
    axes : AxesKeys, optional
        Else those of the log are the body's.
    warm : str
        Name of the column of the gyros' temperature; empty where there is none.
    """
    clock = TimeKeys(column=time) if isinstance(time, str) else time
    sensors = {
        "time": clock.model_dump(),
        "gyro": {"columns": list(gyro), "unit": units[0]},
        "accel": {"columns": list(accel), "unit": units[1]},
        "axes": (axes or AxesKeys()).model_dump(),
    }
    warmth = {"temperature": {"columns": [warm]}} if warm else {}
    return column_map(LogOptions(sensors | warmth | stretch_of(keys)))


def axis_matrix(axes: AxesKeys) -> NDArray:
    """M with v_body = M @ v_raw, shape (3, 3); entries 0 and +-1."""
    M = np.zeros((3, 3))
    for i, name in enumerate(AXES):
        text = getattr(axes, name)
        M[i, AXES.index(text[-1])] = -1.0 if text[0] == "-" else 1.0
    return M


def used_columns(keys: ColumnMap) -> list[str]:
    """The names of the columns that the map reads in the log itself, each once."""
    return list(dict.fromkeys([*keys.gyro.columns, *keys.accel.columns, *other_columns(keys)]))


def other_columns(keys: ColumnMap) -> list[str]:
    """The names of the columns in the log itself that are not, or not only, the imu's."""
    names = [keys.time.column] if keys.time else []
    for part in (keys.temperature, keys.gnss, keys.odometer):
        names += side_columns(part) if part is not None and part.file is None else []
    return names


def side_columns(part: TemperatureKeys | GnssKeys | OdometerKeys) -> list[str]:
    """The names of the columns of a stream beside the imu."""
    names = [part.time.column] if part.time else []
    if isinstance(part, GnssKeys):
        names += (
            part.position.columns
            + (part.position.sigma or [])
            + ([part.fix.column] if part.fix else [])
        )
        return names + (
            part.velocity.columns + (part.velocity.sigma or []) if part.velocity else []
        )
    return names + (part.columns if isinstance(part, TemperatureKeys) else [part.column])


def _unit(
    sensor: SensorKeys, name: str, rates: dict[str, float], increments: dict[str, float]
) -> None:
    if sensor.unit not in rates | increments:
        raise MapError(
            f"map: {name}.unit: got {sensor.unit[:40]!r}, needed one of"
            f" {', '.join(rates | increments)}"
        )
    kind = "rates" if sensor.unit in rates else "increments"
    if sensor.kind not in (None, kind):
        raise MapError(
            f"map: {name}.kind: got {sensor.kind!r}, but {sensor.unit} is a unit of {kind}"
        )


def binary_type(text: str) -> np.dtype:
    """A plain number type such as "<f8" or ">i2"; nothing that could hold Python objects."""
    if not re.fullmatch(r"[<>]?(f[48]|[iu][1248])", text):
        raise MapError(
            f"map: dtype: got {text[:20]!r}, needed f4 f8 i1 i2 i4 i8 u1 u2 u4 u8 after < or >"
        )
    return np.dtype(text)
