"""The command line: the names of the commands; what a command needs is loaded when it is called.

`recal --help` is to take 0.3 s: it makes no command of a verb, loads no library of the verbs, and
writes plain text (rich takes 0.3 s).
"""

import importlib
from collections.abc import Iterator, MutableMapping
from functools import cache
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from recal.cli.console import Command, print_lines
from recal.cli.terminal import life

COMMANDS = {  # in the order of the help, and the module of each
    "demo": "runs",
    "simulate": "runs",
    "look": "logs",
    "convert": "logs",
    "check": "logs",
    "align": "navigation",
    "replay": "navigation",
    "update": "update",
    "watch": "update",
    "misalignment": "misalignment",
    "plan": "gap",
    "diagnose": "gap",
    "serve": "serve",
}
GROUPS = {"table": "table.app", "thermal": "thermal", "fleet": "fleet", "twin": "twin"}


class _Loaded(MutableMapping[str, Any]):
    """Commands by name, in the order of the help, each loaded when it is first asked for and
    built once in a process (15 ms each time, of every command that a test or a service calls).
    """

    def __init__(self) -> None:
        self._found: dict[str, object] = {}
        self._names = [*COMMANDS, *GROUPS]

    def __getitem__(self, name: str) -> Any:
        if name not in self._found:
            if name not in self._names:
                raise KeyError(name)
            self._found[name] = _group(name) if name in GROUPS else _command(name)
        return self._found[name]

    def __setitem__(self, name: str, command: Any) -> None:
        self._found[name] = command

    def __delitem__(self, name: str) -> None:
        del self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@cache
def _command(name: str) -> Any:
    holder = typer.Typer(add_completion=False, rich_markup_mode=None)
    holder.command(name, cls=Command)(getattr(_module(name), name))
    return typer.main.get_command(holder)


@cache
def _group(name: str) -> Any:
    group = typer.main.get_command(_module(name).app)
    group.name = name
    return group


def _module(name: str) -> Any:
    return importlib.import_module(f"recal.cli.{(COMMANDS | GROUPS)[name]}")


def _line_of(name: str) -> str:
    """What a command, or a group of them, says of itself first."""
    module = _module(name)
    text = module.app.info.help if name in GROUPS else getattr(module, name).__doc__
    return " ".join(text.split("\n\n")[0].split())


class Program(TyperGroup):
    """`recal`: its commands are loaded one by one."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = _Loaded()

    def list_commands(self, ctx: Any) -> list[str]:
        """All names, in the order of the help."""
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Names and their lines, without making the commands."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, _line_of(name)) for name in self.commands])


app = typer.Typer(
    name="recal",
    cls=Program,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Strapdown inertial navigation that recalibrates its gyros in the field.",
)


def _show_version(asked: bool) -> None:
    if asked:
        from recal.service.results.files import program_version

        print_lines([f"recal {program_version()}"])
        raise typer.Exit


@app.callback()
def program(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_show_version, help="Print the version and exit."
        ),
    ] = False,
    max_unpacked_mb: Annotated[
        int | None,
        typer.Option(
            "--max-unpacked-mb",
            metavar="NUMBER",
            min=1,
            max=1_000_000,
            help="What a packed file may unpack to [MB], else 268, or 50 times its size; and what"
            " the numbers of a file may take in memory, else 220.",
        ),
    ] = None,
) -> None:
    """What comes before the command."""
    wrong = life.set_log_level()
    if wrong:
        raise typer.BadParameter(wrong)
    if max_unpacked_mb is not None:
        from recal.service.inputs.listings import unpack_limit

        context.with_resource(unpack_limit(max_unpacked_mb))
