"""Drawings of an aided solution for replay.html: map, attitude, velocity, biases, innovations,
sigma against error.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from infield.aided.flight import AidedResult
from infield.reports.charts import (
    DASHED,
    DOT,
    DOTTED,
    FarEdge,
    Item,
    Line,
    Marks,
    Panel,
    chart,
    round_ticks,
)
from infield.reports.documents.aided import aided_columns, smoothed_result
from infield.reports.figures import (
    AXIS_COLOURS,
    BLACK,
    GREEN,
    GREY,
    MAX_DOTS,
    NEW,
    OLD,
    PANEL_POINTS,
    SKY,
    robust_limits,
    thinned,
)
from infield.reports.track_kml import Track, tracks_of
from infield.reports.zoom import ZoomCurve, ZoomFigure, zoom_panels
from ins.earth import displacement_ned
from ins.filters.aided_filter import KINDS
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
AIDED_FIGURES = (
    "aided_attitude",
    "aided_velocity",
    "aided_biases",
    "innovations",
    "aided_sigma",
    "smoothed_sigma",
)
TIME = "time of the log [min]"
# a map of less shows noise: 40 sigmas of the default receiver (0.5 m), 4 of one of 5 m
MOVED_M = 20.0
MAP_INCHES = 6.5
MOST_DEGREES = 4  # labels along a far edge: seven letters each
DRAWN_SIGMAS = 6.0  # of an innovation; a rejected one beyond it stands at the edge
SHADED_SIGMAS = 2.0
LEAST_OFF = 1e-4  # of a fix from its prediction: no logarithm of zero


def map_figure(result: "ReplayResult") -> Markup | None:
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
    panel = Panel(
        items=items,
        x_label=f"east [{name}]",
        y_label=f"north [{name}]",
        x_limits=limits[1],
        y_limits=limits[0],
        equal=True,
        far=_degrees(limits, unit, site.lat_rad, site.lon_rad, site.height_m),
        legend="above",
    )
    label = "Tracks on a plain grid: GNSS, free-inertial by table, aided"
    return chart([panel], label, width=MAP_INCHES, height=MAP_INCHES)


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
        ticks = round_ticks((float(low), float(high)), MOST_DEGREES)
        rows = [((value - origin / DEG) * per_deg[k], text) for value, text in ticks]
        edges.append(FarEdge([(float(at), text) for at, text in rows], f"{name} [deg]"))
    return edges[1], edges[0]


def _grid(track: Track, lat_rad: float, lon_rad: float, height_m: float) -> NDArray:
    return displacement_ned(
        track.lat_rad, track.lon_rad, lat0_rad=lat_rad, lon0_rad=lon_rad, height0_m=height_m
    )


def aided_figures(result: "ReplayResult") -> dict[str, Markup | None]:
    """Drawings by name of AIDED_FIGURES; None where there is no aided solution."""
    aided = result.aided
    if aided is None or aided.history is None:
        return dict.fromkeys(AIDED_FIGURES)
    columns = aided_columns(aided)
    best = smoothed_result(aided)
    return {
        "aided_attitude": zoom_panels(
            list(_attitude(columns)), "Attitude, and what the filter says it is good to."
        ),
        "aided_velocity": zoom_panels(list(_velocity(columns, result))),
        "aided_biases": zoom_panels(
            list(_biases(columns)), "Biases beyond the compensation, with one-sigma bands."
        ),
        "innovations": zoom_panels(
            list(_innovations(aided)),
            "Each fix less its prediction over the sigma of that difference. Shaded: two sigmas."
            " Crosses: rejected by the gate, drawn at the edge where beyond it.",
        ),
        "aided_sigma": zoom_panels(
            list(_sigma(aided, columns)),
            "Logarithmic. Dots: what each fix is off its prediction, receiver noise included.",
        ),
        "smoothed_sigma": None
        if best is None
        else zoom_panels(
            list(_smoothed_sigma(columns, aided_columns(best))),
            "Logarithmic. What the filter knew at each time, and what all fixes together say.",
        ),
    }


def _panel(
    title: str,
    unit: str,
    minutes: NDArray,
    curves: Sequence[ZoomCurve],
    *,
    limits: tuple[float, float] | None = None,
    log: bool = False,
) -> ZoomFigure:
    """A drawing over the time of the log (n,) [min]; all of them zoom together."""
    return ZoomFigure(
        title=title,
        unit=unit,
        time_s=minutes,
        curves=curves,
        x_name=TIME,
        label=f"{title} over time",
        limits=limits,
        log=log,
        panel=True,
    )


def _over_log(columns: dict[str, NDArray], *values: NDArray) -> tuple[NDArray, ...]:
    """Minutes of the log and values (n,), thinned for a panel."""
    return thinned(columns["time_s"] / 60.0, *values, most=PANEL_POINTS)


def _attitude(columns: dict[str, NDArray]) -> Iterator[ZoomFigure]:
    for name in ("roll", "pitch", "heading"):
        angle = columns[f"{name}_deg"]
        angle = np.unwrap(angle, period=360.0) if name == "heading" else _broken(angle)
        t, y = _over_log(columns, angle)
        title = f"{name.capitalize()}{', continuous' if name == 'heading' else ''}"
        yield _panel(title, "angle [deg]", t, [ZoomCurve(name="", values=y, colour=GREEN)])
    for name in ("roll", "pitch", "heading"):
        t, s = _over_log(columns, columns[f"sigma_{name}_deg"])
        curve = ZoomCurve(name="", values=s, colour=GREEN)
        yield _panel(f"Sigma of the {name}", "sigma [deg]", t, [curve], log=True)


def _broken(angle: NDArray) -> NDArray:
    """Jumps over +-180 deg are not drawn."""
    out = np.array(angle)
    out[1:][np.abs(np.diff(angle)) > 180.0] = np.nan
    return out


def _velocity(columns: dict[str, NDArray], result: "ReplayResult") -> Iterator[ZoomFigure]:
    gnss = result.run.gnss
    for k, (name, title) in enumerate((("vn", "North"), ("ve", "East"), ("vd", "Down"))):
        curves = []
        if gnss is not None:
            t, y = thinned(gnss.time_s / 60.0, gnss.v_n_m_s[:, k], most=PANEL_POINTS)
            curves.append(ZoomCurve(name="GNSS", values=y, x=t, colour=SKY))
        t, y = _over_log(columns, columns[f"{name}_m_s"])
        curves.append(ZoomCurve(name="aided", values=y, x=t, colour=GREEN))
        yield _panel(f"{title} velocity", "velocity [m/s]", t, curves)


def _biases(columns: dict[str, NDArray]) -> Iterator[ZoomFigure]:
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
                t,
                [ZoomCurve(name="", values=bias, low=low, high=high, colour=colour)],
                limits=robust_limits(inner, np.concatenate([low, high])),
            )


def _innovations(aided: AidedResult) -> Iterator[ZoomFigure]:
    """Innovations over their sigmas; rejected fixes as crosses, at the edge where beyond it."""
    from ins.filters.aided_kernel import REJECTED, USED

    history = aided.history
    assert history is not None
    minutes = history.fix_time_s / 60.0
    ends, near = minutes[[0, -1]], np.full(2, SHADED_SIGMAS)
    edge = DRAWN_SIGMAS - 0.4
    for row, kind in enumerate(KINDS):
        for k, name in enumerate(("north", "east", "down")):
            over = history.residual[:, 3 * row + k] / history.sigma[:, 3 * row + k]
            band = ZoomCurve(
                name="two sigmas", values=0.0 * near, low=-near, high=near, x=ends, colour=SKY
            )
            curves = [band]
            for state, word, mark, colour in (
                (USED, "used", DOT, BLACK),
                (REJECTED, "rejected", "x", OLD),
            ):
                rows = np.flatnonzero((history.used[:, row] == state) & np.isfinite(over))
                if rows.size:
                    shown = np.clip(over[rows], -edge, edge)
                    t, y = thinned(minutes[rows], shown, most=MAX_DOTS)
                    curves.append(ZoomCurve(name=word, values=y, x=t, mark=mark, colour=colour))
            yield _panel(
                f"{kind.capitalize()}, {name}",
                "over sigma",
                ends,
                curves,
                limits=(-DRAWN_SIGMAS, DRAWN_SIGMAS),
            )


def _sigma(aided: AidedResult, columns: dict[str, NDArray]) -> Iterator[ZoomFigure]:
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
        dots = ZoomCurve(
            name="GNSS less prediction",
            values=np.maximum(off, LEAST_OFF),
            x=t_off,
            mark=DOT,
            colour=GREY,
        )
        line = ZoomCurve(name="sigma of the solution", values=sigma, colour=GREEN)
        yield _panel(f"Level {kind}", f"{kind} [{unit}]", t, [dots, line], log=True)


def _smoothed_sigma(columns: dict[str, NDArray], best: dict[str, NDArray]) -> Iterator[ZoomFigure]:
    """Sigmas of filter and smoother, level and heading."""

    def level(of: dict[str, NDArray]) -> NDArray:
        return np.hypot(of["sigma_north_m"], of["sigma_east_m"])

    def heading(of: dict[str, NDArray]) -> NDArray:
        return of["sigma_heading_deg"]

    for title, sigma_of, unit in (("Level position", level, "m"), ("Heading", heading, "deg")):
        t, sigma = _over_log(columns, sigma_of(columns))
        t_best, of_best = _over_log(best, sigma_of(best))
        curves = [
            ZoomCurve(name="filter", values=sigma, colour=GREY),
            ZoomCurve(name="smoothed", values=of_best, x=t_best, colour=GREEN),
        ]
        yield _panel(title, f"sigma [{unit}]", t, curves, log=True)
