"""Pictures of the report pages for docs/gallery.md: runs the commands that stand there, then takes
the top of each page in Chromium.

    python -m benchmarks.gallery_pictures docs/pictures [FOLDER]

FOLDER keeps what the commands write; what is there already is not made again. Pictures are PNG
with 128 colours, less than 100 kB each.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.serve_pictures import shrink
from tests.recal.chromium import chromium

ROOT = Path(__file__).parents[1]
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
    ("twin_fit", (("twin", "fit", AMBIENT, HOT, "-o", "twin.json"),), "twin.html"),
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
            path = directory / f"gallery_{name}.png"
            browser.picture(path)
            shrink(path)
            print(path, path.stat().st_size)


def main() -> None:
    """Make the pages, take the pictures."""
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures")
    directory.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(sys.argv[2] if len(sys.argv) > 2 else made)
        make(folder)
        take(folder, directory)


if __name__ == "__main__":
    main()
