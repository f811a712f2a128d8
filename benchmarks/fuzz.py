"""Damage what the program reads, again and again, and see that each file costs one clear line.

Targets: a sample of every log format (tests/trajectories/readers/damage.py builds them, so that the
corpus takes no room in the repository), the files of a run directory, and every JSON and TOML
input. A mutation is known by its target, the seed and its number. A finding is any exception but
InputError, a message of more than one line, more than a gigabyte, or a minute. `again`
makes a finding anew.
"""

import json
import re
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.study import Work, table
from infield.store.table_store import TableStore
from infield.table.file import read_table_dict
from infield.thermal.stored_model import read_thermal_model
from ins.json_file import read_toml
from ins.records import InputError
from ins.twin_file import default_twin, read_twin, twin_to_dict
from recal.service.inputs.config import CONFIG_SECTIONS, read_config, setting_names
from tests.trajectories.readers import damage
from tests.trajectories.run_cases import full_run, imu_log, reference_log
from tests.trajectories.test_hostile import table_dict
from trajectories.readers.registry import read_log
from trajectories.readers.rows.column_map import LogOptions, column_map
from trajectories.runs.directory import inspect_run, write_run
from trajectories.simulator.scenario import packaged_scenarios, read_scenario, scenario_ideal

MAPS = Path(__file__).parents[1] / "examples" / "maps"
FEW_ROWS = 30_000  # of a scenario whose motion is made as well
NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
# What takes the place of a number.
WILD = (
    b"0 -0.0 1 -1 1e-300 1e300 1e308 -1e308 1e18 9e99 0.5 1e9 nan inf null true [] {} [1]".split()
)
BYTES_SHARE = 0.4  # of the mutations of text inputs: bytes; the others are numbers
THERMAL = {"schema": "recal.thermal_rlg/1", "imu_serial": "SN-1", "gyro_technology": "rlg"}


class Target(NamedTuple):
    """An input: `write(folder)` makes the whole file and says where, `read(path)` reads it."""

    name: str
    write: Callable[[Path], Path]
    read: Callable[[Path], object]
    is_text: bool


class Finding(NamedTuple):
    """A mutation that did not cost one clear line."""

    target: str
    seed: int
    number: int
    error: str


def targets() -> list[Target]:
    """Every input of the program."""
    found = [
        Target(f"log:{s.name}", _sample(s), _log(s.options), is_text=False) for s in damage.SAMPLES
    ]
    for fmt in ("parquet", "csv", "csv.gz"):
        for stream in ("imu", "temperature", "gnss", "odometer", "phases", "reference"):
            name = f"{stream}.{fmt}"
            found.append(Target(f"run:{name}", _run(name, fmt), _inspect, is_text=fmt == "csv"))
    found.append(Target("json:run", _run("run.json", "csv"), _inspect, is_text=True))
    found.append(Target("json:table", _json(table_dict()), _import_table, is_text=True))
    found.append(Target("json:twin", _json(twin_to_dict(default_twin("rlg"))), read_twin, True))
    found.append(Target("json:thermal", _json(THERMAL), read_thermal_model, is_text=True))
    found.append(Target("toml:settings", _text(settings()), read_config, is_text=True))
    for path in sorted(MAPS.glob("*.toml")):
        found.append(Target(f"toml:map:{path.stem}", _text(path.read_text()), _map, is_text=True))
    folder = resources.files("trajectories.simulator") / "scenarios"
    for name in packaged_scenarios():
        text = (folder / f"{name}.toml").read_text("utf-8")
        found.append(Target(f"toml:scenario:{name}", _text(text), _scenario, is_text=True))
    return found


def settings() -> str:
    """All settings of an update at their defaults."""
    lines = []
    for name, kind in CONFIG_SECTIONS.items():
        lines.append(f"[{name}]")
        default = asdict(kind())
        for key in setting_names(kind):
            value = default[key]
            shown = json.dumps(value).replace(": ", " = ") if value is not None else None
            lines += [f"{key} = {shown}"] if shown is not None else []
    return "\n".join(lines) + "\n"


def mutated(data: bytes, rng: np.random.Generator, *, is_text: bool) -> bytes:
    """The bytes with some of them, or with one to three numbers, replaced."""
    if not is_text or rng.random() < BYTES_SHARE:
        return damage.damaged(data, rng)
    for _ in range(int(rng.integers(1, 4))):
        places = [m.span() for m in NUMBER.finditer(data)]
        if not places:
            return damage.damaged(data, rng)
        a, b = places[int(rng.integers(len(places)))]
        data = data[:a] + WILD[int(rng.integers(len(WILD)))] + data[b:]
    return data


