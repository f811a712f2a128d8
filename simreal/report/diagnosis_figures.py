"""The drawings of a diagnosis report, from the document's numbers and the overlays
(`diagnosis_curves`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from infield.reports.drawing import (
    BLACK,
    BLUE,
    FRAME_PX,
    GREY,
    PALE,
    SKY,
    VERMILLION,
    Boxes,
    Cells,
    Item,
    Line,
    Marks,
    Panel,
    Texts,
    robust_limits,
    rows_height,
    thinned,
)
from simreal.inference.causes import Cause
from simreal.inference.locate import GapCell
from simreal.report.diagnosis_curves import Overlay, RunCurve
from simreal.report.diagnosis_words import Found, answer_words, band_words, plain

MOST_SIGMAS = 8.0  # colour scale of the map: beyond, a cell is as dark as can be; odds of 1e13
SHOWN_SIGMAS = 3.0  # a smaller excess has no number in its cell: one of 370 squares of N(0, 1)
SQUARE_PX, UPRIGHT_PX, BANDS_PX = 19, 50, 320  # heights: of a square; of turned labels; of bands
MOST_PANELS = 8
MOST_BANDS = 2  # channels of one drawing of bands
LEAST_RHO = 0.05  # a smaller ratio is drawn there
# of an excess and of what is too quiet; a cell is as clear as it is near zero, so that the map
# stands on light pages and on dark ones, and either ink is read on it (contrast 3.2 at least)
LOUD, QUIET = "#c85500", "#7a6bab"
FAINTEST = 0.1  # opacity at zero; chosen: just seen on either page
SQUARE_GAP = 0.025  # between squares, in parts of one
# probability of an answer that is drawn: a bar of 0.1 % is one pixel of 1000; of several causes
LEAST_SHOWN, LEAST_LIKELY = 0.001, 0.05
MOST_BARRED = 4  # causes whose answers have bars

Band = tuple[float, float, bool]  # lower and upper end [Hz], and whether the vehicle moves


@dataclass(frozen=True)
class _Square:
    """A cell of the map: row of the band, column of the channel, sigmas off the twin's mean square
    (below 0: too quiet), and whether it is located.
    """

    place: tuple[int, int]
    sigmas: float
    located: bool


def sigmas_of(nats: float, rho: float) -> float:
    """The signed root of a deviance, near N(0, 1) where there is no gap; nats: half of it less its
    mean.
    """
    return float(np.sign(rho - 1.0) * np.sqrt(max(2.0 * nats + 1.0, 0.0)))


def gap_maps(cells: Sequence[GapCell], longest_s: float) -> tuple[Panel, Panel]:
    """Band against channel, before and with what was found, each as narrow as a phone; longest_s:
    of the runs' rests.
    """
    channels = list(dict.fromkeys(c.channel for c in cells))
    bands = _bands(cells)
    places = [(bands.index(_band(c)), channels.index(c.channel)) for c in cells]
    before = [_Square(at, sigmas_of(c.nats, c.rho), c.located) for at, c in zip(places, cells)]
    after = [
        _Square(at, sigmas_of(c.nats_after, c.rho_after), c.located_after)
        for at, c in zip(places, cells)
    ]
    names = [_band_name(b, longest_s) for b in bands]
    return (
        _gap_map(before, channels, names, "Before"),
        _gap_map(after, channels, names, "With what was found"),
    )


def _gap_map(
    squares: Sequence[_Square], channels: Sequence[str], bands: Sequence[str], title: str
) -> Panel:
    rows = [_square_cell(s, channels[s.place[1]], bands[s.place[0]]) for s in squares]
    return Panel(
        items=[Cells(rows), _numbers(squares)],
        title=title,
        label=f"Heat map of the gap by period and channel in sigmas: {title.lower()}",
        x_limits=(-0.5, len(channels) - 0.5),
        y_limits=(len(bands) - 0.5, -0.5),
        x_ticks=list(enumerate(channels)),
        y_ticks=list(enumerate(bands)),
        upright=True,
        bare=True,
        height=SQUARE_PX * len(bands) + FRAME_PX + UPRIGHT_PX,
    )


def _square_cell(
    square: _Square, channel: str, band: str
) -> tuple[float, float, float, float, str, str]:
    y, x = square.place
    half = 0.5 - SQUARE_GAP
    words = f"{channel}, {band}: {square.sigmas:.2g} sigmas"
    return x - half, x + half, y - half, y + half, shade(square.sigmas), words


def _numbers(squares: Sequence[_Square]) -> Texts:
    """Of the squares that stand out; bold where they are located."""
    rows = []
    for square in squares:
        if abs(square.sigmas) > SHOWN_SIGMAS or square.located:
            said = f"{square.sigmas:.0f}".replace("-", "−")
            rows.append((square.place[1], square.place[0], said, BLACK, square.located))
    return Texts(rows)


def shade(sigmas: float) -> str:
    """The colour of so many sigmas, with its opacity; a cell that was measured is never blank."""
    share = FAINTEST + (1.0 - FAINTEST) * min(abs(sigmas) / MOST_SIGMAS, 1.0)
    return f"{LOUD if sigmas > 0 else QUIET}{round(255 * share):02x}"


def _band(cell: GapCell) -> Band:
    low, high = cell.frequency_hz
    assert low is not None
    return float(low), float("inf") if high is None else float(high), bool(cell.moving)


def _bands(cells: Sequence[GapCell]) -> list[Band]:
    """Slow ones first, then those of moving vehicles."""
    return sorted({_band(c) for c in cells}, key=lambda band: (band[2], band[0]))


def _band_name(band: Band, longest_s: float) -> str:
    """A band by its periods, slow ones first."""
    low, high, moving = band
    return "moving" if moving else band_words(low, high, longest_s)


def posterior_bars(causes: Sequence[Found]) -> Panel:
    """Probabilities of the answers, those of one cause below one another: the answer taken, the
    rest of the set that is open, the others; of several causes those only where they are likely.
    """
    items: list[Item] = []
    said: list[tuple[float, float, str, str, bool]] = []
    labels: list[str] = []
    alone = len(causes) == 1
    least = LEAST_SHOWN if alone else LEAST_LIKELY
    for found in causes[:MOST_BARRED]:
        cause = found.first
        own = cause.effect, cause.target
        held = {own} | {(r.effect, r.target) for r in cause.rivals}
        rows = {(a.effect, a.target): a for a in (*cause.rivals, *cause.posterior)}
        for key, answer in sorted(rows.items(), key=lambda row: -row[1].probability):
            p = answer.probability
            if key not in held and (p < least or not (answer.target or alone)):
                continue
            y = len(labels)
            colour = VERMILLION if key == own else BLUE if key in held else PALE
            items.append(Boxes([(0.0, p, y - 0.35, y + 0.35)], colour))
            said.append((p + 0.008, y, _percent(p), BLACK, False))
            labels.append(answer_words(answer, cause.target if alone else ""))
    return Panel(
        items=[*items, Texts(said, middle=False)],
        label="Posterior probabilities of the answers",
        x_label="probability",
        x_limits=(0.0, 1.45),  # the words beside a bar fit into a third of the page
        y_limits=(len(labels) - 0.4, -0.6),
        x_ticks=[(0.0, "0"), (0.5, "0.5"), (1.0, "1")],
        y_ticks=list(enumerate(labels)),
        grid_y=False,
        height=rows_height(len(labels)),
    )


def shrink_bars(causes: Sequence[Cause]) -> Panel:
    """The share of the excess that goes with each cause, with its 95 % interval."""
    judged = [(c, c.shrink) for c in causes if c.shrink is not None]
    x = np.array([100.0 * s.fraction for _, s in judged])
    low, high = 100.0 * np.array([s.interval_95 for _, s in judged]).T
    y = np.arange(len(judged), dtype=float)
    bars = [(min(v, 0.0), max(v, 0.0), k - 0.3, k + 0.3) for k, v in enumerate(x.tolist())]
    whiskers = [
        Line(np.array([a, b]), np.array([k, k]), BLACK, width=2.0) for a, b, k in zip(low, high, y)
    ]
    labels = [_called(c) if len(judged) > 1 else plain(c.effect) for c, _ in judged]
    return Panel(
        items=[Boxes(bars, BLUE), *whiskers],
        label="Share of the excess that goes with each cause, and its 95 % interval",
        x_label="gone [%]",
        x_limits=(max(min(float(low.min()), 0.0), -100.0) - 5.0, 115.0),
        x_ticks=[(-100.0, "−100"), (0.0, "0"), (100.0, "100")],
        y_limits=(len(judged) - 0.4, -0.6),
        y_ticks=list(enumerate(labels)),
        grid_y=False,
        height=rows_height(len(judged)),
    )


def _called(cause: Cause) -> str:
    return f"{plain(cause.effect)}, {cause.run_id or plain(cause.target)}"


def _percent(p: float) -> str:
    if p >= 0.01:
        return f"{100 * p:.0f} %"
    return "under 1 %" if p < 0.005 else "1 %"


def overlay_panels(overlay: Overlay) -> list[Panel]:
    """Run by run: what was measured and the effect through it, each as narrow as a phone; none
    where there is no run to show.
    """
    curves = overlay.curves[:MOST_PANELS]
    both = [np.concatenate([c.measured, c.effect]) for c in curves]
    limits = robust_limits(np.concatenate(both)) if both else None
    return [_overlay(curve, overlay, limits) for curve in curves]


def _overlay(curve: RunCurve, overlay: Overlay, limits: tuple[float, float] | None) -> Panel:
    held = ", fitted on the other runs" if curve.held_out else ""
    t, measured, effect = thinned(curve.time_min, curve.measured, curve.effect)
    return Panel(
        items=[
            Line(t[[0, -1]], np.zeros(2), GREY, width=0.8),
            Marks(t, measured, "o", SKY, name="measured less the twin, minutes", size=3.6),
            Line(t, effect, VERMILLION, name="the effect", width=1.8),
        ],
        title=f"{_plain(curve.run_id)}{held}",
        label=f"Residual of {overlay.channel} and the fitted effect, {_plain(curve.run_id)}",
        x_label="time since power-on [min]",
        y_label=f"{overlay.channel} [{overlay.unit}]",
        y_limits=limits,
    )


def band_panels(cells: Sequence[GapCell], channels: Sequence[str], longest_s: float) -> list[Panel]:
    """Mean square over expectation per band of one or two channels, before and after: for a
    noise.
    """
    known = {cell.channel for cell in cells}
    shown = [c for c in channels if c in known][:MOST_BANDS]
    rows = [cell for cell in cells if cell.channel in shown]
    bands = _bands(rows)
    names = [_band_name(band, longest_s) for band in bands]
    return [
        _band_panel([c for c in rows if c.channel == name], bands, names, name) for name in shown
    ]


def _band_panel(
    rows: Sequence[GapCell], bands: Sequence[Band], names: Sequence[str], name: str
) -> Panel:
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
        x_ticks=list(enumerate(names)),
        upright=True,
        height=BANDS_PX,
    )


def _plain(text: str, longest: int = 34) -> str:
    return str(text).encode("ascii", "replace").decode()[:longest]
