"""What must not get through: other hosts, other sites' forms, guesses, large bodies, paths that
lead out, secrets on a page.
"""

import os
import re
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

pytest.importorskip("fastapi")

from infield.store.table_store import TableStore
from ins.records import InputError
from recal.web import guard, pages
from recal.web.actions import local_path
from recal.web.door import MAX_FAILURES
from recal.web.reports import Reports
from recal.web.settings import ServeSettings
from tests.recal.serving import DECISION, TOKEN, TOKENS, Visitor, put_unit, serving

PROPOSAL = "/proposal?serial=SN-1&technology=rlg&number=1"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("guarded")
    url = f"sqlite:///{folder}/recal.db"
    put_unit(url)
    (folder / "reports/in").mkdir(parents=True)
    (folder / "reports/in/diagnosis.json").write_text("[" * 100_000)
    (folder / "secret").mkdir()
    (folder / "secret/diagnosis.json").write_text(
        '{"schema": "recal.diagnosis/1", "sentence": "TOP SECRET"}'
    )
    (folder / "secret/diagnosis.html").write_text("TOP SECRET")
    (folder / "reports/link").symlink_to(folder / "secret")
    (folder / "reports/linked").mkdir()
    for name in ("diagnosis.json", "diagnosis.html"):
        (folder / "reports/linked" / name).symlink_to(folder / "secret" / name)
    (folder / "reports/loop").symlink_to(folder / "reports/loop")
    with serving(url, reports=folder / "reports") as base:
        yield base, url, folder


@pytest.fixture
def visitor(site):
    with Visitor(site[0]) as found:
        yield found


def unchanged(url):
    with TableStore.open(url) as store:
        return len(store.history()) == 2 and store.proposals()[0].decision is None


def raw(base, request, *, cut_off=False):
    """The answer to bytes that no client library would send."""
    host, port = base.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=20) as connection:
        connection.sendall(request)
        if cut_off:
            connection.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: connection.recv(65536), b""))


def test_every_answer_carries_the_headers(visitor):
    document = "/proposal/update.json?serial=SN-1&technology=rlg&number=1"
    for path in ("/", PROPOSAL, "/nothing", "/signin", "/unit?serial=SN-1", document):
        headers = visitor.get(path).headers
        assert (
            headers["x-content-type-options"] == "nosniff" and headers["x-frame-options"] == "DENY"
        ), path
        assert headers["cache-control"] == "no-store"
        assert headers["referrer-policy"] == "same-origin"
        policy = headers["content-security-policy"]
        assert policy.startswith("default-src 'none'")
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert "server" not in headers
    refused = visitor.get("/", headers={"host": "evil.example"})
    assert refused.headers["x-frame-options"] == "DENY"
    assert refused.headers["content-security-policy"]


FORMS = ("/signin", "/signout", "/decide", "/rollback")


def test_no_page_and_no_form_is_served_under_another_name(site, visitor):
    visitor.sign_in()
    form = {**DECISION, "form_token": visitor.form_token(PROPOSAL), "to": "1", "active": "2"}
    evil = {"host": "evil.example"}
    for path in (*PRIVATE, "/signin", "/login?ticket=x"):
        assert visitor.get(path, headers=evil).status_code == 421, path
    # whose cookie a foreign name brings along is not told, nor the token of the forms
    for answer in (visitor.get("/nothing", headers=evil), visitor.put("/", headers=evil)):
        assert answer.status_code in (404, 405) and "form_token" not in answer.text
    for path in FORMS:
        answer = visitor.submit(path, headers={**evil, "origin": "http://evil.example"}, **form)
        assert answer.status_code == 421 and "SN-1" not in answer.text, path
    assert unchanged(site[1])


def test_no_form_of_another_site_is_taken(site, visitor):
    visitor.sign_in()
    form = {**DECISION, "form_token": visitor.form_token(PROPOSAL), "to": "1", "active": "2"}
    for path in FORMS:
        answer = visitor.submit(path, headers={"origin": "http://evil.example"}, **form)
        assert answer.status_code == 403 and "did not come from this page" in answer.text, path
    assert unchanged(site[1]) and "Sign out" in visitor.get("/").text


def test_no_host_and_two_hosts_are_not_served(site):
    for request in (
        b"GET / HTTP/1.0\r\n\r\n",
        b"GET / HTTP/1.1\r\nConnection: close\r\nHost: localhost\r\nHost: evil.example\r\n\r\n",
    ):
        answer = raw(site[0], request)
        assert answer.split()[1] in (b"400", b"421") and b"SN-1" not in answer


