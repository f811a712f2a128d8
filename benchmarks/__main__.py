"""Studies of the program, by name.

    python -m benchmarks list
    python -m benchmarks run NAME [OPTIONS] [--kept FILE] [--jobs N] [--json] [--write]

`run NAME --help` names the options of a study. --kept appends a line a task as it is done, so that
what was stopped goes on; --write puts the tables into benchmarks/results/NAME.json.
"""

import argparse
import ast
import importlib
import inspect
import json
import os
import shlex
import sys
import typing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks import results
from benchmarks.study import ROOT, Work, commit

STUDIES = {
    "accuracy": "accuracy",
    "against_pyins": "against_pyins",
    "attitude": "attitude",
    "closed_loop": "closed_loop",
    "fleet": "fleet",
    "flights": "flights",
    "fuzz": "fuzz",
    "gap_nulls": "gap_nulls",
    "gap_study": "gap_study",
    "gates": "gate_rates",
    "outlook": "outlook",
    "peers": "peers",
    "real_drives": "real_drives",
    "real_evidence": "real_evidence",
    "recalibration": "recalibration_study",
    "rests": "rests",
    "sources": "sources",
    "speed": "speed",
    "thermal": "thermal_rates",
    "twin_fit": "twin_fit",
}


def words_of(name: str) -> str:
    """What the module of a study says of it; nothing is imported."""
    path = ROOT / "benchmarks" / f"{STUDIES[name]}.py"
    return ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""


def run_of(name: str) -> Callable[..., str]:
    run: Callable[..., str] = importlib.import_module(f"benchmarks.{STUDIES[name]}").run
    return run


def add_options(parser: argparse.ArgumentParser, run: Callable[..., str]) -> None:
    """An option for each keyword of a study; a keyword without a default must be given."""
    hints = typing.get_type_hints(run)
    for name, parameter in inspect.signature(run).parameters.items():
        if parameter.kind is not inspect.Parameter.KEYWORD_ONLY:
            continue
        flag, kind, default = f"--{name.replace('_', '-')}", hints[name], parameter.default
        if kind is bool:
            parser.add_argument(flag, action="store_true")
        elif typing.get_origin(kind) is tuple:
            of = typing.get_args(kind)[0]
            parser.add_argument(flag, type=of, nargs="*", default=default)
        elif default is inspect.Parameter.empty:
            parser.add_argument(flag, type=kind, required=True)
        else:
            parser.add_argument(flag, type=kind, default=default, help=f"default: {default}")


def main(arguments: Sequence[str] | None = None) -> int:
    """0; 1 where a task of the study failed."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("list", help="names of the studies")
    runs = commands.add_parser("run", add_help=False, help="do a study")
    runs.add_argument("name", choices=sorted(STUDIES))
    given, rest = parser.parse_known_args(arguments)
    if given.command == "list":
        for name in sorted(STUDIES):
            first, _, _ = words_of(name).partition("\n\n")
            print(f"{name:20s} {' '.join(first.split())}")
        return 0
    return run_study(given.name, rest)


def run_study(name: str, arguments: list[str]) -> int:
    run = run_of(name)
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks run {name}",
        description=words_of(name),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_options(parser, run)
    own = parser.add_argument_group("of every study")
    own.add_argument("--kept", type=Path, metavar="FILE", help="JSON lines, a task each")
    own.add_argument("--jobs", type=int, default=1, help="processes")
    own.add_argument("--until", default="", metavar="HH:MM", help="UTC: begin no task later")
    own.add_argument("--json", action="store_true", help="print records and text as JSON")
    own.add_argument("--write", action="store_true", help="benchmarks/results/NAME.json")
    options = vars(parser.parse_args(arguments))
    kept, jobs, until, as_json, write = (
        options.pop(key) for key in ("kept", "jobs", "until", "json", "write")
    )
    for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(threads, "1")  # of the workers, which start afresh
    work = Work(kept, jobs, until)
    text = run(work, **options)
    if write:
        command = shlex.join(["python", "-m", "benchmarks", "run", name, *asked(run, options)])
        results.write(name, command, text)
    if as_json:
        document = {"study": name, "commit": commit(), "options": options}
        document |= {"records": work.records, "failed": work.failed, "text": text}
        print(json.dumps(document, default=str))
    else:
        print(text)
    return int(bool(work.failed))


def asked(run: Callable[..., str], options: dict[str, Any]) -> list[str]:
    """The options that differ from the study's own, as they are typed."""
    words = []
    for name, parameter in inspect.signature(run).parameters.items():
        if name not in options or options[name] == parameter.default:
            continue
        value = options[name]
        several = value if isinstance(value, list | tuple) else [value]
        words += [f"--{name.replace('_', '-')}"]
        words += [] if value is True else [str(one) for one in several]
    return words


if __name__ == "__main__":
    sys.exit(main())
