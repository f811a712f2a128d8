"""The command reference, read from the program itself: every command, argument, option, default and
exit code.
"""

import types
import typing
from pathlib import Path
from typing import Any

import typer

from recal.cli import console
from recal.cli.app import app

PYTHON_TYPES: dict[Any, str] = {
    bool: "",
    str: "TEXT",
    int: "WHOLE NUMBER",
    float: "NUMBER",
    Path: "PATH",
}
WORDS = {
    console.DONE_EXIT: "done",
    console.USAGE_EXIT: "wrong usage: an unknown option or a missing argument",
    console.BAD_INPUT_EXIT: (
        "bad input: one line says which file and key, what was got, what was needed; nothing was"
        " stored"
    ),
    console.REFUSED_EXIT: (
        "refused: what was measured, what was needed; the report is written all the same"
    ),
    console.INCONSISTENT_EXIT: (
        "inconsistent: the data contradict the model or the stored table; nothing was committed"
    ),
}


def command_tree() -> dict[str, Any]:
    """Every command that does something, by its full name ("table list"), in the order of `recal
    --help`.
    """
    return dict(_leaves(typer.main.get_command(app), ""))


def command_pages() -> dict[str, str]:
    """Markdown by page name: an index, and one page for each first word."""
    by_word: dict[str, dict[str, Any]] = {}
    for name, command in command_tree().items():
        by_word.setdefault(name.split()[0], {})[name] = command
    pages = {word: _page(word, commands) for word, commands in by_word.items()}
    return {"index": _index(by_word), **pages}


def _leaves(group: Any, prefix: str) -> Any:
    for name, command in group.commands.items():
        if command.hidden:
            continue
        full = f"{prefix} {name}".strip()
        if hasattr(command, "commands"):
            yield from _leaves(command, full)
        else:
            yield full, command


def _index(by_word: dict[str, dict[str, Any]]) -> str:
    lines = [
        "# Commands",
        "",
        "Made from the program when this site was built.",
        "",
        "| command | does |",
        "|---|---|",
    ]
    for word, commands in by_word.items():
        for name, command in commands.items():
            lines.append(f"| [`recal {name}`]({word}.md) | {_cell(_summary(command))} |")
    lines += [
        "",
        "## Exit codes",
        "",
        "| code | meaning | verdicts that end with it |",
        "|---|---|---|",
    ]
    for code, words in sorted(WORDS.items()):
        verdicts = ", ".join(f"`{v}`" for v, c in console.EXIT_CODES.items() if c == code)
        lines.append(f"| {code} | {words} | {verdicts} |")
    names = "\n".join(by_word)
    return "\n".join([*lines, "", f"```{{toctree}}\n:hidden:\n\n{names}\n```", ""])


def _page(word: str, commands: dict[str, Any]) -> str:
    parts = [f"# recal {word}", ""]
    for name, command in commands.items():
        if name != word:
            parts += [f"## recal {name}", ""]
        parts += [
            *_help(command),
            _usage(name, command),
            "",
            *_arguments(command),
            *_options(command),
        ]
    return "\n".join(parts)


def _help(command: Any) -> list[str]:
    """The help text; its example as a block to copy."""
    lines: list[str] = []
    for paragraph in (command.help or "").replace("\x08", "").split("\n\n"):
        if paragraph.startswith("Example"):
            lead, _, example = paragraph.partition(":")
            lines += [
                f"{lead}:",
                "",
                "```",
                *(line.strip() for line in example.strip().splitlines()),
                "```",
                "",
            ]
        else:
            lines += [_plain(paragraph), ""]
    return lines


def _usage(name: str, command: Any) -> str:
    words = ["recal", name, "[OPTIONS]"]
    for p in _of_kind(command, arguments=True):
        word = (p.metavar or p.name).upper() + ("..." if p.nargs == -1 else "")
        words.append(word if p.required else f"[{word}]")
    return "\n".join(["```", " ".join(words), "```"])


def _arguments(command: Any) -> list[str]:
    found = _of_kind(command, arguments=True)
    rows = [
        f"| `{(p.metavar or p.name).upper()}` | {'yes' if p.required else 'no'} | {_cell(p.help)} |"
        for p in found
    ]
    return ["| argument | needed | |", "|---|---|---|", *rows, ""] if rows else []


def _options(command: Any) -> list[str]:
    found = _of_kind(command, arguments=False)
    rows = [f"| {_flags(p)} | {_kind(p)} | {_default(p)} | {_cell(p.help)} |" for p in found]
    return ["| option | takes | default | |", "|---|---|---|---|", *rows, ""] if rows else []


def _of_kind(command: Any, *, arguments: bool) -> list[Any]:
    params = [p for p in command.params if not getattr(p, "hidden", False)]
    return [p for p in params if (not p.opts[0].startswith("-")) == arguments]


def _flags(param: Any) -> str:
    return ", ".join(f"`{flag}`" for flag in (*param.opts, *param.secondary_opts))


def _kind(param: Any) -> str:
    """What follows the flag; a list may be given several times."""
    hint = param.type_descriptor.annotation
    options = [h for h in typing.get_args(hint) if h is not type(None)]
    if typing.get_origin(hint) in (typing.Union, types.UnionType) and options:
        hint = options[0]
    if typing.get_origin(hint) in (list, tuple):
        return f"{_word(typing.get_args(hint)[0])}, repeated"
    return _word(hint)


def _word(hint: Any) -> str:
    if typing.get_origin(hint) is typing.Literal:
        return " \\| ".join(f"`{a}`" for a in typing.get_args(hint))
    if isinstance(hint, type) and hasattr(hint, "__members__"):
        return " \\| ".join(f"`{m.value}`" for m in hint.__members__.values())
    return PYTHON_TYPES.get(hint, getattr(hint, "__name__", str(hint)))


def _default(param: Any) -> str:
    if param.required:
        return "needed"
    if isinstance(param.default, bool) and param.secondary_opts:
        return f"`{(param.opts if param.default else param.secondary_opts)[0]}`"
    if param.default is None or param.default is False or param.default in ((), []):
        return ""
    return f"`{param.default}`" if not callable(param.default) else ""


def _summary(command: Any) -> str:
    return str(command.help or "").split("\n\n")[0]


def _cell(text: str | None) -> str:
    return _plain(" ".join((text or "").split())).replace("|", "\\|")


def _plain(text: str) -> str:
    """Help is plain text: characters that Markdown would read are escaped."""
    for mark in ("\\", "`", "*", "_", "<", "[", "$"):
        text = text.replace(mark, f"\\{mark}")
    return text