IDLE = (  # what a client may leave the server waiting for
    b"",
    b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Slow: ",
    b"POST /signin HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\n"
    b"Sec-Fetch-ReviewSite: same-origin\r\nContent-Type: application/x-www-form-urlencoded\r\n"
    b"Content-Length: 100\r\n\r\na=",
)


@pytest.mark.parametrize("begun", IDLE, ids=["nothing", "half-a-head", "half-a-form"])
def test_idle_connections_make_room_for_a_new_one(site, begun):
    """Twice as many as may be open at once, beyond the limit where uvicorn answers 503."""
    where = site[0].removeprefix("http://").split(":")
    held = [socket.create_connection((where[0], int(where[1])), timeout=10) for _ in range(130)]
    try:
        for connection in held:
            connection.sendall(begun)
        for _ in range(3):
            assert httpx.get(f"{site[0]}/", trust_env=False, timeout=10).status_code == 200
        dropped = [connection for connection in held[:60] if is_closed(connection)]
        assert len(dropped) == 60 and not is_closed(held[-1])
    finally:
        for connection in held:
            connection.close()


def is_closed(connection):
    """Whether the server has ended a connection."""
    connection.settimeout(0.05)
    try:
        return connection.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True


def test_a_request_at_work_is_never_dropped(site, monkeypatch):
    """A slow answer arrives, although twice as many connections as may be open come after it."""
    at_work, go_on = threading.Event(), threading.Event()
    judged = pages.views.unit_health

    def slow(*units):
        at_work.set()
        assert go_on.wait(20.0)
        return judged(*units)

    monkeypatch.setattr(pages.views, "unit_health", slow)
    where = site[0].removeprefix("http://").split(":")
    with Visitor(site[0]) as visitor, ThreadPoolExecutor(1) as reader:
        page = reader.submit(visitor.get, "/")
        assert at_work.wait(20.0)
        held = [socket.create_connection((where[0], int(where[1])), timeout=10) for _ in range(130)]
        try:
            deadline = time.monotonic() + 20.0
            while not is_closed(held[0]):
                assert time.monotonic() < deadline
        finally:
            go_on.set()
            for connection in held:
                connection.close()
        assert page.result().status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example", "sec-fetch-site": "cross-site"},
        {"origin": "null", "sec-fetch-site": "same-origin"},
        {"sec-fetch-site": "same-site"},
        {"sec-fetch-site": "none"},
        {"sec-fetch-site": "cross-site"},
        {"origin": "http://127.0.0.1:1"},
        {"origin": "http://localhost.evil.example"},
    ],
)
def test_a_form_from_another_site_is_refused(site, visitor, headers):
    visitor.sign_in()
    token = visitor.form_token(PROPOSAL)
    answer = visitor.submit("/decide", headers=headers, form_token=token, **DECISION)
    assert answer.status_code == 403 and unchanged(site[1])


def test_a_form_that_says_nothing_of_its_origin_is_refused(site, visitor):
    visitor.sign_in()
    assert (
        visitor.post(
            "/decide", data={**DECISION, "form_token": visitor.form_token(PROPOSAL)}
        ).status_code
        == 403
    )
    assert unchanged(site[1])


def test_a_form_needs_its_session_and_its_own_token(site, visitor):
    # nobody is signed in
    assert visitor.submit("/decide", form_token="0" * 64, **DECISION).status_code == 403
    with Visitor(site[0]) as other:
        other.sign_in()
        of_other = other.form_token(PROPOSAL)
    visitor.sign_in()
    for token in ("", "0" * 64, of_other, "é"):
        assert visitor.submit("/decide", form_token=token, **DECISION).status_code == 403
    assert visitor.submit("/decide", **DECISION).status_code == 403
    for path in ("/rollback", "/signout", "/signin"):
        assert visitor.submit(path, **DECISION, to="1", active="2", token=TOKEN).status_code == 403
    assert unchanged(site[1])


def test_a_session_ends_with_sign_out(site, visitor):
    visitor.sign_in()
    cookie = {"recal_session": visitor.cookies["recal_session"]}
    token = visitor.form_token(PROPOSAL)
    assert visitor.submit("/signout", form_token=token).status_code == 303
    with Visitor(site[0], cookies=cookie) as thief:
        assert thief.submit("/decide", form_token=token, **DECISION).status_code == 403
        assert unchanged(site[1])


def test_the_cookie_is_for_this_site_alone(visitor):
    answer = visitor.sign_in()
    cookie = next(
        c for c in answer.headers.get_list("set-cookie") if c.startswith("recal_session=")
    )
    assert {"HttpOnly", "SameSite=strict", "Path=/"} <= set(cookie.split("; "))
    assert "Domain" not in cookie
    assert TOKEN not in cookie and len(visitor.cookies["recal_session"]) > 40


