"""Which stream a text goes to: the result on standard output, in words or as JSON, and nothing else
there; notes, warnings and errors on standard error.

Every command runs in a quick form: the verb behind a slow one is replaced by a result of one line.
"""

import json
import os
import pty
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from ins.twin_file import default_twin, twin_to_dict
from recal.cli.app import COMMANDS, GROUPS, app
from simreal.twin.exchange import kalibr_text
from tests.recal.test_table import table_file

WORDS = "SN-1: what came out"
OUTPUT = ["-o", "out"]
# they run until they are stopped: test_serve_command.py, watch/test_watch.py
SELF_TESTED = {"serve", "watch"}


@dataclass
class Shown:
    """What a verb gives, made without work."""

    verdict: str = "ok"
    page: None = None  # of a fit that was refused
    folder: Path | None = None
    document: dict = field(default_factory=lambda: {"schema": "recal.alignment/1"})
    record: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(report="out/update.html", problems=())
    )

    def lines(self, *, verbose=False):
        return [WORDS]

    def to_json(self):
        return json.dumps(self.document)

    def write(self, output=None, **more):
        return Path(output)


class SimulationShown(Shown):
    def write(self, output=None, **more):
        return self


@dataclass
class FleetShown:
    """A fleet document without units."""

    verdict: str = "up_to_date"
    reasons: tuple = (WORDS,)
    counts: dict = field(default_factory=dict)
    runs: tuple = ()
    units: tuple = ()
    left_out: tuple = ()
    noted: tuple = ()


def shown(*arguments, **options):
    return Shown()


SLOW = {  # the verb that a command calls
    "demo": "recal.service.demo.demo",
    "simulate": "recal.service.simulate.simulate",
    "look": "recal.service.look.look.look",
    "convert": "recal.service.convert.convert",
    "check": "recal.service.check.check",
    "align": "recal.service.align.align",
    "replay": "recal.service.replay.replay",
    "update": "recal.service.update.update_in_store",
    "misalignment": "recal.service.misalignment.misalignment",
    "plan": "recal.service.plan.plan",
    "diagnose": "recal.service.diagnose.diagnose",
    "thermal rlg": "recal.service.thermal.fit_rlg",
    "thermal fog": "recal.service.thermal.fit_fog",
    "thermal apply": "recal.service.thermal.take_out",
    "twin fit": "recal.service.twin.fit.fit_twin",
    "twin check": "recal.service.twin.fit.check_twin",
    "fleet learn": "recal.service.priors.learn.learn_priors",
    "fleet forecast": "recal.service.priors.forecast.forecast",
    "fleet approve": "recal.service.priors.records.decide",
    "fleet reject": "recal.service.priors.records.decide",
}
QUICK = {  # the words after the name; every command has its line here
    "demo": OUTPUT,
    "simulate": ["parked_only", *OUTPUT],
    "look": ["log.bin", *OUTPUT],
    "convert": ["log.bin", *OUTPUT],
    "check": ["run"],
    "align": ["run", *OUTPUT],
    "replay": ["run", *OUTPUT],
    "update": ["run", *OUTPUT],
    "misalignment": ["run", *OUTPUT],
    "plan": OUTPUT,
    "diagnose": ["run", "--twin", "twin.json", *OUTPUT],
    "table list": [],
    "table show": [],
    "table diff": [],
    "table policy": [],
    "table rollback": ["--to", "factory", "--by", "B", "--reason", "why"],
    "table verify": [],
    "table export": ["-o", "out.csv"],
    "table import": ["table.json"],
    "table proposals": [],
    "table approve": ["1", "--reason", "why"],
    "table reject": ["1", "--reason", "why"],
    "thermal rlg": ["run", *OUTPUT],
    "thermal fog": ["--fast", "run", *OUTPUT],
    "thermal apply": ["model.json", "run", *OUTPUT],
    "fleet update": ["runs", *OUTPUT],
    "twin fit": ["run", *OUTPUT],
    "twin check": ["run", "--twin", "twin.json"],
    "twin import": ["imu.yaml", "--from", "kalibr", "-o", "imported.json"],
    "twin export": ["unit.json", "--to", "kalibr"],
    "fleet learn": OUTPUT,
    "fleet forecast": OUTPUT,
    "fleet priors": [],
    "fleet approve": ["1", "--by", "K.", "--reason", "why"],
    "fleet reject": ["1", "--by", "K.", "--reason", "why"],
}
REPORTS = {
    "look": "look",
    "demo": "update",
    "replay": "replay",
    "update": "update",
    "misalignment": "misalignment",
    "plan": "plan",
    "diagnose": "diagnosis",
    "thermal rlg": "thermal_rlg",
    "thermal fog": "thermal_fog",
    "fleet update": "fleet",
    "fleet learn": "priors",
    "fleet forecast": "forecast",
}


