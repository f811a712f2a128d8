"""Scenario files (TOML): what to simulate, every unit in its key's name; an unknown key is an error
that names it.

Sections: top level (schema, seed, alignment_s), run, site, attitude, imu, motion (list), thermal,
unit, twin (inline) or twin_file, streams, lever_arms_m, survey, disturbance (list); truth (a
profile) instead of site, attitude and motion; environment (one, or a list). Ready ones are packaged
in `scenarios/`.
"""

from dataclasses import MISSING, dataclass, field, fields
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import numpy as np
from pydantic import Field, create_model

from ins.json_file import (
    StrictModel,
    parse,
    parse_toml,
    read_small_text,
    refuse_non_finite,
    without_schema,
)
from ins.records import InputError, Site, Survey, TableDocument, TwinModel
from ins.twin_file import default_twin, read_twin, table_path, twin_from_dict
from ins.units import DEG
from trajectories.simulator.chamber import ChamberProfile
from trajectories.simulator.environments.kinds import Environment
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import SEGMENTS, Segment
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import STARTS, ThermalHistory, thermal_history
from trajectories.simulator.truth import Truth, build_truth
from trajectories.simulator.truth_file import (
    TruthProfile,
    TruthSection,
    read_profile,
    refuse_many_parts,
    refuse_many_rows,
    refuse_out_of_range,
)
from trajectories.simulator.unit_truth import ZERO, ThermalTerms, Triple, UnitTruth, aged_unit
from trajectories.simulator.vehicle import EVENTS, Event

SCENARIO_SCHEMA = "recal.scenario/1"
MAX_BYTES = 1_000_000  # of a scenario; the longest packaged one has 1,491
Around = dict[str, str | float]  # an environment as the file has it


@dataclass(frozen=True, kw_only=True)
class RunSection:
    run_id: str = ""
    tail: str = "N123AB"
    start_utc: str = "2026-03-01T05:00:00Z"


@dataclass(frozen=True, kw_only=True)
class SiteSection:
    lat_deg: float
    lon_deg: float
    height_m: float


@dataclass(frozen=True, kw_only=True)
class AttitudeSection:
    """Of the IMU at the start, on the wheels."""

    heading_deg: float = 0.0
    roll_deg: float = 0.0
    pitch_deg: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ImuSection:
    rate_hz: float = 100.0


@dataclass(frozen=True, kw_only=True)
class UnitSection(ThermalTerms):
    """The true unit; `ageing_seed` fixes its curves, so that several sessions can be made of one
    unit.
    """

    imu_serial: str = ""
    gyro_technology: str = ""
    ageing_seed: int = 1
    ageing_offset_deg_h: float = 0.006
    ageing_shape_deg_h: float = 0.004
    table: str = ""


@dataclass(frozen=True, kw_only=True)
class StreamsSection:
    gnss: bool = False
    odometer: bool = False
    phases: bool = True


@dataclass(frozen=True, kw_only=True)
class LeverArmSection:
    wheel_reference: Triple = ZERO
    gnss: Triple = ZERO


@dataclass(frozen=True, kw_only=True)
class SurveySection:
    heading_deg: float | None = None
    sigma_heading_deg: float | None = None
    centre_line_deg: float | None = None
    sigma_centre_line_deg: float | None = None


