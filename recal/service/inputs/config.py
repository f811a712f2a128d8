"""Settings of `recal update` from a TOML file: frozen models, units in key names, an unknown key is
an error.
"""

from dataclasses import fields
from pathlib import Path
from typing import Any

from infield.session.settings import SessionSettings
from infield.table.thermal_table import AgeingModel
from ins.json_file import read_toml, shown
from ins.records import InputError

# Of any setting: the largest is a sigma of some thousand parts a million; its square stays far
# within a float64.
MAX_SETTING = 1e6
CONFIG_SECTIONS: dict[str, type] = {"session": SessionSettings, "ageing": AgeingModel}


def read_config(path: Path | None) -> tuple[SessionSettings, AgeingModel]:
    """Sections [session] and [ageing]; what is not given keeps its default. InputError names file
    and key.
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
    return made["session"], made["ageing"]


def _section(kind: type, values: Any, where: str) -> Any:
    """One section as its record; numbers must be from 0 to MAX_SETTING."""
    if not isinstance(values, dict):
        raise InputError(f"{where}: got {values!r}, needed a section")
    default = kind()
    plain = bool | int | float | dict
    known = [f.name for f in fields(kind) if isinstance(getattr(default, f.name), plain)]
    for key, value in values.items():
        if key not in known:
            raise InputError(f"{where}: unknown key {key!r}, needed one of {', '.join(known)}")
        wanted = getattr(default, key)
        if isinstance(wanted, bool) != isinstance(value, bool) or isinstance(
            wanted, dict
        ) != isinstance(value, dict):
            raise InputError(f"{where}: {key} = {value!r}, needed {type(wanted).__name__}")
        for number in value.values() if isinstance(value, dict) else [value]:
            if not isinstance(number, int | float) or not 0 <= number <= MAX_SETTING:
                raise InputError(
                    f"{where}: {key} = {shown(value)}, needed a number that is not negative, at"
                    f" most {MAX_SETTING:g}"
                )
    merged = {
        k: {**getattr(default, k), **v} if isinstance(v, dict) else v for k, v in values.items()
    }
    record = kind(**merged)
    if isinstance(record, SessionSettings) and record.bin_s < 30.0:
        raise InputError(f"{where}: bin_s = {record.bin_s:g}, needed at least 30")
    return record
