"""What all commands share: start-up, flags, exit codes, and one line where the input is bad."""

import errno
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import recal
from ins.records import InputError
from recal.cli.app import COMMANDS, GROUPS, app
from recal.cli.console import EXIT_CODES
from recal.service.results.files import write_files

ROOT = Path(recal.__file__).parent.parent
TABLE = get_command(app).commands["table"].commands
MEMBERS = [[group, name] for group in GROUPS for name in get_command(app).commands[group].commands]
ALL = [[name] for name in COMMANDS] + MEMBERS
HEAVY = {
    "numpy",
    "numba",
    "llvmlite",
    "scipy",
    "pandas",
    "pyarrow",
    "matplotlib",
    "plotly",
    "sqlalchemy",
    "alembic",
    "pydantic",
    "filterpy",
    "pymap3d",
    "jinja2",
    "ins.records",
    "trajectories",
    "alignment",
    "infield.session",
    "infield.table",
    "infield.reports.documents",
}
HELPS = """
import json, os, sys
import recal.cli.app  # what all commands share, once
from recal.__main__ import main
for words in json.loads(sys.argv[1]):
    sys.stdout.flush()
    if os.fork() == 0:
        code, sys.argv = 1, ["recal", *words, "--help"]
        try:
            main()
        except SystemExit as end:
            code = end.code
        finally:
            sys.stdout.flush()
            print("\\0", code, *sys.modules, end="\\0", flush=True)
            os._exit(0)
    os.wait()
"""


@pytest.fixture(scope="module")
def helps():
    """What each command's help says, its exit code, and the libraries loaded by then: each forked
    from the bare program.
    """
    every = [[], *([name] for name in GROUPS), *ALL]
    done = subprocess.run(
        [sys.executable, "-c", HELPS, json.dumps(every)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"},
    )
    assert done.stderr == ""
    parts = done.stdout.split("\0")
    return {
        " ".join(words): (text, *last.split())
        for words, text, last in zip(every, parts[:-1:2], parts[1::2], strict=True)
    }


def test_help_loads_no_heavy_library(helps):
    """`recal --help` within 0.4 s: what costs time is importing; numpy alone takes 0.1 s."""
    said, code, *loaded = helps[""]
    assert code == "0" and "update" in said
    assert "recal" in loaded and not HEAVY & set(loaded)


@pytest.mark.parametrize("words", [*([name] for name in GROUPS), *ALL], ids=" ".join)
def test_the_help_of_a_command_loads_no_heavy_library_and_shows_an_example(helps, words):
    said, code, *loaded = helps[" ".join(words)]
    assert code == "0"
    assert not HEAVY & set(loaded) - {"pydantic"}  # typer's own
    assert "Example: recal " + " ".join(words) in " ".join(said.split()) or words[0] in GROUPS


def test_the_version_and_the_packaged_scenarios():
    said = CliRunner().invoke(app, ["--version"])
    assert said.exit_code == 0 and re.fullmatch(r"recal \d+\.\d+\.\d+\n", said.stdout)
    listed = CliRunner().invoke(app, ["simulate", "--list"])
    assert listed.exit_code == 0 and "cold_parked_taxi" in listed.stdout
    known = json.loads(CliRunner().invoke(app, ["simulate", "--list", "--json"]).stdout)
    assert known["schema"] == "recal.scenarios/1" and all(known["scenarios"].values())
    assert CliRunner().invoke(app, ["simulate", "parked_only"]).exit_code == 2


@pytest.mark.parametrize("words", ALL, ids=" ".join)
def test_every_command_has_the_common_flags(words):
    command = get_command(app)
    for word in words:
        command = command.commands[word]
    flags = {flag for parameter in command.params for flag in parameter.opts}
    assert flags >= {"--json", "-q", "-v", "--seed"}


NEEDED = {
    "rollback": ["--by", "B", "--reason", "why"],
    "export": ["-o", "t.json"],
    "approve": ["1", "--reason", "why"],
    "reject": ["1", "--reason", "why"],
}
BAD = [
    ["simulate", "nothing", "-o", "o"],
    ["convert", "nothing", "-o", "o"],
    ["check", "nothing"],
    ["align", "nothing"],
    ["replay", "nothing"],
    ["update", "nothing"],
    ["table", "import", "nothing"],
    *(["table", name, *NEEDED.get(name, [])] for name in TABLE if name != "import"),
]


@pytest.mark.parametrize("words", BAD, ids=" ".join)
def test_bad_input_is_one_line_exit_3_and_one_json_object(words, tmp_path, monkeypatch, capsys):
    import recal.__main__

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["recal", *words, "--json"])
    with pytest.raises(SystemExit) as end:
        recal.__main__.main()
    seen = capsys.readouterr()
    assert end.value.code == 3
    answer = json.loads(seen.out)
    assert answer["verdict"] == "bad_input"
    if words[0] == "check":
        assert answer["schema"] == "recal.check/1" and seen.err == ""
    else:
        assert answer["schema"] == "recal.error/1"
        assert seen.err == f"recal: {answer['reasons'][0]}\n"
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_the_system_refuses_is_bad_input(monkeypatch, tmp_path):
    from recal.service import check

    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "run/imu.parquet")

    monkeypatch.setattr(check, "check", full)
    result = CliRunner().invoke(app, ["check", "run", "--json"])
    assert isinstance(result.exception, InputError)
    assert json.loads(result.stdout)["reasons"] == ["run/imu.parquet: No space left on device"]


