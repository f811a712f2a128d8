"""Pictures of the review page for docs/serve.md, taken of a store that the demo's three sessions
fill.

    python -m benchmarks.serve_pictures docs/pictures

The store: the demo unit, its update of the first session approved, that of the other two proposed,
and a few units of a fleet with default tables. Pictures are PNG with 128 colours, so that each
stays well below 200 kB.
"""

import sys
import tempfile
import time
from pathlib import Path

from infield.store.table_store import TableStore
from recal.service.demo import demo
from recal.service.update import UpdateRequest, update_in_store
from recal.web.settings import token_of
from tests.recal.chromium import chromium
from tests.recal.serving import TOKEN, put_unit, serving

SERIAL = "SN-0042"
UNIT = f"serial={SERIAL}&technology=rlg&mode="
WHO = "K. Reviewer"
LAZY_S = 3.0  # until a frame that comes into view has loaded
SHOTS = (  # name, path, width, height, what to scroll to
    ("serve_units", "/", 1200, 620, ""),
    ("serve_unit", f"/unit?{UNIT}", 1200, 900, ""),
    ("serve_unit_phone", f"/unit?{UNIT}", 420, 900, ""),
    ("serve_proposal", f"/proposal?{UNIT}&number=2", 1200, 900, ""),
    ("serve_decide", f"/proposal?{UNIT}&number=2", 1200, 900, "#decide"),
    ("serve_decide_phone", f"/proposal?{UNIT}&number=2", 420, 900, "#decide"),
    ("serve_history", f"/unit?{UNIT}", 1200, 560, "#proposals"),
    ("serve_rollback", f"/rollback?{UNIT}&to=1", 1200, 760, ""),
)


def fill(folder: Path) -> str:
    """The store's URL."""
    url = f"sqlite:///{folder}/demo/recal.db"
    demo(folder / "demo", seed=42, rate_hz=10.0)
    runs = sorted(folder.glob("demo/run-*"))
    with TableStore.open(url) as store:
        store.rollback(to="factory", by="P. Ilot", reason="one session after the other, please")
    update_in_store(
        UpdateRequest(
            runs=runs[:1],
            store_url=url,
            propose=("night fleet", ""),
            html=False,
            output=folder / "one",
        )
    )
    with TableStore.open(url) as store:
        store.decide(
            1,
            "approved",
            by=WHO,
            reason="residuals white, 12 to 27 degC covered, heading from stops",
        )
    note = "sessions of April and June"
    update_in_store(
        UpdateRequest(
            runs=runs[1:],
            store_url=url,
            propose=("night fleet", note),
            html=False,
            output=folder / "two",
        )
    )
    for k in range(14):
        technology = ("rlg", "fog")[k % 3 == 2]
        serial = f"{'ABCD'[k % 4]}-{1207 + 37 * k}"
        put_unit(
            url, serial, kind=(technology, ""), updates=k % 4, proposals=k % 5 == 1, run=serial
        )
    return url


def take(base: str, directory: Path, profile: Path) -> None:
    """Sign in, then one picture after the other."""
    with chromium(profile) as browser:
        browser.open(f"{base}/signin")
        browser.fill("#token", TOKEN)
        browser.events.clear()
        browser.press("Enter")
        browser.wait_loaded()
        browser.open(f"{base}/proposal/report?{UNIT}&number=2")  # drawn once, then at hand
        for name, path, width, height, target in SHOTS:
            browser.size(width, height, mobile=width < 600)
            browser.open(base + path)
            if target:
                browser.evaluate(f"document.querySelector({target!r}).scrollIntoView()")
                time.sleep(LAZY_S)
            browser.picture(directory / f"{name}.png")
            shrink(directory / f"{name}.png")


def shrink(path: Path) -> None:
    """The picture with 128 colours."""
    from PIL import Image

    Image.open(path).convert("RGB").quantize(128, dither=Image.Dither.NONE).save(
        path, optimize=True
    )


def main() -> None:
    """Fill a store, serve it, take the pictures."""
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures")
    directory.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        url = fill(Path(folder))
        with serving(url, tokens=(token_of(TOKEN, WHO, source="pictures"),)) as base:
            take(base, directory, Path(folder) / "profile")
    for path in sorted(directory.glob("serve_*.png")):
        print(path, path.stat().st_size)


if __name__ == "__main__":
    main()
