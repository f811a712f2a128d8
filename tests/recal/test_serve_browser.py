"""The review page in a real browser, headless: it is whole without script, fits a phone, and works
from the keyboard.
"""

import json
import re
import time

import pytest

pytest.importorskip("fastapi")

from infield.store.table_store import TableStore
from recal.web import pages
from recal.web.settings import token_of
from tests.recal.chromium import chromium, find_chromium
from tests.recal.serving import TOKEN, put_unit, serving

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="no chromium on this machine")

UNIT = "/unit?serial=SN-1&technology=rlg"
PROPOSAL = "/proposal?serial=SN-1&technology=rlg&number={}"
HOSTILE = """<!DOCTYPE html><title>r</title><style>p { color: red }</style><p id="p">report</p>
<script>top.location = "/nothing"</script>"""
BEYOND = """[...document.querySelectorAll("main *, .top *")].filter(
    e => e.checkVisibility() && !e.closest(".scroll, svg, .drawing") && e.getBoundingClientRect().right > WIDTH + 1
).map(e => e.outerHTML.slice(0, 80))"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    folder = tmp_path_factory.mktemp("browsed")
    url = f"sqlite:///{folder}/recal.db"
    put_unit(url, proposals=3)
    put_unit(url, "SN-2-" + "long" * 20, note='<script>document.title = "broken"</script>')
    (folder / "reports/a").mkdir(parents=True)
    said = {
        "schema": "recal.diagnosis/1",
        "verdict": "refused",
        "sentence": "No run.",
        "imu_serial": "SN-1",
        "gyro_technology": "rlg",
    }
    (folder / "reports/a/diagnosis.json").write_text(json.dumps(said))
    (folder / "reports/a/diagnosis.html").write_text(HOSTILE)
    patch = pytest.MonkeyPatch()
    patch.setattr(pages, "stored_update_html", lambda document: HOSTILE)
    with serving(url, reports=folder / "reports") as base:
        yield base, url
    patch.undo()


@pytest.mark.parametrize(
    "path",
    [
        "/",
        UNIT,
        PROPOSAL.format(1),
        "/proposals",
        "/forecast",
        "/diff?serial=SN-1&technology=rlg",
        "/diagnoses",
        "/diagnosis?folder=a",
        "/signin",
        "/nothing",
        "/?q=long",
    ],
)
def test_a_page_keeps_its_policy_and_fits_a_phone(browser, served, path):
    for width, mobile in ((1200, False), (420, True)):
        browser.size(width, mobile=mobile)
        browser.open(served[0] + path)
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
        assert browser.evaluate(BEYOND.replace("WIDTH", str(width))) == []
    broken = [
        line for line in browser.complaints() if "404" not in line and "sandboxed" not in line
    ]
    assert broken == [], broken  # no style, frame or script against the policy of the page
    # the style sheet was let through
    assert browser.evaluate("getComputedStyle(document.body).color") == "rgb(27, 31, 36)"
    requests = [
        e["params"]["request"]["url"]
        for e in browser.events
        if e["method"] == "Network.requestWillBeSent"
    ]
    assert all(url.startswith((served[0], "data:")) for url in requests), requests


def test_every_field_and_link_has_a_name(browser, served):
    sign_in(browser, served[0])
    unnamed = """[...document.querySelectorAll("input:not([type=hidden], [hidden]), select, textarea")]
        .filter(e => !e.labels.length).length
        + [...document.querySelectorAll("a, button")].filter(e => !(e.innerText.trim() || e.ariaLabel)).length"""
    for path in (
        "/",
        UNIT,
        PROPOSAL.format(1),
        "/signin",
        "/rollback?serial=SN-1&technology=rlg&to=1",
    ):
        browser.open(served[0] + path)
        assert browser.evaluate(unnamed) == 0, path
        assert browser.evaluate("document.querySelectorAll('h1').length") == 1
        assert browser.evaluate("document.documentElement.lang")
        ids = browser.evaluate("[...document.querySelectorAll('[id]')].map(e => e.id)")
        assert len(ids) == len(set(ids)), path


def test_a_hostile_report_stays_in_its_sandbox(browser, served):
    for path, frame in (
        (PROPOSAL.format(1), "/proposal/report"),
        ("/diagnosis?folder=a", "/diagnosis/page"),
    ):
        browser.open(served[0] + path)
        source = browser.evaluate("document.querySelector('iframe').src")
        assert frame in source
        assert (
            browser.evaluate("document.querySelector('iframe').contentDocument") is None
        )  # another origin
        assert browser.evaluate("location.pathname + location.search") == path
        browser.open(source)  # alone: still without script
        assert browser.evaluate("document.title") == "r"
        assert browser.evaluate("getComputedStyle(p).color") == "rgb(255, 0, 0)"
    browser.open(served[0] + "/unit?technology=rlg&serial=SN-2-" + "long" * 20)
    assert browser.evaluate("document.title").startswith("SN-2-long")


def test_no_other_site_can_frame_or_send_a_form(browser, served, tmp_path):
    sign_in(browser, served[0])
    framing = tmp_path / "evil.html"
    framing.write_text(
        f'<iframe src="{served[0]}/"></iframe><form id="f" method="post"'
        f' action="{served[0]}/decide"><input name="serial" value="SN-1"><input name="technology"'
        ' value="rlg"></form>'
    )
    browser.open(framing.as_uri())
    assert (
        any("frame" in line.lower() for line in browser.complaints())
        or browser.evaluate("frames[0].length") == 0
    )
    browser.submit("document.getElementById('f').submit()")
    assert "did not come from this page" in browser.evaluate("document.body.innerText")


@pytest.mark.slow
def test_the_login_link_signs_in_once(browser, tmp_path):
    """A browser that opens the printed link is signed in and stays so, a second click included;
    a browser that knows nothing yet is refused.
    """
    url = f"sqlite:///{tmp_path}/recal.db"
    put_unit(url)
    link = "/login?ticket=0123456789abcdef-ticket"
    with serving(url, ticket=token_of("0123456789abcdef-ticket", source="test")) as base:
        browser.call("Network.clearBrowserCookies")
        browser.open(base + link)
        assert browser.evaluate("location.pathname + location.search") == "/"
        browser.open(base + UNIT)
        assert "Sign out" in browser.evaluate("document.body.innerText")
        browser.open(base + link)  # again, by the browser that is signed in
        assert browser.evaluate("location.pathname + location.search") == "/"
        assert "Sign out" in browser.evaluate("document.body.innerText")
        browser.call("Network.clearBrowserCookies")
        browser.open(base + link)
        said = browser.evaluate("document.body.innerText")
        assert "This link was used already" in said and "Sign out" not in said
        assert browser.evaluate("document.querySelector('main a[href=\"/signin\"]') !== null")


def test_a_reviewer_decides_by_keyboard_alone(browser, served):
    """Sign in, reject, approve, roll back without script, by its Origin and cookies."""
    browser.size(1200)
    base, url = served
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        sign_in(browser, base, next_page=PROPOSAL.format(2))
        assert browser.evaluate("location.search").endswith("number=2")
        decide(browser, "rejected")
        assert "Recorded: rejected" in browser.evaluate("document.body.innerText")
        browser.open(base + PROPOSAL.format(1))
        decide(browser, "approved")
        assert "Revision 3 is active" in browser.evaluate("document.body.innerText")
        browser.open(base + "/rollback?serial=SN-1&technology=rlg&to=1")
        sign_form(browser, "wrong run")
        browser.submit("document.querySelector('form[action=\"/rollback\"] button').click()")
        assert "Recorded: rolled back" in browser.evaluate("document.body.innerText")
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)
    with TableStore.open(url) as store:
        states = [(p.state, p.decision and p.decision.decided_by) for p in store.proposals("SN-1")]
        assert states == [
            ("approved", "K. Eyboard"),
            ("rejected", "K. Eyboard"),
            ("out of date", None),
        ]
        assert store.active("SN-1").note == "rolled back by K. Eyboard: wrong run"


def sign_in(browser, base, next_page="/"):
    from urllib.parse import quote

    browser.call("Network.clearBrowserCookies")
    browser.open(f"{base}/signin?next={quote(next_page, safe='')}")
    until = time.monotonic() + 10.0  # the cursor is set after the page has loaded
    while browser.evaluate("document.activeElement.id") != "token":
        assert time.monotonic() < until, "the cursor does not stand in the token's field"
    browser.call("Input.insertText", text=TOKEN)
    browser.events.clear()
    browser.press("Enter")
    browser.wait_loaded()
    assert "Signed in" in browser.evaluate("document.body.innerText")


def sign_form(browser, reason):
    browser.fill("#by", "K. Eyboard")
    browser.press("Tab")
    assert browser.evaluate("document.activeElement.id") == "reason"
    browser.call("Input.insertText", text=reason)


def decide(browser, verdict):
    sign_form(browser, f"{verdict} by keyboard")
    for _ in range(3):
        browser.press("Tab")
        if browser.evaluate("document.activeElement.value") == verdict:
            break
    assert browser.evaluate("document.activeElement.value") == verdict
    assert re.match(
        r"rgb\(230, 159, 0\)",
        browser.evaluate("getComputedStyle(document.activeElement).outlineColor"),
    )  # it is seen
    browser.events.clear()
    browser.press("Enter")
    browser.wait_loaded()
