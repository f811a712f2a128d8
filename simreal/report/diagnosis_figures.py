"""The drawings of a diagnosis report, from the document's numbers and the overlays
(`diagnosis_curves`).
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from infield.reports.figures import (
    BLACK,
    BLUE,
    GREY,
    PALE,
    SKY,
    VERMILLION,
    axis_text,
    in_style,
    new_figure,
    robust_limits,
    svg_text,
    thinned,
)
from simreal.report.diagnosis_curves import Overlay, RunCurve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_NATS = 30.0  # colour scale of the heat map: beyond, a cell is as dark as can be
SHOWN_NATS = 3.0  # a smaller excess has no number in its cell
MOST_PANELS = 8
MOST_BANDS = 2  # channels of one drawing of bands
LEAST_RHO = 0.05  # a smaller ratio is drawn there


@in_style
def gap_map(cells: list[dict[str, Any]]) -> Markup:
    """Channel against band, before and after: colour is the signed root of the nats, numbers are
    rho where it stands out.
    """
    channels = list(dict.fromkeys(c["channel"] for c in cells))
    bands = sorted({_band(c) for c in cells}, key=lambda b: (b[2], b[0]))
    figure, axes = new_figure(2, 1, height=1.7 + 0.5 * len(channels), sharex=True)
    for ax, suffix, title in (
        (axes[0, 0], "", "Before"),
        (axes[1, 0], "_after", "With what was found"),
    ):
        mesh = _draw_map(ax, cells, channels, bands, suffix)
        axis_text(ax, title=title)
    axes[1, 0].set_xticks(
        range(len(bands)),
        [_band_name(b) for b in bands],
        rotation=40,
        ha="right",
        rotation_mode="anchor",
    )
    bar = figure.colorbar(mesh, ax=axes[:, 0], aspect=35, pad=0.01)
    ticks = np.array([-30.0, -10.0, -3.0, 0.0, 3.0, 10.0, 30.0])
    bar.set_ticks(np.sign(ticks) * np.sqrt(np.abs(ticks)), labels=[f"{abs(t):g}" for t in ticks])
    bar.set_label("nats: too quiet below, too loud above")
    return svg_text(figure, "Heat map of the gap by channel and band, before and after")


def _band(cell: dict[str, Any]) -> tuple[float, float, bool]:
    low, high = cell["frequency_hz"]
    return float(low), float("inf") if high is None else float(high), bool(cell["moving"])


def _draw_map(
    ax: "Axes", cells: list[dict[str, Any]], channels: list[str], bands: list, suffix: str
) -> Any:
    from matplotlib.colors import Normalize

    values = np.full((len(channels), len(bands)), np.nan)
    for cell in cells:
        y, x = channels.index(cell["channel"]), bands.index(_band(cell))
        nats, rho = max(cell["nats" + suffix], 0.0), cell["rho" + suffix]
        values[y, x] = np.sign(rho - 1.0) * np.sqrt(min(nats, MOST_NATS))
        if nats > SHOWN_NATS or cell["located" + suffix]:
            dark = abs(values[y, x]) > 0.55 * np.sqrt(MOST_NATS)
            ax.text(
                x,
                y,
                _short(rho),
                ha="center",
                va="center",
                fontsize=7.5,
                color="white" if dark else BLACK,
                fontweight="bold" if cell["located" + suffix] else "normal",
            )
    top = np.sqrt(MOST_NATS)
    edges_x, edges_y = np.arange(len(bands) + 1) - 0.5, np.arange(len(channels) + 1) - 0.5
    masked = np.ma.masked_invalid(values)
    mesh = ax.pcolormesh(
        edges_x,
        edges_y,
        masked,
        cmap="PuOr_r",
        norm=Normalize(-top, top),
        edgecolors="white",
        linewidth=0.6,
    )
    ax.set_yticks(range(len(channels)), channels)
    ax.set_ylim(len(channels) - 0.5, -0.5)
    ax.grid(False)
    ax.tick_params(length=0)
    for side in ("left", "bottom"):
        ax.spines[side].set_visible(False)
    return mesh


def _short(rho: float) -> str:
    return (
        f"{rho:.2f}"
        if rho < 2
        else (
            f"{rho:.1f}"
            if rho < 10
            else f"{rho:.0f}"
            if rho < 1000
            else f"{rho:.0e}".replace("e+0", "e")
        )
    )


def _band_name(band: tuple[float, float, bool]) -> str:
    """A band by its periods, slow ones first."""
    low, high, moving = band
    if moving:
        return "moving"
    if low <= 0:
        return f"over {_period(high)}"
    if np.isinf(high):
        return f"under {_period(low)}"
    return f"{_period(low)} to {_period(high)}"


def _period(frequency_hz: float) -> str:
    seconds = 1.0 / frequency_hz
    return (
        f"{seconds:.0f} s"
        if seconds < 100
        else f"{seconds / 60:.0f} min"
        if seconds < 5400
        else f"{seconds / 3600:.1f} h"
    )


@in_style
def posterior_bars(cause: dict[str, Any]) -> Markup:
    """Probabilities of the answers of one cause; the confounded set in colour."""
    held = {(cause["effect"], cause["target"])} | {
        (r["effect"], r["target"]) for r in cause["rivals"]
    }
    rows = [
        r
        for r in cause["posterior"]
        if r["probability"] >= 0.001 or (r["effect"], r["target"]) in held
    ]
    rows += [
        r
        for r in cause["rivals"]
        if (r["effect"], r["target"]) not in {(x["effect"], x["target"]) for x in rows}
    ]
    figure, axes = new_figure(height=0.75 + 0.27 * len(rows))
    ax = axes[0, 0]
    for y, row in enumerate(rows):
        key = row["effect"], row["target"]
        colour = (
            VERMILLION
            if key == (cause["effect"], cause["target"])
            else BLUE
            if key in held
            else PALE
        )
        ax.barh(y, row["probability"], height=0.7, color=colour)
        ax.text(
            row["probability"] + 0.008, y, _percent(row["probability"]), va="center", fontsize=8.0
        )
    labels = [
        f"{r['effect']} on {r['target']}" if r["target"] else "outside the catalogue" for r in rows
    ]
    ax.set_yticks(range(len(rows)), labels)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlim(0.0, 1.08)
    ax.grid(False, axis="y")
    axis_text(ax, x="probability")
    return svg_text(
        figure, f"Posterior probabilities of the answers for {cause['effect']} on {cause['target']}"
    )


def _percent(p: float) -> str:
    return f"{100 * p:.0f} %" if p > 0.995 or 0.01 <= p else "under 1 %" if p < 0.005 else "1 %"


@in_style
def overlay_drawing(overlay: Overlay) -> Markup | None:
    """Run by run: what was measured and the effect through it; None where there is no run to
    show.
    """
    curves = overlay.curves[:MOST_PANELS]
    if not curves:
        return None
    columns = 2 if len(curves) > 1 else 1
    rows = -(-len(curves) // columns)
    figure, axes = new_figure(rows, columns, height=0.7 + 2.1 * rows, sharey=bool(overlay.unit))
    flat = axes.ravel()
    for ax, curve in zip(flat, curves):
        _draw_curve(ax, curve, overlay.unit)
        held = ", effect fitted on the other runs" if curve.held_out else ""
        axis_text(ax, title=f"{_plain(curve.run_id)}{held}")
    for ax in flat[len(curves) :]:
        ax.set_visible(False)
    if overlay.unit:
        both = [np.concatenate([c.measured, c.effect]) for c in curves]
        flat[0].set_ylim(*robust_limits(np.concatenate(both)))
    for ax in axes[:, 0]:
        ax.set_ylabel(f"{overlay.channel} [{overlay.unit}]" if overlay.unit else "evidence, summed")
    for k in range(len(curves)):
        if k + columns >= len(curves):
            flat[k].set_xlabel("time since power-on [min]")
    handles, labels = flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))
    return svg_text(figure, f"Residual of {overlay.channel} and the fitted effect, run by run")


def _draw_curve(ax: "Axes", curve: RunCurve, unit: str) -> None:
    t, measured, effect = thinned(curve.time_min, curve.measured, curve.effect)
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    if unit:
        ax.plot(
            t,
            measured,
            "o",
            color=SKY,
            markersize=3.0,
            label="measured less the twin, one-minute means",
        )
        ax.plot(t, effect, color=VERMILLION, linewidth=1.8, label="the effect")
        return
    band = 2.0 * np.sqrt(np.maximum(effect, 0.0))
    ax.fill_between(
        t, effect - band, effect + band, color=VERMILLION, alpha=0.15, linewidth=0, label="2 sigma"
    )
    ax.plot(t, effect, color=VERMILLION, linewidth=1.8, label="if the effect is as fitted")
    ax.plot(t, measured, color=BLUE, linewidth=1.2, label="what the data give")


@in_style
def band_drawing(cells: list[dict[str, Any]], channels: list[str]) -> Markup | None:
    """Mean square over expectation per band of one or two channels, before and after: for a noise;
    None without cells.
    """
    shown = [c for c in channels if any(cell["channel"] == c for cell in cells)][:MOST_BANDS]
    if not shown:
        return None
    rows = [cell for cell in cells if cell["channel"] in shown]
    bands = sorted({_band(c) for c in rows}, key=lambda b: (b[2], b[0]))
    figure, axes = new_figure(len(shown), 1, height=1.1 + 1.7 * len(shown), sharex=True)
    for ax, channel in zip(axes[:, 0], shown):
        _draw_bands(ax, [c for c in rows if c["channel"] == channel], bands)
        axis_text(ax, y=f"{channel}, ratio")
    axes[-1, 0].set_xticks(
        range(len(bands)),
        [_band_name(b) for b in bands],
        rotation=40,
        ha="right",
        rotation_mode="anchor",
    )
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return svg_text(figure, f"Mean square per band of {', '.join(shown)} before and after")


def _draw_bands(
    ax: "Axes", rows: list[dict[str, Any]], bands: list[tuple[float, float, bool]]
) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    x = [bands.index(_band(c)) for c in rows]
    spread = 2.0 * np.sqrt(2.0 / np.maximum([c["dof"] for c in rows], 1.0))
    low = np.maximum(1.0 - spread, LEAST_RHO)
    ax.bar(x, 1.0 + spread - low, bottom=low, width=0.8, color=PALE, label="the twin's own 2 sigma")
    ax.axhline(1.0, color=GREY, linewidth=0.9)
    before, after = (np.maximum([c[k] for c in rows], LEAST_RHO) for k in ("rho", "rho_after"))
    ax.plot(x, before, "o", color=VERMILLION, markersize=6, label="before")
    ax.plot(x, after, "D", color=BLUE, markersize=4.5, label="with what was found")
    ax.set_yscale("log")
    ax.set_ylim(
        0.8 * min(before.min(), after.min(), 0.5), 1.3 * max(before.max(), after.max(), 2.0)
    )
    steps = (1, 2, 5) if max(before.max(), after.max()) < 100 else (1,)
    ax.yaxis.set_major_locator(FixedLocator([m * 10.0**k for k in range(-2, 12) for m in steps]))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))


def _plain(text: str, longest: int = 34) -> str:
    return str(text).encode("ascii", "replace").decode()[:longest]