def test_wrong_usage_is_exit_2_and_prints_no_result():
    for words in (
        ["update"],
        ["check", "a", "--nonsense"],
        ["nonsense"],
        ["table", "show", "--json", "more"],
    ):
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 2 and result.stdout == ""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("plan --without sun", "'sun' is not one of 'gnss', 'odometer', 'taxi', 'gradient'"),
        ("plan --lat-deg 90", "got '90', needed at most 85"),
        ("plan --most 2.5", "got '2.5', needed a whole number"),
        ("update run --retry 100", "got '100', needed at most 99"),
        ("demo --seed -3", "got '-3', needed at least 0"),
    ],
)
def test_a_wrong_value_is_said_as_that_of_a_file_is(words, said):
    result = CliRunner().invoke(app, words.split())
    assert result.exit_code == 2
    assert said in result.stderr and "Value error" not in result.stderr


def test_every_verdict_has_its_exit_code():
    """formats.md, section 4; 1: all workers of a fleet broke down."""
    assert {
        code: {v for v, c in EXIT_CODES.items() if c == code} for code in set(EXIT_CODES.values())
    } == {
        0: {
            "ok",
            "warnings",
            "aligned",
            "replayed",
            "proposed",
            "committed",
            "measured",
            "fitted",
            "no_gap",
            "explained",
            "usable",
            "partly_explained",
            "unexplained",
            "approved",
            "rejected",
            "intact",
            "up_to_date",
        },
        1: {"failed"},
        3: {"bad_input", "broken"},
        4: {"refused", "level_only"},
        5: {"inconsistent"},
    }


def test_a_reader_that_leaves_early_is_no_fault(tmp_path):
    """More than a pipe holds, to a reader that takes one line."""
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); sys.argv = ['recal', '--help']\nfrom"
        " recal.__main__ import main"
    )
    long = f"{code}\nimport recal.cli.app\nrecal.cli.app = lambda: print('x' * 1_000_000)\nmain()"
    for program in (f"{code}\nmain()", long):
        with subprocess.Popen(
            [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as process:
            process.stdout.close()
            assert process.stderr.read() == b""
            assert process.wait() == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_standard_output_on_a_full_disk_is_said():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "recal", "--help"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
    assert done.returncode == 3
    assert done.stderr == "recal: standard output: No space left on device\n"


@pytest.mark.skipif(os.name != "posix", reason="needs a shell that closes a stream")
def test_a_closed_standard_output_is_no_crash(tmp_path):
    """`recal ... >&-`: Python has no standard output then; it ended in a traceback, exit code 1."""
    recal = f"{shlex.quote(sys.executable)} -m recal table list --store sqlite:///{tmp_path}/no.db"
    done = subprocess.run(f"{recal} >&-", shell=True, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert done.returncode == 3
    assert done.stderr == f"recal: no store at sqlite:///{tmp_path}/no.db\n"


def test_files_are_written_together_or_not_at_all(tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    write_files({first: "1", second: "2"})
    with pytest.raises(InputError, match=r"c: cannot be written \(Is a directory\)"):
        (tmp_path / "c").mkdir()
        write_files({first: "new", tmp_path / "c": "new"}, commit=lambda: pytest.fail("committed"))

    def refuse():
        raise InputError("no")

    with pytest.raises(InputError, match="no"):
        write_files({first: "new", second: "new"}, commit=refuse)
    assert (first.read_text(), second.read_text()) == ("1", "2")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b", "c"]
