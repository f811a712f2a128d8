"""The command reference, read from the program itself: every command, argument, option, default and
exit code.
"""

import re
from functools import cache
from pathlib import Path
from typing import Any

import typer

from recal.cli import console
from recal.cli.app import app
from recal.cli.terminal.help import default_of, is_argument, panel_of, takes, text_of, usage_words

ROOT = Path(__file__).parents[2]
# pages whose commands are run and compared (docs/examples/run.py), the plainest first
SAMPLES = ("docs/guides", "README.md", "docs", "docs/examples")
SAMPLE_LINES = 12
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
        "inconsistent: the data contradict the model or the table; nothing was committed"
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
        "Made from the program when this site was built. Every command takes `--json`, `-q` and"
        " `-v`. Every command accepts `--seed`; where it is not listed, the command draws no random"
        " numbers.",
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
            *_arguments(name, command),
            *_options(name, command),
            *_sample(name),
        ]
    parts += [_exit_codes(), ""]
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
    return "\n".join(["```", " ".join(["recal", name, *usage_words(command)]), "```"])


def _arguments(name: str, command: Any) -> list[str]:
    found = [p for p in _shown(command) if is_argument(p)]
    rows = [
        f"| `{takes(p)}` | {'yes' if p.required else 'no'} | {_cell(text_of(p, _path(name)))} |"
        for p in found
    ]
    return ["| argument | needed | |", "|---|---|---|", *rows, ""] if rows else []


def _options(name: str, command: Any) -> list[str]:
    found = [p for p in _shown(command) if not is_argument(p)]
    rows = [
        f"| {_flags(p)} | {_code(takes(p))} | {panel_of(p).lower()} | {_code(default_of(p))} |"
        f" {_cell(text_of(p, _path(name)))} |"
        for p in found
    ]
    head = ["| option | takes | kind | default | |", "|---|---|---|---|---|"]
    return [*head, *rows, ""] if rows else []


def _exit_codes() -> str:
    """One line that every page ends with."""
    told = "; ".join(f"{code} {words.split(':')[0]}" for code, words in sorted(WORDS.items()))
    return f"Exit codes: {told}. The index of commands names the verdicts that end with each."


def _sample(name: str) -> list[str]:
    """A call of the command with what it printed, of a page that is run and compared."""
    found = next((s for s in samples() if re.match(rf"recal {re.escape(name)}(?= |$)", s[0])), None)
    if found is None:
        return []
    lines = found[1].rstrip().splitlines()
    if len(lines) > SAMPLE_LINES:
        lines = [*lines[:SAMPLE_LINES], "..."]
    return ["Sample:", "", "```", f"$ {found[0]}", *lines, "```", ""]


@cache
def samples() -> list[tuple[str, str]]:
    """Commands of the pages that are run, each with what it printed."""
    files = [f for place in SAMPLES for f in _markdown(ROOT / place)]
    found: list[tuple[str, str]] = []
    for file in files:
        for block in re.findall(r"^```console\n(.*?)^```$", file.read_text("utf-8"), re.M | re.S):
            for step in re.split(r"^\$ ", block, flags=re.M)[1:]:
                command, _, printed = step.partition("\n")
                if printed.strip() and "|" not in command and ";" not in command:
                    found.append((command, printed))
    return found


def _markdown(place: Path) -> list[Path]:
    return [place] if place.is_file() else sorted(place.glob("*.md"))


def _path(name: str) -> str:
    return f"recal {name}"


def _shown(command: Any) -> list[Any]:
    return [p for p in command.params if not getattr(p, "hidden", False)]


def _flags(param: Any) -> str:
    return ", ".join(f"`{flag}`" for flag in (*param.opts, *param.secondary_opts))


def _code(text: str) -> str:
    return "`" + text.replace("|", "\\|") + "`" if text else ""


def _summary(command: Any) -> str:
    return str(command.help or "").split("\n\n")[0]


def _cell(text: str | None) -> str:
    return _plain(" ".join((text or "").split())).replace("|", "\\|")


def _plain(text: str) -> str:
    """Help is plain text: characters that Markdown would read are escaped."""
    for mark in ("\\", "`", "*", "_", "<", "[", "$"):
        text = text.replace(mark, f"\\{mark}")
    return text
