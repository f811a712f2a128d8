"""A line before a command's libraries are loaded, and the log that RECAL_LOG asks for."""

import io
import sys

import pytest
from typer.testing import CliRunner

from recal.cli.app import app
from recal.cli.terminal import life


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_sees_a_command_begin_and_the_line_go(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    life.begin("recal update", quiet=False)
    assert terminal.getvalue() == "recal update ..."
    life.clear()
    life.clear()
    life.begin("recal align", quiet=True)
    assert terminal.getvalue() == "recal update ...\r\x1b[K"


def test_a_pipe_sees_nothing_of_it(capsys):
    life.begin("recal update", quiet=False)
    life.clear()
    assert capsys.readouterr().err == ""


@pytest.fixture
def untouched():
    yield
    life.log.handlers[:] = []
    life.log.setLevel("NOTSET")


def test_the_log_level_is_of_the_environment(tmp_path, monkeypatch, untouched):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RECAL_LOG", "info")
    said = CliRunner().invoke(app, ["check", "nowhere"])
    assert "recal check" in said.stderr and "INFO" in said.stderr
    monkeypatch.setenv("RECAL_LOG", "loud")
    assert CliRunner().invoke(app, ["check", "nowhere"]).exit_code == 2
