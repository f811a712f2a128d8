"""What every command shares: options, which stream a text goes to, exit codes.

The result goes to standard output: in words, or with --json as one JSON document. Everything else,
progress, notes, warnings and errors, goes to standard error.
"""

import errno
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperCommand

from ins.documents import to_json
from ins.user_input import one_line, visible
from recal.cli.terminal import life
from recal.cli.terminal.help import help_records, usage_words
from recal.cli.terminal.progress import Progress
from recal.cli.terminal.user_config import read_user_config
from recal.service.results.issuer import set_issuer

if TYPE_CHECKING:
    from recal.service.results.result import Result

DONE_EXIT, FAILED_EXIT, USAGE_EXIT, BAD_INPUT_EXIT, REFUSED_EXIT, INCONSISTENT_EXIT = (
    0,
    1,
    2,
    3,
    4,
    5,
)
EXIT_CODES = {
    **dict.fromkeys(
        ("ok", "warnings", "aligned", "replayed", "proposed", "committed", "measured", "fitted"),
        DONE_EXIT,
    ),
    **dict.fromkeys(("approved", "rejected", "usable"), DONE_EXIT),
    **dict.fromkeys(("no_gap", "explained", "partly_explained", "unexplained"), DONE_EXIT),
    "intact": DONE_EXIT,
    "broken": BAD_INPUT_EXIT,
    "up_to_date": DONE_EXIT,
    "failed": FAILED_EXIT,  # of a fleet: nothing new; nothing but breakdowns
    "bad_input": BAD_INPUT_EXIT,
    "level_only": REFUSED_EXIT,
    "refused": REFUSED_EXIT,
    "inconsistent": INCONSISTENT_EXIT,
}
DEFAULT_STORE = "sqlite:///recal.db"

OPTIONAL_VALUE = {"--retry": "3"}  # of an option that no number follows


class Command(TyperCommand):
    """A command whose bad input is an InputError of one line, and with --json also an object on
    standard output.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As typer does; an option of OPTIONAL_VALUE that no number follows gets its own."""
        configured = read_user_config()
        set_issuer(configured)
        ctx.default_map = {"store": configured.store or None, "by": configured.operator or None}
        given = list(args)
        for k in reversed(range(given.index("--") if "--" in given else len(given))):
            if given[k] in OPTIONAL_VALUE and not "".join(given[k + 1 : k + 2]).isdecimal():
                given.insert(k + 1, OPTIONAL_VALUE[given[k]])
        try:
            return super().parse_args(ctx, given)
        except typer.BadParameter as error:
            if error.__cause__ is not None:
                error.message = _fault(error.__cause__)
            raise

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """What follows the name in the line of usage."""
        return usage_words(self)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Options under the headings of recal.cli.terminal.help, in plain text."""
        for panel, rows in help_records(self, ctx.command_path).items():
            with formatter.section(panel):
                formatter.write_dl(rows)

    def get_short_help_str(self, limit: int = 0) -> str:
        """The first paragraph of the help, whole."""
        return " ".join((self.help or "").split("\n\n")[0].split())

    def invoke(self, ctx: Any) -> Any:
        """As typer does; InputError also where the operating system refuses a file that nobody else
        asked about. What the store refuses ends with exit code 4.
        """
        from ins.records import InputError, Refusal

        life.begin(ctx.command_path, quiet=bool(ctx.params.get("quiet")))
        try:
            return super().invoke(ctx)
        except (InputError, OSError) as error:
            # the reader has seen enough
            if isinstance(error, OSError) and error.errno == errno.EPIPE:
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                raise typer.Exit(DONE_EXIT) from None
            if isinstance(error, OSError) and error.strerror is None:
                raise
            line = (
                f"{error.filename or ctx.command_path}: {error.strerror}"
                if isinstance(error, OSError)
                else str(error)
            )
            more = getattr(error, "more", ())
            _emit_fault(ctx, "bad_input", line, more)
            raise InputError(line, more) from error
        except Refusal as refused:
            _emit_fault(ctx, "refused", str(refused))
            say(f"recal: {refused}")
            raise typer.Exit(REFUSED_EXIT) from None
        finally:
            life.clear()
            life.log.info("%s ends", ctx.command_path)


def _fault(error: Any) -> str:
    """What is wrong with an option's value, of the fault that pydantic found in it."""
    from ins.json_file import needed

    first = error.errors()[0]
    words = needed(first["type"], first.get("ctx", {}))
    return words if first["type"] == "value_error" else f"got {first['input']!r}, needed {words}"