def test_behind_tls_cookies_are_for_https_alone(tmp_path):
    url = f"sqlite:///{tmp_path}/recal.db"
    put_unit(url, updates=0, proposals=0)
    with serving(url, https=True) as base, Visitor(base) as visitor:
        page = visitor.get("/signin")
        cookie = page.headers["set-cookie"]
        assert cookie.startswith("__Host-recal_session=")
        assert "Secure" in cookie
        assert "Domain" not in cookie
        assert page.headers["strict-transport-security"] == "max-age=31536000"
        token = re.search(r'name="form_token" value="(\w+)"', page.text)[1]
        given = {"cookie": cookie.partition(";")[0], "origin": base.replace("http:", "https:")}
        done = visitor.submit("/signin", headers=given, token=TOKEN, form_token=token, next="/")
        assert done.status_code == 303
        assert done.headers["set-cookie"].startswith("__Host-recal_session=")


def test_guesses_are_limited(tmp_path):
    url = f"sqlite:///{tmp_path}/recal.db"
    put_unit(url)
    with serving(url) as base, Visitor(base) as visitor:
        answers = [visitor.sign_in(f"guess {k} of a token") for k in range(MAX_FAILURES + 1)]
        assert [a.status_code for a in answers] == [403] * MAX_FAILURES + [429]
        assert "not a token" in answers[0].text and int(answers[-1].headers["retry-after"]) > 200
        assert visitor.sign_in(TOKEN).status_code == 429  # the right one has to wait, too


def test_without_a_token_it_only_reads(tmp_path):
    url = f"sqlite:///{tmp_path}/recal.db"
    put_unit(url)
    with serving(url, tokens=()) as base, Visitor(base) as visitor:
        assert "Read only" in visitor.get("/").text
        assert "roll back" not in visitor.get("/unit?serial=SN-1&technology=rlg").text
        assert visitor.get("/signin").status_code == 200
        assert 'name="token"' not in visitor.get("/signin").text
        assert visitor.submit("/decide", form_token="", **DECISION).status_code == 403
        assert unchanged(url)


OF_UNIT = "serial=SN-1&technology=rlg"
PRIVATE = (
    "/",
    PROPOSAL,
    "/proposals",
    "/forecast",
    "/diagnoses",
    f"/unit?{OF_UNIT}",
    f"/diff?{OF_UNIT}",
    f"/rollback?{OF_UNIT}&to=1",
    f"/revision/report?{OF_UNIT}&number=2",
    f"/proposal/report?{OF_UNIT}&number=1",
    "/diagnosis?folder=a",
    f"/proposal/update.json?{OF_UNIT}&number=1",
    "/diagnosis/page?folder=a",
    "/diagnosis/document?folder=a",
)


def test_beyond_this_machine_reading_needs_a_token_too(tmp_path):
    url = f"sqlite:///{tmp_path}/recal.db"
    put_unit(url)
    with serving(url, hosts=("recal.fleet",)) as base, Visitor(base) as visitor:
        for path in PRIVATE:
            answer = visitor.get(path)
            assert answer.status_code == 303 and answer.headers["location"].startswith(
                "/signin?next=%2F"
            ), path
            assert "SN-1" not in answer.text
        assert visitor.sign_in(next="/proposals").headers["location"] == "/proposals"
        assert visitor.get("/", headers={"host": "recal.fleet"}).status_code == 200


@pytest.mark.parametrize(
    "path", ["https://evil.example/", "//evil.example", "/\\evil.example", "evil", "", "/a\nb"]
)
def test_signing_in_leads_nowhere_else(visitor, path):
    assert local_path(path) == "/"
    assert visitor.sign_in(next=path).headers["location"] == "/"
    assert local_path("/unit?serial=a%2Fb") == "/unit?serial=a%2Fb"


FOLDERS = (
    "..",
    "../secret",
    "in/../../secret",
    "link",
    "link/",
    "linked",
    "loop",
    "/etc",
    "//etc",
    ".",
    "in\0",
    "..\\secret",
    "%2e%2e/secret",
    "....//secret",
    "in/../../secret/",
    "~",
    "a" * 5000,
    "in/" * 500,
)


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_path_leads_out_of_the_reports(site, visitor, folder):
    for path in ("/diagnosis", "/diagnosis/page", "/diagnosis/document"):
        answer = visitor.get(path, params={"folder": folder})
        assert answer.status_code == 404 and "TOP SECRET" not in answer.text
    base, _, root = site
    answer = raw(
        base,
        b"GET /diagnosis/page?folder=%2e%2e%2fsecret HTTP/1.1\r\nHost: localhost\r\nConnection:"
        b" close\r\n\r\n",
    )
    assert b" 404 " in answer.split(b"\r\n")[0] and b"TOP SECRET" not in answer
    assert Reports(root / "reports").text("in", "../../secret/diagnosis.html") is None
    listed = visitor.get("/diagnoses").text
    assert "not JSON" in listed and "SECRET" not in listed and "linked" not in listed


