"""A command made from a verb: types, defaults, ranges and help of its options are those of the
signature and the numpydoc of `recal.service`, and a command says only what differs.

::

    @made_from("recal.service.align", "align")
    def command(shown, run, /, store, twin, output, force): ...

A name before the slash is an argument, one after it an option; `**given` stands for the names in
`asks`, else for all that the verb documents besides. A name is declared by the command (Annotated,
as typer has it), else by the options that commands share, else by the verb. What the command's own
signature and numpydoc say of it goes before what the verb says.

The verb's module is read, not imported: it takes 1 to 3 s to import one, and 0.02 s to read it.

Decision: docs/decisions/0090-commands-from-verbs.md.
"""

import ast
import inspect
import re
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, get_origin

import typer

from recal.cli.console import Shown
from recal.cli.parameters.shared import AT_THE_END, SHARED, by_name

TYPE_OF: dict[str, type] = {"str": str, "int": int, "float": float, "bool": bool}
TYPE_OF |= dict.fromkeys(("AnyPath", "AnyRun", "AnyTable", "AnyTwin", "Path"), Path)
SEVERAL = re.compile(r"(?:Sequence|list)\[(?:\w+\.)*(\w+)\]")
ONE_OF = re.compile(r"\{(.+)\}")  # of numpydoc: {'rlg', 'fog'}
WITHIN = re.compile(r"in \[(\S*), (\S*)\]")  # an end that is left out is no limit
SECTION = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w+\n-{3,}$|\Z)", re.DOTALL | re.MULTILINE)
SAYS_DEFAULT = re.compile(r"\b(Default|Needed)\b")
NOT_SAID = inspect.Parameter.empty
Field = tuple[str, ast.expr | None, ast.expr | None]  # name, type, default


class Choice(StrEnum):
    """The base of what a numpydoc lists; a command gets the text."""


@dataclass(frozen=True)
class Said:
    """What a signature and its numpydoc say of a parameter; kind: its type in words."""

    hint: Any = NOT_SAID
    default: Any = NOT_SAID
    kind: str = ""
    words: str = ""

    def over(self, other: "Said") -> "Said":
        """This one, completed by another."""
        return Said(
            other.hint if self.hint is NOT_SAID else self.hint,
            other.default if self.default is NOT_SAID else self.default,
            self.kind or other.kind,
            self.words or other.words,
        )


def made_from(
    module: str = "", verb: str = "", *more: inspect.Parameter, asks: str = "", **metavars: str
) -> Callable[[Callable[..., None]], "Made"]:
    """A decorator that makes a command of a function and a verb.

    Parameters
    ----------
    module, verb : str
        Where the verb is, and its name: a function, or the dataclass of a request. Without them,
        the command says all that the shared options do not.
    *more : Parameter
        Options that the commands of a group share.
    asks : str
        Names of the options that the command takes together, as **given.
    **metavars : str
        What follows an option in its help.
    """
    shared = SHARED | by_name(*more)
    return lambda function: Made(function, (module, verb), shared, metavars, asks.split())


class Made:
    """A function with the signature of a command, put together when typer asks for it."""

    def __init__(
        self,
        function: Callable[..., None],
        verb: tuple[str, str],
        shared: Mapping[str, inspect.Parameter],
        metavars: Mapping[str, str],
        asks: Sequence[str],
    ) -> None:
        self._function, self._verb = function, verb
        self._shared, self._metavars, self._asks = shared, metavars, asks
        self._text = inspect.getdoc(function) or ""
        self.__name__, self.__module__ = function.__name__, function.__module__
        self.__doc__ = SECTION.sub("", self._text).strip()

    @cached_property
    def _own(self) -> list[inspect.Parameter]:
        """The parameters of the function, but for `shown`."""
        return list(inspect.signature(self._function, eval_str=True).parameters.values())[1:]

    def __call__(self, **words: Any) -> None:
        shown = Shown(*(words.pop(name) for name in ("as_json", "quiet", "verbose")))
        words = {name: _plain(value) for name, value in words.items()}
        places = [words.pop(p.name) for p in self._own if p.kind is p.POSITIONAL_ONLY]
        if all(p.name != "seed" for p in self._own):
            del words["seed"]
        self._function(shown, *places, **words)

    @property
    def __annotations__(self) -> dict[str, type]:  # type: ignore[override]
        return {p.name: p.annotation for p in self.__signature__.parameters.values()}

    @cached_property
    def __signature__(self) -> inspect.Signature:
        of_verb = said_by_verb(*self._verb) if self._verb[0] else {}
        listed: list[inspect.Parameter] = []
        for own in self._own:
            if own.kind is own.VAR_KEYWORD:
                named = {other.name for other in self._own}
                documented_there = (name for name, said in of_verb.items() if said.words)
                more = self._asks or [name for name in documented_there if name not in named]
                listed += [own.replace(name=name, kind=own.KEYWORD_ONLY) for name in more]
            else:
                listed.append(own)
        found = [self._taken(own, of_verb) for own in listed]
        names = {parameter.name for parameter in found}
        found += [SHARED[name] for name in AT_THE_END if name not in names]
        return inspect.Signature(found)

    def _taken(self, own: inspect.Parameter, of_verb: Mapping[str, Said]) -> inspect.Parameter:
        """A parameter of the command as typer takes it."""
        kind, words = documented(self._text).get(own.name, ("", ""))
        if get_origin(own.annotation) is Annotated:
            return own.replace(kind=own.KEYWORD_ONLY)
        if own.name in self._shared and not words:
            shared = self._shared[own.name]
            return shared.replace(
                default=shared.default if own.default is NOT_SAID else own.default
            )
        said = Said(own.annotation, own.default, kind, words).over(of_verb.get(own.name, Said()))
        is_place = own.kind is own.POSITIONAL_ONLY
        return declared(own.name, said, self._metavars.get(own.name), is_place=is_place)


