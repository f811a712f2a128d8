"""Twin files (`recal.twin/1`, formats.md section 3): what is believed about one installation.

The records in `ins.records` name the fields and units; this module only checks and fills them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict, cast

from pydantic import Field, create_model

from ins.json_file import (
    JsonObject,
    StrictModel,
    parse,
    read_json_object,
    refuse_non_finite,
    without_schema,
)
from ins.records import (
    GYRO_TECHNOLOGIES,
    AccelNoise,
    EffectDocument,
    FitDocument,
    GyroNoise,
    InputError,
    TemperatureNoise,
    TwinModel,
    check_name,
)

SCHEMA = "recal.twin/1"
TWIN_SECTIONS = ("gyro", "accel", "temperature", "gnss", "odometer", "vehicle")
# the rest are sizes, >= 0
SIGNED = ("scale_factor_ppm", "misalignment_mrad", "bias_ug", "scale_ppm", "crab_mrad")
# Of any number but those below; chosen: 1 g in micro-g, a scale of 100 % in ppm.
MAX_OF_OTHERS = 1e6
# The oscillator of the sway has neither period nor end without these; a ship on its lines has
# 0.01 Hz, a gear 0.3, an engine mount 30. Speeds and a creep beyond leave the place that is
# simulated: 100 m/s for the 2 s of the side motion, half a turn in an hour.
TWIN_RANGES = {
    "sway_hz": (0.001, 1000.0),
    "sway_damping": (0.001, 100.0),
    "sway_m_s": (0.0, 100.0),
    "lateral_noise_m_s": (0.0, 100.0),
    "yaw_creep_arcsec_sqrt_h": (0.0, 648_000.0),
}

# A MEMS unit of the industrial class. Gyro: ADIS16460 data sheet, rev. C: 0.12 deg/sqrt(h), 8 deg/h
# in-run; consumer parts (ICM-20602: 0.004 deg/s/sqrt(Hz) = 0.24 deg/sqrt(h)) are a little worse, so
# rounded up. Accelerometer noise: ICM-20602, 100 ug/sqrt(Hz). Turn-on and random walks: engineering
# estimates, what a factory's thermal trim leaves.
MEMS_GYRO = GyroNoise(
    arw_deg_sqrt_h=0.3,
    bias_instability_deg_h=10.0,
    rate_random_walk_deg_h_sqrt_h=10.0,
    turn_on_deg_h=30.0,
)
MEMS_ACCEL = AccelNoise(
    vrw_ug_sqrt_hz=100.0,
    bias_instability_ug=50.0,
    rate_random_walk_ug_sqrt_h=100.0,
    turn_on_ug=3000.0,
)
MEMS_TEMPERATURE = TemperatureNoise(noise_degC=0.05, resolution_degC=0.01)


Section = Mapping[str, float | Sequence[float]]


class TwinDocument(TypedDict, total=False):
    """A twin as its file holds it (formats.md, section 3); source: where it is part of a report."""

    source: str
    schema: str
    imu_serial: str
    gyro_technology: str
    table: str | None
    gyro: Section
    accel: Section
    temperature: Section
    gnss: Section
    odometer: Section
    vehicle: Section
    effects: Sequence[EffectDocument]
    fit: FitDocument


class _Effect(StrictModel):
    effect: str = Field(min_length=1)
    target: str = Field(min_length=1)
    parameters: dict[str, Any] = Field(default_factory=dict)
    sigma: dict[str, Annotated[float, Field(ge=0.0, allow_inf_nan=False)]] = Field(
        default_factory=dict
    )


class _Fit(StrictModel):
    """`FitDocument`, checked; all may be left out, nothing else stands in it."""

    parameters: list[str]
    values: list[float]
    sigma: list[float | None]
    interval_95: list[list[float | None]] = Field(default_factory=list)
    covariance: list[list[float]] = Field(default_factory=list)
    identified: list[bool] = Field(default_factory=list)
    seconds: list[float] = Field(default_factory=list)
    needed_s: list[float | None] = Field(default_factory=list)
    needed_runs: list[float | None] = Field(default_factory=list)
    not_identified: dict[str, str] = Field(default_factory=dict)
    lines: list[dict[str, float | str]] = Field(default_factory=list)
    axes: list[dict[str, float | str]] = Field(default_factory=list)
    read_below_hz: dict[str, Annotated[float, Field(gt=0.0, allow_inf_nan=False)]] = Field(
        default_factory=dict
    )
    runs: list[str] = Field(default_factory=list)
    method: str = ""


class _TwinHead(StrictModel):
    imu_serial: str = ""
    gyro_technology: Literal["rlg", "fog", "mems"]
    table: Annotated[str, Field(min_length=1)] | None = None
    effects: list[_Effect] = Field(default_factory=list)
    fit: _Fit | None = None


def default_twin(technology: str) -> TwinModel:
    """The defaults of a gyro technology.

    Parameters
    ----------
    technology : str
        One of GYRO_TECHNOLOGIES.

    Returns
    -------
    twin : TwinModel
        The twin of formats.md for rlg and fog, an industrial unit for mems.

    Raises
    ------
    InputError
        On another technology.

    Examples
    --------
    >>> default_twin("mems").gyro.arw_deg_sqrt_h
    0.3
    """
    if technology not in GYRO_TECHNOLOGIES:
        raise InputError(
            f"gyro_technology {technology!r}, needed one of {', '.join(GYRO_TECHNOLOGIES)}"
        )
    twin = TwinModel(gyro_technology=technology, source=f"defaults of {technology}")
    if technology != "mems":
        return twin
    return replace(twin, gyro=MEMS_GYRO, accel=MEMS_ACCEL, temperature=MEMS_TEMPERATURE)


def read_twin(path: Path) -> TwinModel:
    """The twin in a JSON file.

    Parameters
    ----------
    path : Path
        A file of formats.md, section 3.

    Returns
    -------
    twin : TwinModel
        Missing keys take the default of its technology.

    Raises
    ------
    InputError
        Names file and key.
    """
    path = Path(path)
    return twin_from_dict(read_json_object(path), source=str(path), name=str(path))


def table_path(twin: TwinModel, folder: Path) -> Path | None:
    """Where the table of a twin lies.

    Parameters
    ----------
    twin : TwinModel
        As read.
    folder : Path
        The folder of the twin's file.

    Returns
    -------
    path : Path or None
        None where the twin names no table.

    Raises
    ------
    InputError
        Where the table lies outside the folder: a twin comes from somebody else, and shall open
        nothing but its own table. Where it is not there.
    """
    if twin.table is None:
        return None
    path = folder / twin.table
    if "\0" in twin.table or not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(
            f"{twin.source}: table: {twin.table[:100]!r} leaves the folder of the twin, needed a"
            " path within it"
        )
    if not path.exists():
        raise InputError(
            f"{twin.source}: table: {twin.table[:100]!r} is not there, needed the table of the unit"
            " beside the twin, or a twin without the key table"
        )
    return path


def twin_from_dict(data: JsonObject, *, source: str, name: str) -> TwinModel:
    """The twin in a plain dict of formats.md, section 3.

    Parameters
    ----------
    data : dict
        As read.
    source : str
        Kept in the record; reports say with it where the noise model came from.
    name : str
        Each error line begins with it.

    Returns
    -------
    twin : TwinModel
        Missing keys take the default of its technology.

    Raises
    ------
    InputError
        Names the key: unknown, of a wrong type, negative noise, NaN.
    """
    refuse_non_finite(data, name=name)
    model = parse(_twin_model(), without_schema(data, SCHEMA, name=name), name=name)
    check_name(f"{name}: imu_serial", model.imu_serial)
    given = model.model_dump(exclude_unset=True)
    default = default_twin(given["gyro_technology"])
    sections = {
        s: replace(getattr(default, s), **_tuples(given[s])) for s in TWIN_SECTIONS if s in given
    }
    return replace(
        default,
        **sections,
        source=source,
        table=given.get("table"),
        imu_serial=given.get("imu_serial", ""),
        effects=tuple(_effect(item) for item in model.effects),
        fit=None if model.fit is None else _fit(model.fit),
    )


def twin_to_dict(twin: TwinModel) -> TwinDocument:
    """The plain dict of a twin (formats.md, section 3).

    Parameters
    ----------
    twin : TwinModel
        Its `source` is left out.

    Returns
    -------
    data : dict
        `twin_from_dict` makes the same twin of it.
    """
    left_out = {"source"} if twin.fit is not None else {"source", "fit"}
    body = _lists({k: v for k, v in asdict(twin).items() if k not in left_out})
    document: TwinDocument = {"schema": SCHEMA, **body}
    return document


@cache
def _twin_model() -> type[_TwinHead]:
    """The pydantic model, built from the records so that names and defaults exist once."""
    twin = TwinModel()
    sections: dict[str, Any] = {
        name: (_section_model(getattr(twin, name)), None) for name in TWIN_SECTIONS
    }
    return create_model("Twin", __base__=_TwinHead, **sections)


def _section_model(record: Any) -> type[StrictModel]:
    types: dict[str, Any] = {}
    for f in fields(record):
        value = getattr(record, f.name)
        least = -MAX_OF_OTHERS if f.name in SIGNED else 0.0
        low, high = TWIN_RANGES.get(f.name, (least, MAX_OF_OTHERS))
        number: Any = Annotated[float, Field(ge=low, le=high)]
        length = len(value) if isinstance(value, tuple) else None
        kind = (
            number
            if length is None
            else Annotated[list[number], Field(min_length=length, max_length=length)]
        )
        types[f.name] = (kind, None)
    return create_model(type(record).__name__, __base__=StrictModel, **types)


def _fit(item: _Fit) -> FitDocument:
    return cast(FitDocument, item.model_dump(exclude_unset=True))


def _effect(item: _Effect) -> EffectDocument:
    found: EffectDocument = {
        "parameters": item.parameters,
        "effect": item.effect,
        "target": item.target,
    }
    return {**found, "sigma": item.sigma} if item.sigma else found


def _tuples(section: Section) -> dict[str, float | tuple[float, ...]]:
    return {
        k: tuple(map(float, v)) if isinstance(v, Sequence) else float(v) for k, v in section.items()
    }


def _lists(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _lists(v) for k, v in value.items()}
    return [_lists(v) for v in value] if isinstance(value, list | tuple) else value
