"""Drawings of an aided solution for replay.html: map, attitude, velocity, biases, innovations,
sigma against error.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from infield.aided.flight import AidedResult
from infield.reports.documents.aided import aided_columns, smoothed_result
from infield.reports.figures import (
    AXIS_COLOURS,
    AXIS_LINES,
    BLACK,
    GREEN,
    GREY,
    MAX_DOTS,
    NEW,
    OLD,
    SKY,
    LineStyle,
    axis_text,
    in_style,
    new_figure,
    robust_limits,
    svg_text,
    thinned,
)
from infield.reports.track_kml import Track, tracks_of
from ins.earth import displacement_ned
from ins.filters.aided_filter import KINDS
from ins.units import DEG

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from infield.replay.free_inertial import ReplayResult

STYLES: dict[str, LineStyle] = {
    "gnss": {"color": GREY, "linewidth": 3.5, "alpha": 0.45, "label": "GNSS"},
    "previous": {
        "color": OLD,
        "linestyle": ":",
        "zorder": 3,
        "label": "free-inertial, previous table",
    },
    "active": {
        "color": NEW,
        "linestyle": "--",
        "zorder": 3,
        "label": "free-inertial, active table",
    },
    "aided": {"color": GREEN, "linewidth": 1.8, "label": "aided by GNSS"},
}
SMOOTHED: LineStyle = {"color": GREEN, "linewidth": 1.8}
BAND: LineStyle = {"alpha": 0.25, "linewidth": 0.0}
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


@in_style
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
    figure, axes = new_figure(width=6.4, height=6.6)
    ax = axes[0, 0]
    for t in tracks:
        north, east = thinned(*(grid[t.key] / unit).T)
        ax.plot(east, north, **STYLES[t.key])
    best = grid["aided"] if "aided" in grid else held[0]
    ax.plot(
        *(best[0, ::-1] / unit),
        marker="o",
        color=BLACK,
        linestyle="none",
        markersize=6,
        label="start",
    )
    ax.plot(
        *(best[-1, ::-1] / unit),
        marker="s",
        color=BLACK,
        linestyle="none",
        markersize=6,
        label="end",
    )
    ax.set_xlim((centre[1] - half) / unit, (centre[1] + half) / unit)
    ax.set_ylim((centre[0] - half) / unit, (centre[0] + half) / unit)
    ax.set_aspect("equal")
    _degrees(ax, unit, site.lat_rad, site.lon_rad, site.height_m)
    axis_text(ax, x=f"east [{name}]", y=f"north [{name}]")
    figure.legend(loc="outside upper center", ncols=2)
    return svg_text(figure, "Tracks on a plain grid: GNSS, free-inertial by table, aided")


def _rolls(result: "ReplayResult") -> bool:
    """Whether the vehicle leaves its parked place before the log ends, by the first flight."""
    last = max(
        [float(t.history.time_s[-1]) for t in result.tables if t.history is not None], default=0.0
    )
    return result.parked_until_s is not None and result.parked_until_s < last - 1.0


def _degrees(ax: "Axes", unit: float, lat_rad: float, lon_rad: float, height_m: float) -> None:
    """Latitude on the right, longitude on top."""
    from matplotlib.ticker import MaxNLocator

    per_deg = (
        displacement_ned(
            lat_rad + DEG, lon_rad + DEG, lat0_rad=lat_rad, lon0_rad=lon_rad, height0_m=height_m
        )
        / unit
    )
    right = ax.secondary_yaxis("right", functions=_scales(lat_rad / DEG, float(per_deg[0])))
    top = ax.secondary_xaxis("top", functions=_scales(lon_rad / DEG, float(per_deg[1])))
    for axis in (right.yaxis, top.xaxis):
        axis.set_major_locator(MaxNLocator(nbins=4))
    right.set_ylabel("latitude [deg]")
    top.set_xlabel("longitude [deg]")


def _scales(origin_deg: float, per_deg: float) -> tuple[Any, Any]:
    """From the grid's unit to degrees, and back."""

    def degrees(distance: Any) -> Any:
        return origin_deg + np.asarray(distance, dtype=float) / per_deg

    def distance(degree: Any) -> Any:
        return (np.asarray(degree, dtype=float) - origin_deg) * per_deg

    return degrees, distance


def _grid(track: Track, lat_rad: float, lon_rad: float, height_m: float) -> NDArray:
    return displacement_ned(
        track.lat_rad, track.lon_rad, lat0_rad=lat_rad, lon0_rad=lon_rad, height0_m=height_m
    )


