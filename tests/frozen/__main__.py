"""Asks the frozen inputs again: `compare` prints what moved, `renew` writes the answers."""

import argparse
import json
import sys
import time
from pathlib import Path

from tests.frozen.answers import Answer, differences
from tests.frozen.cases import CASES, Frozen

FOLDER = Path(__file__).parent
DATA = FOLDER.parents[2] / "shared" / "data"


def frozen_answers(kind: str) -> dict[str, Answer]:
    """The answers of a kind by name, as they were written; none where there is no file yet."""
    path = FOLDER / f"{kind}.json"
    return json.loads(path.read_text("utf-8")) if path.exists() else {}


def absent(case: Frozen) -> bool:
    """Whether its recorded log is not beside the project."""
    return bool(case.needs) and not (DATA / case.needs).exists()


def main(arguments: list[str] | None = None) -> int:
    """0: renewed, or nothing moved; 1: something moved, and the table says what."""
    parser = argparse.ArgumentParser(prog="python -m tests.frozen", description=__doc__)
    parser.add_argument("task", choices=("compare", "renew"))
    parser.add_argument("kinds", nargs="*", default=list(CASES), metavar="KIND")
    parser.add_argument("--only", action="append", default=[], metavar="NAME")
    parser.add_argument("--quick", action="store_true", help="the inputs of the normal suite")
    given = parser.parse_args(arguments)
    moved = sum(_ask(kind, given) for kind in given.kinds)
    print(f"{moved} inputs moved")
    return int(moved > 0)


def _ask(kind: str, given: argparse.Namespace) -> int:
    """Asks the inputs of a kind; the number of those that moved."""
    answers, moved = frozen_answers(kind), 0
    for case in CASES[kind]:
        chosen = not given.only or case.name in given.only
        if absent(case) or not chosen or (given.quick and not case.quick):
            continue
        begun = time.process_time()
        now = case.ask()
        spent = f"{time.process_time() - begun:.1f} s"
        if given.task == "renew":
            answers[case.name] = now
            _write(kind, answers)
            print(f"{kind} | {case.name} | {spent}", flush=True)
            continue
        lines = list(differences(answers[case.name], now))
        moved += bool(lines)
        print(f"{kind} | {case.name} | {spent} | {len(lines)} differences", flush=True)
        print(*(f"    {line}" for line in lines), sep="\n", end="\n" if lines else "")
    return moved


def _write(kind: str, answers: dict[str, Answer]) -> None:
    """One line an input, in the order of the cases; what is no case any more is left out."""
    names = [case.name for case in CASES[kind] if case.name in answers]
    rows = [f"{json.dumps(n)}: {json.dumps(answers[n], separators=(',', ':'))}" for n in names]
    (FOLDER / f"{kind}.json").write_text("{\n" + ",\n".join(rows) + "\n}\n", "utf-8")


if __name__ == "__main__":
    sys.exit(main())
