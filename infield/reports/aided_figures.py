"""Drawings of an aided solution for replay.html: map, attitude, velocity, biases, innovations,
sigma against error.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from infield.aided.flight import AidedResult
from infield.reports.documents.aided import aided_columns, smoothed_result
from infield.reports.drawing import (
    AXIS_COLOURS,
    BLACK,
    DASHED,
    DOT,
    DOTTED,
    GREEN,
    GREY,
    MAX_DOTS,
    NEW,
    OLD,
    PANEL_POINTS,
    SKY,
    Band,
    FarEdge,
    Item,
    Line,
    Marks,
    Panel,
    robust_limits,
    thinned,
)
from infield.reports.track_kml import Track, tracks_of
from ins.earth import displacement_ned
from ins.filters.aided_filter import KINDS
from ins.filters.aided_records import REJECTED, USED
from ins.records import AXES
from ins.units import DEG

if TYPE_CHECKING:
    from infield.replay.free_inertial import ReplayResult

TRACK_NAMES = {
    "gnss": "GNSS",
    "previous": "free-inertial, previous table",
    "active": "free-inertial, active table",
    "aided": "aided by GNSS",
}
# on the map: colour, width, dash; GNSS lies widely below the others
TRACK_LINES = {
    "gnss": ("#B9BEC4", 3.5, ""),
    "previous": (OLD, 1.5, DOTTED),
    "active": (NEW, 1.5, DASHED),
    "aided": (GREEN, 1.8, ""),
}
TIME, LOG_GROUP = "time of the log [min]", "log"
# a map of less shows noise: 40 sigmas of the default receiver (0.5 m), 4 of one of 5 m
MOVED_M = 20.0
MAP_PX = 620
ROUND_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
MOST_DEGREES = 4  # labels along a far edge: seven letters each
DRAWN_SIGMAS = 6.0  # of an innovation; a rejected one beyond it stands at the edge
SHADED_SIGMAS = 2.0
DOT_SIZE, CROSS_SIZE = 1.8, 3.6
LEAST_OFF = 1e-4  # of a fix from its prediction: no logarithm of zero


def map_panel(result: "ReplayResult") -> Panel | None:
    """All tracks on a plain grid, km or m east and north of the run's site, latitude and longitude
    on the far sides.

    None where nothing moves by MOVED_M. A free-inertial track that runs away is cut at the frame,
    which holds the others.
    """
    site, tracks = result.run.header.site, tracks_of(result)
    grid = {t.key: _grid(t, site.lat_rad, site.lon_rad, site.height_m) for t in tracks}
    held = [grid[k] for k in ("gnss", "aided") if k in grid] or list(grid.values())
    parked = set(grid) <= {"active", "previous"} and not _rolls(result)
    if not held or parked or max(float(np.ptp(g, axis=0).max()) for g in held) < MOVED_M:
        return None
    low, high = (
        np.min([g.min(axis=0) for g in held], axis=0),
        np.max([g.max(axis=0) for g in held], axis=0),
    )
    centre, half = 0.5 * (low + high), 0.6 * float((high - low).max())
    unit, name = (1000.0, "km") if half > 1500.0 else (1.0, "m")
    items: list[Item] = []
    for t in tracks:
        north, east = thinned(*(grid[t.key] / unit).T)
        colour, width, dash = TRACK_LINES[t.key]
        items.append(Line(east, north, colour, TRACK_NAMES[t.key], width, dash))
    best = grid["aided"] if "aided" in grid else held[0]
    for mark, place, row in (("o", "start", best[0]), ("s", "end", best[-1])):
        items.append(Marks(row[[1]] / unit, row[[0]] / unit, mark, BLACK, place, size=6.0))
    limits = [((c - half) / unit, (c + half) / unit) for c in centre]
    return Panel(
        items=items,
        label="Tracks on a plain grid: GNSS, free-inertial by table, aided",
        x_label=f"east [{name}]",
        y_label=f"north [{name}]",
        x_limits=limits[1],
        y_limits=limits[0],
        equal=True,
        far=_degrees(limits, unit, site.lat_rad, site.lon_rad, site.height_m),
        height=MAP_PX,
    )


def _rolls(result: "ReplayResult") -> bool:
    """Whether the vehicle leaves its parked place before the log ends, by the first flight."""
    last = max(
        [float(t.history.time_s[-1]) for t in result.tables if t.history is not None], default=0.0
    )
    return result.parked_until_s is not None and result.parked_until_s < last - 1.0


def _degrees(
    limits: Sequence[tuple[float, float]],
    unit: float,
    lat_rad: float,
    lon_rad: float,
    height_m: float,
) -> tuple[FarEdge, FarEdge]:
    """Longitude on top, latitude on the right; limits: north and east, in the grid's unit [m]."""
    per_deg = (
        displacement_ned(
            lat_rad + DEG, lon_rad + DEG, lat0_rad=lat_rad, lon0_rad=lon_rad, height0_m=height_m
        )
        / unit
    )
    edges = []
    for k, (origin, name) in enumerate(((lat_rad, "latitude"), (lon_rad, "longitude"))):
        low, high = (origin / DEG + end / per_deg[k] for end in limits[k])
        ticks = _round_ticks(float(low), float(high))
        rows = [((value - origin / DEG) * per_deg[k], text) for value, text in ticks]
        edges.append(FarEdge([(float(at), text) for at, text in rows], f"{name} [deg]"))
    return edges[1], edges[0]