def names():
    """Every command that does something, by its full name."""
    commands = get_command(app).commands
    found = list(COMMANDS)
    for group in GROUPS:
        found += [f"{group} {name}" for name in commands[group].commands]
    return found


def refused(url, proposal, *rest):
    return FleetShown(verdict="refused"), None


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A store with two revisions of one unit; slow verbs replaced."""
    monkeypatch.chdir(tmp_path)
    for verb in SLOW.values():
        monkeypatch.setattr(verb, shown)
    monkeypatch.setattr(SLOW["simulate"], lambda *_, **more: SimulationShown())
    monkeypatch.setattr("recal.service.tables.decide", refused)
    monkeypatch.setattr("recal.fleet.update.update_fleet", lambda *_: FleetShown())
    unit = tmp_path / "unit.json"
    unit.write_text(json.dumps(twin_to_dict(default_twin("mems"))))
    (tmp_path / "imu.yaml").write_text(kalibr_text(default_twin("mems"), rate_hz=100.0))
    with TableStore.open("sqlite:///recal.db", create=True) as store:
        data = table_file(tmp_path)
        store.import_table(data)
        data["axes"]["y"]["bias_deg_h"][0] = 0.5
        store.import_table(data)
    return tmp_path


def run(name, *more):
    done = CliRunner().invoke(app, [*name.split(), *QUICK[name], *more])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done


def test_every_command_has_its_quick_form():
    assert {*QUICK, *SELF_TESTED} == set(names())


@pytest.mark.parametrize("name", QUICK)
def test_the_result_goes_to_standard_output_and_nothing_else_does(name, folder):
    said = run(name)
    assert said.stderr == ""
    assert said.stdout.strip() or name == "table proposals"  # there are none
    if name in SLOW:
        assert said.stdout.startswith(WORDS + "\n")
    last = said.stdout.splitlines()[-1:]
    if name in REPORTS:
        assert last == [f"report: {Path('out', REPORTS[name]).with_suffix('.html')}"]
    as_json = run(name, "--json")
    json.loads(as_json.stdout)
    assert as_json.stderr == "" and as_json.exit_code == said.exit_code
    quiet = run(name, "-q")
    assert quiet.output == "" and quiet.exit_code == said.exit_code
    more = run(name, "-v")
    json.loads(more.stderr)
    assert more.stdout == said.stdout or name in ("table import", "table rollback")  # a number on


def test_progress_is_said_on_a_terminal_only(monkeypatch, capsys):
    """On a terminal the step, how many there are, and once that kernels are compiled."""
    from numba import njit

    from recal.cli.terminal.progress import FIRST_RUN, Progress

    with Progress("replaying", quiet=False, steps=2) as told:
        told("reading the run")
    assert capsys.readouterr() == ("", "")
    master, slave = pty.openpty()
    os.set_blocking(master, False)
    with os.fdopen(master, "rb", buffering=0) as seen, os.fdopen(slave, "w") as terminal:
        monkeypatch.setattr("sys.stderr", terminal)
        monkeypatch.setenv("TERM", "xterm")
        for compiled in (False, True):
            with Progress("replaying", quiet=False, steps=2) as told:
                told("reading the run")
                if not compiled:
                    njit(lambda x: x + 1.0)(1.0)
                told("drawing the report")
            terminal.flush()
            said = all_of(seen)
            assert "1/2" in said and "drawing the report" in said
            assert (FIRST_RUN in said) is not compiled
            assert ("kept for the next run" in said) is not compiled
        with Progress("replaying", quiet=True):
            terminal.write("end")
            terminal.flush()
        assert all_of(seen) == "end"


def all_of(seen):
    """What a terminal shows by now; it is read in pieces."""
    pieces = iter(lambda: seen.read(65536), None)
    return b"".join(pieces).decode()
