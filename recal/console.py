"""What every command shares: options, text on standard error, JSON on standard output, exit codes."""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

DONE, USAGE, BAD_INPUT, REFUSED, INCONSISTENT = 0, 2, 3, 4, 5
DEFAULT_STORE = "sqlite:///recal.db"

JsonFlag = Annotated[bool, typer.Option("--json", help="Print exactly the result JSON on standard output.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Say nothing but errors.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Say more: the whole result on standard error.")]
Seed = Annotated[int | None, typer.Option("--seed", help="Seed of the random generator.")]
NoSeed = Annotated[
    int | None, typer.Option("--seed", help="Accepted by every command; this one draws no random numbers.")
]
StoreUrl = Annotated[str, typer.Option("--store", help="SQLAlchemy URL of the table store.")]
OutputPath = Annotated[Path | None, typer.Option("-o", "--output", help="Where to write (created).")]


def say(text: str, *, quiet: bool = False) -> None:
    """One line for people, on standard error."""
    if not quiet:
        print(text, file=sys.stderr)


def say_all(result: dict[str, Any], *, verbose: bool) -> None:
    """With -v: the whole result, on standard error."""
    if verbose:
        print(result_text(result), file=sys.stderr, end="")


def emit_json(result: dict[str, Any]) -> None:
    """The result and nothing else, on standard output; numbers that are not finite become null."""
    sys.stdout.write(result_text(result))


def result_text(result: dict[str, Any]) -> str:
    """The one JSON form of a result, in files and on standard output."""
    return json.dumps(_finite(result), indent=1, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    if (isinstance(value, float) and value != value) or value in (float("inf"), float("-inf")):
        return None
    return value
