"""A headless Chromium, driven by Playwright: pages as a person sees them, forms as a browser sends
them.
"""

import shutil
import time
from contextlib import contextmanager

import pytest

WAIT_S = 60.0
HEARD = (
    "Page.loadEventFired",
    "Network.responseReceived",
    "Network.requestWillBeSent",
    "Log.entryAdded",
    "Runtime.exceptionThrown",
)


def find_chromium():
    """The program, None where there is none."""
    return next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )


@contextmanager
def chromium(folder):
    """A browser with a profile of its own; skips the test where none is installed."""
    program = find_chromium()
    if program is None:
        pytest.skip("no chromium on this machine")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            folder,
            executable_path=program,
            headless=True,
            no_viewport=True,  # tests set sizes, of phones too
            args=["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"],
        )
        try:
            yield Browser(context.pages[0])
        finally:
            context.close()


class Browser:
    """One tab. `events`: what the page reported since it was opened."""

    def __init__(self, page):
        self.page, self.events = page, []
        self._tools = page.context.new_cdp_session(page)
        for domain in ("Page", "Network", "Log", "Runtime", "DOM"):
            self.call(f"{domain}.enable")
        for name in HEARD:
            self._tools.on(name, self._hear(name))

    def _hear(self, name):
        return lambda params: self.events.append({"method": name, "params": params})

    def call(self, method, **parameters):
        """The answer to one command of the DevTools protocol."""
        return self._tools.send(method, parameters)

    def open(self, url):
        """Go there and wait until everything is loaded; the document's HTTP status."""
        self.events.clear()
        self.call("Page.navigate", url=url)
        return self.wait_loaded()

    def wait_loaded(self):
        until = time.monotonic() + WAIT_S
        while not any(e["method"] == "Page.loadEventFired" for e in self.events):
            assert time.monotonic() < until, "the page did not load"
            self.page.wait_for_timeout(5)
        documents = [
            e
            for e in self.events
            if e["method"] == "Network.responseReceived" and e["params"]["type"] == "Document"
        ]
        return documents[0]["params"]["response"]["status"] if documents else None

    def submit(self, code):
        """Do what leads to another page (a click), and wait for that page."""
        self.events.clear()
        self.evaluate(code)
        return self.wait_loaded()

    def evaluate(self, code):
        """The value of an expression in the page. Not Playwright's: that would evaluate a text,
        which the policy of a page forbids.
        """
        found = self.call("Runtime.evaluate", expression=code, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, code):
        """Wait until an expression in the page is true."""
        end = time.monotonic() + WAIT_S
        while not self.evaluate(code):
            assert time.monotonic() < end, f"never true: {code}"
            self.page.wait_for_timeout(20)

    def fill(self, selector, text):
        """Type into a field."""
        self.evaluate(f"document.querySelector({selector!r}).focus()")
        self.page.keyboard.insert_text(text)

    def press(self, key):
        """Press and release Tab or Enter."""
        self.page.keyboard.press(key)

    def size(self, width, height=900, *, mobile=False):
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=mobile,
        )

    def complaints(self):
        """What the browser logged as a fault of the page since it was opened."""
        return [
            e["params"]["entry"]["text"] for e in self.events if e["method"] == "Log.entryAdded"
        ]
