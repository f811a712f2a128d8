"""Pictures of the report pages for the guides, and of the review page for docs/serve.md.

The commands that make them are run and the top of each page is taken in Chromium. The
review page shows a store of the demo unit (its update of the first session approved, that of the
other two proposed) and of a few units of a fleet with default tables. Pictures are PNG with 128
colours, each well below 200 kB.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.study import ROOT, Work, table
from infield.store.table_store import TableStore
from recal.service.demo import demo
from recal.service.update import UpdateRequest, update_in_store
from recal.web.settings import token_of
from tests.recal.chromium import chromium
from tests.recal.serving import TOKEN, put_unit, serving

WIDTH, HEIGHT = 1200, 900  # of a picture
COLD, HOT = "recal-demo/run-1-cold_parked_taxi", "recal-demo/run-3-hot_parked_taxi"
AMBIENT = "recal-demo/run-2-ambient_parked_taxi"
STORE = "sqlite:///recal-demo/recal.db"
GAP = ROOT / "examples/gap"
LACKS = ("--twin", f"{GAP}/aircraft.json", "--table-out", "table.json")
PAGES = (  # name, what makes it, the page
    ("update", (("demo",),), "recal-demo/update.html"),
    (
        "flight",
        (
            ("simulate", "cold_flight", "-o", "flight", "--table-out", "flight.json"),
            ("table", "import", "flight.json", "--store", "sqlite:///flight.db"),
            ("update", "flight", "--store", "sqlite:///flight.db", "-o", "flight-update"),
        ),
        "flight-update/update.html",
    ),
    ("look", (("look", AMBIENT, "-o", "look"),), "look/look.html"),
    ("replay", (("replay", AMBIENT, "--store", STORE, "-o", "replay"),), "replay/replay.html"),
    ("twin_fit", (("twin", "fit", AMBIENT, HOT, "-o", "fitted.json"),), "fitted.html"),
    (
        "diagnosis",
        (
            ("simulate", f"{GAP}/cold.toml", *LACKS, "-o", "cold"),
            ("simulate", f"{GAP}/hot.toml", *LACKS, "-o", "hot"),
            ("diagnose", "cold", "hot", "--twin", "twin.json", "-o", "diagnosis"),
        ),
        "diagnosis/diagnosis.html",
    ),
    (
        "plan",
        (("plan", "--separate", "gyro_thermal_linear,gyro_warmup_transient", "-o", "plan"),),
        "plan/plan.html",
    ),
    (
        "fleet",
        (
            ("table", "export", "--revision", "1", "--store", STORE, "-o", "factory.json"),
            ("table", "import", "factory.json", "--store", "sqlite:///fleet.db"),
            ("fleet", "update", "recal-demo", "--store", "sqlite:///fleet.db", "-o", "fleet"),
        ),
        "fleet/fleet.html",
    ),
    (
        "forecast",
        (("fleet", "forecast", "--store", STORE, "-o", "forecast"),),
        "forecast/forecast.html",
    ),
)

FIRST = {"flight": "Flight with the receiver"}  # heading at the top of the picture, else the page's

TO_HEADING = """[...document.querySelectorAll("h2, h3")].find(
    heading => heading.textContent.startsWith("TEXT")).scrollIntoView()"""


def make(folder: Path) -> None:
    """Run the commands of the pages that are not there."""
    shutil.copy(GAP / "twin.json", folder)  # its table is made beside it
    for _, commands, page in PAGES:
        if (folder / page).is_file():
            continue
        for words in commands:
            run = subprocess.run(
                [sys.executable, "-m", "recal", *words, "-q"],
                cwd=folder,
                env=os.environ | {"PYTHONPATH": str(ROOT)},
                check=False,
            )
            # 4 and 5 are verdicts, and the page says so
            if run.returncode not in (0, 4, 5):
                raise SystemExit(f"recal {' '.join(words)}: exit code {run.returncode}")


def _shown(folder: Path, page: str) -> Path:
    """A copy of the page that does not say where the folder lies."""
    text = (folder / page).read_text("utf-8")
    shown = (folder / page).with_suffix(".shown.html")
    shown.write_text(text.replace(f"{folder.absolute()}/", ""), "utf-8")
    return shown


def take(folder: Path, directory: Path) -> None:
    """A picture of the top of each page."""
    with tempfile.TemporaryDirectory() as profile, chromium(Path(profile)) as browser:
        for name, _, page in PAGES:
            browser.size(WIDTH, HEIGHT)
            browser.open(_shown(folder, page).absolute().as_uri())
            if name in FIRST:
                browser.evaluate(TO_HEADING.replace("TEXT", FIRST[name]))
            time.sleep(LAZY_S)
            path = directory / f"gallery_{name}.png"
            browser.picture(path)
            shrink(path)


# ---- the review page


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


def take_served(base: str, directory: Path, profile: Path) -> None:
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


def of_pages(directory: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        make(Path(folder))
        take(Path(folder), Path(directory))
    return "gallery"


def of_review(directory: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        url = fill(Path(folder))
        with serving(url, tokens=(token_of(TOKEN, WHO, source="pictures"),)) as base:
            take_served(base, Path(directory), Path(folder) / "profile")
    return "serve"


def run(work: Work, *, directory: Path = ROOT / "docs" / "pictures") -> str:
    directory.mkdir(parents=True, exist_ok=True)
    made = [*work.each(of_pages, [(str(directory),)]), *work.each(of_review, [(str(directory),)])]
    paths = [path for name in made for path in sorted(directory.glob(f"{name}_*.png"))]
    return table(("picture", "bytes"), [(path.name, path.stat().st_size) for path in paths])
