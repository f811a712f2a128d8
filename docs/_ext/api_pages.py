"""The Python reference, read from the sources: the names of `import recal`, and what pages cite of
the packages, each with signature and docstring.
"""

import ast
import re
import textwrap
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("ins", "trajectories", "alignment", "infield", "simreal", "recal")
NAME = re.compile(rf"(?<!\[)`((?:{'|'.join(PACKAGES)})(?:\.\w+)+)`(?!\])")
Entry = ast.FunctionDef | ast.ClassDef


def api_pages() -> dict[str, str]:
    """Markdown by page name: an index, the front door, and what pages cite."""
    return {"index": _index(), "front_door": _front_door(), "cited": _cited()}


def modules(package: str) -> dict[str, Path]:
    """Source files by dotted name, the package itself first; private modules and those of commands
    are left out.
    """
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        parts = parts[:-1] if parts[-1] == "__init__" else parts
        if (
            not any(p.startswith("_") for p in parts)
            and parts[:2] != ("recal", "cli")
            and "migrations" not in parts
        ):
            found[".".join(parts)] = path
    return dict(sorted(found.items(), key=lambda item: (item[0].count(".") > 0, item[0])))


@cache
def cited_entries() -> dict[str, Entry]:
    """Public functions and classes that a page names in full in backquotes, in order of name."""
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    texts = [page.read_text("utf-8") for page in pages if "generated" not in page.parts]
    names = {name for text in texts for name in NAME.findall(text)}
    sources = {name: path for package in PACKAGES for name, path in modules(package).items()}
    found = {}
    for name in sorted(names):
        module, _, last = name.rpartition(".")
        if module in sources:
            nodes = [node for node in _public(sources[module]) if node.name == last]
            found.update((name, node) for node in nodes)
    return found


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a source file, made once."""
    return ast.parse(path.read_text("utf-8"))


def _public(path: Path) -> list[Entry]:
    body = parsed(path).body
    return [
        n
        for n in body
        if isinstance(n, ast.FunctionDef | ast.ClassDef) and not n.name.startswith("_")
    ]


def front_door() -> dict[str, Path]:
    """The names of `import recal`, each with the module that it is loaded from."""
    for node in parsed(ROOT / "recal/__init__.py").body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "_HOMES":
            homes = ast.literal_eval(node.value)
            folder = ROOT / "recal/service"
            return {name: folder / f"{home.replace('.', '/')}.py" for name, home in homes.items()}
    raise LookupError("recal/__init__.py has no _HOMES")


def _front_door() -> str:
    parts = [
        "# The front door: import recal",
        "",
        "A verb takes paths or records, one run or several, and gives a frozen result with"
        " `verdict`, `reasons`, `to_json()`, `to_dict()` and `to_html(path)`. The page on Python"
        " shows them together. Each entry ends with an example, and a test runs it.",
        "",
    ]
    for name, path in sorted(front_door().items()):
        node = next(node for node in _public(path) if node.name == name)
        parts += [f"## recal.{name}".replace("_", "\\_"), "", _block(_entry(node)), ""]
    return "\n".join(parts)


def _index() -> str:
    names = ", ".join(f"`{name}`" for name in sorted(front_door()))
    return (
        f"# Python interface\n\nThe *front door*, `import recal`, is all that most programs need:"
        f" {names}. The packages behind it are documented in their"
        " sources.\n\n```{toctree}\n:maxdepth: 1\n\nfront_door\ncited\n```\n"
    )


def _cited() -> str:
    parts = ["# Functions that these pages cite", ""]
    for name, node in cited_entries().items():
        parts += [f"## {name}".replace("_", "\\_"), "", _block(_entry(node)), ""]
    return "\n".join(parts)


def _entry(node: Entry) -> str:
    """Signature and docstring; of a class its fields and public methods too."""
    if isinstance(node, ast.FunctionDef):
        return _signature(node) + _indented(ast.get_docstring(node))
    lines = [
        f"class {node.name}({', '.join(ast.unparse(b) for b in node.bases)})".replace("()", "")
    ]
    text = lines[0] + _indented(ast.get_docstring(node))
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and not ast.unparse(item.target).startswith("_"):
            text += f"\n    {ast.unparse(item)}"
    for item in node.body:
        if isinstance(item, ast.FunctionDef) and not item.name.startswith("_"):
            method = _signature(item) + _indented(ast.get_docstring(item))
            text += "\n\n" + "\n".join(
                f"    {line}" if line else "" for line in method.splitlines()
            )
    return text


def _signature(node: ast.FunctionDef) -> str:
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    one_line = f"{node.name}({ast.unparse(node.args)}){returns}"
    if len(one_line) <= 100:
        return one_line
    arguments = textwrap.fill(
        ast.unparse(node.args), 96, initial_indent="    ", subsequent_indent="    "
    )
    return f"{node.name}(\n{arguments}\n){returns}"


def _indented(docstring: str | None) -> str:
    return (
        ""
        if not docstring
        else "\n" + "\n".join(f"    {line}" if line else "" for line in docstring.splitlines())
    )


def _block(text: str | None) -> str:
    return f"````text\n{text}\n````"
