"""Runs the commands of the pages and compares what they print with the text; `--write` puts the new
output in.

A page's blocks marked `console` run in order, in one empty folder, where `data` leads to the
recorded logs, `examples` to the project's own and `recal` is this program. Blocks marked `pycon`
run after them, as one session of Python in that folder. A page that says `<!-- needs: FILE -->` is
skipped where data/FILE is not there. Numbers agree within 2 % or two of their last digit; hashes
and dates may differ.

Example: python docs/examples/run.py docs/examples/ln100.md
"""

import argparse
import doctest
import json
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
PAGES = ("README.md", "docs/*.md", "docs/guides/*.md", "docs/examples/*.md")
BLOCK = re.compile(r"^```console\n(.*?)^```$", re.M | re.S)
SESSION = re.compile(r"^```pycon\n(.*?)^```$", re.M | re.S)
# what a session of Python prints, statement by statement
TYPED = """
import contextlib, io, json, sys, traceback
names = {"__name__": "__main__"}
said = []
for source in json.load(sys.stdin):
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        try:
            exec(compile(source, "page", "single"), names)
        except Exception as error:
            print("".join(traceback.format_exception_only(error)), end="")
    said.append(out.getvalue())
json.dump(said, sys.stdout)
"""
NEEDS = re.compile(r"<!-- needs: (\S+) -->")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?", re.I)
PASSING = re.compile(r"\b[0-9a-f]{12,64}\b|\d{4}-\d\d-\d\dT[\d:.]+Z?")
RELATIVE, LAST_DIGITS = 0.02, 2.0
LONGEST_S = 900


@dataclass(frozen=True)
class Step:
    """One command as typed, and what the page says it prints."""

    command: str
    output: str


def steps_of(block: str) -> list[Step]:
    """A block cut at its prompts; lines that begin with "> " go on with the command."""
    found: list[list[str]] = []
    for line in block.splitlines():
        if line.startswith("$ "):
            found.append([line[2:], ""])
        elif line.startswith("> ") and not found[-1][1]:
            found[-1][0] += "\n" + line[2:]
        else:
            found[-1][1] += line + "\n"
    return [Step(command, output) for command, output in found]


def differences(expected: str, got: str) -> list[str]:
    """Lines that differ beyond the tolerance, as pairs for people; empty where the texts agree."""
    a, b = (PASSING.sub("#", text).rstrip().splitlines() for text in (expected, got))
    if len(a) != len(b):
        return [f"{len(a)} lines, got {len(b)}: {got.strip()[-300:]}"]
    return [f"- {x}\n+ {y}" for x, y in zip(a, b) if not _same(x, y)]


def _same(a: str, b: str) -> bool:
    if NUMBER.sub("#", a).split() != NUMBER.sub("#", b).split():
        return False
    return all(_close(x, y) for x, y in zip(NUMBER.findall(a), NUMBER.findall(b)))


def _close(a: str, b: str) -> bool:
    decimals = (
        len(a.partition(".")[2].partition("e")[0]) if "." in a and "e" not in a.lower() else 0
    )
    slack = LAST_DIGITS * 10.0**-decimals if "." in a else 0.0
    x, y = float(a), float(b)
    return abs(x - y) <= RELATIVE * max(abs(x), abs(y)) + slack


def missing(page: Path, data: Path) -> str:
    """Why a page cannot be run; empty where it can."""
    absent = [name for name in NEEDS.findall(page.read_text("utf-8")) if not (data / name).exists()]
    return f"{data / absent[0]} is not there" if absent else ""


def outputs(page: Path, data: Path) -> list[tuple[Step, str]]:
    """Every command of a page with what it printed, standard output and error together."""
    steps = [step for block in BLOCK.findall(page.read_text("utf-8")) for step in steps_of(block)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "data").symlink_to(data)
        (folder / "examples").symlink_to(ROOT / "examples")
        environment = _environment(folder)
        ran = [(step, _run(step.command, folder, environment)) for step in steps]
        return ran + _session(page, folder, environment)


def typed(page: Path) -> list[Step]:
    """The statements of a page's session of Python, and what the page says they print."""
    blocks = SESSION.findall(page.read_text("utf-8"))
    examples = [e for block in blocks for e in doctest.DocTestParser().get_examples(block)]
    return [Step(example.source, example.want) for example in examples]


def _session(page: Path, folder: Path, environment: dict[str, str]) -> list[tuple[Step, str]]:
    steps = typed(page)
    if not steps:
        return []
    done = subprocess.run(
        [sys.executable, "-c", TYPED],
        cwd=folder,
        env=environment,
        input=json.dumps([step.command for step in steps]),
        text=True,
        timeout=LONGEST_S,
        stdout=subprocess.PIPE,
        check=True,
    )
    return list(zip(steps, json.loads(done.stdout), strict=True))


def _environment(folder: Path) -> dict[str, str]:
    program = folder / ".bin" / "recal"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m recal "$@"\n')
    program.chmod(0o755)
    programs = [str(program.parent), str(Path(sys.executable).parent), os.environ["PATH"]]
    modules = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(modules),
        "PATH": os.pathsep.join(programs),
        "MPLBACKEND": "Agg",
        "OMP_NUM_THREADS": "1",
    }


def _run(command: str, folder: Path, environment: dict[str, str]) -> str:
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=folder,
        env=environment,
        text=True,
        timeout=LONGEST_S,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    return done.stdout


def rewritten(page: Path, ran: list[tuple[Step, str]]) -> str:
    """The page's text with what the commands printed."""
    rest = iter(ran)

    def block(match: re.Match[str]) -> str:
        lines = []
        for _ in steps_of(match[1]):
            step, got = next(rest)
            lines += [
                "$ " + step.command.replace("\n", "\n> "),
                *([got.rstrip()] if got.strip() else []),
            ]
        return "```console\n" + "\n".join(lines) + "\n```"

    def session(match: re.Match[str]) -> str:
        text = ""
        for _ in doctest.DocTestParser().get_examples(match[1]):
            step, got = next(rest)
            first, *more = step.command.rstrip("\n").split("\n")
            text += "\n".join([f">>> {first}", *(f"... {line}".rstrip() for line in more)]) + "\n"
            text += got.rstrip() + "\n" if got.strip() else ""
        return f"```pycon\n{text}```"

    return SESSION.sub(session, BLOCK.sub(block, page.read_text("utf-8")))


def main() -> int:
    """0: all agree; 1: the differences are printed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("pages", nargs="*", type=Path, help="Pages to run (default: all).")
    parser.add_argument("--write", action="store_true", help="Put the new output into the pages.")
    parser.add_argument("--data", type=Path, default=DATA, help="Folder of the recorded logs.")
    given = parser.parse_args()
    failed = False
    for page in given.pages or [p for pattern in PAGES for p in sorted(ROOT.glob(pattern))]:
        if why := missing(page, given.data):
            print(f"{page}: skipped, {why}")
            continue
        ran = outputs(page, given.data.resolve())
        wrong = [
            f"$ {step.command}\n{d}" for step, got in ran for d in differences(step.output, got)
        ]
        if given.write:
            page.write_text(rewritten(page, ran), "utf-8")
        print(
            f"{page}: {len(ran)} commands, {len(wrong)} differences", *wrong, sep="\n", flush=True
        )
        failed |= bool(wrong) and not given.write
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
