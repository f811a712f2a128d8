"""The help of a command in plain text: options by what they are for, each with what it takes, its
default and its range in words.

Plain, so that no unit in square brackets is read as markup, and without rich, which takes 0.3 s.
"""

import types
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any

INPUT, OUTPUT, METHOD, ADVANCED = "Input", "Output", "Method", "Advanced"
PANELS = (INPUT, OUTPUT, METHOD, ADVANCED)
PANEL_OF = {  # options that several commands share; one without a panel of its own is of METHOD
    "--store": INPUT,
    "--twin": INPUT,
    "--config": INPUT,
    "--thermal-model": INPUT,
    "--serial": INPUT,
    "--technology": INPUT,
    "--mode": INPUT,
    "--revision": INPUT,
    "--output": OUTPUT,
    "--json": OUTPUT,
    "--quiet": OUTPUT,
    "--verbose": OUTPUT,
    "--force": OUTPUT,
    "--from": INPUT,
    "--to": INPUT,
    "--reports": INPUT,
    "--token-file": INPUT,
    "--map": INPUT,
    "--lat-deg": INPUT,
    "--page": OUTPUT,
    "--report": OUTPUT,
    "--gnss": INPUT,
    "--imu": INPUT,
    "--heading-deg": INPUT,
    "--north-to-west-deg": INPUT,
    "--sigma-deg-h": INPUT,
    "--fast": INPUT,
    "--slow": INPUT,
    "--check": INPUT,
    "--hold-out": INPUT,
    "--table": INPUT,
    "--truth": OUTPUT,
    "--table-out": OUTPUT,
    "--twin-out": OUTPUT,
    "--word-bits": OUTPUT,
    "--pages": OUTPUT,
    "--kml": OUTPUT,
    "--csv": OUTPUT,
    "--retry": ADVANCED,
    "--workers": ADVANCED,
    "--cluster": ADVANCED,
    "--override-technology": ADVANCED,
    "--any-size": ADVANCED,
    "--new-store": ADVANCED,
    "--new-unit": ADVANCED,
    "--any-clock": ADVANCED,
    "--seed": ADVANCED,
    "--help": ADVANCED,
}
TYPE_WORDS: dict[Any, str] = {str: "TEXT", int: "NUMBER", float: "NUMBER", Path: "PATH"}
FOLDER = "{folder}"  # in a help text: the folder a command writes to unless -o names one


def help_records(command: Any, path: str) -> dict[str, list[tuple[str, str]]]:
    """Arguments and options with their texts, by panel, in the order to show them.

    path: the command's words, such as "recal table list".
    """
    panels: dict[str, list[tuple[str, str]]] = {"Arguments": [], **{name: [] for name in PANELS}}
    for param in command.params:
        if not getattr(param, "hidden", False):
            panels[panel_of(param)].append((left_of(param), text_of(param, path)))
    panels[ADVANCED].append(("--help", "Show this help."))
    return {name: rows for name, rows in panels.items() if rows}


def panel_of(param: Any) -> str:
    """Under which heading a parameter stands."""
    if is_argument(param):
        return "Arguments"
    own = getattr(param, "rich_help_panel", None)
    shared = (PANEL_OF[flag] for flag in param.opts if flag in PANEL_OF)
    return str(own or next(shared, METHOD))


def is_argument(param: Any) -> bool:
    """Whether it is given by its place, not by a flag."""
    return not param.opts[0].startswith("-")


def usage_words(command: Any) -> list[str]:
    """The line of usage after the command's name."""
    words = ["[OPTIONS]"]
    for param in filter(is_argument, command.params):
        word = takes(param) + ("..." if param.nargs == -1 else "")
        words.append(word if param.required else f"[{word}]")
    return words


def left_of(param: Any) -> str:
    """The flags of an option and what it takes; the name of an argument."""
    if is_argument(param):
        return takes(param)
    flags = ", ".join(param.opts)
    if param.secondary_opts:
        flags += " / " + ", ".join(param.secondary_opts)
    return f"{flags} {takes(param)}".strip()


def takes(param: Any) -> str:
    """What follows a flag, in capitals, or its choices; empty where nothing does."""
    if param.metavar:
        return str(param.metavar).strip("[]") if is_argument(param) else str(param.metavar)
    if is_argument(param):
        return str(param.name).upper().removesuffix("S")
    hint = param.type_descriptor.annotation
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        hint = next(part for part in typing.get_args(hint) if part is not type(None))
    if hint is bool:
        return ""
    if typing.get_origin(hint) is tuple:
        return " ".join(word_of(part) for part in typing.get_args(hint))
    if typing.get_origin(hint) is list:
        hint = typing.get_args(hint)[0]
    return word_of(hint)


def word_of(hint: Any) -> str:
    """A type in a word, an enumeration as its values."""
    if isinstance(hint, type) and hasattr(hint, "__members__"):
        return "|".join(str(member.value) for member in hint.__members__.values())
    return TYPE_WORDS.get(hint, "TEXT")


def text_of(param: Any, path: str) -> str:
    """What a parameter does, whether it is needed, its default and its range."""
    words = path.split()
    said = (param.help or "").replace(FOLDER, "-".join(words[:2]))
    notes = [said]
    if param.required:
        notes.append("Needed.")
    elif (default := default_of(param)) and "efault" not in said:
        notes.append(f"Default: {default}.")
    notes += range_of(getattr(param, "min", None), getattr(param, "max", None))
    return " ".join(filter(None, notes))


def default_of(param: Any) -> str:
    """The default in a word; empty where there is none to tell."""
    value = param.default
    if isinstance(value, bool):
        return str((param.opts if value else param.secondary_opts or [""])[0])
    if value is None or callable(value) or value in ("", (), []):
        return ""
    return f"{value:g}" if isinstance(value, float) else str(getattr(value, "value", value))


def range_of(low: float | None, high: float | None) -> Sequence[str]:
    """The numbers that are allowed, as a sentence."""
    if low is not None and high is not None:
        return [f"From {low:g} to {high:g}."]
    if low is not None:
        return [f"At least {low:g}."]
    return [] if high is None else [f"At most {high:g}."]
