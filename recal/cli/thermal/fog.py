"""`recal thermal fog`: temperature and rate coefficients of a fibre-optic unit from chamber
ramps.
"""

from collections.abc import Sequence
from pathlib import Path

from recal.cli.console import Shown
from recal.cli.parameters.verbs import made_from


@made_from("recal.service.thermal", "FogRequest", fast="RUN...", slow="RUN...", check="RUN...")
def command(
    shown: Shown,
    /,
    fast: list[Path],
    slow: Sequence[Path] = (),
    check: Sequence[Path] = (),
    *,
    store,
    twin,
    output,
    force,
    **asked,
) -> None:
    """Fit K_T and K_delta of a fibre-optic gyro, b = K_T(T) + K_delta(T) dT/dt, to temperature
    ramps of the resting unit.

    Example: recal thermal fog --fast chamber-fast --slow chamber-slow --check chamber-other -o fog

    Parameters
    ----------
    fast
        Runs with the fast ramp, up and down.
    slow
        Runs with the slow ramp. Default: none; up and down of the fast ramp are compared.
    check
        Runs that only test the model.
    """
    from recal.service.results.overwrite import need_free_report
    from recal.service.thermal import THERMAL_STEPS, FogRequest, fit_fog

    folder = output or Path("recal-thermal")
    others = ("thermal_fog.html",)
    need_free_report(folder, "thermal_fog.json", "recal.thermal_fog/1", others, force=force)
    request = FogRequest(**asked)
    runs = [*fast, *slow, *check]
    with shown.progress("fitting", len(runs) + THERMAL_STEPS) as told:
        fitted = fit_fog(fast, slow, check, twin=twin, store=store, request=request, told=told)
        written = fitted.write(output)
    shown.end(fitted, written / "thermal_fog.html")
