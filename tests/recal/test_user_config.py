"""The user's config.toml: the store and the operator of commands that name none; RECAL_STORE comes
before it, an option before both.
"""

import json

import pytest
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from ins.records import InputError
from recal.cli.app import app
from recal.cli.console import login_name
from recal.cli.terminal.user_config import UserConfig, config_path, read_user_config
from tests.recal.test_table import table_file


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("RECAL_STORE", raising=False)
    monkeypatch.chdir(tmp_path)
    file = config_path()
    file.parent.mkdir(parents=True)
    return file


def listed(*more):
    done = CliRunner().invoke(app, ["table", "list", "--json", *more])
    assert done.exit_code == 0, done.exception
    return json.loads(done.stdout)["units"]


def store(folder, name, serial):
    url = f"sqlite:///{folder / name}"
    with TableStore.open(url, create=True) as opened:
        opened.import_table(table_file(folder, serial))
    return url


def test_an_option_comes_before_the_environment_and_that_before_the_file(
    config, tmp_path, monkeypatch
):
    urls = [store(tmp_path, f"{k}.db", f"SN-{k}") for k in range(4)]
    (tmp_path / "0.db").rename(tmp_path / "recal.db")

    def serial(*more):
        return listed(*more)[0]["imu_serial"]

    assert serial() == "SN-0"
    config.write_text(f'store = "{urls[1]}"\n')
    assert serial() == "SN-1"
    monkeypatch.setenv("RECAL_STORE", urls[2])
    assert serial() == "SN-2"
    assert serial("--store", urls[3]) == "SN-3"


def test_what_the_file_says(config):
    assert read_user_config() == UserConfig()
    config.write_text('operator = "K. Reviewer"\norganisation = "Hangar 3"\npart_number = "7-1"\n')
    found = read_user_config()
    assert (found.operator, found.organisation, found.store) == ("K. Reviewer", "Hangar 3", "")


def test_the_operator_proposes_and_approves(config, monkeypatch, tmp_path):
    signed = []

    def decide(url, proposal, unit, by, reason):
        signed.append(by)
        raise InputError("seen")

    monkeypatch.setattr("recal.service.tables.decide", decide)
    words = ["table", "approve", "1", "--reason", "why"]
    CliRunner().invoke(app, words)
    config.write_text('operator = "K. Reviewer"\n')
    CliRunner().invoke(app, words)
    CliRunner().invoke(app, [*words, "--by", "A. Other"])
    assert signed == [login_name(), "K. Reviewer", "A. Other"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('stroe = "x"\n', "key 'stroe', needed one of"),
        ("store = 3\n", "store = 3, needed a text in quotes"),
        ("store = \n", "cannot be read"),
    ],
)
def test_a_mistake_in_the_file_is_one_line(config, text, said):
    config.write_text(text)
    result = CliRunner().invoke(app, ["table", "list"])
    assert isinstance(result.exception, InputError) and str(config) in str(result.exception)
    assert said in str(result.exception) and "\n" not in str(result.exception)


def test_reports_name_who_issues_them(tmp_path, monkeypatch):
    """Organisation, department, operator, instrument type and part number stand on every page."""
    from infield.reports import issuer
    from infield.reports.page import render_page
    from recal.service.results.issuer import set_issuer

    monkeypatch.setattr(issuer, "_set", [issuer.Issuer()])
    assert "issued by" not in render_page("base.html.j2")
    said = UserConfig(
        organisation="Hangar <3>", operator="A. Engineer", instrument_type="RLG-9", part_number="77"
    )
    set_issuer(said)
    page = render_page("base.html.j2")
    for text in ("Hangar &lt;3&gt;", "A. Engineer", "RLG-9", "77"):
        assert f"<strong>{text}</strong>" in page
