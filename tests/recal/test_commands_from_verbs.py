"""A command made from the text of a verb: types, ranges, choices, defaults and help."""

import sys

import pytest
import typer
from typer.testing import CliRunner

from recal.cli.console import Command
from recal.cli.parameters.shared import SEED_OPTION
from recal.cli.parameters.verbs import made_from

VERB = '''
raise ImportError("a verb is read for its options, not imported")

def work(runs: AnyRun | Sequence[AnyRun], *, share: float = 0.01, kind: str = "fog",
         seen: Sequence[str] = (), scale_ppm: float | None = None, plot: bool = True, silent=0):
    """Work.

    Parameters
    ----------
    runs : Run or path, or several
        Run directories.
    share : float in [1e-4, 0.5]
        Share of
        false alarms.
    kind : {'rlg', 'fog'}
        Technology of the gyros.
    seen : sequence of str
        What was seen.
    scale_ppm : float, optional
        Scale [ppm].
    plot : bool
        Also draw it.

    Returns
    -------
    silent
        Not a parameter.
    """
'''


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A command of the verb: what it is given, by the words of its line; or its exit code."""
    (tmp_path / "verb_of_test.py").write_text(VERB)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    given = []

    @made_from("verb_of_test", "work", SEED_OPTION, seen="WHAT")
    def command(shown, runs, /, *, note: str = "", seed=3, **more):
        """Do the work.

        Parameters
        ----------
        note
            A note.
        """
        given.append((shown, runs, note, seed, more))

    app = typer.Typer(rich_markup_mode=None)
    app.command(cls=Command)(command)

    def called(*words):
        done = CliRunner().invoke(app, words)
        return given.pop() if given else done

    return called


def test_what_is_not_given_is_the_verbs(run):
    shown, runs, note, seed, more = run("run-1", "run-2", "-q")
    assert (shown.as_json, shown.quiet, shown.verbose) == (False, True, False)
    assert [path.name for path in runs] == ["run-1", "run-2"]
    assert (note, seed) == ("", 3)
    assert more == {"share": 0.01, "kind": "fog", "seen": [], "scale_ppm": None, "plot": True}


def test_what_is_given_has_the_verbs_types(run):
    words = "r --share 0.5 --kind rlg --seen a --seen b --scale-ppm 7 --no-plot --note n --seed 8"
    *_, note, seed, more = run(*words.split())
    assert (note, seed) == ("n", 8) and type(more["kind"]) is str
    said = {"share": 0.5, "kind": "rlg", "seen": ["a", "b"], "scale_ppm": 7.0, "plot": False}
    assert more == said


@pytest.mark.parametrize("wrong", ["--share 0.6", "--share x", "--kind mems", "--silent 1"])
def test_what_the_verb_does_not_take_is_wrong_usage(run, wrong):
    assert run("r", *wrong.split()).exit_code == 2
    assert run().exit_code == 2


def test_the_help_is_the_verbs_and_the_commands(run):
    said = " ".join(run("--help").output.split())
    for words in (
        "RUN... Do the work. Arguments:",
        "--share NUMBER Share of false alarms. Default: 0.01. From 0.0001 to 0.5.",
        "--kind rlg|fog Technology of the gyros. Default: fog.",
        "--seen WHAT What was seen. Default: none.",
        "--scale-ppm NUMBER Scale [ppm]. Default: none.",
        "--plot / --no-plot Also draw it. Default: --plot.",
        "--note TEXT A note.",
    ):
        assert words in said
    assert "Parameters" not in said and "Seed of the random generator." in said


def test_an_option_that_nobody_explains_is_a_fault_of_the_program(tmp_path, monkeypatch):
    (tmp_path / "verb_of_test.py").write_text(VERB)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])

    @made_from("verb_of_test", "work")
    def command(shown, /, silent): ...

    with pytest.raises(TypeError, match="neither the verb nor the command says what silent is"):
        assert command.__signature__