def _round_ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Multiples of a round step with their labels, MOST_DEGREES and one more at most."""
    raw = (high - low) / MOST_DEGREES
    decade = math.floor(math.log10(raw))
    step = next(s * 10.0**decade for s in ROUND_STEPS if s * 10.0**decade >= raw * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
    decimals = max(0, 1 - decade)
    return [(k * step, f"{k * step:.{decimals}f}") for k in range(first, last + 1)]


def _grid(track: Track, lat_rad: float, lon_rad: float, height_m: float) -> NDArray:
    return displacement_ned(
        track.lat_rad, track.lon_rad, lat0_rad=lat_rad, lon0_rad=lon_rad, height0_m=height_m
    )


@dataclass(frozen=True)
class AidedFigure:
    """Panels side by side with what is said of them."""

    panels: list[Panel]
    caption: str = ""


def aided_figures(result: "ReplayResult") -> dict[str, AidedFigure]:
    """Figures by name; empty where there is no aided solution."""
    aided = result.aided
    if aided is None or aided.history is None:
        return {}
    columns = aided_columns(aided)
    best = smoothed_result(aided)
    found = {
        "attitude": AidedFigure(
            list(_attitude(columns)), "Attitude, and what the filter says it is good to."
        ),
        "velocity": AidedFigure(list(_velocity(columns, result))),
        "biases": AidedFigure(
            list(_biases(columns)), "Biases beyond the compensation, with one-sigma bands."
        ),
        "innovations": AidedFigure(
            list(_innovations(aided)),
            "Each fix less its prediction over the sigma of that difference. Shaded: two sigmas."
            " Crosses: rejected by the gate, drawn at the edge where beyond it.",
        ),
        "sigma": AidedFigure(
            list(_sigma(aided, columns)),
            "Logarithmic. Dots: what each fix is off its prediction, receiver noise included.",
        ),
    }
    if best is not None:
        found["smoothed"] = AidedFigure(
            list(_smoothed_sigma(columns, aided_columns(best))),
            "Logarithmic. What the filter knew at each time, and what all fixes together say.",
        )
    return found


def _panel(
    title: str,
    y_label: str,
    items: list[Item],
    *,
    limits: tuple[float, float] | None = None,
    log: bool = False,
) -> Panel:
    """A panel over the time of the log; all of them zoom together."""
    return Panel(
        title=title,
        items=items,
        label=f"{title} over time",
        x_label=TIME,
        y_label=y_label,
        y_limits=limits,
        y_log=log,
        group=LOG_GROUP,
    )


def _over_log(columns: dict[str, NDArray], *values: NDArray) -> tuple[NDArray, ...]:
    """Minutes of the log and values (n,), thinned for a panel."""
    return thinned(columns["time_s"] / 60.0, *values, most=PANEL_POINTS)


def _attitude(columns: dict[str, NDArray]) -> Iterator[Panel]:
    for name in ("roll", "pitch", "heading"):
        angle = columns[f"{name}_deg"]
        angle = np.unwrap(angle, period=360.0) if name == "heading" else _broken(angle)
        t, y = _over_log(columns, angle)
        title = f"{name.capitalize()}{', continuous' if name == 'heading' else ''}"
        yield _panel(title, "angle [deg]", [Line(t, y, GREEN)])
    for name in ("roll", "pitch", "heading"):
        t, s = _over_log(columns, columns[f"sigma_{name}_deg"])
        yield _panel(f"Sigma of the {name}", "sigma [deg]", [Line(t, s, GREEN)], log=True)


def _broken(angle: NDArray) -> NDArray:
    """Jumps over +-180 deg are not drawn."""
    out = np.array(angle)
    out[1:][np.abs(np.diff(angle)) > 180.0] = np.nan
    return out


def _velocity(columns: dict[str, NDArray], result: "ReplayResult") -> Iterator[Panel]:
    gnss = result.run.gnss
    for k, (name, title) in enumerate((("vn", "North"), ("ve", "East"), ("vd", "Down"))):
        items: list[Item] = []
        if gnss is not None:
            t, y = thinned(gnss.time_s / 60.0, gnss.v_n_m_s[:, k], most=PANEL_POINTS)
            items.append(Line(t, y, SKY, "GNSS"))
        t, y = _over_log(columns, columns[f"{name}_m_s"])
        items.append(Line(t, y, GREEN, "aided"))
        yield _panel(f"{title} velocity", "velocity [m/s]", items)


def _biases(columns: dict[str, NDArray]) -> Iterator[Panel]:
    """Gyro and accelerometer biases beyond the compensation, with one-sigma bands."""
    sensors = (("gyro", "deg_h", 1.0, "deg/h"), ("accel", "ug", 1e-3, "mg"))
    for sensor, unit, factor, words in sensors:
        for axis in AXES:
            names = (f"{prefix}{sensor}_bias_{axis}_{unit}" for prefix in ("", "sigma_"))
            t, *found = _over_log(columns, *(columns[name] for name in names))
            bias, sigma = (factor * values for values in found)
            low, high, settled = bias - sigma, bias + sigma, slice(bias.size // 2, None)
            inner = np.concatenate([bias, low[settled], high[settled]])
            colour = AXIS_COLOURS[axis]
            yield _panel(
                f"{sensor.capitalize()} {axis}",
                f"bias [{words}]",
                [Line(t, bias, colour, low=low, high=high)],
                limits=robust_limits(inner, np.concatenate([low, high])),
            )


def _innovations(aided: AidedResult) -> Iterator[Panel]:
    """Innovations over their sigmas; rejected fixes as crosses, at the edge where beyond it."""
    history = aided.history
    assert history is not None
    minutes = history.fix_time_s / 60.0
    ends, near = minutes[[0, -1]], np.full(2, SHADED_SIGMAS)
    edge = DRAWN_SIGMAS - 0.4
    for row, kind in enumerate(KINDS):
        for k, name in enumerate(("north", "east", "down")):
            over = history.residual[:, 3 * row + k] / history.sigma[:, 3 * row + k]
            items: list[Item] = [Band(ends, -near, near, SKY, 0.18, "two sigmas")]
            for state, word, mark, colour in (
                (USED, "used", DOT, BLACK),
                (REJECTED, "rejected", "x", OLD),
            ):
                rows = np.flatnonzero((history.used[:, row] == state) & np.isfinite(over))
                if rows.size:
                    shown = np.clip(over[rows], -edge, edge)
                    t, y = thinned(minutes[rows], shown, most=MAX_DOTS)
                    size = DOT_SIZE if mark == DOT else CROSS_SIZE
                    items.append(Marks(t, y, mark, colour, word, size))
            yield _panel(
                f"{kind.capitalize()}, {name}",
                "over sigma",
                items,
                limits=(-DRAWN_SIGMAS, DRAWN_SIGMAS),
            )


def _sigma(aided: AidedResult, columns: dict[str, NDArray]) -> Iterator[Panel]:
    """Sigma of the level position and velocity, and what each fix says they are off."""
    history = aided.history
    assert history is not None
    for k, (kind, names, unit) in enumerate(
        (
            ("position", ("sigma_north_m", "sigma_east_m"), "m"),
            ("velocity", ("sigma_vn_m_s", "sigma_ve_m_s"), "m/s"),
        )
    ):
        rows = np.flatnonzero(np.isfinite(history.residual[:, 3 * k]))
        t_off, off = thinned(
            history.fix_time_s[rows] / 60.0,
            np.linalg.norm(history.residual[rows, 3 * k : 3 * k + 2], axis=1),
            most=MAX_DOTS,
        )
        t, sigma = _over_log(columns, np.hypot(*(columns[name] for name in names)))
        off = np.maximum(off, LEAST_OFF)
        dots = Marks(t_off, off, DOT, GREY, "GNSS less prediction", DOT_SIZE)
        line = Line(t, sigma, GREEN, "sigma of the solution")
        yield _panel(f"Level {kind}", f"{kind} [{unit}]", [dots, line], log=True)


def _smoothed_sigma(columns: dict[str, NDArray], best: dict[str, NDArray]) -> Iterator[Panel]:
    """Sigmas of filter and smoother, level and heading."""

    def level(of: dict[str, NDArray]) -> NDArray:
        return np.hypot(of["sigma_north_m"], of["sigma_east_m"])

    def heading(of: dict[str, NDArray]) -> NDArray:
        return of["sigma_heading_deg"]

    for title, sigma_of, unit in (("Level position", level, "m"), ("Heading", heading, "deg")):
        t, sigma = _over_log(columns, sigma_of(columns))
        t_best, of_best = _over_log(best, sigma_of(best))
        items: list[Item] = [
            Line(t, sigma, GREY, "filter"),
            Line(t_best, of_best, GREEN, "smoothed"),
        ]
        yield _panel(title, f"sigma [{unit}]", items, log=True)