def _emit_fault(ctx: Any, verdict: str, line: str, more: Iterable[str] = ()) -> None:
    """With --json, why a command has no result of its own."""
    if ctx.params.get("as_json"):
        emit_json(
            {
                "schema": "recal.error/1",
                "command": ctx.command_path,
                "verdict": verdict,
                "reasons": [line, *more],
            }
        )


def finish(verdict: str) -> None:
    """Ends a command with the exit code of its result's verdict."""
    raise typer.Exit(EXIT_CODES[verdict])


def login_name() -> str:
    """The name that the operating system knows the user by, empty where it knows none."""
    import getpass

    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return ""


def say(text: str, *, quiet: bool = False) -> None:
    """One line that is no part of the result, a note or a warning, on standard error."""
    if not quiet:
        life.clear()
        print(one_line(text), file=sys.stderr)


@dataclass(frozen=True)
class Shown:
    """How a command says what it does and what came out: in words, as JSON, or not at all."""

    as_json: bool
    quiet: bool
    verbose: bool

    def folder(
        self, output: Path | None, schema: str, *others: str, default: str = "", force: bool
    ) -> Path:
        """The folder that a report is written to, which it may be: `output`, else `default`, else
        that of its schema's name. others: what lies beside its JSON.
        """
        from recal.service.results.files import schema_name
        from recal.service.results.overwrite import need_free_report

        folder = output or Path(default or f"recal-{schema_name(schema)}")
        need_free_report(folder, schema, others, force=force)
        return folder

    def progress(self, title: str, steps: int | None, *, compiles: bool = True) -> Progress:
        """A bar on a terminal, told of each step."""
        return Progress(title, quiet=self.quiet, steps=steps, compiles=compiles)

    def say(self, line: str) -> None:
        """A line that is no part of the result."""
        say(line, quiet=self.quiet)

    def answer(self, result: object, lines: Iterable[str], report: Path | None = None) -> None:
        """The result, once, on standard output: its lines and where its report is, or its JSON;
        verbose: whole on standard error, too.
        """
        life.clear()
        if self.verbose:
            print(to_json(result), file=sys.stderr, end="")
        if self.as_json:
            emit_json(result)
        elif not self.quiet:
            print_lines(lines)
            if report is not None:
                print(f"report: {linked(report)}")

    def end(self, found: "Result[Any]", report: Path | None = None) -> None:
        """The result of a verb, and the exit code of its verdict."""
        self.answer(found.document, found.lines(verbose=self.verbose), report)
        finish(found.verdict)


def print_lines(lines: Iterable[str]) -> None:
    """Lines of a result in words, on standard output."""
    life.clear()
    for line in lines:
        print(one_line(line))


def json_line(document: object) -> None:
    """A result as one line of JSON, on standard output at once."""
    print(to_json(document, indent=None), end="", flush=True)


def linked(path: Path) -> str:
    """The path; on a terminal one that a click opens (OSC 8)."""
    if not sys.stdout.isatty() or os.environ.get("TERM") == "dumb":
        return visible(str(path))
    return f"\x1b]8;;{path.absolute().as_uri()}\x1b\\{visible(str(path))}\x1b]8;;\x1b\\"


def emit_json(result: object) -> None:
    """The result and nothing else, on standard output; numbers that are not finite become null."""
    life.clear()
    sys.stdout.write(to_json(result))