def tried(target: Target, whole: bytes, path: Path, seed: int, number: int) -> str:
    """What was wrong with a mutation; empty where it cost one line, or none."""
    rng = np.random.default_rng([seed, number])
    path.write_bytes(mutated(whole, rng, is_text=target.is_text))
    try:
        with damage.bounded(), np.errstate(all="ignore"):
            target.read(path)
    except InputError as error:
        return "a message of several lines" if "\n" in str(error) else ""
    except Exception as error:
        return f"{type(error).__name__}: {' '.join(str(error).split())[:150]}"
    return ""


def mutate(chosen: list[Target], seed: int, seconds: float) -> tuple[Counter[str], list[Finding]]:
    """Mutations of each target in turn until the time is over: how many of each, and findings."""
    count: Counter[str] = Counter()
    findings: list[Finding] = []
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as folder:
        made = []
        for k, target in enumerate(chosen):
            place = Path(folder, str(k))
            place.mkdir()
            path = target.write(place)
            made.append((target, path, path.read_bytes()))
        for number in _numbers(end):
            for target, path, whole in made:
                if time.monotonic() > end:
                    break
                error = tried(target, whole, path, seed, number)
                count[target.name] += 1
                if error:
                    findings.append(Finding(target.name, seed, number, error))
                path.write_bytes(whole)
    return count, findings


def again(finding: dict[str, object], folder: Path) -> str:
    """What a mutation that is known by target, seed and number costs now."""
    target = next(t for t in targets() if t.name == finding["target"])
    path = target.write(folder)
    seed, number = int(str(finding["seed"])), int(str(finding["number"]))
    return tried(target, path.read_bytes(), path, seed, number)


def _numbers(end: float) -> Iterator[int]:
    number = 0
    while time.monotonic() < end:
        yield number
        number += 1


def _sample(sample: damage.Sample) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / f"log{sample.suffix}"
        sample.write(path)
        return path

    return write


def _log(options: dict[str, object]) -> Callable[[Path], object]:
    return lambda path: read_log(path, LogOptions(options))


def _run(name: str, fmt: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        made = full_run(imu=imu_log(seconds=12))
        write_run(folder / "run", made, reference=reference_log(), fmt=fmt)
        return folder / "run" / name

    return write


def _inspect(path: Path) -> object:
    lines = [finding.text for finding in inspect_run(path.parent).findings]
    if any("\n" in line for line in lines):
        raise ValueError("a finding of several lines")
    return lines


def _json(document: object) -> Callable[[Path], Path]:
    return _text(json.dumps(document, indent=1))


def _text(text: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / "input.txt"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def _import_table(path: Path) -> object:
    document = read_table_dict(path)
    with TableStore.open(f"sqlite:///{path.with_name('fuzz.db')}", create=True) as opened:
        return opened.import_table(document)


def _map(path: Path) -> object:
    return column_map(LogOptions(read_toml(path)))


def _scenario(path: Path) -> object:
    scenario = read_scenario(path)
    end_s = scenario.profile.time_s[-1] if scenario.profile is not None else 0.0
    for segment in scenario.segments:
        end_s += getattr(segment, "duration_s", 60.0) or 0.0
    return scenario_ideal(scenario) if end_s * scenario.imu.rate_hz < FEW_ROWS else scenario


def run(work: Work, *, seconds: float = 60.0, seed: int = 1, only: tuple[str, ...] = ("",)) -> str:
    """only: beginnings of names of targets."""
    ((counts, findings),) = work.each(hunt, [(seconds, seed, list(only))])
    rows = [(name, count) for name, count in counts.items()]
    told = "".join(f"- {json.dumps(finding)}\n" for finding in findings)
    total = f"{sum(counts.values())} mutations, {len(findings)} findings.\n"
    return table(("target", "mutations"), rows) + "\n" + total + told


def hunt(seconds: float, seed: int, only: list[str]) -> tuple[dict[str, int], list[dict]]:
    chosen = [target for target in targets() if target.name.startswith(tuple(only))]
    count, findings = mutate(chosen, seed, seconds)
    return dict(count), [finding._asdict() for finding in findings]
