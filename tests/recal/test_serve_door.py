"""The parts of `recal serve` that need no server: tokens, the door, hosts, the directory of
reports.
"""

import json
import os

import pytest

from ins.records import InputError
from recal.web.door import MAX_FAILURES, SESSION_S, TICKET_S, Door, TooManyGuesses
from recal.web.guard import allowed_host
from recal.web.reports import Reports
from recal.web.settings import ServeSettings, read_tokens, token_of

TOKEN = "0123456789abcdef-shared"
TOKENS = (
    token_of(TOKEN, source="test"),
    token_of("0123456789abcdef-of-her", "R. Eviewer", source="test"),
)


def test_which_hosts_are_ours():
    here = ServeSettings(store_url="x")
    there = ServeSettings(store_url="x", host="0.0.0.0", tokens=TOKENS, hosts=("recal.fleet",))
    for host in ("127.0.0.1:8000", "localhost:9", "[::1]:8000", "127.0.0.1"):
        assert allowed_host(host, here) and allowed_host(host, there)
    for host in ("10.1.2.3:8000", "recal.fleet", "RECAL.FLEET:443", "[fe80::1]:8000"):
        assert allowed_host(host, there) and not allowed_host(host, here)
    for host in (
        "evil.example",
        "x@127.0.0.1",
        "127.0.0.1:x",
        "localhost/a",
        "localhost?a",
        "127.0.0.1.evil.example",
        "[::1].evil",
        "[::1].evil:8000",
        "[::1]x:8000",
        "x[::1]",
        "::1",
        "[127.0.0.1]",
        "[localhost]",
        "[::1]:70000",
        "127.0.0.1:8000:9",
        "127.0.0.1 ",
        "localhost\n",
        "",
    ):
        assert not allowed_host(host, here) and not allowed_host(host, there)


def test_the_door_forgets_failures_and_old_sessions():
    now = [0.0]
    door = Door(TOKENS, clock=lambda: now[0])
    session = door.sign_in(TOKEN, "a")
    for _ in range(MAX_FAILURES):
        assert door.sign_in("wrong", "a") is None
    with pytest.raises(TooManyGuesses):
        door.sign_in(TOKEN, "a")
    assert door.sign_in(TOKEN, "b") is not None  # another address does not pay for it
    now[0] = 301.0
    assert door.sign_in(TOKEN, "a") is not None and door.session(session).name == ""
    now[0] = SESSION_S
    assert door.session(session) is None and door.session("") is None
    assert Door(()).locked and Door(()).sign_in("", "a") is None


def test_guesses_from_many_addresses_are_limited_too():
    door = Door(TOKENS, clock=lambda: 0.0)
    with pytest.raises(TooManyGuesses):
        for k in range(1000):
            door.sign_in("wrong", f"10.0.{k // 250}.{k % 250}")


def test_tokens_come_from_a_file_or_the_environment(tmp_path, monkeypatch):
    path = tmp_path / "tokens"
    path.write_text("# reviewers\n0123456789abcdef\n\nR. Eviewer  0123456789abcdeg\n")
    assert [t.name for t in read_tokens(path)] == ["", "R. Eviewer"]
    monkeypatch.setenv("RECAL_SERVE_TOKEN", TOKEN)
    assert read_tokens(None) == (token_of(TOKEN, source="x"),)
    assert "RECAL_SERVE_TOKEN" not in os.environ and read_tokens(None) == ()


@pytest.mark.parametrize(
    "text, line",
    [
        ("short", "line 1: a token of 5 characters"),
        ("", "holds no token"),
        ("# only\n", "holds no token"),
        ("0123456789abcdef\nB 0123456789abcdef\n", "same token twice"),
        ("Wörd 0123456789abcdéf", "printable ASCII"),
        ("x" * 70_000, "more than 65536 bytes"),
    ],
)
def test_a_bad_token_file_is_one_line_without_the_token(tmp_path, text, line):
    path = tmp_path / "tokens"
    path.write_text(text)
    with pytest.raises(InputError, match=line) as refused:
        read_tokens(path)
    assert "0123456789" not in str(refused.value)
    with pytest.raises(InputError, match="cannot be read"):
        read_tokens(tmp_path / "nothing")


def test_reports_are_read_with_limits(tmp_path, monkeypatch):
    from recal.web import reports

    (tmp_path / "a").mkdir()
    (tmp_path / "a/diagnosis.json").write_text(
        json.dumps({"schema": "recal.diagnosis/1", "verdict": "no_gap"})
    )
    os.mkfifo(tmp_path / "a/diagnosis.html")
    found = Reports(tmp_path)
    assert found.one("a").document["verdict"] == "no_gap"
    assert not found.one("a").has_page and found.text("a", "diagnosis.html") is None
    assert Reports(None).all() == [] and Reports(None).one("a") is None
    monkeypatch.setattr(reports, "LARGEST", 10)
    assert "needed a file of at most 10" in found.one("a").fault
    with pytest.raises(InputError, match="no such directory"):
        Reports(tmp_path / "nothing")


def test_a_login_link_lets_in_once_and_not_for_long():
    now, ticket = [0.0], token_of("0123456789abcdef-ticket", source="test")
    door = Door(TOKENS, clock=lambda: now[0], ticket=ticket)
    assert door.sign_in_once("0123456789abcdef-guess") is None
    assert door.sign_in_once(TOKEN) is None  # a token is no ticket
    assert door.sign_in("0123456789abcdef-ticket", "there") is None  # nor the other way round
    session = door.session(door.sign_in_once("0123456789abcdef-ticket"))
    assert session is not None and session.name == ""
    assert door.sign_in_once("0123456789abcdef-ticket") is None  # spent
    late = Door(TOKENS, clock=lambda: now[0], ticket=ticket)
    now[0] += TICKET_S
    assert late.sign_in_once("0123456789abcdef-ticket") is None


def test_wrong_login_links_lock_nobody_out():
    """A page of another site can make a browser ask for /login?ticket=x as often as it likes."""
    door = Door(TOKENS, ticket=token_of("0123456789abcdef-ticket", source="test"))
    for _ in range(2 * MAX_FAILURES):
        assert door.sign_in_once("x") is None
    assert door.session(door.sign_in(TOKEN, "there")) is not None
    for _ in range(MAX_FAILURES):
        door.sign_in("0123456789abcdef-guess", "there")
    with pytest.raises(TooManyGuesses):
        door.sign_in(TOKEN, "there")
    assert door.session(door.sign_in_once("0123456789abcdef-ticket")) is not None
