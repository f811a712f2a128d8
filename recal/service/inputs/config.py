"""Settings of `recal update` from a TOML file: frozen models, units in key names, an unknown key is
an error.
"""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from infield.session.settings import FIT, FlightPriors, SessionSettings
from infield.table.thermal_table import AgeingModel
from ins.json_file import read_toml, shown
from ins.records import InputError

# Of any setting: the largest is a sigma of some thousand parts a million; its square stays far
# within a float64.
MAX_SETTING = 1e6
CONFIG_SECTIONS: dict[str, type] = {
    "session": SessionSettings,
    "flight": FlightPriors,
    "ageing": AgeingModel,
}
# settings that had one number for all technologies before, and still take one
ONCE_OF_ALL = {"sigma_misalignment_mrad"}
# of what a number divides: bins below it hold no rest, slow errors below it are a fix's own noise
LEAST_SETTING = {
    "bin_s": 30.0,
    "slow_position_s": 1.0,
    "slow_velocity_s": 1.0,
    "deflection_km": 0.001,
}


def read_config(path: Path | None) -> tuple[SessionSettings, AgeingModel]:
    """Sections [session], [flight] and [ageing]; what is not given keeps its default. InputError
    names file and key.
    """
    if path is None:
        return SessionSettings(), AgeingModel()
    data = read_toml(path)
    for key in data:
        if key not in CONFIG_SECTIONS:
            raise InputError(
                f"{path}: unknown key {key!r}, needed one of {', '.join(CONFIG_SECTIONS)}"
            )
    made = {
        name: _section(kind, data.get(name, {}), f"{path}: [{name}]")
        for name, kind in CONFIG_SECTIONS.items()
    }
    return replace(made["session"], flight=made["flight"]), made["ageing"]


def setting_names(kind: type) -> list[str]:
    """The keys of a section, in order: what a number, a switch, a table of numbers or FIT sets."""
    default = kind()
    plain = bool | int | float | dict | str
    return [f.name for f in fields(kind) if isinstance(getattr(default, f.name), plain)]


def _section(kind: type, values: Any, where: str) -> Any:
    """One section as its record; numbers must be from 0 to MAX_SETTING."""
    if not isinstance(values, dict):
        raise InputError(f"{where}: got {values!r}, needed a section")
    default = kind()
    known = setting_names(kind)
    values = {key: _of_each(key, value, default) for key, value in values.items()}
    for key, value in values.items():
        if key not in known:
            raise InputError(f"{where}: unknown key {key!r}, needed one of {', '.join(known)}")
        _check(f"{where}: {key}", value, getattr(default, key))
    merged = {
        k: {**getattr(default, k), **v} if isinstance(v, dict) else v for k, v in values.items()
    }
    record = kind(**merged)
    for key, least in LEAST_SETTING.items():
        got = getattr(record, key, least)
        if got != FIT and got < least:
            raise InputError(f"{where}: {key} = {got:g}, needed at least {least:g}")
    return record


def _of_each(key: str, value: Any, default: Any) -> Any:
    """The number of a key that was one for all technologies is that of each."""
    if key in ONCE_OF_ALL and isinstance(value, int | float):
        return dict.fromkeys(getattr(default, key), value)
    return value


def _check(where: str, value: Any, wanted: Any) -> None:
    """A value must be of its default's kind, its numbers from 0 to MAX_SETTING; FIT, or a number in
    its place.
    """
    if value == wanted == FIT:
        return
    kinds = [(isinstance(v, bool), isinstance(v, dict)) for v in (value, wanted)]
    if kinds[0] != kinds[1]:
        raise InputError(f"{where} = {value!r}, needed {type(wanted).__name__}")
    if isinstance(value, dict) and (unknown := [k for k in value if k not in wanted]):
        raise InputError(f"{where}: unknown key {unknown[0]!r}, needed one of {', '.join(wanted)}")
    for number in value.values() if isinstance(value, dict) else [value]:
        if not isinstance(number, int | float) or not 0 <= number <= MAX_SETTING:
            raise InputError(
                f"{where} = {shown(value)}, needed a number that is not negative, at most"
                f" {MAX_SETTING:g}" + (f', or "{FIT}"' if wanted == FIT else "")
            )
