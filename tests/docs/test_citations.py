"""Every citation leads somewhere: a page to a file, a section, an equation, an effect or a
requirement to the page of docs/reference that has it, a name in backquotes to code.
"""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import recal

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
REFERENCE = DOCS / "reference"
PACKAGES = ("ins", "trajectories", "alignment", "infield", "simreal", "recal")
CITING = (*PACKAGES, "tests", "benchmarks", "docs", "examples")
SUFFIXES = (".py", ".md", ".toml", ".j2")
MADE = {"generated", "_build"}  # folders of the site's build
INVENTED = {"page.md", "../../index.md"}  # of a test's temporary folder, and of the built site

PAGE = re.compile(r"(?<![\w/.}-])((?:[\w.-]+/)*[\w-]+\.md)\b")
# what may stand between a page and the place in it: "physics.md, section 4", "page.md) 6.5"
BETWEEN = re.compile(r"[)`]?,?\s+(?:end of\s+)?(?:sections?\s+|eq\.\s+)?(?=\(?[\dGAPOFD])")
PLACE = re.compile(r"\(?(\d+(?:\.\d+)*(?:-\d+)?[abc]?|[GAPOFD]\d\d)\)?(?!\w|\.\w)")
MORE = re.compile(r"(?:,? and |, | to |; )(?:sections? )?")
REQUIREMENT = re.compile(r"\bR\d+\b")
HEADING = re.compile(r"^#{2,4} (\d+(?:\.\d+)*[abc]?)\.? ", re.M)
ENTRY = re.compile(r"^\| (?:\*\*)?([GAPOFDR]\d+)(?:\*\*)? \|", re.M)
EQUATION = re.compile(r"\((\d+\.\d+-\d+)[,)]|, (\d+\.\d+-\d+)\)")
FENCE = re.compile(r"^(`{3,})[^\n]*\n.*?^\1\s*$", re.M | re.S)
NAME = re.compile(rf"`((?:{'|'.join(PACKAGES)}|benchmarks)(?:\.\w+)+)`")
NOT_CODE = re.compile(
    r".*\.(?:json|db|html)|recal\.(?:effects|errors)"
)  # files; groups of entry points
SOURCE = re.compile(rf"`((?:{'|'.join(CITING)})/[\w/.*-]+)`")


def citing_files():
    """All texts of the project but this one, which plants bad citations."""
    found = [*ROOT.glob("*.md"), ROOT / "pyproject.toml"]
    for folder in CITING:
        found += [p for p in (ROOT / folder).rglob("*") if p.suffix in SUFFIXES]
    return [p for p in found if p != Path(__file__) and not MADE & set(p.relative_to(ROOT).parts)]


@cache
def flowing(text):
    """The text without its line breaks, comment marks and the seams of joined strings."""
    text = re.sub(r'"\s*\n\s*f?"', "", text)
    return re.sub(r"\s*\n[\s#]*", " ", text)


@cache
def places(page):
    """Sections, equations and entries of a reference page."""
    text = (REFERENCE / page).read_text("utf-8")
    found = {*HEADING.findall(text), *ENTRY.findall(text)}
    return found | {a or b for a, b in EQUATION.findall(text)}


def cited_places(text, end):
    """The places named after a page that ends at `end`."""
    if not (between := BETWEEN.match(text, end)):
        return
    end = between.end()
    while place := PLACE.match(text, end):
        yield place[1]
        more = MORE.match(text, place.end())
        if not more:
            return
        end = more.end()


def page_exists(name, folder):
    """A page beside the text, in the project, in docs or among the reference pages."""
    return any((base / name).exists() for base in (folder, ROOT, DOCS, REFERENCE))


def unresolved(whole, folder=ROOT):
    """What the text cites and is not there."""
    wrong = []
    text = flowing(whole) if ".md" in whole else ""
    for page in PAGE.finditer(text):
        name = page[1]
        if name in INVENTED or MADE & set(Path(name).parts):
            continue
        if not page_exists(name, folder):
            wrong.append(name)
        elif (REFERENCE / Path(name).name).exists():
            known = places(Path(name).name)
            wrong += [f"{name} {p}" for p in cited_places(text, page.end()) if p not in known]
    known = places("requirements.md")  # its numbers are cited without the page as well
    return wrong + [r for r in REQUIREMENT.findall(whole) if r not in known]


