"""The worked examples: pages of recorded files, and the script that runs them finds what has
changed.
"""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
DATA = ROOT.parent / "shared" / "data"
FILES = ("x_LN100_up.ins", "apm_fixedwing_TestLog2.mat")


@pytest.fixture(scope="module")
def runner():
    spec = importlib.util.spec_from_file_location("run_examples", EXAMPLES / "run.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.mark.parametrize("file", FILES)
def test_every_file_has_a_page_with_commands_and_its_licence(runner, file):
    pages = [p for p in EXAMPLES.glob("*.md") if f"<!-- needs: {file} -->" in p.read_text("utf-8")]
    assert len(pages) == 1, file
    text = pages[0].read_text("utf-8")
    assert "licence" in text
    assert re.search(r"commit [0-9a-f]{8}", text)
    assert f"({pages[0].name})" in (EXAMPLES / "index.md").read_text()
    commands = [s.command for block in runner.BLOCK.findall(text) for s in runner.steps_of(block)]
    assert any(f"data/{file}" in c for c in commands)
    assert all(
        s.output.strip()
        for block in runner.BLOCK.findall(text)
        for s in runner.steps_of(block)
        if "recal align" in s.command
    )


@pytest.mark.parametrize(
    ("expected", "got", "agree"),
    [
        ("heading 277.34 +- 1.96 deg", "heading  277.36 +- 1.95 deg", True),
        ("heading 277.34 +- 1.96 deg", "heading 277.34 +- 2.96 deg", False),
        ("sigma 0.0079 -> 0.0035", "sigma 0.0079 -> 0.0036", True),
        ("sigma 0.0079 -> 0.0035", "sigma 0.0079 -> 0.0045", False),
        ("y: observed", "y: not_observable", False),
        ("exit code 4", "exit code 3", False),
        ("a\nb", "a", False),
        (
            "revision 1 2026-11-21T18:14:10Z 3d1e3478dbf6",
            "revision 1 2027-01-02T03:04:05Z 0123456789ab",
            True,
        ),
        ("p under 1e-300", "p under 1e-300", True),
        ("-12.62 arcmin", "12.62 arcmin", False),
    ],
)
def test_differences_are_those_beyond_the_tolerance(runner, expected, got, agree):
    assert (runner.differences(expected, got) == []) is agree


def test_a_page_is_run_and_rewritten(runner, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "Text.\n\n```console\n$ echo one 1.0\none 1.0\n$ cat <<E\n> two\n> E\n```\n\n```console\n$"
        " ls data\n```\n"
    )
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "file").touch()
    ran = runner.outputs(page, tmp_path / "data")
    assert [got for _, got in ran] == ["one 1.0\n", "two\n", "file\n"]
    assert [runner.differences(step.output, got) == [] for step, got in ran] == [True, False, False]
    page.write_text(runner.rewritten(page, ran))
    assert (
        page.read_text() == "Text.\n\n```console\n$ echo one 1.0\none 1.0\n$ cat <<E\n> two\n>"
        " E\ntwo\n```\n\n```console\n$ ls data\nfile\n```\n"
    )
    assert all(
        runner.differences(step.output, got) == []
        for step, got in runner.outputs(page, tmp_path / "data")
    )


def test_a_page_whose_file_is_absent_says_so(runner, tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- needs: log.bin -->\n")
    assert runner.missing(page, tmp_path) == f"{tmp_path / 'log.bin'} is not there"
    (tmp_path / "log.bin").touch()
    assert runner.missing(page, tmp_path) == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    sorted(
        p
        for pattern in ("README.md", "docs/guides/*.md", "docs/examples/*.md")
        for p in ROOT.glob(pattern)
    ),
)
def test_pages_print_what_they_say(runner, page):
    if why := runner.missing(page, DATA):
        pytest.skip(why)
    wrong = [
        d for step, got in runner.outputs(page, DATA) for d in runner.differences(step.output, got)
    ]
    assert wrong == []


def test_the_session_of_the_front_door_names_what_is_there(runner):
    """Each job of the page is done, by functions that exist; the next test runs them."""
    import recal

    code = "\n".join(step.command for step in runner.typed(ROOT / "docs/python.md"))
    named = set(re.findall(r"\brecal\.(\w+)", code)) - {"db"}
    wanted = {"read_run", "align", "update", "open_store", "replay", "diagnose", "fit_twin"}
    assert wanted <= named <= set(recal.__all__)


@pytest.mark.slow
def test_the_session_of_the_front_door_prints_what_the_page_says(runner):
    ran = runner.outputs(ROOT / "docs/python.md", DATA)
    assert [d for step, got in ran for d in runner.differences(step.output, got)] == []
