"""`recal align` and `recal replay`: attitude and heading of a run, and its navigation with the
stored table and with the one before it.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from recal.cli.console import Shown
from recal.cli.parameters.verbs import made_from

if TYPE_CHECKING:
    from recal.service.replay import Aided

REPLAY_STEPS = 5  # reading, two tables, satellite fixes, the report
ANY_VEHICLE = "other"  # nothing is known of its wheels


@made_from("recal.service.align", "align")
def align(shown: Shown, run, /, store, twin, output, force) -> None:
    """Find roll, pitch and heading of a parked unit with their sigmas, and the phases of the run.

    Example: recal align run-1 --json

    Parameters
    ----------
    run : path
        A run directory.
    """
    from recal.service.align import ALIGN_STEPS
    from recal.service.align import align as aligned_run

    folder = shown.folder(output, "recal.alignment/1", default="recal-align", force=force)
    with shown.progress("aligning", ALIGN_STEPS) as told:
        aligned = aligned_run(run, twin=twin, store=store, told=told)
    shown.end(aligned, aligned.write(folder) / "alignment.json")


@made_from("recal.service.replay", "Aided", outage="START:LENGTH")
def replay(
    shown: Shown,
    run: Path,
    /,
    store,
    twin,
    thermal_model,
    aided: bool = True,
    outage: Sequence[str] = (),
    *,
    smooth,
    vehicle: str = ANY_VEHICLE,
    kml: bool = False,
    csv: bool = False,
    output,
    force,
) -> None:
    """Fly the log again with the stored table and with the one before it: drift in NM/h, old and
    new.

    Example: recal replay run-2 --store sqlite:///recal.db -o replay

    Parameters
    ----------
    run
        A run directory.
    aided
        Also navigate with the satellite fixes of the run, where it has any.
    outage
        Leave the fixes of a stretch out of the aided solution, and score it with them [s]. May be
        repeated. Default: none.
    vehicle
        car: also held by its wheels (it goes where it points, at the odometer's speed); find:
        where the log shows a car.
    kml
        Also write track.kml for a globe.
    csv
        Also write the navigation files as CSV.
    """
    from recal.service.replay import replay as replayed

    navigation = ("navigation.parquet", "navigation_aided.parquet", "navigation_smoothed.parquet")
    others = ("replay.html", *navigation, "track.kml")
    folder = shown.folder(output, "recal.replay/1", *others, force=force)
    with shown.progress("replaying", REPLAY_STEPS) as told:
        flown = replayed(
            run,
            twin=twin,
            store=store,
            thermal_model=thermal_model,
            aided=_asked(outage, aided=aided, smooth=smooth, vehicle=vehicle),
            told=told,
        )
        told("drawing the report")
        written = flown.write(folder, kml=kml, csv=csv)
    shown.end(flown, written / "replay.html")


def _asked(outages: Sequence[str], *, aided: bool, smooth: bool, vehicle: str) -> "bool | Aided":
    """What is asked of the aided flight; else whether there is one."""
    from ins.records import InputError
    from recal.service.replay import Aided

    options = {"--outage": bool(outages), "--smooth": smooth, "--vehicle": vehicle != ANY_VEHICLE}
    given = [name for name, asked in options.items() if asked]
    if not given:
        return aided
    if not aided:
        raise InputError(f"{given[0]}: needed the aided flight, which --no-aided switches off")
    return Aided(outages=[_stretch(words) for words in outages], smooth=smooth, vehicle=vehicle)


def _stretch(words: str) -> tuple[float, float]:
    """Start and length of a stretch written START:LENGTH [s]."""
    from ins.records import InputError

    start, _, length = words.partition(":")
    try:
        found = float(start), float(length)
    except ValueError:
        found = (math.nan, math.nan)
    if not (math.isfinite(found[0]) and 0.0 < found[1] < math.inf):
        raise InputError(f"--outage {words!r}: needed START:LENGTH in seconds, such as 300:60")
    return found
