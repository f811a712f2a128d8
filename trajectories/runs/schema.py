"""What a run directory may hold (formats.md, section 1): the columns of each stream and the keys of
run.json.

Angles are degrees in the files and radians in the records; `degrees_exact` is the way back.
"""

import datetime
import difflib
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from ins.columns import (
    ACCEL_DEGC,
    ATTITUDE,
    FIX_SIGMA_COLUMNS,
    FIX_TYPE_COLUMN,
    GRADIENT_DEGC,
    GYRO_DEGC,
    INCREMENT_COLUMNS,
    POSITION,
    RATE_COLUMNS,
    VELOCITY,
    degrees_exact,
)
from ins.json_file import JsonObject, complaints, half_unit, without_schema
from ins.records import (
    LEAST_SIGMA_LAT_RAD,
    InputError,
    LatitudeSource,
    RemovedModel,
    RunHeader,
    Site,
    Span,
    Survey,
)
from ins.units import DEG

SCHEMA = "recal.run/1"
# of accelerometers that are accepted: raw ones that read 7.7 m/s^2 are 0.21 off; the nearest units
# (m/s^2 and ft/s^2) are a factor of 3.3 apart
MOST_ACCEPTED_SCALE = 0.3

REQUIRED: dict[str, tuple[str, ...]] = {
    "temperature": ("time_s", *GYRO_DEGC),
    "gnss": ("time_s", *POSITION, *VELOCITY),
    "odometer": ("time_s", "speed_m_s"),
    "phases": ("phase", "start_s", "end_s"),
    "reference": ("time_s", *POSITION, *VELOCITY, *ATTITUDE),
}
OPTIONAL: dict[str, tuple[str, ...]] = {
    "temperature": (*ACCEL_DEGC, "block_degC", *GRADIENT_DEGC, "ambient_degC"),
    "gnss": (*FIX_SIGMA_COLUMNS, FIX_TYPE_COLUMN),
}
STREAMS = ("imu", *REQUIRED)
WHOLE_TRIPLES = (ACCEL_DEGC, GRADIENT_DEGC)  # all three axes or none


def check_columns(stream: str, names: Sequence[str], *, where: str) -> list[str]:
    """What is wrong with the column names of a stream, one line each; empty when nothing is."""
    required = imu_columns(names) if stream == "imu" else REQUIRED[stream]
    optional = OPTIONAL.get(stream, ())
    known = (*required, *optional)
    if stream == "imu" and set(names) & set(INCREMENT_COLUMNS) and set(names) & set(RATE_COLUMNS):
        a, b = (next(n for n in names if n in group) for group in (INCREMENT_COLUMNS, RATE_COLUMNS))
        return [f"{where}: column {b} beside {a}: needed either increments or rates, not both"]
    allowed = (*INCREMENT_COLUMNS, *RATE_COLUMNS, "time_s") if stream == "imu" else known
    wrong = [_unknown(n, allowed) for n in names if n not in known]
    wrong += [f"column {n} appears twice" for n, k in Counter(names).items() if k > 1]
    wrong += [
        f"column {n} is missing, needed {' '.join(required)}" for n in required if n not in names
    ][:1]
    for triple in WHOLE_TRIPLES:
        given = [n for n in triple if n in names]
        if triple[0] in optional and 0 < len(given) < 3:
            wrong.append(f"column {given[0]} needs all of {' '.join(triple)}")
    return [f"{where}: {line}" for line in wrong]


def imu_columns(names: Iterable[str]) -> tuple[str, ...]:
    """The imu columns in order: those of rates where the file names more of them, else of
    increments.
    """
    given = set(names)
    rates = len(given & set(RATE_COLUMNS)) > len(given & set(INCREMENT_COLUMNS)) or (
        not given & set(INCREMENT_COLUMNS) and any(n.startswith(("gyro_", "accel_")) for n in given)
    )
    return ("time_s", *(RATE_COLUMNS if rates else INCREMENT_COLUMNS))


def _unknown(name: str, known: Sequence[str]) -> str:
    if not name or name.startswith(("Unnamed:", "__index_level_")):
        return f"column {name!r} is a table index: write the file without it"
    stem = re.match(
        r"(?:(?:gyro|accel|dtheta|dv|gradient)_[xyz]|time|lat|lon|height|speed|v[ned])_", name
    )
    same = [k for k in known if stem and k.startswith(stem.group())]
    if same:
        return f"unknown column {name}: the unit must be as in {same[0]}"
    near = difflib.get_close_matches(name, known, n=1)
    return f"unknown column {name}" + (
        f" (did you mean {near[0]}?)" if near else f", needed among: {' '.join(known)}"
    )


@dataclass(frozen=True, kw_only=True)
class SourceFile:
    """A file that a run was made from: its name and the hash of its bytes."""

    source: str
    source_sha256: str


@dataclass(frozen=True, kw_only=True)
class SimulationRecord:
    """What the simulator made a run from, as run.json keeps it: such a run is no recording."""

    scenario: str
    seed: int


