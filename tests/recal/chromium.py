"""A headless Chromium, driven over its DevTools pipe: pages as a person sees them, forms as a
browser sends them.
"""

import base64
import json
import os
import shutil
import subprocess
import time
from contextlib import contextmanager

import pytest

WAIT_S = 60.0


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
    commands_out, commands_in = os.pipe()  # the browser reads its file 3 and writes its file 4
    answers_out, answers_in = os.pipe()

    def into_place():
        os.dup2(os.dup(commands_out), 3)
        os.dup2(os.dup(answers_in), 4)

    process = subprocess.Popen(
        [
            program,
            "--headless=new",
            "--remote-debugging-pipe",
            "--no-sandbox",
            "--disable-gpu",
            "--no-first-run",
            "--disable-dev-shm-usage",
            "--disable-background-networking",
            f"--user-data-dir={folder}",
            "about:blank",
        ],
        close_fds=False,
        preexec_fn=into_place,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(commands_out), os.close(answers_in)
    browser = Browser(commands_in, answers_out)
    try:
        browser.attach()
        yield browser
    finally:
        process.kill()
        process.wait()
        os.close(commands_in), os.close(answers_out)


class Browser:
    """One tab. `events`: what the page reported, `console`: what the browser complained about
    (broken policies among it).
    """

    def __init__(self, commands, answers):
        self._commands, self._answers, self._rest = commands, answers, b""
        self._number, self._session, self.events = 0, None, []

    def attach(self):
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(t for t in targets if t["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Network", "Log", "Runtime", "DOM"):
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        """The answer to one command."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]

    def open(self, url):
        """Go there and wait until everything is loaded; the document's HTTP status."""
        self.events.clear()
        self.call("Page.navigate", url=url)
        return self.wait_loaded()

    def wait_loaded(self):
        until = time.monotonic() + WAIT_S
        while not any(e["method"] == "Page.loadEventFired" for e in self.events):
            assert time.monotonic() < until, "the page did not load"
            self._read()
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
        """The value of an expression in the page (the tester's, not the page's: that has no
        script).
        """
        found = self.call("Runtime.evaluate", expression=code, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def fill(self, selector, text):
        """Type into a field."""
        self.evaluate(f"document.querySelector({selector!r}).focus()")
        self.call("Input.insertText", text=text)

    def press(self, key):
        """Press and release Tab or Enter."""
        code = {"Tab": 9, "Enter": 13}[key]
        text = {"text": "\r"} if key == "Enter" else {}
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                code=key,
                windowsVirtualKeyCode=code,
                **text,
            )

    def size(self, width, height=900, *, mobile=False):
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=mobile,
        )

    def picture(self, path, *, full=False):
        """A PNG of the window, or of the whole page."""
        more = {}
        if full:
            size = self.call("Page.getLayoutMetrics")["cssContentSize"]
            more = {
                "clip": {
                    "x": 0,
                    "y": 0,
                    "width": size["width"],
                    "height": size["height"],
                    "scale": 1,
                },
                "captureBeyondViewport": True,
            }
        path.write_bytes(
            base64.b64decode(self.call("Page.captureScreenshot", format="png", **more)["data"])
        )

    def complaints(self):
        """What the browser logged as a fault of the page since it was opened."""
        return [
            e["params"]["entry"]["text"] for e in self.events if e["method"] == "Log.entryAdded"
        ]

    def _read(self):
        while b"\0" not in self._rest:
            piece = os.read(self._answers, 1 << 20)
            assert piece, "the browser ended"
            self._rest += piece
        line, _, self._rest = self._rest.partition(b"\0")
        message = json.loads(line)
        if "method" in message:
            self.events.append(message)
        return message