SECTIONS: dict[str, type] = {
    "run": RunSection,
    "site": SiteSection,
    "attitude": AttitudeSection,
    "imu": ImuSection,
    "unit": UnitSection,
    "streams": StreamsSection,
    "lever_arms_m": LeverArmSection,
    "survey": SurveySection,
}


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A checked scenario file. `table_path`: of the factory table, from the unit or its twin; None:
    a random curve.
    """

    name: str
    seed: int
    alignment_s: float
    run: RunSection
    site: SiteSection
    segments: tuple[Segment, ...]
    thermal: ThermalHistory | ChamberProfile
    twin: TwinModel
    table_path: Path | None = None
    attitude: AttitudeSection = field(default_factory=AttitudeSection)
    imu: ImuSection = field(default_factory=ImuSection)
    unit: UnitSection = field(default_factory=UnitSection)
    streams: StreamsSection = field(default_factory=StreamsSection)
    lever_arms_m: LeverArmSection = field(default_factory=LeverArmSection)
    survey: SurveySection = field(default_factory=SurveySection)
    events: tuple[Event, ...] = ()
    environments: tuple[Environment, ...] = ()
    profile: TruthProfile | None = None


def packaged_scenarios() -> list[str]:
    """Names of the scenarios that come with the program."""
    folder = resources.files("trajectories.simulator") / "scenarios"
    return sorted(
        f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")
    )


def _packaged_text(name: str) -> str:
    folder = resources.files("trajectories.simulator") / "scenarios"
    return (folder / f"{name}.toml").read_text("utf-8")


def scenario_words(name: str) -> str:
    """What a packaged scenario is: the comment that its file begins with."""
    return _packaged_text(name).partition("\n")[0].removeprefix("# ")


def read_scenario(source: Path | str, *, twin_path: Path | None = None) -> Scenario:
    """The scenario in a TOML file, or the packaged one of that name; `twin_path` replaces its twin.

    Raises InputError naming the file and the key, what was got and what was needed.
    """
    path = Path(source)
    if not path.exists() and str(source) in packaged_scenarios():
        text, folder = _packaged_text(str(source)), Path()
    else:
        text, folder = _read_text(path), path.parent
    return scenario_from_dict(
        parse_toml(text, name=str(source)), name=str(source), folder=folder, twin_path=twin_path
    )


def scenario_from_dict(
    data: dict[str, Any], *, name: str, folder: Path = Path(), twin_path: Path | None = None
) -> Scenario:
    """The scenario in a plain dict; paths in it are relative to `folder`, `name` begins each error
    line.
    """
    refuse_non_finite(data, name=name)
    rest = {
        k: v
        for k, v in without_schema(data, SCENARIO_SCHEMA, name=name).items()
        if k not in SECTIONS
    }
    head = fill(_Head, rest, name=name)
    refuse_many_parts("motion", len(head.motion), name=name)
    refuse_many_parts("disturbance", len(head.disturbance), name=name)
    profile = _profile(head, data, folder, name)
    if profile is not None:
        data = {**data, "site": _site_keys(profile.site)}
    elif not head.motion:
        raise InputError(f"{name}: key motion is missing, needed it or [truth]")
    sections = {
        key: fill(cls, data.get(key, {}), name=f"{name}: {key}") for key, cls in SECTIONS.items()
    }
    unit: UnitSection = sections["unit"]
    twin, twin_folder = _twin(
        head, folder, twin_path, name, technology=unit.gyro_technology or "rlg"
    )
    factory_table = folder / unit.table if unit.table else table_path(twin, twin_folder)
    scenario = Scenario(
        name=Path(name).stem,
        seed=head.seed,
        alignment_s=head.alignment_s,
        twin=twin,
        table_path=factory_table,
        segments=tuple(
            _one_of(SEGMENTS, "segment", m, f"{name}: motion[{k}]")
            for k, m in enumerate(head.motion)
        ),
        events=tuple(
            _one_of(EVENTS, "event", e, f"{name}: disturbance[{k}]")
            for k, e in enumerate(head.disturbance)
        ),
        environments=_environments(head.environment, name),
        thermal=_thermal(head.thermal, f"{name}: thermal"),
        profile=profile,
        **sections,
    )
    _refuse_endless(scenario, name)
    return scenario


def _refuse_endless(scenario: Scenario, name: str) -> None:
    """InputError where the run has more rows than can be made; a motion is laid out for its length
    alone.
    """
    if scenario.profile is not None:
        end_s = float(scenario.profile.stretches[-1].end_s)
    else:
        try:
            end_s = lay(scenario.segments, alignment_s=scenario.alignment_s).end_s
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
    refuse_many_rows(end_s, scenario.imu.rate_hz, name=f"{name}: motion")


def _profile(head: "_Head", data: dict[str, Any], folder: Path, name: str) -> TruthProfile | None:
    """The profile of [truth], which says itself where the run starts, how it stands and moves."""
    if head.truth is None:
        return None
    for key in ("site", "attitude", "motion"):
        if key in data:
            raise InputError(f"{name}: {key} and truth are both given, needed one of them")
    if data.get("streams", {}).get("odometer"):
        raise InputError(
            f"{name}: streams.odometer: got true, needed false with truth: it does not say what"
            " rolls"
        )
    section = fill(TruthSection, head.truth, name=f"{name}: truth")
    try:
        return read_profile(section, folder)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _site_keys(site: Site) -> dict[str, float]:
    return {"lat_deg": site.lat_rad / DEG, "lon_deg": site.lon_rad / DEG, "height_m": site.height_m}


def simulate_scenario(
    scenario: Scenario, *, seed: int | None = None, table: TableDocument | None = None
) -> tuple[SimulatedRun, UnitTruth]:
    """One session of the scenario's unit, and that unit; `table` (checked) is its factory table, at
    `table_path`.
    """
    unit = scenario_unit(scenario, table=table)
    seed = scenario.seed if seed is None else seed
    run, survey = scenario.run, scenario.survey
    simulated = simulate_run(
        scenario_ideal(scenario),
        scenario.thermal,
        unit,
        scenario.twin,
        rng=np.random.default_rng(seed),
        plan=SessionPlan(
            with_gnss=scenario.streams.gnss,
            with_odometer=scenario.streams.odometer,
            with_phases=scenario.streams.phases,
            events=scenario.events,
            environments=scenario.environments,
            gnss_lever_arm_m=scenario.lever_arms_m.gnss,
            run_id=run.run_id or f"{scenario.name}-{seed}",
            tail=run.tail,
            start_utc=run.start_utc,
            survey=Survey(
                heading_rad=_radians(survey.heading_deg),
                sigma_heading_rad=_radians(survey.sigma_heading_deg),
                centre_line_rad=_radians(survey.centre_line_deg),
                sigma_centre_line_rad=_radians(survey.sigma_centre_line_deg),
            ),
        ),
    )
    return simulated, unit


def scenario_ideal(scenario: Scenario) -> IdealSensors:
    """The noise-free part, the same for every seed."""
    return ideal_sensors(scenario_truth(scenario), scenario.imu.rate_hz)


def scenario_truth(scenario: Scenario) -> Truth:
    """The motion: of the profile where there is one, else of the segments."""
    if scenario.profile is not None:
        return scenario.profile.truth(scenario.lever_arms_m.wheel_reference)
    site, attitude = scenario.site, scenario.attitude
    return build_truth(
        lay(scenario.segments, alignment_s=scenario.alignment_s),
        Site(lat_rad=site.lat_deg * DEG, lon_rad=site.lon_deg * DEG, height_m=site.height_m),
        heading_rad=attitude.heading_deg * DEG,
        roll_rad=attitude.roll_deg * DEG,
        pitch_rad=attitude.pitch_deg * DEG,
        wheel_reference_m=scenario.lever_arms_m.wheel_reference,
    )


def scenario_unit(scenario: Scenario, *, table: TableDocument | None = None) -> UnitTruth:
    """The scenario's unit: serial and technology from its section, else the table, else the twin;
    they must agree.
    """
    section, twin = scenario.unit, scenario.twin
    serials = {
        "unit.imu_serial": section.imu_serial,
        "table": table["imu_serial"] if table else None,
        "twin": twin.imu_serial,
    }
    serial = _agreed(scenario.name, "imu_serial", serials) or "SN-0042"
    technologies = {
        "unit.gyro_technology": section.gyro_technology,
        "table": table["gyro_technology"] if table else None,
        "twin": twin.gyro_technology,
    }
    return aged_unit(
        np.random.default_rng(section.ageing_seed),
        imu_serial=serial,
        table=table,
        gyro_technology=_agreed(scenario.name, "gyro_technology", technologies),
        ageing_offset_deg_h=section.ageing_offset_deg_h,
        ageing_shape_deg_h=section.ageing_shape_deg_h,
        **{f.name: getattr(section, f.name) for f in fields(ThermalTerms)},
    )


def fill(cls: type, data: Any, *, name: str) -> Any:
    """A dataclass from a plain dict: types, missing and unknown keys are checked against its
    fields.
    """
    if not isinstance(data, dict):
        raise InputError(f"{name}: got {str(data)[:60]!r}, needed a table of keys")
    hints = get_type_hints(cls)
    needed: dict[str, Any] = {
        f.name: (
            _file_type(hints[f.name]),
            ... if f.default is f.default_factory is MISSING else None,
        )
        for f in fields(cls)
    }
    model = parse(create_model(cls.__name__, __base__=StrictModel, **needed), data, name=name)
    given = model.model_dump(exclude_unset=True)
    for key, value in given.items():
        refuse_out_of_range(key, value, name=name)
    try:
        return cls(**{k: tuple(v) if hints[k] == Triple else v for k, v in given.items()})
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _file_type(hint: Any) -> Any:
    return Annotated[list[float], Field(min_length=3, max_length=3)] if hint == Triple else hint


@dataclass(frozen=True, kw_only=True)
class _Head:
    thermal: dict[str, Any]
    motion: list[dict[str, Any]] = field(default_factory=list)
    truth: dict[str, Any] | None = None
    seed: int = 1
    alignment_s: float = 600.0
    twin: dict[str, Any] | None = None
    twin_file: str | None = None
    disturbance: list[dict[str, Any]] = field(default_factory=list)
    environment: Around | list[Around] = field(default_factory=list)


def _twin(
    head: _Head, folder: Path, twin_path: Path | None, name: str, *, technology: str
) -> tuple[TwinModel, Path]:
    """The twin (else the defaults of the technology) and the folder that its table is relative
    to.
    """
    if head.twin is not None and head.twin_file is not None:
        raise InputError(f"{name}: twin and twin_file are both given, needed one of them")
    if twin_path is not None:
        return read_twin(twin_path), twin_path.parent
    if head.twin_file is not None:
        return read_twin(folder / head.twin_file), (folder / head.twin_file).parent
    if head.twin is not None:
        inline = {"schema": "recal.twin/1", **head.twin}
        return twin_from_dict(inline, source=f"{name}: twin", name=f"{name}: twin"), folder
    return default_twin(technology), folder


def _one_of(kinds: dict[str, type], key: str, item: dict[str, Any], name: str) -> Any:
    kind = item.get(key)
    if kind not in kinds:
        raise InputError(f"{name}: {key}: got {str(kind)[:60]!r}, needed one of {', '.join(kinds)}")
    return fill(kinds[kind], {k: v for k, v in item.items() if k != key}, name=f"{name} {kind}")


def _environments(data: Around | list[Around], name: str) -> tuple[Environment, ...]:
    """What [environment] or each [[environment]] says."""
    listed = data if isinstance(data, list) else [data]
    refuse_many_parts("environment", len(listed), name=name)
    found = []
    for k, item in enumerate(listed):
        where = f"{name}: environment[{k}]" if isinstance(data, list) else f"{name}: environment"
        found.append(fill(Environment, item, name=where))
    return tuple(found)


def _thermal(data: dict[str, Any], name: str) -> ThermalHistory | ChamberProfile:
    """A named start, any of its fields replaced; `chamber` is a profile of soaks and ramps."""
    start = data.get("start")
    if start == "chamber":
        return fill(ChamberProfile, {k: v for k, v in data.items() if k != "start"}, name=name)
    if start not in STARTS:
        raise InputError(
            f"{name}: start: got {str(start)[:60]!r}, needed one of {', '.join(STARTS)}, chamber"
        )
    base = thermal_history(start)
    changes = {k: v for k, v in data.items() if k != "start"}
    known = {f.name: getattr(base, f.name) for f in fields(base)}
    merged = {**{k: list(v) if isinstance(v, tuple) else v for k, v in known.items()}, **changes}
    return fill(ThermalHistory, merged, name=name)


def _agreed(scenario: str, key: str, sources: dict[str, str | None]) -> str:
    given = {where: value for where, value in sources.items() if value}
    if len(set(given.values())) > 1:
        said = ", ".join(f"{where} says {value}" for where, value in given.items())
        raise InputError(f"{scenario}: {key}: {said}; needed the same")
    return next(iter(given.values()), "")


def _radians(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else angle_deg * DEG


def _read_text(path: Path) -> str:
    if not path.exists():
        known = ", ".join(packaged_scenarios())
        raise InputError(f"{path}: cannot be read (no such file); packaged scenarios: {known}")
    return read_small_text(path, most_bytes=MAX_BYTES)
