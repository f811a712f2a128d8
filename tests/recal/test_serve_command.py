"""`recal serve` as it is started: where it listens, which tokens it takes and makes, what it
refuses and says.
"""

import json
import os
import pty
import re
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

pytest.importorskip("fastapi")

import recal
from tests.recal import command
from tests.recal.serving import TOKEN, Visitor, put_unit

URL = "sqlite:///recal.db"
ROOT = str(Path(recal.__file__).parent.parent)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    put_unit(URL)
    return tmp_path


def refused(*arguments):
    return command.refused("serve", *arguments)


@contextmanager
def started(*arguments, terminal=False, **environment):
    """A `recal serve --port 0 --json` of its own: its result, and what it says on standard error
    until it ends.
    """
    reader, writer = pty.openpty() if terminal else os.pipe()
    said = bytearray()

    def listen():
        while True:
            try:
                piece = os.read(reader, 65536)
            except OSError:  # what a terminal says at its end
                return
            if not piece:
                return
            said.extend(piece)

    process = subprocess.Popen(
        [sys.executable, "-m", "recal", "serve", "--port", "0", "--json", *arguments],
        stdout=subprocess.PIPE,
        stderr=writer,
        env={**os.environ, "PYTHONPATH": ROOT, **environment},
    )
    os.close(writer)
    listener = threading.Thread(target=listen)
    listener.start()
    text = b""
    try:
        while not text.endswith(b"}\n"):
            line = process.stdout.readline()
            assert line, said.decode()
            text += line
        yield json.loads(text), said
    finally:
        process.terminate()
        process.wait(timeout=30)
        process.stdout.close()
        listener.join()
        os.close(reader)


def get(url):
    with httpx.Client(trust_env=False, timeout=30) as client:
        for _ in range(100):
            try:
                return client.get(url)
            except httpx.ConnectError:
                continue
    raise AssertionError(f"{url} does not answer")


def test_without_a_token_and_a_terminal_it_only_reads(folder):
    with started() as (result, said):
        assert result["read_only"] is True and result["schema"] == "recal.serve/1"
        assert "Read only" in get(result["url"]).text
    assert b"read only: no token was given" in said and b"token of this start" not in said


def test_on_a_terminal_a_token_is_made_for_this_start(folder):
    with started(terminal=True) as (result, said):
        assert result["read_only"] is False
        get(result["url"])
        token = re.search(rb"token of this start, to sign in with: (\S{30,})", bytes(said))[
            1
        ].decode()
        with Visitor(result["url"]) as visitor:
            assert visitor.sign_in(token).status_code == 303
            assert visitor.sign_in(token[:-1]).status_code == 403
        link = re.search(rb"sign in with one click, once, within 10 min: (\S+)", bytes(said))[1]
        with Visitor(result["url"]) as visitor:
            first = visitor.get(link.decode())
            assert first.status_code == 303 and first.headers["location"] == "/"
            assert "Sign out" in visitor.get("/").text
        with Visitor(result["url"]) as other:
            assert other.get(link.decode()).status_code == 403


def test_a_token_of_a_file_is_never_shown(folder):
    (folder / "token").write_text(TOKEN + "\n")
    (folder / "token").chmod(0o600)
    with started("--token-file", "token", "-v") as (result, said):
        get(result["url"])
        with Visitor(result["url"]) as visitor:
            assert visitor.sign_in(TOKEN).status_code == 303
            assert visitor.sign_in("wrong token").status_code == 403
    assert TOKEN.encode() not in said and b"POST /signin" in said and b"warning" not in said
    (folder / "token").chmod(0o644)
    with started("--token-file", "token", terminal=True) as (_, said):
        pass
    assert b"can be read by every user" in said and b"token of this start" not in said


def test_a_token_of_the_environment_serves_an_open_address(folder):
    with started("--host", "0.0.0.0", RECAL_SERVE_TOKEN=TOKEN) as (result, said):
        base = result["url"].replace("0.0.0.0", "127.0.0.1")
        assert get(base).status_code == 303
        with Visitor(base) as visitor:
            assert visitor.sign_in(TOKEN).status_code == 303 and "SN-1" in visitor.get("/").text
    assert b"warning: no TLS" in said and TOKEN.encode() not in said


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "recal.example"])
def test_an_open_address_needs_a_token(folder, monkeypatch, host):
    monkeypatch.delenv("RECAL_SERVE_TOKEN", raising=False)
    assert f"a token is needed on {host}" in refused("--store", URL, "--host", host)


def test_other_refusals_are_one_line(folder, monkeypatch):
    import socket

    assert "no store at" in refused("--store", "sqlite:///none.db")
    assert not (folder / "none.db").exists()
    assert "no such directory" in refused("--reports", "nowhere")
    assert "cannot be read" in refused("--token-file", "nowhere")
    assert "behind a proxy" in refused("--https")
    monkeypatch.setenv("RECAL_SERVE_TOKEN", "short")
    assert "a token of 5 characters" in refused()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"cannot listen on 127.0.0.1 port {port}" in refused("--port", str(port))
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert refused() == "serve needs FastAPI and uvicorn: pip install strapdown-recal[web]"
