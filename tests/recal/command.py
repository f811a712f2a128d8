"""The command line as a user types it, within this process."""

import json

from typer.testing import CliRunner

from ins.records import InputError
from recal.cli.app import app


def run(*words):
    """What became of a command."""
    return CliRunner().invoke(app, [str(word) for word in words])


def answered(*words, exit_code=0):
    """The document of a command."""
    done = run(*words, "--json")
    assert done.exit_code == exit_code, (done.output, done.exception)
    return json.loads(done.stdout)


def refused(*words):
    """The one line of an InputError, which `recal` turns into exit code 3."""
    done = run(*words)
    assert isinstance(done.exception, InputError), (done.output, done.exception)
    assert "\n" not in str(done.exception)
    return str(done.exception)