@dataclass(frozen=True, kw_only=True)
class ConversionRecord:
    """Where the run of a converted log came from, as run.json keeps it.

    format: of the log; time_shift_s: subtracted from the log's own times; repaired: what the reader
    repaired; other_sources: files read beside the log.
    """

    source: str
    source_sha256: str
    format: str
    time_shift_s: float
    notes: tuple[str, ...] = ()
    repaired: tuple[Span, ...] = ()
    other_sources: tuple[SourceFile, ...] = ()

    def to_json(self) -> dict[str, object]:
        """The keys of `conversion` in run.json."""
        out: dict[str, object] = {
            "source": self.source,
            "source_sha256": self.source_sha256,
            "format": self.format,
            "time_shift_s": self.time_shift_s,
            "notes": list(self.notes),
            "repaired": [[s.start_s, s.end_s, s.reason] for s in self.repaired],
        }
        if self.other_sources:
            out["other_sources"] = [vars(file) for file in self.other_sources]
        return out


class _Open(BaseModel):
    """Keys of run.json that this version does not know are kept and reported, not refused."""

    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False, frozen=True)


class _SiteKeys(_Open):
    lat_deg: float = Field(ge=-90, le=90)
    lon_deg: float = Field(ge=-360, le=360)
    height_m: float = Field(ge=-1000, le=30000)
    sigma_lat_deg: float = Field(default=LEAST_SIGMA_LAT_RAD / DEG, gt=0, le=90)
    lat_source: LatitudeSource = Field(default=LatitudeSource.GIVEN, strict=False)

    @model_validator(mode="before")
    @classmethod
    def _by_its_digits(cls, site: Any) -> Any:
        """A latitude without a sigma is as well known as its last digit, at best to 0.001 deg."""
        if not isinstance(site, dict) or site.get("sigma_lat_deg") is not None:
            return site
        lat_deg = site.get("lat_deg")
        if isinstance(lat_deg, bool) or not isinstance(lat_deg, float | int):
            return site
        if not abs(lat_deg) <= 90.0:
            return site
        return {**site, "sigma_lat_deg": max(half_unit(lat_deg), LEAST_SIGMA_LAT_RAD / DEG)}


_Vector = Annotated[list[float], Field(min_length=3, max_length=3)]


def _one_line(text: str) -> str:
    if not text.isprintable():
        raise ValueError("text without line ends and control characters")
    return text


def _hexadecimal(text: str) -> str:
    if not re.fullmatch("[0-9a-f]{64}", text):
        raise ValueError("null or 64 hexadecimal digits")
    return text


_Text = Annotated[str, Field(max_length=200), AfterValidator(_one_line)]
_Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_one_line)]


class _LeverArms(_Open):
    wheel_reference: _Vector = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    gnss: _Vector = Field(default_factory=lambda: [0.0, 0.0, 0.0])


