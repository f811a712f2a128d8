"""The drawings of a diagnosis report, from the document's numbers and the overlays
(`diagnosis_curves`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from infield.reports.figures import (
    BLACK,
    BLUE,
    GREY,
    PALE,
    PANEL_WIDTH,
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
from simreal.report.diagnosis_records import CauseRecord, CellRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

MOST_NATS = 30.0  # colour scale of the heat map: beyond, a cell is as dark as can be; odds of 1e13
SHOWN_NATS = 3.0  # a smaller excess has no number in its cell: odds of 20
MOST_PANELS = 8
MOST_BANDS = 2  # channels of one drawing of bands
LEAST_RHO = 0.05  # a smaller ratio is drawn there
# share of the colour scale from which a number is written in white; chosen: past its middle (0.5)
DARK = 0.55
LEAST_SHOWN = 0.001  # probability of an answer that is drawn: a bar of 0.1 % is one pixel of 1000
Band = tuple[float, float, bool]  # lower and upper end [Hz], and whether the vehicle moves


@dataclass(frozen=True)
class _Square:
    """A cell of the map: where it is, and its numbers before or after."""

    place: tuple[int, int]  # row of the band, column of the channel
    nats: float
    rho: float
    located: bool

    @property
    def colour(self) -> float:
        """Signed root of the nats: below 0 too quiet, above too loud."""
        return float(np.sign(self.rho - 1.0) * np.sqrt(np.clip(self.nats, 0.0, MOST_NATS)))


def gap_maps(cells: Sequence[CellRecord]) -> tuple[Markup, Markup]:
    """Band against channel, before and after, each as narrow as a phone: colour is the signed root
    of the nats, numbers are rho where it stands out.
    """
    channels = list(dict.fromkeys(c.channel for c in cells))
    bands = _bands(cells)
    places = [(bands.index(_band(c)), channels.index(c.channel)) for c in cells]
    before = [_Square(at, c.nats, c.rho, c.located) for at, c in zip(places, cells)]
    after = [
        _Square(at, c.nats_after, c.rho_after, c.located_after) for at, c in zip(places, cells)
    ]
    names = [_band_name(b) for b in bands]
    return (
        _gap_map(before, channels, names, "Before"),
        _gap_map(after, channels, names, "With what was found"),
    )


@in_style
def _gap_map(
    squares: Sequence[_Square], channels: Sequence[str], bands: Sequence[str], title: str
) -> Markup:
    figure, axes = new_figure(height=1.9 + 0.27 * len(bands), width=PANEL_WIDTH)
    ax = axes[0, 0]
    mesh = _draw_map(ax, squares, channels, bands)
    axis_text(ax, title=title)
    bar = figure.colorbar(mesh, ax=ax, location="bottom", aspect=35, pad=0.02)
    ticks = np.array([-30.0, -10.0, -3.0, 0.0, 3.0, 10.0, 30.0])
    bar.set_ticks(np.sign(ticks) * np.sqrt(np.abs(ticks)), labels=[f"{abs(t):g}" for t in ticks])
    bar.set_label("too quiet   nats   too loud")
    return svg_text(figure, f"Heat map of the gap by band and channel: {title.lower()}")


def _band(cell: CellRecord) -> Band:
    low, high = cell.frequency_hz
    assert low is not None
    return float(low), float("inf") if high is None else float(high), bool(cell.moving)


def _bands(cells: Sequence[CellRecord]) -> list[Band]:
    """Slow ones first, then those of moving vehicles."""
    return sorted({_band(c) for c in cells}, key=lambda band: (band[2], band[0]))


def _name_bands(ax: "Axes", bands: Sequence[Band]) -> None:
    ax.set_xticks(
        range(len(bands)),
        [_band_name(b) for b in bands],
        rotation=40,
        ha="right",
        rotation_mode="anchor",
    )


def _draw_map(
    ax: "Axes", squares: Sequence[_Square], channels: Sequence[str], bands: Sequence[str]
) -> "QuadMesh":
    from matplotlib.colors import Normalize

    values = np.full((len(bands), len(channels)), np.nan)
    for square in squares:
        values[square.place] = square.colour
        if square.nats > SHOWN_NATS or square.located:
            _write_rho(ax, square)
    top = np.sqrt(MOST_NATS)
    edges_x, edges_y = np.arange(len(channels) + 1) - 0.5, np.arange(len(bands) + 1) - 0.5
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
    ax.set_yticks(range(len(bands)), bands)
    ax.set_xticks(range(len(channels)), channels, rotation=90)
    ax.set_ylim(len(bands) - 0.5, -0.5)
    ax.grid(False)
    ax.tick_params(length=0)
    for side in ("left", "bottom"):
        ax.spines[side].set_visible(False)
    return mesh


def _write_rho(ax: "Axes", square: _Square) -> None:
    """The number of a square that stands out, bold where it is located."""
    y, x = square.place
    dark = abs(square.colour) > DARK * np.sqrt(MOST_NATS)
    ax.text(
        x,
        y,
        _short(square.rho),
        ha="center",
        va="center",
        color="white" if dark else BLACK,
        fontweight="bold" if square.located else "normal",
    )


def _short(rho: float) -> str:
    """A ratio in at most three characters: a cell of the map is as wide."""
    if rho < 0.005:
        return "0"
    if rho < 0.995:
        return f"{rho:.2f}".removeprefix("0")
    if rho < 9.95:
        return f"{rho:.1f}"
    if rho < 999.5:
        return f"{rho:.0f}"
    return f"{rho:.0e}".replace("e+0", "e")


def _band_name(band: Band) -> str:
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
    """In seconds below 100 s, in minutes below 90."""
    seconds = 1.0 / frequency_hz
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


@in_style
def posterior_bars(cause: CauseRecord) -> Markup:
    """Probabilities of the answers of one cause; the confounded set in colour."""
    own = cause.effect, cause.target
    held = {own} | {(r.effect, r.target) for r in cause.rivals}
    rows = {
        (a.effect, a.target): a.probability
        for a in cause.posterior
        if a.probability >= LEAST_SHOWN or (a.effect, a.target) in held
    }
    for rival in cause.rivals:
        rows.setdefault((rival.effect, rival.target), rival.probability)
    figure, axes = new_figure(height=0.75 + 0.27 * len(rows))
    ax = axes[0, 0]
    for y, (key, p) in enumerate(rows.items()):
        other = BLUE if key in held else PALE
        ax.barh(y, p, height=0.7, color=VERMILLION if key == own else other)
        ax.text(p + 0.008, y, _percent(p), va="center")
    labels = [
        f"{effect} on {target}" if target else "outside the catalogue" for effect, target in rows
    ]
    ax.set_yticks(range(len(rows)), labels)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlim(0.0, 1.08)
    ax.grid(False, axis="y")
    axis_text(ax, x="probability")
    return svg_text(
        figure, f"Posterior probabilities of the answers for {cause.effect} on {cause.target}"
    )


def _percent(p: float) -> str:
    if p >= 0.01:
        return f"{100 * p:.0f} %"
    return "under 1 %" if p < 0.005 else "1 %"


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
def band_drawing(cells: Sequence[CellRecord], channels: Sequence[str]) -> Markup | None:
    """Mean square over expectation per band of one or two channels, before and after: for a noise;
    None without cells.
    """
    known = {cell.channel for cell in cells}
    shown = [c for c in channels if c in known][:MOST_BANDS]
    if not shown:
        return None
    rows = [cell for cell in cells if cell.channel in shown]
    bands = _bands(rows)
    figure, axes = new_figure(len(shown), 1, height=1.1 + 1.7 * len(shown), sharex=True)
    for ax, channel in zip(axes[:, 0], shown):
        _draw_bands(ax, [c for c in rows if c.channel == channel], bands)
        axis_text(ax, y=f"{channel}, ratio")
    _name_bands(axes[-1, 0], bands)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return svg_text(figure, f"Mean square per band of {', '.join(shown)} before and after")


def _draw_bands(ax: "Axes", rows: Sequence[CellRecord], bands: Sequence[Band]) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    x = [bands.index(_band(c)) for c in rows]
    spread = 2.0 * np.sqrt(2.0 / np.maximum([c.dof for c in rows], 1.0))
    low = np.maximum(1.0 - spread, LEAST_RHO)
    ax.bar(x, 1.0 + spread - low, bottom=low, width=0.8, color=PALE, label="the twin's own 2 sigma")
    ax.axhline(1.0, color=GREY, linewidth=0.9)
    before = np.maximum([c.rho for c in rows], LEAST_RHO)
    after = np.maximum([c.rho_after for c in rows], LEAST_RHO)
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