@in_style
def aided_figures(result: "ReplayResult") -> dict[str, Markup | None]:
    """Drawings by name of AIDED_FIGURES; None where there is no aided solution."""
    aided = result.aided
    if aided is None or aided.history is None:
        return dict.fromkeys(AIDED_FIGURES)
    columns = aided_columns(aided)
    return {
        "aided_attitude": _attitude(columns),
        "aided_velocity": _velocity(columns, result),
        "aided_biases": _biases(columns),
        "innovations": _innovations(aided),
        "aided_sigma": _sigma(aided, columns, result),
        "smoothed_sigma": _smoothed_sigma(aided, columns),
    }


def _smoothed_sigma(aided: AidedResult, columns: dict[str, NDArray]) -> Markup | None:
    """Sigmas of filter and smoother, level and heading."""
    best = smoothed_result(aided)
    if best is None:
        return None
    figure, axes = new_figure(1, 2, height=3.0)
    solutions = ("filter", columns, STYLES["gnss"]), ("smoothed", aided_columns(best), SMOOTHED)
    for name, of, style in solutions:
        minutes, level = of["time_s"] / 60.0, np.hypot(of["sigma_north_m"], of["sigma_east_m"])
        for ax, sigma in ((axes[0, 0], level), (axes[0, 1], of["sigma_heading_deg"])):
            t, s = thinned(minutes, sigma)
            ax.plot(t, s, **{**style, "label": name})
    for ax, title, unit in zip(axes[0], ("Level position", "Heading"), ("m", "deg")):
        _decades(ax)
        axis_text(ax, title=title, x=TIME, y=f"sigma [{unit}]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2)
    return svg_text(figure, "Sigmas of level position and heading, filter and smoothed")


def _banded(
    ax: "Axes", minutes: NDArray, value: NDArray, sigma: NDArray, colour: str, line: str
) -> None:
    """A curve with its one-sigma band."""
    t, y, s = thinned(minutes, value, sigma)
    ax.fill_between(t, y - s, y + s, color=colour, **BAND)
    ax.plot(t, y, color=colour, linestyle=line, linewidth=1.3)


def _attitude(columns: dict[str, NDArray]) -> Markup:
    figure, axes = new_figure(2, 3, height=4.4, sharex=True)
    minutes = columns["time_s"] / 60.0
    for k, name in enumerate(("roll", "pitch", "heading")):
        angle = columns[f"{name}_deg"]
        angle = np.unwrap(angle, period=360.0) if name == "heading" else _broken(angle)
        t, y, s = thinned(minutes, angle, columns[f"sigma_{name}_deg"])
        axes[0, k].plot(t, y, color=GREEN, linewidth=1.2)
        axes[1, k].plot(t, s, color=GREEN)
        _decades(axes[1, k])
        axis_text(
            axes[0, k], title=f"{name.capitalize()}{', continuous' if name == 'heading' else ''}"
        )
        axis_text(axes[1, k], title=f"Sigma of the {name}", x=TIME)
    axes[0, 0].set_ylabel("angle [deg]")
    axes[1, 0].set_ylabel("sigma [deg]")
    return svg_text(figure, "Aided roll, pitch and heading, and their sigmas")


def _decades(ax: "Axes") -> None:
    """A logarithmic axis with plain numbers (reports draw no mathematical text), a few of them also
    within a decade.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    ax.set_yscale("log")
    low, high = ax.get_ylim()
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 100.0 * low else (1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())


def _broken(angle: NDArray) -> NDArray:
    """Jumps over +-180 deg are not drawn."""
    out = np.array(angle)
    out[1:][np.abs(np.diff(angle)) > 180.0] = np.nan
    return out


def _velocity(columns: dict[str, NDArray], result: "ReplayResult") -> Markup:
    figure, axes = new_figure(1, 3, height=2.9)
    gnss = result.run.gnss
    for k, (name, title) in enumerate((("vn", "North"), ("ve", "East"), ("vd", "Down"))):
        ax = axes[0, k]
        if gnss is not None:
            t, y = thinned(gnss.time_s / 60.0, gnss.v_n_m_s[:, k])
            ax.plot(t, y, **STYLES["gnss"])
        t, y = thinned(columns["time_s"] / 60.0, columns[f"{name}_m_s"])
        ax.plot(t, y, color=GREEN, linewidth=1.1, label="aided")
        axis_text(ax, title=f"{title} velocity", x=TIME)
    axes[0, 0].set_ylabel("velocity [m/s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2)
    return svg_text(figure, "North, east and down velocity, GNSS and aided")


def _biases(columns: dict[str, NDArray]) -> Markup:
    """Gyro and accelerometer biases beyond the compensation, with one-sigma bands."""
    figure, axes = new_figure(2, 3, height=4.6, sharex=True)
    minutes = columns["time_s"] / 60.0
    for row, (sensor, unit, factor, words) in enumerate(
        (("gyro", "deg_h", 1.0, "deg/h"), ("accel", "ug", 1e-3, "mg"))
    ):
        for k, axis in enumerate("xyz"):
            bias, sigma = (
                factor * columns[f"{p}{sensor}_bias_{axis}_{unit}"] for p in ("", "sigma_")
            )
            _banded(axes[row, k], minutes, bias, sigma, AXIS_COLOURS[axis], AXIS_LINES[axis])
            low, high, settled = bias - sigma, bias + sigma, slice(bias.size // 2, None)
            inner = np.concatenate([bias, low[settled], high[settled]])
            axes[row, k].set_ylim(*robust_limits(inner, np.concatenate([low, high])))
            axis_text(axes[row, k], title=f"{sensor.capitalize()} {axis}", x=TIME if row else "")
        axes[row, 0].set_ylabel(f"bias [{words}]")
    return svg_text(figure, "Gyro and accelerometer biases over time with their one-sigma bands")


def _innovations(aided: AidedResult) -> Markup:
    """Innovations over their sigmas; rejected fixes as crosses at the edge."""
    from ins.filters.aided_kernel import REJECTED, USED

    history = aided.history
    assert history is not None
    figure, axes = new_figure(2, 3, height=4.2, sharex=True, sharey=True)
    for row, kind in enumerate(KINDS):
        used, rejected = (
            np.flatnonzero(history.used[:, row] == state) for state in (USED, REJECTED)
        )
        for k, name in enumerate(("north", "east", "down")):
            ax, over = (
                axes[row, k],
                history.residual[:, 3 * row + k] / history.sigma[:, 3 * row + k],
            )
            ax.axhspan(-2, 2, color=SKY, alpha=0.18, linewidth=0.0)
            t, y = thinned(history.fix_time_s[used] / 60.0, over[used], most=MAX_DOTS)
            ax.plot(t, y, color=BLACK, marker=".", markersize=2.0, linestyle="none")
            t, y = thinned(history.fix_time_s[rejected] / 60.0, np.clip(over[rejected], -5.6, 5.6))
            ax.plot(t, y, color=OLD, marker="x", markersize=4.0, linestyle="none")
            axis_text(ax, title=f"{kind.capitalize()}, {name}", x=TIME if row else "")
        axes[row, 0].set_ylabel("over sigma")
    axes[0, 0].set_ylim(-6.0, 6.0)
    return svg_text(
        figure, "Innovations over their sigmas; two sigmas shaded, rejected fixes as crosses"
    )


def _sigma(aided: AidedResult, columns: dict[str, NDArray], result: "ReplayResult") -> Markup:
    """Sigma of the level position and velocity, and what each fix says they are off."""
    history = aided.history
    assert history is not None
    figure, axes = new_figure(1, 2, height=3.0)
    minutes = columns["time_s"] / 60.0
    for k, (kind, names, unit) in enumerate(
        (
            ("position", ("sigma_north_m", "sigma_east_m"), "m"),
            ("velocity", ("sigma_vn_m_s", "sigma_ve_m_s"), "m/s"),
        )
    ):
        ax = axes[0, k]
        rows = np.flatnonzero(np.isfinite(history.residual[:, 3 * k]))
        t, off = thinned(
            history.fix_time_s[rows] / 60.0,
            np.linalg.norm(history.residual[rows, 3 * k : 3 * k + 2], axis=1),
            most=MAX_DOTS,
        )
        dots: LineStyle = {"marker": ".", "markersize": 2.0, "linestyle": "none"}
        ax.plot(t, np.maximum(off, 1e-4), color=GREY, label="GNSS less prediction", **dots)
        t, s = thinned(minutes, np.hypot(*(columns[name] for name in names)))
        ax.plot(t, s, color=GREEN, label="sigma of the solution")
        _decades(ax)
        axis_text(ax, title=f"Level {kind}", x=TIME, y=f"{kind} [{unit}]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2)
    return svg_text(
        figure,
        "Sigma of level position and velocity, against the difference of each fix from its"
        " prediction",
    )
