"""The drawings of a diagnosis report, from the document's numbers and the overlays
(`diagnosis_curves`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from infield.reports.drawing import Band as Area
from infield.reports.drawing import Boxes, Cells, Item, Line, Marks, Panel, Texts, rows_height
from infield.reports.figures import BLACK, BLUE, GREY, PALE, SKY, VERMILLION, robust_limits, thinned
from simreal.inference.causes import Cause
from simreal.inference.locate import GapCell
from simreal.report.diagnosis_curves import Overlay, RunCurve

MOST_NATS = 30.0  # colour scale of the heat map: beyond, a cell is as dark as can be; odds of 1e13
SHOWN_NATS = 3.0  # a smaller excess has no number in its cell: odds of 20
UPRIGHT_PX, SCALE_PX, BANDS_PX = 50, 130, 320  # heights: of turned labels; of the scale; of bands
MOST_PANELS = 8
MOST_BANDS = 2  # channels of one drawing of bands
LEAST_RHO = 0.05  # a smaller ratio is drawn there
# share of the colour scale from which a number is written in white; chosen: past its middle (0.5)
DARK = 0.55
SHADES = tuple(  # the scheme PuOr of ColorBrewer, from purple to orange: red, green, blue
    tuple(bytes.fromhex(code))
    for code in (
        *("2d004b", "542788", "8073ac", "b2abd2", "d8daeb", "f7f7f7"),
        *("fee0b6", "fdb863", "e08214", "b35806", "7f3b08"),
    )
)
SCALE_STEPS, SCALE_NATS = 60, (-30.0, -10.0, -3.0, 0.0, 3.0, 10.0, 30.0)
SQUARE_GAP = 0.025  # between squares, in parts of one
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


def gap_maps(cells: Sequence[GapCell]) -> list[Panel]:
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
    return [
        _gap_map(before, channels, names, "Before"),
        _gap_map(after, channels, names, "With what was found"),
    ]


def _gap_map(
    squares: Sequence[_Square], channels: Sequence[str], bands: Sequence[str], title: str
) -> Panel:
    rows = [_square_cell(s, channels[s.place[1]], bands[s.place[0]]) for s in squares]
    return Panel(
        items=[Cells(rows), _numbers(squares)],
        title=title,
        label=f"Heat map of the gap by band and channel: {title.lower()}",
        x_limits=(-0.5, len(channels) - 0.5),
        y_limits=(len(bands) - 0.5, -0.5),
        x_ticks=list(enumerate(channels)),
        y_ticks=list(enumerate(bands)),
        upright=True,
        bare=True,
        height=rows_height(len(bands)) + UPRIGHT_PX,
    )


def _square_cell(
    square: _Square, channel: str, band: str
) -> tuple[float, float, float, float, str, str]:
    y, x = square.place
    half = 0.5 - SQUARE_GAP
    words = f"{channel}, {band}: ratio {square.rho:.3g}, {square.nats:.3g} nats"
    return x - half, x + half, y - half, y + half, _shade(square.colour), words


def _numbers(squares: Sequence[_Square]) -> Texts:
    """Of the squares that stand out; bold where they are located."""
    rows = []
    for square in squares:
        if square.nats > SHOWN_NATS or square.located:
            dark = abs(square.colour) > DARK * np.sqrt(MOST_NATS)
            colour = "white" if dark else "black"  # on the cell's colour, in the dark as well
            rows.append(
                (square.place[1], square.place[0], _short(square.rho), colour, square.located)
            )
    return Texts(rows)


def _shade(colour: float) -> str:
    """Of a signed root of nats, between the colours of SHADES."""
    top = float(np.sqrt(MOST_NATS))
    at = (colour + top) / (2.0 * top) * (len(SHADES) - 1)
    mixed = [np.interp(at, np.arange(len(SHADES)), shades) for shades in zip(*SHADES)]
    return "#" + "".join(f"{round(float(value)):02x}" for value in mixed)


def nats_scale() -> Panel:
    """The colours of both maps with their nats."""
    top = float(np.sqrt(MOST_NATS))
    edges = np.linspace(-top, top, SCALE_STEPS + 1)
    rows = [
        (low, high, 0.0, 1.0, _shade(0.5 * (low + high)), "")
        for low, high in zip(edges[:-1].tolist(), edges[1:].tolist())
    ]
    ticks = [(float(np.sign(t) * np.sqrt(abs(t))), f"{abs(t):g}") for t in SCALE_NATS]
    return Panel(
        items=[Cells(rows)],
        label="Colours of the maps in nats",
        x_label="nats; left: too quiet, right: too loud",
        x_limits=(-1.02 * top, 1.02 * top),
        y_limits=(0.0, 1.0),
        x_ticks=ticks,
        y_ticks=[],
        bare=True,
        height=SCALE_PX,
    )


def _band(cell: GapCell) -> Band:
    low, high = cell.frequency_hz
    assert low is not None
    return float(low), float("inf") if high is None else float(high), bool(cell.moving)


def _bands(cells: Sequence[GapCell]) -> list[Band]:
    """Slow ones first, then those of moving vehicles."""
    return sorted({_band(c) for c in cells}, key=lambda band: (band[2], band[0]))


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


def posterior_bars(cause: Cause) -> Panel:
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
    items: list[Item] = []
    for y, (key, p) in enumerate(rows.items()):
        colour = VERMILLION if key == own else BLUE if key in held else PALE
        items.append(Boxes([(0.0, p, y - 0.35, y + 0.35)], colour))
    said = [(p + 0.008, y, _percent(p), BLACK, False) for y, p in enumerate(rows.values())]
    labels = [
        f"{effect} on {target}" if target else "outside the catalogue" for effect, target in rows
    ]
    return Panel(
        items=[*items, Texts(said, middle=False)],
        label=f"Posterior probabilities of the answers for {cause.effect} on {cause.target}",
        x_label="probability",
        x_limits=(0.0, 1.18),  # the words beside a bar fit on a phone
        y_limits=(len(rows) - 0.4, -0.6),
        y_ticks=list(enumerate(labels)),
        grid_y=False,
        height=rows_height(len(rows)),
    )


def _percent(p: float) -> str:
    if p >= 0.01:
        return f"{100 * p:.0f} %"
    return "under 1 %" if p < 0.005 else "1 %"


def overlay_panels(overlay: Overlay) -> list[Panel]:
    """Run by run: what was measured and the effect through it, each as narrow as a phone; none
    where there is no run to show.
    """
    curves = overlay.curves[:MOST_PANELS]
    limits = None
    if overlay.unit and curves:
        both = [np.concatenate([c.measured, c.effect]) for c in curves]
        limits = robust_limits(np.concatenate(both))
    return [_overlay(curve, overlay, limits) for curve in curves]


def _overlay(curve: RunCurve, overlay: Overlay, limits: tuple[float, float] | None) -> Panel:
    held = ", fitted on the other runs" if curve.held_out else ""
    unit = overlay.unit
    return Panel(
        items=_curve_items(curve, unit),
        title=f"{_plain(curve.run_id)}{held}",
        label=f"Residual of {overlay.channel} and the fitted effect, {_plain(curve.run_id)}",
        x_label="time since power-on [min]",
        y_label=f"{overlay.channel} [{unit}]" if unit else "evidence, summed",
        y_limits=limits,
    )


def _curve_items(curve: RunCurve, unit: str) -> list[Item]:
    t, measured, effect = thinned(curve.time_min, curve.measured, curve.effect)
    zero = Line(t[[0, -1]], np.zeros(2), GREY, width=0.8)
    if unit:
        return [
            zero,
            Marks(t, measured, "o", SKY, name="measured less the twin, minutes", size=3.6),
            Line(t, effect, VERMILLION, name="the effect", width=1.8),
        ]
    band = 2.0 * np.sqrt(np.maximum(effect, 0.0))
    return [
        zero,
        Area(t, effect - band, effect + band, VERMILLION, 0.15, name="2 sigma"),
        Line(t, effect, VERMILLION, name="if the effect is as fitted", width=1.8),
        Line(t, measured, BLUE, name="what the data give", width=1.2),
    ]


def band_panels(cells: Sequence[GapCell], channels: Sequence[str]) -> list[Panel]:
    """Mean square over expectation per band of one or two channels, before and after: for a
    noise.
    """
    known = {cell.channel for cell in cells}
    shown = [c for c in channels if c in known][:MOST_BANDS]
    rows = [cell for cell in cells if cell.channel in shown]
    bands = _bands(rows)
    return [_band_panel([c for c in rows if c.channel == name], bands, name) for name in shown]


def _band_panel(rows: Sequence[GapCell], bands: Sequence[Band], name: str) -> Panel:
    x = np.array([bands.index(_band(c)) for c in rows], dtype=float)
    spread = 2.0 * np.sqrt(2.0 / np.maximum([c.dof for c in rows], 1.0))
    low, high = np.maximum(1.0 - spread, LEAST_RHO), 1.0 + spread
    boxes = [(a - 0.4, a + 0.4, b, c) for a, b, c in zip(x.tolist(), low.tolist(), high.tolist())]
    before = np.maximum([c.rho for c in rows], LEAST_RHO)
    after = np.maximum([c.rho_after for c in rows], LEAST_RHO)
    most, least = max(before.max(), after.max()), min(before.min(), after.min())
    limits = (0.8 * min(least, 0.5), 1.3 * max(most, 2.0))
    ends = (-0.6, len(bands) - 0.4)
    return Panel(
        items=[
            Boxes(boxes, PALE, name="the twin's own 2 sigma"),
            Line(np.array(ends), np.ones(2), GREY, width=0.9),
            Marks(x, before, "o", VERMILLION, name="before", size=6.0),
            Marks(x, after, "D", BLUE, name="with what was found", size=4.5),
        ],
        label=f"Mean square per band of {name} before and after",
        x_limits=ends,
        y_limits=limits,
        y_label=f"{name}, ratio",
        y_log=True,
        x_ticks=[(k, _band_name(band)) for k, band in enumerate(bands)],
        upright=True,
        height=BANDS_PX,
    )


def _plain(text: str, longest: int = 34) -> str:
    return str(text).encode("ascii", "replace").decode()[:longest]