@pytest.mark.parametrize(
    "path",
    [b"/../../etc/passwd", b"/%2e%2e/%2e%2e/etc/passwd", b"//evil.example/", b"/static/../x", b"*"],
)
def test_odd_paths_are_no_pages(site, path):
    answer = raw(
        site[0], b"GET " + path + b" HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    )
    assert answer.split()[1] in (b"404", b"400")
    assert b"root:" not in answer
    assert b"Traceback" not in answer


def test_a_large_form_is_refused(site, visitor):
    visitor.sign_in()
    token = visitor.form_token(PROPOSAL)
    answer = visitor.submit("/decide", form_token=token, **{**DECISION, "reason": "x" * 40_000})
    assert answer.status_code == 413 and unchanged(site[1])
    headers = (
        "POST /decide HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\nConnection:"
        " close\r\nContent-Type: "
    )
    form = headers + "application/x-www-form-urlencoded\r\n"
    assert raw(site[0], f"{form}Content-Length: 99999999\r\n\r\nabc".encode()).split()[1] == b"413"
    assert b" 303 " not in raw(
        site[0], f"{form}Content-Length: 5\r\n\r\nabc".encode(), cut_off=True
    )
    chunks = (
        form
        + "Transfer-Encoding: chunked\r\n\r\n"
        + 20 * ("1000\r\n" + 4096 * "x" + "\r\n")
        + "0\r\n\r\n"
    )
    assert raw(site[0], chunks.encode()).split()[1] == b"413"


def test_a_form_that_never_ends_is_let_go(site, monkeypatch):
    monkeypatch.setattr(guard, "BODY_WAIT_S", 0.2)
    head = (
        "POST /decide HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\nConnection:"
        " close\r\n"
    )
    slow = (
        f"{head}Content-Type: application/x-www-form-urlencoded\r\nContent-Length:"
        " 100\r\n\r\nserial=S"
    )
    assert raw(site[0], slow.encode()).split()[1] == b"408"


@pytest.mark.parametrize(
    "kind, body, status",
    [
        ("application/json", b"{}", 415),
        ("multipart/form-data; boundary=x", b"--x--", 415),
        ("text/plain", b"a=b", 415),
        ("application/x-www-form-urlencoded", b"\xff\xfe", 400),
        ("application/x-www-form-urlencoded", b"a=%ff", 400),
        ("application/x-www-form-urlencoded", b"&".join(b"a%d=1" % k for k in range(50)), 400),
        ("application/x-www-form-urlencoded", b"form_token=a&form_token=b", 400),
        ("", b"a=b", 415),
    ],
)
def test_what_is_no_form_is_refused(visitor, kind, body, status):
    visitor.sign_in()
    origin = {"origin": str(visitor.base_url).rstrip("/"), "content-type": kind}
    assert visitor.post("/decide", content=body, headers=origin).status_code == status


def test_a_fault_shows_no_trace_and_no_secret(tmp_path, monkeypatch):
    url = f"sqlite:///{tmp_path}/recal.db"
    put_unit(url)

    def broken(*arguments, **options):
        raise RuntimeError("password=hunter2 in " + str(tmp_path))

    with serving(url) as base, Visitor(base) as visitor:
        monkeypatch.setattr(pages.views, "unit_health", broken)
        answer = visitor.get("/")
        assert answer.status_code == 500 and "does not know" in answer.text
        assert not re.search(r"hunter2|Traceback|RuntimeError|File &#34;|/tmp", answer.text)
        assert answer.headers["x-frame-options"] == "DENY"
        assert "script" not in answer.headers["content-security-policy"]
        os.rename(tmp_path / "recal.db", tmp_path / "gone.db")
        with Visitor(base) as other:  # a server may close the connection that it failed on
            gone = other.get("/unit?serial=SN-1&technology=rlg")
        assert gone.status_code == 503 and str(tmp_path) not in gone.text


def test_no_page_names_the_database_password(tmp_path):
    """A PostgreSQL that is not there: what the driver says is shown without address or password."""
    pytest.importorskip("psycopg")
    from recal.web.site import ReviewSite

    with pytest.raises(InputError) as refused:
        ReviewSite(
            ServeSettings(store_url="postgresql://user:hunter2@127.0.0.1:1/db", tokens=TOKENS)
        )
    assert "hunter2" not in str(refused.value)
