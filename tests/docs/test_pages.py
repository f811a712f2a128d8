"""The documentation is true where that can be checked: links, commands in code blocks, reference
pages, formulas.
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    p
    for p in (*ROOT.glob("*.md"), *DOCS.rglob("*.md"))
    if not {"generated", "_build"} & set(p.relative_to(ROOT).parts)
]
FENCE = re.compile(r"^(`{3,})([^\n`]*)\n(.*?)^\1\s*$", re.M | re.S)
LINK = re.compile(r"!?\[[^\]\n]*\]\(([^)\s]+)\)")
FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\\$\w])\$([^$\n]+?)\$(?![\w$])", re.S)
by_page = pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))


@pytest.fixture(scope="module")
def extension():
    """The folder of the site's own modules on the path, for this module only."""
    sys.path.insert(0, str(DOCS / "_ext"))
    yield
    sys.path.remove(str(DOCS / "_ext"))


@pytest.fixture(scope="module")
def tree(extension):
    from command_pages import command_tree

    return command_tree()


def prose(page):
    return re.sub(r"`[^`\n]*`", "", FENCE.sub("", page.read_text("utf-8")))


@by_page
def test_links_lead_to_files(page):
    for target in LINK.findall(prose(page)):
        file = target.split("#")[0]
        if "://" in target or not file:
            continue
        assert (page.parent / file).exists(), f"{page.name}: {target}"


def test_links_of_the_site_alone_are_added(extension):
    from site_links import with_site_links

    text = (
        "`ins.earth.gravity_n`, `ins.nothing`: *files*<!-- site: ../generated/files/run.md -->,"
        " [c](../../CONVENTIONS.md#a)\n"
    )
    assert (
        with_site_links(text, "guides/page")
        == "[`ins.earth.gravity_n`](../generated/api/cited.md#insearthgravity_n), `ins.nothing`: "
        "[files](../generated/files/run.md), [c](../generated/project/conventions.md#a)\n"
    )
    block = "```\n`ins.earth.gravity_n`\n```\n"
    assert with_site_links(block, "page") == block


def command_lines(text):
    """What a reader would type, from the code blocks: lines after a prompt, continued ones joined,
    split at ; | and &&.
    """
    for _, _, block in FENCE.findall(text):
        joined = re.sub(r"\\\n>?\s*", " ", block)
        for line in joined.splitlines():
            typed = re.sub(r"^[$>]\s+", "", line)
            if typed != line or line.startswith("recal "):
                yield from re.split(r"\s*(?:;|&&|\|\|?|\s&\s)\s*", typed.split(" # ")[0])


def unknown_words(line, tree):
    """What is not of the program in a line that starts with recal: a command, or options of it."""
    words = [w for w in shlex.split(line) if not re.fullmatch(r"\d?>.*", w)][1:]
    name = next((n for n in (" ".join(words[:2]), " ".join(words[:1])) if n in tree), None)
    if name is None:
        return [w for w in words[:1] if not w.startswith("-")]
    known = {flag for p in tree[name].params for flag in (*p.opts, *p.secondary_opts)} | {"--help"}
    return [w for w in words if re.match(r"--?[a-z]", w) and w.split("=")[0] not in known]


@by_page
def test_commands_and_their_options_exist(page, tree):
    for line in command_lines(page.read_text("utf-8")):
        found = re.match(r"(?:do |(?:\S*/)?)recal (.*)", line.strip())
        if found and re.match("[-a-z]", found[1]):
            assert unknown_words(f"recal {found[1]}", tree) == [], f"{page.name}: {line}"


def test_an_unknown_option_and_an_unknown_command_are_found(tree):
    lines = list(
        command_lines(
            "```\n$ recal update run --comit; recal updat run\n$ cat x | recal check run\n```"
        )
    )
    found = [unknown_words(line, tree) for line in lines if line.startswith("recal")]
    assert found == [["--comit"], ["updat"], []]


def test_every_command_has_a_page_with_all_its_options(tree, extension):
    from command_pages import command_pages

    pages = command_pages()
    for name, command in tree.items():
        page = pages[name.split()[0]]
        assert f"# recal {name}" in page and f"`recal {name}`" in pages["index"]
        shown = [p for p in command.params if not getattr(p, "hidden", False)]
        flags = [flag for p in shown for flag in p.opts if flag.startswith("-")]
        assert flags and all(f"`{flag}`" in page for flag in flags)
    for code in (0, 2, 3, 4, 5):
        assert f"| {code} |" in pages["index"]


def test_file_pages_hold_the_models_keys(extension):
    from file_pages import file_pages

    pages = file_pages()
    assert "| `imu_serial` | text (length >= 1, length <= 200) | needed |" in pages["run"]
    assert "`site.lat_deg` | number (>= -90, <= 90)" in pages["run"]
    assert "`dtheta_x_rad`" in pages["run"]
    assert "| `gyro.arw_deg_sqrt_h` | 0.002 | 0.3 |" in pages["twin"]
    assert "`axes.x.slope_deg_h_degC`" in pages["table"]
    assert "`gyro_thermal_rate`" in pages["effects"]
    for schema in (
        "update",
        "alignment",
        "replay",
        "diagnosis",
        "plan",
        "check",
        "misalignment",
        "demo",
    ):
        assert f"## recal.{schema}/1" in pages["results"], schema
    points = "points[]  # The total bias of one gyro over one bin\n  axis  [text]\n  time_s  [s]"
    assert points in pages["results"]


def test_what_pages_cite_has_an_entry(extension):
    from api_pages import api_pages

    cited = api_pages()["cited"]
    assert "## ins.earth.gravity\\_n\n\n````text\ngravity_n(" in cited and "def _" not in cited


@by_page
def test_formulas_are_drawn(page, extension):
    from mathml import mathml

    text = page.read_text("utf-8")
    if not page.is_relative_to(DOCS) or "$" not in prose(page):
        return
    for block, inline in FORMULA.findall(re.sub(r"`[^`\n]*`", "", FENCE.sub("", text))):
        assert mathml(block or inline, block=bool(block)).startswith("<math")


@pytest.mark.slow
def test_the_site_is_read_without_a_warning(tmp_path):
    """All of Sphinx but the writing of pages; .ci/run writes them too."""
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-W",
        "--keep-going",
        "-b",
        "dummy",
        "-d",
        str(tmp_path / "trees"),
    ]
    found = subprocess.run(
        [*command, str(DOCS), str(tmp_path / "out")], capture_output=True, text=True, cwd=ROOT
    )
    assert found.returncode == 0, found.stderr


def test_a_command_page_shows_a_sample_and_exit_codes(extension):
    """Samples are of pages that are run, so that they are what the program prints."""
    from command_pages import command_pages

    pages = command_pages()
    for name in ("check", "align", "update", "replay", "look", "convert"):
        assert f"Sample:\n\n```\n$ recal {name} " in pages[name]
        assert "Exit codes: 0 done" in pages[name]


def test_the_front_door_has_a_page_with_examples(extension):
    from api_pages import api_pages, front_door

    import recal

    page = api_pages()["front_door"]
    assert set(front_door()) == set(recal.__all__) - {"__version__"}
    for name in front_door():
        assert f"## recal.{name}".replace("_", "\\_") in page
    assert page.count(">>> import recal") >= len(front_door()) - 1  # PlanRequest is a record
