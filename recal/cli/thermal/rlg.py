"""`recal thermal rlg`: rate and gradient terms of a ring-laser unit from chamber or parked runs."""

from pathlib import Path

from recal.cli.console import Shown
from recal.cli.parameters.verbs import made_from


@made_from("recal.service.thermal", "fit_rlg", check="RUN...")
def command(shown: Shown, runs, /, check, remounted, store, twin, output, force) -> None:
    """Fit K1..K6 of a ring-laser gyro, b = K1 + K2 T + K3 T^2 + K4 dT/dt + K5 T dT/dt + K6 Tdiff,
    to runs at rest.

    Example: recal thermal rlg chamber-1 chamber-2 --check chamber-3 -o rlg
    """
    from recal.service.results.overwrite import need_free_report
    from recal.service.thermal import THERMAL_STEPS, fit_rlg

    folder = output or Path("recal-thermal")
    others = ("thermal_rlg.html",)
    need_free_report(folder, "thermal_rlg.json", "recal.thermal_rlg/1", others, force=force)
    with shown.progress("fitting", len(runs) + len(check) + THERMAL_STEPS) as told:
        fitted = fit_rlg(runs, check, twin=twin, store=store, remounted=remounted, told=told)
        written = fitted.write(output)
    shown.end(fitted, written / "thermal_rlg.html")