class _SurveyKeys(_Open):
    heading_deg: Annotated[float, Field(ge=-360, le=360)] | None = None
    sigma_heading_deg: Annotated[float, Field(gt=0)] | None = None
    centre_line_deg: Annotated[float, Field(ge=-360, le=360)] | None = None
    sigma_centre_line_deg: Annotated[float, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _each_with_its_sigma(self) -> "_SurveyKeys":
        for key in ("heading_deg", "centre_line_deg"):
            if getattr(self, key) is not None and getattr(self, f"sigma_{key}") is None:
                raise ValueError(f"sigma_{key} beside {key}")
        return self


class _SimulationKeys(_Open):
    """`simulation` of run.json."""

    scenario: str
    seed: int


class _ModelKeys(_Open):
    sha256: Annotated[str, AfterValidator(_hexadecimal)]
    part: Literal["all", "rates"]
    run_sha256: Annotated[str, AfterValidator(_hexadecimal)]


class _RunKeys(_Open):
    run_id: _Name
    tail: _Text = ""
    imu_serial: _Name
    gyro_technology: Literal["rlg", "fog", "mems"]
    start_utc: str
    site: _SiteKeys
    lever_arms_m: _LeverArms = _LeverArms()
    applied_table_sha256: Annotated[str, AfterValidator(_hexadecimal)] | None = None
    gyro_mode: _Text = ""
    survey: _SurveyKeys | None = None
    removed_thermal_model: _ModelKeys | None = None
    gyro_level_removed: bool = False
    accepted_accelerometer_scale: Annotated[float, Field(ge=0, le=MOST_ACCEPTED_SCALE)] = 0.0
    accepted_constant_temperature: bool = False
    any_attitude: bool = False
    conversion: dict[str, Any] = Field(default_factory=dict)
    simulation: _SimulationKeys | None = None

    @model_validator(mode="after")
    def _accepted_of_mems(self) -> "_RunKeys":
        if self.accepted_accelerometer_scale and self.gyro_technology != "mems":
            raise ValueError(
                "accepted_accelerometer_scale of mems units only: others level by accelerometers"
                " good to a thousandth"
            )
        return self

    @field_validator("start_utc")
    @classmethod
    def _utc(cls, text: str) -> str:
        try:
            offset = datetime.datetime.fromisoformat(text).utcoffset()
        except ValueError:
            offset = None
        if offset != datetime.timedelta(0):
            raise ValueError("a UTC time such as 2026-03-01T05:00:00Z")
        return text


# keys of run.json and the fields of the header that hold them
FIELDS = ("run_id", "tail", "imu_serial", "gyro_technology", "start_utc")
LATER_FIELDS = ("applied_table_sha256", "gyro_mode")
SWITCHES = {  # written where they are set
    "gyro_level_removed": "level_removed",
    "accepted_accelerometer_scale": "accepted_accel_scale",
    "accepted_constant_temperature": "accepted_constant_temperature",
    "any_attitude": "any_attitude",
}
# in every run.json; the default is taken with a warning
EXPECTED = ("tail", "lever_arms_m", "applied_table_sha256")


def header_from_json(
    data: JsonObject, *, name: str
) -> tuple[RunHeader | None, list[str], list[str]]:
    """The header in run.json, the errors (header None then) and the warnings, one line each."""
    try:
        keys = _RunKeys.model_validate(without_schema(data, SCHEMA, name=name))
    except InputError as error:
        return None, [str(error)], []
    except ValidationError as error:
        return None, complaints(error, _RunKeys, name=name), []
    warnings = [f"{name}: unknown key {key}, not used" for key in _unused(keys)]
    warnings += [
        f"{name}: key {k} is missing, taken as {_default(k)}" for k in EXPECTED if k not in data
    ]
    survey, removed = keys.survey or _SurveyKeys(), keys.removed_thermal_model
    model = None
    if removed is not None:
        parts = {"sha256": removed.sha256, "part": removed.part, "run_sha256": removed.run_sha256}
        model = RemovedModel(**parts)
    header = RunHeader(
        **{key: getattr(keys, key) for key in (*FIELDS, *LATER_FIELDS)},
        **{field: getattr(keys, key) for key, field in SWITCHES.items()},
        site=_site(keys.site),
        wheel_reference_m=_xyz(keys.lever_arms_m.wheel_reference),
        gnss_lever_arm_m=_xyz(keys.lever_arms_m.gnss),
        survey=Survey(
            **{
                k.replace("_deg", "_rad"): _rad(getattr(survey, k))
                for k in type(survey).model_fields
            }
        ),
        removed_model=model,
    )
    return header, [], warnings


def unknown_keys(keys: Iterable[str], site_keys: Iterable[str]) -> list[str]:
    """Of a run.json that may lack keys: those that no run.json has, its site's among them."""
    return [k for k in keys if k != "schema" and k not in _RunKeys.model_fields] + [
        f"site.{k}" for k in site_keys if k not in _SiteKeys.model_fields
    ]


def header_to_json(
    header: RunHeader,
    *,
    conversion: ConversionRecord | None = None,
    simulation: SimulationRecord | None = None,
) -> dict[str, Any]:
    """run.json as a plain dict; `conversion` says where a converted log came from, `simulation`
    that the run is no recording.
    """
    site, survey = header.site, header.survey
    return {
        "schema": SCHEMA,
        **{key: getattr(header, key) for key in FIELDS},
        "site": {
            "lat_deg": _deg(site.lat_rad),
            "lon_deg": _deg(site.lon_rad),
            "height_m": float(site.height_m),
            "sigma_lat_deg": _deg(site.sigma_lat_rad),
            "lat_source": site.lat_source.value,
        },
        "lever_arms_m": {
            "wheel_reference": list(map(float, header.wheel_reference_m)),
            "gnss": list(map(float, header.gnss_lever_arm_m)),
        },
        **{key: getattr(header, key) for key in LATER_FIELDS},
        "survey": {
            k: _deg(getattr(survey, k.replace("_deg", "_rad"))) for k in _SurveyKeys.model_fields
        },
        **({"removed_thermal_model": vars(header.removed_model)} if header.removed_model else {}),
        **{
            key: getattr(header, field) for key, field in SWITCHES.items() if getattr(header, field)
        },
        **({"conversion": conversion.to_json()} if conversion else {}),
        **({"simulation": vars(simulation)} if simulation else {}),
    }


def _site(keys: _SiteKeys) -> Site:
    return Site(
        lat_rad=keys.lat_deg * DEG,
        lon_rad=keys.lon_deg * DEG,
        height_m=keys.height_m,
        sigma_lat_rad=keys.sigma_lat_deg * DEG,
        lat_source=keys.lat_source,
    )


def _deg(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else float(degrees_exact(angle_rad))


def _rad(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else angle_deg * DEG


def _xyz(values: list[float]) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _default(key: str) -> str:
    return {"tail": "''", "lever_arms_m": "zero", "applied_table_sha256": "null (raw gyro output)"}[
        key
    ]


def _unused(keys: _Open, prefix: str = "") -> list[str]:
    names = [prefix + k for k in keys.model_extra or {}]
    for name in type(keys).model_fields:
        value = getattr(keys, name)
        names += _unused(value, f"{prefix}{name}.") if isinstance(value, _Open) else []
    return names