def declared(
    name: str, said: Said, metavar: str | None, *, is_place: bool = False
) -> inspect.Parameter:
    """An argument or an option as typer takes it."""
    if not said.words:
        raise TypeError(f"neither the verb nor the command says what {name} is")
    kind, several = _kind_of(said.hint)
    default = said.default
    choices = ONE_OF.search(said.kind)
    if choices:
        kind = _choice(name, choices[1])
        default = kind(default) if isinstance(default, str) else default
    hint = types.GenericAlias(list, kind) if several else kind
    if several and not default:
        default = []
    if default is None:
        hint = hint | None
    words = said.words
    is_silent = default in (None, []) and not SAYS_DEFAULT.search(words)
    if is_silent and kind is not bool and not is_place:
        words += " Default: none."
    within = WITHIN.search(said.kind)
    low, high = within.groups() if within else ("", "")
    flag = f"--{name.strip('_').replace('_', '-')}"
    declare = typer.Argument
    if not is_place:
        declare = partial(typer.Option, f"{flag}/--no-{flag[2:]}" if default is True else flag)
    what = declare(
        help=words,
        metavar=metavar,
        min=kind(float(low)) if low else None,
        max=kind(float(high)) if high else None,
    )
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[hint, what]
    )


def _plain(value: Any) -> Any:
    """A choice as its text."""
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return str(value) if isinstance(value, Choice) else value


def _choice(name: str, listed: str) -> Any:
    """The values that are listed, as a type."""
    values = [value.strip(" '") for value in listed.split(",")]
    made: Any = Choice
    return made(name, [(value, value) for value in values])


def _kind_of(hint: Any) -> tuple[Any, bool]:
    """The type of one value, and whether several may be given."""
    text = hint if isinstance(hint, str) else inspect.formatannotation(hint)
    several = SEVERAL.search(text)
    name = several[1] if several else text.removesuffix(" | None").rpartition(".")[2]
    return TYPE_OF[name], several is not None


def said_by_verb(module: str, verb: str) -> Mapping[str, Said]:
    """What a function, or the dataclass of a request, says of its parameters."""
    found = find_spec(module)
    assert found is not None and found.origin is not None
    tree = ast.parse(Path(found.origin).read_text("utf-8"))
    nodes = [node for node in tree.body if getattr(node, "name", "") == verb]
    assert isinstance(nodes[0], ast.FunctionDef | ast.ClassDef)
    words = documented(ast.get_docstring(nodes[0]) or "")
    said = {}
    for name, hint, default in _fields(nodes[0]):
        known = words.get(name, ("", ""))
        said[name] = Said("" if hint is None else ast.unparse(hint), _value(default), *known)
    return said


def _fields(node: ast.FunctionDef | ast.ClassDef) -> list[Field]:
    """Name, type and default of each parameter."""
    if isinstance(node, ast.ClassDef):
        lines = [line for line in node.body if isinstance(line, ast.AnnAssign)]
        return [(ast.unparse(line.target), line.annotation, line.value) for line in lines]
    given = node.args
    places = [None] * (len(given.args) - len(given.defaults)) + list(given.defaults)
    pairs = zip([*given.args, *given.kwonlyargs], [*places, *given.kw_defaults])
    return [(arg.arg, arg.annotation, default) for arg, default in pairs]


def _value(node: ast.expr | None) -> Any:
    """A default that is written as a plain value; of another one the command has to say it."""
    if isinstance(node, ast.Constant):
        return node.value
    is_empty = isinstance(node, ast.Tuple) and not node.elts
    return () if is_empty else NOT_SAID


def documented(text: str) -> dict[str, tuple[str, str]]:
    """Type and words of each parameter of a numpydoc."""
    section = SECTION.search(text)
    found: dict[str, tuple[str, str]] = {}
    names: list[str] = []
    for line in section[1].splitlines() if section else ():
        if line.startswith(" "):
            for name in names:
                kind, words = found[name]
                found[name] = (kind, f"{words} {line.strip()}".strip().replace("`", ""))
        elif line:
            listed, _, kind = line.partition(" : ")
            names = [name.strip() for name in listed.split(",")]
            found |= {name: (kind, "") for name in names}
    return found
