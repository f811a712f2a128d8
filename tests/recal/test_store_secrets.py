"""A password in a store's URL is in no output, report or JSON of any command, also where the
command fails.
"""

import json

import pytest
from sqlalchemy import create_engine, make_url, text
from sqlalchemy.pool import NullPool
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from ins.documents import plain
from recal.cli.app import app
from tests.forks import plain_page
from tests.infield.sessions import PARKED, factory_dict, simulated
from tests.infield.stores import database_url
from trajectories.runs.directory import write_run

SECRET = "hunter2Q%41z"  # in a URL: %25 for the percent sign
IN_URL = "hunter2Q%2541z"
NOBODY_LISTENS = f"postgresql://recal:{IN_URL}@127.0.0.1:1/fleet"
BAD_URLS = (
    NOBODY_LISTENS,
    f"postgresql://127.0.0.1:1/fleet?user=recal&password={IN_URL}",
    f"postgresql://recal:{SECRET}@x@127.0.0.1:1/fleet",
    f"postgresql//recal:{SECRET}@127.0.0.1/fleet",
    f"postgresql://recal:{SECRET}@127.0.0.1:port/fleet",
    f"nosuch://recal:{IN_URL}@127.0.0.1/fleet",
    f"{NOBODY_LISTENS}?nosuchoption=1",
    f"{NOBODY_LISTENS}?sslpassword={IN_URL}",
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    write_run(folder / "run", simulated(1, PARKED).run)
    return str(folder / "run")


def silent(done, folder):
    """Nothing printed, raised or written holds the password, in any of its forms."""
    texts = [
        done.output,
        done.stderr,
        str(done.exception),
        repr(done.exception),
        str(done.exc_info),
    ]
    texts += [
        p.read_text(errors="replace")
        for p in folder.rglob("*")
        if p.is_file() and "run" not in p.parent.name
    ]
    for said in texts:
        assert "hunter2" not in said, said[:2000]


def commands(run, table):
    yield from (["table", name] for name in ("list", "show", "diff", "verify"))
    yield ["table", "rollback", "--by", "B", "--reason", "why"]
    yield ["table", "export", "-o", "exported.json"]
    yield ["table", "import", str(table)]
    yield ["update", run, "-o", "out"]
    yield ["update", run, "-o", "out", "--commit"]
    yield ["align", run, "-o", "out"]
    yield ["replay", run, "-o", "out"]


@pytest.mark.parametrize("bad", BAD_URLS)
def test_a_store_that_cannot_be_opened(run, tmp_path, monkeypatch, bad):
    monkeypatch.chdir(tmp_path)
    table = tmp_path / "table.json"
    table.write_text(json.dumps(factory_dict()))
    every = list(commands(run, table))
    for words in every if bad == NOBODY_LISTENS else (every[0], every[8]):
        done = CliRunner().invoke(app, [*words, "--store", bad, "--json"])
        assert done.exit_code != 0, words
        silent(done, tmp_path)
        assert json.loads(done.stdout)["reasons"][0].startswith("store "), words


def with_password(url, name):
    """The URL of a new role that owns all and has the password."""
    engine = create_engine(url, poolclass=NullPool)
    quoted = engine.dialect.identifier_preparer.quote(name)
    with engine.begin() as c:
        c.execute(text(f"CREATE ROLE {quoted} SUPERUSER LOGIN PASSWORD '{SECRET}'"))
    return make_url(url).set(username=name, password=SECRET).render_as_string(hide_password=False)


def test_a_store_that_works_and_one_that_takes_no_write(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "infield.reports.update_page.update_html",
        lambda document: plain_page(document) + json.dumps(plain(document)),
    )
    table = tmp_path / "table.json"
    table.write_text(json.dumps(factory_dict()))
    with database_url("postgresql", tmp_path) as owner:
        name = f"recal_secret_{tmp_path.name[-8:]}_{abs(hash(owner)) % 10**9}"
        url = with_password(owner, name)
        try:
            with TableStore.open(url, create=True) as store:
                store.import_table({**factory_dict(), "created_utc": "2025-01-01T00:00:00Z"})
            for words in (*commands(run, table), ["update", run, "-o", "out", "--commit"]):
                done = CliRunner().invoke(app, [*words, "--store", url, "--json"])
                silent(done, tmp_path)
                assert words[-1] != "--commit" or "rollback_command" in json.loads(done.stdout)
            options = f"{make_url(url).query['options']} -c default_transaction_read_only=on"
            read_only = make_url(url).update_query_dict({"options": options})
            words = [
                "table",
                "rollback",
                *("--by", "B", "--reason", "why"),
                "--to",
                "1",
                "--store",
                read_only.render_as_string(hide_password=False),
                "--json",
            ]
            done = CliRunner().invoke(app, words)
            assert "read-only" in done.stdout
            silent(done, tmp_path)
        finally:
            engine = create_engine(owner, poolclass=NullPool)
            with engine.begin() as c:
                c.execute(text(f"REASSIGN OWNED BY {name} TO CURRENT_USER"))
                c.execute(text(f"DROP ROLE {name}"))
