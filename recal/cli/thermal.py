"""`recal thermal`: thermal coefficients of chamber runs, and a fitted model taken out of a run."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from recal.cli.console import Command, Shown
from recal.cli.parameters.verbs import made_from

FOLDER = "recal-thermal"  # written to without -o

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Fit thermal coefficients to chamber runs.",
)


class ManyRuns(Command):
    """`--fast A B --slow C` means `--fast A --fast B --slow C`."""

    MANY = ("--fast", "--slow", "--check")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Each further word after one of MANY belongs to it."""
        spread: list[str] = []
        option, filled = "", False
        for word in args:
            if word.startswith("-"):
                option, filled = word if word in self.MANY else "", False
            elif option and filled:
                spread.append(option)
            else:
                filled = bool(option)
            spread.append(word)
        return super().parse_args(ctx, spread)


@app.command(cls=ManyRuns)
@made_from("recal.service.thermal", "fit_rlg", check="RUN...")
def rlg(shown: Shown, runs, /, check, remounted, store, twin, output, force) -> None:
    """Fit K1..K6 of a ring-laser gyro, b = K1 + K2 T + K3 T^2 + K4 dT/dt + K5 T dT/dt + K6 Tdiff,
    to runs at rest.

    Example: recal thermal rlg chamber-1 chamber-2 --check chamber-3 -o rlg
    """
    from recal.service.thermal import THERMAL_STEPS, fit_rlg

    page = "thermal_rlg.html"
    folder = shown.folder(output, "recal.thermal_rlg/1", page, default=FOLDER, force=force)
    with shown.progress("fitting", len(runs) + len(check) + THERMAL_STEPS) as told:
        fitted = fit_rlg(runs, check, twin=twin, store=store, remounted=remounted, told=told)
        written = fitted.write(folder)
    shown.end(fitted, written / page)


@app.command(cls=ManyRuns)
@made_from("recal.service.thermal", "FogRequest", fast="RUN...", slow="RUN...", check="RUN...")
def fog(
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
    from recal.service.thermal import THERMAL_STEPS, FogRequest, fit_fog

    page = "thermal_fog.html"
    folder = shown.folder(output, "recal.thermal_fog/1", page, default=FOLDER, force=force)
    request = FogRequest(**asked)
    runs = [*fast, *slow, *check]
    with shown.progress("fitting", len(runs) + THERMAL_STEPS) as told:
        fitted = fit_fog(fast, slow, check, twin=twin, store=store, request=request, told=told)
        written = fitted.write(folder)
    shown.end(fitted, written / page)


@app.command(cls=Command)
@made_from("recal.service.thermal", "take_out", part="all|rates")
def apply(
    shown: Shown,
    model,
    run,
    /,
    output: Annotated[Path, typer.Option("-o", "--output", help="The compensated run to write.")],
    part,
    batch,
    force,
) -> None:
    """Take a fitted model out of a run's gyro output, each row from temperatures up to its own
    time.

    Example: recal thermal apply rlg/thermal_rlg.json run-1 -o run-1-compensated
    """
    from recal.service.results.overwrite import is_compensated, need_free_run
    from recal.service.thermal import TAKE_OUT_STEPS, take_out

    need_free_run(output, is_compensated, "a compensated run", force=force)
    with shown.progress("compensating", TAKE_OUT_STEPS, compiles=False) as told:
        left = take_out(model, run, output, part=part, batch=batch, told=told)
    shown.answer(left.document, left.lines())