def test_every_citation_resolves():
    wrong = {
        str(path.relative_to(ROOT)): found
        for path in citing_files()
        if (found := unresolved(path.read_text("utf-8"), path.parent))
    }
    assert wrong == {}


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("the cancellation of physics.md 6.5 holds", []),
        ("# physics.md, sections 6.2 and 6.3, for", []),
        ("(physics.md\n# section 4, errors 1 to 4)", []),
        ('f"needed by formats.md, "\n    f"section 5"', []),
        ("(effects.md, G02 to G08, G11). effects.md 2c, O01", []),
        ("physics.md (6.2-1), and R13, R29", []),
        ("see [formats](docs/reference/formats.md), section 5", []),
        ("physics.md 9.9", ["physics.md 9.9"]),
        ("physics.md 6.3, 6.44: its case", ["physics.md 6.44"]),
        ("formats.md section\n    7", ["formats.md 7"]),
        ("effects.md G30", ["effects.md G30"]),
        ("physics.md (6.2-9)", ["physics.md 6.2-9"]),
        ("house.md section 3.6", ["house.md"]),
        ("requirements R30", ["R30"]),
    ],
)
def test_a_planted_citation(text, wrong):
    assert unresolved(text) == wrong


@cache
def names_of(path):
    """What a module defines or imports at its top level, and the members of its classes."""
    found = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            members = [n.name for n in node.body if isinstance(n, ast.FunctionDef)]
            found |= {f"{node.name}.{name}" for name in members}
        if isinstance(node, ast.Assign):
            found |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
        if isinstance(node, ast.AnnAssign):
            found.add(node.target.id)
        if isinstance(node, ast.Import | ast.ImportFrom):
            found |= {alias.asname or alias.name for alias in node.names}
    return found


def code_exists(dotted):
    """A module of the project, what a module has, or a name of the front door."""
    parts = dotted.split(".")
    if parts[0] == "recal" and len(parts) == 2 and parts[1] in recal.__all__:
        return True
    for n in range(len(parts), 0, -1):
        path = ROOT.joinpath(*parts[:n])
        module, package = path.with_suffix(".py"), path / "__init__.py"
        if n == len(parts) and (module.exists() or package.exists()):
            return True
        if module.exists():
            return ".".join(parts[n:]) in names_of(module)
    return False


def missing_code(text):
    """Names and paths in backquotes that are not in the project."""
    text = FENCE.sub("", text)
    names = [name for name in NAME.findall(text) if not NOT_CODE.fullmatch(name)]
    wrong = [name for name in names if not code_exists(name)]
    for path in SOURCE.findall(text):
        if not MADE & set(Path(path).parts) and not any(ROOT.glob(path.rstrip("/"))):
            wrong.append(path)
    return wrong


PAGES = [p for p in citing_files() if p.suffix == ".md" and p.name != "CHANGELOG.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_code_that_a_page_names_exists(page):
    assert missing_code(page.read_text("utf-8")) == []


def test_code_that_is_not_there_is_found():
    text = "`ins.earth.gravity_n` `ins.earth.gravity_m` `ins.nothing.here` `tests/none.py` `docs/`"
    assert missing_code(text) == ["ins.earth.gravity_m", "ins.nothing.here", "tests/none.py"]


def room_rows():
    """Rooms and what each holds, from the table of ARCHITECTURE.md."""
    package = ""
    text = (ROOT / "ARCHITECTURE.md").read_text("utf-8")
    table = text[text.index("| package | room |") : text.index("A folder holds")]
    for line in table.splitlines()[2:]:
        if not line.startswith("|"):
            continue
        first, room, holds = (cell.strip() for cell in line.strip("|").split("|"))
        package = first.strip("`") or package
        rooms = re.findall(r"`([\w.]+)`", room) or [package]
        yield package, rooms, re.findall(r"`(\w+)`", holds)


def test_every_room_is_in_the_table_with_modules_that_it_has():
    named = set()
    for package, rooms, modules in room_rows():
        folders = [ROOT.joinpath(*room.split(".")) for room in rooms]
        assert all(
            folder.is_dir() and room.startswith(package) for folder, room in zip(folders, rooms)
        )
        named |= set(rooms)
        there = {p.stem for folder in folders for p in folder.rglob("*") if "__" not in p.name}
        assert set(modules) - there - {"effects"} == set(), rooms
    folders = {p.parent for p in ROOT.glob("*/*/__init__.py") if p.parts[-3] in PACKAGES}
    assert {f"{p.parent.name}.{p.name}" for p in folders} <= named
